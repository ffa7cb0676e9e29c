// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/bands.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::heightmap::detail {
namespace {

// From the middle outwards.
constexpr std::array<float, 2> kNarrow{2.0F / 4, 1.0F / 4};
constexpr std::array<float, 3> kWide{6.0F / 16, 4.0F / 16, 1.0F / 16};

/// What lies beyond a grid's edge: the mirror image, or that turned over so that slopes go on.
enum class Edge { mirrored, turned };

/// Index of what stands for index i of n.
std::ptrdiff_t mirrored(std::ptrdiff_t i, std::ptrdiff_t n) {
  return std::clamp<std::ptrdiff_t>(i < 0 ? -i : i >= n ? 2 * (n - 1) - i : i, 0, n - 1);
}

/// Every `step`-th node of the filtered grid; the kernel's values stand `apart` nodes apart.
Grid<float> smoothed(const Grid<float>& z, std::span<const float> kernel, std::ptrdiff_t step,
                     Edge edge, std::ptrdiff_t apart = 1) {
  const auto arm = static_cast<std::ptrdiff_t>(kernel.size()) - 1, reach = arm * apart;
  Grid<float> out((z.rows() + step - 1) / step, (z.cols() + step - 1) / step);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, out.rows(), [&](std::ptrdiff_t r) {
    const auto n = static_cast<std::size_t>(z.cols()), pad = static_cast<std::size_t>(reach);
    std::vector<float> line(n + 2 * pad, 0.0F);  // with `reach` values more on either side
    float* const first = line.data() + reach;
    for (std::ptrdiff_t k = -arm; k <= arm; ++k) {
      const float w = kernel[static_cast<std::size_t>(std::abs(k))];
      const std::ptrdiff_t i = r * step + k * apart;
      const auto from = z.row(mirrored(i, z.rows()));
      if (edge == Edge::turned && (i < 0 || i >= z.rows())) {
        const auto last = z.row(i < 0 ? 0 : z.rows() - 1);
        for (std::size_t c = 0; c < n; ++c) first[c] += w * (2.0F * last[c] - from[c]);
      } else {
        for (std::size_t c = 0; c < n; ++c) first[c] += w * from[c];
      }
    }
    for (std::ptrdiff_t k = 1; k <= reach; ++k) {
      const float left = first[mirrored(-k, z.cols())],
                  right = first[mirrored(z.cols() - 1 + k, z.cols())];
      first[-k] = edge == Edge::turned ? 2.0F * first[0] - left : left;
      first[z.cols() - 1 + k] = edge == Edge::turned ? 2.0F * first[n - 1] - right : right;
    }
    const auto to = out.row(r);
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) {
      const float* middle = first + c * step;
      float sum = kernel[0] * middle[0];
      for (std::ptrdiff_t k = 1; k <= arm; ++k)
        sum += kernel[static_cast<std::size_t>(k)] * (middle[k * apart] + middle[-k * apart]);
      to[static_cast<std::size_t>(c)] = sum;
    }
  });
  return out;
}

Grid<float> every_second(const Grid<float>& fine) {
  Grid<float> out((fine.rows() + 1) / 2, (fine.cols() + 1) / 2);
  for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) out(r, c) = fine(2 * r, 2 * c);
  return out;
}

