// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/even_and_odd.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace maquette::diagnosis::detail {
namespace {

constexpr std::size_t kParities = 3;  // of the row, the column, their sum
constexpr Eigen::Index kUnknowns = 4;

/// 1 or -1.
std::array<double, kParities> signs_of(const MeasuredPixel& p, std::size_t width) {
  const double row = (p.at / width) % 2 == 0 ? 1.0 : -1.0,
               col = (p.at % width) % 2 == 0 ? 1.0 : -1.0;
  return {row, col, row * col};
}

}  // namespace

EvenAndOdd even_and_odd(const PhotoLinear& left, const PhotoViews& views, double clip) {
  using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  using Vector = Eigen::Matrix<double, kUnknowns, 1>;
  const std::size_t channels = views.channels();
  struct Sums {
    Matrix normal = Matrix::Zero(), scatter = Matrix::Zero();
    std::array<Vector, kParities> right{Vector::Zero(), Vector::Zero(), Vector::Zero()};
    double noise = 0.0, n = 0.0;  // variance of the pixels, as declared
  };
  const auto& photos = views.scene().photos;
  std::vector<Sums> sums(photos.size() * channels);
  const auto& pixels = views.pixels();
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const MeasuredPixel& p = pixels[i];
    const auto sign = signs_of(p, static_cast<std::size_t>(photos[p.photo].width_px));
    for (std::size_t ch = 0; ch < channels; ++ch) {
      const auto at = static_cast<Eigen::Index>(i * channels + ch);
      const double sigma = static_cast<double>(left.sigma(at));
      const double r = std::clamp(static_cast<double>(left.residual(at)), -clip, clip);
      const Vector x = Vector{1.0, static_cast<double>(p.value[ch]), static_cast<double>(p.du),
                              static_cast<double>(p.dv)} /
                       sigma;
      Sums& s = sums[p.photo * channels + ch];
      s.normal += x * x.transpose();
      s.scatter += r * r * x * x.transpose();
      for (std::size_t k = 0; k < kParities; ++k) s.right[k] += sign[k] * r * x;
      s.noise += sigma * sigma;
      s.n += 1.0;
    }
  }
  EvenAndOdd clearest;
  for (const Sums& s : sums) {
    if (s.n < 100.0 * kUnknowns) continue;
    const auto normal = s.normal.ldlt(), scatter = s.scatter.ldlt();
    for (const Vector& right : s.right) {
      const double level = right.dot(scatter.solve(right));
      if (!(level > clearest.level)) continue;
      const double explained = right.dot(normal.solve(right));
      clearest = {level, 255.0 * std::sqrt(std::fmax(0.0, explained) / s.n * s.noise / s.n)};
    }
  }
  return clearest;
}

}  // namespace maquette::diagnosis::detail
