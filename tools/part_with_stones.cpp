// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/part_with_stones.hpp"

#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "core/files.hpp"
#include "core/run_part.hpp"
#include "tools/jobs.hpp"

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

std::vector<meshing::PlacedStone> stones_over(const ModelField& design,
                                              const meshing::NodeWindow& window,
                                              std::span<const meshing::PlacedStone> stones) {
  const auto within = [](double p, double from, double to, bool first, bool last) {
    return (first || p >= from) && (last || p < to);
  };
  std::vector<meshing::PlacedStone> over;
  for (const auto& s : stones) {
    const Vec3 at = s.model_from_stone.translation_mm;
    if (within(at.x, design.x_mm(window.col0), design.x_mm(window.col1), window.col0 == 0,
               window.col1 + 1 == design.z_mm.cols()) &&
        within(at.y, design.y_mm(window.row0), design.y_mm(window.row1), window.row0 == 0,
               window.row1 + 1 == design.z_mm.rows()))
      over.push_back(s);
  }
  return over;
}

std::vector<int> numbers_of(std::span<const meshing::PlacedStone> stones) {
  std::vector<int> numbers;
  for (const auto& s : stones) numbers.push_back(s.number);
  return numbers;
}

Result<PartWithStones> part_with_stones(const ModelField& design, const meshing::NodeWindow& window,
                                        std::span<const meshing::PlacedStone> stones,
                                        const meshing::SolidOptions& options,
                                        const meshing::Shaping& shaping, const fs::path& out,
                                        const RunContext& run) {
  ModelField copy;
  const bool whole = window == meshing::all_nodes(design);
  if (!whole) copy = meshing::window_field(design, window);
  const ModelField& piece = whole ? design : copy;
  std::vector<TriMesh> bodies;
  for (const auto& s : stones) bodies.push_back(meshing::stone_mesh(s));
  PartWithStones made;
  MAQUETTE_TRY(made.mesh, meshing::volume_solid(piece, bodies, options, part(run, 0.0, 0.4)));
  if (!whole) count_from_the_whole(made.mesh, piece, design, window);
  const std::uint64_t top = meshing::top_triangles(made.mesh, piece);
  made.mesh = meshing::shaped(std::move(made.mesh), piece, shaping);
  MAQUETTE_TRY(made.certificate,
               meshing::check_mesh(made.mesh, &piece, {.top_triangles = top, .stones = bodies},
                                   part(run, 0.4, 1.0)));
  made.certificate.rounding_mm = 0.0;  // PLY as we write it is float64
  if (made.certificate.passed()) return made;
  const fs::path refused = out.parent_path() / (out.stem().string() + ".refused.json");
  MAQUETTE_TRY_VOID(write_file(refused, meshing::to_json(made.certificate)));
  return fail(made.certificate.sound() ? kSolidInexact : kMeshFailed,
              fmt::format("{}: the mesh did not pass its checks and was not written ({}); see {}",
                          out.string(), meshing::shortcomings(made.certificate), refused.string()));
}

}  // namespace maquette::tools
