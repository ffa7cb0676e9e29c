// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/picture_noise.hpp"

#include "camera/effects/noise.hpp"

namespace maquette::camera {

Result<void> check(const PictureNoise& e, const Shot&) {
  MAQUETTE_TRY_VOID(in_range("picture_noise", "hot_pixel_share", e.hot_pixel_share, 0.0, 1.0));
  MAQUETTE_TRY_VOID(in_range("picture_noise", "colour_sigma", e.colour_sigma, 0.0, 10.0));
  return in_range("picture_noise", "monochrome_sigma", e.monochrome_sigma, 0.0, 10.0);
}

RowFunction rows(const PictureNoise& e, const Shot& shot, const Frame&) {
  const NoiseStream colour = temporal_noise(shot, "picture_noise.colour");
  const NoiseStream grey = temporal_noise(shot, "picture_noise.monochrome");
  const auto limit = static_cast<std::uint32_t>(e.hot_pixel_share * 4294967295.0);
  const auto colour_sigma = static_cast<float>(e.colour_sigma);
  const auto grey_sigma = static_cast<float>(e.monochrome_sigma);
  return [=](std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    const NormalTable& table = normal_table();
    for (std::size_t c = 0; c < bands.front().size(); ++c) {
      const std::uint64_t bits = grey.bits(draw_number(row, 0, 0) + c);
      const float common = grey_sigma * normal_from(table, static_cast<std::uint32_t>(bits >> 32));
      const bool hot = static_cast<std::uint32_t>(bits) < limit;
      for (std::size_t b = 0; b < bands.size(); ++b) {
        bands[b][c] += common + colour_sigma * normal_at(table, colour, draw_number(row, 0, b) + c);
        if (hot) bands[b][c] = 1.0F;
      }
    }
  };
}

}  // namespace maquette::camera
