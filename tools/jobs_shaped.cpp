// SPDX-License-Identifier: GPL-3.0-or-later

// maquette mesh --hollow-mm, --label, --scale-bar: solids with another underside, engraved walls,
// with stones and without

#include "tools/jobs_shaped.hpp"

#include <algorithm>
#include <iterator>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/ball_offset.hpp"
#include "core/files.hpp"
#include "core/run_part.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/shaped_solid.hpp"
#include "tools/part_with_stones.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {
namespace {

using meshing::MeshCertificate;
using nlohmann::ordered_json;

ordered_json hollow_json(const meshing::Underside& u, const meshing::HollowOptions& o) {
  return {{"wall_mm", o.wall.value()},
          {"rib_mm", o.rib.value()},
          {"pockets", {u.pockets_x, u.pockets_y}},
          {"pocket_mm", {u.pocket_x_mm, u.pocket_y_mm}},
          {"removed_mm3", u.volume_mm3},
          {"ceilings_mm", {u.lowest_ceiling_mm, u.highest_ceiling_mm}},
          {"mean_excess_mm", u.mean_excess_mm},
          {"most_excess_mm", u.most_excess_mm}};
}

ordered_json engraved_json(const std::vector<meshing::WallMark>& marks,
                           const std::vector<meshing::EngravedWall>& walls,
                           const meshing::EngravingStyle& style) {
  ordered_json list = ordered_json::array();
  for (std::size_t i = 0; i < marks.size(); ++i)
    list.push_back({{"what", marks[i].name},
                    {"width_mm", marks[i].width_mm},
                    {"depth_mm", style.depth.value()},
                    {"stroke_mm", style.stroke_mm()},
                    {"removed_mm3", walls[i].volume_mm3}});
  return list;
}

/// Of what the construction proves CGAL looks at meshes up to this size, too: 44 CPU s, 1 GiB.
constexpr std::uint64_t kLookedAtTwice = 4'000'000;

/// What the construction proves, and where it is not too large CGAL's word on it, too.
Result<MeshCertificate> prove(const meshing::ShapedSolid& solid, const RunContext& run) {
  MAQUETTE_TRY(MeshCertificate proven, solid.certify(part(run, 0.0, 0.3)));
  if (proven.triangles > kLookedAtTwice) return proven;
  TriMesh mesh;
  mesh.vertices_mm.resize(solid.vertex_count());
  mesh.triangles.resize(solid.triangle_count());
  solid.vertices(0, mesh.vertices_mm);
  solid.triangles(0, mesh.triangles);
  MAQUETTE_TRY(const MeshCertificate found,
               meshing::check_mesh(mesh, nullptr, {}, part(run, 0.3, 1.0)));
  if (!found.passed())
    return fail(kMeshFailed,
                fmt::format("CGAL does not find the solid valid ({}); it was not written: {}",
                            meshing::shortcomings(found), to_json(found)));
  proven.proof += ", and CGAL";
  return proven;
}

/// Label and scale bar into walls, beside their holes; what the certificate says of them.
Result<void> engrave(const heightmap::ModelField& design, const meshing::NodeWindow& window,
                     Millimetres base_z, const Shape& shape, meshing::Shaping& shaping,
                     ordered_json& figures, const RunContext& run) {
  std::vector<meshing::WallMark> marks;
  if (!shape.label.empty()) {
    MAQUETTE_TRY(marks.emplace_back(), meshing::text_mark(shape.label, shape.engraving));
  }
  if (shape.scale_denominator != 0.0) {
    MAQUETTE_TRY(
        marks.emplace_back(),
        meshing::scale_bar_mark(shape.scale_denominator,
                                meshing::wall_length_mm(design, window, shape.engraving.side),
                                shape.engraving));
  }
  MAQUETTE_TRY(auto engraved, meshing::engrave_wall(design, window, base_z, marks, shape.engraving,
                                                    shaping.walls, run));
  figures["engraved"] = engraved_json(marks, engraved, shape.engraving);
  std::move(engraved.begin(), engraved.end(), std::back_inserter(shaping.walls));
  return {};
}

/// @param piece  the design over the window
Result<void> hollow(const heightmap::ModelField& piece, Millimetres base_z,
                    const meshing::HollowOptions& options, meshing::Shaping& shaping,
                    ordered_json& figures, const RunContext& run) {
  MAQUETTE_TRY(const auto roof,
               cnc::offset_surface(piece, Millimetres{-options.wall.value()}, part(run, 0.0, 0.7)));
  MAQUETTE_TRY(shaping.underside,
               meshing::hollow_underside(piece, roof, base_z, options, part(run, 0.7, 1.0)));
  figures["hollow"] = hollow_json(shaping.underside, options);
  return {};
}

Result<JobResult> shape(const heightmap::ModelField& design, const ShapedJob& job,
                        const fs::path& out, const RunContext& run) {
  meshing::Tile tile{1, 1, 1, meshing::all_nodes(design)};
  std::vector<meshing::Tile> tiles{tile};
  if (job.band) {
    MAQUETTE_TRY(const auto bands, meshing::split_into_bands(design, job.band->split));
    MAQUETTE_CHECK(job.band->index < bands.size(), "band {} of {}", job.band->index, bands.size());
    tiles.clear();
    for (const meshing::Band& b : bands) {
      const bool along_x = b.axis == meshing::BandAxis::x;
      tiles.push_back({b.number, along_x ? 1 : b.number, along_x ? b.number : 1,
                       meshing::band_window(design, b)});
    }
    tile = tiles[job.band->index];
  }
  const auto options = solid_options(design, job.base_thickness);
  MAQUETTE_TRY(JointHoles holes,
               place_holes(design, tiles, options.base_z, job.base_thickness, job.in_joints));
  JobResult result;
  result.outputs = {out, certificate_path(out)};
  // Once for all strips, with the first.
  if (job.band && job.band->index == 0)
    MAQUETTE_TRY_VOID(write_pins(holes, out.parent_path(), result.outputs));
  for (HolesOfKind* kind : {&holes.dowels, &holes.magnets})
    std::erase_if(kind->places, [&](const meshing::Dowel& d) {
      return d.tiles[0] != tile.number && d.tiles[1] != tile.number;
    });
  MAQUETTE_TRY(const ShapedPart shaped,
               shape_part(design, tile.nodes, options.base_z, job.shape,
                          holes_of(design, tile, options.base_z, holes), part(run, 0.0, 0.4)));
  std::vector<meshing::PlacedStone> stones;
  if (job.stones) {
    MAQUETTE_TRY(stones, meshing::read_stone_plan(*job.stones));
    stones = stones_over(design, tile.nodes, stones);
  }
  MAQUETTE_TRY(const MeshCertificate certificate,
               write_part(
                   design, tile.nodes, stones, options, shaped.shaping, out,
                   [&](const MeshStream& mesh) { return meshing::write_ply(mesh, out); },
                   part(run, 0.4, 1.0)));

  auto text = ordered_json::parse(meshing::to_json(certificate));
  text.update(ordered_json::parse(shaped.figures_json));
  text.update(ordered_json::parse(to_json(holes)));
  if (job.stones && job.band) text["stones"] = numbers_of(stones);
  result.figures_json = text.dump(2) + "\n";
  MAQUETTE_TRY_VOID(write_file(result.outputs[1], result.figures_json));
  result.note = fmt::format("{} triangles{}, closed, manifold", certificate.triangles,
                            stones.empty() ? "" : fmt::format(" with {} stones", stones.size()));
  if (const double removed = shaped.shaping.underside.volume_mm3; job.shape.hollow)
    result.note += fmt::format(", {:.1f} of {:.1f} cm^3 hollow", 1e-3 * removed,
                               1e-3 * (removed + certificate.volume_mm3));
  return result;
}

}  // namespace

