// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/scallop.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::cnc {

double ridge_mm(BallNose tool, double centre_distance) {
  return centre_distance >= 2.0 * tool.radius_mm ? tool.radius_mm
                                                 : scallop_mm(tool, centre_distance);
}

double stated_scallop_mm(BallNose tool, double stepover_mm, double slope) {
  const double R = tool.radius_mm, steep = std::sqrt(1.0 + slope * slope),
               half = 0.5 * stepover_mm * steep;
  if (!(half < R)) return INFINITY;
  return (R - std::sqrt(R * R - half * half)) * steep;
}

double centre_distance_of_ridge_mm(BallNose tool, double ridge) {
  return 2.0 * std::sqrt(ridge * (2.0 * tool.radius_mm - ridge));
}

int halvings(double centre_distance, double allowed, int most) {
  int n = 0;
  for (; n < most && centre_distance > allowed * (1.0 + 1e-9); ++n) centre_distance *= 0.5;
  return n;
}

ScallopCollector::ScallopCollector(const heightmap::ModelField& design, double limit_mm,
                                   double least_mm)
    : limit_mm_(limit_mm) {
  constexpr double kHair_mm = 1e-6;
  low_ = {design.x0.value() - kHair_mm, design.y0.value() - kHair_mm, 0.0};
  high_ = {design.x_mm(design.z_mm.cols() - 1) + kHair_mm,
           design.y_mm(design.z_mm.rows() - 1) + kHair_mm, 0.0};
  const double width = design.x_mm(design.z_mm.cols() - 1) - design.x0.value();
  const double depth = design.y_mm(design.z_mm.rows() - 1) - design.y0.value();
  const double spacing = std::max(std::max(width, depth) / 1000.0, least_mm);
  heightmap::ModelField& field = map_.predicted_mm;
  field.x0 = design.x0;
  field.y0 = design.y0;
  field.spacing = Millimetres{spacing};
  const auto nodes = [spacing](double length) {
    return static_cast<std::ptrdiff_t>(std::ceil(length / spacing - 1e-9)) + 1;
  };
  field.z_mm = Grid<float>(nodes(depth), nodes(width), NAN);
}

void ScallopCollector::add(double x_mm, double y_mm, double ridge_mm, double area_mm2) {
  if (x_mm < low_.x || x_mm > high_.x || y_mm < low_.y || y_mm > high_.y) return;
  heightmap::ModelField& field = map_.predicted_mm;
  const auto nearest = [](double t, std::ptrdiff_t count) {
    return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::lround(t)), 0, count - 1);
  };
  float& z =
      field.z_mm(nearest((y_mm - field.y0.value()) / field.spacing.value(), field.z_mm.rows()),
                 nearest((x_mm - field.x0.value()) / field.spacing.value(), field.z_mm.cols()));
  const auto ridge = static_cast<float>(ridge_mm);
  if (!(z >= ridge)) z = ridge;
  map_.highest_mm = std::max(map_.highest_mm, ridge_mm);
  sum_ += ridge_mm * area_mm2;
  area_mm2_ += area_mm2;
  if (ridge_mm > limit_mm_ * (1.0 + 1e-9)) above_mm2_ += area_mm2;
}

ScallopMap ScallopCollector::finish() && {
  if (area_mm2_ > 0.0) {
    map_.mean_mm = sum_ / area_mm2_;
    map_.share_above_limit = above_mm2_ / area_mm2_;
  }
  return std::move(map_);
}

}  // namespace maquette::cnc
