// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/band_joints.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "meshing/detail/joint_lines.hpp"

namespace maquette::meshing {
namespace {

/// What a stone takes of the axis.
struct Stretch {
  double from_mm, to_mm;
  int stone;
};

/// A joint through a stone is worse than any number of joints too near to stones.
constexpr detail::LineCost kThrough = 1'000'000;

class Axis {
 public:
  Axis(const heightmap::ModelField& surface, BandAxis axis)
      : first_mm_(axis == BandAxis::x ? surface.x0.value() : surface.y0.value()),
        spacing_mm_(surface.spacing.value()),
        lines_(axis == BandAxis::x ? surface.z_mm.cols() : surface.z_mm.rows()) {}
  [[nodiscard]] std::ptrdiff_t lines() const { return lines_; }
  [[nodiscard]] double at(std::ptrdiff_t line) const {
    return first_mm_ + spacing_mm_ * static_cast<double>(line);
  }
  /// Adds to the lines within the stretch, its ends included.
  void add(std::vector<detail::LineCost>& cost, double from_mm, double to_mm,
           detail::LineCost more) const {
    const auto line = [&](double mm) {
      return std::clamp((mm - first_mm_) / spacing_mm_, -1.0, static_cast<double>(lines_));
    };
    const auto first = std::max<std::ptrdiff_t>(0, std::lround(std::ceil(line(from_mm))));
    const auto last = std::min<std::ptrdiff_t>(lines_ - 1, std::lround(std::floor(line(to_mm))));
    for (std::ptrdiff_t i = first; i <= last; ++i) cost[static_cast<std::size_t>(i)] += more;
  }

 private:
  double first_mm_, spacing_mm_;
  std::ptrdiff_t lines_;
};

std::vector<Stretch> stretches(std::span<const PlacedStone> stones, BandAxis axis) {
  std::vector<Stretch> all;
  for (const PlacedStone& stone : stones) {
    const Box3 box = stone_mesh(stone).bounds();
    const bool x = axis == BandAxis::x;
    all.push_back({x ? box.min.x : box.min.y, x ? box.max.x : box.max.y, stone.number});
  }
  return all;
}

}  // namespace

Result<BandLayout> split_beside_stones(const heightmap::ModelField& surface, const BandSplit& split,
                                       std::span<const PlacedStone> stones, Millimetres clearance) {
  const double clear_mm = clearance.value();
  if (!(clear_mm >= 0.0) || !std::isfinite(clear_mm))
    return fail(
        kBandsDegenerate,
        fmt::format("clearance of {} mm between joints and stones; choose 0 mm or more", clear_mm));
  BandLayout layout;
  MAQUETTE_TRY(layout.bands, split_into_bands(surface, split));
  layout.even_bands = layout.bands.size();
  if (stones.empty() || (layout.bands.size() == 1 && !split.joints)) return layout;

  const Axis axis(surface, split.axis);
  const auto taken = stretches(stones, split.axis);
  std::vector<detail::LineCost> cost(static_cast<std::size_t>(axis.lines()), 0);
  for (const Stretch& s : taken) {
    axis.add(cost, s.from_mm - clear_mm, s.to_mm + clear_mm, 1);
    axis.add(cost, s.from_mm, s.to_mm, kThrough);
  }
  const bool even_do =
      std::all_of(layout.bands.begin() + 1, layout.bands.end(),
                  [&](const Band& b) { return cost[static_cast<std::size_t>(b.first)] == 0; });
  if (!even_do && !split.joints) {
    std::vector<std::ptrdiff_t> lines;
    if (split.count > 0) {
      lines = detail::best_lines_of(cost, split.count);
    } else {
      // A width may lie a rounding error beside a whole number of cells, as in split_into_bands.
      constexpr double kCellRounding = 1e-9;
      const double widest = std::floor(split.max_width / surface.spacing + kCellRounding);
      lines = detail::best_lines(
          cost, 2,
          static_cast<std::ptrdiff_t>(std::fmin(widest, static_cast<double>(axis.lines() - 1))));
    }
    if (!lines.empty()) {  // 2 k + 1 cells have no cut into bands of two; then the even ones stay
      BandSplit cut{.axis = split.axis};
      cut.joints.emplace(lines.begin() + 1, lines.end() - 1);
      MAQUETTE_TRY(layout.bands, split_into_bands(surface, cut));
    }
  }
  for (std::size_t b = 1; b < layout.bands.size(); ++b) {
    JointAtStones joint{static_cast<int>(b), axis.at(layout.bands[b].first), {}, {}};
    for (const Stretch& s : taken) {
      const double beside = std::fmax(s.from_mm - joint.at_mm, joint.at_mm - s.to_mm);
      if (beside <= clear_mm) (beside <= 0.0 ? joint.through : joint.near).push_back(s.stone);
    }
    if (!joint.through.empty() || !joint.near.empty()) layout.kept.push_back(std::move(joint));
  }
  return layout;
}

BandSplit split_of(const BandLayout& layout) {
  BandSplit split{.axis = layout.bands.front().axis};
  split.joints.emplace();
  for (std::size_t b = 1; b < layout.bands.size(); ++b)
    split.joints->push_back(layout.bands[b].first);
  return split;
}

}  // namespace maquette::meshing
