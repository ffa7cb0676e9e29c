// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/surface_distance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/check.hpp"
#include "core/triangle_distance.hpp"

namespace maquette::scan {

using heightmap::ModelField;

namespace {

struct Search {
  const ModelField& field;
  Vec3 p;
  double best2;

  void cell(std::ptrdiff_t r, std::ptrdiff_t c) {
    const double x0 = field.x_mm(c), x1 = field.x_mm(c + 1);
    const double y0 = field.y_mm(r), y1 = field.y_mm(r + 1);
    const double gx = std::max({x0 - p.x, p.x - x1, 0.0});
    const double gy = std::max({y0 - p.y, p.y - y1, 0.0});
    const double beside2 = gx * gx + gy * gy;
    if (!(beside2 < best2)) return;  // most cells of a ring
    const float* lower = &field.z_mm(r, c);
    const float* upper = &field.z_mm(r + 1, c);
    float low = INFINITY, high = -INFINITY;
    for (const float h : {lower[0], lower[1], upper[0], upper[1]}) {
      low = std::min(low, h);  // in this order NaN is passed over
      high = std::max(high, h);
    }
    const double gz =
        std::max({static_cast<double>(low) - p.z, p.z - static_cast<double>(high), 0.0});
    if (!(beside2 + gz * gz < best2)) return;
    const Vec3 a{x0, y0, static_cast<double>(lower[0])};
    const Vec3 b{x1, y0, static_cast<double>(lower[1])};
    const Vec3 d{x1, y1, static_cast<double>(upper[1])};
    const Vec3 e{x0, y1, static_cast<double>(upper[0])};
    if (const double right = triangle_distance2(p, a, b, d); right < best2) best2 = right;
    if (const double left = triangle_distance2(p, a, d, e); left < best2) best2 = left;
  }

  /// The cell (r, c) that the point is in, as far as the plane is concerned. The triangle over or
  /// under the point comes first: the other is no nearer than the diagonal is beside the point,
  /// which in most cases ends the matter.
  void own_cell(std::ptrdiff_t r, std::ptrdiff_t c) {
    const double x0 = field.x_mm(c), x1 = field.x_mm(c + 1);
    const double y0 = field.y_mm(r), y1 = field.y_mm(r + 1);
    const float* lower = &field.z_mm(r, c);
    const float* upper = &field.z_mm(r + 1, c);
    const Vec3 a{x0, y0, static_cast<double>(lower[0])};
    const Vec3 d{x1, y1, static_cast<double>(upper[1])};
    const Vec3 b{x1, y0, static_cast<double>(lower[1])};
    const Vec3 e{x0, y1, static_cast<double>(upper[0])};
    const double across = (p.x - x0) - (p.y - y0);
    const bool right = across >= 0.0;
    if (const double d2 = right ? triangle_distance2(p, a, b, d) : triangle_distance2(p, a, d, e);
        d2 < best2)
      best2 = d2;
    if (0.5 * across * across >= best2) return;
    if (const double d2 = right ? triangle_distance2(p, a, d, e) : triangle_distance2(p, a, b, d);
        d2 < best2)
      best2 = d2;
  }

  /// The eight cells around (r, c), those only whose side or corner is near enough: with points
  /// nearer to the surface than a spacing mostly none.
  void neighbours(std::ptrdiff_t r, std::ptrdiff_t c) {
    const std::ptrdiff_t last_r = field.z_mm.rows() - 2, last_c = field.z_mm.cols() - 2;
    const auto square = [](double gap) { return gap * gap; };
    constexpr double kNone = std::numeric_limits<double>::infinity();
    const double west = c > 0 ? square(p.x - field.x_mm(c)) : kNone;
    const double east = c < last_c ? square(field.x_mm(c + 1) - p.x) : kNone;
    const double south = r > 0 ? square(p.y - field.y_mm(r)) : kNone;
    const double north = r < last_r ? square(field.y_mm(r + 1) - p.y) : kNone;
    if (west < best2) cell(r, c - 1);
    if (east < best2) cell(r, c + 1);
    if (south < best2) cell(r - 1, c);
    if (north < best2) cell(r + 1, c);
    if (south + west < best2) cell(r - 1, c - 1);
    if (south + east < best2) cell(r - 1, c + 1);
    if (north + west < best2) cell(r + 1, c - 1);
    if (north + east < best2) cell(r + 1, c + 1);
  }

