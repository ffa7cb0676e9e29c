// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/mesh_cloud.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/files.hpp"
#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/cloud_survey.hpp"
#include "scan/detail/dual_mesh.hpp"
#include "scan/detail/mesh_borders.hpp"
#include "scan/detail/surfels.hpp"

namespace maquette::scan {
namespace {

using detail::KeyMap;
using detail::Surfel;
using detail::VoxelGrid;

// Reach of a piece in voxels: nodes up to two voxels away feel it, by exp(-d^2 / voxel^2).
constexpr std::int64_t kReach = 2;
// A border of that many voxels' length is that of a gap some three voxels wide: among points
// that lie as chance has it, four a voxel, such gaps are chance, too.
constexpr double kPinholeVoxels = 16.0;

/// The implicit function and the colour where it is known.
struct Field {
  const VoxelGrid& grid;
  const std::vector<Surfel>& surfels;
  const KeyMap& map;

  [[nodiscard]] Vec3 node(std::int64_t x, std::int64_t y, std::int64_t z) const {
    return grid.origin_mm + grid.voxel_mm * Vec3{static_cast<double>(x), static_cast<double>(y),
                                                 static_cast<double>(z)};
  }

  struct Value {
    double distance = 0.0, weight = 0.0;
    Vec3 gradient;  // of the planes, at fixed weights
    Vec3 colour;
  };
  /// Sum over the pieces around a place.
  [[nodiscard]] Value at(Vec3 p, bool with_colour) const {
    const Vec3 q = (1.0 / grid.voxel_mm) * (p - grid.origin_mm);
    const auto x0 = static_cast<std::int64_t>(std::floor(q.x - 0.5)),
               y0 = static_cast<std::int64_t>(std::floor(q.y - 0.5)),
               z0 = static_cast<std::int64_t>(std::floor(q.z - 0.5));
    const double per = 1.0 / (grid.voxel_mm * grid.voxel_mm);
    Value v;
    for (std::int64_t x = x0 - 1; x <= x0 + kReach; ++x)
      for (std::int64_t y = y0 - 1; y <= y0 + kReach; ++y)
        for (std::int64_t z = z0 - 1; z <= z0 + kReach; ++z) {
          const std::uint32_t i = map.find(VoxelGrid::key(x, y, z));
          if (i == KeyMap::npos) continue;
          const Surfel& s = surfels[i];
          const Vec3 d = p - s.centre_mm;
          const double w = std::exp(-dot(d, d) * per) * std::sqrt(static_cast<double>(s.points));
          v.weight += w;
          v.distance += w * dot(d, s.normal);
          v.gradient += w * s.normal;
          if (with_colour)
            v.colour += w * Vec3{static_cast<double>(s.red), static_cast<double>(s.green),
                                 static_cast<double>(s.blue)};
        }
    if (v.weight > 0.0) {
      const double share = 1.0 / v.weight;
      v.distance *= share;
      v.gradient = share * v.gradient;
      v.colour = share * v.colour;
    }
    return v;
  }
};

struct Vertex {
  Vec3 place;
  Colour colour;
  bool near = false;  // to points
};

/// The middle of a piece's crossings, moved onto the zero along the gradient.
Vertex vertex_of(const detail::DualGrid& cells, std::size_t k, unsigned piece, const Field& field,
                 bool coloured) {
  const VoxelGrid& grid = field.grid;
  const detail::CellSurfaces& surfaces = cells.surfaces[k];
  const std::array<float, 8> f = cells.at_corners(k);
  Vec3 sum;
  int crossings = 0;
  for (unsigned e = 0; e < 12; ++e) {
    if (!surfaces.crosses(e) || surfaces.piece(e) != piece) continue;
    const detail::Crossing c = detail::crossing_of(f, e);
    const Vec3 from = cells.corner_mm(k, c.from);
    sum += from + c.share * (cells.corner_mm(k, c.to) - from);
    ++crossings;
  }
  Vertex vertex;
  Vec3 p = (1.0 / crossings) * sum;
  Field::Value v = field.at(p, coloured);
  for (int round = 0; round < 2 && v.weight > 0.0; ++round) {
    const double square = dot(v.gradient, v.gradient);
    // Half a voxel at most: the vertex stays with its cell.
    if (!(square > 0.01) || std::abs(v.distance) > 0.5 * grid.voxel_mm) break;
    p = p - (v.distance / square) * v.gradient;
    v = field.at(p, coloured);
  }
  if (!(v.weight > 0.0)) return vertex;
  // Near points only: a piece within a voxel of the vertex.
  const std::uint64_t own = grid.key_of(p);
  for (std::int64_t dx = -1; dx <= 1 && !vertex.near; ++dx)
    for (std::int64_t dy = -1; dy <= 1 && !vertex.near; ++dy)
      for (std::int64_t dz = -1; dz <= 1 && !vertex.near; ++dz) {
        const std::uint32_t i = field.map.find(VoxelGrid::key(
            VoxelGrid::x_of(own) + dx, VoxelGrid::y_of(own) + dy, VoxelGrid::z_of(own) + dz));
        if (i == KeyMap::npos) continue;
        const Vec3 d = field.surfels[i].centre_mm - p;
        vertex.near = dot(d, d) < grid.voxel_mm * grid.voxel_mm;
      }
  vertex.place = p;
  const auto whole = [](double c) {
    return static_cast<std::uint16_t>(std::lround(std::clamp(c, 0.0, 65'535.0)));
  };
  if (coloured) vertex.colour = {whole(v.colour.x), whole(v.colour.y), whole(v.colour.z)};
  return vertex;
}

/// Vertices that no triangle has: those whose neighbours are far from points.
void drop_unused(TriMesh& mesh, std::vector<Colour>& colours) {
  std::vector<std::uint32_t> number(mesh.vertices_mm.size(), KeyMap::npos);
  for (const auto& t : mesh.triangles)
    for (const std::uint32_t v : t) number[v] = 0;
  std::uint32_t kept = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == KeyMap::npos) continue;
    mesh.vertices_mm[kept] = mesh.vertices_mm[v];
    if (!colours.empty()) colours[kept] = colours[v];
    number[v] = kept++;
  }
  mesh.vertices_mm.resize(kept);
  if (!colours.empty()) colours.resize(kept);
  for (auto& t : mesh.triangles)
    for (std::uint32_t& v : t) v = number[v];
}

/// Cells that touch a voxel with points: its own and its 26 neighbours.
void make_cells(const std::vector<Surfel>& surfels, detail::DualGrid& cells) {
  cells.cell_of = KeyMap(4 * surfels.size());
  for (const Surfel& s : surfels)
    for (std::int64_t dx = -1; dx <= 1; ++dx)
      for (std::int64_t dy = -1; dy <= 1; ++dy)
        for (std::int64_t dz = -1; dz <= 1; ++dz) {
          const std::uint64_t key =
              VoxelGrid::key(VoxelGrid::x_of(s.key) + dx, VoxelGrid::y_of(s.key) + dy,
                             VoxelGrid::z_of(s.key) + dz);
          const auto next = static_cast<std::uint32_t>(cells.keys.size());
          if (cells.cell_of.insert(key, next) == next) cells.keys.push_back(key);
        }
}

/// The function at the cells' corners.
void fill_corners(const Field& field, detail::DualGrid& cells) {
  const std::size_t count = cells.keys.size();
  std::vector<std::uint64_t> nodes;
  cells.corners.resize(count);
  {
    KeyMap node_of(2 * count);
    for (std::size_t k = 0; k < count; ++k)
      for (unsigned c = 0; c < 8; ++c) {
        const std::uint64_t key = VoxelGrid::key(VoxelGrid::x_of(cells.keys[k]) + (c & 1U),
                                                 VoxelGrid::y_of(cells.keys[k]) + (c >> 1U & 1U),
                                                 VoxelGrid::z_of(cells.keys[k]) + (c >> 2U & 1U));
        const auto next = static_cast<std::uint32_t>(nodes.size());
        cells.corners[k][c] = node_of.insert(key, next);
        if (cells.corners[k][c] == next) nodes.push_back(key);
      }
  }
  cells.values.resize(nodes.size());
  oneapi::tbb::parallel_for(std::size_t{0}, nodes.size(), [&](std::size_t i) {
    const auto v = field.at(
        field.node(VoxelGrid::x_of(nodes[i]), VoxelGrid::y_of(nodes[i]), VoxelGrid::z_of(nodes[i])),
        false);
    cells.values[i] = v.weight > 0.0 ? static_cast<float>(v.distance) : NAN;
  });
}

/// Vertices near points, numbered, with their colours.
void place_vertices(const Field& field, bool coloured, detail::DualGrid& cells, CloudMesh& result) {
  const std::size_t count = cells.keys.size();
  cells.surfaces.resize(count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    const std::array<float, 8> f = cells.at_corners(k);
    if (std::none_of(f.begin(), f.end(), [](float v) { return std::isnan(v); }))
      cells.surfaces[k] = detail::surfaces_of(f);
  });
  cells.first.resize(count);
  std::uint32_t pieces = 0;
  for (std::size_t k = 0; k < count; ++k) {
    cells.first[k] = pieces;
    pieces += cells.surfaces[k].count;
  }
  std::vector<Vertex> vertices(pieces);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    for (unsigned piece = 0; piece < cells.surfaces[k].count; ++piece)
      vertices[cells.first[k] + piece] = vertex_of(cells, k, piece, field, coloured);
  });
  TriMesh& mesh = result.mesh;
  cells.vertex.assign(pieces, KeyMap::npos);
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    if (!vertices[i].near) continue;
    cells.vertex[i] = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    mesh.vertices_mm.push_back(vertices[i].place);
    if (coloured) result.colours.push_back(vertices[i].colour);
  }
}

