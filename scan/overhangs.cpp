// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/overhangs.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <oneapi/tbb/concurrent_vector.h>
#include <oneapi/tbb/parallel_for.h>

#include "scan/detail/scan_scene.hpp"
#include "scan/detail/sight.hpp"
#include "scan/mesh_distance.hpp"
#include "scan/surface_distance.hpp"

namespace maquette::scan {
namespace {

constexpr double kOnPart = 3.0, kWrong = 0.25;  // standard deviations
constexpr double kRoundTheCorner = 2.0;         // the same
constexpr double kLeavesGroundMm = 0.01;

/// A stone with its tree, and where it can matter.
struct Stone {
  MeshDistance to;
  Box3 box;
  double reach_mm;
  Stone(const TriMesh& mesh, double margin_mm) : to(mesh), box(mesh.bounds()) {
    const Vec3 margin{margin_mm, margin_mm, margin_mm};
    box.min = box.min - margin;
    box.max = box.max + margin;
    reach_mm = norm(box.max - box.min);  // whatever is in the box has its nearest triangle
  }
  [[nodiscard]] bool near(Vec3 p) const {
    return p.x > box.min.x && p.x < box.max.x && p.y > box.min.y && p.y < box.max.y &&
           p.z < box.max.z;
  }
};

/// Does the envelope leave the ground within a distance of a place?
bool near_outline(const heightmap::ModelField& envelope, const heightmap::ModelField& ground,
                  Vec3 p, double within_mm) {
  const auto& z = envelope.z_mm;
  const double h = envelope.spacing.value();
  const auto from = [&](double at, double origin) {
    return static_cast<std::ptrdiff_t>(std::ceil((at - within_mm - origin) / h));
  };
  const std::ptrdiff_t row = from(p.y, envelope.y0.value()), col = from(p.x, envelope.x0.value());
  const auto count = static_cast<std::ptrdiff_t>(2.0 * within_mm / h) + 1;
  bool stone = false, bare = false;
  for (std::ptrdiff_t r = row; r < row + count; ++r)
    for (std::ptrdiff_t c = col; c < col + count; ++c) {
      if (!z.contains(r, c)) continue;
      const double x = envelope.x_mm(c), y = envelope.y_mm(r);
      if (std::hypot(x - p.x, y - p.y) > within_mm) continue;
      const bool above =
          static_cast<double>(z(r, c)) > heightmap::height_at(ground, x, y) + kLeavesGroundMm;
      (above ? stone : bare) = true;
    }
  return stone && bare;
}

/// What each point's line of sight meets, asked for those that have one.
class Feet {
 public:
  static Result<Feet> build(const heightmap::ModelField& ground, std::span<const TriMesh> stones,
                            std::span<const Viewpoint> views) {
    Feet feet;
    for (const Viewpoint& view : views)
      feet.ends_.push_back((feet.ends_.empty() ? 0 : feet.ends_.back()) + view.points);
    feet.views_ = views;
    if (views.empty()) return feet;
    MAQUETTE_TRY(auto scene, detail::ScanScene::build(ground, stones));
    feet.scene_.emplace(std::move(scene));
    return feet;
  }
  /// Was the scanner's place of this point given?
  [[nodiscard]] bool know(std::size_t point) const {
    return scene_ && view_of(point).station_mm.has_value();
  }
  struct Foot {
    Vec3 place_mm;
    bool on_stone;
  };
  /// @pre know()
  [[nodiscard]] std::optional<Foot> of(std::size_t point, Vec3 p) const {
    const detail::Sight sight = detail::sight_of(view_of(point), p);
    const auto echo = scene_->look(sight.from_mm, sight.direction);
    if (!echo) return std::nullopt;
    return Foot{sight.from_mm + echo->range_mm * sight.direction, echo->stone};
  }

 private:
  [[nodiscard]] const Viewpoint& view_of(std::size_t point) const {
    return views_[static_cast<std::size_t>(std::upper_bound(ends_.begin(), ends_.end(), point) -
                                           ends_.begin())];
  }
  std::span<const Viewpoint> views_;
  std::vector<std::size_t> ends_;
  std::optional<detail::ScanScene> scene_;
};

}  // namespace

Result<HeightJudgement> judge_by_heights(std::span<const Vec3> points,
                                         const heightmap::ModelField& envelope,
                                         const heightmap::ModelField& ground,
                                         std::span<const TriMesh> meshes, double coat_mm,
                                         double noise_mm, std::span<const Viewpoint> views) {
  HeightJudgement judged;
  judged.beyond.assign(points.size(), 0);
  const double on_part = kOnPart * noise_mm;
  std::vector<Stone> stones;
  stones.reserve(meshes.size());
  for (const TriMesh& mesh : meshes)
    if (!mesh.triangles.empty()) stones.emplace_back(mesh, on_part + coat_mm);
  if (stones.empty()) return judged;
  MAQUETTE_TRY(const Feet feet, Feet::build(ground, meshes, views));
  const double corner = kRoundTheCorner * noise_mm + envelope.spacing.value();
  const auto wrong = [&](Vec3 p, double distance) {
    const double reach =
        on_part + norm(p - Vec3{p.x, p.y, heightmap::height_at(envelope, p.x, p.y)});
    return std::abs(signed_distance_mm(envelope, p, reach) - distance) > kWrong * noise_mm;
  };
  oneapi::tbb::concurrent_vector<SeenAt> seen_at;
  oneapi::tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    const Vec3 p = points[i];
    // Distance to what is joined: the least, exact outside.
    double to_part = INFINITY;
    for (const Stone& stone : stones)
      if (stone.near(p))
        if (const auto nearest =
                stone.to.nearest(p, stone.reach_mm + std::abs(p.z - stone.box.min.z)))
          to_part = std::fmin(to_part, nearest->distance_mm - coat_mm);
    if (to_part == INFINITY) return;
    const double to_ground = signed_distance_mm(ground, p, on_part);
    if (!std::isnan(to_ground))
      to_part = std::fmin(to_part, to_ground);
    else if (!(p.z > heightmap::height_at(ground, p.x, p.y)))
      return;  // deep in the ground
    if (!(std::abs(to_part) < on_part)) return;
    if (!feet.know(i)) {
      if (wrong(p, to_part)) judged.beyond[i] = 1;
      return;
    }
    const auto foot = feet.of(i, p);
    if (!foot) return;
    if (wrong(foot->place_mm, foot->on_stone ? -coat_mm : 0.0) ||
        near_outline(envelope, ground, foot->place_mm, corner))
      judged.beyond[i] = 1;
    else
      seen_at.push_back({i, foot->place_mm});
  });
  judged.seen_at.assign(seen_at.begin(), seen_at.end());
  std::sort(judged.seen_at.begin(), judged.seen_at.end(),
            [](const SeenAt& a, const SeenAt& b) { return a.point < b.point; });
  return judged;
}

}  // namespace maquette::scan
