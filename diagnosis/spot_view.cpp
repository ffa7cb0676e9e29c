// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/spot_view.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/smoothed.hpp"
#include "heightmap/field_tracer.hpp"

namespace maquette::diagnosis {
namespace {

constexpr double kSteepest = 5.0;  // change of range across the beam of what is one surface, mm/mm

/// Marks everything within `reach` nodes of a marked node along rows, or columns.
Grid<std::uint8_t> widened(const Grid<std::uint8_t>& in, std::ptrdiff_t reach, bool along_rows) {
  Grid<std::uint8_t> out(in.rows(), in.cols(), 0);
  const std::ptrdiff_t lines = along_rows ? in.rows() : in.cols(),
                       length = along_rows ? in.cols() : in.rows();
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, lines, [&](std::ptrdiff_t line) {
    const auto at = [&](auto& grid, std::ptrdiff_t i) -> auto& {
      return along_rows ? grid(line, i) : grid(i, line);
    };
    std::ptrdiff_t until = -1;  // marked up to here
    for (std::ptrdiff_t i = 0; i < length; ++i) {
      if (at(in, i) == 0) continue;
      const std::ptrdiff_t end = std::min(length - 1, i + reach);
      for (std::ptrdiff_t k = std::max(until + 1, i - reach); k <= end; ++k) at(out, k) = 1;
      until = end;
    }
  });
  return out;
}

Grid<std::uint8_t> ends(const heightmap::ModelField& range, double within_mm) {
  const Grid<float>& z = range.z_mm;
  const auto step = static_cast<float>(kSteepest * range.spacing.value());
  Grid<std::uint8_t> marked(z.rows(), z.cols(), 0);
  const auto apart = [&](float a, float b) {
    return !(std::abs(a - b) <= step) && !(std::isnan(a) && std::isnan(b));
  };
  for (std::ptrdiff_t r = 0; r + 1 < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c + 1 < z.cols(); ++c)
      marked(r, c) = apart(z(r, c), z(r, c + 1)) || apart(z(r, c), z(r + 1, c));
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(within_mm / range.spacing.value()));
  return widened(widened(marked, reach, true), reach, false);
}

}  // namespace

SpotView::SpotView(const heightmap::ModelField& surface, const heightmap::FieldTracer& tracer,
                   const Box3& box, Vec3 station, double most_pixels)
    : station_(station) {
  const Vec3 middle = 0.5 * (box.min + box.max);
  distance_mm_ = norm(middle - station);
  axis_ = (1.0 / distance_mm_) * (middle - station);
  across_ = normalized(cross(axis_, std::abs(axis_.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{1, 0, 0}));
  up_ = cross(axis_, across_);
  double u0 = INFINITY, u1 = -INFINITY, v0 = INFINITY, v1 = -INFINITY;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 p{corner & 1 ? box.max.x : box.min.x, corner & 2 ? box.max.y : box.min.y,
                 corner & 4 ? box.max.z : box.min.z};
    const Vec3 d = p - station;
    const double deep = dot(d, axis_);
    if (!(deep > 0.05 * distance_mm_)) continue;  // beside or behind: a station over a wide part
    const double u = distance_mm_ * dot(d, across_) / deep, v = distance_mm_ * dot(d, up_) / deep;
    u0 = std::fmin(u0, u), u1 = std::fmax(u1, u);
    v0 = std::fmin(v0, v), v1 = std::fmax(v1, v);
  }
  if (!(u1 > u0) || !(v1 > v0)) return;
  const double pixel =
      std::fmax(surface.spacing.value(), std::fmax(u1 - u0, v1 - v0) / most_pixels);
  // A pixel more on each side: the surface ends within the view.
  heightmap::ModelField range{Grid<float>(static_cast<std::ptrdiff_t>((v1 - v0) / pixel) + 4,
                                          static_cast<std::ptrdiff_t>((u1 - u0) / pixel) + 4, NAN),
                              Millimetres{pixel}, Millimetres{u0 - pixel}, Millimetres{v0 - pixel}};
  // Less the distance of the middle, or single precision would round to 0.1 um.
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, range.z_mm.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < range.z_mm.cols(); ++c)
      if (const auto hit = tracer.trace(
              station,
              normalized(distance_mm_ * axis_ + range.x_mm(c) * across_ + range.y_mm(r) * up_)))
        range.z_mm(r, c) = static_cast<float>(hit->distance_mm - distance_mm_);
  });
  end_mm_ = std::fmin(kEnd_mm, kEndShare * std::fmax(box.max.x - box.min.x, box.max.y - box.min.y));
  ends_ = ends(range, end_mm_);
  const double ratio = kSpotWidths_mm[1] / kSpotWidths_mm[0];
  for (std::size_t k = 0; k < kImages; ++k) {
    width_mm_[k] = k == 0             ? kSpotWidths_mm.front() / ratio
                   : k + 1 == kImages ? kSpotWidths_mm.back() * ratio
                                      : kSpotWidths_mm[k - 1];
  }
  auto widths_pixels = width_mm_;
  for (double& width : widths_pixels) width /= pixel;
  auto mean = detail::smoothed(range.z_mm, widths_pixels);
  for (std::size_t k = 0; k < kImages; ++k)
    mean_[k] = {std::move(mean[k]), range.spacing, range.x0, range.y0};
}

bool SpotView::project(Vec3 place, double& u, double& v) const {
  const Vec3 d = place - station_;
  const double deep = dot(d, axis_);
  if (!(deep > 0.05 * distance_mm_) || mean_[0].z_mm.rows() < 2) return false;
  u = distance_mm_ * dot(d, across_) / deep;
  v = distance_mm_ * dot(d, up_) / deep;
  return true;
}

bool SpotView::at_an_end(Vec3 place) const {
  double u = 0.0, v = 0.0;
  if (!project(place, u, v)) return false;
  const double pixel = mean_[0].spacing.value();
  const auto r = std::lround((v - mean_[0].y0.value()) / pixel),
             c = std::lround((u - mean_[0].x0.value()) / pixel);
  return ends_.contains(r, c) && ends_(r, c) != 0;
}

std::array<float, kSpotWidths_mm.size()> SpotView::further(Vec3 place) const {
  std::array<float, kSpotWidths_mm.size()> all{};
  double u = 0.0, v = 0.0;
  if (!project(place, u, v)) return all;
  const double range = norm(place - station_), deep = dot(place - station_, axis_);
  std::array<double, kImages> further{};
  for (std::size_t k = 0; k < kImages; ++k) {
    further[k] = heightmap::height_at(mean_[k], u, v) + distance_mm_ - range;
    if (!std::isfinite(further[k])) return all;
  }
  // A pixel is smaller across the beam by the cosine off the axis, along one side by its square:
  // on average by its power of 3/2. In the images spots of this range are that much wider.
  const double scale = distance_mm_ / range * std::pow(range / deep, 1.5);
  for (std::size_t j = 0; j < all.size(); ++j) {
    const double width = kSpotWidths_mm[j] * scale;
    std::size_t k = 1;
    while (k + 1 < kImages && width_mm_[k] < width) ++k;
    const double a = width_mm_[k - 1] * width_mm_[k - 1], b = width_mm_[k] * width_mm_[k],
                 share = (width * width - a) / (b - a);
    all[j] = static_cast<float>(further[k - 1] + share * (further[k] - further[k - 1]));
  }
  return all;
}

}  // namespace maquette::diagnosis
