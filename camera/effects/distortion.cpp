// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/distortion.hpp"

#include <cmath>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "camera/detail/distortion_laws.hpp"
#include "camera/effects/sampling.hpp"

namespace maquette::camera {
namespace {

constexpr double kSteepFold = 0.05;  ///< of the least change of radius that is not called a fold

const std::vector<double>& coefficients_of(const Distortion& e, std::size_t band) {
  if (band == 0 && !e.red.empty()) return e.red;
  if (band == 2 && !e.blue.empty()) return e.blue;
  return e.coefficients;
}

double quotient(const std::vector<double>& k, double r) {
  return detail::quotient_law<double>(k, r);
}

Vec2 brown_conrady(const std::vector<double>& k, Vec2 p) {
  const auto [x, y] = detail::brown_conrady_law<double>(k, p.x, p.y);
  return {x, y};
}

/// p with f(p) = goal, by Newton with numerical derivatives.
template <class F>
std::optional<Vec2> solve(const F& f, Vec2 goal) {
  Vec2 p = goal;
  for (int i = 0; i < 50; ++i) {
    const Vec2 at = f(p);
    const Vec2 miss{goal.x - at.x, goal.y - at.y};
    if (std::hypot(miss.x, miss.y) < 1e-12) return p;
    constexpr double kStep = 1e-6;
    const Vec2 right = f({p.x + kStep, p.y}), down = f({p.x, p.y + kStep});
    const double a = (right.x - at.x) / kStep, b = (down.x - at.x) / kStep;
    const double c = (right.y - at.y) / kStep, d = (down.y - at.y) / kStep;
    const double det = a * d - b * c;
    if (!(det > 0.0)) return std::nullopt;
    p = {p.x + (d * miss.x - b * miss.y) / det, p.y + (a * miss.y - c * miss.x) / det};
  }
  const Vec2 at = f(p);
  if (std::hypot(goal.x - at.x, goal.y - at.y) < 1e-9) return p;
  return std::nullopt;
}

/// Ideal pixel of each real one on a raster of `step` pixels.
struct Map {
  std::ptrdiff_t step = 16;
  Grid<double> x, y;  ///< node (i, j) at pixel corner (j step, i step)
  [[nodiscard]] Vec2 at(double px, double py) const {
    const double u = px / static_cast<double>(step), v = py / static_cast<double>(step);
    const auto j = std::min(static_cast<std::ptrdiff_t>(u), x.cols() - 2);
    const auto i = std::min(static_cast<std::ptrdiff_t>(v), x.rows() - 2);
    const double s = u - static_cast<double>(j), t = v - static_cast<double>(i);
    const auto mix = [&](const Grid<double>& g) {
      return (1.0 - t) * ((1.0 - s) * g(i, j) + s * g(i, j + 1)) +
             t * ((1.0 - s) * g(i + 1, j) + s * g(i + 1, j + 1));
    };
    return {mix(x), mix(y)};
  }
};

Vec2 ideal_pixel(const Distortion& e, const Intrinsics& k, Vec2 px, std::size_t band) {
  const Vec2 real = tangents(k, px);
  return pixel(k, undistorted(e, real, band).value_or(real));
}

Map map_of(const Distortion& e, const Intrinsics& k, std::size_t band) {
  constexpr double kAllowedPx = 0.002;
  for (std::ptrdiff_t step = 16;; step /= 2) {
    Map map;
    map.step = step;
    const std::ptrdiff_t nodes_y = k.height_px / step + 2, nodes_x = k.width_px / step + 2;
    map.x = Grid<double>(nodes_y, nodes_x), map.y = Grid<double>(nodes_y, nodes_x);
    tbb::parallel_for(std::ptrdiff_t{0}, nodes_y, [&](std::ptrdiff_t i) {
      for (std::ptrdiff_t j = 0; j < nodes_x; ++j) {
        const Vec2 p =
            ideal_pixel(e, k, {static_cast<double>(j * step), static_cast<double>(i * step)}, band);
        map.x(i, j) = p.x, map.y(i, j) = p.y;
      }
    });
    double worst = 0.0;
    for (std::ptrdiff_t i = 0; i + 1 < nodes_y; i += 2)
      for (std::ptrdiff_t j = 0; j + 1 < nodes_x; j += 2) {
        const Vec2 px{(static_cast<double>(j) + 0.5) * static_cast<double>(step),
                      (static_cast<double>(i) + 0.5) * static_cast<double>(step)};
        const Vec2 exact = ideal_pixel(e, k, px, band), near = map.at(px.x, px.y);
        worst = std::max(worst, std::hypot(exact.x - near.x, exact.y - near.y));
      }
    if (worst <= kAllowedPx || step == 1) return map;
  }
}

bool bends(const Distortion& e, std::size_t band) {
  for (const double k : coefficients_of(e, band))
    if (k != 0.0) return true;
  return of_band(e.band_scale, band) != 0.0;
}

/// @param to  of the same size; everything in it is written
void warp(const Grid<float>& from, const Map& map, bool nearest, Grid<float>& to) {
  tbb::parallel_for(std::ptrdiff_t{0}, to.rows(), [&](std::ptrdiff_t r) {
    const double py = static_cast<double>(r) + 0.5;
    for (std::ptrdiff_t start = 0; start < to.cols(); start += map.step) {
      // Along a row of one cell the map is straight.
      const std::ptrdiff_t end = std::min(start + map.step, to.cols());
      const Vec2 a = map.at(static_cast<double>(start), py);
      const Vec2 b = map.at(static_cast<double>(start + map.step), py);
      const double dx = (b.x - a.x) / static_cast<double>(map.step);
      const double dy = (b.y - a.y) / static_cast<double>(map.step);
      std::ptrdiff_t c = start;
      constexpr auto kLanes = static_cast<std::ptrdiff_t>(kSampleLanes);
      for (; !nearest && c + kLanes <= end; c += kLanes) {
        std::array<float, kSampleLanes> x, y;
        for (std::size_t l = 0; l < kSampleLanes; ++l) {
          const double along =
              static_cast<double>(static_cast<int>(c - start) + static_cast<int>(l)) + 0.5;
          x[l] = static_cast<float>(a.x + along * dx), y[l] = static_cast<float>(a.y + along * dy);
        }
        bicubic_lanes(from, x.data(), y.data(), &to(r, c));
      }
      for (; c < end; ++c) {
        const double along = static_cast<double>(c - start) + 0.5;
        const double x = a.x + along * dx, y = a.y + along * dy;
        if (nearest) {
          const auto row = std::clamp(static_cast<std::ptrdiff_t>(std::floor(y)), std::ptrdiff_t{0},
                                      from.rows() - 1);
          const auto col = std::clamp(static_cast<std::ptrdiff_t>(std::floor(x)), std::ptrdiff_t{0},
                                      from.cols() - 1);
          to(r, c) = from(row, col);
        } else {
          to(r, c) = bicubic(from, static_cast<float>(x), static_cast<float>(y));
        }
      }
    }
  });
}

}  // namespace

Vec2 distorted(const Distortion& e, Vec2 ideal, std::size_t band) {
  const auto& k = coefficients_of(e, band);
  const double scale = 1.0 + of_band(e.band_scale, band);
  Vec2 p = ideal;
  if (e.model == "brown_conrady") {
    p = brown_conrady(k, ideal);
  } else if (e.model == "quotient") {
    const double q = quotient(k, std::hypot(ideal.x, ideal.y));
    p = {ideal.x / q, ideal.y / q};
  } else {
    const auto back = solve(
        [&](Vec2 real) {
          const double q = quotient(k, std::hypot(real.x, real.y));
          return Vec2{real.x / q, real.y / q};
        },
        ideal);
    p = back.value_or(Vec2{NAN, NAN});
  }
  return {scale * p.x, scale * p.y};
}

std::optional<Vec2> undistorted(const Distortion& e, Vec2 real, std::size_t band) {
  const double scale = 1.0 + of_band(e.band_scale, band);
  const Vec2 lens{real.x / scale, real.y / scale};
  if (e.model == "division") {
    const double q = quotient(coefficients_of(e, band), std::hypot(lens.x, lens.y));
    if (!(q > 0.0)) return std::nullopt;
    return Vec2{lens.x / q, lens.y / q};
  }
  Distortion unscaled = e;
  unscaled.band_scale = {0.0};
  return solve([&](Vec2 p) { return distorted(unscaled, p, band); }, lens);
}

Result<void> check(const Distortion& e, const Shot& shot) {
  if (e.model != "quotient" && e.model != "division" && e.model != "brown_conrady")
    return fail(kEffectOutOfRange, fmt::format("distortion.model is \"{}\"; quotient, division or "
                                               "brown_conrady is possible",
                                               e.model));
  for (const auto* list : {&e.coefficients, &e.red, &e.blue}) {
    if (list->size() > 8)
      return fail(kEffectOutOfRange, "distortion: at most 8 coefficients are possible");
    for (const double k : *list)
      MAQUETTE_TRY_VOID(in_range("distortion", "coefficients", k, -1e6, 1e6));
  }
  if (e.band_scale.empty()) return fail(kEffectOutOfRange, "distortion.band_scale is empty");
  for (const double s : e.band_scale)
    MAQUETTE_TRY_VOID(in_range("distortion", "band_scale", s, -0.5, 0.5));
  // Out to the corners the real picture must have one ideal place each, farther out the farther.
  const Intrinsics& k = shot.intrinsics;
  for (std::size_t band = 0; band < 3; ++band)
    for (const Vec2 corner :
         {Vec2{0.0, 0.0}, Vec2{1.0 * k.width_px, 0.0}, Vec2{0.0, 1.0 * k.height_px},
          Vec2{1.0 * k.width_px, 1.0 * k.height_px}}) {
      const Vec2 t = tangents(k, corner);
      constexpr int kSteps = 64;
      double before = 0.0;
      for (int i = 1; i <= kSteps; ++i) {
        const double share = static_cast<double>(i) / kSteps;
        const auto ideal = undistorted(e, {share * t.x, share * t.y}, band);
        const double radius = ideal ? std::hypot(ideal->x, ideal->y) : -1.0;
        const double least = kSteepFold * std::hypot(t.x, t.y) / kSteps;
        if (!(radius - before > least))
          return fail(kEffectOutOfRange,
                      fmt::format("distortion: at {:.0f} % of the way to the corner the formula "
                                  "folds the picture over itself; check the coefficients ({}, in "
                                  "units of the focal length)",
                                  100.0 * share, e.model));
        before = radius;
      }
    }
  return {};
}

void apply(const Distortion& e, const Shot& shot, Frame& frame) {
  std::optional<Map> middle;
  bool alike = e.red.empty() && e.blue.empty() && e.band_scale.size() == 1;
  std::optional<Map> map;
  Grid<float> spare;
  for (std::size_t b = 0; b < frame.bands.size(); ++b) {
    // Grey light goes the way of the middle band.
    const std::size_t band = frame.bands.size() == 1 ? (e.band_scale.size() == 1 ? 1 : 1) : b;
    if (!bends(e, std::min(band, std::size_t{2}))) continue;
    if (!map || !alike) map = map_of(e, shot.intrinsics, band);
    if (spare.empty()) spare = Grid<float>(frame.bands[b].rows(), frame.bands[b].cols());
    warp(frame.bands[b], *map, false, spare);
    std::swap(frame.bands[b], spare);  // the next band goes where this one was
    if (band == 1) middle = map;
  }
  for (Grid<float>* known : {&frame.depth_mm, &frame.lit}) {
    if (known->empty() || !middle) continue;
    warp(*known, *middle, true, spare);
    std::swap(*known, spare);
  }
}

}  // namespace maquette::camera
