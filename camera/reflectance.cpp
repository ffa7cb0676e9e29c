// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/reflectance.hpp"

#include <algorithm>
#include <numbers>

#include <fmt/format.h>

namespace maquette::camera {
namespace {

constexpr int kNodes = 64;

/// Nodes and weights of Gauss and Legendre on [0, 1]: Newton's iteration on the polynomial, whose
/// roots are near cos(pi (i + 3/4) / (n + 1/2)).
struct GaussLegendre {
  std::array<double, kNodes> x, weight;

  GaussLegendre() {
    for (int i = 0; i < kNodes; ++i) {
      double t = std::cos(std::numbers::pi * (i + 0.75) / (kNodes + 0.5)), slope = 1.0;
      for (int step = 0; step < 100; ++step) {
        double p0 = 1.0, p1 = t;
        for (int n = 2; n <= kNodes; ++n) {
          const double p2 = ((2 * n - 1) * t * p1 - (n - 1) * p0) / n;
          p0 = p1;
          p1 = p2;
        }
        slope = kNodes * (t * p1 - p0) / (t * t - 1.0);
        const double change = p1 / slope;
        t -= change;
        if (std::abs(change) < 1e-15) break;
      }
      x[static_cast<std::size_t>(i)] = 0.5 * (1.0 + t);
      weight[static_cast<std::size_t>(i)] = 1.0 / ((1.0 - t * t) * slope * slope);
    }
  }
};

struct Limit {
  const char* name;
  double value, min, max;
};

Result<void> within(const Material& m, std::initializer_list<Limit> limits) {
  for (const Limit& l : limits)
    if (!(l.value >= l.min && l.value <= l.max))
      return fail(kMaterialOutOfRange, fmt::format("material {}: {} is {}; {} to {} expected",
                                                   m.name, l.name, l.value, l.min, l.max));
  return {};
}

Result<void> within(const Material& m, const char* name, const Bands& bands, double min,
                    double max) {
  for (const double value : bands) MAQUETTE_TRY_VOID(within(m, {{name, value, min, max}}));
  return {};
}

struct Check {
  const Material& m;