/// The zero of the function that the pieces make.
Result<void> make_surface(const VoxelGrid& grid, const std::vector<Surfel>& surfels, bool coloured,
                          CloudMesh& result, const RunContext& run) {
  KeyMap map(surfels.size());
  for (std::size_t i = 0; i < surfels.size(); ++i)
    map.insert(surfels[i].key, static_cast<std::uint32_t>(i));
  const Field field{grid, surfels, map};
  detail::DualGrid cells;
  cells.grid = &grid;
  make_cells(surfels, cells);
  fill_corners(field, cells);
  if (run.stopped()) return fail(kCancelled, "meshing was cancelled");
  run.progress(0.6);
  place_vertices(field, coloured, cells, result);
  detail::join_cells(cells, result.mesh, result.colours);
  return {};
}

MeshHole hole_of(const TriMesh& mesh, const std::vector<std::uint32_t>& loop) {
  MeshHole hole;
  hole.edges = loop.size();
  Vec3 sum;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const Vec3 a = mesh.vertices_mm[loop[i]], b = mesh.vertices_mm[loop[(i + 1) % loop.size()]];
    hole.length_mm += norm(b - a);
    sum += a;
  }
  hole.middle_mm = (1.0 / static_cast<double>(loop.size())) * sum;
  for (std::size_t i = 0; i < loop.size(); ++i)
    hole.area_mm2 +=
        0.5 * norm(cross(mesh.vertices_mm[loop[i]] - hole.middle_mm,
                         mesh.vertices_mm[loop[(i + 1) % loop.size()]] - hole.middle_mm));
  return hole;
}

