// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/target_calibration.hpp"

#include <algorithm>
#include <cmath>

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>
#include <Eigen/Dense>

#include "camera/detail/distortion_laws.hpp"
#include "camera/detail/normal_matrix.hpp"
#include "camera/detail/quiet_ceres.hpp"
#include "camera/detail/target_poses.hpp"

namespace maquette::camera {
namespace {

using detail::Spread;

constexpr int kMatrix = 5;        ///< f, aspect, cx, cy, skew
constexpr int kMost = 8;          ///< coefficients of distortion
constexpr double kOutlier = 6.0;  ///< robust standard deviations

/// Everything that is estimated.
struct Unknowns {
  std::array<double, kMatrix> matrix{};
  std::array<double, kMost> bend{};
  std::vector<std::array<double, 6>> poses;  ///< angle-axis, mm: camera from target
};

/// Where a point is seen less where it should be, pixels.
struct Miss {
  Vec3 target_mm;
  Vec2 seen_px;
  bool quotient = false;

  template <class T>
  bool operator()(const T* matrix, const T* bend, const T* pose, T* miss) const {
    const std::array<T, 3> from{T(target_mm.x), T(target_mm.y), T(target_mm.z)};
    std::array<T, 3> at;
    ceres::AngleAxisRotatePoint(pose, from.data(), at.data());
    for (std::size_t i = 0; i < 3; ++i) at[i] += pose[3 + i];
    if (!(at[2] > T(1e-6))) return false;  // behind the camera
    const T x = at[0] / at[2], y = at[1] / at[2];
    std::array<T, 2> lens{x, y};
    const std::span<const T> k(bend, kMost);
    if (quotient) {
      const T r2 = x * x + y * y;
      const T l = r2 > T(0.0) ? detail::quotient_law(k, T(sqrt(r2))) : T(1.0);
      if (!(l > T(0.0))) return false;
      lens = {x / l, y / l};
    } else {
      lens = detail::brown_conrady_law(k, x, y);
    }
    const T& f = matrix[0];
    miss[0] = f * lens[0] + matrix[4] * lens[1] + matrix[2] - T(seen_px.x);
    miss[1] = f * matrix[1] * lens[1] + matrix[3] - T(seen_px.y);
    return true;
  }
};

struct Problem {
  const std::vector<TargetPoint>& points;
  const TargetOptions& options;
  std::vector<unsigned char> left_out;

  [[nodiscard]] std::vector<int> fixed_of_matrix() const {
    std::vector<int> fixed;
    if (!options.aspect) fixed.push_back(1);
    if (!options.principal_point) fixed.push_back(2), fixed.push_back(3);
    if (!options.skew) fixed.push_back(4);
    return fixed;
  }
  [[nodiscard]] std::vector<int> fixed_of_bend() const {
    std::vector<int> fixed;
    for (int i = options.coefficients; i < kMost; ++i) fixed.push_back(i);
    return fixed;
  }
  /// @param huber_px  beyond it residuals count linearly; 0: all count squared
  void build(ceres::Problem& to, Unknowns& x, double huber_px) const {
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (left_out[i] != 0) continue;
      const TargetPoint& p = points[i];
      auto* cost = new ceres::AutoDiffCostFunction<Miss, 2, kMatrix, kMost, 6>(
          new Miss{p.target_mm, p.seen_px, options.distortion == "quotient"});
      ceres::LossFunction* loss = huber_px > 0.0 ? new ceres::HuberLoss(huber_px) : nullptr;
      to.AddResidualBlock(cost, loss, x.matrix.data(), x.bend.data(),
                          x.poses[static_cast<std::size_t>(p.view)].data());
    }
    if (const auto fixed = fixed_of_matrix(); !fixed.empty())
      to.SetManifold(x.matrix.data(), new ceres::SubsetManifold(kMatrix, fixed));
    if (options.coefficients == 0)
      to.SetParameterBlockConstant(x.bend.data());
    else if (const auto fixed = fixed_of_bend(); !fixed.empty())
      to.SetManifold(x.bend.data(), new ceres::SubsetManifold(kMost, fixed));
  }
};

/// @return cost, or infinite
double solve(const Problem& problem, Unknowns& x, double huber_px) {
  ceres::Problem ceres_problem;
  problem.build(ceres_problem, x, huber_px);
  detail::quiet_ceres();
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  auto* order = new ceres::ParameterBlockOrdering;
  for (auto& pose : x.poses) order->AddElementToGroup(pose.data(), 0);
  order->AddElementToGroup(x.matrix.data(), 1);
  order->AddElementToGroup(x.bend.data(), 1);
  options.linear_solver_ordering.reset(order);
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  options.gradient_tolerance = 1e-16;
  options.parameter_tolerance = 1e-13;
  options.num_threads = 1;  // sums in one order
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  return summary.IsSolutionUsable() ? summary.final_cost : INFINITY;
}

std::vector<Vec2> misses(const Problem& problem, const Unknowns& x) {
  std::vector<Vec2> out;
  for (const TargetPoint& p : problem.points) {
    const Miss miss{p.target_mm, p.seen_px, problem.options.distortion == "quotient"};
    std::array<double, 2> m{INFINITY, INFINITY};
    (void)miss(x.matrix.data(), x.bend.data(), x.poses[static_cast<std::size_t>(p.view)].data(),
               m.data());
    out.push_back({-m[0], -m[1]});
  }
  return out;
}

/// Standard deviation of a coordinate by the median of all.
double robust_sigma(const Problem& problem, const std::vector<Vec2>& miss) {
  std::vector<double> all;
  for (std::size_t i = 0; i < miss.size(); ++i)
    if (problem.left_out[i] == 0)
      all.push_back(std::abs(miss[i].x)), all.push_back(std::abs(miss[i].y));
  const auto middle = all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2);
  std::nth_element(all.begin(), middle, all.end());
  return 1.4826 * *middle;
}

