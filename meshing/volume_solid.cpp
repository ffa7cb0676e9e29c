// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include "core/check.hpp"
#include "meshing/detail/exact_union.hpp"
#include "meshing/detail/shell.hpp"
#include "meshing/detail/stone_cap.hpp"
#include "meshing/solid.hpp"

namespace maquette::meshing {
namespace {

using detail::CellBlock;
using detail::Lattice;
using detail::Patch;
using detail::StoneCluster;
using heightmap::ModelField;

/// The stones' shifts, mm, until the union is sound: a millionth of a millimetre is enough where a
/// vertex lies in an edge or a facet in another one.
constexpr Vec3 kShifts_mm[] = {{0.0, 0.0, 0.0}, {3.1e-7, 1.7e-7, -1e-6}, {-4.3e-6, 2.9e-6, -1e-5}};

/// Where there is no exact union: tried one after the other until a cluster's cap fits into the
/// terrain soundly: the lattice's place decides how it meets a crevice, and a finer one sees more.
struct Try {
  double voxel_share, shift;
};
constexpr Try kTries[] = {{1.0, 0.0},  {1.0, 0.37},  {0.83, 0.21}, {0.67, 0.59},
                          {0.5, 0.13}, {0.41, 0.47}, {0.33, 0.31}, {0.27, 0.17}};

/// Level sets, contour, box trees and proof of a cluster, per column of voxels: 1850 to
/// 2050 measured on a stone of 40 mm at voxels of 0.25 to 0.08 mm, and some to spare.
constexpr double kBytesPerColumn = 2500.0;

/// @return empty, or what keeps the mesh from being a solid
std::string not_a_solid(const TriMesh& mesh) {
  if (mesh.triangles.empty()) return "it has no triangle";
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    const Vec3 p = mesh.vertices_mm[v];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
      return fmt::format("vertex {} is not finite", v);
  }
  std::vector<std::array<std::uint32_t, 2>> edges;
  edges.reserve(3 * mesh.triangles.size());
  double volume_mm3 = 0.0;
  for (const auto& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (t[i] >= mesh.vertices_mm.size()) return fmt::format("there is no vertex {}", t[i]);
      edges.push_back({t[i], t[(i + 1) % 3]});
    }
    const auto p = [&](std::size_t i) { return mesh.vertices_mm[t[i]] - mesh.vertices_mm[0]; };
    volume_mm3 += dot(p(0), cross(p(1), p(2))) / 6.0;
  }
  std::sort(edges.begin(), edges.end());
  if (std::adjacent_find(edges.begin(), edges.end()) != edges.end())
    return "an edge has more than two triangles, or two that are turned against each other";
  for (const auto& e : edges)
    if (!std::binary_search(edges.begin(), edges.end(), std::array{e[1], e[0]}))
      return fmt::format("it is open at the edge from vertex {} to vertex {}", e[0], e[1]);
  if (!(volume_mm3 > 0.0)) return "it is turned inside out";
  return {};
}

Result<void> check_stones(const ModelField& field, std::span<const TriMesh> stones,
                          double base_z_mm) {
  const double x_last = field.x_mm(field.z_mm.cols() - 1);
  const double y_last = field.y_mm(field.z_mm.rows() - 1);
  for (std::size_t i = 0; i < stones.size(); ++i) {
    if (std::string why = not_a_solid(stones[i]); !why.empty())
      return fail(kNotASolid, fmt::format("stone {} of {} is not a solid: {}; close it first",
                                          i + 1, stones.size(), why));
    const Box3 box = stones[i].bounds();
    if (!(box.min.x > field.x_mm(0) && box.max.x < x_last && box.min.y > field.y_mm(0) &&
          box.max.y < y_last && box.min.z > base_z_mm))
      return fail(
          kNotASolid,
          fmt::format("stone {} of {} (x {:.2f} to {:.2f}, y {:.2f} to {:.2f}, z from {:.2f} mm) "
                      "sticks out of the model's walls or base; leave it out or move it inside",
                      i + 1, stones.size(), box.min.x, box.max.x, box.min.y, box.max.y, box.min.z));
  }
  return {};
}

