// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file box_tree.hpp
/// May any of many close rays come to one of many boxes? Asked once for all of them, before they
/// are traced one by one.
///
/// Method  A tree of boxes, eight to a node. For each axis the ends of the rays' origins and
///         directions bound where the first of them enters a box and the last one leaves it; if no
///         time is left between the latest entry and the earliest leave, none meets the box.
/// Holds   "No" is certain, up to the rounding of doubles. "Yes" is not.
/// Cost    16 rays, 500 boxes: 0.1 us (one of the rays in Embree: nearly as much).
/// Sources Boulos, Wald, Shirley, "Geometric and arithmetic culling methods for entire ray
///         packets", University of Utah, UUCS-06-010, 2006

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "camera/detail/ray_lanes.hpp"
#include "core/vec.hpp"

namespace maquette::camera::detail {

class BoxTree {
 public:
  /// Rays, by what holds them all.
  class Bundle {
   public:
    Bundle() = default;
    /// Of all lanes.
    explicit Bundle(const RayLanes& rays);
    /// @param direction  of any length
    /// @param length     times `direction`; infinite allowed
    void add(Vec3 origin, Vec3 direction, double length);
    [[nodiscard]] bool empty() const { return length_ < 0.0; }

   private:
    friend class BoxTree;
    static constexpr double kInf = std::numeric_limits<double>::infinity();
    std::array<double, 3> least_origin_{kInf, kInf, kInf}, most_origin_{-kInf, -kInf, -kInf};
    std::array<double, 3> least_way_{kInf, kInf, kInf}, most_way_{-kInf, -kInf, -kInf};
    double length_ = -1.0;
  };

  /// Of no boxes: nothing is met.
  BoxTree() = default;
  explicit BoxTree(std::span<const Box3> boxes);

  [[nodiscard]] bool may_meet(const Bundle& rays) const;

 private:
  static constexpr std::size_t kBranch = 8;
  using Eight = std::array<double, kBranch>;
  struct Node {
    std::array<Eight, 3> low, high;             ///< by axis; empty boxes where there is none
    std::array<std::int32_t, kBranch> child{};  ///< number of a node; 0: a box itself
    Node();
  };
  std::int32_t build(std::span<const Box3> boxes, std::span<std::uint32_t> order);

  std::vector<Node> nodes_;  ///< the first one holds all
};

}  // namespace maquette::camera::detail
