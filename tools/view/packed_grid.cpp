// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/packed_grid.hpp"

#include <cmath>
#include <cstdint>

#include <zlib.h>

namespace maquette::tools {

PackedGrid packed(const ThinnedField& field, double least_step) {
  double low = INFINITY, high = -INFINITY;
  for (const float v : field.values)
    if (std::isfinite(v)) {
      low = std::min(low, static_cast<double>(v));
      high = std::max(high, static_cast<double>(v));
    }
  PackedGrid grid;
  if (low > high) low = high = 0.0;
  grid.low = low;
  grid.step = std::max((high - low) / 65534.0, least_step);
  const auto cols = static_cast<std::size_t>(field.cols);
  std::vector<std::uint16_t> numbers;
  numbers.reserve(field.values.size());
  for (const float v : field.values)
    numbers.push_back(std::isfinite(v)
                          ? static_cast<std::uint16_t>(
                                1 + std::lround((static_cast<double>(v) - grid.low) / grid.step))
                          : 0);
  std::string bytes(2 * numbers.size(), '\0');
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const bool left = i % cols > 0, below = i >= cols;
    const int expected = (left ? numbers[i - 1] : 0) + (below ? numbers[i - cols] : 0) -
                         (left && below ? numbers[i - cols - 1] : 0);
    const auto rest = static_cast<std::uint16_t>(numbers[i] - expected);
    bytes[i] = static_cast<char>(rest >> 8);
    bytes[numbers.size() + i] = static_cast<char>(rest & 0xff);
  }
  grid.bytes = deflated(bytes);
  return grid;
}

std::vector<float> unpacked(const PackedGrid& grid, std::size_t rows, std::size_t cols) {
  const std::size_t n = rows * cols;
  uLongf size = 2 * n;
  std::string bytes(size, '\0');
  uncompress(reinterpret_cast<Bytef*>(bytes.data()), &size,
             reinterpret_cast<const Bytef*>(grid.bytes.data()), grid.bytes.size());
  std::vector<std::uint16_t> numbers(n);
  std::vector<float> values(n);
  for (std::size_t i = 0; i < n; ++i) {
    const bool left = i % cols > 0, below = i >= cols;
    const int expected = (left ? numbers[i - 1] : 0) + (below ? numbers[i - cols] : 0) -
                         (left && below ? numbers[i - cols - 1] : 0);
    const int rest =
        static_cast<unsigned char>(bytes[i]) * 256 + static_cast<unsigned char>(bytes[n + i]);
    numbers[i] = static_cast<std::uint16_t>(expected + rest);
    values[i] = numbers[i] == 0 ? NAN : static_cast<float>(grid.low + (numbers[i] - 1) * grid.step);
  }
  return values;
}

std::string deflated(std::string_view bytes) {
  uLongf size = compressBound(bytes.size());
  std::string out(size, '\0');
  compress2(reinterpret_cast<Bytef*>(out.data()), &size,
            reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(), 6);
  out.resize(size);
  return out;
}

}  // namespace maquette::tools
