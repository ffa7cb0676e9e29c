// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/find_stones.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "heightmap/field_tracer.hpp"
#include "scan/detail/mesh_surface.hpp"
#include "scan/detail/registration_steps.hpp"
#include "scan/detail/stone_fit.hpp"

namespace maquette::scan {
namespace {

using detail::Pose;
using heightmap::ModelField;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr std::size_t kSample = 1'500;
constexpr std::size_t kFewer = 120;  // to find the heading
constexpr int kHeadings = 16;
constexpr std::size_t kMostRanges = 4'000;
constexpr double kMargin = 0.25;  // of a stone's radius
// Of that of a ball around it: how far from its middle points lie that count. Behind its edge the
// ground is seen as far away as its shadow is long.
constexpr double kBehind = 4.0;
constexpr std::ptrdiff_t kCells = 256;
constexpr double kFalseCalls = 0.01;  // plans in which a stone that stands is called moved

struct Shape {
  TriMesh mesh;
  Vec3 middle;
  double radius_mm = 0.0;  ///< about the vertical through the middle
  double around_mm = 0.0;  ///< radius of a ball about the middle that holds it
  Box3 box;
};

Shape shape_of(const meshing::PlacedStone& stone) {
  Shape s;
  s.mesh = meshing::stone_mesh(stone);
  s.box = s.mesh.bounds();
  s.middle = 0.5 * (s.box.min + s.box.max);
  for (const Vec3& v : s.mesh.vertices_mm) {
    s.radius_mm = std::fmax(s.radius_mm, std::hypot(v.x - s.middle.x, v.y - s.middle.y));
    s.around_mm = std::fmax(s.around_mm, norm(v - s.middle));
  }
  return s;
}

struct Match {
  Pose pose;  // plan from actual
  double noise_mm = INFINITY;
};

/// The points on one mesh, from one heading.
Match match(const std::vector<Vec3>& points, const MeshDistance& mesh, const Pose& start,
            double reach_mm, int rounds) {
  const detail::MeshSurface surface(mesh, reach_mm);
  // The search for a heading need not come to rest.
  const detail::Level level{&surface, (rounds > 1 ? 0.05 : 1.0) * reach_mm,
                            static_cast<double>(points.size()), 1e-8};
  Match m;
  m.pose = start;
  for (int i = 0; i < rounds; ++i) m.pose = detail::settle(points, m.pose, level);
  const detail::Met met = detail::meet(points, m.pose, surface);
  const auto spread = detail::spread_of(met);
  // What is out of reach has no residual: a fit that leaves out half of the points is none.
  if (2 * spread.count < points.size() || spread.count < kLeastOnStone) return m;
  m.noise_mm = std::fmax(detail::kLeastScaleMm, detail::robust_scale(met));
  return m;
}

Pose turned_about(Vec3 centre, double angle, Vec3 shift) {
  Pose pose;
  pose.rigid.rotation = rotation_about({0.0, 0.0, 1.0}, angle);
  pose.rigid.translation_mm = centre - rotate(pose.rigid.rotation, centre) + shift;
  return pose;
}

Match best_heading(const std::vector<Vec3>& points, const MeshDistance& mesh, Vec3 from, Vec3 to,
                   double reach_mm) {
  const std::vector<Vec3> fewer = detail::sample(points, kFewer);
  Match best;
  for (int k = 0; k < kHeadings; ++k) {
    const Match m =
        match(fewer, mesh, turned_about(from, 2.0 * std::numbers::pi * k / kHeadings, to - from),
              reach_mm, 1);
    if (m.noise_mm < best.noise_mm) best = m;
  }
  return best.noise_mm < INFINITY ? match(points, mesh, best.pose, reach_mm, 3) : best;
}

/// What the scan's pose does to a stone's.
Matrix6 scan_pose_at(const Registration* registration, const detail::StoneFrame& frame) {
  if (registration == nullptr) return Matrix6::Zero();
  using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  const Vec3 arm = frame.middle_mm - registration->centre_mm;
  Matrix6 carry = Matrix6::Identity();
  carry.block<3, 3>(0, 3) << 0.0, arm.z, -arm.y, -arm.z, 0.0, arm.x, arm.y, -arm.x, 0.0;
  carry.bottomRows<3>() *= frame.arm_mm;
  return carry * Eigen::Map<const RowMajor6>(registration->covariance.data()) * carry.transpose();
}

void state_pose(StoneFinding& f, const detail::StoneFit& fit, const detail::StoneFrame& frame,
                const Matrix6& scan_pose) {
  f.actual_from_planned = fit.actual_from_planned;
  f.noise_mm = fit.noise_mm;
  f.shift_mm = fit.actual_from_planned.point(frame.middle_mm) - frame.middle_mm;
  Quaternion q = fit.actual_from_planned.rotation;
  if (q.w < 0.0) q = {-q.w, -q.x, -q.y, -q.z};
  f.turn_rad = 2.0 * std::atan2(q.z, q.w);
  f.tilt_rad = 2.0 * std::asin(std::fmin(1.0, std::hypot(q.x, q.y)));
  const Matrix6 covariance = fit.covariance + scan_pose;
  f.sigma_shift_mm = {std::sqrt(covariance(0, 0)), std::sqrt(covariance(1, 1)),
                      std::sqrt(covariance(2, 2))};
  f.sigma_turn_rad = std::sqrt(covariance(5, 5)) / frame.arm_mm;
  const Eigen::Matrix2d tilt = covariance.block<2, 2>(3, 3);
  f.sigma_tilt_rad =
      std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(tilt).eigenvalues()(1)) /
      frame.arm_mm;
}

/// Which view a point belongs to.
class Views {
 public:
  explicit Views(std::span<const Viewpoint> views) : views_(views) {
    for (const Viewpoint& v : views) ends_.push_back((ends_.empty() ? 0 : ends_.back()) + v.points);
  }
  [[nodiscard]] const Viewpoint& of(std::size_t point) const {
    const auto at = std::upper_bound(ends_.begin(), ends_.end(), point) - ends_.begin();
    return at < std::ssize(ends_) ? views_[static_cast<std::size_t>(at)] : above_;
  }