Result<std::vector<Spread>> check_points(const std::vector<TargetPoint>& points, int views,
                                         const TargetOptions& options) {
  const auto wrong = [](const std::string& what) { return fail(kCalibrationTargets, what); };
  std::vector<std::vector<Vec3>> by_view(static_cast<std::size_t>(views));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const TargetPoint& p = points[i];
    for (const double v : {p.target_mm.x, p.target_mm.y, p.target_mm.z, p.seen_px.x, p.seen_px.y})
      if (!std::isfinite(v))
        return wrong(fmt::format("point {} of picture {} has a coordinate that is not finite",
                                 i + 1, p.view + 1));
    by_view[static_cast<std::size_t>(p.view)].push_back(p.target_mm);
  }
  std::vector<Spread> spread;
  bool space = false;
  for (std::size_t v = 0; v < by_view.size(); ++v) {
    const auto& own = by_view[v];
    const std::size_t n = own.size();
    constexpr std::size_t kFewest = 4, kFewestInSpace = 6;
    if (n < kFewest)
      return wrong(
          fmt::format("picture {} has {} points; at least {} are needed, {} where they "
                      "lie in no plane",
                      v + 1, n, kFewest, kFewestInSpace));
    spread.push_back(detail::spread_of(own));
    if (spread.back() == Spread::line)
      return wrong(
          fmt::format("the {} points of picture {} lie on one line; spread them over a "
                      "plane or in space",
                      n, v + 1));
    if (spread.back() == Spread::space && n < kFewestInSpace) spread.back() = Spread::plane;
    space |= spread.back() == Spread::space;
  }
  if (views == 1 && !space)
    return wrong(
        "one picture of points in one plane: focal length and distance cannot be told apart; add "
        "pictures of the target at other angles, or points off the plane");
  const std::size_t unknown = kMatrix - Problem{points, options, {}}.fixed_of_matrix().size() +
                              static_cast<std::size_t>(options.coefficients) + 6 * by_view.size();
  if (2 * points.size() < unknown + 4)
    return wrong(
        fmt::format("{} points give {} numbers for {} unknowns; measure more points, or "
                    "ask for fewer coefficients",
                    points.size(), 2 * points.size(), unknown));
  return spread;
}

Result<void> check_options(const TargetOptions& o, const Intrinsics& start) {
  if (o.distortion != "brown_conrady" && o.distortion != "quotient")
    return fail(kEffectOutOfRange,
                fmt::format("targets.distortion is \"{}\"; brown_conrady or quotient is possible",
                            o.distortion));
  MAQUETTE_TRY_VOID(in_range("targets", "coefficients", o.coefficients, 0, kMost));
  return check(start);
}

/// Poses by homographies at a focal length, then everything but the focal length and distortion
/// free. @return nothing if a picture has no pose
std::optional<Unknowns> begin(const Problem& problem, const Intrinsics& start, double f_px,
                              const std::vector<Spread>& spread) {
  Unknowns x;
  x.matrix = {f_px, start.fy_px / start.fx_px, start.cx_px, start.cy_px, start.skew_px};
  Intrinsics k = start;
  k.fx_px = f_px, k.fy_px = f_px * x.matrix[1];
  for (std::size_t v = 0; v < spread.size(); ++v) {
    std::vector<Vec3> own;
    std::vector<Vec2> seen;
    for (const TargetPoint& p : problem.points)
      if (static_cast<std::size_t>(p.view) == v) {
        own.push_back(p.target_mm);
        seen.push_back(tangents(k, p.seen_px));
      }
    const auto pose = detail::pose_of(own, seen, spread[v]);
    if (!pose) return std::nullopt;
    const std::array<double, 4> q{pose->rotation.w, pose->rotation.x, pose->rotation.y,
                                  pose->rotation.z};
    auto& to = x.poses.emplace_back();
    ceres::QuaternionToAngleAxis(q.data(), to.data());
    to[3] = pose->translation_mm.x, to[4] = pose->translation_mm.y, to[5] = pose->translation_mm.z;
  }
  return x;
}

