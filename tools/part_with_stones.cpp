// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/part_with_stones.hpp"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/run_part.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "tools/jobs.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {
namespace {

using heightmap::ModelField;

/// Coordinates of nodes as the whole counts them: those that a piece counts from its own first node
/// differ in the last bit where the spacing is no power of two, and neighbours would not meet.
void count_from_the_whole(TriMesh& mesh, const ModelField& piece, const ModelField& whole,
                          const meshing::NodeWindow& window) {
  const double spacing = piece.spacing.value();
  for (Vec3& v : mesh.vertices_mm) {
    const auto c = std::lround((v.x - piece.x_mm(0)) / spacing);
    const auto r = std::lround((v.y - piece.y_mm(0)) / spacing);
    if (v.x == piece.x_mm(c) && v.y == piece.y_mm(r)) {
      v.x = whole.x_mm(window.col0 + c);
      v.y = whole.y_mm(window.row0 + r);
    }
  }
}

}  // namespace

Result<PartWithStones> part_with_stones(const ModelField& design, const meshing::NodeWindow& window,
                                        std::span<const meshing::PlacedStone> stones,
                                        const meshing::SolidOptions& options,
                                        const RunContext& run) {
  const ModelField piece = meshing::window_field(design, window);
  PartWithStones made;
  std::vector<TriMesh> bodies;
  for (const auto& s : stones) {
    const Vec3 at = s.model_from_stone.translation_mm;
    // Of a joint's two sides the eastern and northern one has what stands exactly on it.
    if (at.x < design.x_mm(window.col0) || at.x >= design.x_mm(window.col1) ||
        at.y < design.y_mm(window.row0) || at.y >= design.y_mm(window.row1))
      continue;
    bodies.push_back(meshing::stone_mesh(s));
    made.stones.push_back(s.number);
  }
  MAQUETTE_TRY(made.mesh, meshing::volume_solid(piece, bodies, options, part(run, 0.0, 0.5)));
  count_from_the_whole(made.mesh, piece, design, window);
  MAQUETTE_TRY(made.certificate,
               meshing::check_mesh(made.mesh, &piece, {.stones = bodies}, part(run, 0.5, 1.0)));
  made.certificate.rounding_mm = 0.0;  // PLY as we write it is float64
  if (!made.certificate.passed())
    return fail(made.certificate.sound() ? kSolidInexact : kMeshFailed,
                fmt::format("the solid with {} stones was not written: {}", made.stones.size(),
                            meshing::shortcomings(made.certificate)));
  return made;
}

Result<JobResult> band_with_stones_job(const fs::path& design_path, const fs::path& stones_path,
                                       const meshing::BandSplit& split, std::size_t band,
                                       Millimetres base_thickness, const fs::path& out,
                                       const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  MAQUETTE_TRY(const auto stones, meshing::read_stone_plan(stones_path));
  MAQUETTE_TRY(const auto bands, meshing::split_into_bands(design, split));
  MAQUETTE_CHECK(band < bands.size(), "band {} of {}", band, bands.size());
  const auto options = solid_options(design, base_thickness);
  auto made = part_with_stones(design, meshing::band_window(design, bands[band]), stones, options,
                               part(run, 0.0, 0.9));
  if (!made)
    return tl::unexpected(
        std::move(made.error()).within(fmt::format("{}: band {}", design_path.string(), band + 1)));
  MAQUETTE_TRY_VOID(meshing::write_ply(made->mesh, out, part(run, 0.9, 1.0)));
  auto text = nlohmann::ordered_json::parse(meshing::to_json(made->certificate));
  text["stones"] = made->stones;
  JobResult result;
  result.outputs = {out, certificate_path(out)};
  result.figures_json = text.dump(2) + "\n";
  MAQUETTE_TRY_VOID(write_file(result.outputs.back(), result.figures_json));
  result.note = fmt::format("{} triangles with {} stones, closed, manifold",
                            made->certificate.triangles, made->stones.size());
  return result;
}

}  // namespace maquette::tools
