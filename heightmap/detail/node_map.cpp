// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/node_map.hpp"

#include <cmath>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::heightmap::detail {
namespace {

constexpr double kWorstPixels = 0.005;

/// Lagrange weights on -1, 0, 1.
std::array<double, 3> quadratic(double t) {
  return {0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)};
}

double biquadratic(const std::array<double, 9>& f, const std::array<double, 3>& wx,
                   const std::array<double, 3>& wy) {
  return wy[0] * (wx[0] * f[0] + wx[1] * f[1] + wx[2] * f[2]) +
         wy[1] * (wx[0] * f[3] + wx[1] * f[4] + wx[2] * f[5]) +
         wy[2] * (wx[0] * f[6] + wx[1] * f[7] + wx[2] * f[8]);
}

std::array<double, 4> keys(double t) {
  const double s = 1.0 - t;
  return {-0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + s * s * (1.5 * s - 2.5),
          -0.5 * s * t * t};
}

double bilinear_over_valid(const Grid<float>& h, std::ptrdiff_t r, std::ptrdiff_t c, double s,
                           double t) {
  const std::ptrdiff_t nearest_r = r + (t >= 0.5 ? 1 : 0);
  const std::ptrdiff_t nearest_c = c + (s >= 0.5 ? 1 : 0);
  if (std::isnan(h(nearest_r, nearest_c))) return NAN;
  const double w[4] = {(1 - t) * (1 - s), (1 - t) * s, t * (1 - s), t * s};
  const float z[4] = {h(r, c), h(r, c + 1), h(r + 1, c), h(r + 1, c + 1)};
  double sum = 0.0, weight = 0.0;
  for (int i = 0; i < 4; ++i) {
    if (std::isnan(z[i])) continue;
    sum += w[i] * static_cast<double>(z[i]);
    weight += w[i];
  }
  return sum / weight;  // the nearest weighs at least 1/4
}

}  // namespace

double sample_window(const PixelWindow& window, double u, double v) {
  const Grid<float>& h = window.height_m;
  const double s = (u - window.u0) / window.step_u - 0.5;
  const double t = (v - window.v0) / window.step_v - 0.5;
  const double cs = std::floor(s), rt = std::floor(t);
  if (!(cs >= 1.0 && rt >= 1.0 && cs < static_cast<double>(h.cols() - 2) &&
        rt < static_cast<double>(h.rows() - 2)))
    return NAN;
  const auto c = static_cast<std::ptrdiff_t>(cs);
  const auto r = static_cast<std::ptrdiff_t>(rt);
  const auto wx = keys(s - cs), wy = keys(t - rt);
  double sum = 0.0;
  for (std::ptrdiff_t j = 0; j < 4; ++j) {
    const float* row = &h(r - 1 + j, c - 1);
    double line = 0.0;
    for (std::ptrdiff_t i = 0; i < 4; ++i)
      line += wx[static_cast<std::size_t>(i)] * static_cast<double>(row[i]);
    sum += wy[static_cast<std::size_t>(j)] * line;
  }
  return std::isnan(sum) ? bilinear_over_valid(h, r, c, s - cs, t - rt) : sum;
}

namespace {

float nearest_in(const PixelWindow& window, double u, double v) {
  const auto c = static_cast<std::ptrdiff_t>(std::floor((u - window.u0) / window.step_u));
  const auto r = static_cast<std::ptrdiff_t>(std::floor((v - window.v0) / window.step_v));
  return window.height_m.contains(r, c) ? window.height_m(r, c) : NAN;
}

PixelSize pixel_size_at(const DemReader& dem, const SiteFrame& site, double x0, double y0) {
  constexpr double kStep = 0.5;  // metres; the map is linear over such a distance
  const double x[4] = {x0 - kStep, x0 + kStep, x0, x0}, y[4] = {y0, y0, y0 - kStep, y0 + kStep};
  double lat[4], lon[4], u[4], v[4];
  for (int i = 0; i < 4; ++i) {
    const BodyPoint p = site.below(x[i], y[i]);
    lat[i] = p.latitude_deg;
    lon[i] = p.longitude_deg;
  }
  dem.to_pixels(lat, lon, u, v);
  const double ux = u[1] - u[0], uy = u[3] - u[2], vx = v[1] - v[0], vy = v[3] - v[2];
  const double det = std::abs(ux * vy - uy * vx);
  return {std::hypot(vx, vy) / det, std::hypot(ux, uy) / det};
}

}  // namespace

