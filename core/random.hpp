// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file random.hpp
/// Counter-based random numbers: a pure function of (seed, counter), so that the
/// same job draws the same numbers for any number of threads and any order.
///
/// Mixing function: Steele, Lea, Flood, "Fast splittable pseudorandom number
/// generators", OOPSLA 2014, doi:10.1145/2660193.2660195 (SplitMix64, applied
/// twice). Not for cryptography.

#include <cmath>
#include <cstdint>
#include <numbers>

namespace maquette {

[[nodiscard]] constexpr std::uint64_t mix64(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// 64 random bits for draw number `counter` of stream `seed`.
[[nodiscard]] constexpr std::uint64_t random_bits(std::uint64_t seed, std::uint64_t counter) {
  return mix64(mix64(seed) ^ mix64(counter * 0xd1342543de82ef95ULL + 1));
}

/// Uniform in [0, 1), 53 bits.
[[nodiscard]] constexpr double random_uniform(std::uint64_t seed, std::uint64_t counter) {
  return static_cast<double>(random_bits(seed, counter) >> 11) * 0x1.0p-53;
}

/// Standard normal by Box and Muller; uses draws 2 counter and 2 counter + 1.
[[nodiscard]] inline double random_normal(std::uint64_t seed, std::uint64_t counter) {
  const double u = 1.0 - random_uniform(seed, 2 * counter);
  const double v = random_uniform(seed, 2 * counter + 1);
  return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
}

}  // namespace maquette
