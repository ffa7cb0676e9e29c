// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/mesh_distance.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <tuple>

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include "core/check.hpp"

namespace maquette::scan {
namespace {

constexpr std::size_t kLeaf = 4;

/// Bits of a 21 bit number, two zeros after each.
std::uint64_t spread_bits(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffffULL;
  x = (x | x << 16) & 0x1f0000ff0000ffULL;
  x = (x | x << 8) & 0x100f00f00f00f00fULL;
  x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
  return (x | x << 2) & 0x1249249249249249ULL;
}

/// The nearest feature: a face, corner 0 to 2, or the edge from corner k to the next.
struct Foot {
  Vec3 at;
  int corner = -1, edge = -1;
};

Foot foot_on(Vec3 p, Vec3 a, Vec3 b, Vec3 c) {
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, 0, -1};
  const Vec3 bp = p - b;
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0.0 && d4 <= d3) return {b, 1, -1};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {a + (d1 / (d1 - d3)) * ab, -1, 0};
  const Vec3 cp = p - c;
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0.0 && d5 <= d6) return {c, 2, -1};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {a + (d2 / (d2 - d6)) * ac, -1, 2};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0)
    return {b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b), -1, 1};
  const double whole = 1.0 / (va + vb + vc);
  return {a + (vb * whole) * ab + (vc * whole) * ac, -1, -1};
}

double angle_at(Vec3 at, Vec3 u, Vec3 v) {
  const Vec3 a = u - at, b = v - at;
  return std::atan2(norm(cross(a, b)), dot(a, b));
}

}  // namespace

Vec3 MeshDistance::normal_of(std::uint32_t t) const {
  const auto& c = mesh_->triangles[t];
  const auto& v = mesh_->vertices_mm;
  const Vec3 n = cross(v[c[1]] - v[c[0]], v[c[2]] - v[c[0]]);
  const double length = norm(n);
  return length > 0.0 ? (1.0 / length) * n : Vec3{};
}

double MeshDistance::gap2(const Box& box, Vec3 p) const {
  const double q[3] = {p.x, p.y, p.z};
  double sum = 0.0;
  for (int k = 0; k < 3; ++k) {
    const double gap = std::max(
        {static_cast<double>(box.min[k]) - q[k], q[k] - static_cast<double>(box.max[k]), 0.0});
    sum += gap * gap;
  }
  return sum;
}

MeshDistance::MeshDistance(const TriMesh& mesh) : mesh_(&mesh) {
  const auto& v = mesh.vertices_mm;
  const std::size_t n = mesh.triangles.size();
  MAQUETTE_CHECK(n < std::numeric_limits<std::uint32_t>::max(), "{} triangles", n);
  const Box3 bounds = mesh.bounds();
  const Vec3 size = bounds.max - bounds.min;
  const double cell = std::fmax(1e-12, std::max({size.x, size.y, size.z})) / 2097151.0;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(n);
  oneapi::tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
    const auto& t = mesh.triangles[i];
    const Vec3 c = (1.0 / 3.0) * (v[t[0]] + v[t[1]] + v[t[2]]) - bounds.min;
    const auto step = [&](double a) {
      return static_cast<std::uint64_t>(std::fmax(0.0, a / cell));
    };
    const bool flat = normal_of(static_cast<std::uint32_t>(i)) == Vec3{};
    keys[i] = {
        flat ? ~0ULL
             : spread_bits(step(c.x)) | spread_bits(step(c.y)) << 1 | spread_bits(step(c.z)) << 2,
        static_cast<std::uint32_t>(i)};
  });
  oneapi::tbb::parallel_sort(keys);
  while (!keys.empty() && keys.back().first == ~0ULL) keys.pop_back();
  order_.resize(keys.size());
  for (std::size_t i = 0; i < keys.size(); ++i) order_[i] = keys[i].second;

  leaves_ = std::bit_ceil(std::max<std::size_t>(1, (order_.size() + kLeaf - 1) / kLeaf));
  constexpr float kFar = std::numeric_limits<float>::infinity();
  boxes_.assign(2 * leaves_, Box{{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}});
  oneapi::tbb::parallel_for(std::size_t{0}, leaves_, [&](std::size_t leaf) {
    Box& box = boxes_[leaves_ + leaf];
    const std::size_t end = std::min(order_.size(), (leaf + 1) * kLeaf);
    for (std::size_t i = leaf * kLeaf; i < end; ++i)
      for (const std::uint32_t corner : mesh.triangles[order_[i]]) {
        const double p[3] = {v[corner].x, v[corner].y, v[corner].z};
        for (int k = 0; k < 3; ++k) {
          box.min[k] = std::min(box.min[k], std::nextafter(static_cast<float>(p[k]), -kFar));
          box.max[k] = std::max(box.max[k], std::nextafter(static_cast<float>(p[k]), kFar));
        }
      }
  });
  for (std::size_t i = leaves_ - 1; i >= 1; --i)
    for (int k = 0; k < 3; ++k) {
      boxes_[i].min[k] = std::min(boxes_[2 * i].min[k], boxes_[2 * i + 1].min[k]);
      boxes_[i].max[k] = std::max(boxes_[2 * i].max[k], boxes_[2 * i + 1].max[k]);
    }

  first_.assign(v.size() + 1, 0);
  for (const std::uint32_t t : order_)
    for (const std::uint32_t c : mesh.triangles[t]) ++first_[c + 1];
  for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  fan_.resize(order_.size() * 3);
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  for (const std::uint32_t t : order_)
    for (const std::uint32_t c : mesh.triangles[t]) fan_[next[c]++] = t;
}