  /// Cells of the square ring at distance k from (r, c) that lie in the field.
  void ring(std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t k) {
    const std::ptrdiff_t last_r = field.z_mm.rows() - 2, last_c = field.z_mm.cols() - 2;
    const std::ptrdiff_t c0 = std::max(c - k, std::ptrdiff_t{0}), c1 = std::min(c + k, last_c);
    for (const std::ptrdiff_t row : {r - k, r + k})
      if (row >= 0 && row <= last_r)
        for (std::ptrdiff_t col = c0; col <= c1; ++col) cell(row, col);
    const std::ptrdiff_t r0 = std::max(r - k + 1, std::ptrdiff_t{0});
    const std::ptrdiff_t r1 = std::min(r + k - 1, last_r);
    for (const std::ptrdiff_t col : {c - k, c + k})
      if (col >= 0 && col <= last_c)
        for (std::ptrdiff_t row = r0; row <= r1; ++row) cell(row, col);
  }
};

}  // namespace

double signed_distance_mm(const ModelField& field, Vec3 p, double reach_mm) {
  const std::ptrdiff_t rows = field.z_mm.rows(), cols = field.z_mm.cols();
  const double x0 = field.x0.value(), x1 = field.x_mm(cols - 1);
  const double y0 = field.y0.value(), y1 = field.y_mm(rows - 1);
  const double wall = std::min({p.x - x0, x1 - p.x, p.y - y0, y1 - p.y});
  if (!(wall >= -kOutlineSlackMm)) return NAN;
  const double x = std::clamp(p.x, x0, x1), y = std::clamp(p.y, y0, y1);
  const double above = p.z - heightmap::height_at(field, x, y);
  if (std::isnan(above)) return NAN;

  // The point of the surface straight below or above bounds the distance.
  const double s = field.spacing.value();
  Search search{field, p, std::min(above * above, reach_mm * reach_mm * (1.0 + 1e-12))};
  if (p.x != x || p.y != y) search.best2 = reach_mm * reach_mm * (1.0 + 1e-12);
  const double start2 = search.best2;
  const double u = (x - x0) / s, v = (y - y0) / s;
  const auto c = static_cast<std::ptrdiff_t>(std::min(u, static_cast<double>(cols - 2)));
  const auto r = static_cast<std::ptrdiff_t>(std::min(v, static_cast<double>(rows - 2)));
  search.own_cell(r, c);
  const double du = u - static_cast<double>(c), dv = v - static_cast<double>(r);
  const double inner = s * std::min({du, 1.0 - du, dv, 1.0 - dv});
  const std::ptrdiff_t rings = std::max(rows, cols);
  search.neighbours(r, c);
  for (std::ptrdiff_t k = 2; k < rings; ++k) {
    const double least = inner + s * static_cast<double>(k - 1);  // to any cell of this ring
    if (least > 0.0 && least * least >= search.best2) break;
    search.ring(r, c, k);
  }
  if (search.best2 == start2 && !(above * above <= start2)) return NAN;  // nothing within reach
  const double distance = std::sqrt(search.best2);
  if (above < -s && wall < distance) return NAN;
  return above < 0.0 ? -distance : distance;
}

void signed_distances_mm(const ModelField& field, std::span<const Vec3> points, double reach_mm,
                         std::span<double> distances) {
  MAQUETTE_CHECK(points.size() == distances.size(), "{} points, {} distances", points.size(),
                 distances.size());
  // Heights are asked for this many points before they are wanted: memory answers many at a time,
  // but branches that depend on one height keep the processor from asking for the next.
  constexpr std::size_t kAhead = 12;
  const double per_mm = 1.0 / field.spacing.value();
  const auto fetch = [&](Vec3 p) {
    const double u = (p.x - field.x0.value()) * per_mm, v = (p.y - field.y0.value()) * per_mm;
    if (!(u >= 0.0 && v >= 0.0 && u < static_cast<double>(field.z_mm.cols()) &&
          v < static_cast<double>(field.z_mm.rows() - 1)))
      return;
    const float* lower =
        &field.z_mm(static_cast<std::ptrdiff_t>(v), static_cast<std::ptrdiff_t>(u));
    __builtin_prefetch(lower);
    __builtin_prefetch(lower + field.z_mm.cols());
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i + kAhead < points.size()) fetch(points[i + kAhead]);
    distances[i] = signed_distance_mm(field, points[i], reach_mm);
  }
}

}  // namespace maquette::scan
