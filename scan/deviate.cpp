// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/deviate.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <span>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"
#include "scan/statistics.hpp"
#include "scan/surface_distance.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;

constexpr std::size_t kChunk = 8192;
// Deviations are added up per node as whole multiples of 2^-32 mm: integer addition
// does not depend on the order, so threads may add as they come. 63 bits hold
// 2 million points a metre off on one node.
constexpr double kUnitsPerMm = 0x1.0p32;
constexpr double kLargestReachMm = 1000.0;

/// What a node of the design collects from the points; together, for points come to it together.
struct NodeSum {
  std::int64_t sum = 0;
  std::uint32_t count = 0;
  std::uint8_t covered = 0;
};

struct NodeSums {
  std::ptrdiff_t rows, cols;
  double x0_mm, y0_mm, spacing_mm;
  std::vector<NodeSum> nodes;

  explicit NodeSums(const ModelField& f)
      : rows(f.z_mm.rows()),
        cols(f.z_mm.cols()),
        x0_mm(f.x0.value()),
        y0_mm(f.y0.value()),
        spacing_mm(f.spacing.value()),
        nodes(f.z_mm.cells().size()) {}

  [[nodiscard]] std::size_t at(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<std::size_t>(r * cols + c);
  }

  /// Asks for the memory of the four nodes about a point that will be added soon: an atomic
  /// addition waits for all that was asked before, one at a time.
  void fetch(Vec3 p) const {
    const double u = (p.x - x0_mm) / spacing_mm, v = (p.y - y0_mm) / spacing_mm;
    if (!(u >= 0.0 && v >= 0.0 && u < static_cast<double>(cols) &&
          v < static_cast<double>(rows - 1)))
      return;
    const NodeSum* lower =
        &nodes[at(static_cast<std::ptrdiff_t>(v), static_cast<std::ptrdiff_t>(u))];
    __builtin_prefetch(lower, 1);
    __builtin_prefetch(lower + cols, 1);
  }

  void add(Vec3 p, double deviation_mm) {
    const double u = (p.x - x0_mm) / spacing_mm, v = (p.y - y0_mm) / spacing_mm;
    // floor and ceil are instructions, lround is a call.
    const auto whole = [](double x) { return static_cast<std::int64_t>(x); };
    const auto c = std::clamp<std::ptrdiff_t>(whole(std::floor(u + 0.5)), 0, cols - 1);
    const auto r = std::clamp<std::ptrdiff_t>(whole(std::floor(v + 0.5)), 0, rows - 1);
    NodeSum& nearest = nodes[at(r, c)];
    std::atomic_ref(nearest.sum)
        .fetch_add(whole(std::floor(deviation_mm * kUnitsPerMm + 0.5)), std::memory_order_relaxed);
    std::atomic_ref(nearest.count).fetch_add(1, std::memory_order_relaxed);
    const auto first_c = std::max<std::ptrdiff_t>(0, whole(std::ceil(u - 1.0)));
    const auto last_c = std::min(cols - 1, whole(std::floor(u + 1.0)));
    const auto first_r = std::max<std::ptrdiff_t>(0, whole(std::ceil(v - 1.0)));
    const auto last_r = std::min(rows - 1, whole(std::floor(v + 1.0)));
    for (std::ptrdiff_t i = first_r; i <= last_r; ++i)
      for (std::ptrdiff_t j = first_c; j <= last_c; ++j) {
        const double du = u - static_cast<double>(j), dv = v - static_cast<double>(i);
        if (du * du + dv * dv <= 1.0)
          std::atomic_ref(nodes[at(i, j)].covered).store(1, std::memory_order_relaxed);
      }
  }

  /// Those of a chunk whose distance is a number.
  void add_all(std::span<const Vec3> points, std::span<const double> deviations_mm) {
    constexpr std::size_t kAhead = 12;
    for (std::size_t k = 0; k < points.size(); ++k) {
      if (k + kAhead < points.size()) fetch(points[k + kAhead]);
      if (!std::isnan(deviations_mm[k])) add(points[k], deviations_mm[k]);
    }
  }
};

/// Distances of all points, in chunks.
/// @param chunk_of  takes points of the model frame, near each other, and fills in their
///                  distances, NaN for those that have none; called from several threads
template <class ChunkOf>
Result<void> measure(Deviation& d, const Cloud& cloud, const RigidTransform& model_from_scan,
                     Millimetres reach, const RunContext& run, const ChunkOf& chunk_of) {
  const std::size_t n = cloud.points_mm.size();
  if (n == 0) return fail(kCloudEmpty, "the cloud has no points to compare with the design");
  if (!(reach.value() > 0.0 && reach.value() <= kLargestReachMm))
    return fail(kReach, fmt::format("reach must be above 0 and at most {} mm, got {} mm",
                                    kLargestReachMm, reach.value()));
  d.per_point_mm.assign(n, NAN);
  // Neighbours look at the same triangles: a cloud in no order would wait for memory.
  const std::vector<std::uint32_t> order = near_each_other(cloud.points_mm);
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  std::atomic<std::size_t> done{0};
  std::atomic<bool> stopped{false};
  oneapi::tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    if (stopped.load(std::memory_order_relaxed)) return;
    if (run.stopped()) {
      stopped = true;
      return;
    }
    const auto some =
        std::span(order).subspan(chunk * kChunk, std::min(kChunk, n - chunk * kChunk));
    // Fetched first: the processor waits for many points at a time, not for each in turn.
    std::vector<Vec3> points(some.size());
    for (std::size_t k = 0; k < some.size(); ++k) points[k] = cloud.points_mm[some[k]];
    for (Vec3& p : points) p = model_from_scan.point(p);
    std::vector<double> distances(some.size(), NAN);
    chunk_of(std::span<const Vec3>(points), std::span(distances));
    for (std::size_t k = 0; k < some.size(); ++k)
      d.per_point_mm[some[k]] = static_cast<float>(distances[k]);
    if (const std::size_t k = ++done; k % 64 == 0)
      run.progress(0.9 * static_cast<double>(k) / static_cast<double>(chunks));
  });
  if (stopped) return fail(kCancelled, "the comparison was cancelled");

  std::vector<float> ascending;
  d.statistics = summarize(d.per_point_mm, &ascending);
  if (d.statistics.points == 0)
    return fail(kTooFewPoints,
                fmt::format("none of {} points is on the part within {} mm; check the pose of the "
                            "scan and its unit",
                            n, reach.value()));
  d.histogram_limit_mm = round_up_125(std::fmax(absolute_quantile(ascending, 0.0, 0.995), 1e-6));
  d.histogram = histogram_101(ascending, d.histogram_limit_mm);
  return {};
}

