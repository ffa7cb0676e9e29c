// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file las_layout.hpp
/// Where LAS 1.2 to 1.4 keeps what (ASPRS, LAS specification 1.4 - R15, 2019). The header has
/// 227 bytes (1.3: 235, 1.4: 375), numbers little-endian:
///   0 "LASF"; 24, 25 version; 94 u16 its size; 96 u32 offset of the points; 104 u8 point
///   format (bits 6 and 7: compressed); 105 u16 record length; 107 u32 points; 111 5 u32
///   points by return; 131 3 f64 scale; 155 3 f64 offset; 179 f64 max x, min x, max y, ...;
///   1.4: 247 u64 points, 255 15 u64 points by return
/// A coordinate is raw * scale + offset.

#include <array>
#include <cstddef>
#include <optional>

namespace maquette::scan::detail {

struct LasLayout {
  std::size_t bytes;  ///< at least
  std::optional<std::size_t> time, colour;
  bool extended;  ///< formats 6 to 10: four bits per return number, fine scan angles
};

inline constexpr std::array<LasLayout, 11> kLasLayouts{{
    {20, {}, {}, false},
    {28, 20, {}, false},
    {26, {}, 20, false},
    {34, 20, 28, false},
    {57, 20, {}, false},
    {63, 20, 28, false},
    {30, 22, {}, true},
    {36, 22, 30, true},
    {38, 22, 30, true},
    {59, 22, {}, true},
    {67, 22, 30, true},
}};

inline constexpr double kLasAngleStepDeg = 0.006;  ///< of the extended formats; others: 1

[[nodiscard]] constexpr std::size_t las_header_bytes(int minor) {
  return minor >= 4 ? 375 : minor == 3 ? 235 : 227;
}

}  // namespace maquette::scan::detail
