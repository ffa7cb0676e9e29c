// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/voxel_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include "scan/detail/moments.hpp"

namespace maquette::scan::detail {

Vec3 VoxelStatistics::middle_of(std::uint64_t key) const {
  const auto at = [](std::int64_t i) { return static_cast<double>(i) + 0.5; };
  return grid_.origin_mm + grid_.voxel_mm * Vec3{at(VoxelGrid::x_of(key)), at(VoxelGrid::y_of(key)),
                                                 at(VoxelGrid::z_of(key))};
}

void VoxelStatistics::add(Vec3 p, Vec3 towards, float intensity, Colour colour) {
  const std::uint64_t key = grid_.key_of(p);
  std::uint32_t& number = numbers_.at(key);
  if (number == 0) {
    cells_.emplace_back().key = key;
    number = static_cast<std::uint32_t>(cells_.size());
  }
  Cell& c = cells_[number - 1];
  const Vec3 q = (1.0 / grid_.voxel_mm) * (p - middle_of(key));
  const std::array<float, 3> at{static_cast<float>(q.x), static_cast<float>(q.y),
                                static_cast<float>(q.z)};
  const float share = 1.0F / static_cast<float>(++c.n);
  std::array<float, 3> before{}, after{};
  for (std::size_t k = 0; k < 3; ++k) {
    before[k] = at[k] - c.mean[k];
    c.mean[k] += share * before[k];
    after[k] = at[k] - c.mean[k];
  }
  std::size_t place = 0;
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t l = k; l < 3; ++l) c.scatter[place++] += before[k] * after[l];
  c.towards[0] += static_cast<float>(towards.x);
  c.towards[1] += static_cast<float>(towards.y);
  c.towards[2] += static_cast<float>(towards.z);
  const std::array<float, 4> look{static_cast<float>(colour.red), static_cast<float>(colour.green),
                                  static_cast<float>(colour.blue), intensity};
  for (std::size_t k = 0; k < 4; ++k) c.look[k] += share * (look[k] - c.look[k]);
}

void VoxelStatistics::sort() {
  oneapi::tbb::parallel_sort(cells_.begin(), cells_.end(),
                             [](const Cell& a, const Cell& b) { return a.key < b.key; });
  for (std::size_t i = 0; i < cells_.size(); ++i)
    numbers_.at(cells_[i].key) = static_cast<std::uint32_t>(i + 1);
}

void VoxelCounts::add(Vec3 p) {
  std::uint16_t& count = counts_.at(grid_.key_of(p));
  if (count < kMost) ++count;
}

void VoxelCounts::mark_lonely(std::uint32_t least) {
  // Counts are read while marks are set: marks wait until all blocks are judged.
  std::vector<std::uint64_t> marks(counts_.size());
  oneapi::tbb::parallel_for(std::size_t{0}, counts_.size(), [&](std::size_t b) {
    constexpr std::int64_t kSide = VoxelBlocks<std::uint16_t>::kSide, kWide = kSide + 2;
    // The block with a margin of one voxel, summed along each axis in turn.
    std::array<std::uint32_t, kWide * kWide * kWide> sum{};
    const std::uint64_t corner = counts_.key_of(b, 0);
    const auto& own = counts_.block(b);
    std::size_t i = 0;
    for (std::int64_t x = -1; x <= kSide; ++x)
      for (std::int64_t y = -1; y <= kSide; ++y)
        for (std::int64_t z = -1; z <= kSide; ++z, ++i) {
          const bool inside = x >= 0 && x < kSide && y >= 0 && y < kSide && z >= 0 && z < kSide;
          sum[i] = inside ? own[static_cast<std::size_t>((x * kSide + y) * kSide + z)]
                          : counts_.find(VoxelGrid::key(VoxelGrid::x_of(corner) + x,
                                                        VoxelGrid::y_of(corner) + y,
                                                        VoxelGrid::z_of(corner) + z));
        }
    for (const std::size_t step :
         {std::size_t{1}, std::size_t{kWide}, std::size_t{kWide * kWide}}) {
      const auto before = sum;
      for (std::size_t k = step; k + step < sum.size(); ++k)
        sum[k] = before[k - step] + before[k] + before[k + step];
    }
    i = 0;
    for (std::int64_t x = 1; x <= kSide; ++x)
      for (std::int64_t y = 1; y <= kSide; ++y)
        for (std::int64_t z = 1; z <= kSide; ++z, ++i)
          if (sum[static_cast<std::size_t>((x * kWide + y) * kWide + z)] < least)
            marks[b] |= std::uint64_t{1} << i;
  });
  for (std::size_t b = 0; b < marks.size(); ++b)
    for (std::size_t i = 0; i < counts_.block(b).size(); ++i)
      if ((marks[b] >> i & 1U) != 0) counts_.block(b)[i] |= kMost + 1U;
}

bool VoxelCounts::lonely(Vec3 p) const {
  return counts_.find(grid_.key_of(p)) > kMost;
}

