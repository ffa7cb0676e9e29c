// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/tone.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>

#include "camera/srgb.hpp"

namespace maquette::camera {
namespace {

/// Steps of the table: the curve of sRGB is straight below 0.0031 and its error above is below
/// 2e-6; a power curve is steepest at 0, where the first steps are worked out one by one.
constexpr std::size_t kSteps = 16384;
constexpr float kExactBelow = 0.004F;

}  // namespace

double encoded(const Tone& e, double linear) {
  const double v = std::clamp(linear, 0.0, 1.0);
  if (e.curve == "linear") return v;
  if (e.curve == "gamma") return std::pow(v, 1.0 / e.gamma);
  return srgb_of_linear(v);
}

Result<void> check(const Tone& e, const Shot&) {
  if (e.curve != "srgb" && e.curve != "gamma" && e.curve != "linear")
    return fail(kEffectOutOfRange,
                fmt::format("tone.curve is \"{}\"; srgb, gamma or linear is possible", e.curve));
  return in_range("tone", "gamma", e.gamma, 0.1, 10.0);
}

RowFunction rows(const Tone& e, const Shot&, const Frame&) {
  auto table = std::make_shared<std::vector<float>>(kSteps + 2);
  for (std::size_t i = 0; i < table->size(); ++i)
    (*table)[i] = static_cast<float>(encoded(e, static_cast<double>(i) / kSteps));
  return [e, table](std::ptrdiff_t, const std::vector<std::span<float>>& bands) {
    const bool power = e.curve == "gamma";
    const float* t = table->data();
    for (const auto& band : bands)
      for (float& v : band) {
        const float x = std::clamp(v, 0.0F, 1.0F);
        if (power && x < kExactBelow) {
          v = static_cast<float>(encoded(e, static_cast<double>(x)));
          continue;
        }
        const float place = x * static_cast<float>(kSteps);
        const auto i = static_cast<std::size_t>(static_cast<int>(place));
        v = t[i] + (place - static_cast<float>(i)) * (t[i + 1] - t[i]);
      }
  };
}

}  // namespace maquette::camera
