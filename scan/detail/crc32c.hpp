// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file crc32c.hpp
/// CRC-32C: polynomial 0x1EDC6F41, reflected, initial value and final xor all ones.
/// Castagnoli, Brauer, Herrmann, "Optimization of cyclic redundancy-check codes with 24 and
/// 32 parity bits", IEEE Trans. Commun. 41(6), 1993, doi:10.1109/26.231911.
/// "123456789" gives 0xE3069283.

#include <cstdint>
#include <string_view>

namespace maquette::scan::detail {

/// By the processor's instruction where the build may use it, else as crc32c_by_table.
[[nodiscard]] std::uint32_t crc32c(std::string_view bytes);
/// Eight tables, eight bytes a turn.
[[nodiscard]] std::uint32_t crc32c_by_table(std::string_view bytes);

}  // namespace maquette::scan::detail
