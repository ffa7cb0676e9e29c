// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing_volume.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>

#include <fmt/format.h>
#include <openvdb/tools/MeshToVolume.h>

#include "meshing/detail/stone_cap.hpp"
#include "meshing/detail/terrain_level_set.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/settle_stones.hpp"
#include "meshing/solid.hpp"
#include "meshing/stones.hpp"
#include "meshing_table.hpp"
#include "support/bench_times.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::now;
using testing_support::peak_mib;
using testing_support::Times;

openvdb::FloatGrid::Ptr peer_of(const TriMesh& solid, const detail::LatticeBox& box,
                                double voxel_mm) {
  std::vector<openvdb::Vec3s> points;
  std::vector<openvdb::Vec3I> triangles;
  for (const Vec3& v : solid.vertices_mm) {
    const Vec3 p = v - box.origin_mm;
    points.emplace_back(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z));
  }
  for (const auto& t : solid.triangles) triangles.emplace_back(t[0], t[1], t[2]);
  return openvdb::tools::meshToLevelSet<openvdb::FloatGrid>(
      *openvdb::math::Transform::createLinearTransform(voxel_mm), points, triangles,
      detail::kBandVoxels);
}

}  // namespace

void level_set_case(const ModelField& field, double voxel_mm, bool with_peer) {
  openvdb::initialize();
  const auto range = heightmap::height_range(field.z_mm);
  const double low = static_cast<double>(range.min), high = static_cast<double>(range.max);
  detail::LatticeBox box;
  box.origin_mm = {field.x_mm(0), field.y_mm(0), low - 8.0 * voxel_mm};
  const double to_voxels = field.spacing.value() / voxel_mm;
  const auto count = [&](std::ptrdiff_t nodes) {
    return static_cast<int>(static_cast<double>(nodes - 1) * to_voxels) + 1;
  };
  box.nodes = {count(field.z_mm.cols()), count(field.z_mm.rows()),
               static_cast<int>((high - low) / voxel_mm) + 16};
  const double columns = 1e-6 * box.nodes.x() * box.nodes.y();
  Times start = now();
  const auto grid = detail::terrain_level_set(field, box, voxel_mm);
  const double cpu = now().cpu - start.cpu;
  const std::string name =
      fmt::format("{:.2f} M columns, {:.1f} M active voxels, {:.0f} MiB: ", columns,
                  1e-6 * static_cast<double>(grid->activeVoxelCount()),
                  static_cast<double>(grid->memUsage()) / 1048576.0);
  row(name + "from the grid", columns / cpu, "M columns per CPU s", at_least(2.5));
  if (!with_peer) return;
  const auto solid = grid_solid(field, {.base_z = Millimetres{low - 20.0}});
  if (!solid) return;
  start = now();
  const auto peer = peer_of(*solid, box, voxel_mm);
  const double peer_cpu = now().cpu - start.cpu;
  double squares = 0.0, most = 0.0;
  std::uint64_t compared = 0;
  const auto other = peer->getConstAccessor();
  const int margin = 12;  // away from the solid's walls
  for (auto it = grid->cbeginValueOn(); it; ++it) {
    const openvdb::Coord c = it.getCoord();
    if (c.x() < margin || c.y() < margin || c.x() >= box.nodes.x() - margin ||
        c.y() >= box.nodes.y() - margin || std::abs(*it) > voxel_mm)
      continue;
    const double off = static_cast<double>(*it - other.getValue(c)) / voxel_mm;
    squares += off * off;
    most = std::fmax(most, std::abs(off));
    ++compared;
  }
  row(name + "meshToLevelSet", columns / peer_cpu, "M columns per CPU s");
  row("meshToLevelSet takes", peer_cpu / cpu, "times as long", at_least(80.0));
  row("the two within a voxel of the surface, rms",
      std::sqrt(squares / static_cast<double>(compared)), "voxel");
  row("the two within a voxel of the surface, at most", most, "voxel");
}

void settle_case(const ModelField& field, int stones) {
  const double half = 0.5 * field.spacing.value() * static_cast<double>(field.z_mm.cols() - 1);
  const SitePlanRequest request{.count = stones,
                                .half_width = Metres{half},
                                .min_diameter = Metres{1.5},
                                .max_diameter = Metres{5.0}};
  Times start = now();
  const auto plan = plan_stones(request);
  if (!plan) return;
  fmt::print("  plan {:.1f} CPU s", now().cpu - start.cpu);
  start = now();
  const auto fitted = lay_stones(*plan, field, ModelScale(1000.0), -half, -half);
  fmt::print(", {} fitted {:.1f} CPU s", fitted.size(), now().cpu - start.cpu);
  start = now();
  const StoneGround ground{field, ModelScale(1000.0), -half, -half};
  const auto settled = settle_stones(*plan, request, ground);
  if (!settled) {
    fmt::print("\n  {}\n", settled.error().message);
    return;
  }
  double tilt = 0.0;
  for (std::size_t i = 0; i < std::min(fitted.size(), settled->size()); ++i)
    tilt += std::acos(std::fmin(1.0, dot(fitted[i].model_from_stone.direction({0, 0, 1}),
                                         (*settled)[i].model_from_stone.direction({0, 0, 1}))));
  fmt::print(", {} settled {:.1f} CPU s ({:.1f} degrees from fitted, mean); peak {:.2f} GiB\n",
             settled->size(), now().cpu - start.cpu,
             tilt * 180.0 / std::numbers::pi / static_cast<double>(settled->size()),
             peak_mib() / 1024.0);
}

