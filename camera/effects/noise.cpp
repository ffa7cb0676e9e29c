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

namespace {

constexpr float kFewCounts = 30.0F;
constexpr int kMostCounts = 200;  ///< of fewer than kFewCounts expected

/// Of kFewCounts or more.
inline float many_counts(float mean, float z) {
  const float root = std::sqrt(mean), z2 = z * z;
  const float skewed = z + (z2 - 1.0F) / (6.0F * root) + (z - z * z2) / (72.0F * mean);
  const float count = std::floor(mean + root * skewed + 0.5F);
  return count > 0.0F ? count : 0.0F;
}

}  // namespace

float poisson_from(const NormalTable& table, float mean, std::uint32_t bits) {
  if (!(mean > 0.0F)) return 0.0F;
  if (mean < kFewCounts) {
    const double u = (static_cast<double>(bits) + 0.5) * 0x1.0p-32;
    double term = std::exp(-static_cast<double>(mean)), sum = term;
    int count = 0;
    // 2^-33 of the tail lies beyond 30 + 45: it ends.
    while (sum < u && count < kMostCounts) sum += term *= static_cast<double>(mean) / ++count;
    return static_cast<float>(count);
  }
  return many_counts(mean, normal_from(table, bits));
}

namespace {

/// poisson_from() of means below kFewCounts, four at a time.
void few_counts(std::span<const float> means, std::span<const std::uint32_t> bits,
                std::span<float> counts) {
  using Four = double __attribute__((vector_size(32)));
  for (std::size_t first = 0; first < means.size(); first += 4) {
    const std::size_t n = std::min<std::size_t>(4, means.size() - first);
    Four mean{}, u{}, term{}, count{};  // what is left of the four draws nothing
    for (std::size_t i = 0; i < n; ++i) {
      if (!(means[first + i] > 0.0F)) continue;
      mean[i] = static_cast<double>(means[first + i]);
      u[i] = (static_cast<double>(bits[first + i]) + 0.5) * 0x1.0p-32;
      term[i] = std::exp(-mean[i]);
    }
    Four sum = term;
    for (int k = 1; k <= kMostCounts; ++k) {
      const auto more = sum < u;
      if ((more[0] | more[1] | more[2] | more[3]) == 0) break;
      term *= mean / static_cast<double>(k);
      sum = more ? sum + term : sum;
      count = more ? count + 1.0 : count;
    }
    for (std::size_t i = 0; i < n; ++i) counts[first + i] = static_cast<float>(count[i]);
  }
}

}  // namespace

void poisson_counts(const NormalTable& table, const NoiseStream& stream, std::uint64_t first,
                    std::span<float> means) {
  std::array<float, kDraws> z, counts, few;
  std::array<std::uint32_t, kDraws> few_bits;
  std::array<std::size_t, kDraws> of;
  for (std::size_t c = 0; c < means.size(); c += kDraws) {
    const std::size_t n = std::min(kDraws, means.size() - c);
    float* to = means.data() + c;
    normals_at(table, stream, first + c, n, z.data());
    for (std::size_t i = 0; i < n; ++i)
      counts[i] = many_counts(to[i] > kFewCounts ? to[i] : kFewCounts, z[i]);
    std::size_t k = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (to[i] >= kFewCounts) continue;
      of[k] = i;
      few[k] = to[i];
      few_bits[k++] = static_cast<std::uint32_t>(stream.bits(first + c + i) >> 32);
    }
    std::copy_n(counts.data(), n, to);
    few_counts({few.data(), k}, {few_bits.data(), k}, {counts.data(), k});
    for (std::size_t i = 0; i < k; ++i) to[of[i]] = counts[i];
  }
}

}  // namespace maquette::camera
