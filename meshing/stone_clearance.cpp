// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/stone_clearance.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;

constexpr std::uint32_t kNoSlot = std::numeric_limits<std::uint32_t>::max();

/// RigidTransform::point for many points.
class Poser {
 public:
  explicit Poser(const RigidTransform& pose)
      : x_(pose.direction({1, 0, 0})),
        y_(pose.direction({0, 1, 0})),
        z_(pose.direction({0, 0, 1})),
        origin_(pose.translation_mm) {}
  [[nodiscard]] Vec3 operator()(Vec3 p) const { return origin_ + p.x * x_ + p.y * y_ + p.z * z_; }

 private:
  Vec3 x_, y_, z_, origin_;
};

/// Whole numbers from one value to another, in either order; visit(share of the way).
template <class Visit>
void for_each_line_between(double from, double to, Visit&& visit) {
  if (from == to) return;
  const double last = std::floor(std::max(from, to));
  for (double k = std::ceil(std::min(from, to)); k <= last; k += 1.0)
    visit(std::clamp((k - from) / (to - from), 0.0, 1.0));
}

/// visit(point, gap) where the edge crosses the lines of the grid and the diagonals of its cells.
template <class Visit>
void along_edge(const ModelField& f, Vec3 a, Vec3 b, Visit&& visit) {
  const double s = f.spacing.value();
  const double ua = (a.x - f.x0.value()) / s, va = (a.y - f.y0.value()) / s;
  const double ub = (b.x - f.x0.value()) / s, vb = (b.y - f.y0.value()) / s;
  const auto at = [&](double share) {
    const Vec3 p = a + share * (b - a);
    visit(p, p.z - heightmap::height_at(f, p.x, p.y));
  };
  for_each_line_between(ua, ub, at);
  for_each_line_between(va, vb, at);
  for_each_line_between(ua - va, ub - vb, at);
}

/// visit(point, gap) for the nodes under a face that looks down.
template <class Visit>
void under_face(const ModelField& f, Vec3 a, Vec3 b, Vec3 c, Visit&& visit) {
  const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
  if (!(area < 0.0)) return;  // looks up, or stands upright
  const double s = f.spacing.value();
  const auto range = [s](double p, double q, double r, double origin, std::ptrdiff_t count) {
    const double low = (std::min({p, q, r}) - origin) / s,
                 high = (std::max({p, q, r}) - origin) / s;
    return std::pair{std::max<std::ptrdiff_t>(0, static_cast<std::ptrdiff_t>(std::ceil(low))),
                     std::min(count - 1, static_cast<std::ptrdiff_t>(std::floor(high)))};
  };
  const auto [row_first, row_last] = range(a.y, b.y, c.y, f.y0.value(), f.z_mm.rows());
  const auto [col_first, col_last] = range(a.x, b.x, c.x, f.x0.value(), f.z_mm.cols());
  for (std::ptrdiff_t row = row_first; row <= row_last; ++row)
    for (std::ptrdiff_t col = col_first; col <= col_last; ++col) {
      const double x = f.x_mm(col), y = f.y_mm(row);
      const double wb = ((x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x)) / area;
      const double wc = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / area;
      if (wb < 0.0 || wc < 0.0 || wb + wc > 1.0) continue;
      const double z = a.z + wb * (b.z - a.z) + wc * (c.z - a.z);
      visit(Vec3{x, y, z}, z - static_cast<double>(f.z_mm(row, col)));
    }
}

}  // namespace

StoneClearance::StoneClearance(const TriMesh& stone, const ModelField& surface)
    : stone_(stone), surface_(surface) {
  for (const auto& t : stone.triangles)
    for (std::size_t i = 0; i < 3; ++i)
      if (t[i] < t[(i + 1) % 3]) edges_.push_back({t[i], t[(i + 1) % 3]});  // closed: once each
  for (const auto& [a, b] : edges_)
    length_mm_.push_back(norm(stone.vertices_mm[a] - stone.vertices_mm[b]));
  longest_edge_mm_ = *std::max_element(length_mm_.begin(), length_mm_.end());
  slot_.assign(stone.vertices_mm.size(), kNoSlot);
  gap_.resize(stone.vertices_mm.size());
}

