// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/deviate.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>

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

/// What the nodes of the design collect from the points.
struct NodeSums {
  std::ptrdiff_t rows, cols;
  std::vector<std::int64_t> sum;
  std::vector<std::uint32_t> count;
  std::vector<std::uint8_t> covered;

  explicit NodeSums(const ModelField& f)
      : rows(f.z_mm.rows()),
        cols(f.z_mm.cols()),
        sum(f.z_mm.cells().size(), 0),
        count(sum.size(), 0),
        covered(sum.size(), 0) {}

  /// @param u, v  column and row of the point, in spacings
  void add(double u, double v, double deviation_mm) {
    const auto at = [this](std::ptrdiff_t r, std::ptrdiff_t c) {
      return static_cast<std::size_t>(r * cols + c);
    };
    const auto c = std::clamp<std::ptrdiff_t>(std::lround(u), 0, cols - 1);
    const auto r = std::clamp<std::ptrdiff_t>(std::lround(v), 0, rows - 1);
    std::atomic_ref(sum[at(r, c)])
        .fetch_add(std::llround(deviation_mm * kUnitsPerMm), std::memory_order_relaxed);
    std::atomic_ref(count[at(r, c)]).fetch_add(1, std::memory_order_relaxed);
    const auto first_c = std::max<std::ptrdiff_t>(0, std::lround(std::ceil(u - 1.0)));
    const auto last_c = std::min(cols - 1, static_cast<std::ptrdiff_t>(std::floor(u + 1.0)));
    const auto first_r = std::max<std::ptrdiff_t>(0, std::lround(std::ceil(v - 1.0)));
    const auto last_r = std::min(rows - 1, static_cast<std::ptrdiff_t>(std::floor(v + 1.0)));
    for (std::ptrdiff_t i = first_r; i <= last_r; ++i)
      for (std::ptrdiff_t j = first_c; j <= last_c; ++j) {
        const double du = u - static_cast<double>(j), dv = v - static_cast<double>(i);
        if (du * du + dv * dv <= 1.0)
          std::atomic_ref(covered[at(i, j)]).store(1, std::memory_order_relaxed);
      }
  }
};

}  // namespace

Result<Deviation> deviate(const Cloud& cloud, const RigidTransform& model_from_scan,
                          const ModelField& design, Millimetres reach, const RunContext& run) {
  MAQUETTE_CHECK(design.z_mm.rows() >= 2 && design.z_mm.cols() >= 2, "design of {} x {} nodes",
                 design.z_mm.rows(), design.z_mm.cols());
  const std::size_t n = cloud.points_mm.size();
  if (n == 0) return fail(kCloudEmpty, "the cloud has no points to compare with the design");
  if (!(reach.value() > 0.0 && reach.value() <= kLargestReachMm))
    return fail(kReach, fmt::format("reach must be above 0 and at most {} mm, got {} mm",
                                    kLargestReachMm, reach.value()));
  if (const auto unit = check_unit(cloud, design); !unit) run.warn(unit.error().message);

  Deviation d;
  d.per_point_mm.assign(n, NAN);
  NodeSums nodes(design);
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  std::atomic<std::size_t> done{0};
  std::atomic<bool> stopped{false};
  oneapi::tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    if (stopped.load(std::memory_order_relaxed)) return;
    if (run.stopped()) {
      stopped = true;
      return;
    }
    const std::size_t end = std::min(n, (chunk + 1) * kChunk);
    for (std::size_t i = chunk * kChunk; i < end; ++i) {
      const Vec3 p = model_from_scan.point(cloud.points_mm[i]);
      const double distance = signed_distance_mm(design, p, reach.value());
      if (std::isnan(distance)) continue;
      d.per_point_mm[i] = static_cast<float>(distance);
      const double s = design.spacing.value();
      nodes.add((p.x - design.x0.value()) / s, (p.y - design.y0.value()) / s, distance);
    }
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

  d.map_mm = Grid<float>(nodes.rows, nodes.cols, NAN);
  std::vector<std::uint64_t> covered(static_cast<std::size_t>(nodes.rows), 0), present = covered;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, nodes.rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < nodes.cols; ++c) {
      const auto i = static_cast<std::size_t>(r * nodes.cols + c);
      if (nodes.count[i] > 0)
        d.map_mm(r, c) = static_cast<float>(static_cast<double>(nodes.sum[i]) /
                                            (kUnitsPerMm * static_cast<double>(nodes.count[i])));
      if (std::isnan(design.z_mm(r, c))) continue;
      ++present[static_cast<std::size_t>(r)];
      covered[static_cast<std::size_t>(r)] += nodes.covered[i];
    }
  });
  std::uint64_t covered_nodes = 0, present_nodes = 0;
  for (std::size_t r = 0; r < covered.size(); ++r) {
    covered_nodes += covered[r];
    present_nodes += present[r];
  }
  d.statistics.coverage = static_cast<double>(covered_nodes) / static_cast<double>(present_nodes);
  run.progress(1.0);
  return d;
}

}  // namespace maquette::scan