void VoxelSlices::add(Vec3 p) {
  const std::uint64_t key = grid_.key_of(p);
  std::uint8_t& seen = seen_.at(key);
  if (seen != 0) return;
  seen = 1;
  const auto slice = static_cast<std::size_t>(VoxelGrid::x_of(key));
  if (slice >= voxels_.size()) voxels_.resize(slice + 1 + slice / 2);
  ++voxels_[slice];
}

std::vector<std::int64_t> VoxelSlices::ends(std::uint64_t most) const {
  std::vector<std::int64_t> ends;
  std::uint64_t sum = 0;
  for (std::size_t slice = 0; slice < voxels_.size(); ++slice) {
    if (sum > 0 && sum + voxels_[slice] > most) {
      ends.push_back(static_cast<std::int64_t>(slice));
      sum = 0;
    }
    sum += voxels_[slice];
  }
  ends.push_back(VoxelGrid::kSide);
  return ends;
}

Vec3 VoxelStatistics::normal(std::size_t voxel, double* rough_mm) const {
  const std::uint64_t key = cells_[voxel].key;
  Moments all;  // in voxels
  for (std::int64_t dx = -1; dx <= 1; ++dx)
    for (std::int64_t dy = -1; dy <= 1; ++dy)
      for (std::int64_t dz = -1; dz <= 1; ++dz) {
        const std::uint32_t i = index_of(VoxelGrid::key(
            VoxelGrid::x_of(key) + dx, VoxelGrid::y_of(key) + dy, VoxelGrid::z_of(key) + dz));
        if (i == KeyMap::npos) continue;
        const Cell& c = cells_[i];
        const double n = c.n, x = static_cast<double>(c.mean[0]),
                     y = static_cast<double>(c.mean[1]), z = static_cast<double>(c.mean[2]);
        const auto s = [&](std::size_t k) { return static_cast<double>(c.scatter[k]); };
        const Moments m{n,
                        {n * x, n * y, n * z},
                        s(0) + n * x * x,
                        s(1) + n * x * y,
                        s(2) + n * x * z,
                        s(3) + n * y * y,
                        s(4) + n * y * z,
                        s(5) + n * z * z};
        all.add(m, {static_cast<double>(dx), static_cast<double>(dy), static_cast<double>(dz)});
      }
  const auto plane = plane_of(all);
  if (!plane) return {};
  if (rough_mm != nullptr) *rough_mm = grid_.voxel_mm * plane->rough_mm;
  const auto& t = cells_[voxel].towards;
  const Vec3 towards{static_cast<double>(t[0]), static_cast<double>(t[1]),
                     static_cast<double>(t[2])};
  const double facing = dot(plane->normal, towards);
  if (facing == 0.0) return {};  // no scanner is known
  return facing < 0.0 ? -plane->normal : plane->normal;
}

void VoxelNormals::put(const VoxelStatistics& voxels, std::int64_t begin, std::int64_t end) {
  constexpr std::size_t kBatch = 65'536;
  std::vector<std::size_t> chosen;
  std::vector<Vec3> normals;
  for (std::size_t next = 0; next < voxels.size();) {
    chosen.clear();
    for (; next < voxels.size() && chosen.size() < kBatch; ++next)
      if (const std::int64_t x = VoxelGrid::x_of(voxels.key(next)); x >= begin && x < end)
        chosen.push_back(next);
    normals.resize(chosen.size());
    oneapi::tbb::parallel_for(std::size_t{0}, chosen.size(),
                              [&](std::size_t i) { normals[i] = voxels.normal(chosen[i]); });
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      normals_.push_back({static_cast<float>(normals[i].x), static_cast<float>(normals[i].y),
                          static_cast<float>(normals[i].z)});
      numbers_.at(voxels.key(chosen[i])) = static_cast<std::uint32_t>(normals_.size());
    }
  }
}

Vec3 VoxelNormals::at(Vec3 p) const {
  const std::uint32_t number = numbers_.find(grid_.key_of(p));
  if (number == 0) return {};
  const auto& n = normals_[number - 1];
  return {static_cast<double>(n[0]), static_cast<double>(n[1]), static_cast<double>(n[2])};
}

VoxelSummary VoxelStatistics::summary(std::size_t voxel) const {
  const Cell& c = cells_[voxel];
  VoxelSummary s;
  s.points = c.n;
  s.mean_mm = middle_of(c.key) + grid_.voxel_mm * Vec3{static_cast<double>(c.mean[0]),
                                                       static_cast<double>(c.mean[1]),
                                                       static_cast<double>(c.mean[2])};
  s.normal = normal(voxel, &s.rough_mm);
  const double squares = static_cast<double>(c.scatter[0]) + static_cast<double>(c.scatter[3]) +
                         static_cast<double>(c.scatter[5]);
  s.spread_mm = grid_.voxel_mm * std::sqrt(std::fmax(0.0, squares) / c.n);
  s.intensity = static_cast<double>(c.look[3]);
  const auto whole = [](float v) {
    return static_cast<std::uint16_t>(std::lround(std::clamp(v, 0.0F, 65'535.0F)));
  };
  s.colour = {whole(c.look[0]), whole(c.look[1]), whole(c.look[2])};
  return s;
}

}  // namespace maquette::scan::detail