double StoneClearance::steepest_under(const Box3& box) const {
  const double s = surface_.spacing.value();
  const auto cell = [s](double at, double origin, std::ptrdiff_t count) {
    return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::floor((at - origin) / s)), 0,
                                      count - 2);
  };
  const Grid<float>& z = surface_.z_mm;
  double most = 0.0;
  for (std::ptrdiff_t r = cell(box.min.y, surface_.y0.value(), z.rows());
       r <= cell(box.max.y, surface_.y0.value(), z.rows()); ++r)
    for (std::ptrdiff_t c = cell(box.min.x, surface_.x0.value(), z.cols());
         c <= cell(box.max.x, surface_.x0.value(), z.cols()); ++c) {
      const double z00 = z(r, c), z01 = z(r, c + 1), z10 = z(r + 1, c), z11 = z(r + 1, c + 1);
      const double lower = (z01 - z00) * (z01 - z00) + (z11 - z01) * (z11 - z01);
      const double upper = (z11 - z10) * (z11 - z10) + (z10 - z00) * (z10 - z00);
      most = std::fmax(most, std::fmax(lower, upper));
    }
  return std::sqrt(most) / s;
}

bool StoneClearance::gather(const RigidTransform& pose, double reach_mm) {
  const Poser posed(pose);
  Box3 box;
  for (std::size_t i = 0; i < gap_.size(); ++i) {
    const Vec3 p = posed(stone_.vertices_mm[i]);
    gap_[i] = p.z - heightmap::height_at(surface_, p.x, p.y);
    if (std::isnan(gap_[i])) return false;
    box.add(p);
  }
  // The gap of a point changes by at most `steep` times the way that it goes; no point of an edge
  // is farther than half of it from an end, none of a face farther than an edge from a corner.
  double steep = 1.0, near_vertex = INFINITY, near_corner = INFINITY;
  if (std::isfinite(reach_mm)) {
    box.min = box.min - Vec3{reach_mm, reach_mm, 0};
    box.max = box.max + Vec3{reach_mm, reach_mm, 0};
    steep = std::hypot(1.0, steepest_under(box));
    near_vertex = steep * reach_mm;
    near_corner = steep * (reach_mm + longest_edge_mm_);
  }
  for (const std::uint32_t i : used_) slot_[i] = kNoSlot;
  used_.clear();
  const auto slot = [&](std::uint32_t i) {
    if (slot_[i] == kNoSlot) {
      slot_[i] = static_cast<std::uint32_t>(used_.size());
      used_.push_back(i);
    }
    return slot_[i];
  };
  touching_.clear();
  near_edges_.clear();
  near_faces_.clear();
  for (std::uint32_t i = 0; i < gap_.size(); ++i)
    if (gap_[i] <= near_vertex) touching_.push_back(slot(i));
  for (std::size_t k = 0; k < edges_.size(); ++k) {
    const auto& [a, b] = edges_[k];
    if (std::min(gap_[a], gap_[b]) <= near_vertex + 0.5 * steep * length_mm_[k])
      near_edges_.push_back({slot(a), slot(b)});
  }
  for (const auto& [a, b, c] : stone_.triangles)
    if (std::min({gap_[a], gap_[b], gap_[c]}) <= near_corner)
      near_faces_.push_back({slot(a), slot(b), slot(c)});
  return true;
}

template <class Visit>
void StoneClearance::for_each(const RigidTransform& pose, const bool& done, Visit&& visit) {
  const Poser posed(pose);
  posed_.resize(used_.size());
  for (std::size_t i = 0; i < used_.size(); ++i) posed_[i] = posed(stone_.vertices_mm[used_[i]]);
  for (std::size_t k = 0; k < touching_.size() && !done; ++k) {
    const Vec3 p = posed_[touching_[k]];
    visit(p, p.z - heightmap::height_at(surface_, p.x, p.y));
  }
  for (std::size_t k = 0; k < near_edges_.size() && !done; ++k)
    along_edge(surface_, posed_[near_edges_[k][0]], posed_[near_edges_[k][1]], visit);
  for (std::size_t k = 0; k < near_faces_.size() && !done; ++k) {
    const auto& [a, b, c] = near_faces_[k];
    under_face(surface_, posed_[a], posed_[b], posed_[c], visit);
  }
}

double StoneClearance::least_gap_mm(const RigidTransform& pose, double enough_mm) {
  double least = INFINITY;
  bool over = true, done = false;
  for_each(pose, done, [&](Vec3, double gap) {
    over = over && !std::isnan(gap);
    if (gap < least) least = gap;
    done = least < enough_mm;
  });
  return over ? least : NAN;
}

std::vector<StoneContact> StoneClearance::contacts(const RigidTransform& pose, double within_mm) {
  std::vector<StoneContact> all;
  for_each(pose, false, [&](Vec3 at, double gap) {
    if (gap <= within_mm) all.push_back({at, gap});
  });
  return all;
}

}  // namespace maquette::meshing::detail
