// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/surfels.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include "core/random.hpp"
#include "scan/detail/moments.hpp"

namespace maquette::scan::detail {
namespace {

Vec3 middle_of(const VoxelGrid& g, std::uint64_t key) {
  const auto at = [](std::int64_t i) { return static_cast<double>(i) + 0.5; };
  return g.origin_mm + g.voxel_mm * Vec3{at(VoxelGrid::x_of(key)), at(VoxelGrid::y_of(key)),
                                         at(VoxelGrid::z_of(key))};
}

}  // namespace

bool make_voxel_grid(const Box3& box, double voxel_mm, VoxelGrid& grid) {
  // No whole number: a level plane at the box's bottom shall not lie in the nodes.
  const double margin = 4.381966 * voxel_mm;
  const Vec3 size = box.max - box.min;
  grid.origin_mm = box.min - Vec3{margin, margin, margin};
  grid.voxel_mm = voxel_mm;
  return std::max({size.x, size.y, size.z}) / voxel_mm + 9.0 <
         static_cast<double>(VoxelGrid::kSide);
}

KeyMap::KeyMap(std::size_t expected) {
  std::size_t size = 64;
  while (size < 2 * expected) size *= 2;
  slots_.resize(size);
}

std::uint32_t KeyMap::find(std::uint64_t key) const {
  const std::size_t mask = slots_.size() - 1;
  for (std::size_t i = mix64(key) & mask;; i = (i + 1) & mask) {
    if (slots_[i].key == key) return slots_[i].index;
    if (slots_[i].index == npos) return npos;
  }
}

std::uint32_t KeyMap::insert(std::uint64_t key, std::uint32_t next) {
  if (2 * used_ >= slots_.size()) grow();
  const std::size_t mask = slots_.size() - 1;
  for (std::size_t i = mix64(key) & mask;; i = (i + 1) & mask) {
    if (slots_[i].key == key) return slots_[i].index;
    if (slots_[i].index != npos) continue;
    slots_[i] = {key, next};
    ++used_;
    return next;
  }
}

void KeyMap::grow() {
  std::vector<Slot> old(2 * slots_.size());
  old.swap(slots_);
  const std::size_t mask = slots_.size() - 1;
  for (const Slot& s : old) {
    if (s.index == npos) continue;
    std::size_t i = mix64(s.key) & mask;
    while (slots_[i].index != npos) i = (i + 1) & mask;
    slots_[i] = s;
  }
}

Views views_of(const Cloud& cloud) {
  Views v;
  Box3 box;
  for (const Vec3& p : cloud.points_mm) box.add(p);
  const Vec3 above =
      0.5 * (box.min + box.max) + Vec3{0.0, 0.0, 1e3 * (1.0 + norm(box.max - box.min))};
  std::uint64_t end = 0;
  for (const ScanStation& s : cloud.stations) {
    if (s.points == 0) continue;
    end += s.points;
    v.places_mm.push_back(s.position_mm.value_or(above));
    v.ends.push_back(end);
  }
  if (v.places_mm.empty()) {
    v.places_mm.push_back(cloud.station_mm.value_or(above));
    v.ends.push_back(cloud.points_mm.size());
  }
  return v;
}

std::vector<Surfel> make_surfels(const Cloud& cloud, const VoxelGrid& grid) {
  const Views views = views_of(cloud);
  const std::size_t n = cloud.points_mm.size();
  struct Entry {
    std::uint64_t key;
    std::uint32_t point;
    bool operator<(const Entry& b) const { return key != b.key ? key < b.key : point < b.point; }
  };
  std::vector<Entry> entries(n);
  oneapi::tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
    entries[i] = {grid.key_of(cloud.points_mm[i]), static_cast<std::uint32_t>(i)};
  });
  oneapi::tbb::parallel_sort(entries.begin(), entries.end());
  std::vector<std::size_t> begins;
  for (std::size_t i = 0; i < n; ++i)
    if (i == 0 || entries[i].key != entries[i - 1].key) begins.push_back(i);
  begins.push_back(n);
  const std::size_t count = begins.size() - 1;

  std::vector<Surfel> surfels(count);
  std::vector<Moments> moments(count);
  std::vector<Vec3> towards(count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    Surfel& s = surfels[k];
    Moments& m = moments[k];
    s.key = entries[begins[k]].key;
    const Vec3 middle = middle_of(grid, s.key);
    for (std::size_t i = begins[k]; i < begins[k + 1]; ++i) {
      const std::size_t p = entries[i].point;
      const Vec3 d = cloud.points_mm[p] - middle;
      m.n += 1.0;
      m.sum += d;
      m.xx += d.x * d.x;
      m.xy += d.x * d.y;
      m.xz += d.x * d.z;
      m.yy += d.y * d.y;
      m.yz += d.y * d.z;
      m.zz += d.z * d.z;
      if (!cloud.colours.empty()) {
        s.red += cloud.colours[p].red;
        s.green += cloud.colours[p].green;
        s.blue += cloud.colours[p].blue;
      }
      if (!cloud.intensity.empty()) s.intensity += cloud.intensity[p];
      const Vec3 way = views.of(p) - cloud.points_mm[p];
      towards[k] += (1.0 / std::fmax(norm(way), 1e-9)) * way;
    }
    s.points = static_cast<std::uint32_t>(m.n);
    s.centre_mm = middle + (1.0 / m.n) * m.sum;
    const auto share = static_cast<float>(1.0 / m.n);
    s.red *= share;
    s.green *= share;
    s.blue *= share;
    s.intensity *= share;
  });

  KeyMap map(count);
  for (std::size_t k = 0; k < count; ++k) map.insert(surfels[k].key, static_cast<std::uint32_t>(k));
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    Surfel& s = surfels[k];
    const std::int64_t x = VoxelGrid::x_of(s.key), y = VoxelGrid::y_of(s.key),
                       z = VoxelGrid::z_of(s.key);
    Moments all;
    for (std::int64_t dx = -1; dx <= 1; ++dx)
      for (std::int64_t dy = -1; dy <= 1; ++dy)
        for (std::int64_t dz = -1; dz <= 1; ++dz) {
          const std::uint32_t i = map.find(VoxelGrid::key(x + dx, y + dy, z + dz));
          if (i == KeyMap::npos) continue;
          all.add(moments[i], grid.voxel_mm * Vec3{static_cast<double>(dx), static_cast<double>(dy),
                                                   static_cast<double>(dz)});
        }
    const auto plane = plane_of(all);
    if (!plane) return;
    s.normal = dot(plane->normal, towards[k]) < 0.0 ? -plane->normal : plane->normal;
    s.rough_mm = plane->rough_mm;
  });
  return surfels;
}

