// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/surface.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include "core/median.hpp"
#include "diagnosis/cast_shadow.hpp"
#include "diagnosis/detail/smoothed.hpp"
#include "diagnosis/spot_view.hpp"

namespace maquette::diagnosis {
namespace {
using heightmap::ModelField;
constexpr double kMostNodes =
    2400.0;  // of a side, of the grids that films and spots are taken from

}  // namespace

Scene scene_of(const ModelField& design, const CutPath* path, double ball_radius_mm) {
  Scene scene;
  const auto heights = heightmap::height_range(design.z_mm);
  scene.box.add({design.x0.value(), design.y0.value(), static_cast<double>(heights.min)});
  scene.box.add({design.x_mm(design.z_mm.cols() - 1), design.y_mm(design.z_mm.rows() - 1),
                 static_cast<double>(heights.max)});
  scene.ball_radius_mm = ball_radius_mm;
  scene.shadow = cast_shadows(design);
  if (path == nullptr) return scene;
  scene.has_path = true;
  scene.duration_min = path->duration_min();
  scene.cut_mm = path->cut_mm();
  scene.section_starts = path->section_starts();
  scene.slack = [of = *path](double width_mm) { return of.slack(width_mm); };
  scene.lag = [of = *path](double lag_mm) { return of.lag(lag_mm); };
  scene.above = [of = *path](double x, double y) { return of.above(x, y); };
  scene.slack_with_lag = [of = *path](int axis, double width_mm, double lag_mm, bool lag_first) {
    return of.slack_with_lag(axis, width_mm, lag_mm, lag_first);
  };
  return scene;
}

std::optional<SimulatedSurface::Place> SimulatedSurface::at(double x, double y,
                                                            std::vector<Rival>* rivals) const {
  const double z = heightmap::height_at(design_, x, y);
  if (std::isnan(z)) return std::nullopt;
  if (path_ == nullptr) {
    const double h = 0.5 * design_.spacing.value();
    const double x0 = design_.x0.value(), x1 = design_.x_mm(design_.z_mm.cols() - 1);
    const double y0 = design_.y0.value(), y1 = design_.y_mm(design_.z_mm.rows() - 1);
    const double xa = std::fmax(x0, x - h), xb = std::fmin(x1, x + h);
    const double ya = std::fmax(y0, y - h), yb = std::fmin(y1, y + h);
    const double gx =
        (heightmap::height_at(design_, xb, y) - heightmap::height_at(design_, xa, y)) / (xb - xa);
    const double gy =
        (heightmap::height_at(design_, x, yb) - heightmap::height_at(design_, x, ya)) / (yb - ya);
    if (std::isnan(gx) || std::isnan(gy)) return std::nullopt;
    return Place{z, normalized(Vec3{-gx, -gy, 1.0}), std::nullopt, z};
  }
  auto contact = path_->at(x, y, rivals);
  if (!contact) return std::nullopt;
  return Place{contact->height_mm, contact->normal, contact, z};
}

SimulatedSurface::SimulatedSurface(const ModelField& design, const CutPath* path, const RunContext&)
    : design_(design), path_(path), pass_(path == nullptr ? nullptr : path->pass()) {
  const double wide = design.x_mm(design.z_mm.cols() - 1) - design.x0.value();
  const double high = design.y_mm(design.z_mm.rows() - 1) - design.y0.value();
  // Half the design's spacing: between passes as well as on them, or ridges would be missed.
  const double step = std::fmax(0.5 * design.spacing.value(), std::fmax(wide, high) / kMostNodes);
  ModelField cut{Grid<float>(static_cast<std::ptrdiff_t>(high / step) + 1,
                             static_cast<std::ptrdiff_t>(wide / step) + 1, NAN),
                 Millimetres{step}, design.x0, design.y0};
  Grid<float> off(cut.z_mm.rows(), cut.z_mm.cols(), NAN);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, cut.z_mm.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cut.z_mm.cols(); ++c) {
      const double x = cut.x_mm(c), y = cut.y_mm(r);
      const double wanted = heightmap::height_at(design_, x, y);
      if (std::isnan(wanted)) continue;
      const auto made = path_ == nullptr ? std::optional(wanted) : path_->height(x, y);
      if (!made) continue;
      cut.z_mm(r, c) = static_cast<float>(*made);
      off(r, c) = static_cast<float>(*made - wanted);
    }
  });
  std::vector<double> d;
  for (const float v : off.cells())
    if (!std::isnan(v)) d.push_back(static_cast<double>(v));
  cut_share_ = static_cast<double>(d.size()) / static_cast<double>(off.cells().size());
  misfit_ = d.empty() ? INFINITY : nmad(std::move(d));
  auto lengths_nodes = kFilmLengths_mm;
  for (double& length : lengths_nodes) length /= step;
  auto smooth = detail::smoothed(cut.z_mm, lengths_nodes);
  for (std::size_t k = 0; k < smooth_.size(); ++k)
    smooth_[k] = {std::move(smooth[k]), cut.spacing, cut.x0, cut.y0};
  cut_ = std::move(cut);
  tracer_.emplace(cut_);
}

