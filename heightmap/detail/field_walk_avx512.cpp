// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled for x86-64-v4 where the compiler can: CMakeLists.txt.
#include "heightmap/detail/field_walk.hpp"

#if defined(__AVX512F__)
#include <immintrin.h>
#define MAQUETTE_WALK walk_avx512
#define MAQUETTE_WALK_MANY walk_many_avx512
#include "heightmap/detail/field_walk.inc"
#endif
