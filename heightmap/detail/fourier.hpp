// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fourier.hpp
/// Fourier transform of a square of complex numbers.

#include <complex>
#include <cstddef>
#include <vector>

namespace maquette::heightmap::detail {

/// In place, rows then columns; n x n. Backwards it divides by n^2. Same result for any number of
/// threads. Fast where n has no prime factor above five.
void fourier(std::vector<std::complex<float>>& a, std::ptrdiff_t n, bool forward);

/// Smallest number from n on whose prime factors are 2, 3 and 5.
[[nodiscard]] std::ptrdiff_t smooth_size(std::ptrdiff_t n);

}  // namespace maquette::heightmap::detail
