// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/datums.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "scan/detail/registration_steps.hpp"

namespace maquette::scan {
namespace {

using detail::Foot;
using heightmap::ModelField;

constexpr std::size_t kLeastOnDatum = 10;
constexpr std::size_t kSample = 30'000;

/// Distance to the nearest of the datums, where it is within reach.
class DatumSurface : public detail::Surface {
 public:
  DatumSurface(const ModelField& design, std::span<const Datum> datums, double reach_mm)
      : design_(design), datums_(datums), reach_(reach_mm) {}

  [[nodiscard]] Foot on(const Datum& d, Vec3 p) const {
    Foot foot;
    const Vec3 arm = p - d.at_mm;
    if (d.kind == Datum::Kind::pad) {
      if (std::abs(arm.x) > d.half_x_mm || std::abs(arm.y) > d.half_y_mm) return {};
      design_.feet({&p, 1}, {&foot, 1});
    } else if (d.kind == Datum::Kind::sphere) {
      const double r = norm(arm);
      // The foot of the sphere's holder is no sphere: what lies below 0.8 radii is left out.
      if (!(r > 0.0) || arm.z < -0.8 * r) return {};
      foot = {r - d.radius_mm, (1.0 / r) * arm, 1.0};
    } else {
      const double along = dot(arm, d.axis);
      if (along < 0.0 || along > d.length_mm) return {};
      const Vec3 out = arm - along * d.axis;
      const double r = norm(out);
      if (!(r > 0.0)) return {};
      foot = {r - d.radius_mm, (1.0 / r) * out, 1.0};
    }
    return std::abs(foot.e_mm) <= reach_ ? foot : Foot{};
  }
  void feet(std::span<const Vec3> points, std::span<Foot> feet) const override {
    for (std::size_t i = 0; i < points.size(); ++i) {
      feet[i] = {};
      for (const Datum& d : datums_)
        if (const Foot f = on(d, points[i]);
            !std::isnan(f.e_mm) && !(std::abs(f.e_mm) >= std::abs(feet[i].e_mm)))
          feet[i] = f;
    }
  }