Result<void> set_covariance(const Problem& problem, Unknowns& x, TargetCalibration& out) {
  ceres::Problem ceres_problem;
  problem.build(ceres_problem, x, 0.0);
  ceres::Problem::EvaluateOptions options;
  options.parameter_blocks = {x.matrix.data()};
  if (problem.options.coefficients > 0) options.parameter_blocks.push_back(x.bend.data());
  for (auto& pose : x.poses) options.parameter_blocks.push_back(pose.data());
  ceres::CRSMatrix jacobian;
  std::vector<double> residuals;
  ceres_problem.Evaluate(options, nullptr, &residuals, nullptr, &jacobian);
  const detail::NormalMatrix normal(jacobian);
  double square = 0.0;
  for (const double v : residuals) square += v * v;
  const auto dof = static_cast<double>(residuals.size()) - static_cast<double>(jacobian.num_cols);
  out.noise_px = std::sqrt(square / std::max(1.0, dof));
  const auto shared = static_cast<Eigen::Index>(out.names.size());
  if (!normal.tells_all()) {
    Eigen::Index worst = 0;
    normal.solver.eigenvectors().col(0).head(shared).cwiseAbs().maxCoeff(&worst);
    return fail(kCalibrationTargets,
                fmt::format("the pictures do not say what {} is: other unknowns make up for it. "
                            "Take pictures at other angles and distances with the target all over "
                            "the picture, or leave it out of the estimate",
                            out.names[static_cast<std::size_t>(worst)]));
  }
  const Eigen::MatrixXd inverse = normal.inverse();
  for (Eigen::Index i = 0; i < shared; ++i) {
    auto& row = out.covariance.emplace_back();
    for (Eigen::Index j = 0; j < shared; ++j)
      row.push_back(out.noise_px * out.noise_px * normal.scale(i) * inverse(i, j) *
                    normal.scale(j));
  }
  return {};
}

void name_unknowns(TargetCalibration& out, const TargetOptions& o) {
  out.names = {"focal_px"};
  if (o.aspect) out.names.emplace_back("aspect");
  if (o.principal_point) out.names.emplace_back("cx_px"), out.names.emplace_back("cy_px");
  if (o.skew) out.names.emplace_back("skew_px");
  const std::array<const char*, kMost> brown{"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"};
  for (int i = 0; i < o.coefficients; ++i)
    out.names.push_back(o.distortion == "quotient" ? fmt::format("k{}", i + 1)
                                                   : brown[static_cast<std::size_t>(i)]);
}

void set_values(const Unknowns& x, const Intrinsics& start, const TargetOptions& o,
                TargetCalibration& out) {
  out.intrinsics = start;
  out.intrinsics.fx_px = x.matrix[0], out.intrinsics.fy_px = x.matrix[0] * x.matrix[1];
  out.intrinsics.cx_px = x.matrix[2], out.intrinsics.cy_px = x.matrix[3];
  out.intrinsics.skew_px = x.matrix[4];
  out.distortion.model = o.distortion;
  out.distortion.coefficients.assign(x.bend.begin(), x.bend.begin() + o.coefficients);
  const auto u = [&](const std::string& name) {
    const auto at = std::find(out.names.begin(), out.names.end(), name);
    if (at == out.names.end()) return 0.0;
    const auto i = static_cast<std::size_t>(at - out.names.begin());
    return std::sqrt(out.covariance[i][i]);
  };
  out.focal_px = {x.matrix[0], u("focal_px")};
  out.aspect = {x.matrix[1], u("aspect")};
  out.cx_px = {x.matrix[2], u("cx_px")}, out.cy_px = {x.matrix[3], u("cy_px")};
  out.skew_px = {x.matrix[4], u("skew_px")};
  const std::size_t first = out.names.size() - static_cast<std::size_t>(o.coefficients);
  for (std::size_t i = 0; i < static_cast<std::size_t>(o.coefficients); ++i)
    out.coefficients.push_back({x.bend[i], std::sqrt(out.covariance[first + i][first + i])});
}

