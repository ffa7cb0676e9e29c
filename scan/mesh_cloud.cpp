// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/mesh_cloud.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <unordered_map>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include "core/files.hpp"
#include "scan/detail/surfels.hpp"

namespace maquette::scan {
namespace {

using detail::KeyMap;
using detail::Surfel;
using detail::VoxelGrid;

// Reach of a piece in voxels: nodes up to two voxels away feel it, by exp(-d^2 / voxel^2).
constexpr std::int64_t kReach = 2;

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

struct Cell {
  std::uint64_t key = 0;
  bool crossed = false;
  std::uint8_t below = 0;  // bit per corner: the function is negative there
  Vec3 vertex;
  Colour colour;
};

constexpr std::array<std::array<int, 2>, 12> kEdges{{{0, 1},
                                                     {2, 3},
                                                     {4, 5},
                                                     {6, 7},
                                                     {0, 2},
                                                     {1, 3},
                                                     {4, 6},
                                                     {5, 7},
                                                     {0, 4},
                                                     {1, 5},
                                                     {2, 6},
                                                     {3, 7}}};

std::array<std::uint64_t, 2> ordered(std::uint32_t a, std::uint32_t b) {
  return a < b ? std::array<std::uint64_t, 2>{a, b} : std::array<std::uint64_t, 2>{b, a};
}

/// Border loops: half edges without a partner, joined head to tail.
std::vector<std::vector<std::uint32_t>> border_loops(const TriMesh& mesh, std::size_t& knots) {
  struct Half {
    std::uint64_t edge;
    std::uint32_t from, to;
    bool operator<(const Half& b) const { return edge != b.edge ? edge < b.edge : from < b.from; }
  };
  std::vector<Half> halves;
  halves.reserve(3 * mesh.triangles.size());
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      const auto e = ordered(a, b);
      halves.push_back({e[0] << 32U | e[1], a, b});
    }
  oneapi::tbb::parallel_sort(halves.begin(), halves.end());
  std::unordered_multimap<std::uint32_t, std::uint32_t> next;
  std::vector<std::uint32_t> starts;
  knots = 0;
  for (std::size_t i = 0; i < halves.size();) {
    std::size_t j = i;
    while (j < halves.size() && halves[j].edge == halves[i].edge) ++j;
    if (j - i > 2) ++knots;
    if (j - i == 1) {
      // The border runs against the triangle's edge, so that a fan fits.
      next.emplace(halves[i].to, halves[i].from);
      starts.push_back(halves[i].to);
    }
    i = j;
  }
  std::vector<std::vector<std::uint32_t>> loops;
  for (const std::uint32_t start : starts) {
    std::vector<std::uint32_t> loop;
    for (std::uint32_t at = start;;) {
      const auto step = next.find(at);
      if (step == next.end()) break;
      loop.push_back(at);
      at = step->second;
      next.erase(step);
      if (at == start) break;
    }
    if (loop.size() >= 3) loops.push_back(std::move(loop));
  }
  return loops;
}

}  // namespace

