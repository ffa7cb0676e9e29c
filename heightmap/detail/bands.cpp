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

/// Every `step`-th node of the filtered grid.
Grid<float> smoothed(const Grid<float>& z, std::span<const float> kernel, std::ptrdiff_t step,
                     Edge edge) {
  const auto reach = static_cast<std::ptrdiff_t>(kernel.size()) - 1;
  Grid<float> out((z.rows() + step - 1) / step, (z.cols() + step - 1) / step);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, out.rows(), [&](std::ptrdiff_t r) {
    const auto n = static_cast<std::size_t>(z.cols()), pad = static_cast<std::size_t>(reach);
    std::vector<float> line(n + 2 * pad, 0.0F);  // with `reach` values more on either side
    float* const first = line.data() + reach;
    for (std::ptrdiff_t k = -reach; k <= reach; ++k) {
      const float w = kernel[static_cast<std::size_t>(std::abs(k))];
      const std::ptrdiff_t i = r * step + k;
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
      for (std::ptrdiff_t k = 1; k <= reach; ++k)
        sum += kernel[static_cast<std::size_t>(k)] * (middle[k] + middle[-k]);
      to[static_cast<std::size_t>(c)] = sum;
    }
  });
  return out;
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
  void next_level() {
    for (Grid<float>& share : share_) share = smoothed(share, kWide, 2, Edge::mirrored);
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
    out.push_back(left * (1.0 - c));
    out.push_back(left * (c - c * c));
    out.push_back(left * (c * c - c * c * c * c));
    left *= c * c * c * c;
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
    const Grid<float> narrow = smoothed(z, kNarrow, 1, Edge::turned),
                      wide = smoothed(z, kWide, 1, Edge::turned);
    Grid<float> half = halved(z);
    const Grid<float> back = doubled(half, z.rows(), z.cols());
    const std::size_t first = kBandsPerLevel * k;
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.rows(), [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
        z(r, c) = weight(first, r, c) * (z(r, c) - narrow(r, c)) +
                  weight(first + 1, r, c) * (narrow(r, c) - wide(r, c)) +
                  weight(first + 2, r, c) * (wide(r, c) - back(r, c));
    });
    level.push_back(std::exchange(z, std::move(half)));
    weight.next_level();
  }
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c) z(r, c) *= weight(bands_of(levels) - 1, r, c);
  for (std::size_t k = levels; k-- > 0;) {
    const Grid<float> wider = doubled(z, level[k].rows(), level[k].cols());
    z = std::move(level[k]);
    for (std::size_t i = 0; i < z.cells().size(); ++i) z.cells()[i] += wider.cells()[i];
    level.pop_back();
  }
  return z;
}

}  // namespace maquette::heightmap::detail