 private:
  std::span<const Viewpoint> views_;
  std::vector<std::size_t> ends_;
  Viewpoint above_;
};

/// Distance of a line of sight from a place.
double passing_mm(const detail::Sight& sight, Vec3 place) {
  return norm(cross(place - sight.from_mm, sight.direction));
}

double margin_of(const Shape& s, double noise_mm) {
  return std::fmax(kMargin * s.radius_mm, 5.0 * noise_mm);
}

/// How far from a stone's middle points lie that count.
double farthest_of(const Shape& s, double noise_mm) {
  return kBehind * s.around_mm + margin_of(s, noise_mm);
}

/// What lies about a stone, in one pass over all points.
struct About {
  std::vector<std::size_t> points;  // whose beams pass it
  std::vector<Vec3> on;             // of those, clear of the ground
  std::size_t over = 0;             // its middle
  double high = 0.0, planned = 0.0;
};

/// Points belong to a stone by their lines of sight. By where they lie, those that an edge has
/// mixed with the ground far behind would be missing, and all others there pull towards the stone.
std::vector<About> gather(std::span<const Vec3> points, const Views& views,
                          const ModelField& ground, const std::vector<Shape>& shapes, double lift,
                          double noise_mm) {
  // Stones by the cells that they may have points in.
  const double x0 = ground.x0.value(), y0 = ground.y0.value();
  const double wide = ground.x_mm(ground.z_mm.cols() - 1) - x0;
  const double deep = ground.y_mm(ground.z_mm.rows() - 1) - y0;
  const auto cell = [](double along, double length) {
    return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(along / length * kCells), 0,
                                      kCells - 1);
  };
  Grid<std::vector<std::uint32_t>> near(kCells, kCells);
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    const Vec3 m = shapes[k].middle;
    const double reach = farthest_of(shapes[k], noise_mm);
    for (std::ptrdiff_t r = cell(m.y - reach - y0, deep); r <= cell(m.y + reach - y0, deep); ++r)
      for (std::ptrdiff_t c = cell(m.x - reach - x0, wide); c <= cell(m.x + reach - x0, wide); ++c)
        near(r, c).push_back(static_cast<std::uint32_t>(k));
  }
  std::vector<About> about(shapes.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 p = points[i];
    for (const std::uint32_t k : near(cell(p.y - y0, deep), cell(p.x - x0, wide))) {
      const Shape& shape = shapes[k];
      const double out = std::hypot(p.x - shape.middle.x, p.y - shape.middle.y);
      if (out > farthest_of(shape, noise_mm)) continue;
      const double h = heightmap::height_at(ground, p.x, p.y);
      if (std::isnan(h)) continue;
      About& a = about[k];
      if (passing_mm(detail::sight_of(views.of(i), p), shape.middle) <
          shape.around_mm + margin_of(shape, noise_mm))
        a.points.push_back(i);
      if (out > shape.radius_mm + margin_of(shape, noise_mm)) continue;
      if (out < 0.3 * shape.radius_mm) {
        ++a.over;
        a.high += p.z - h;
        a.planned += shape.box.max.z - h;
      }
      if (p.z - h > lift) a.on.push_back(p);
    }
  }
  return about;
}