PixelSize pixel_size(const DemReader& dem, const SiteFrame& site, double aside_m) {
  const PixelSize here = pixel_size_at(dem, site, 0.0, 0.0);
  if (std::isfinite(here.longer_m()) && here.longer_m() > 0.0 && here.longer_m() < 1e7) return here;
  return pixel_size_at(dem, site, 0.8 * aside_m, 0.6 * aside_m);
}

void NodeMap::Bounds::add(double u, double v) {
  if (!std::isfinite(u) || !std::isfinite(v)) return;
  u_min = std::min(u_min, u);
  u_max = std::max(u_max, u);
  v_min = std::min(v_min, v);
  v_max = std::max(v_max, v);
}

NodeMap::NodeMap(const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes,
                 const Origin& origin)
    : dem_(&dem), site_(&site), nodes_(nodes), origin_(origin) {
  tile_rows_ = (nodes.rows + kTile - 1) / kTile;
  tile_cols_ = (nodes.cols + kTile - 1) / kTile;
  tiles_.resize(static_cast<std::size_t>(tile_rows_ * tile_cols_));
  row_bounds_.resize(static_cast<std::size_t>(tile_rows_));
}

void NodeMap::walk(const std::vector<double>& x, const std::vector<double>& y,
                   std::array<std::vector<double>, kChannels>& out) const {
  const std::size_t n = x.size();
  std::vector<double> lat(n), lon(n);
  for (auto& channel : out) channel.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const BodyPoint p = site_->below(origin_.xx * x[i] + origin_.xy * y[i] + origin_.x_m,
                                     origin_.yx * x[i] + origin_.yy * y[i] + origin_.y_m);
    lat[i] = p.latitude_deg;
    lon[i] = p.longitude_deg;
    out[kDeficit][i] = site_->radius_deficit_m(p.latitude_deg);
  }
  dem_->to_pixels(lat, lon, out[kU], out[kV]);
}