/// Cells that the stones may change.
CellBlock reach_of(const ModelField& field, const Box3& box, double voxel_mm) {
  const double s = field.spacing.value();
  const double margin = detail::kMarginVoxels * voxel_mm + 4.0 * s;
  const auto cell = [&](double p, double from) {
    return static_cast<std::ptrdiff_t>(std::floor((p - from) / s));
  };
  return {std::max<std::ptrdiff_t>(cell(box.min.y - margin, field.y0.value()), 0),
          std::min(cell(box.max.y + margin, field.y0.value()) + 1, field.z_mm.rows() - 1),
          std::max<std::ptrdiff_t>(cell(box.min.x - margin, field.x0.value()), 0),
          std::min(cell(box.max.x + margin, field.x0.value()) + 1, field.z_mm.cols() - 1)};
}

/// Stones whose reaches overlap go together, until no two clusters' reaches do.
std::vector<StoneCluster> cluster_stones(const ModelField& field, std::span<const TriMesh> stones,
                                         double voxel_mm) {
  std::vector<StoneCluster> clusters;
  for (const TriMesh& stone : stones) {
    StoneCluster next{{&stone}, reach_of(field, stone.bounds(), voxel_mm)};
    for (std::size_t i = 0; i < clusters.size();) {
      if (!clusters[i].reach.overlaps(next.reach)) {
        ++i;
        continue;
      }
      const CellBlock& o = clusters[i].reach;
      next.reach = {std::min(o.row0, next.reach.row0), std::max(o.row1, next.reach.row1),
                    std::min(o.col0, next.reach.col0), std::max(o.col1, next.reach.col1)};
      next.stones.insert(next.stones.begin(), clusters[i].stones.begin(), clusters[i].stones.end());
      clusters.erase(clusters.begin() + static_cast<std::ptrdiff_t>(i));
      i = 0;  // the grown reach may meet one that was passed
    }
    clusters.push_back(std::move(next));
  }
  return clusters;
}

double level_set_bytes(const ModelField& field, const StoneCluster& cluster, double voxel_mm) {
  const double k = field.spacing.value() / voxel_mm;
  return kBytesPerColumn * k * k * static_cast<double>(cluster.reach.row1 - cluster.reach.row0) *
         static_cast<double>(cluster.reach.col1 - cluster.reach.col0);
}

Result<void> check_memory(const ModelField& field, std::span<const TriMesh> stones, double voxel_mm,
                          double limit_bytes) {
  // The mesh (24 bytes a vertex, 24 a cell) and two tables of 4 bytes a node.
  const double mesh_bytes = 56.0 * static_cast<double>(field.z_mm.rows() * field.z_mm.cols());
  const auto bytes = [&](double v) {
    double largest = 0.0;  // clusters come one after the other
    for (const StoneCluster& c : cluster_stones(field, stones, v))
      largest = std::fmax(largest, level_set_bytes(field, c, v));
    return mesh_bytes + largest;
  };
  if (bytes(voxel_mm) <= limit_bytes) return {};
  constexpr double kGib = 1024.0 * 1024.0 * 1024.0;
  const double width_mm =
      field.spacing.value() * static_cast<double>(std::max(field.z_mm.rows(), field.z_mm.cols()));
  double fits = voxel_mm;
  while (fits < width_mm && bytes(fits) > limit_bytes) fits *= 1.02;
  if (fits >= width_mm)
    return fail(
        kVoxelTooSmall,
        fmt::format("the mesh of {} x {} nodes alone takes {:.2f} GiB, the limit is {:.2f} "
                    "GiB; no voxel fits, raise the limit",
                    field.z_mm.rows(), field.z_mm.cols(), mesh_bytes / kGib, limit_bytes / kGib));
  return fail(kVoxelTooSmall,
              fmt::format("a voxel of {} mm takes {:.2f} GiB, the limit is {:.2f} GiB; a voxel of "
                          "{:.3g} mm would fit",
                          voxel_mm, bytes(voxel_mm) / kGib, limit_bytes / kGib, 1.01 * fits));
}