/// Stones sorted by x, to find those that may hide another or stand behind it.
class Neighbours {
 public:
  explicit Neighbours(const std::vector<Shape>& shapes) : shapes_(shapes), order_(shapes.size()) {
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    std::sort(order_.begin(), order_.end(),
              [&](std::size_t a, std::size_t b) { return x_of(a) < x_of(b); });
    for (const Shape& s : shapes) widest_mm_ = std::fmax(widest_mm_, s.around_mm);
  }
  /// Meshes of all others that a point which counts for a stone may lie on.
  [[nodiscard]] std::vector<TriMesh> of(std::size_t k, double reach_mm) const {
    std::vector<TriMesh> meshes;
    const double most = reach_mm + widest_mm_;
    for (auto at = std::lower_bound(order_.begin(), order_.end(), x_of(k) - most,
                                    [&](std::size_t i, double x) { return x_of(i) < x; });
         at != order_.end() && x_of(*at) <= x_of(k) + most; ++at)
      if (*at != k &&
          norm(shapes_[*at].middle - shapes_[k].middle) < reach_mm + shapes_[*at].around_mm)
        meshes.push_back(shapes_[*at].mesh);
    return meshes;
  }

 private:
  [[nodiscard]] double x_of(std::size_t i) const { return shapes_[i].middle.x; }
  const std::vector<Shape>& shapes_;
  std::vector<std::size_t> order_;
  double widest_mm_ = 0.0;
};

/// @param others  stones that are not in question: what their beams meet first is no other stone's
detail::StoneRanges ranges_of(std::span<const Vec3> points, const std::vector<std::size_t>& about,
                              const Views& views, const heightmap::FieldTracer& ground,
                              const detail::StoneScene& others) {
  detail::StoneRanges seen;
  std::vector<detail::Ray> rays;
  for (const std::size_t k : detail::sample_indices(about.size(), kMostRanges)) {
    const std::size_t i = about[k];
    const Viewpoint& view = views.of(i);
    const detail::Sight sight = detail::sight_of(view, points[i]);
    const auto samples = detail::rays_of(view), finer = detail::edge_rays_of(view);
    seen.ranges.push_back({i, sight.range_mm, seen.rays.size(), samples.size(), finer.size()});
    for (const auto* some : {&samples, &finer}) {
      rays.resize(some->size());
      detail::spread(sight, view, *some, i, rays);
      for (std::size_t j = 0; j < rays.size(); ++j) {
        const auto hit = ground.trace(rays[j].origin_mm, rays[j].direction);
        double met_mm = hit ? hit->distance_mm : INFINITY;
        double cosine = hit ? -dot(hit->normal, rays[j].direction) : 0.0;
        if (const auto other = others.trace(rays[j].origin_mm, rays[j].direction, met_mm)) {
          met_mm = other->distance_mm;
          cosine = -dot(other->normal, rays[j].direction);
        }
        seen.rays.push_back(
            {rays[j].origin_mm, rays[j].direction, (*some)[j], met_mm, std::fmax(0.0, cosine)});
      }
    }
  }
  return seen;
}

}  // namespace

std::string_view name_of(StoneState state) {
  switch (state) {
    case StoneState::as_planned:
      return "as planned";
    case StoneState::moved:
      return "moved";
    case StoneState::missing:
      return "missing";
    case StoneState::swapped:
      return "swapped";
    case StoneState::unclear:
      return "unclear";
    case StoneState::present:
      return "present";
    default:
      return "unseen";
  }
}