void NodeMap::build_row(std::ptrdiff_t tile_row) {
  // One call for the whole row of tiles: setting up a transformation costs more than it.
  constexpr std::array<double, 13> kT = {-1, 0, 1, -1, 0, 1, -1, 0, 1, -0.5, 0.5, -0.5, 0.5};
  constexpr std::array<double, 13> kS = {-1, -1, -1, 0, 0, 0, 1, 1, 1, -0.5, -0.5, 0.5, 0.5};
  std::vector<double> x, y;
  const std::ptrdiff_t r0 = tile_row * kTile;
  const double half_rows = 0.5 * static_cast<double>(std::min(kTile, nodes_.rows - r0) - 1);
  for (std::ptrdiff_t t = 0; t < tile_cols_; ++t) {
    const std::ptrdiff_t c0 = t * kTile;
    const double half_cols = 0.5 * static_cast<double>(std::min(kTile, nodes_.cols - c0) - 1);
    for (std::size_t i = 0; i < kT.size(); ++i) {
      x.push_back(nodes_.x0_m +
                  nodes_.spacing_m * (static_cast<double>(c0) + half_cols * (1.0 + kT[i])));
      y.push_back(nodes_.y0_m +
                  nodes_.spacing_m * (static_cast<double>(r0) + half_rows * (1.0 + kS[i])));
    }
  }
  std::array<std::vector<double>, kChannels> at;
  walk(x, y, at);
  Bounds& bounds = row_bounds_[static_cast<std::size_t>(tile_row)];
  std::vector<double> exact_x, exact_y;
  for (std::ptrdiff_t t = 0; t < tile_cols_; ++t) {
    Tile& tile = tiles_[static_cast<std::size_t>(tile_row * tile_cols_ + t)];
    const std::size_t first = static_cast<std::size_t>(t) * kT.size();
    for (std::size_t k = 0; k < kChannels; ++k)
      for (std::size_t i = 0; i < 9; ++i) tile.lattice[k][i] = at[k][first + i];
    Bounds mine;
    for (std::size_t i = 0; i < kT.size(); ++i) {
      mine.add(at[kU][first + i], at[kV][first + i]);
      if (i < 9) continue;
      const auto wx = quadratic(kT[i]), wy = quadratic(kS[i]);
      for (const Channel k : {kU, kV})
        if (!(std::abs(biquadratic(tile.lattice[k], wx, wy) - at[k][first + i]) < kWorstPixels))
          tile.exact = true;  // also for NaN
    }
    if (!tile.exact) {
      // A quadratic may bulge between its nodes by at most a quarter of their range.
      const double du = 0.25 * (mine.u_max - mine.u_min), dv = 0.25 * (mine.v_max - mine.v_min);
      bounds.add(mine.u_min - du, mine.v_min - dv);
      bounds.add(mine.u_max + du, mine.v_max + dv);
      continue;
    }
    const std::ptrdiff_t c0 = t * kTile;
    for (std::ptrdiff_t r = r0; r < std::min(r0 + kTile, nodes_.rows); ++r)
      for (std::ptrdiff_t c = c0; c < std::min(c0 + kTile, nodes_.cols); ++c) {
        exact_x.push_back(nodes_.x0_m + nodes_.spacing_m * static_cast<double>(c));
        exact_y.push_back(nodes_.y0_m + nodes_.spacing_m * static_cast<double>(r));
      }
  }
  if (exact_x.empty()) return;
  walk(exact_x, exact_y, at);
  for (std::size_t i = 0; i < exact_x.size(); ++i) bounds.add(at[kU][i], at[kV][i]);
}

Result<NodeMap> NodeMap::build(const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes,
                               const RunContext& run, const Origin& origin) {
  NodeMap map(dem, site, nodes, origin);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, map.tile_rows_, [&](std::ptrdiff_t tile_row) {
    if (!run.stopped()) map.build_row(tile_row);
  });
  if (run.stopped()) return fail(kCancelled, dem.name() + ": projecting was stopped");
  for (const Bounds& b : map.row_bounds_) {
    map.bounds_.add(b.u_min, b.v_min);
    map.bounds_.add(b.u_max, b.v_max);
  }
  const Bounds& b = map.bounds_;
  map.touches_ = (dem.wraps() ? b.u_min <= b.u_max
                              : b.u_max > 0.0 && b.u_min < static_cast<double>(dem.cols())) &&
                 b.v_max > 0.0 && b.v_min < static_cast<double>(dem.rows());
  return map;
}

PixelRectangle NodeMap::needed(int step_u, int step_v) const {
  Bounds b = bounds_;
  if (!dem_->wraps()) {
    b.u_min = std::max(b.u_min, 0.0);
    b.u_max = std::min(b.u_max, static_cast<double>(dem_->cols()));
  }
  b.v_min = std::max(b.v_min, 0.0);
  b.v_max = std::min(b.v_max, static_cast<double>(dem_->rows()));
  constexpr long kMargin = 3;  // cells: two for the cubic, one for rounding
  PixelRectangle need;
  need.u_begin = std::lround(std::floor(b.u_min)) - kMargin * step_u;
  need.v_begin = std::lround(std::floor(b.v_min)) - kMargin * step_v;
  const long u_cells = (std::lround(std::ceil(b.u_max)) - need.u_begin) / step_u + 1 + kMargin;
  const long v_cells = (std::lround(std::ceil(b.v_max)) - need.v_begin) / step_v + 1 + kMargin;
  need.u_end = need.u_begin + u_cells * step_u;
  need.v_end = need.v_begin + v_cells * step_v;
  return need;
}