Result<ShapedPart> shape_part(const heightmap::ModelField& design,
                              const meshing::NodeWindow& window, Millimetres base_z,
                              const Shape& shape, Holes holes, const RunContext& run) {
  ShapedPart result;
  result.shaping.walls = std::move(holes.walls);
  ordered_json figures = ordered_json::object();
  if (shape.engraves())
    MAQUETTE_TRY_VOID(
        engrave(design, window, base_z, shape, result.shaping, figures, part(run, 0.0, 0.1)));
  heightmap::ModelField copy;
  if (window != meshing::all_nodes(design)) copy = meshing::window_field(design, window);
  const heightmap::ModelField& piece = copy.z_mm.rows() > 0 ? copy : design;
  if (shape.hollow) {
    meshing::HollowOptions options = *shape.hollow;
    options.cut = holes.depth;
    if (Millimetres& cut = options.cut[static_cast<std::size_t>(shape.engraving.side)];
        shape.engraves())
      cut = std::max(cut, shape.engraving.depth);
    MAQUETTE_TRY_VOID(hollow(piece, base_z, options, result.shaping, figures, part(run, 0.1, 1.0)));
  } else {
    result.shaping.underside = meshing::plain_underside(piece, base_z);
  }
  result.figures_json = figures.dump();
  return result;
}

Result<MeshCertificate> write_part(const heightmap::ModelField& design,
                                   const meshing::NodeWindow& window,
                                   std::span<const meshing::PlacedStone> stones,
                                   const meshing::SolidOptions& options,
                                   const meshing::Shaping& shaping, const fs::path& out,
                                   const std::function<Result<void>(const MeshStream&)>& write,
                                   const RunContext& run) {
  if (stones.empty()) {
    MAQUETTE_TRY(const auto solid, meshing::ShapedSolid::create(design, window, options, shaping));
    MAQUETTE_TRY(MeshCertificate certificate, prove(solid, part(run, 0.0, 0.8)));
    MAQUETTE_TRY_VOID(write(solid));
    return certificate;
  }
  MAQUETTE_TRY(const PartWithStones made, part_with_stones(design, window, stones, options, shaping,
                                                           out, part(run, 0.0, 0.9)));
  MAQUETTE_TRY_VOID(write(TriMeshStream(made.mesh)));
  return made.certificate;
}

Result<JobResult> shaped_job(const ShapedJob& job, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(job.design));
  auto result = shape(design, job, out, run);
  if (result) return result;
  const std::string which = job.band ? fmt::format(": band {}", job.band->index + 1) : "";
  return tl::unexpected(std::move(result.error()).within(job.design.string() + which));
}

}  // namespace maquette::tools