Result<std::vector<StoneFinding>> find_stones(std::span<const Vec3> points,
                                              std::span<const Viewpoint> viewpoints,
                                              const ModelField& ground,
                                              std::span<const meshing::PlacedStone> plan,
                                              double noise_mm, const Registration* registration) {
  std::vector<StoneFinding> findings;
  if (plan.empty()) return findings;
  std::vector<Shape> shapes;
  std::vector<MeshDistance> meshes;
  shapes.reserve(plan.size());
  meshes.reserve(plan.size());
  for (const auto& stone : plan) {
    shapes.push_back(shape_of(stone));
    meshes.emplace_back(shapes.back().mesh);
  }
  const double lift = std::fmax(5.0 * noise_mm, 0.05 * ground.spacing.value());
  const detail::StoneNoise noise{std::fmax(detail::kLeastScaleMm, noise_mm),
                                 std::fmax(2.0 * noise_mm, 0.05 * ground.spacing.value())};
  const Views views(viewpoints);
  const auto all = gather(points, views, ground, shapes, lift, noise_mm);
  const heightmap::FieldTracer tracer(ground);
  const Neighbours neighbours(shapes);
  const double level = 1.0 - std::pow(1.0 - kFalseCalls, 1.0 / static_cast<double>(plan.size()));
  for (std::size_t k = 0; k < plan.size(); ++k) {
    const Shape& shape = shapes[k];
    const About& about = all[k];
    StoneFinding f;
    f.number = plan[k].number;
    f.points = about.on.size();
    f.over = about.over;
    f.width_mm = 2.0 * shape.radius_mm;
    f.height_share = about.planned > 0.0 ? about.high / about.planned : 0.0;
    const double sigma_share =
        about.planned > 0.0 ? noise_mm * std::sqrt(static_cast<double>(about.over)) / about.planned
                            : INFINITY;
    if (about.over >= kLeastOverStone && f.height_share < 0.25 &&
        f.height_share < 0.5 - 3.0 * sigma_share) {
      f.state = StoneState::missing;
    } else if (about.on.size() >= kLeastOnStone) {
      const double reach = 0.5 * shape.radius_mm;
      // Facets and glue aside, a stone fits as well as the scan is noisy.
      const double fits = std::fmax(3.0 * noise_mm, 0.01 * shape.radius_mm);
      MAQUETTE_TRY(const auto scene, detail::StoneScene::build(std::span(&shape.mesh, 1)));
      const auto near = neighbours.of(k, farthest_of(shape, noise_mm));
      MAQUETTE_TRY(const auto others, detail::StoneScene::build(near));
      const detail::StoneRanges seen = ranges_of(points, about.points, views, tracer, others);
      const detail::StoneFrame frame{shape.middle, shape.radius_mm};
      const auto fit_from = [&](const RigidTransform& start) {
        return detail::fit_stone(seen, scene, ground, frame, start, noise);
      };
      detail::StoneFit fit = fit_from({});
      Match own, other;
      std::size_t which = k;
      if (!(fit.noise_mm <= fits)) {
        const std::vector<Vec3> some = detail::sample(about.on, kSample);
        own = match(some, meshes[k], {}, reach, 3);
        if (own.noise_mm > fits)
          if (const Match turned = best_heading(some, meshes[k], shape.middle, shape.middle, reach);
              turned.noise_mm < own.noise_mm)
            own = turned;
        if (detail::StoneFit again = fit_from(own.pose.rigid.inverse());
            again.noise_mm < fit.noise_mm)
          fit = std::move(again);
        for (std::size_t j = 0; j < plan.size() && !(fit.noise_mm <= fits); ++j) {
          if (j == k) continue;
          const Vec3 there{shapes[j].middle.x, shapes[j].middle.y,
                           shapes[j].box.max.z - shape.box.max.z + shape.middle.z};
          const Match m =
              best_heading(some, meshes[j], shape.middle, there, 0.5 * shapes[j].radius_mm);
          if (m.noise_mm < other.noise_mm) other = m, which = j;
        }
      }
      if (which != k && other.noise_mm < 0.5 * own.noise_mm && other.noise_mm <= 2.0 * fits) {
        f.state = StoneState::swapped;
        f.carries = plan[which].number;
        f.noise_mm = other.noise_mm;
      } else if (fit.noise_mm <= 3.0 * fits) {
        const Matrix6 scan_pose = scan_pose_at(registration, frame);
        state_pose(f, fit, frame, scan_pose);
        f.chance = detail::chance_of_standing(seen, scene, ground, frame, fit, scan_pose, noise);
        f.state = f.chance < level ? StoneState::moved : StoneState::as_planned;
        f.size = detail::size_terms(seen, scene, ground, frame, fit, noise);
      } else {
        f.state = StoneState::unclear;
        f.noise_mm = std::fmin(fit.noise_mm, own.noise_mm);
      }
    }
    if (f.state == StoneState::unseen && about.over >= kLeastOverStone)
      f.state = f.height_share > 0.5 ? StoneState::present : StoneState::unclear;
    findings.push_back(f);
  }
  return findings;
}

Result<std::vector<double>> beyond_stones(std::span<const Vec3> points,
                                          std::span<const Viewpoint> viewpoints,
                                          const ModelField& ground,
                                          std::span<const meshing::PlacedStone> stones) {
  std::vector<TriMesh> meshes;
  for (const auto& stone : stones) meshes.push_back(meshing::stone_mesh(stone));
  std::optional<detail::StoneScene> scene;
  if (!meshes.empty()) {
    MAQUETTE_TRY(scene, detail::StoneScene::build(meshes));
  }
  const heightmap::FieldTracer tracer(ground);
  const Views views(viewpoints);
  std::vector<double> beyond(points.size());
  oneapi::tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    const detail::Sight sight = detail::sight_of(views.of(i), points[i]);
    double range = INFINITY;
    if (const auto hit = tracer.trace(sight.from_mm, sight.direction)) range = hit->distance_mm;
    if (scene)
      if (const auto hit = scene->trace(sight.from_mm, sight.direction, range))
        range = hit->distance_mm;
    beyond[i] = sight.range_mm - range;
  });
  return beyond;
}

}  // namespace maquette::scan
