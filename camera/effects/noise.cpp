// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/noise.hpp"

namespace maquette::camera {
namespace {

std::uint64_t hash(std::string_view text) {
  std::uint64_t h = 0;
  for (const char c : text) h = mix64(h ^ static_cast<unsigned char>(c));
  return h;
}

/// Lower quantile of the normal distribution, by Newton from Abramowitz and Stegun 26.2.23.
double quantile(double p) {
  if (p >= 0.5) return 0.0;
  const double t = std::sqrt(-2.0 * std::log(p));
  double z = -(t - (2.515517 + t * (0.802853 + t * 0.010328)) /
                       (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308))));
  for (int i = 0; i < 4; ++i) {
    const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
    z -= (0.5 * std::erfc(-z / std::numbers::sqrt2) - p) / density;
  }
  return z;
}

}  // namespace

NormalTable::NormalTable() {
  for (std::size_t i = 0; i < z.size(); ++i) {
    const int octave = static_cast<int>(i) / kSteps, step = static_cast<int>(i) % kSteps;
    const double p = std::ldexp(1.0 + static_cast<double>(step) / kSteps, octave - kOctaves);
    z[i] = static_cast<float>(quantile(p));
  }
}

const NormalTable& normal_table() {
  static const NormalTable table;
  return table;
}

NoiseStream temporal_noise(const Shot& shot, std::string_view effect) {
  const auto time = std::bit_cast<std::uint64_t>(shot.time_s + 0.0);  // no -0
  return {mix64(mix64(mix64(shot.seed) ^ hash(effect)) + mix64(time ^ 0x5bf03635ULL))};
}

NoiseStream fixed_pattern(const Shot& shot, std::string_view effect) {
  return {mix64(mix64(shot.serial ^ 0xa5a5a5a5ULL) + hash(effect))};
}

RowFunction added_normal(const NoiseStream& stream, double sigma) {
  return [stream, sigma = static_cast<float>(sigma)](std::ptrdiff_t row,
                                                     const std::vector<std::span<float>>& bands) {
    with_normals(stream, row, bands, [&](float& v, float z) { v += sigma * z; });
  };
}

float poisson_from(const NormalTable& table, float mean, std::uint32_t bits) {
  if (!(mean > 0.0F)) return 0.0F;
  constexpr float kFewCounts = 30.0F;
  if (mean < kFewCounts) {
    const double u = (static_cast<double>(bits) + 0.5) * 0x1.0p-32;
    double term = std::exp(-static_cast<double>(mean)), sum = term;
    int count = 0;
    // 2^-33 of the tail lies beyond 30 + 45: it ends.
    while (sum < u && count < 200) sum += term *= static_cast<double>(mean) / ++count;
    return static_cast<float>(count);
  }
  const float z = normal_from(table, bits);
  const float root = std::sqrt(mean), z2 = z * z;
  const float skewed = z + (z2 - 1.0F) / (6.0F * root) + (z - z * z2) / (72.0F * mean);
  const float count = std::floor(mean + root * skewed + 0.5F);
  return count > 0.0F ? count : 0.0F;
}

}  // namespace maquette::camera