/// Loops that are pinholes: short, and their fans face as the triangles around them do. The outline
/// of a stray piece is short, too, but its fan would be the piece's other side.
std::vector<bool> are_pinholes(const TriMesh& mesh,
                               const std::vector<std::vector<std::uint32_t>>& loops,
                               const std::vector<MeshHole>& holes, double longest_mm) {
  const auto& at = mesh.vertices_mm;
  std::unordered_map<std::uint32_t, std::size_t> loop_at;
  for (std::size_t k = 0; k < loops.size(); ++k)
    if (holes[k].length_mm <= longest_mm)
      for (const std::uint32_t v : loops[k]) loop_at.emplace(v, k);
  std::vector<Vec3> around(loops.size());
  for (const auto& t : mesh.triangles)
    for (const std::uint32_t v : t)
      if (const auto found = loop_at.find(v); found != loop_at.end())
        around[found->second] += cross(at[t[1]] - at[t[0]], at[t[2]] - at[t[0]]);
  std::vector<bool> pinholes(loops.size(), false);
  for (std::size_t k = 0; k < loops.size(); ++k) {
    if (holes[k].length_mm > longest_mm) continue;
    Vec3 fan;
    for (std::size_t i = 0; i < loops[k].size(); ++i)
      fan += cross(at[loops[k][i]] - holes[k].middle_mm,
                   at[loops[k][(i + 1) % loops[k].size()]] - holes[k].middle_mm);
    pinholes[k] = dot(fan, around[k]) > 0.0;
  }
  return pinholes;
}

/// A fan from the middle of a loop.
void fill_hole(const std::vector<std::uint32_t>& loop, Vec3 middle_mm, CloudMesh& result) {
  TriMesh& mesh = result.mesh;
  const auto middle = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  mesh.vertices_mm.push_back(middle_mm);
  if (!result.colours.empty()) {
    double red = 0, green = 0, blue = 0;
    for (const std::uint32_t i : loop) {
      red += result.colours[i].red;
      green += result.colours[i].green;
      blue += result.colours[i].blue;
    }
    const auto share = [&](double c) {
      return static_cast<std::uint16_t>(c / static_cast<double>(loop.size()));
    };
    result.colours.push_back({share(red), share(green), share(blue)});
  }
  for (std::size_t i = 0; i < loop.size(); ++i)
    mesh.triangles.push_back({loop[i], loop[(i + 1) % loop.size()], middle});
}

}  // namespace