std::optional<Observation> SimulatedSurface::observe(double x, double y) const {
  auto rivals = std::make_shared<std::vector<Rival>>();
  const auto place = at(x, y, rivals.get());
  if (!place) return std::nullopt;
  Observation o;
  o.place = o.tip = {x, y, place->height_mm};
  o.normal = o.along = place->normal;
  o.milled_minus_design_mm =
      std::clamp((place->height_mm - place->design_mm) * place->normal.z, -0.2, 0.2);
  if (place->contact) {
    static_cast<CutState&>(o) = *place->contact;
    o.rivals = std::move(rivals);
    o.pass = pass_;
  }
  o.slope_normal = slope_normal(x, y).value_or(o.normal);
  o.curvature_per_mm = curvature_per_mm(x, y);
  if (place->contact)
    o.level_tip = o.place + path_->ball_radius_mm() * (o.slope_normal - Vec3{0.0, 0.0, 1.0});
  o.levelled = levelled(x, y, o.place.z);
  return o;
}

std::optional<Vec3> SimulatedSurface::slope_normal(double x, double y) const {
  const ModelField& f = smooth_[0];
  const double h = f.spacing.value();
  const auto z = [&](double dx, double dy) { return heightmap::height_at(f, x + dx, y + dy); };
  const double gx = (z(h, 0.0) - z(-h, 0.0)) / (2.0 * h), gy = (z(0.0, h) - z(0.0, -h)) / (2.0 * h);
  if (std::isnan(gx) || std::isnan(gy)) return std::nullopt;
  return normalized(Vec3{-gx, -gy, 1.0});
}

std::array<float, 3> SimulatedSurface::curvature_per_mm(double x, double y) const {
  // Between nodes heights run straight on: over less than two of them that would be a kink or none.
  const ModelField& f = smooth_[0];
  const double h = std::fmax(kFilmLengths_mm[0], 2.0 * f.spacing.value());
  const auto z = [&](double dx, double dy) { return heightmap::height_at(f, x + dx, y + dy); };
  const double middle = z(0.0, 0.0), xx = (z(h, 0.0) - 2.0 * middle + z(-h, 0.0)) / (h * h),
               yy = (z(0.0, h) - 2.0 * middle + z(0.0, -h)) / (h * h),
               xy = (z(h, h) - z(h, -h) - z(-h, h) + z(-h, -h)) / (4.0 * h * h);
  if (!std::isfinite(xx + yy + xy)) return {};
  return {static_cast<float>(xx), static_cast<float>(xy), static_cast<float>(yy)};
}

std::array<float, kFilmLengths_mm.size()> SimulatedSurface::levelled(double x, double y,
                                                                     double height) const {
  std::array<float, kFilmLengths_mm.size()> all{};
  for (std::size_t k = 0; k < all.size(); ++k) {
    const double d = heightmap::height_at(smooth_[k], x, y) - height;
    if (std::isfinite(d)) all[k] = static_cast<float>(d);
  }
  return all;
}

SpotView SimulatedSurface::spots(Vec3 station) const {
  const auto heights = heightmap::height_range(cut_.z_mm);
  Box3 box;
  box.add({cut_.x0.value(), cut_.y0.value(), static_cast<double>(heights.min)});
  box.add({cut_.x_mm(cut_.z_mm.cols() - 1), cut_.y_mm(cut_.z_mm.rows() - 1),
           static_cast<double>(heights.max)});
  return {cut_, *tracer_, box, station, kMostNodes};
}

std::optional<double> SimulatedSurface::range_mm(Vec3 station, Vec3 beam) const {
  const auto hit = tracer_->trace(station, beam);
  return hit ? std::optional(hit->distance_mm) : std::nullopt;
}

}  // namespace maquette::diagnosis
