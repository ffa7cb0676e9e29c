// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file certificate.hpp
/// As-milled surface against design: gouge, excess, and what lies between the cells.
///
/// Both surfaces are taken at the nodes of the as-milled grid, which is the design's
/// grid divided `per_spacing` times, so every facet of the design is a whole number of
/// half cells and its height at a node is exact. How the bound follows from the ball's
/// curvature: docs/derivations/verify_bound.md.

#include <cstdint>
#include <vector>

#include "cnc/verify.hpp"
#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// Deeper cuts count as gouged area and may be listed.
inline constexpr double kGougeListed_mm = 0.001;
/// A node counts as within the ball's reach if the design's closing by the ball lies at
/// most this far above it.
inline constexpr double kReachTolerance_mm = 0.005;

/// The design at the nodes of a grid that divides each of its cells `per_spacing` times.
class DividedDesign {
 public:
  /// @pre at least 2 x 2 nodes, none void, per_spacing >= 1
  DividedDesign(const heightmap::ModelField& design, std::ptrdiff_t per_spacing)
      : z_(&design.z_mm), k_(per_spacing), step_(1.0 / static_cast<double>(per_spacing)) {}
  [[nodiscard]] std::ptrdiff_t rows() const { return (z_->rows() - 1) * k_ + 1; }
  [[nodiscard]] std::ptrdiff_t cols() const { return (z_->cols() - 1) * k_ + 1; }
  [[nodiscard]] double at(std::ptrdiff_t row, std::ptrdiff_t col) const {
    const std::ptrdiff_t r = std::min(row / k_, z_->rows() - 2);
    const std::ptrdiff_t c = std::min(col / k_, z_->cols() - 2);
    const double dv = static_cast<double>(row - r * k_) * step_;
    const double du = static_cast<double>(col - c * k_) * step_;
    const double z00 = (*z_)(r, c), z11 = (*z_)(r + 1, c + 1);
    if (du >= dv) {
      const double z10 = (*z_)(r, c + 1);
      return z00 + du * (z10 - z00) + dv * (z11 - z10);
    }
    const double z01 = (*z_)(r + 1, c);
    return z00 + dv * (z01 - z00) + du * (z11 - z01);
  }

 private:
  const Grid<float>* z_;
  std::ptrdiff_t k_;
  double step_;
};

/// What may separate the simulated cutter from the true one.
struct CutterError {
  double sideways_mm = 0.0;  ///< rounding of places, chords for arcs
  double vertical_mm = 0.0;  ///< rounding of heights
};

/// Fills the figures of `certificate` that come from the two surfaces: gouge, excess
/// (max_excess_mm by reachable_excess), area, mean, rms, worst places, bound.
/// mean and rms are of as-milled minus design, signed, over all nodes.
/// @return CORE_CANCELLED if stopped
[[nodiscard]] Result<void> compare(const heightmap::ModelField& design,
                                   const heightmap::ModelField& as_milled,
                                   std::ptrdiff_t per_spacing, double ball_radius_mm,
                                   CutterError error, Certificate& certificate,
                                   const RunContext& run = {});

/// How far a gouge between nodes may exceed the deepest one at the nodes of its facet,
/// for a facet of the given slope (rise per mm); infinite where the ball's rim is nearer
/// than the nodes.
[[nodiscard]] double gouge_between_nodes_mm(double slope, double cell_mm, double ball_radius_mm);

/// Largest as-milled minus design at nodes that the ball can reach, at least 0.
///
/// Reach: dilation and erosion of the design by the ball on the as-milled grid (of every
/// n-th node where the radius exceeds 32 cells), blocks of nodes in the order of their
/// largest excess, so that most are never looked at. Worst case (unreachable
/// excess in every block) about 10 ms for each block of 64 x 64 nodes.
/// @param block_excess  per block of `block` x `block` nodes: its largest excess
[[nodiscard]] Result<double> reachable_excess(const DividedDesign& design,
                                              const Grid<float>& as_milled_mm, double cell_mm,
                                              double ball_radius_mm,
                                              const Grid<float>& block_excess, std::ptrdiff_t block,
                                              const RunContext& run = {});

}  // namespace maquette::cnc