Result<CloudMesh> mesh_cloud(const OpenCloud& open, const MeshCloudOptions& options,
                             const RunContext& run) {
  // Some 900 bytes a voxel while the surface is made.
  constexpr double kMostVoxels = 6e6;
  CloudMesh result;
  VoxelGrid grid;
  std::vector<Surfel> surfels;
  bool coloured = false;
  std::uint64_t points = 0;
  {
    MAQUETTE_TRY(const detail::CloudSurvey survey, detail::survey_cloud(open, run));
    points = survey.sample.count();
    coloured = survey.coloured;
    if (points < 20)
      return fail(kMeshCloudSparse, fmt::format("{} points make no surface", points));
    const double each = std::fmax(4.0, static_cast<double>(points) / kMostVoxels);
    result.voxel_mm = options.voxel_mm == 0.0 ? survey.sample.voxel_for(each) : options.voxel_mm;
    const Box3& box = survey.bounds_mm;
    if (!(result.voxel_mm > 0.0) || !detail::make_voxel_grid(box, result.voxel_mm, grid))
      return fail(kMeshCloudOptions, fmt::format("a voxel of {} mm does not fit a cloud of {} mm",
                                                 result.voxel_mm, norm(box.max - box.min)));
    MAQUETTE_TRY(surfels, detail::gather_surfels(open, survey, grid, run));
  }
  std::erase_if(surfels, [](const Surfel& s) { return !(dot(s.normal, s.normal) > 0.5); });
  if (run.stopped()) return fail(kCancelled, "meshing was cancelled");
  run.progress(0.3);
  MAQUETTE_TRY_VOID(make_surface(grid, surfels, coloured, result, run));
  surfels = {};
  TriMesh& mesh = result.mesh;
  if (mesh.triangles.empty())
    return fail(kMeshCloudSparse,
                fmt::format("{} points in voxels of {:.3g} mm show no surface; take larger voxels",
                            points, result.voxel_mm));
  run.progress(0.9);

  detail::part_fans(mesh, result.colours);
  drop_unused(mesh, result.colours);
  const auto loops = detail::border_loops(mesh);
  std::vector<MeshHole> holes;
  for (const auto& loop : loops) holes.push_back(hole_of(mesh, loop));
  const auto pinholes = are_pinholes(mesh, loops, holes, kPinholeVoxels * result.voxel_mm);
  for (std::size_t k = 0; k < loops.size(); ++k) {
    if (pinholes[k])
      ++result.pinholes;
    else
      result.holes.push_back(holes[k]);
    if (pinholes[k] || options.closed) fill_hole(loops[k], holes[k].middle_mm, result);
  }
  std::stable_sort(result.holes.begin(), result.holes.end(),
                   [](const MeshHole& a, const MeshHole& b) { return a.length_mm > b.length_mm; });
  run.progress(1.0);
  return result;
}

Result<CloudMesh> mesh_cloud(const Cloud& cloud, const MeshCloudOptions& options,
                             const RunContext& run) {
  return mesh_cloud([&] { return detail::reader_of(cloud); }, options, run);
}

Result<void> write_mesh_ply(const CloudMesh& m, const std::filesystem::path& path) {
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  std::string text = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment maquette, millimetres\nelement vertex {}\n"
      "property double x\nproperty double y\nproperty double z\n{}element face {}\n"
      "property list uchar uint vertex_indices\nend_header\n",
      m.mesh.vertices_mm.size(),
      m.colours.empty() ? "" : "property uchar red\nproperty uchar green\nproperty uchar blue\n",
      m.mesh.triangles.size());
  const auto put = [&](const auto& value) {
    char bytes[sizeof(value)];
    std::memcpy(bytes, &value, sizeof(value));
    text.append(bytes, sizeof(value));
    if (text.size() > (std::size_t{1} << 20)) {
      file.write(text);
      text.clear();
    }
  };
  for (std::size_t i = 0; i < m.mesh.vertices_mm.size(); ++i) {
    put(m.mesh.vertices_mm[i]);
    if (m.colours.empty()) continue;
    for (const std::uint16_t c : {m.colours[i].red, m.colours[i].green, m.colours[i].blue})
      put(static_cast<std::uint8_t>((c + 128U) / 257U));
  }
  for (const auto& t : m.mesh.triangles) {
    put(std::uint8_t{3});
    put(t);
  }
  file.write(text);
  return file.commit();
}

}  // namespace maquette::scan
