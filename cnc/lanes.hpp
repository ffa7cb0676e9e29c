// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lanes.hpp
/// Eight floats at once in the compilers' own notation, which they lower to what the target has.

#include <cstring>

#ifdef __AVX2__
#include <immintrin.h>
#endif

namespace maquette::cnc {

inline constexpr int kLanes = 8;
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));

inline Lanes load(const float* from) {
  Lanes v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
inline void store(float* to, Lanes v) {
  std::memcpy(to, &v, sizeof v);
}
inline Lanes larger(Lanes a, Lanes b) {
  return a > b ? a : b;
}
inline Lanes smaller(Lanes a, Lanes b) {
  return a < b ? a : b;
}
inline Lanes magnitude(Lanes a) {
  return a < 0.0F ? -a : a;
}
inline float largest(Lanes v) {
  float top = v[0];
  for (int k = 1; k < kLanes; ++k) top = v[k] > top ? v[k] : top;
  return top;
}
/// @pre no lane is negative
inline Lanes root(Lanes v) {
#ifdef __AVX2__
  return reinterpret_cast<Lanes>(_mm256_sqrt_ps(reinterpret_cast<__m256>(v)));
#else
  for (int k = 0; k < kLanes; ++k) v[k] = __builtin_sqrtf(v[k]);
  return v;
#endif
}
/// Bit k: lane k of v is not <= limit (so that NaN counts).
inline unsigned beats(Lanes v, float limit) {
#ifdef __AVX2__
  return static_cast<unsigned>(_mm256_movemask_ps(
      _mm256_cmp_ps(reinterpret_cast<__m256>(v), _mm256_set1_ps(limit), _CMP_NLE_UQ)));
#else
  unsigned mask = 0;
  for (int k = 0; k < kLanes; ++k) mask |= (v[k] <= limit ? 0U : 1U) << k;
  return mask;
#endif
}

}  // namespace maquette::cnc