/// @return a patch; with an empty block if the stones are buried
Result<Patch> mesh_cluster(const ModelField& surface, const StoneCluster& cluster, double voxel_mm,
                           double memory_bytes, const RunContext& run) {
  std::string not_exact;
  std::optional<Patch> in_memory_only;
  for (const Vec3 shift : kShifts_mm) {
    if (run.stopped()) return fail(kCancelled, "meshing stones was stopped");
    MAQUETTE_TRY(auto united, detail::unite_exactly(surface, cluster, shift));
    if (united.why_not.empty() && !united.spoilt_in_files) return std::move(united.patch);
    if (united.why_not.empty() && !in_memory_only) in_memory_only = std::move(united.patch);
    not_exact = std::move(united.why_not);
  }
  if (in_memory_only) {
    run.warn(
        fmt::format("stones near cell row {}, column {}: their mesh is sound with 64 bits only; as "
                    "STL or 3MF it may be refused (move the stones by 0.01 mm, or the origin "
                    "nearer)",
                    in_memory_only->block.row0, in_memory_only->block.col0));
    return std::move(*in_memory_only);
  }
  Error why{kNotASolid, not_exact};
  for (const Try& attempt : kTries) {
    if (run.stopped()) return fail(kCancelled, "meshing stones was stopped");
    const Lattice lattice{attempt.voxel_share * voxel_mm, attempt.shift};
    if (level_set_bytes(surface, cluster, lattice.voxel_mm) > memory_bytes) break;
    MAQUETTE_TRY(const detail::StoneCap cap, detail::contour_stones(surface, cluster, lattice));
    if (cap.triangles.empty()) return Patch{};
    Result<Patch> patch = detail::fit_cap(surface, cap, cluster.reach, lattice.voxel_mm);
    if (patch) {
      run.warn(fmt::format(
          "stones near cell row {}, column {} have no exact union with the terrain ({}); they were "
          "meshed by a level set with a voxel of {:.3f} mm and a fillet of {} voxels{}",
          patch->block.row0, patch->block.col0, not_exact, lattice.voxel_mm, detail::kFilletVoxels,
          lattice.voxel_mm == voxel_mm
              ? ""
              : fmt::format(", for of {:.3f} mm no sound mesh came out ({})", voxel_mm,
                            why.message)));
      return patch;
    }
    why = std::move(patch).error();
  }
  return tl::unexpected<Error>(std::move(why));
}

}  // namespace

Result<TriMesh> volume_solid(const ModelField& surface, std::span<const TriMesh> stones,
                             const SolidOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(detail::check_surface(surface, options));
  MAQUETTE_TRY_VOID(check_stones(surface, stones, options.base_z.value()));
  const double voxel_mm =
      options.voxel.value() != 0.0 ? options.voxel.value() : surface.spacing.value();
  MAQUETTE_CHECK(voxel_mm > 0.0 && std::isfinite(voxel_mm), "voxel {} mm", voxel_mm);
  const double limit_bytes = options.memory_limit_gib * 1024.0 * 1024.0 * 1024.0;
  MAQUETTE_TRY_VOID(check_memory(surface, stones, voxel_mm, limit_bytes));
  const std::vector<StoneCluster> clusters = cluster_stones(surface, stones, voxel_mm);

  std::vector<Patch> patches;
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    auto patch = mesh_cluster(surface, clusters[i], voxel_mm, limit_bytes, run);
    if (!patch) {
      const Box3 box = clusters[i].stones.front()->bounds();
      return tl::unexpected<Error>(std::move(patch).error().within(
          fmt::format("{} stone(s) near x = {:.1f}, y = {:.1f} mm", clusters[i].stones.size(),
                      0.5 * (box.min.x + box.max.x), 0.5 * (box.min.y + box.max.y))));
    }
    if (!patch->block.empty()) patches.push_back(std::move(*patch));
    run.progress(0.8 * static_cast<double>(i + 1) / static_cast<double>(clusters.size()));
  }
  RunContext rest = run;
  rest.progress = [&run](double share) { run.progress(0.8 + 0.2 * share); };
  return detail::close_shell(surface, options.base_z.value(), patches, rest);
}

}  // namespace maquette::meshing