Result<CloudMesh> mesh_cloud(const Cloud& cloud, const MeshCloudOptions& options,
                             const RunContext& run) {
  CloudMesh result;
  Box3 box;
  for (const Vec3& p : cloud.points_mm) box.add(p);
  if (cloud.points_mm.size() < 20)
    return fail(kMeshCloudSparse, fmt::format("{} points make no surface", cloud.points_mm.size()));
  result.voxel_mm =
      options.voxel_mm == 0.0 ? detail::voxel_for(cloud.points_mm, 4.0) : options.voxel_mm;
  VoxelGrid grid;
  if (!(result.voxel_mm > 0.0) || !detail::make_voxel_grid(box, result.voxel_mm, grid))
    return fail(kMeshCloudOptions, fmt::format("a voxel of {} mm does not fit a cloud of {} mm",
                                               result.voxel_mm, norm(box.max - box.min)));
  std::vector<Surfel> surfels = detail::make_surfels(cloud, grid);
  std::erase_if(surfels, [](const Surfel& s) { return !(dot(s.normal, s.normal) > 0.5); });
  if (run.stopped()) return fail(kCancelled, "meshing was cancelled");
  run.progress(0.3);
  KeyMap map(surfels.size());
  for (std::size_t i = 0; i < surfels.size(); ++i)
    map.insert(surfels[i].key, static_cast<std::uint32_t>(i));

  // Cells that touch a voxel with points: its own and its 26 neighbours.
  std::vector<std::uint64_t> keys;
  KeyMap seen(4 * surfels.size());
  for (const Surfel& s : surfels)
    for (std::int64_t dx = -1; dx <= 1; ++dx)
      for (std::int64_t dy = -1; dy <= 1; ++dy)
        for (std::int64_t dz = -1; dz <= 1; ++dz) {
          const std::uint64_t key =
              VoxelGrid::key(VoxelGrid::x_of(s.key) + dx, VoxelGrid::y_of(s.key) + dy,
                             VoxelGrid::z_of(s.key) + dz);
          const auto next = static_cast<std::uint32_t>(keys.size());
          if (seen.insert(key, next) == next) keys.push_back(key);
        }
  // The function at the cells' corners.
  KeyMap node_map(2 * keys.size());
  std::vector<std::uint64_t> nodes;
  std::vector<std::array<std::uint32_t, 8>> corners(keys.size());
  for (std::size_t k = 0; k < keys.size(); ++k)
    for (unsigned c = 0; c < 8; ++c) {
      const std::uint64_t key = VoxelGrid::key(VoxelGrid::x_of(keys[k]) + (c & 1U),
                                               VoxelGrid::y_of(keys[k]) + (c >> 1U & 1U),
                                               VoxelGrid::z_of(keys[k]) + (c >> 2U & 1U));
      const auto next = static_cast<std::uint32_t>(nodes.size());
      corners[k][c] = node_map.insert(key, next);
      if (corners[k][c] == next) nodes.push_back(key);
    }
  const Field field{grid, surfels, map};
  std::vector<float> values(nodes.size());
  oneapi::tbb::parallel_for(std::size_t{0}, nodes.size(), [&](std::size_t i) {
    const auto v = field.at(
        field.node(VoxelGrid::x_of(nodes[i]), VoxelGrid::y_of(nodes[i]), VoxelGrid::z_of(nodes[i])),
        false);
    values[i] = v.weight > 0.0 ? static_cast<float>(v.distance) : NAN;
  });
  if (run.stopped()) return fail(kCancelled, "meshing was cancelled");
  run.progress(0.6);

  const bool coloured = !cloud.colours.empty();
  std::vector<Cell> cells(keys.size());
  oneapi::tbb::parallel_for(std::size_t{0}, keys.size(), [&](std::size_t k) {
    Cell& cell = cells[k];
    cell.key = keys[k];
    std::array<Vec3, 8> place;
    std::array<double, 8> f{};
    for (unsigned c = 0; c < 8; ++c) {
      const std::uint64_t key = nodes[corners[k][c]];
      place[c] = field.node(VoxelGrid::x_of(key), VoxelGrid::y_of(key), VoxelGrid::z_of(key));
      f[c] = static_cast<double>(values[corners[k][c]]);
      if (std::isnan(f[c])) return;
      if (f[c] < 0.0) cell.below = static_cast<std::uint8_t>(cell.below | 1U << c);
    }
    if (cell.below == 0 || cell.below == 255) return;
    Vec3 sum;
    int crossings = 0;
    for (const auto& [a, b] : kEdges) {
      const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
      if ((f[i] < 0.0) == (f[j] < 0.0)) continue;
      sum += place[i] + f[i] / (f[i] - f[j]) * (place[j] - place[i]);
      ++crossings;
    }
    Vec3 p = (1.0 / crossings) * sum;
    Field::Value v = field.at(p, coloured);
    for (int round = 0; round < 2 && v.weight > 0.0; ++round) {
      const double square = dot(v.gradient, v.gradient);
      // Half a voxel at most: the vertex stays with its cell.
      if (!(square > 0.01) || std::abs(v.distance) > 0.5 * grid.voxel_mm) break;
      p = p - (v.distance / square) * v.gradient;
      v = field.at(p, coloured);
    }
    if (!(v.weight > 0.0)) return;
    // Near points only: a piece within a voxel of the vertex.
    const std::uint64_t own = grid.key_of(p);
    bool near = false;
    for (std::int64_t dx = -1; dx <= 1 && !near; ++dx)
      for (std::int64_t dy = -1; dy <= 1 && !near; ++dy)
        for (std::int64_t dz = -1; dz <= 1 && !near; ++dz) {
          const std::uint32_t i = map.find(VoxelGrid::key(
              VoxelGrid::x_of(own) + dx, VoxelGrid::y_of(own) + dy, VoxelGrid::z_of(own) + dz));
          if (i == KeyMap::npos) continue;
          const Vec3 d = surfels[i].centre_mm - p;
          near = dot(d, d) < grid.voxel_mm * grid.voxel_mm;
        }
    if (!near) return;
    cell.crossed = true;
    cell.vertex = p;
    const auto whole = [](double c) {
      return static_cast<std::uint16_t>(std::lround(std::clamp(c, 0.0, 65'535.0)));
    };
    if (coloured) cell.colour = {whole(v.colour.x), whole(v.colour.y), whole(v.colour.z)};
  });

  std::vector<std::uint32_t> number(cells.size(), KeyMap::npos);
  TriMesh& mesh = result.mesh;
  for (std::size_t k = 0; k < cells.size(); ++k) {
    if (!cells[k].crossed) continue;
    number[k] = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    mesh.vertices_mm.push_back(cells[k].vertex);
    if (coloured) result.colours.push_back(cells[k].colour);
  }
  // A crossed edge of the grid from a node along an axis joins the four cells around it.
  for (std::size_t k = 0; k < cells.size(); ++k) {
    if (!cells[k].crossed) continue;
    const std::int64_t at[3] = {VoxelGrid::x_of(cells[k].key), VoxelGrid::y_of(cells[k].key),
                                VoxelGrid::z_of(cells[k].key)};
    for (unsigned axis = 0; axis < 3; ++axis) {
      const bool from = (cells[k].below & 1U) != 0;
      const bool to = (cells[k].below >> (1U << axis) & 1U) != 0;
      if (from == to) continue;
      const unsigned u = (axis + 1) % 3, v = (axis + 2) % 3;
      std::array<std::uint32_t, 4> ring{};
      bool whole = true;
      for (unsigned i = 0; i < 4 && whole; ++i) {
        std::int64_t c[3] = {at[0], at[1], at[2]};
        // Counter-clockwise about the axis: (0,0), (-1,0), (-1,-1), (0,-1).
        if (i == 1 || i == 2) --c[u];
        if (i == 2 || i == 3) --c[v];
        const std::uint32_t cell = seen.find(VoxelGrid::key(c[0], c[1], c[2]));
        whole = cell != KeyMap::npos && number[cell] != KeyMap::npos;
        if (whole) ring[i] = number[cell];
      }
      if (!whole) continue;
      // Outside is where the function is positive.
      if (!from) std::swap(ring[1], ring[3]);
      const auto square = [&](std::size_t a, std::size_t b) {
        const Vec3 d = mesh.vertices_mm[ring[a]] - mesh.vertices_mm[ring[b]];
        return dot(d, d);
      };
      if (square(0, 2) <= square(1, 3)) {
        mesh.triangles.push_back({ring[0], ring[1], ring[2]});
        mesh.triangles.push_back({ring[0], ring[2], ring[3]});
      } else {
        mesh.triangles.push_back({ring[0], ring[1], ring[3]});
        mesh.triangles.push_back({ring[1], ring[2], ring[3]});
      }
    }
  }
  if (mesh.triangles.empty())
    return fail(kMeshCloudSparse,
                fmt::format("{} points in voxels of {:.3g} mm show no surface; take larger voxels",
                            cloud.points_mm.size(), result.voxel_mm));
  run.progress(0.9);

  const auto loops = border_loops(mesh, result.knots);
  for (const auto& loop : loops) {
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
    result.holes.push_back(hole);
    if (!options.closed) continue;
    const auto middle = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    mesh.vertices_mm.push_back(hole.middle_mm);
    if (coloured) {
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
  std::stable_sort(result.holes.begin(), result.holes.end(),
                   [](const MeshHole& a, const MeshHole& b) { return a.length_mm > b.length_mm; });
  run.progress(1.0);
  return result;
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
