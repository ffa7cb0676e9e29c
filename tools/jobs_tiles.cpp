// SPDX-License-Identifier: GPL-3.0-or-later

// maquette bands with tiles: joints that no stone stands on, solids that share their walls

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "tools/exploded_view.hpp"
#include "tools/jobs_bands.hpp"
#include "tools/jobs_tiles.hpp"
#include "tools/part_with_stones.hpp"
#include "tools/set_aside.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {
namespace {

using meshing::MeshCertificate;
using meshing::Tile;
using nlohmann::json;

/// The same mesh with its south-western corner and base at the origin.
class OwnFrame final : public MeshStream {
 public:
  OwnFrame(const MeshStream& mesh, Vec3 origin) : mesh_(mesh), origin_(origin) {}
  [[nodiscard]] std::uint64_t vertex_count() const override { return mesh_.vertex_count(); }
  [[nodiscard]] std::uint64_t triangle_count() const override { return mesh_.triangle_count(); }
  void vertices(std::uint64_t first, std::span<Vec3> out) const override {
    mesh_.vertices(first, out);
    for (Vec3& v : out) v = v - origin_;
  }
  void triangles(std::uint64_t first, std::span<Triangle> out) const override {
    mesh_.triangles(first, out);
  }
  void corners(std::uint64_t first, std::span<Corners> out) const override {
    mesh_.corners(first, out);
    for (Corners& c : out)
      for (Vec3& v : c) v = v - origin_;
  }

 private:
  const MeshStream& mesh_;
  Vec3 origin_;
};

/// From above: tiles with their numbers, stones with theirs. Millimetres.
std::string plan_svg(const heightmap::ModelField& design, const std::vector<Tile>& tiles,
                     const std::vector<meshing::PlacedStone>& stones, const JointHoles& holes) {
  const double x0 = design.x_mm(0), y1 = design.y_mm(design.z_mm.rows() - 1);
  const double width = design.x_mm(design.z_mm.cols() - 1) - x0, height = y1 - design.y_mm(0);
  const double line = 0.002 * std::max(width, height), letter = 15.0 * line;
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}mm\" height=\"{1}mm\" "
      "viewBox=\"{2} {2} {3} {4}\" font-family=\"sans-serif\" text-anchor=\"middle\">\n"
      "<g fill=\"none\" stroke=\"black\" stroke-width=\"{5}\">\n",
      width, height, -line, width + 2 * line, height + 2 * line, line);
  std::string texts = fmt::format("<g font-size=\"{}\">\n", letter);
  double deepest = 0.0;  // numbers stand above what comes in from the joint
  for (const HolesOfKind* kind : {&holes.dowels, &holes.magnets})
    if (kind->wanted) deepest = std::max(deepest, kind->options.depth_mm);
  for (const Tile& t : tiles) {
    const double west = design.x_mm(t.nodes.col0) - x0, east = design.x_mm(t.nodes.col1) - x0;
    const double north = y1 - design.y_mm(t.nodes.row1), south = y1 - design.y_mm(t.nodes.row0);
    svg += fmt::format("<rect x=\"{:.4f}\" y=\"{:.4f}\" width=\"{:.4f}\" height=\"{:.4f}\"/>\n",
                       west, north, east - west, south - north);
    texts += fmt::format("<text x=\"{:.4f}\" y=\"{:.4f}\">{}</text>\n", 0.5 * (west + east),
                         south - deepest - 0.5 * letter, t.number);
  }
  for (const HolesOfKind* kind : {&holes.dowels, &holes.magnets})
    for (const auto& d : kind->places) {
      const double x = d.centre_mm.x - x0, y = y1 - d.centre_mm.y, depth = kind->options.depth_mm;
      const double dx = d.along_x ? depth : 0.0, dy = d.along_x ? 0.0 : depth;
      svg += fmt::format(
          "<line x1=\"{:.4f}\" y1=\"{:.4f}\" x2=\"{:.4f}\" y2=\"{:.4f}\" stroke=\"{}\"/>\n", x - dx,
          y - dy, x + dx, y + dy, kind == &holes.dowels ? "#3060c0" : "#c03030");
    }
  svg += "</g>\n<g fill=\"#b08050\">\n";
  for (const auto& s : stones) {
    const Box3 box = meshing::stone_mesh(s).bounds();
    svg += fmt::format("<ellipse cx=\"{:.4f}\" cy=\"{:.4f}\" rx=\"{:.4f}\" ry=\"{:.4f}\"/>\n",
                       0.5 * (box.min.x + box.max.x) - x0, y1 - 0.5 * (box.min.y + box.max.y),
                       0.5 * (box.max.x - box.min.x), 0.5 * (box.max.y - box.min.y));
    texts += fmt::format("<text x=\"{:.4f}\" y=\"{:.4f}\" font-size=\"{}\">{}</text>\n",
                         box.max.x - x0 + 0.4 * letter, y1 - box.max.y, 0.6 * letter, s.number);
  }
  return svg + "</g>\n" + texts + "</g>\n</svg>\n";
}

ExplodedView view_of(const heightmap::ModelField& design, const std::vector<Tile>& tiles,
                     Millimetres base_z, std::span<const meshing::PlacedStone> stones,
                     const JointHoles& holes, bool with_stones) {
  ExplodedView view{
      .title = fmt::format("{:.6g} × {:.6g} mm in {} tiles",
                           design.x_mm(design.z_mm.cols() - 1) - design.x_mm(0),
                           design.y_mm(design.z_mm.rows() - 1) - design.y_mm(0), tiles.size()),
      .base_z = base_z,
      .stones = stones,
      .holes = holes};
  for (const Tile& t : tiles)
    view.parts.push_back({std::to_string(t.number), t.number, t.nodes, t.place - 1, t.strip - 1});
  if (!stones.empty())
    view.notes.push_back(
        fmt::format("{} stones, {}.", stones.size(),
                    with_stones ? "of one piece with the tiles" : "made apart and glued on"));
  return view;
}

