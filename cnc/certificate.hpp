// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file certificate.hpp
/// As-milled surface against design: gouge, excess, and what lies between the cells.
///
/// Both surfaces are taken at the nodes of the as-milled grid, which is the design's
/// grid divided `per_spacing` times, so every facet of the design is a whole number of
/// half cells and its height at a node is exact. The as-milled grid comes in bands of whole
/// blocks (about 64 x 64 nodes), so it is never there as a whole. How the bounds follow from the
/// cutter's curvature: docs/derivations/verify_bound.md.

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "cnc/verify.hpp"
#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// Deeper cuts count as gouged area and may be listed.
inline constexpr double kGougeListed_mm = 0.001;
/// A node counts as within the ball's reach if a ball that touches it has to rise by at most
/// this to cut nothing elsewhere.
inline constexpr double kReachTolerance_mm = 0.005;
/// It has room there if it may slide on over the facet's plane by half a stepover in eight
/// directions around and has to rise by at most this to cut nothing. Passes a stepover apart come
/// as near then, and leave what the stepover states. Without room (beside a crease that the ball
/// touches on both sides, down a pit) they may rest on the other side and leave several times as
/// much.
inline constexpr double kRoomTolerance_mm = 0.003;
/// Area that stands more than this above the stated scallop is counted by what keeps it there.
inline constexpr double kOverScallop_mm = 0.010;

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
  double sideways_mm = 0.0;  ///< rounding of places, deviation of pieces
  double vertical_mm = 0.0;  ///< rounding of heights
};

/// How far a gouge between nodes may exceed the deepest one at the nodes of its facet,
/// for a facet of the given slope (rise per mm); infinite where the cutter's rim is nearer
/// than the nodes, so always for a flat cutter.
[[nodiscard]] double gouge_between_nodes_mm(double slope, double cell_mm, const Cutter& cutter);

/// A block of nodes (last ones excluded) and the largest value in it.
struct ReachBlock {
  float value = 0.0F;
  std::ptrdiff_t r0 = 0, r1 = 0, c0 = 0, c1 = 0;
};

enum class BallReach : std::uint8_t { none, tight, roomy };

/// Looks for the largest of some figure among the nodes that the ball can reach: those where it
/// touches a facet that holds the node, along the facet's normal, and has to rise by at most
/// kReachTolerance_mm to cut nothing elsewhere (exact cutter location). Blocks and nodes in the
/// order of their values, so that most are never looked at.
class ReachSearch {
 public:
  /// @param ball_radius_mm  0: everything is within reach
  ReachSearch(const heightmap::ModelField& design, std::ptrdiff_t per_spacing,
              double ball_radius_mm);
  ~ReachSearch();
  /// @param value  of (row, col) on the as-milled grid
  /// @return the largest value above `best`; `best` if there is none; CORE_CANCELLED
  [[nodiscard]] Result<double> raise(
      std::vector<ReachBlock> blocks,
      const std::function<double(std::ptrdiff_t, std::ptrdiff_t)>& value, double best,
      const RunContext& run = {});

  /// How the ball reaches a node, with `room_mm` around or less. Thread-safe.
  [[nodiscard]] BallReach at(std::ptrdiff_t row, std::ptrdiff_t col, double room_mm) const;
  /// By how much no place of the ball leaves less over a node: the closing of the design by the
  /// ball, less the design. Searched around the places that touch facets at the node, so what is
  /// found may be too high, hardly by more than 1 um where the ball is near. 0 without a ball.
  /// Thread-safe; some 40 drops.
  [[nodiscard]] double closing_mm(std::ptrdiff_t row, std::ptrdiff_t col) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// As-milled rows of a band: row 0 is node row `first_row` of the whole grid.
struct MilledBand {
  const Grid<float>& z_mm;
  std::ptrdiff_t first_row;
  [[nodiscard]] double at(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return static_cast<double>(z_mm(row - first_row, col));
  }
};

struct ComparisonOptions {
  std::ptrdiff_t per_spacing = 1;
  double cell_mm = 0.0;
  CutterError error{};
  std::vector<Cutter> cutters{};  ///< those that leave the surface that is compared
  double reach_radius_mm = 0.0;   ///< of the ball that decides what can be reached
  double border_mm = 0.0;         ///< nodes nearer to the outline are counted apart
  double deepest_gouge_mm = 0.0;  ///< nothing is cut deeper; for the excess between nodes
  double stepover_mm = NAN;       ///< NaN: no stated scallop
};

class Comparison {
 public:
  /// @pre as for DividedDesign; the design outlives this
  Comparison(const heightmap::ModelField& design, ComparisonOptions options);

  [[nodiscard]] std::ptrdiff_t block_rows() const { return block_rows_; }
  /// Nodes along a block; block row b has the node rows b n .. (b + 1) n, both included.
  [[nodiscard]] std::ptrdiff_t block_nodes() const { return block_nodes_; }
  /// What a band needs beside its block rows, above and below, where the grid has it.
  static constexpr std::ptrdiff_t kMargin = 2;

  /// Every block row once, in any order of bands (which of several equal figures is named may
  /// depend on it). @return CORE_CANCELLED if stopped
  [[nodiscard]] Result<void> add(const MilledBand& band, std::ptrdiff_t first_block_row,
                                 std::ptrdiff_t end_block_row, const RunContext& run);

  /// Bound on the gouge of a surface that `cutter` has cut last, on the continuous facets of
  /// these block rows.
  [[nodiscard]] double proven_gouge_mm(const MilledBand& band, std::ptrdiff_t first_block_row,
                                       std::ptrdiff_t end_block_row, const Cutter& cutter) const;

  /// Fills the figures that come from the two surfaces. cell_bound_mm is what `cutters` may
  /// have cut deeper between the nodes.
  void finish(Certificate& certificate);

 private:
  struct Gouge {
    float depth_mm;
    std::int32_t row, col;
  };
  struct Strip;  // figures of one row of blocks
  enum Reach : std::size_t { inside, border, with_bound, over_scallop, kReaches };

  void add_quad(const MilledBand& band, std::ptrdiff_t qr, std::ptrdiff_t qc, Strip& strip,
                Gouge& deepest, std::array<float, kReaches>& reach) const;
  [[nodiscard]] double proven_quad(const MilledBand& band, std::ptrdiff_t qr, std::ptrdiff_t qc,
                                   double slope, double quad_gouge, const Cutter& cutter) const;
  [[nodiscard]] double slope_of(std::ptrdiff_t qr, std::ptrdiff_t qc) const;
  /// How nodes above the stated scallop are reached, sampled every sampling_ nodes.
  void add_over_scallop(const MilledBand& band, std::ptrdiff_t block_row, Strip& strip) const;
  [[nodiscard]] bool is_border(std::ptrdiff_t row, std::ptrdiff_t col) const;
  /// What counts for a kind of reach at a node; -INFINITY: nothing.
  [[nodiscard]] double value(Reach kind, std::ptrdiff_t row, std::ptrdiff_t col, double excess,
                             double slope) const;
  [[nodiscard]] double slope_at_node(std::ptrdiff_t row, std::ptrdiff_t col) const;

  const heightmap::ModelField& design_;
  ComparisonOptions options_;
  DividedDesign divided_;
  std::ptrdiff_t quads_, block_nodes_, block_rows_, block_cols_, border_nodes_, sampling_;
  std::vector<Strip> strips_;
  std::array<double, kReaches> best_{};
  ReachSearch reach_;

 public:
  Comparison(const Comparison&) = delete;
  Comparison& operator=(const Comparison&) = delete;
  ~Comparison();
};

}  // namespace maquette::cnc
