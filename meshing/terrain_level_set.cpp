// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/terrain_level_set.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using openvdb::FloatGrid;
using Leaf = FloatGrid::TreeType::LeafNodeType;

constexpr int kLeaf = 8;

/// Of one leaf's columns; x counts slowest, as in OpenVDB's leaves.
struct Columns {
  std::array<float, kLeaf * kLeaf> height{};      ///< above the lattice's origin
  std::array<float, kLeaf * kLeaf> flattening{};  ///< 1 / sqrt(1 + slope^2)
  float low = 0.0F, high = 0.0F;                  ///< where the band can be
};

class ColumnMaker {
 public:
  ColumnMaker(const ModelField& field, const LatticeBox& box, double voxel)
      : field_(field), origin_(box.origin_mm), voxel_(voxel) {}

  [[nodiscard]] Columns at(int i0, int j0) const {
    constexpr int kWith = kLeaf + 2;  // neighbours on both sides
    std::array<double, kWith * kWith> h{};
    for (int i = 0; i < kWith; ++i)
      for (int j = 0; j < kWith; ++j)
        h[static_cast<std::size_t>(kWith * i + j)] =
            clamped_height(field_, origin_.x + voxel_ * (i0 + i - 1),
                           origin_.y + voxel_ * (j0 + j - 1)) -
            origin_.z;
    Columns c;
    double low = INFINITY, high = -INFINITY;
    for (int i = 0; i < kLeaf; ++i)
      for (int j = 0; j < kLeaf; ++j) {
        const auto here = static_cast<std::size_t>(kWith * (i + 1) + j + 1);
        const double dx = h[here + kWith] - h[here - kWith], dy = h[here + 1] - h[here - 1];
        const double steep = std::sqrt(1.0 + (dx * dx + dy * dy) / (4.0 * voxel_ * voxel_));
        const auto n = static_cast<std::size_t>(kLeaf * i + j);
        c.height[n] = static_cast<float>(h[here]);
        c.flattening[n] = static_cast<float>(1.0 / steep);
        const double reach = static_cast<double>(kBandVoxels) * voxel_ * steep;
        low = std::fmin(low, h[here] - reach);
        high = std::fmax(high, h[here] + reach);
      }
    c.low = static_cast<float>(low);
    c.high = static_cast<float>(high);
    return c;
  }

 private:
  const ModelField& field_;
  Vec3 origin_;
  double voxel_;
};

/// @return nothing if no value lies within the band
Leaf* make_leaf(const Columns& c, const openvdb::Coord& at, float voxel, float outside) {
  auto* leaf = new Leaf(at, outside, false);
  float* const value = leaf->buffer().data();
  Leaf::NodeMaskType active(false);
  const float base = voxel * static_cast<float>(at.z());
  bool any = false;
  for (std::size_t n = 0; n < c.height.size(); ++n) {
    std::array<float, kLeaf> distance{};
    openvdb::Index64 bits = 0;
    for (std::size_t k = 0; k < kLeaf; ++k) {
      const float d = (base - c.height[n] + voxel * static_cast<float>(k)) * c.flattening[n];
      bits |= static_cast<openvdb::Index64>(std::abs(d) < outside) << k;
      distance[k] = std::clamp(d, -outside, outside);
    }
    std::copy(distance.begin(), distance.end(), value + kLeaf * n);
    // Eight columns of eight share a word of the mask.
    active.getWord<openvdb::Index64>(static_cast<openvdb::Index>(n / kLeaf)) |=
        bits << (kLeaf * (n % kLeaf));
    any = any || bits != 0;
  }
  if (!any) {
    delete leaf;
    return nullptr;
  }
  leaf->setValueMask(active);
  return leaf;
}

}  // namespace

double clamped_height(const ModelField& field, double x_mm, double y_mm) {
  const double x_last = field.x_mm(field.z_mm.cols() - 1);
  const double y_last = field.y_mm(field.z_mm.rows() - 1);
  return heightmap::height_at(field, std::clamp(x_mm, field.x_mm(0), x_last),
                              std::clamp(y_mm, field.y_mm(0), y_last));
}

FloatGrid::Ptr terrain_level_set(const ModelField& field, const LatticeBox& box, double voxel_mm) {
  const auto voxel = static_cast<float>(voxel_mm);
  const float outside = kBandVoxels * voxel;
  FloatGrid::Ptr grid = FloatGrid::create(outside);
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(voxel_mm));
  const ColumnMaker columns(field, box, voxel_mm);
  for (int i0 = 0; i0 < box.nodes.x(); i0 += kLeaf)
    for (int j0 = 0; j0 < box.nodes.y(); j0 += kLeaf) {
      const Columns c = columns.at(i0, j0);
      for (int k0 = 0; k0 < box.nodes.z(); k0 += kLeaf) {
        if (voxel * static_cast<float>(k0) > c.high) break;  // nothing but air from here on
        const bool reached = voxel * static_cast<float>(k0 + kLeaf - 1) >= c.low;
        Leaf* const leaf = reached ? make_leaf(c, {i0, j0, k0}, voxel, outside) : nullptr;
        if (leaf != nullptr)
          grid->tree().addLeaf(leaf);
        else if (voxel * static_cast<float>(k0) < c.height[0])
          grid->tree().addTile(1, {i0, j0, k0}, -outside, false);
      }
    }
  return grid;
}

}  // namespace maquette::meshing::detail
