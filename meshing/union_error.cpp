// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/union_error.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <unordered_map>
#include <vector>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_reduce.h>

#include "core/random.hpp"
#include "meshing/coordinate_rounding.hpp"
#include "meshing/detail/stone_cap.hpp"

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;

/// Heights are interpolated in double: at a metre they err by less.
constexpr double kOnFacet_mm = 1e-9;
/// The farthest that a union moves a stone's vertex to where 32 bits hold it.
constexpr double kRounded_mm = 1e-3;

struct PlaceHash {
  std::size_t operator()(const Vec3& v) const {
    return static_cast<std::size_t>(
        mix64(std::bit_cast<std::uint64_t>(v.x) ^
              mix64(std::bit_cast<std::uint64_t>(v.y) ^ mix64(std::bit_cast<std::uint64_t>(v.z)))));
  }
};

/// The union has stones' vertices where 32 bits hold them.
Vec3 in_32_bits(Vec3 v) {
  constexpr auto kTo = CoordinateRounding::float32;
  return {rounded(v.x, kTo), rounded(v.y, kTo), rounded(v.z, kTo)};
}

/// Stones by the squares of the plan that they reach into; a box tree each.
class NearStones {
 public:
  NearStones(const ModelField& field, std::span<const TriMesh> stones) {
    double widest = field.spacing.value();
    for (const TriMesh& stone : stones) {
      boxes_.push_back(stone.bounds());
      const TriMesh* const body = &stone;
      trees_.push_back(std::make_unique<StoneDistance>(std::span<const TriMesh* const>(&body, 1)));
      for (const Vec3& v : stone.vertices_mm) vertices_.try_emplace(in_32_bits(v), v);
      const Vec3 size = boxes_.back().max - boxes_.back().min;
      widest = std::fmax(widest, std::fmax(size.x, size.y));
    }
    reach_mm_ = widest;
    bin_mm_ = 2.0 * widest;
    origin_ = {field.x_mm(0), field.y_mm(0), 0.0};
    const double x_last = field.x_mm(field.z_mm.cols() - 1),
                 y_last = field.y_mm(field.z_mm.rows() - 1);
    bins_ = Grid<std::vector<std::uint32_t>>(
        static_cast<std::ptrdiff_t>((y_last - origin_.y) / bin_mm_) + 1,
        static_cast<std::ptrdiff_t>((x_last - origin_.x) / bin_mm_) + 1);
    for (std::uint32_t i = 0; i < boxes_.size(); ++i)
      for (std::ptrdiff_t r = row(boxes_[i].min.y - reach_mm_);
           r <= row(boxes_[i].max.y + reach_mm_); ++r)
        for (std::ptrdiff_t c = col(boxes_[i].min.x - reach_mm_);
             c <= col(boxes_[i].max.x + reach_mm_); ++c)
          bins_(r, c).push_back(i);
  }

  /// Distance to a stone's vertex that p is but for rounding; INFINITY if there is none.
  [[nodiscard]] double from_vertex_mm(Vec3 p) const {
    const auto found = vertices_.find(in_32_bits(p));
    if (found == vertices_.end()) return INFINITY;
    const double distance = norm(p - found->second);
    return distance <= kRounded_mm ? distance : INFINITY;
  }

  /// Distance, if it is below `most_mm`; else INFINITY.
  [[nodiscard]] double distance_mm(Vec3 p, double most_mm) const {
    double least = INFINITY;
    for (const std::uint32_t i : bins_(row(p.y), col(p.x))) {
      const Vec3 a = boxes_[i].min - p, b = p - boxes_[i].max;
      if (std::max({a.x, a.y, a.z, b.x, b.y, b.z}) > std::fmin(least, most_mm)) continue;
      least = std::fmin(least, trees_[i]->nearest(p).distance_mm);
    }
    return least;
  }

 private:
  [[nodiscard]] std::ptrdiff_t row(double y) const {
    return std::clamp<std::ptrdiff_t>(
        static_cast<std::ptrdiff_t>(std::floor((y - origin_.y) / bin_mm_)), 0, bins_.rows() - 1);
  }
  [[nodiscard]] std::ptrdiff_t col(double x) const {
    return std::clamp<std::ptrdiff_t>(
        static_cast<std::ptrdiff_t>(std::floor((x - origin_.x) / bin_mm_)), 0, bins_.cols() - 1);
  }

  std::vector<Box3> boxes_;
  std::vector<std::unique_ptr<StoneDistance>> trees_;
  std::unordered_map<Vec3, Vec3, PlaceHash> vertices_;  ///< by their places in 32 bits
  double reach_mm_ = 0.0, bin_mm_ = 1.0;
  Vec3 origin_;
  Grid<std::vector<std::uint32_t>> bins_;
};

