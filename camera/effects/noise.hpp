// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file noise.hpp
/// Random numbers of the effects: a pure function of (seed, simulation time, effect, pixel), so
/// that a picture is the same for any number of threads, and another time gives another.
///
/// Bits: SplitMix64 (Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195) as a counter. Normal
/// deviates by the inverse of the distribution from a table with 32 steps an octave: within 1e-4 of
/// the true quantile up to 6 sigma (tests). Poisson counts by inversion below 30 expected, above by
/// the Cornish-Fisher expansion of the quantile (Abramowitz and Stegun 26.2.49).

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "camera/effects/frame.hpp"
#include "core/random.hpp"

namespace maquette::camera {

struct NoiseStream {
  std::uint64_t key = 0;
  [[nodiscard]] std::uint64_t bits(std::uint64_t pixel) const {
    return mix64(key + pixel * 0x9e3779b97f4a7c15ULL);
  }
};

/// Temporal noise of one effect in one shot.
[[nodiscard]] NoiseStream temporal_noise(const Shot& shot, std::string_view effect);
/// What the sensor was made with: depends on its serial number alone.
[[nodiscard]] NoiseStream fixed_pattern(const Shot& shot, std::string_view effect);

/// Number of a pixel's draw in a stream.
[[nodiscard]] inline std::uint64_t draw_number(std::ptrdiff_t row, std::ptrdiff_t col,
                                               std::size_t band) {
  return (static_cast<std::uint64_t>(band) << 60) ^ (static_cast<std::uint64_t>(row) << 30) ^
         static_cast<std::uint64_t>(col);
}

/// Table of the normal quantile: octave by octave from one half downwards.
struct NormalTable {
  static constexpr int kSteps = 32, kOctaves = 32;
  std::array<float, kSteps * kOctaves + 2> z{};
  NormalTable();
};
[[nodiscard]] const NormalTable& normal_table();

/// Standard normal deviate from 32 random bits; symmetric.
[[nodiscard]] inline float normal_from(const NormalTable& table, std::uint32_t bits) {
  // p in (0, 1/2]: the upper end of a step of 2^-32.
  const float p = (static_cast<float>(bits & 0x7fffffffU) + 1.0F) * 0x1.0p-32F;
  const std::uint32_t raw = std::bit_cast<std::uint32_t>(p);
  constexpr std::uint32_t kBase = (127U - NormalTable::kOctaves) << 5;
  const std::uint32_t index = (raw >> 18) - kBase;
  const float share = static_cast<float>(raw & 0x3ffffU) * 0x1.0p-18F;
  const float z = table.z[index] + share * (table.z[index + 1] - table.z[index]);
  return (bits & 0x80000000U) != 0 ? -z : z;
}

/// Draw `number` of a stream: its upper 32 bits, as a standard normal deviate.
[[nodiscard]] inline float normal_at(const NormalTable& table, const NoiseStream& stream,
                                     std::uint64_t number) {
  return normal_from(table, static_cast<std::uint32_t>(stream.bits(number) >> 32));
}

/// Draws `first` to `first` + n - 1 of a stream as standard normal deviates, n <= kDraws: the same
/// as normal_at() one by one.
inline constexpr std::size_t kDraws = 64;
inline void normals_at(const NormalTable& table, const NoiseStream& stream, std::uint64_t first,
                       std::size_t n, float* to) {
  std::array<std::uint32_t, kDraws> bits;
  for (std::size_t i = 0; i < n; ++i)
    bits[i] = static_cast<std::uint32_t>(stream.bits(first + i) >> 32);
  for (std::size_t i = 0; i < n; ++i) to[i] = normal_from(table, bits[i]);
}

/// Calls change(pixel, deviate) for each pixel of a row in each band, with its own draw.
template <class Change>
void with_normals(const NoiseStream& stream, std::ptrdiff_t row,
                  const std::vector<std::span<float>>& bands, Change change) {
  const NormalTable& table = normal_table();
  for (std::size_t b = 0; b < bands.size(); ++b) {
    const std::uint64_t first = draw_number(row, 0, b);
    const std::size_t cols = bands[b].size();
    std::array<float, kDraws> z;
    for (std::size_t c = 0; c < cols; c += kDraws) {
      const std::size_t n = std::min(kDraws, cols - c);
      normals_at(table, stream, first + c, n, z.data());
      float* to = bands[b].data() + c;
      for (std::size_t i = 0; i < n; ++i) change(to[i], z[i]);
    }
  }
}

/// Adds normal noise of `sigma` to every pixel.
[[nodiscard]] RowFunction added_normal(const NoiseStream& stream, double sigma);

/// Counts of a Poisson distribution of `mean` >= 0 from 32 random bits.
[[nodiscard]] float poisson_from(const NormalTable& table, float mean, std::uint32_t bits);
/// Each mean becomes a count, by draws `first` and following of a stream: the same as
/// poisson_from() one by one.
void poisson_counts(const NormalTable& table, const NoiseStream& stream, std::uint64_t first,
                    std::span<float> means);

}  // namespace maquette::camera