void set_views(const Problem& problem, const Unknowns& x, const Vec3& middle_mm,
               TargetCalibration& out) {
  const std::vector<Vec2> miss = misses(problem, x);
  for (const auto& pose : x.poses) {
    std::array<double, 4> q{};
    ceres::AngleAxisToQuaternion(pose.data(), q.data());
    const RigidTransform centred{normalized(Quaternion{q[0], q[1], q[2], q[3]}),
                                 {pose[3], pose[4], pose[5]}};
    out.views.push_back(
        {{centred.rotation, centred.translation_mm - rotate(centred.rotation, middle_mm)}, 0, 0.0});
  }
  for (std::size_t i = 0; i < miss.size(); ++i) {
    const bool left = problem.left_out[i] != 0;
    out.residuals.push_back({i, miss[i], left});
    if (left) continue;
    TargetView& view = out.views[static_cast<std::size_t>(problem.points[i].view)];
    ++view.points;
    view.rms_px += miss[i].x * miss[i].x + miss[i].y * miss[i].y;
  }
  for (TargetView& v : out.views)
    v.rms_px = v.points == 0 ? 0.0 : std::sqrt(v.rms_px / static_cast<double>(v.points));
}

/// Leaves out points that are farther off than noise can be. @return whether any was
bool leave_out(Problem& problem, const Unknowns& x) {
  const std::vector<Vec2> miss = misses(problem, x);
  // Places are exact to rounding where a program made them; then nothing is an outlier.
  const double limit = std::max(kOutlier * robust_sigma(problem, miss), 1e-6);
  bool any = false;
  for (std::size_t i = 0; i < miss.size(); ++i) {
    const unsigned char out = std::abs(miss[i].x) > limit || std::abs(miss[i].y) > limit ? 1 : 0;
    any |= out != problem.left_out[i];
    problem.left_out[i] = out;
  }
  return any;
}

}  // namespace

Result<TargetCalibration> calibrate_targets(const std::vector<TargetPoint>& given,
                                            const Intrinsics& start, const TargetOptions& options) {
  MAQUETTE_TRY_VOID(check_options(options, start));
  if (given.empty()) return fail(kCalibrationTargets, "no points");
  // About their middle, so that rotations do not move them.
  Vec3 middle;
  int views = 0;
  for (const TargetPoint& p : given) {
    middle += (1.0 / static_cast<double>(given.size())) * p.target_mm;
    views = std::max(views, p.view + 1);
  }
  MAQUETTE_TRY(const std::vector<Spread> spread, check_points(given, views, options));
  std::vector<TargetPoint> points = given;
  for (TargetPoint& p : points) p.target_mm = p.target_mm - middle;
  Problem problem{points, options, std::vector<unsigned char>(points.size(), 0)};

  std::optional<Unknowns> best;
  double least = INFINITY;
  for (const double factor : {1.0, 0.7, 1.4, 0.5, 2.0, 0.3, 3.3}) {
    std::optional<Unknowns> x = begin(problem, start, factor * start.fx_px, spread);
    if (!x) continue;
    // Distortion last: a wrong focal length would bend it out of its range.
    TargetOptions straight = options;
    straight.coefficients = 0;
    const Problem first{points, straight, problem.left_out};
    if (!std::isfinite(solve(first, *x, 5.0))) continue;
    const double cost = solve(problem, *x, 5.0);
    if (cost < 0.99 * least) least = cost, best = x;
    constexpr double kRightPx = 1.0;  // no wrong minimum puts all points there
    if (robust_sigma(problem, misses(problem, *best)) < kRightPx) break;
  }
  if (!best)
    return fail(kCalibrationTargets,
                "no camera sees the points where they were seen: check that X, Y, Z are in mm of "
                "the target, u, v in pixels from the upper left corner, and that rows belong to "
                "their picture");
  Unknowns x = *best;
  const double scale = robust_sigma(problem, misses(problem, x));
  (void)solve(problem, x, std::max(2.0 * scale, 1e-9));
  for (int round = 0; round < 5 && leave_out(problem, x); ++round) (void)solve(problem, x, 0.0);
  if (!std::isfinite(solve(problem, x, 0.0)))
    return fail(kCalibrationTargets, "the adjustment of the points does not converge");
  TargetCalibration out;
  std::vector<TargetPoint> kept;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (problem.left_out[i] == 0) kept.push_back(points[i]);
  if (2 * kept.size() < points.size())
    return fail(kCalibrationTargets,
                fmt::format("{} of {} points do not lie where a camera would see them; check that "
                            "rows belong to their picture and point",
                            points.size() - kept.size(), points.size()));
  MAQUETTE_TRY_VOID(check_points(kept, views, options));
  name_unknowns(out, options);
  MAQUETTE_TRY_VOID(set_covariance(problem, x, out));
  set_values(x, start, options, out);
  set_views(problem, x, middle, out);
  return out;
}

}  // namespace maquette::camera
