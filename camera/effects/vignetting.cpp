// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/vignetting.hpp"

#include <cmath>
#include <memory>
#include <numbers>

#include <fmt/format.h>

namespace maquette::camera {
namespace {

constexpr std::size_t kSteps = 4096;  ///< of the table over the squared radius; error below 1e-6

/// By the distance from the principal point, pixels.
double at_radius(const Vignetting& e, const Shot& shot, double radius_px) {
  const Intrinsics& k = shot.intrinsics;
  const double tangent = radius_px / k.fx_px;
  double light = std::pow(1.0 + tangent * tangent, -0.5 * e.cosine_power);
  if (e.barrel_ratio > 0.0) light *= disc_overlap(e.barrel_ratio, e.barrel_shift * tangent);
  const double q = radius_px / (0.5 * std::hypot(k.width_px, k.height_px)), q2 = q * q;
  double sum = 0.0;
  for (std::size_t i = e.polynomial.size(); i-- > 0;) sum = (sum + e.polynomial[i]) * q2;
  return std::max(0.0, light * (1.0 + sum));
}

/// Squared distance in pixels of the x axis.
double squared_radius(const Intrinsics& k, Vec2 px) {
  const double x = px.x - k.cx_px, y = (px.y - k.cy_px) * k.fx_px / k.fy_px;
  return x * x + y * y;
}

}  // namespace

double disc_overlap(double ratio, double shift) {
  const double d = std::abs(shift);
  if (d >= 1.0 + ratio) return 0.0;
  if (d <= ratio - 1.0) return 1.0;
  if (d <= 1.0 - ratio) return ratio * ratio;
  const double a = std::acos((d * d + 1.0 - ratio * ratio) / (2.0 * d));
  const double b = std::acos((d * d + ratio * ratio - 1.0) / (2.0 * d * ratio));
  const double lens = a - 0.5 * std::sin(2.0 * a) + ratio * ratio * (b - 0.5 * std::sin(2.0 * b));
  return lens / std::numbers::pi;
}

double fall_of_light(const Vignetting& e, const Shot& shot, Vec2 px) {
  return at_radius(e, shot, std::sqrt(squared_radius(shot.intrinsics, px)));
}

Result<void> check(const Vignetting& e, const Shot&) {
  MAQUETTE_TRY_VOID(in_range("vignetting", "cosine_power", e.cosine_power, 0.0, 20.0));
  if (e.barrel_ratio != 0.0)
    MAQUETTE_TRY_VOID(in_range("vignetting", "barrel_ratio", e.barrel_ratio, 1.0, 100.0));
  MAQUETTE_TRY_VOID(in_range("vignetting", "barrel_shift", e.barrel_shift, 0.0, 1000.0));
  if (e.polynomial.size() > 6)
    return fail(kEffectOutOfRange, fmt::format("vignetting.polynomial has {} values; at most 6 are "
                                               "possible",
                                               e.polynomial.size()));
  for (const double v : e.polynomial)
    MAQUETTE_TRY_VOID(in_range("vignetting", "polynomial", v, -100.0, 100.0));
  return {};
}

RowFunction rows(const Vignetting& e, const Shot& shot, const Frame&) {
  const Intrinsics k = shot.intrinsics;
  double farthest = 0.0;
  for (const double x : {0.0, 1.0 * k.width_px})
    for (const double y : {0.0, 1.0 * k.height_px})
      farthest = std::max(farthest, squared_radius(k, {x, y}));
  auto table = std::make_shared<std::vector<float>>(kSteps + 2);
  for (std::size_t i = 0; i < table->size(); ++i)
    (*table)[i] = static_cast<float>(
        at_radius(e, shot, std::sqrt(farthest * static_cast<double>(i) / kSteps)));
  return [table, k, scale = static_cast<float>(kSteps / farthest)](
             std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    const float* t = table->data();
    const auto y =
        static_cast<float>((static_cast<double>(row) + 0.5 - k.cy_px) * k.fx_px / k.fy_px);
    for (std::size_t c = 0; c < bands[0].size(); ++c) {
      const float x = static_cast<float>(c) + 0.5F - static_cast<float>(k.cx_px);
      const float place = scale * (x * x + y * y);
      const int i = static_cast<int>(place);
      const float light = t[i] + (place - static_cast<float>(i)) * (t[i + 1] - t[i]);
      for (const auto& band : bands) band[c] *= light;
    }
  };
}

}  // namespace maquette::camera
