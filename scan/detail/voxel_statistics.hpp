// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file voxel_statistics.hpp
/// What the points of each voxel have in common, gathered point by point: memory goes with the
/// voxels that hold points (some 90 bytes each, 10 where they are only counted), not with the
/// points.

#include <array>
#include <cstdint>
#include <deque>

#include "scan/cloud.hpp"
#include "scan/detail/surfels.hpp"

namespace maquette::scan::detail {

struct VoxelSummary {
  Vec3 mean_mm;
  Vec3 normal;  ///< of the 27 voxels' points, towards the scanner; zero where unknown
  std::uint32_t points = 0;
  double spread_mm = 0.0;  ///< rms distance of the points from their mean
  double rough_mm = 0.0;   ///< standard deviation of the 27 voxels' points along the normal
  double intensity = 0.0;
  Colour colour;  ///< means, rounded
};

/// A value for each voxel, kept for 4 x 4 x 4 of them at a time: a noisy surface fills a third of
/// such a block, so that a key and its place among the keys are paid once for many voxels.
template <class T>
class VoxelBlocks {
 public:
  static constexpr std::int64_t kSide = 4;
  using Block = std::array<T, kSide * kSide * kSide>;

  /// Made with its block, zero, where there is none.
  [[nodiscard]] T& at(std::uint64_t key) {
    const std::uint64_t wanted = block_key(key);
    if (wanted != last_key_) {
      const auto next = static_cast<std::uint32_t>(keys_.size());
      last_ = map_.insert(wanted, next);
      last_key_ = wanted;
      if (last_ == next) {
        keys_.push_back(wanted);
        blocks_.push_back(Block{});
      }
    }
    return blocks_[last_][place(key)];
  }
  /// Zero where there is none. Thread-safe.
  [[nodiscard]] T find(std::uint64_t key) const {
    const std::uint32_t b = map_.find(block_key(key));
    return b == KeyMap::npos ? T{} : blocks_[b][place(key)];
  }
  [[nodiscard]] std::size_t size() const { return keys_.size(); }  ///< blocks
  [[nodiscard]] Block& block(std::size_t b) { return blocks_[b]; }
  [[nodiscard]] const Block& block(std::size_t b) const { return blocks_[b]; }
  /// Of the voxel in a block's place.
  [[nodiscard]] std::uint64_t key_of(std::size_t b, std::size_t place) const {
    const std::uint64_t k = keys_[b];
    const auto p = static_cast<std::int64_t>(place);
    return VoxelGrid::key(kSide * VoxelGrid::x_of(k) + p / (kSide * kSide),
                          kSide * VoxelGrid::y_of(k) + p / kSide % kSide,
                          kSide * VoxelGrid::z_of(k) + p % kSide);
  }

 private:
  static std::uint64_t block_key(std::uint64_t k) {
    return VoxelGrid::key(VoxelGrid::x_of(k) / kSide, VoxelGrid::y_of(k) / kSide,
                          VoxelGrid::z_of(k) / kSide);
  }
  static std::size_t place(std::uint64_t k) {
    return static_cast<std::size_t>(
        (VoxelGrid::x_of(k) % kSide * kSide + VoxelGrid::y_of(k) % kSide) * kSide +
        VoxelGrid::z_of(k) % kSide);
  }
  KeyMap map_{1024};
  std::deque<std::uint64_t> keys_;  // grow without a second copy
  std::deque<Block> blocks_;
  std::uint64_t last_key_ = ~std::uint64_t{0};  // points come in rows
  std::uint32_t last_ = 0;
};

/// How many points each voxel has, and no more.
class VoxelCounts {
 public:
  static constexpr std::uint32_t kMost = 0x7fff;  ///< counting stops there
  explicit VoxelCounts(const VoxelGrid& grid) : grid_(grid) {}
  void add(Vec3 p_mm);
  /// Once all points are there.
  /// @pre least <= kMost
  void mark_lonely(std::uint32_t least);
  /// Are there fewer than `least` points in the voxel and the 26 around it?
  [[nodiscard]] bool lonely(Vec3 p_mm) const;

 private:
  VoxelGrid grid_;
  VoxelBlocks<std::uint16_t> counts_;  // the highest bit: lonely
};

/// How many voxels hold points in each slice of a grid across x.
class VoxelSlices {
 public:
  explicit VoxelSlices(const VoxelGrid& grid) : grid_(grid) {}
  void add(Vec3 p_mm);
  /// The ends of runs of slices that hold at most `most` voxels each (or are one slice), the last
  /// beyond all.
  [[nodiscard]] std::vector<std::int64_t> ends(std::uint64_t most) const;

 private:
  VoxelGrid grid_;
  VoxelBlocks<std::uint8_t> seen_;
  std::vector<std::uint64_t> voxels_;  // by slice
};

class VoxelStatistics {
 public:
  explicit VoxelStatistics(const VoxelGrid& grid) : grid_(grid) {}
  /// @param towards  unit, to the scanner, or zero where it is not known
  void add(Vec3 p_mm, Vec3 towards, float intensity = 0.0F, Colour colour = {});
  [[nodiscard]] std::size_t size() const { return cells_.size(); }  ///< in the order met
  [[nodiscard]] const VoxelGrid& grid() const { return grid_; }
  /// Into the order of keys: neighbours, which normals ask, then lie near each other in memory.
  void sort();
  /// KeyMap::npos if there is none.
  [[nodiscard]] std::uint32_t find(Vec3 p_mm) const { return index_of(grid_.key_of(p_mm)); }
  /// Its place in the grid, as VoxelGrid::key().
  [[nodiscard]] std::uint64_t key(std::size_t voxel) const { return cells_[voxel].key; }
  [[nodiscard]] Vec3 normal(std::size_t voxel, double* rough_mm = nullptr) const;
  [[nodiscard]] VoxelSummary summary(std::size_t voxel) const;

 private:
  /// Running means (Welford 1962, doi:10.1080/00401706.1962.10490022), in voxels about the voxel's
  /// middle: single precision is 1e-7 of a voxel.
  struct Cell {
    std::uint64_t key = 0;
    std::uint32_t n = 0;
    std::array<float, 3> mean{};
    std::array<float, 6> scatter{};  ///< xx xy xz yy yz zz about the mean
    std::array<float, 3> towards{};
    std::array<float, 4> look{};  ///< red, green, blue, intensity
  };
  [[nodiscard]] Vec3 middle_of(std::uint64_t key) const;
  [[nodiscard]] std::uint32_t index_of(std::uint64_t key) const {
    return numbers_.find(key) - 1U;  // none: 0 - 1 is npos
  }

  VoxelGrid grid_;
  VoxelBlocks<std::uint32_t> numbers_;  // from 1
  std::deque<Cell> cells_;              // grows without a second copy
};
static_assert(KeyMap::npos == 0U - 1U);

/// A normal for each voxel, when its statistics are no longer needed: some 25 bytes.
class VoxelNormals {
 public:
  explicit VoxelNormals(const VoxelGrid& grid) : grid_(grid) {}
  /// Those of the voxels with begin <= x < end.
  void put(const VoxelStatistics& voxels, std::int64_t begin, std::int64_t end);
  /// Zero where there is none. Thread-safe.
  [[nodiscard]] Vec3 at(Vec3 p_mm) const;

 private:
  VoxelGrid grid_;
  VoxelBlocks<std::uint32_t> numbers_;  // from 1
  std::deque<std::array<float, 3>> normals_;
};

}  // namespace maquette::scan::detail
