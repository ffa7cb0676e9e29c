// SPDX-License-Identifier: GPL-3.0-or-later
#include "assets/synthetic_terrain.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "assets/synthetic_products.hpp"
#include "core/random.hpp"

namespace maquette::assets {
namespace {

// ---- fractal relief ----------------------------------------------------------

constexpr std::uint64_t kFractalStream = 0x66726163ULL;
constexpr std::uint64_t kCraterStream = 0x63726174ULL;
constexpr std::uint64_t kRippleStream = 0x72697070ULL;

// Gradient noise of lattice spacing L has most of its power near wavelength 2 L;
// lengths here are lattice spacings.
constexpr int kOctaves = 11;
constexpr double kLongest_m = 800.0;
constexpr double kLongestSigma_m = 10.0;

/// Key of a lattice cell. The factors are odd and unrelated, so that neighbours
/// share no pattern after mixing.
inline std::uint64_t cell_key(std::uint64_t stream, std::int64_t ix, std::int64_t iy) {
  return mix64(stream ^ (static_cast<std::uint64_t>(ix) * 0x9e3779b97f4a7c15ULL +
                         static_cast<std::uint64_t>(iy) * 0xc2b2ae3d27d4eb4fULL));
}

/// Unit gradients; 256 directions are finer than any eye or test can tell.
const std::array<std::array<double, 2>, 256> kGradients = [] {
  std::array<std::array<double, 2>, 256> g;
  for (std::size_t i = 0; i < g.size(); ++i) {
    const double a = 2.0 * std::numbers::pi * (static_cast<double>(i) + 0.5) / 256.0;
    g[i] = {std::cos(a), std::sin(a)};
  }
  return g;
}();

inline double fade(double t) {
  return t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
}

/// Perlin's improved noise (2002, doi:10.1145/566654.566636), scaled to standard
/// deviation 1 over the plane: the factor is 1 / sqrt(4 A B) with
/// A = integral of w^2 x^2, B = integral of w^2 over 0..1, w = 1 - fade.
double gradient_noise(std::uint64_t stream, double x, double y) {
  const double fx = std::floor(x), fy = std::floor(y);
  const auto ix = static_cast<std::int64_t>(fx);
  const auto iy = static_cast<std::int64_t>(fy);
  const double u = x - fx, v = y - fy;
  const auto corner = [&](std::int64_t dx, std::int64_t dy, double px, double py) {
    const auto& g = kGradients[cell_key(stream, ix + dx, iy + dy) >> 56];
    return g[0] * px + g[1] * py;
  };
  const double a = fade(u), b = fade(v);
  const double south = (1.0 - a) * corner(0, 0, u, v) + a * corner(1, 0, u - 1.0, v);
  const double north = (1.0 - a) * corner(0, 1, u, v - 1.0) + a * corner(1, 1, u - 1.0, v - 1.0);
  constexpr double kNormalise = 1.0 / 0.21571080275974693;
  return kNormalise * ((1.0 - b) * south + b * north);
}

struct Octave {
  double inverse_m, sigma_m;
  double cos, sin;
};

const std::array<Octave, kOctaves> kOctaveTable = [] {
  std::array<Octave, kOctaves> table;
  double length = kLongest_m;
  for (std::size_t i = 0; i < table.size(); ++i) {
    // 0.7 rad is no near fraction of a quarter turn.
    const double turn = 0.35 + 0.7 * static_cast<double>(i);
    const double self_affine = std::pow(length / kLongest_m, kHurst);
    const double creep = std::pow(std::min(1.0, 2.0 * length / kCreepWavelength_m), kCreepExponent);
    table[i] = {1.0 / length, kLongestSigma_m * self_affine * creep, std::cos(turn),
                std::sin(turn)};
    length /= 2.0;
  }
  return table;
}();

// ---- craters -----------------------------------------------------------------

constexpr int kClasses = 8;  // 2..4, 4..8, ..., 256..512 m
constexpr int kMostPerCell = 8;
constexpr double kWorn = 0.06, kFresh = 0.8;
constexpr double kTrask = 0.0794;  // 10^10.9 per 10^6 km^2 at 1 m

struct CraterClass {
  double smallest_m, cell_m;
  bool production;                           // slope -3
  std::array<double, kMostPerCell> at_most;  // probability of at most i craters in a cell
};

const std::array<CraterClass, kClasses> kClassTable = [] {
  std::array<CraterClass, kClasses> table;
  double d = kSmallestCrater_m;
  for (CraterClass& c : table) {
    c.smallest_m = d;
    // Twice the reach of the largest: four cells hold all that matters anywhere.
    c.cell_m = 2.0 * kEjectaReach * d;
    c.production = d >= kEquilibriumCrater_m;
    const double upper = crater_density_per_m2(2.0 * d);
    const double mean = (crater_density_per_m2(d) - upper) * c.cell_m * c.cell_m;
    double term = std::exp(-mean), sum = 0.0;
    for (std::size_t i = 0; i < c.at_most.size(); ++i) {
      sum += term;
      c.at_most[i] = sum;
      term *= mean / static_cast<double>(i + 1);
    }
    d *= 2.0;
  }
  return table;
}();

inline double unit32(std::uint64_t bits) {
  return static_cast<double>(bits & 0xffffffffULL) * 0x1.0p-32;
}

/// Calls visit(east, north, key) for the craters of one cell.
template <class Visit>
inline void for_craters_of_cell(const CraterClass& c, std::uint64_t stream, std::int64_t ix,
                                std::int64_t iy, const Visit& visit) {
  const std::uint64_t key = cell_key(stream, ix, iy);
  const double u = static_cast<double>(key >> 11) * 0x1.0p-53;
  for (std::size_t i = 0; i < kMostPerCell && u >= c.at_most[i]; ++i) {
    const std::uint64_t place = mix64(key + 0x632be59bd9b4e019ULL * (i + 1));
    visit((static_cast<double>(ix) + unit32(place)) * c.cell_m,
          (static_cast<double>(iy) + unit32(place >> 32)) * c.cell_m, place);
  }
}

/// Diameter by inversion of the cumulative law within the class; freshness with
/// most craters worn, as where new ones constantly replace the worn-out.
inline SyntheticCrater make_crater(const CraterClass& c, double east, double north,
                                   std::uint64_t place) {
  const std::uint64_t bits = mix64(place);
  const double u = unit32(bits), v = unit32(bits >> 32);
  const double ratio =
      c.production ? 1.0 / std::cbrt(1.0 - u * 0.875) : 1.0 / std::sqrt(1.0 - u * 0.75);
  return {east, north, c.smallest_m * ratio, kWorn + (kFresh - kWorn) * v * v * v};
}

/// Minimum with a rounded corner (quadratic blend over `width`), once differentiable.
inline double soft_min(double a, double b, double width) {
  const double h = std::max(width - std::abs(a - b), 0.0);
  return std::min(a, b) - h * h / (4.0 * width);
}

inline std::uint64_t class_stream(std::uint64_t seed, std::size_t k) {
  return mix64(seed ^ kCraterStream) + k * 0xa0761d6478bd642fULL;
}

}  // namespace

double crater_density_per_m2(double diameter_m) {
  if (diameter_m >= kLargestCrater_m) return 0.0;
  // The production branch is cut at the largest crater; its tail is subtracted so
  // that the class counts add up.
  const auto production = [](double d) { return kTrask * kEquilibriumCrater_m / (d * d * d); };
  const double tail = production(kLargestCrater_m);
  if (diameter_m >= kEquilibriumCrater_m) return production(diameter_m) - tail;
  return kTrask / (diameter_m * diameter_m) - tail;
}

double crater_profile_m(const SyntheticCrater& crater, double distance_m) {
  const double r2 = 4.0 * distance_m * distance_m / (crater.diameter_m * crater.diameter_m);
  constexpr double kReach2 = kEjectaReach * kEjectaReach;
  if (r2 >= kReach2) return 0.0;
  const double size = crater.freshness * crater.diameter_m;
  const double rim = 0.036 * size;
  const double bowl = rim + 0.2 * size * (r2 - 1.0);
  if (r2 < 0.3) return bowl;
  const double q = (r2 - 1.0) / (kReach2 - 1.0);
  const double ejecta = rim / (r2 * std::sqrt(r2)) * (1.0 - q) * (1.0 - q);
  // Wear rounds the rim.
  return soft_min(bowl, ejecta, size * (0.04 + 0.08 * (1.0 - crater.freshness)));
}

double fractal_relief_m(std::uint64_t seed, double east_m, double north_m) {
  const std::uint64_t stream = mix64(seed ^ kFractalStream);
  double sum = 0.0;
  for (std::size_t i = 0; i < kOctaveTable.size(); ++i) {
    const Octave& o = kOctaveTable[i];
    const double x = (o.cos * east_m - o.sin * north_m) * o.inverse_m;
    const double y = (o.sin * east_m + o.cos * north_m) * o.inverse_m;
    sum += o.sigma_m * gradient_noise(stream + i * 0xe7037ed1a0b428dbULL, x, y);
  }
  return sum;
}

double crater_relief_m(std::uint64_t seed, double east_m, double north_m) {
  double sum = 0.0;
  for (std::size_t k = 0; k < kClassTable.size(); ++k) {
    const CraterClass& c = kClassTable[k];
    const std::uint64_t stream = class_stream(seed, k);
    // The 2 x 2 cells nearest to the point.
    const auto ix = static_cast<std::int64_t>(std::floor(east_m / c.cell_m - 0.5));
    const auto iy = static_cast<std::int64_t>(std::floor(north_m / c.cell_m - 0.5));
    const double reach2 = 0.25 * c.cell_m * c.cell_m;
    for (std::int64_t dy = 0; dy < 2; ++dy)
      for (std::int64_t dx = 0; dx < 2; ++dx)
        for_craters_of_cell(
            c, stream, ix + dx, iy + dy, [&](double east, double north, std::uint64_t place) {
              const double de = east_m - east, dn = north_m - north;
              const double d2 = de * de + dn * dn;
              if (d2 < reach2)
                sum += crater_profile_m(make_crater(c, east, north, place), std::sqrt(d2));
            });
  }
  return sum;
}

double ripple_relief_m(std::uint64_t seed, double east_m, double north_m) {
  constexpr double kWavelength_m = 4.0, kAmplitude_m = 0.08;
  const std::uint64_t stream = mix64(seed ^ kRippleStream);
  // Patches where a slow noise is high: about a sixth of the ground.
  const double patch = gradient_noise(stream, east_m / 70.0 + 0.37, north_m / 70.0 + 0.61);
  const double t = std::clamp((patch - 0.7) / 0.8, 0.0, 1.0);
  if (t <= 0.0) return 0.0;
  const double mask = t * t * (3.0 - 2.0 * t);
  // Crests run across the wind and wander by a wavelength over some 45 m.
  const double wander = gradient_noise(stream + 1, east_m / 45.0, north_m / 45.0);
  const double along = 0.8 * east_m + 0.6 * north_m;
  return kAmplitude_m * mask *
         std::sin(2.0 * std::numbers::pi * (along / kWavelength_m + 0.6 * wander));
}

std::vector<SyntheticCrater> synthetic_craters(std::uint64_t seed, double east_min_m,
                                               double north_min_m, double east_max_m,
                                               double north_max_m) {
  std::vector<SyntheticCrater> craters;
  for (std::size_t k = 0; k < kClassTable.size(); ++k) {
    const CraterClass& c = kClassTable[k];
    const auto cell = [&](double x) { return static_cast<std::int64_t>(std::floor(x / c.cell_m)); };
    for (std::int64_t iy = cell(north_min_m); iy <= cell(north_max_m); ++iy)
      for (std::int64_t ix = cell(east_min_m); ix <= cell(east_max_m); ++ix)
        for_craters_of_cell(c, class_stream(seed, k), ix, iy,
                            [&](double east, double north, std::uint64_t place) {
                              if (east >= east_min_m && east < east_max_m && north >= north_min_m &&
                                  north < north_max_m)
                                craters.push_back(make_crater(c, east, north, place));
                            });
  }
  return craters;
}

double synthetic_height_m(const SyntheticSite& site, double east_m, double north_m) {
  return kSyntheticBase_m + fractal_relief_m(site.seed, east_m, north_m) +
         crater_relief_m(site.seed, east_m, north_m) + ripple_relief_m(site.seed, east_m, north_m);
}

}  // namespace maquette::assets