std::optional<MeshDistance::Nearest> MeshDistance::nearest(Vec3 p, double reach_mm,
                                                           std::uint32_t hint) const {
  const auto& v = mesh_->vertices_mm;
  const auto& triangles = mesh_->triangles;
  if (order_.empty()) return std::nullopt;
  // A hair more, so that what is exactly at the reach is found.
  double best2 = reach_mm * reach_mm * (1.0 + 1e-12);
  Foot best;
  std::uint32_t which = std::numeric_limits<std::uint32_t>::max();
  const auto look_at = [&](std::uint32_t t) {
    const auto& c = triangles[t];
    const Foot foot = foot_on(p, v[c[0]], v[c[1]], v[c[2]]);
    const Vec3 off = p - foot.at;
    if (const double d2 = dot(off, off); d2 < best2) best2 = d2, best = foot, which = t;
  };
  if (hint < triangles.size() && !(normal_of(hint) == Vec3{})) look_at(hint);
  std::array<std::pair<std::size_t, double>, 64> stack;
  std::size_t depth = 0;
  stack[depth++] = {1, gap2(boxes_[1], p)};
  while (depth > 0) {
    const auto [node, gap] = stack[--depth];
    if (!(gap < best2)) continue;
    if (node >= leaves_) {
      const std::size_t first = (node - leaves_) * kLeaf;
      for (std::size_t i = first; i < std::min(first + kLeaf, order_.size()); ++i)
        look_at(order_[i]);
      continue;
    }
    const double left = gap2(boxes_[2 * node], p), right = gap2(boxes_[2 * node + 1], p);
    const bool left_first = left <= right;
    const double nearer = left_first ? left : right, other = left_first ? right : left;
    if (other < best2) stack[depth++] = {2 * node + (left_first ? 1 : 0), other};
    if (nearer < best2) stack[depth++] = {2 * node + (left_first ? 0 : 1), nearer};
  }
  if (which == std::numeric_limits<std::uint32_t>::max()) return std::nullopt;

  Nearest result{0.0, best.at, normal_of(which), which, false};
  Vec3 side = result.normal;
  const auto& c = triangles[which];
  const auto fan = [&](std::uint32_t vertex) {
    return std::span(fan_).subspan(first_[vertex], first_[vertex + 1] - first_[vertex]);
  };
  if (best.edge >= 0) {
    const std::uint32_t a = c[static_cast<std::size_t>(best.edge)];
    const std::uint32_t b = c[static_cast<std::size_t>(best.edge + 1) % 3];
    side = {};
    int sharing = 0;
    for (const std::uint32_t t : fan(a))
      if (std::find(triangles[t].begin(), triangles[t].end(), b) != triangles[t].end()) {
        side += normal_of(t);
        ++sharing;
      }
    result.border = sharing == 1;
  } else if (best.corner >= 0) {
    const std::uint32_t at = c[static_cast<std::size_t>(best.corner)];
    side = {};
    // Each edge of a closed fan belongs to two triangles: ends and beginnings pair up.
    std::uint64_t in = 0, out = 0;
    for (const std::uint32_t t : fan(at)) {
      const auto& k = triangles[t];
      const auto i = static_cast<std::size_t>(std::find(k.begin(), k.end(), at) - k.begin());
      const std::uint32_t u = k[(i + 1) % 3], w = k[(i + 2) % 3];
      side += angle_at(v[at], v[u], v[w]) * normal_of(t);
      out += u;
      in += w;
    }
    result.border = in != out;
  }
  const Vec3 off = p - best.at;
  // Over a face the distance to its plane, without the detour over the foot point.
  const double distance =
      best.edge < 0 && best.corner < 0 ? std::abs(dot(off, result.normal)) : std::sqrt(best2);
  result.distance_mm = dot(off, side) < 0.0 ? -distance : distance;
  return result;
}