/// On a node (1 28 70 28 1) / 128, between two of them (1 7 7 1) / 16: all that is made of a wave
/// besides itself is weaker than half a percent where `kWide` leaves much of it. Beyond the edge
/// slopes go on.
Grid<float> between(const Grid<float>& coarse, std::ptrdiff_t rows, std::ptrdiff_t cols) {
  constexpr std::array<float, 5> kOn{1.0F / 128, 28.0F / 128, 70.0F / 128, 28.0F / 128, 1.0F / 128};
  constexpr std::array<float, 4> kOff{1.0F / 16, 7.0F / 16, 7.0F / 16, 1.0F / 16};
  Grid<float> out(rows, cols);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    const std::ptrdiff_t n = coarse.cols(), last = coarse.rows() - 1, i = r / 2;
    std::vector<float> line(static_cast<std::size_t>(n) + 4, 0.0F);  // two more on either side
    float* const first = line.data() + 2;
    const auto add = [&](std::ptrdiff_t row, float w) {
      const auto from = coarse.row(mirrored(row, last + 1));
      if (row >= 0 && row <= last) {
        for (std::size_t c = 0; c < from.size(); ++c) first[c] += w * from[c];
      } else {
        const auto edge = coarse.row(row < 0 ? 0 : last);
        for (std::size_t c = 0; c < from.size(); ++c) first[c] += w * (2.0F * edge[c] - from[c]);
      }
    };
    if (r % 2 == 0) {
      for (std::ptrdiff_t k = -2; k <= 2; ++k) add(i + k, kOn[static_cast<std::size_t>(k + 2)]);
    } else {
      for (std::ptrdiff_t k = -1; k <= 2; ++k) add(i + k, kOff[static_cast<std::size_t>(k + 1)]);
    }
    for (const std::ptrdiff_t c : {std::ptrdiff_t{-2}, std::ptrdiff_t{-1}, n, n + 1})
      first[c] = 2.0F * first[c < 0 ? 0 : n - 1] - first[mirrored(c, n)];
    const auto to = out.row(r);
    for (std::size_t c = 0; c < to.size(); ++c) {
      const float* at = first + c / 2;
      to[c] = c % 2 == 0 ? kOn[2] * at[0] + kOn[1] * (at[-1] + at[1]) + kOn[0] * (at[-2] + at[2])
                         : kOff[1] * (at[0] + at[1]) + kOff[0] * (at[-1] + at[2]);
    }
  });
  return out;
}

/// Distance of a level's filters, in its nodes: from level 1 on it has twice as many as waves need.
std::ptrdiff_t apart_at(std::size_t level) {
  return level == 0 ? 1 : 2;
}

/// From the nodes of the next level back to those of this one.
Grid<float> widened(const Grid<float>& next, std::size_t level, std::ptrdiff_t rows,
                    std::ptrdiff_t cols) {
  return level == 0 ? smoothed(next, kWide, 1, Edge::turned) : between(next, rows, cols);
}

/// Weight of each band of a level at a node.
class LevelWeights {
 public:
  explicit LevelWeights(const BandWeights& weights) : weights_(&weights) {
    if (weights.of_class.size() < 2) return;
    const Grid<std::uint8_t>& classes = *weights.classes;
    // The last class has what the others leave.
    for (std::size_t k = 0; k + 1 < weights.of_class.size(); ++k) {
      Grid<float>& share = share_.emplace_back(classes.rows(), classes.cols());
      for (std::size_t i = 0; i < share.cells().size(); ++i)
        share.cells()[i] = classes.cells()[i] == k ? 1.0F : 0.0F;
    }
  }
  [[nodiscard]] float operator()(std::size_t band, std::ptrdiff_t r, std::ptrdiff_t c) const {
    const auto& of = weights_->of_class;
    float weight = of.back()[band];
    for (std::size_t k = 0; k < share_.size(); ++k)
      weight += share_[k](r, c) * (of[k][band] - of.back()[band]);
    return weight;
  }
  void leave_level(std::size_t level) {
    const std::ptrdiff_t apart = apart_at(level);
    for (Grid<float>& share : share_) share = smoothed(share, kWide, apart, Edge::mirrored, apart);
  }

 private:
  const BandWeights* weights_;
  std::vector<Grid<float>> share_;
};

}  // namespace

std::vector<double> band_shares(double fx, double fy, std::size_t levels) {
  std::vector<double> out;
  double left = 1.0;
  for (std::size_t k = 0; k < levels; ++k, fx *= 2.0, fy *= 2.0) {
    const double c = std::pow(std::cos(std::numbers::pi * fx) * std::cos(std::numbers::pi * fy), 2);
    // What `widened` leaves.
    const double half =
        std::cos(0.5 * std::numbers::pi * fx) * std::cos(0.5 * std::numbers::pi * fy);
    const double back = c * c * (k == 0 ? c * c : std::pow(half, 8));
    out.push_back(left * (1.0 - c));
    out.push_back(left * (c - c * c));
    out.push_back(left * (c * c - back));
    left *= back;
  }
  out.push_back(left);
  return out;
}

