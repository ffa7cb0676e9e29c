// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file chunked.hpp
/// A list that grows without moving what it has, and can be taken apart from the front.

#include <cstdint>
#include <memory>
#include <vector>

namespace maquette::meshing::detail {

template <class T>
class Chunked {
 public:
  static constexpr std::size_t kShift = 14, kChunk = std::size_t{1} << kShift;
  [[nodiscard]] std::uint32_t size() const { return size_; }
  T& operator[](std::uint32_t i) { return chunks_[i >> kShift][i & (kChunk - 1)]; }
  const T& operator[](std::uint32_t i) const { return chunks_[i >> kShift][i & (kChunk - 1)]; }
  std::uint32_t push(const T& value) {
    if ((size_ >> kShift) == chunks_.size()) chunks_.emplace_back(new T[kChunk]);
    (*this)[size_] = value;
    return size_++;
  }
  /// Frees all whole chunks before i; they must not be asked for again.
  void free_before(std::uint32_t i) {
    if ((i & (kChunk - 1)) == 0 && i > 0) chunks_[(i >> kShift) - 1].reset();
  }

 private:
  std::vector<std::unique_ptr<T[]>> chunks_;
  std::uint32_t size_ = 0;
};

}  // namespace maquette::meshing::detail