/// What became of a tile.
struct MadeTile {
  MeshCertificate certificate;
  json figures = json::object();  ///< "hollow", "engraved"
};

/// One tile to its file. @param origin  of the file's frame
Result<MadeTile> make_tile(const heightmap::ModelField& design, const Tile& tile,
                           Millimetres base_z, const JointHoles& holes,
                           std::span<const meshing::PlacedStone> stones, const TilesJob& job,
                           Vec3 origin, const fs::path& file, const RunContext& run) {
  const auto write = [&](const MeshStream& mesh) {
    return job.own_frame ? meshing::write_ply(OwnFrame(mesh, origin), file)
                         : meshing::write_ply(mesh, file);
  };
  MadeTile made;
  const meshing::SolidOptions options{.base_z = base_z};
  Holes own = holes_of(design, tile, base_z, holes);
  Shape shape = job.shape;
  if (!shape.label.empty()) shape.label += fmt::format(" {}", tile.number);
  MAQUETTE_TRY(const ShapedPart part,
               shape_part(design, tile.nodes, base_z, shape, std::move(own), run));
  made.figures = json::parse(part.figures_json);
  std::vector<meshing::PlacedStone> own_stones;
  if (job.with_stones) {
    own_stones = stones_over(design, tile.nodes, stones);
    made.figures["stones"] = numbers_of(own_stones);
  }
  MAQUETTE_TRY(made.certificate,
               write_part(design, tile.nodes, own_stones, options, part.shaping, file, write, run));
  return made;
}

}  // namespace

Result<JobResult> tiles_job(const TilesJob& job, const fs::path& folder, const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(job.design));
  std::vector<meshing::PlacedStone> stones;
  if (job.stones) {
    MAQUETTE_TRY(stones, meshing::read_stone_plan(*job.stones));
  }
  auto tiles = meshing::split_into_tiles(design, stones, job.options);
  if (!tiles) return tl::unexpected(std::move(tiles.error()).within(job.design.string()));
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  const Millimetres base_z = solid_options(design, job.base_thickness).base_z;
  const auto holes = place_holes(design, *tiles, base_z, job.base_thickness, job.in_joints);
  if (!holes) return tl::unexpected(Error(holes.error()).within(job.design.string()));

  MAQUETTE_TRY_VOID(set_aside_beyond(folder, "tile_", tiles->size(), run));
  JobResult result;
  json list = json::array();
  double volume = 0.0;
  for (std::size_t i = 0; i < tiles->size(); ++i) {
    if (run.stopped()) return fail(kCancelled, "cutting into tiles was stopped");
    const Tile& t = (*tiles)[i];
    const Vec3 corner{design.x_mm(t.nodes.col0), design.y_mm(t.nodes.row0), base_z.value()};
    const Vec3 origin = job.own_frame ? corner : Vec3{};
    const std::string name = fmt::format("tile_{:02}", t.number);
    result.outputs.push_back(folder / (name + ".ply"));
    auto made =
        make_tile(design, t, base_z, *holes, stones, job, origin, result.outputs.back(), run);
    if (!made)
      return tl::unexpected(std::move(made.error())
                                .within(fmt::format("{}: tile {}", job.design.string(), t.number)));
    result.outputs.push_back(folder / (name + ".certificate.json"));
    auto text = nlohmann::ordered_json::parse(meshing::to_json(made->certificate));
    text.update(made->figures);
    MAQUETTE_TRY_VOID(write_file(result.outputs.back(), text.dump(2) + "\n"));
    volume += made->certificate.volume_mm3;
    list.push_back({{"file", name + ".ply"},
                    {"number", t.number},
                    {"strip", t.strip},
                    {"place", t.place},
                    {"x_mm", {corner.x, design.x_mm(t.nodes.col1)}},
                    {"y_mm", {corner.y, design.y_mm(t.nodes.row1)}},
                    {"origin_mm", {origin.x, origin.y, origin.z}},
                    {"volume_mm3", made->certificate.volume_mm3}});
    list.back().update(made->figures);
    run.progress(static_cast<double>(i + 1) / static_cast<double>(tiles->size()));
  }
  MAQUETTE_TRY_VOID(write_pins(*holes, folder, result.outputs));
  result.outputs.push_back(folder / "tiles.svg");
  MAQUETTE_TRY_VOID(write_file(result.outputs.back(), plan_svg(design, *tiles, stones, *holes)));
  const ExplodedView view = view_of(design, *tiles, base_z, stones, *holes, job.with_stones);
  MAQUETTE_TRY_VOID(write_exploded(design, view, folder, result.outputs));
  json figures{{"tiles", list}, {"volume_mm3", volume}};
  figures.update(json::parse(to_json(*holes)));
  result.outputs.push_back(folder / "tiles.json");
  MAQUETTE_TRY_VOID(write_file(result.outputs.back(), figures.dump(2) + "\n"));
  result.figures_json = figures.dump();
  result.note = fmt::format("{} tiles", tiles->size());
  if (job.in_joints.dowels) result.note += fmt::format(", {} dowels", holes->dowels.places.size());
  if (job.in_joints.magnets)
    result.note += fmt::format(", {} pairs of magnets", holes->magnets.places.size());
  return result;
}

}  // namespace maquette::tools