void NodeMap::sample_row(std::ptrdiff_t tile_row, const PixelWindow& window, bool nearest,
                         Grid<float>& z) const {
  const std::ptrdiff_t r0 = tile_row * kTile;
  const std::ptrdiff_t r1 = std::min(r0 + kTile, nodes_.rows);
  const auto last_u = static_cast<double>(dem_->cols());
  const auto last_v = static_cast<double>(dem_->rows());
  const bool wraps = dem_->wraps();
  const auto height = [&](double u, double v, double deficit) {
    if (!(v >= 0.0 && v <= last_v) || !(wraps || (u >= 0.0 && u <= last_u))) return NAN;
    if (nearest) return nearest_in(window, u, v);
    const double h = sample_window(window, u, v);
    return static_cast<float>(window.radii ? h + deficit : h);
  };
  std::vector<double> x, y;
  for (std::ptrdiff_t t = 0; t < tile_cols_; ++t) {
    const Tile& tile = tiles_[static_cast<std::size_t>(tile_row * tile_cols_ + t)];
    const std::ptrdiff_t c0 = t * kTile;
    const std::ptrdiff_t c1 = std::min(c0 + kTile, nodes_.cols);
    const double per_col = c1 - c0 > 1 ? 2.0 / static_cast<double>(c1 - c0 - 1) : 0.0;
    const double per_row = r1 - r0 > 1 ? 2.0 / static_cast<double>(r1 - r0 - 1) : 0.0;
    for (std::ptrdiff_t r = r0; r < r1; ++r) {
      const auto wy = quadratic(per_row * static_cast<double>(r - r0) - 1.0);
      for (std::ptrdiff_t c = c0; c < c1; ++c) {
        if (tile.exact) {
          x.push_back(nodes_.x0_m + nodes_.spacing_m * static_cast<double>(c));
          y.push_back(nodes_.y0_m + nodes_.spacing_m * static_cast<double>(r));
          continue;
        }
        const auto wx = quadratic(per_col * static_cast<double>(c - c0) - 1.0);
        z(r, c) =
            height(biquadratic(tile.lattice[kU], wx, wy), biquadratic(tile.lattice[kV], wx, wy),
                   biquadratic(tile.lattice[kDeficit], wx, wy));
      }
    }
  }
  if (x.empty()) return;
  std::array<std::vector<double>, kChannels> at;
  walk(x, y, at);
  std::size_t i = 0;
  for (std::ptrdiff_t t = 0; t < tile_cols_; ++t) {
    if (!tiles_[static_cast<std::size_t>(tile_row * tile_cols_ + t)].exact) continue;
    const std::ptrdiff_t c1 = std::min((t + 1) * kTile, nodes_.cols);
    for (std::ptrdiff_t r = r0; r < r1; ++r)
      for (std::ptrdiff_t c = t * kTile; c < c1; ++c, ++i)
        z(r, c) = height(at[kU][i], at[kV][i], at[kDeficit][i]);
  }
}

Result<Grid<float>> NodeMap::sample_by(const PixelWindow& window, bool nearest,
                                       const RunContext& run) const {
  Grid<float> z(nodes_.rows, nodes_.cols, NAN);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, tile_rows_, [&](std::ptrdiff_t tile_row) {
    if (!run.stopped()) sample_row(tile_row, window, nearest, z);
  });
  if (run.stopped()) return fail(kCancelled, dem_->name() + ": sampling was stopped");
  return z;
}

Result<Grid<float>> NodeMap::sample(const PixelWindow& window, const RunContext& run) const {
  return sample_by(window, false, run);
}

Result<Grid<float>> NodeMap::sample_nearest(const PixelWindow& window,
                                            const RunContext& run) const {
  return sample_by(window, true, run);
}

}  // namespace maquette::heightmap::detail