float mean_of(std::int64_t sum, std::uint32_t count) {
  return count == 0 ? NAN
                    : static_cast<float>(static_cast<double>(sum) /
                                         (kUnitsPerMm * static_cast<double>(count)));
}

Grid<float> map_of(const NodeSums& nodes) {
  Grid<float> map(nodes.rows, nodes.cols);
  for (std::size_t i = 0; i < nodes.nodes.size(); ++i)
    map.cells()[i] = mean_of(nodes.nodes[i].sum, nodes.nodes[i].count);
  return map;
}

}  // namespace

Result<Deviation> deviate(const Cloud& cloud, const RigidTransform& model_from_scan,
                          const ModelField& design, Millimetres reach, const RunContext& run) {
  MAQUETTE_CHECK(design.z_mm.rows() >= 2 && design.z_mm.cols() >= 2, "design of {} x {} nodes",
                 design.z_mm.rows(), design.z_mm.cols());
  if (!cloud.points_mm.empty())
    if (const auto unit = check_unit(cloud, design); !unit) run.warn(unit.error().message);
  Deviation d;
  NodeSums nodes(design);
  MAQUETTE_TRY_VOID(measure(d, cloud, model_from_scan, reach, run,
                            [&](std::span<const Vec3> points, std::span<double> distances) {
                              signed_distances_mm(design, points, reach.value(), distances);
                              nodes.add_all(points, distances);
                            }));
  d.map_mm = map_of(nodes);
  std::uint64_t covered = 0, present = 0;
  for (std::size_t i = 0; i < nodes.nodes.size(); ++i) {
    if (std::isnan(design.z_mm.cells()[i])) continue;
    ++present;
    covered += nodes.nodes[i].covered;
  }
  d.statistics.coverage = static_cast<double>(covered) / static_cast<double>(present);
  run.progress(1.0);
  return d;
}

Result<MeshDeviation> deviate(const Cloud& cloud, const RigidTransform& model_from_scan,
                              const MeshDistance& mesh, const ModelField& top, Millimetres reach,
                              const RunContext& run) {
  const auto& v = mesh.mesh().vertices_mm;
  const auto& triangles = mesh.mesh().triangles;
  MeshDeviation d;
  NodeSums nodes(top);
  std::vector<std::int64_t> sum(v.size(), 0);
  std::vector<std::uint32_t> count(v.size(), 0);
  std::vector<std::uint8_t> covered(v.size(), 0);
  const auto add_to_vertices = [&](const MeshDistance::Nearest& n) {
    const auto& t = triangles[n.triangle];
    std::uint32_t corner = t[0];
    for (const std::uint32_t k : t) {
      std::atomic_ref(covered[k]).store(1, std::memory_order_relaxed);
      if (norm(v[k] - n.foot_mm) < norm(v[corner] - n.foot_mm)) corner = k;
    }
    std::atomic_ref(sum[corner])
        .fetch_add(std::llround(n.distance_mm * kUnitsPerMm), std::memory_order_relaxed);
    std::atomic_ref(count[corner]).fetch_add(1, std::memory_order_relaxed);
  };
  const auto chunk_of = [&](std::span<const Vec3> points, std::span<double> distances) {
    std::uint32_t hint = 0;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Vec3 p = points[k];
      const auto n = mesh.nearest(p, reach.value(), hint);
      if (!n) continue;
      hint = n->triangle;
      if (n->border) continue;
      distances[k] = n->distance_mm;
      add_to_vertices(*n);
      if (std::abs(p.z - heightmap::height_at(top, p.x, p.y)) <= reach.value())
        nodes.add(p, n->distance_mm);
    }
  };
  MAQUETTE_TRY_VOID(measure(d, cloud, model_from_scan, reach, run, chunk_of));
  d.map_mm = map_of(nodes);
  d.per_vertex_mm.resize(v.size());
  for (std::size_t i = 0; i < v.size(); ++i) d.per_vertex_mm[i] = mean_of(sum[i], count[i]);
  double seen = 0.0, all = 0.0;
  for (const auto& t : triangles) {
    const double area = norm(cross(v[t[1]] - v[t[0]], v[t[2]] - v[t[0]]));
    all += area;
    seen += area * (covered[t[0]] + covered[t[1]] + covered[t[2]]) / 3.0;
  }
  d.statistics.coverage = seen / all;
  run.progress(1.0);
  return d;
}

}  // namespace maquette::scan