  Result<void> operator()(const Lambert& l) const { return within(m, "albedo", l.albedo, 0, 1); }
  Result<void> operator()(const LommelSeeliger& l) const {
    return within(m, "albedo", l.albedo, 0, 1);
  }
  Result<void> operator()(const LunarLambert& l) const {
    MAQUETTE_TRY_VOID(within(m, {{"lunar_lambert_l", l.l, 0, 1}}));
    return within(m, "albedo", l.albedo, 0, 1);
  }
  Result<void> operator()(const Hapke& h) const {
    MAQUETTE_TRY_VOID(within(m, {{"b", h.b, -0.99, 0.99},
                                 {"c", h.c, -1, 2},
                                 {"surge", h.surge, 0, 10},
                                 {"surge_width", h.surge_width, 1e-6, 1e3},
                                 {"coherent", h.coherent, 0, 10},
                                 {"coherent_width", h.coherent_width, 1e-6, 1e3},
                                 {"roughness_deg", h.roughness_deg, 0, 59},
                                 {"filling", h.filling, 0, 0.74}}));
    return within(m, "w", h.w, 0, 1);
  }
  Result<void> operator()(const OrenNayar& o) const {
    MAQUETTE_TRY_VOID(within(m, {{"sigma_deg", o.sigma_deg, 0, 60}}));
    return within(m, "albedo", o.albedo, 0, 0.97);
  }
  Result<void> operator()(const Ggx& g) const {
    MAQUETTE_TRY_VOID(within(m, {{"alpha", g.alpha, 1e-3, 1}}));
    MAQUETTE_TRY_VOID(within(m, "n", g.n, 1e-3, 100));
    MAQUETTE_TRY_VOID(within(m, "k", g.k, 0, 100));
    return within(m, "tint", g.tint, 0, 1);
  }
  Result<void> operator()(const BrdfTable& t) const {
    if (t.grid == nullptr)
      return fail(kMaterialOutOfRange,
                  fmt::format("material {}: a table law needs its file", m.name));
    return within(m, {{"scale", t.scale, 0, 1e6}});
  }
};

double sample(const Grid<float>& g, double row, double col) {
  const double r = std::clamp(row, 0.0, static_cast<double>(g.rows() - 1));
  const double c = std::clamp(col, 0.0, static_cast<double>(g.cols() - 1));
  const auto r0 = static_cast<std::ptrdiff_t>(r), c0 = static_cast<std::ptrdiff_t>(c);
  const auto r1 = std::min(r0 + 1, g.rows() - 1), c1 = std::min(c0 + 1, g.cols() - 1);
  const double v = r - static_cast<double>(r0), u = c - static_cast<double>(c0);
  const auto at = [&g](std::ptrdiff_t i, std::ptrdiff_t j) { return static_cast<double>(g(i, j)); };
  return (1 - v) * ((1 - u) * at(r0, c0) + u * at(r0, c1)) +
         v * ((1 - u) * at(r1, c0) + u * at(r1, c1));
}

}  // namespace

bool of_one_size(const std::array<Grid<float>, 3>& factor) {
  return std::all_of(factor.begin(), factor.end(), [&](const Grid<float>& f) {
    return !f.empty() && f.rows() == factor[0].rows() && f.cols() == factor[0].cols();
  });
}

Bands AlbedoMap::at(double x_mm, double y_mm) const {
  const double col =
      (x_mm - min_x_mm) / (max_x_mm - min_x_mm) * static_cast<double>(factor[0].cols()) - 0.5;
  const double row =
      (y_mm - min_y_mm) / (max_y_mm - min_y_mm) * static_cast<double>(factor[0].rows()) - 0.5;
  return {sample(factor[0], row, col), sample(factor[1], row, col), sample(factor[2], row, col)};
}

Bands radiance_factor(const Law& law, const Angles& angles) {
  return std::visit([&angles](const auto& l) { return l.radiance_factor(angles); }, law);
}

Bands directional_albedo(const Law& law, double mu0) {
  static const GaussLegendre rule;
  Bands sum{};
  // f mu dOmega = RADF / (pi mu0) mu dmu dpsi, twice for both signs of the azimuth. In emission
  // over the angle, so that nodes gather at neither end; in azimuth by midpoints.
  const double half_pi = 0.5 * std::numbers::pi, sin0 = std::sqrt(std::max(0.0, 1.0 - mu0 * mu0));
  for (std::size_t i = 0; i < kNodes; ++i) {
    const double e = half_pi * rule.x[i], mu = std::cos(e), sine = std::sin(e);
    for (std::size_t k = 0; k < kNodes; ++k) {
      const double psi = std::numbers::pi * (static_cast<double>(k) + 0.5) / kNodes;
      const Bands r = radiance_factor(law, {mu0, mu, mu0 * mu + sin0 * sine * std::cos(psi)});
      for (std::size_t b = 0; b < 3; ++b) sum[b] += rule.weight[i] * r[b] * mu * sine;
    }
  }
  for (double& s : sum) s *= 2.0 * half_pi / (kNodes * mu0);
  return sum;
}

double largest_albedo(const Law& law) {
  double largest = 0.0;
  for (const double incidence_deg : {0.0, 30.0, 60.0, 75.0, 85.0, 89.0})
    for (const double a :
         directional_albedo(law, std::cos(incidence_deg * std::numbers::pi / 180.0)))
      largest = std::max(largest, a);
  return largest;
}

Result<void> check_material(const Material& material) {
  MAQUETTE_TRY_VOID(std::visit(Check{material}, material.law));
  if (material.map == nullptr) return {};
  const AlbedoMap& map = *material.map;
  if (!of_one_size(map.factor))
    return fail(kMaterialOutOfRange,
                fmt::format("material {}: the albedo map has bands of different sizes or none",
                            material.name));
  if (!(map.max_x_mm > map.min_x_mm) || !(map.max_y_mm > map.min_y_mm))
    return fail(kMaterialOutOfRange,
                fmt::format("material {}: the albedo map's rectangle is empty", material.name));
  return {};
}

}  // namespace maquette::camera