enum class Kind : char { other, node, stone };

struct Sums {
  UnionError error;
  double squares = 0.0;
};

Sums together(const Sums& a, const Sums& b) {
  Sums s;
  s.error.on_terrain = a.error.on_terrain + b.error.on_terrain;
  s.error.on_stones = a.error.on_stones + b.error.on_stones;
  s.error.max_vertical_mm = std::fmax(a.error.max_vertical_mm, b.error.max_vertical_mm);
  s.error.max_mm = std::fmax(a.error.max_mm, b.error.max_mm);
  s.squares = a.squares + b.squares;
  return s;
}

}  // namespace

UnionError union_error(const PartOfMesh& solid, double base_z_mm, const ModelField& field,
                       std::span<const TriMesh> stones, const RunContext& run) {
  const NearStones near(field, stones);
  const double x_last = field.x_mm(field.z_mm.cols() - 1),
               y_last = field.y_mm(field.z_mm.rows() - 1), s = field.spacing.value();
  const auto is_node = [&](Vec3 p) {
    const double c = std::round((p.x - field.x_mm(0)) / s),
                 r = std::round((p.y - field.y_mm(0)) / s);
    return p.x == field.x_mm(static_cast<std::ptrdiff_t>(c)) &&
           p.y == field.y_mm(static_cast<std::ptrdiff_t>(r));
  };
  std::vector<Kind> kind(solid.vertices_mm.size(), Kind::other);
  constexpr std::size_t kAtOnce = std::size_t{1} << 14;
  const auto all = [&](std::size_t count, auto&& work) {
    return oneapi::tbb::parallel_deterministic_reduce(
        oneapi::tbb::blocked_range<std::size_t>(0, count, kAtOnce), Sums{},
        [&](const oneapi::tbb::blocked_range<std::size_t>& range, Sums sums) {
          if (run.stopped()) return sums;
          for (std::size_t i = range.begin(); i != range.end(); ++i) work(i, sums);
          return sums;
        },
        together);
  };
  const auto off_at = [&](Vec3 p) {
    return std::abs(p.z - heightmap::height_at(field, std::clamp(p.x, field.x_mm(0), x_last),
                                               std::clamp(p.y, field.y_mm(0), y_last)));
  };
  const auto sample = [&](Vec3 p, Sums& sums) {
    const double off = off_at(p);
    if (off <= kOnFacet_mm) return;
    sums.error.max_mm = std::fmax(sums.error.max_mm, std::fmin(off, near.distance_mm(p, off)));
  };
  Sums sums = all(solid.vertices_mm.size(), [&](std::size_t i, Sums& sum) {
    const Vec3 v = solid.vertices_mm[i];
    if (v.z == base_z_mm) return;
    const double off = off_at(v);
    if (const double stone = near.from_vertex_mm(v); stone < INFINITY) {
      kind[i] = Kind::stone;
      ++sum.error.on_stones;
      sum.error.max_mm = std::fmax(sum.error.max_mm, std::fmin(off, stone));
      return;
    }
    if (is_node(v)) kind[i] = Kind::node;
    const double stone = off <= kOnFacet_mm ? INFINITY : near.distance_mm(v, off);
    sum.error.max_mm = std::fmax(sum.error.max_mm, std::fmin(off, stone));
    if (stone < off) {
      ++sum.error.on_stones;
    } else {
      ++sum.error.on_terrain;
      sum.squares += off * off;
      sum.error.max_vertical_mm = std::fmax(sum.error.max_vertical_mm, off);
    }
  });
  sums = together(sums, all(solid.triangles.size(), [&](std::size_t i, Sums& sum) {
                    const auto& [a, b, c] = solid.triangles[i];
                    const Vec3 p = solid.vertices_mm[a], q = solid.vertices_mm[b],
                               r = solid.vertices_mm[c];
                    if (p.z == base_z_mm || q.z == base_z_mm || r.z == base_z_mm) return;
                    sample((1.0 / 3.0) * (p + q + r), sum);
                    if (kind[a] == kind[b] && kind[b] == kind[c] && kind[a] != Kind::other) return;
                    sample(0.5 * (p + q), sum);
                    sample(0.5 * (q + r), sum);
                    sample(0.5 * (r + p), sum);
                  }));
  UnionError error = sums.error;
  if (error.on_terrain > 0)
    error.rms_vertical_mm = std::sqrt(sums.squares / static_cast<double>(error.on_terrain));
  return error;
}

}  // namespace maquette::meshing::detail