void volume_case(const ModelField& field, int stones) {
  const double half = 0.5e-3 * field.spacing.value() * static_cast<double>(field.z_mm.cols() - 1);
  SitePlanRequest request;
  request.count = stones;
  request.half_width = Metres{1000.0 * half};
  request.inner_share = 0.0;
  request.min_diameter = Metres{6.0};
  request.max_diameter = Metres{30.0};
  request.k = 0.5;
  const auto plan = plan_stones(request);
  if (!plan) return;
  const auto placed =
      lay_stones(*plan, field, ModelScale(1000.0, 1.0), -1000.0 * half, -1000.0 * half);
  std::vector<TriMesh> meshes;
  double largest = 0.0;
  for (const auto& s : placed) {
    meshes.push_back(stone_mesh(s));
    largest = std::max(largest, s.scale_mm);
  }
  const double low = static_cast<double>(heightmap::height_range(field.z_mm).min);
  const Times start = now();
  const auto solid = volume_solid(field, meshes, {.base_z = Millimetres{low - 10.0}});
  if (!solid) {
    fmt::print("  {}\n", solid.error().message);
    return;
  }
  const Times end = now();
  fmt::print("  {} stones to {:.1f} mm on {} x {} nodes, {:.1f} M triangles\n", placed.size(),
             largest, field.z_mm.cols(), field.z_mm.rows(),
             1e-6 * static_cast<double>(solid->triangles.size()));
  row("united", end.wall - start.wall, "s by the clock", at_most(120.0));
  row("united", end.cpu - start.cpu, "CPU s");
  row("most memory", peak_mib() / 1024.0, "GiB", at_most(10.0));
  std::fflush(stdout);
  // One box tree a stone, asked only where its box is near.
  const double voxel = field.spacing.value(), reach = 5.0 * voxel;
  std::vector<Box3> boxes;
  std::vector<std::unique_ptr<detail::StoneDistance>> trees;
  for (const TriMesh& m : meshes) {
    const TriMesh* const body = &m;
    boxes.push_back(m.bounds());
    trees.push_back(
        std::make_unique<detail::StoneDistance>(std::span<const TriMesh* const>(&body, 1)));
  }
  const auto to_stone = [&](Vec3 v) {
    double least = INFINITY;
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      const Vec3 a = boxes[i].min - v, b = v - boxes[i].max;
      if (std::max({a.x, a.y, a.z, b.x, b.y, b.z}) > reach) continue;
      least = std::fmin(least, trees[i]->nearest(v).distance_mm);
    }
    return least;
  };
  // Each vertex of the top against the nearer of terrain and stone.
  double squares = 0.0, most_away = 0.0, seam = 0.0;
  std::uint64_t away = 0, near = 0, exact = 0;
  for (const Vec3& v : solid->vertices_mm) {
    const double ground = heightmap::height_at(field, v.x, v.y);
    const double off = std::abs(v.z - ground);
    if (std::isnan(off) || v.z < low - 9.0) continue;  // walls and base
    if (off == 0.0) {                                  // a node, or straight on a facet
      ++away;
      continue;
    }
    const double stone = to_stone(v);
    if (stone > reach) {
      ++away;
      squares += off * off;
      most_away = std::fmax(most_away, off);
      continue;
    }
    const double nearer = std::fmin(stone, off);
    ++near;
    exact += nearer < 0.001;
    seam = std::fmax(seam, nearer);
  }
  row(fmt::format("{} vertices away from stones, off the terrain, rms", away),
      std::sqrt(squares / static_cast<double>(std::max<std::uint64_t>(1, away))) / voxel, "voxel",
      at_most(0.05));
  row("the same, at most", 1000.0 * most_away, "um", at_most(20.0));
  row(fmt::format("{} near them, off the nearer of stone and terrain, at most", near),
      1000.0 * seam, "um", at_most(20.0));
  row("of those nearer than 1 um",
      100.0 * static_cast<double>(exact) / static_cast<double>(std::max<std::uint64_t>(1, near)),
      "%");
}

}  // namespace maquette::meshing
