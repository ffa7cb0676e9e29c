// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/lzf.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace maquette::scan::detail {
namespace {
constexpr std::size_t kLiterals = 32, kReach = 8192, kLongestCopy = 264;
constexpr unsigned kHashBits = 16;
}  // namespace

std::optional<std::string> lzf_decompress(std::string_view packed, std::size_t size) {
  std::string out;
  if (size / kLzfLargestRatio > packed.size()) return std::nullopt;
  out.reserve(size);
  std::size_t at = 0;
  const auto byte = [&] {
    return static_cast<std::size_t>(static_cast<unsigned char>(packed[at++]));
  };
  while (at < packed.size()) {
    const std::size_t token = byte();
    if (token < kLiterals) {
      const std::size_t n = token + 1;
      if (packed.size() - at < n || size - out.size() < n) return std::nullopt;
      out += packed.substr(at, n);
      at += n;
      continue;
    }
    std::size_t length = token >> 5;
    if (packed.size() - at < (length == 7 ? 2U : 1U)) return std::nullopt;
    if (length == 7) length += byte();
    length += 2;
    const std::size_t back = ((token & 31U) << 8) + byte() + 1;
    if (back > out.size() || size - out.size() < length) return std::nullopt;
    for (; length > 0; --length) out += out[out.size() - back];  // may overlap itself
  }
  if (out.size() != size) return std::nullopt;
  return out;
}

std::string lzf_compress(std::string_view bytes) {
  std::string out;
  std::vector<std::size_t> last(std::size_t{1} << kHashBits, SIZE_MAX);
  const auto at = [&](std::size_t i) {
    return static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i]));
  };
  const auto slot = [&](std::size_t i) -> std::size_t& {
    const std::uint32_t three = at(i) << 16 | at(i + 1) << 8 | at(i + 2);
    return last[(three * 2654435761U) >> (32 - kHashBits)];
  };
  std::size_t literal = 0, i = 0;  // literals wait from `literal` on
  const auto flush = [&] {
    while (literal < i) {
      const std::size_t n = std::min(kLiterals, i - literal);
      out += static_cast<char>(n - 1);
      out += bytes.substr(literal, n);
      literal += n;
    }
  };
  while (i + 2 < bytes.size()) {
    std::size_t& seen = slot(i);
    const std::size_t from = seen;
    seen = i;
    if (from == SIZE_MAX || i - from > kReach || bytes.substr(from, 3) != bytes.substr(i, 3)) {
      ++i;
      continue;
    }
    const std::size_t longest = std::min(kLongestCopy, bytes.size() - i);
    std::size_t length = 3;
    while (length < longest && bytes[from + length] == bytes[i + length]) ++length;
    flush();
    const std::size_t back = i - from - 1, rest = length - 2;
    out += static_cast<char>((std::min<std::size_t>(rest, 7) << 5) | (back >> 8));
    if (rest >= 7) out += static_cast<char>(rest - 7);
    out += static_cast<char>(back & 0xFFU);
    i += length;
    literal = i;
  }
  i = bytes.size();
  flush();
  return out;
}

}  // namespace maquette::scan::detail
