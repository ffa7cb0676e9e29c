// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/hot_pixels.hpp"

#include <cmath>

#include <fmt/format.h>

#include "camera/effects/dark_current.hpp"
#include "camera/effects/noise.hpp"

namespace maquette::camera {

Result<void> check(const HotPixels& e, const Shot&) {
  MAQUETTE_TRY_VOID(in_range("hot_pixels", "share", e.share, 0.0, 0.5));
  MAQUETTE_TRY_VOID(in_range("hot_pixels", "mean_rate_e_s", e.mean_rate_e_s, 0.0, 1e9));
  return in_range("hot_pixels", "reference_c", e.reference_c, -200.0, 150.0);
}

RowFunction rows(const HotPixels& e, const Shot& shot, const Frame&) {
  const NoiseStream stream = fixed_pattern(shot, HotPixels::kInfo.name);
  const auto limit = static_cast<std::uint32_t>(e.share * 4294967295.0);
  const double mean_e =
      e.mean_rate_e_s * shot.exposure_s * dark_growth(shot.temperature_c, e.reference_c);
  return [=](std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    for (std::size_t b = 0; b < bands.size(); ++b) {
      const std::uint64_t first = draw_number(row, 0, b);
      for (std::size_t c = 0; c < bands[b].size(); ++c) {
        const std::uint64_t bits = stream.bits(first + c);
        if ((bits >> 32) >= limit) continue;
        const double u = (static_cast<double>(bits & 0xffffffffU) + 0.5) * 0x1.0p-32;
        bands[b][c] -= static_cast<float>(mean_e * std::log(u));
      }
    }
  };
}

Result<void> check(const DarkLibrary& e, const Shot& shot) {
  for (std::size_t i = 0; i < e.frames.size(); ++i) {
    const auto& [temperature_c, rate] = e.frames[i];
    MAQUETTE_TRY_VOID(in_range("dark_library", "temperature_c", temperature_c, -200.0, 150.0));
    if (i > 0 && temperature_c <= e.frames[i - 1].temperature_c)
      return fail(kEffectOutOfRange, "dark_library: frames must come by rising temperature");
    if (rate.rows() != shot.intrinsics.height_px || rate.cols() != shot.intrinsics.width_px)
      return fail(
          kEffectOutOfRange,
          fmt::format("dark_library: the frame of {} C has {} x {} pixels, the camera {} x {}",
                      temperature_c, rate.cols(), rate.rows(), shot.intrinsics.width_px,
                      shot.intrinsics.height_px));
  }
  return {};
}

RowFunction rows(const DarkLibrary& e, const Shot& shot, const Frame&) {
  if (e.frames.empty()) return [](std::ptrdiff_t, const std::vector<std::span<float>>&) {};
  const auto& frames = e.frames;
  std::size_t upper = 0;
  while (upper + 1 < frames.size() && frames[upper].temperature_c < shot.temperature_c) ++upper;
  const std::size_t lower =
      upper > 0 && frames[upper].temperature_c >= shot.temperature_c ? upper - 1 : upper;
  const double low_c = frames[lower].temperature_c, high_c = frames[upper].temperature_c;
  const double inside_c = std::clamp(shot.temperature_c, low_c, high_c);
  const auto inverse = [](double celsius) { return 1.0 / (celsius + 273.15); };
  const double share =
      lower == upper ? 0.0
                     : (inverse(inside_c) - inverse(low_c)) / (inverse(high_c) - inverse(low_c));
  const double beyond = dark_growth(shot.temperature_c, inside_c) * shot.exposure_s;
  return [share, beyond, a = &frames[lower].rate_e_s, b = &frames[upper].rate_e_s](
             std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    for (const auto& band : bands)
      for (std::size_t c = 0; c < band.size(); ++c) {
        const double low = std::max(1e-9, static_cast<double>(a->row(row)[c]));
        const double high = std::max(1e-9, static_cast<double>(b->row(row)[c]));
        band[c] += static_cast<float>(beyond * low * std::pow(high / low, share));
      }
  };
}

}  // namespace maquette::camera
