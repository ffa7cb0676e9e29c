// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scalars.hpp
/// Numbers as binary files hold them.

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

namespace maquette::scan::detail {

static_assert(std::endian::native == std::endian::little, "files are written as memory holds them");

enum class Scalar { int8, uint8, int16, uint16, int32, uint32, int64, uint64, float32, float64 };

[[nodiscard]] constexpr std::size_t bytes_of(Scalar type) {
  switch (type) {
    case Scalar::int8:
    case Scalar::uint8:
      return 1;
    case Scalar::int16:
    case Scalar::uint16:
      return 2;
    case Scalar::int32:
    case Scalar::uint32:
    case Scalar::float32:
      return 4;
    default:
      return 8;
  }
}

/// @param swap  the bytes are in big-endian order
template <class T>
[[nodiscard]] T load(const char* bytes, bool swap = false) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes, sizeof(T));
  if (swap) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<T>(raw);
}

[[nodiscard]] inline double load_scalar(Scalar type, const char* bytes, bool swap = false) {
  switch (type) {
    case Scalar::int8:
      return load<std::int8_t>(bytes);
    case Scalar::uint8:
      return load<std::uint8_t>(bytes);
    case Scalar::int16:
      return load<std::int16_t>(bytes, swap);
    case Scalar::uint16:
      return load<std::uint16_t>(bytes, swap);
    case Scalar::int32:
      return load<std::int32_t>(bytes, swap);
    case Scalar::uint32:
      return load<std::uint32_t>(bytes, swap);
    case Scalar::int64:
      return static_cast<double>(load<std::int64_t>(bytes, swap));
    case Scalar::uint64:
      return static_cast<double>(load<std::uint64_t>(bytes, swap));
    case Scalar::float32:
      return static_cast<double>(load<float>(bytes, swap));
    default:
      return load<double>(bytes, swap);
  }
}

/// Appends a value as memory holds it.
template <class T>
void store(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace maquette::scan::detail
