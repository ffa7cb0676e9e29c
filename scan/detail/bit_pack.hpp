// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file bit_pack.hpp
/// Integers of any width from 0 to 64 bits in a row, the lowest bit first, as E57 packs them.

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

namespace maquette::scan::detail {

/// Bits that hold every value from minimum to maximum. @pre minimum <= maximum
[[nodiscard]] constexpr unsigned bits_for(std::int64_t minimum, std::int64_t maximum) {
  std::uint64_t span = static_cast<std::uint64_t>(maximum) - static_cast<std::uint64_t>(minimum);
  unsigned bits = 0;
  for (; span != 0; span >>= 1) ++bits;
  return bits;
}

inline constexpr std::size_t kUnpackSlack = 9;  ///< readable bytes that unpack needs beyond the end

/// `count` values of `bits` bits from bit `first_bit` on.
inline void unpack(const char* bytes, std::uint64_t first_bit, unsigned bits, std::size_t count,
                   std::uint64_t* values) {
  const std::uint64_t mask = bits >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
  for (std::size_t i = 0; i < count; ++i, first_bit += bits) {
    const char* at = bytes + first_bit / 8;
    const auto shift = static_cast<unsigned>(first_bit % 8);
    std::uint64_t word = 0;
    std::memcpy(&word, at, 8);
    word >>= shift;
    if (shift + bits > 64)
      word |= static_cast<std::uint64_t>(static_cast<unsigned char>(at[8])) << (64 - shift);
    values[i] = word & mask;
  }
}

/// Appends values to a string of bytes.
class BitPacker {
 public:
  /// @pre value < 2^bits
  void put(std::uint64_t value, unsigned bits) {
    word_ |= value << used_;
    if (used_ + bits < 64) {
      used_ += bits;
      return;
    }
    bytes_.append(reinterpret_cast<const char*>(&word_), 8);
    const unsigned written = 64 - used_;
    word_ = written < 64 ? value >> written : 0;
    used_ = used_ + bits - 64;
  }
  /// Completes the last byte with zeros and hands all bytes out.
  [[nodiscard]] std::string take() {
    bytes_.append(reinterpret_cast<const char*>(&word_), (used_ + 7) / 8);
    word_ = 0;
    used_ = 0;
    std::string all;
    all.swap(bytes_);
    return all;
  }

 private:
  std::string bytes_;
  std::uint64_t word_ = 0;
  unsigned used_ = 0;  // bits of word_, at most 63
};

}  // namespace maquette::scan::detail
