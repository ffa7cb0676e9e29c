// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lzf.hpp
/// The LZF byte stream, which binary_compressed PCD uses. Each token starts with a byte c:
///   c < 32   c + 1 literal bytes follow
///   else     a copy of (c >> 5) + 2 bytes (7: one more byte is added to the length) from
///            ((c & 31) << 8) + next byte + 1 bytes before the end of the output

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace maquette::scan::detail {

/// The most that a compressed byte can become: three give 264.
inline constexpr std::size_t kLzfLargestRatio = 88;

/// @return exactly `size` bytes, or nothing if the stream is damaged
[[nodiscard]] std::optional<std::string> lzf_decompress(std::string_view packed, std::size_t size);
/// Greedy, with one hash of three bytes; at most 1/32 (and a byte) longer than the input.
[[nodiscard]] std::string lzf_compress(std::string_view bytes);

}  // namespace maquette::scan::detail
