// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file surfels.hpp
/// A cloud in pieces: what the points of each voxel and its neighbours say about the surface.

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "core/vec.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan::detail {

/// Integer places in a grid of voxels as one number: 21 bits an axis, x first in order.
struct VoxelGrid {
  Vec3 origin_mm;
  double voxel_mm = 1.0;
  static constexpr std::int64_t kSide = std::int64_t{1} << 21;
  [[nodiscard]] static constexpr std::uint64_t key(std::int64_t x, std::int64_t y, std::int64_t z) {
    return static_cast<std::uint64_t>((x * kSide + y) * kSide + z);
  }
  [[nodiscard]] static constexpr std::int64_t x_of(std::uint64_t k) {
    return static_cast<std::int64_t>(k >> 42U);
  }
  [[nodiscard]] static constexpr std::int64_t y_of(std::uint64_t k) {
    return static_cast<std::int64_t>(k >> 21U) & (kSide - 1);
  }
  [[nodiscard]] static constexpr std::int64_t z_of(std::uint64_t k) {
    return static_cast<std::int64_t>(k) & (kSide - 1);
  }
  [[nodiscard]] std::uint64_t key_of(Vec3 p) const {
    const Vec3 q = (1.0 / voxel_mm) * (p - origin_mm);
    return key(static_cast<std::int64_t>(q.x), static_cast<std::int64_t>(q.y),
               static_cast<std::int64_t>(q.z));
  }
};

/// A grid over the box with a margin of four voxels on all sides.
/// @return false if that needs more than 2^21 voxels on an axis
[[nodiscard]] bool make_voxel_grid(const Box3& box, double voxel_mm, VoxelGrid& grid);

/// Open addressing, keys to indices; grows.
class KeyMap {
 public:
  explicit KeyMap(std::size_t expected);
  /// Index of a key, or npos.
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const;
  /// Index of a key; `next` is stored if it is new.
  std::uint32_t insert(std::uint64_t key, std::uint32_t next);
  static constexpr std::uint32_t npos = 0xffffffffU;

 private:
  void grow();
  struct Slot {
    std::uint64_t key = ~std::uint64_t{0};
    std::uint32_t index = npos;
  };
  std::vector<Slot> slots_;
  std::size_t used_ = 0;
};

/// Where each point was seen from: its station, or far above the cloud where none is known.
struct Views {
  std::vector<Vec3> places_mm;      ///< per station, in the points' frame
  std::vector<std::uint64_t> ends;  ///< per station, the index behind its last point
  [[nodiscard]] Vec3 of(std::size_t point) const {
    return places_mm[static_cast<std::size_t>(std::upper_bound(ends.begin(), ends.end(), point) -
                                              ends.begin())];
  }
};
[[nodiscard]] Views views_of(const Cloud& cloud);

struct Surfel {
  std::uint64_t key = 0;     ///< of its voxel
  Vec3 centre_mm;            ///< mean of the voxel's points
  Vec3 normal;               ///< unit, towards the scanner; zero if it is not determined
  double rough_mm = 0.0;     ///< standard deviation of the neighbourhood's points along it
  std::uint32_t points = 0;  ///< of the voxel
  float red = 0.0F, green = 0.0F, blue = 0.0F, intensity = 0.0F;  ///< means
};

/// One surfel a voxel that holds points, in the order of keys. The normal is that of least scatter
/// of the points of the 27 voxels around it (at least six of them, and not on a line), turned
/// to the side from which most of the voxel's points were seen (views_of).
[[nodiscard]] std::vector<Surfel> make_surfels(const Cloud& cloud, const VoxelGrid& grid);

/// Edge of the voxels that hold about `points` points each where there are any.
[[nodiscard]] double voxel_for(std::span<const Vec3> points_mm, double points);

/// An even share of points that are met one by one, to choose voxels by: every k-th, two million at
/// most.
class PointSample {
 public:
  void add(Vec3 p_mm);
  [[nodiscard]] std::uint64_t count() const { return count_; }  ///< of all that were met
  /// As above, of all points.
  [[nodiscard]] double voxel_for(double points) const;

 private:
  static constexpr std::size_t kMost = 2'000'000;
  std::vector<Vec3> points_;
  std::uint64_t count_ = 0, step_ = 1;
};

}  // namespace maquette::scan::detail
