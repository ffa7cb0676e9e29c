// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/photoclinometry.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Core>

#include "core/check.hpp"
#include "heightmap/detail/fourier.hpp"
#include "heightmap/detail/sinc.hpp"

namespace maquette::heightmap {
namespace {

using Complex = std::complex<float>;
constexpr double kPi = std::numbers::pi;
constexpr int kMostSteps = 8;
constexpr double kChange = 0.01;      // of the detail's size: settled
constexpr double kTilePixels = 12.0;  // of the elevation model, of a tile's side
constexpr double kFromPixel = 0.35, kWholeFromPixel = 0.5;  // cycles per pixel
constexpr double kGrazing = 0.03;      // cosine of incidence below which nothing is read
constexpr double kMostResidual = 0.7;  // of log brightness: beyond it is no shading of this relief

/// First difference of sixth order: at a quarter of a cycle per node 7 % too small.
constexpr std::array<double, 3> kStencil{0.75, -0.15, 1.0 / 60.0};

double stencil_gain(double f) {
  double g = 0.0;
  for (std::size_t k = 0; k < 3; ++k)
    g += 2.0 * kStencil[k] * std::sin(2.0 * kPi * f * static_cast<double>(k + 1));
  return g;
}

/// Log of lunar-Lambert reflectance of a slope, seen from above; NaN in shadow.
struct LogReflectance {
  double sx, sy, sz, l;
  explicit LogReflectance(const Shading& s)
      : sx(std::cos(s.sun_elevation_rad) * std::sin(s.sun_azimuth_rad)),
        sy(std::cos(s.sun_elevation_rad) * std::cos(s.sun_azimuth_rad)),
        sz(std::sin(s.sun_elevation_rad)),
        l(s.lunar_lambert) {}
  double operator()(double p, double q) const {
    const double mu = 1.0 / std::sqrt(1.0 + p * p + q * q);
    const double mu0 = mu * (sz - p * sx - q * sy);
    if (mu0 < kGrazing) return NAN;
    return std::log(l * 2.0 * mu0 / (mu0 + mu) + (1.0 - l) * mu0);
  }
};

class Solver {
 public:
  Solver(const Grid<float>& z, const Grid<float>& brightness, double spacing, double dem_pixel,
         double image_pixel, const detail::Roughness& relief, const Shading& shading)
      : z_(z), brightness_(brightness), spacing_(spacing), reflectance_(shading) {
    const double wanted = kTilePixels * dem_pixel / spacing;
    core_ = 64;
    while (static_cast<double>(core_) < wanted && core_ < std::max(z.rows(), z.cols())) core_ *= 2;
    const double h = 1e-4;
    gx_ = (reflectance_(h, 0) - reflectance_(-h, 0)) / (2.0 * h);
    gy_ = (reflectance_(0, h) - reflectance_(0, -h)) / (2.0 * h);
    make_filter(dem_pixel, image_pixel, relief, shading);
  }

  Result<ShadedDetail> solve(const RunContext& run) {
    ShadedDetail out;
    out.gain_m2 = gain_;
    out.added_m = Grid<float>(z_.rows(), z_.cols(), 0.0F);
    Grid<float> y(z_.rows(), z_.cols(), 0.0F);
    double change = 1.0, size = 0.0;
    for (; out.steps < kMostSteps && change > kChange * size; ++out.steps) {
      linearise(out.added_m, y);
      Grid<float> next(z_.rows(), z_.cols(), 0.0F);
      for (std::ptrdiff_t r = 0; r < z_.rows(); r += core_)
        for (std::ptrdiff_t c = 0; c < z_.cols(); c += core_) {
          if (run.stopped()) return fail(kCancelled, "photoclinometry was stopped");
          filter_tile(y, r, c, next);
        }
      change = size = 0.0;
      for (std::size_t i = 0; i < next.cells().size(); ++i) {
        const double a = static_cast<double>(next.cells()[i]),
                     b = static_cast<double>(out.added_m.cells()[i]);
        change += (a - b) * (a - b);
        size += a * a;
      }
      change = std::sqrt(change);
      size = std::sqrt(size);
      out.added_m = std::move(next);
    }
    return out;
  }

 private:
  /// Wiener's filter on 2 core x 2 core nodes, rows being y.
  void make_filter(double dem_pixel, double image_pixel, const detail::Roughness& relief,
                   const Shading& shading) {
    const std::ptrdiff_t n = 2 * core_;
    filter_.resize(static_cast<std::size_t>(n * n));
    const double dem = dem_pixel / spacing_, image = std::max(1.0, image_pixel / spacing_);
    const double albedo_nodes = shading.albedo_length_m / spacing_;
    const double albedo0 = shading.albedo_contrast * shading.albedo_contrast * 4.0 * kPi *
                           albedo_nodes * albedo_nodes;  // of (1 + (2 pi f l)^2)^-2
    const auto frequency = [n](std::ptrdiff_t k) {
      return static_cast<double>(k <= n / 2 ? k : k - n) / static_cast<double>(n);
    };
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c) {
        const double fx = frequency(c), fy = frequency(r), f = std::hypot(fx, fy);
        const double ramp =
            std::clamp((f * dem - kFromPixel) / (kWholeFromPixel - kFromPixel), 0.0, 1.0);
        const double pass = 0.5 - 0.5 * std::cos(kPi * ramp);
        Complex w(0.0F, 0.0F);
        if (pass > 0.0 && std::max(std::abs(fx), std::abs(fy)) * image <= 0.5) {
          const double law = relief.spectrum() / (spacing_ * spacing_) *
                             std::pow(f / spacing_, -2.0 * relief.hurst - 2.0);
          const double seen = f * dem < 0.5 ? detail::sinc(fx * dem) * detail::sinc(fy * dem) : 0.0;
          const double prior = law * (1.0 - seen) * (1.0 - seen);
          const double slope = (gx_ * stencil_gain(fx) + gy_ * stencil_gain(fy)) / spacing_;
          const double k = 2.0 * kPi * f * albedo_nodes;
          const double rest =
              albedo0 / ((1.0 + k * k) * (1.0 + k * k)) + shading.noise * shading.noise;
          const double total = slope * slope * prior + rest;
          w = Complex(0.0F, static_cast<float>(-pass * slope * prior / total));
          gain_ += pass * slope * slope * prior * prior / total / static_cast<double>(n * n);
        }
        filter_[static_cast<std::size_t>(r * n + c)] = w;
      }
  }