 private:
  detail::FieldSurface design_;
  std::span<const Datum> datums_;
  double reach_;
};

Result<void> check(const Datum& d) {
  const bool pad = d.kind == Datum::Kind::pad;
  if (pad && !(d.half_x_mm > 0.0 && d.half_y_mm > 0.0))
    return fail(kDatums, fmt::format("datum {}: a pad needs two sides above 0 mm", d.name));
  if (!pad && !(d.radius_mm > 0.0))
    return fail(kDatums,
                fmt::format("datum {}: radius must be above 0 mm, is {}", d.name, d.radius_mm));
  if (d.kind == Datum::Kind::dowel && !(d.length_mm > 0.0 && std::abs(norm(d.axis) - 1.0) < 1e-6))
    return fail(kDatums, fmt::format("datum {}: a dowel needs a length and a unit axis", d.name));
  return {};
}

}  // namespace

Result<DatumRegistration> register_datums(const Cloud& cloud, const ModelField& design,
                                          std::span<const Datum> datums,
                                          const RigidTransform& best_fit, double reach_mm,
                                          const RunContext& run) {
  if (datums.empty()) return fail(kDatums, "no datum is given");
  for (const Datum& d : datums) MAQUETTE_TRY_VOID(check(d));
  const DatumSurface surface(design, datums, reach_mm);
  // Only what can come to lie on a datum: within twice the reach of one, after the best fit.
  const DatumSurface wide(design, datums, 2.0 * reach_mm);
  const detail::Pose start{best_fit, 1.0};
  std::vector<Vec3> near;
  const detail::Met met = detail::meet(cloud.points_mm, start, wide);
  for (std::size_t i = 0; i < met.feet.size(); ++i)
    if (!std::isnan(met.feet[i].e_mm)) near.push_back(cloud.points_mm[i]);
  for (const Datum& d : datums) {
    const auto on = std::count_if(near.begin(), near.end(), [&](Vec3 q) {
      return !std::isnan(surface.on(d, start.point(q)).e_mm);
    });
    if (static_cast<std::size_t>(on) < kLeastOnDatum)
      return fail(kDatums,
                  fmt::format("datum {}: {} points lie within {} mm of it, at least {} are "
                              "needed; was it scanned, and is its place right?",
                              d.name, on, reach_mm, kLeastOnDatum));
  }
  const std::vector<Vec3> some = detail::sample(near, kSample);
  const detail::Frame frame = detail::spread_of(detail::meet(some, start, surface)).frame;
  detail::Level level;
  level.surface = &surface;
  level.spacing_mm = design.spacing.value();
  MAQUETTE_TRY(const detail::Rest rest, detail::come_to_rest(near, some, start, level, surface,
                                                             frame, RegisterOptions{}, run));
  DatumRegistration result;
  detail::state(result.registration, near, some, rest, surface, frame);
  std::size_t within = 0;
  for (const Datum& d : datums) {
    DatumFit fit{d.name, 0, 0.0, 0.0};
    std::vector<double> e;
    for (const Vec3& q : near)
      if (const double r = surface.on(d, rest.pose.point(q)).e_mm; !std::isnan(r)) {
        e.push_back(std::abs(r));
        fit.mean_mm += r;
      }
    fit.points = e.size();
    within += e.size();
    if (!e.empty()) {
      fit.mean_mm /= static_cast<double>(e.size());
      std::nth_element(e.begin(), e.begin() + static_cast<std::ptrdiff_t>(e.size() / 2), e.end());
      fit.noise_mm = 1.4826 * e[e.size() / 2];
    }
    result.datums.push_back(fit);
  }
  result.registration.noise_mm = detail::robust_scale(detail::meet(some, rest.pose, surface));
  result.registration.overlap =
      static_cast<double>(within) / static_cast<double>(std::max<std::size_t>(1, near.size()));
  result.registration.likeness = 1.0;
  return result;
}

Absorbed absorbed_by(const Registration& best_fit, const Registration& datums,
                     const ModelField& design) {
  const RigidTransform scan_from_model = best_fit.model_from_scan.inverse();
  const std::ptrdiff_t rows = design.z_mm.rows(), cols = design.z_mm.cols();
  const std::ptrdiff_t stride = std::max<std::ptrdiff_t>(1, std::max(rows, cols) / 200);
  const detail::FieldSurface surface(design);
  Absorbed a;
  a.min_mm = INFINITY, a.max_mm = -INFINITY;
  double n = 0.0;
  Vec3 middle, normal;
  for (std::ptrdiff_t r = 0; r < rows; r += stride)
    for (std::ptrdiff_t c = 0; c < cols; c += stride) {
      if (std::isnan(design.z_mm(r, c))) continue;
      const Vec3 p{design.x_mm(c), design.y_mm(r), static_cast<double>(design.z_mm(r, c))};
      Foot foot;
      surface.feet({&p, 1}, {&foot, 1});
      if (std::isnan(foot.e_mm)) continue;
      const Vec3 moved = datums.model_from_scan.point(scan_from_model.point(p)) - p;
      const double d = dot(moved, foot.normal);
      a.mean_mm += d;
      a.rms_mm += d * d;
      a.min_mm = std::fmin(a.min_mm, d);
      a.max_mm = std::fmax(a.max_mm, d);
      middle += p;
      normal += foot.normal;
      n += 1.0;
    }
  if (n == 0.0) return {};
  a.mean_mm /= n;
  a.rms_mm = std::sqrt(a.rms_mm / n);
  middle = (1.0 / n) * middle;
  normal = normalized(normal);
  a.sigma_mm =
      std::hypot(pose_sigma_mm(best_fit, middle, normal), pose_sigma_mm(datums, middle, normal));
  return a;
}

}  // namespace maquette::scan
