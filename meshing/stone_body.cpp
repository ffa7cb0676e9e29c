// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/stone_body.hpp"

#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "assets/rocks.hpp"
#include "core/check.hpp"
#include "core/files.hpp"
#include "meshing/detail/solid_mass.hpp"
#include "meshing/mesh_io.hpp"

namespace maquette::meshing {
namespace {

constexpr double kMillimetresPerMetre = 1000.0;

}  // namespace

std::string to_text(const MeshRepairs& r) {
  std::vector<std::string> parts;
  const auto add = [&](std::size_t count, std::string_view one, std::string_view many) {
    if (count > 0) parts.push_back(fmt::format("{} {}", count, count == 1 ? one : many));
  };
  add(r.merged_points, "point merged", "points merged");
  add(r.repeated_faces, "repeated triangle dropped", "repeated triangles dropped");
  add(r.degenerate_faces, "triangle without area removed", "triangles without area removed");
  add(r.turned_faces, "triangle turned", "triangles turned");
  add(r.filled_holes, "hole filled", "holes filled");
  add(r.dropped_pieces, "loose piece dropped", "loose pieces dropped");
  add(r.filled_cavities, "cavity filled", "cavities filled");
  return parts.empty() ? "none" : fmt::format("{}", fmt::join(parts, ", "));
}

bool operator==(const StoneBody& a, const StoneBody& b) {
  return a.name == b.name && a.mesh.vertices_mm == b.mesh.vertices_mm &&
         a.mesh.triangles == b.mesh.triangles && a.source == b.source &&
         a.source_sha256 == b.source_sha256 && a.mm_per_unit == b.mm_per_unit &&
         a.diameter_mm == b.diameter_mm && a.volume_mm3 == b.volume_mm3 && a.repairs == b.repairs;
}

Result<StoneBody> read_stone_body(const std::filesystem::path& path,
                                  std::optional<double> mm_per_unit, const RunContext& run) {
  MAQUETTE_CHECK(!mm_per_unit || *mm_per_unit > 0.0, "{}", *mm_per_unit);
  MAQUETTE_TRY(const TriMesh mesh, read_mesh(path, run));
  MeshRepairs repairs;
  auto repaired = repair_stone(mesh, repairs, run);
  if (!repaired) return tl::unexpected(std::move(repaired.error()).within(path.string()));
  MAQUETTE_TRY(const bool gltf, is_gltf(path));
  StoneBody body;
  body.name = path.stem().string();
  body.source = path.filename().string();
  MAQUETTE_TRY(body.source_sha256, sha256_file(path));
  body.mm_per_unit = mm_per_unit.value_or(gltf ? kMillimetresPerMetre : 1.0);
  // read_mesh gives a glTF's metres in millimetres already.
  const double scale = body.mm_per_unit / (gltf ? kMillimetresPerMetre : 1.0);
  body.mesh = std::move(*repaired);
  const detail::SolidMass mass = detail::solid_mass(body.mesh);
  for (Vec3& v : body.mesh.vertices_mm) v = v - mass.centre;
  const double diameter = assets::equivalent_diameter(body.mesh.vertices_mm);
  for (Vec3& v : body.mesh.vertices_mm) v = (1.0 / diameter) * v;
  body.diameter_mm = scale * diameter;
  body.volume_mm3 = scale * scale * scale * mass.volume;
  body.repairs = to_text(repairs);
  return body;
}

}  // namespace maquette::meshing