TriMesh welded(TriMesh mesh) {
  const std::size_t n = mesh.vertices_mm.size();
  std::vector<std::uint32_t> order(n), same(n);
  for (std::size_t i = 0; i < n; ++i) order[i] = static_cast<std::uint32_t>(i);
  const auto& v = mesh.vertices_mm;
  const auto key = [&](std::uint32_t i) { return std::tuple(v[i].x, v[i].y, v[i].z); };
  oneapi::tbb::parallel_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return key(a) != key(b) ? key(a) < key(b) : a < b;
  });
  bool any = false;
  for (std::size_t i = 0; i < n; ++i) {
    const bool twin = i > 0 && key(order[i]) == key(order[i - 1]);
    same[order[i]] = twin ? same[order[i - 1]] : order[i];
    any = any || twin;
  }
  if (any)  // the others stay, unused
    for (auto& t : mesh.triangles)
      for (std::uint32_t& corner : t) corner = same[corner];
  return mesh;
}

std::vector<std::uint32_t> near_each_other(std::span<const Vec3> points) {
  MAQUETTE_CHECK(points.size() < std::numeric_limits<std::uint32_t>::max(), "{} points",
                 points.size());
  Box3 box;
  for (const Vec3& p : points) box.add(p);
  // 10 bits an axis of the longest side, so three passes of 10 bits sort them.
  const Vec3 size = box.max - box.min;
  const double cell = std::fmax(1e-12, std::max({size.x, size.y, size.z})) / 1023.0;
  // Key and number travel together: nothing is looked up out of order.
  std::vector<std::uint64_t> now(points.size()), next(points.size());
  oneapi::tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    const Vec3 c = (1.0 / cell) * (points[i] - box.min);
    const auto step = [](double a) { return static_cast<std::uint64_t>(a > 0.0 ? a : 0.0); };
    const std::uint64_t key =
        spread_bits(step(c.x)) | spread_bits(step(c.y)) << 1 | spread_bits(step(c.z)) << 2;
    now[i] = key << 32 | i;
  });
  for (const unsigned shift : {32U, 42U, 52U}) {
    std::vector<std::size_t> start(1025, 0);
    for (const std::uint64_t k : now) ++start[((k >> shift) & 1023U) + 1];
    for (std::size_t d = 0; d < 1024; ++d) start[d + 1] += start[d];
    for (const std::uint64_t k : now) next[start[(k >> shift) & 1023U]++] = k;
    now.swap(next);
  }
  std::vector<std::uint32_t> order(points.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<std::uint32_t>(now[i]);
  return order;
}

std::vector<float> signed_distances_mm(std::span<const Vec3> points,
                                       const RigidTransform& model_from_scan,
                                       const MeshDistance& mesh, double reach_mm) {
  constexpr std::size_t kChunk = 4096;
  std::vector<float> distances(points.size(), NAN);
  const std::vector<std::uint32_t> order = near_each_other(points);
  oneapi::tbb::parallel_for(
      std::size_t{0}, (points.size() + kChunk - 1) / kChunk, [&](std::size_t k) {
        std::uint32_t hint = std::numeric_limits<std::uint32_t>::max();
        for (std::size_t i = k * kChunk; i < std::min(points.size(), (k + 1) * kChunk); ++i)
          if (const auto n =
                  mesh.nearest(model_from_scan.point(points[order[i]]), reach_mm, hint)) {
            hint = n->triangle;
            if (!n->border) distances[order[i]] = static_cast<float>(n->distance_mm);
          }
      });
  return distances;
}

}  // namespace maquette::scan