double voxel_for(std::span<const Vec3> points, double per_voxel) {
  Box3 box;
  for (const Vec3& p : points) box.add(p);
  const Vec3 size = box.max - box.min;
  // Occupied voxels of a few hundred to the side: their number measures the area.
  double voxel = std::fmax(norm(size) / 300.0, 1e-9);
  for (int round = 0; round < 4; ++round) {
    VoxelGrid grid;
    if (!make_voxel_grid(box, voxel, grid)) break;
    KeyMap map(1024);
    std::uint32_t occupied = 0;
    for (const Vec3& p : points)
      if (map.insert(grid.key_of(p), occupied) == occupied) ++occupied;
    const double mean = static_cast<double>(points.size()) / occupied;
    if (mean > 0.7 * per_voxel && mean < 1.4 * per_voxel) break;
    voxel *= std::clamp(std::sqrt(per_voxel / mean), 0.1, 10.0);
  }
  return voxel;
}

void PointSample::add(Vec3 p) {
  if (count_++ % step_ != 0) return;
  points_.push_back(p);
  if (points_.size() < kMost) return;
  std::size_t to = 0;
  for (std::size_t i = 0; i < points_.size(); i += 2) points_[to++] = points_[i];
  points_.resize(to);
  step_ *= 2;
}

double PointSample::voxel_for(double points) const {
  // In a sample of one point in k, n points of all are n / k: the area does not change.
  const double k = static_cast<double>(count_) / static_cast<double>(points_.size());
  return detail::voxel_for(points_, points) / std::sqrt(k);
}

}  // namespace maquette::scan::detail
