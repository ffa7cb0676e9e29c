// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/random_field.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include "core/random.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr int kNodes = 1024;
}

RandomField::RandomField(const Box3& box, const std::vector<FieldLaw>& laws, double blur_mm,
                         std::uint64_t seed)
    : x0_(box.min.x),
      y0_(box.min.y),
      step_(1.25 * std::fmax(box.max.x - box.min.x, box.max.y - box.min.y) / kNodes) {
  std::vector<double> power(kNodes * kNodes, 0.0);
  for (const FieldLaw& law : laws) {
    if (!(law.variance > 0.0)) continue;
    double sum = 0.0;
    const auto each = [&](const auto& use) {
      for (std::ptrdiff_t r = 0; r < kNodes; ++r)
        for (std::ptrdiff_t c = 0; c < kNodes; ++c) {
          const auto wave = [](std::ptrdiff_t i) {
            return static_cast<double>(i > kNodes / 2 ? i - kNodes : i);
          };
          const double k = 2.0 * std::numbers::pi * std::hypot(wave(r), wave(c)) / (kNodes * step_);
          use(static_cast<std::size_t>(r * kNodes + c), k, law.spectrum(k));
        }
    };
    each([&](std::size_t, double, double s) { sum += s; });
    each([&](std::size_t i, double k, double s) {
      power[i] += law.variance * s / sum * std::exp(-k * k * blur_mm * blur_mm);
    });
  }
  using Complex = std::complex<double>;
  Eigen::Matrix<Complex, kNodes, 1> line, turned;
  std::vector<Complex> v(kNodes * kNodes);
  for (std::size_t i = 0; i < v.size(); ++i)
    v[i] =
        std::sqrt(power[i]) * Complex(random_normal(seed, 2 * i), random_normal(seed, 2 * i + 1));
  Eigen::FFT<double> fft;
  for (const bool rows : {true, false})
    for (std::size_t a = 0; a < kNodes; ++a) {
      const auto at = [&](std::size_t b) { return rows ? a * kNodes + b : b * kNodes + a; };
      for (std::size_t b = 0; b < kNodes; ++b) line(static_cast<Eigen::Index>(b)) = v[at(b)];
      fft.fwd(turned, line);
      for (std::size_t b = 0; b < kNodes; ++b) v[at(b)] = turned(static_cast<Eigen::Index>(b));
    }
  for (const Complex& c : v) value_.push_back(static_cast<float>(c.real()));
}

double RandomField::at(double x, double y) const {
  const auto c = std::clamp<std::ptrdiff_t>(std::lround((x - x0_) / step_), 0, kNodes - 1),
             r = std::clamp<std::ptrdiff_t>(std::lround((y - y0_) / step_), 0, kNodes - 1);
  return static_cast<double>(value_[static_cast<std::size_t>(r * kNodes + c)]);
}

}  // namespace maquette::diagnosis::detail
