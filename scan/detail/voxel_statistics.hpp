// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file voxel_statistics.hpp
/// What the points of each voxel have in common, gathered point by point: memory goes with the
/// voxels that hold points (some 100 bytes each), not with the points.

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

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

/// How many points each voxel has, and no more: some 45 bytes each.
class VoxelCounts {
 public:
  explicit VoxelCounts(const VoxelGrid& grid) : grid_(grid), map_(1024) {}
  void add(Vec3 p_mm);
  [[nodiscard]] std::size_t size() const { return keys_.size(); }  ///< in the order they were met
  /// KeyMap::npos if there is none.
  [[nodiscard]] std::uint32_t find(Vec3 p_mm) const { return map_.find(grid_.key_of(p_mm)); }
  /// Points of a voxel and the 26 around it; counting stops at `enough`.
  [[nodiscard]] std::uint64_t around(std::size_t voxel, std::uint64_t enough) const;

 private:
  VoxelGrid grid_;
  KeyMap map_;
  std::deque<std::uint64_t> keys_;  // grows without a second copy
  std::deque<std::uint32_t> points_;
};

class VoxelStatistics {
 public:
  explicit VoxelStatistics(const VoxelGrid& grid) : grid_(grid), map_(1024) {}
  /// @param towards  unit, to the scanner, or zero where it is not known
  void add(Vec3 p_mm, Vec3 towards, float intensity = 0.0F, Colour colour = {});
  [[nodiscard]] std::size_t size() const { return keys_.size(); }  ///< in the order they were met
  [[nodiscard]] const VoxelGrid& grid() const { return grid_; }
  /// KeyMap::npos if there is none.
  [[nodiscard]] std::uint32_t find(Vec3 p_mm) const { return map_.find(grid_.key_of(p_mm)); }
  [[nodiscard]] Vec3 normal(std::size_t voxel, double* rough_mm = nullptr) const;
  [[nodiscard]] VoxelSummary summary(std::size_t voxel) const;

 private:
  /// Running means (Welford 1962, doi:10.1080/00401706.1962.10490022), in voxels about the voxel's
  /// middle: single precision is 1e-7 of a voxel.
  struct Cell {
    std::uint32_t n = 0;
    std::array<float, 3> mean{};
    std::array<float, 6> scatter{};  ///< xx xy xz yy yz zz about the mean
    std::array<float, 3> towards{};
    std::array<float, 4> look{};  ///< red, green, blue, intensity
  };
  [[nodiscard]] Vec3 middle_of(std::uint64_t key) const;

  VoxelGrid grid_;
  KeyMap map_;
  std::vector<std::uint64_t> keys_;
  std::deque<Cell> cells_;  // grows without a second copy
};

}  // namespace maquette::scan::detail
