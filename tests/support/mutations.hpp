// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mutations.hpp
/// Damages files in the ways that find bugs in readers: bytes replaced, flipped, cut out, doubled,
/// saturated, and characters that numbers are made of put in.

#include <algorithm>
#include <string>
#include <string_view>

#include "core/random.hpp"

namespace maquette::testing_support {

class Mutator {
 public:
  explicit Mutator(std::uint64_t seed) : seed_(seed) {}

  /// Uniform in [0, n). @pre n > 0
  std::size_t index(std::size_t n) {
    return static_cast<std::size_t>(random_bits(seed_, draw_++) % n);
  }

  /// One to four damages; a quarter of them near the beginning, where headers are.
  std::string operator()(std::string bytes) {
    constexpr std::string_view kSpice = "0123456789-+.eE \n\r\t,;#nainf\xFF";
    for (std::size_t k = 1 + index(4); k > 0 && !bytes.empty(); --k) {
      const std::size_t at =
          index(index(4) == 0 ? std::min<std::size_t>(bytes.size(), 300) : bytes.size());
      switch (index(7)) {
        case 0:
          bytes[at] = static_cast<char>(index(256));
          break;
        case 1:
          bytes = bytes.substr(0, at) + kSpice[index(kSpice.size())] + bytes.substr(at);
          break;
        case 2:
          bytes[at] = kSpice[index(kSpice.size())];
          break;
        case 3:
          bytes.erase(at, 1 + index(20));
          break;
        case 4:
          bytes.erase(at);
          break;
        case 5: {
          const std::string piece = bytes.substr(index(bytes.size()), index(60));
          bytes = bytes.substr(0, at) + piece + bytes.substr(at);
          break;
        }
        default:
          for (std::size_t b = at; b < std::min(at + 1 + index(8), bytes.size()); ++b)
            bytes[b] = static_cast<char>(bytes[b] ^ (index(2) == 0 ? 0xFF : 1 << index(8)));
      }
    }
    return bytes;
  }

 private:
  std::uint64_t seed_, draw_ = 0;
};

}  // namespace maquette::testing_support
