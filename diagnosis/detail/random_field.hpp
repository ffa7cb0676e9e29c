// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Stationary Gaussian noise in plan, for simulated measurements.

#include <cmath>
#include <cstdint>
#include <vector>

#include "core/vec.hpp"

namespace maquette::diagnosis::detail {

/// Variance, and correlation exp(-r^2 / 2 length^2) or exp(-r / length).
struct FieldLaw {
  double variance = 0.0, length_mm = 1.0;
  bool gauss = true;
  /// Up to a factor.
  [[nodiscard]] double spectrum(double k) const {
    const double q = k * k * length_mm * length_mm;
    return gauss ? std::exp(-0.5 * q) : std::pow(1.0 + q, -1.5);
  }
};

/// A field with the sum of some laws: white noise coloured in the spectrum, so that no line of it
/// stands out. Values at 1024 x 1024 nodes that repeat beyond 1.25 sides of the box; lengths below
/// a node are a node's.
class RandomField {
 public:
  /// @param blur_mm  standard deviation of what each value is a mean over
  RandomField(const Box3& box, const std::vector<FieldLaw>& laws, double blur_mm,
              std::uint64_t seed);
  [[nodiscard]] double at(double x_mm, double y_mm) const;

 private:
  double x0_, y0_, step_;
  std::vector<float> value_;
};

}  // namespace maquette::diagnosis::detail
