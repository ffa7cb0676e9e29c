// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/field_walk.hpp"

#if defined(__AVX2__)
#include <immintrin.h>
#endif
#define MAQUETTE_WALK walk_common
#define MAQUETTE_WALK_MANY walk_many_common
#include "heightmap/detail/field_walk.inc"

namespace maquette::heightmap::detail {

Walks best_walks() {
#if defined(__AVX2__) && defined(MAQUETTE_WITH_AVX512)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512cd"))
    return {walk_avx512, walk_many_avx512};
#endif
  return {walk_common, walk_many_common};
}

Walks common_walks() {
  return {walk_common, walk_many_common};
}

}  // namespace maquette::heightmap::detail