Grid<float> halved(const Grid<float>& fine) {
  return smoothed(fine, kWide, 2, Edge::turned);
}

void halve(Grid<float>& fine, Grid<float>& weight) {
  for (std::size_t i = 0; i < fine.cells().size(); ++i) fine.cells()[i] *= weight.cells()[i];
  fine = smoothed(fine, kWide, 2, Edge::mirrored);
  weight = smoothed(weight, kWide, 2, Edge::mirrored);
  for (std::size_t i = 0; i < fine.cells().size(); ++i)
    fine.cells()[i] = weight.cells()[i] > 0.0F ? fine.cells()[i] / weight.cells()[i] : 0.0F;
}

Grid<float> doubled(const Grid<float>& coarse, std::ptrdiff_t rows, std::ptrdiff_t cols) {
  Grid<float> out(rows, cols);
  // On a coarse node (1 6 1) / 8, between two of them (1 1) / 2; at the edge the slope goes on.
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    const auto n = static_cast<std::size_t>(coarse.cols());
    const std::ptrdiff_t last = coarse.rows() - 1, i = r / 2;
    const auto here = coarse.row(i), before = coarse.row(std::max<std::ptrdiff_t>(0, i - 1)),
               after = coarse.row(std::min(last, i + 1));
    std::vector<float> line(n + 2);
    for (std::size_t c = 0; c < n; ++c) {
      const float b = i > 0 ? before[c] : 2.0F * here[c] - after[c],
                  a = i < last ? after[c] : 2.0F * here[c] - before[c];
      line[c + 1] = r % 2 != 0 ? 0.5F * (here[c] + a) : 0.125F * (b + 6.0F * here[c] + a);
    }
    line[0] = n > 1 ? 2.0F * line[1] - line[2] : line[1];
    line[n + 1] = n > 1 ? 2.0F * line[n] - line[n - 1] : line[n];
    const auto to = out.row(r);
    for (std::size_t c = 0; c < to.size(); ++c) {
      const float* at = line.data() + 1 + c / 2;
      to[c] = c % 2 != 0 ? 0.5F * (at[0] + at[1]) : 0.125F * (at[-1] + 6.0F * at[0] + at[1]);
    }
  });
  return out;
}

Grid<float> weighted_bands(Grid<float> z, std::size_t levels, const BandWeights& weights) {
  LevelWeights weight(weights);
  std::vector<Grid<float>> level;
  for (std::size_t k = 0; k < levels; ++k) {
    const Grid<float> narrow = smoothed(z, kNarrow, 1, Edge::turned, apart_at(k));
    Grid<float> wide = smoothed(z, kWide, 1, Edge::turned, apart_at(k));
    Grid<float> next = k == 0 ? wide : every_second(wide);
    const Grid<float> back = widened(next, k, z.rows(), z.cols());
    const std::size_t first = kBandsPerLevel * k;
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.rows(), [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
        z(r, c) = weight(first, r, c) * (z(r, c) - narrow(r, c)) +
                  weight(first + 1, r, c) * (narrow(r, c) - wide(r, c)) +
                  weight(first + 2, r, c) * (wide(r, c) - back(r, c));
    });
    level.push_back(std::exchange(z, std::move(next)));
    weight.leave_level(k);
  }
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c) z(r, c) *= weight(bands_of(levels) - 1, r, c);
  for (std::size_t k = levels; k-- > 0;) {
    const Grid<float> wider = widened(z, k, level[k].rows(), level[k].cols());
    z = std::move(level[k]);
    for (std::size_t i = 0; i < z.cells().size(); ++i) z.cells()[i] += wider.cells()[i];
    level.pop_back();
  }
  return z;
}

}  // namespace maquette::heightmap::detail