  /// What the linear model would have to show: residual plus the part of the detail so far.
  void linearise(const Grid<float>& added, Grid<float>& y) const {
    const auto at = [](const Grid<float>& g, std::ptrdiff_t r, std::ptrdiff_t c) {
      return static_cast<double>(g(std::clamp<std::ptrdiff_t>(r, 0, g.rows() - 1),
                                   std::clamp<std::ptrdiff_t>(c, 0, g.cols() - 1)));
    };
    const auto slope = [&](const Grid<float>& g, std::ptrdiff_t r, std::ptrdiff_t c,
                           std::ptrdiff_t dr, std::ptrdiff_t dc) {
      double sum = 0.0;
      for (std::ptrdiff_t k = 1; k <= 3; ++k)
        sum += kStencil[static_cast<std::size_t>(k - 1)] *
               (at(g, r + k * dr, c + k * dc) - at(g, r - k * dr, c - k * dc));
      return sum / spacing_;
    };
    std::vector<double> row_sum(static_cast<std::size_t>(z_.rows()), 0.0), row_n(row_sum);
    Grid<float> known(z_.rows(), z_.cols(), 0.0F);
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z_.rows(), [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < z_.cols(); ++c) {
        const double dx = slope(added, r, c, 0, 1), dy = slope(added, r, c, 1, 0);
        const double model = reflectance_(slope(z_, r, c, 0, 1) + dx, slope(z_, r, c, 1, 0) + dy);
        const auto i = static_cast<double>(brightness_(r, c));
        y(r, c) = static_cast<float>(gx_ * dx + gy_ * dy);
        if (!(i > 0.0) || std::isnan(model)) continue;
        known(r, c) = static_cast<float>(std::log(i) - model);
        row_sum[static_cast<std::size_t>(r)] += std::log(i) - model;
        row_n[static_cast<std::size_t>(r)] += 1.0;
      }
    });
    double sum = 0.0, n = 0.0;
    for (std::size_t r = 0; r < row_sum.size(); ++r) {
      sum += row_sum[r];
      n += row_n[r];
    }
    const auto mean = static_cast<float>(n > 0.0 ? sum / n : 0.0);
    const auto most = static_cast<float>(kMostResidual);
    for (std::size_t k = 0; k < y.cells().size(); ++k)
      if (known.cells()[k] != 0.0F)
        y.cells()[k] += std::clamp(known.cells()[k] - mean, -most, most);
  }

  /// Overlap-save: a tile with half its side around it, beyond the grid mirrored.
  void filter_tile(const Grid<float>& y, std::ptrdiff_t r0, std::ptrdiff_t c0, Grid<float>& out) {
    const std::ptrdiff_t n = 2 * core_, halo = core_ / 2;
    const auto mirrored = [](std::ptrdiff_t k, std::ptrdiff_t size) {
      const std::ptrdiff_t period = 2 * size;
      k = ((k % period) + period) % period;
      return k < size ? k : period - 1 - k;
    };
    tile_.resize(static_cast<std::size_t>(n * n));
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c)
        tile_[static_cast<std::size_t>(r * n + c)] =
            Complex(y(mirrored(r0 - halo + r, y.rows()), mirrored(c0 - halo + c, y.cols())), 0.0F);
    detail::fourier(tile_, n, true);
    for (std::size_t k = 0; k < tile_.size(); ++k) tile_[k] *= filter_[k];
    detail::fourier(tile_, n, false);
    for (std::ptrdiff_t r = 0; r < std::min(core_, y.rows() - r0); ++r)
      for (std::ptrdiff_t c = 0; c < std::min(core_, y.cols() - c0); ++c)
        out(r0 + r, c0 + c) = tile_[static_cast<std::size_t>((r + halo) * n + c + halo)].real();
  }

  const Grid<float>& z_;
  const Grid<float>& brightness_;
  double spacing_;
  LogReflectance reflectance_;
  std::ptrdiff_t core_ = 64;
  double gx_ = 0.0, gy_ = 0.0, gain_ = 0.0;
  std::vector<Complex> filter_, tile_;
};

}  // namespace

Result<ShadedDetail> photoclinometry(const Grid<float>& z_m, const Grid<float>& brightness,
                                     double spacing_m, double dem_pixel_m, double image_pixel_m,
                                     const detail::Roughness& relief, const Shading& shading,
                                     const RunContext& run) {
  MAQUETTE_CHECK(shading.sun_elevation_rad > 0.0 && dem_pixel_m > image_pixel_m,
                 "sun {} rad above the horizon, pixels of {} and {} m", shading.sun_elevation_rad,
                 dem_pixel_m, image_pixel_m);
  return Solver(z_m, brightness, spacing_m, dem_pixel_m, image_pixel_m, relief, shading).solve(run);
}

}  // namespace maquette::heightmap
