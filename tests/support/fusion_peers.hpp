// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fusion_peers.hpp
/// What others make of the two sources of a fusion trial, and the figures of all. Needs LIBS
/// GDAL::GDAL.

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <gdal_priv.h>
#include <gdal_utils.h>

#include "heightmap/detail/blend.hpp"
#include "support/fusion_trial.hpp"

namespace maquette::testing_support {

/// gdalwarp -r cubic of both onto the nodes, the fine source last and so on top.
inline Grid<float> gdalwarp_mosaic(const Trial& t) {
  GDALAllRegister();
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  constexpr int n = static_cast<int>(Trial::kNodes);
  const auto dataset = [&](int side, double pixel) {
    GDALDataset* d = memory->Create("", side, side, 1, GDT_Float32, nullptr);
    std::array<double, 6> transform{0.0, pixel, 0.0, 0.0, 0.0, pixel};
    d->SetGeoTransform(transform.data());
    d->GetRasterBand(1)->SetNoDataValue(NAN);
    return d;
  };
  const auto transfer = [](GDALDataset* d, GDALRWFlag way, float* cells) {
    const int side = d->GetRasterXSize();
    return d->GetRasterBand(1)->RasterIO(way, 0, 0, side, side, cells, side, side, GDT_Float32, 0,
                                         0, nullptr);
  };
  std::vector<float> pixels(t.coarse.cells().begin(), t.coarse.cells().end());
  Grid<float> fine = t.layer, out(n, n, NAN);
  GDALDataset* coarse =
      dataset(static_cast<int>(t.coarse.cols()), static_cast<double>(t.what.coarse_pixel));
  GDALDataset* layer = dataset(n, 1.0);
  GDALDataset* result = dataset(n, 1.0);
  CPLErr failed = transfer(coarse, GF_Write, pixels.data());
  failed = std::max(failed, transfer(layer, GF_Write, fine.cells().data()));
  failed = std::max(failed, transfer(result, GF_Write, out.cells().data()));
  std::array<char*, 3> arguments{const_cast<char*>("-r"), const_cast<char*>("cubic"), nullptr};
  GDALWarpAppOptions* options = GDALWarpAppOptionsNew(arguments.data(), nullptr);
  std::array<GDALDatasetH, 2> sources{coarse, layer};
  GDALWarp(nullptr, result, 2, sources.data(), options, nullptr);
  GDALWarpAppOptionsFree(options);
  failed = std::max(failed, transfer(result, GF_Read, out.cells().data()));
  for (GDALDataset* d : {coarse, layer, result}) GDALClose(d);
  return failed == CE_None ? out : Grid<float>(n, n, NAN);
}

/// Distance of a node inside the layer from its border, along the row.
inline double depth(const Trial& t, std::ptrdiff_t r, std::ptrdiff_t c) {
  return static_cast<double>(t.border(r) - c);
}

/// The layer's share rises over two coarse pixels from its border.
inline Grid<float> linear_feather(const Trial& t) {
  Grid<float> z = t.base;
  const double ramp = 2.0 * static_cast<double>(t.what.coarse_pixel);
  for (std::ptrdiff_t r = 0; r < Trial::kNodes; ++r)
    for (std::ptrdiff_t c = 0; c < t.border(r); ++c) {
      const auto w = static_cast<float>(std::min(1.0, depth(t, r, c) / ramp));
      z(r, c) += w * (t.layer(r, c) - z(r, c));
    }
  return z;
}

/// Waves longer than a coarse pixel over that ramp, shorter ones over three nodes.
inline Grid<float> two_band_blend(const Trial& t) {
  constexpr std::ptrdiff_t n = Trial::kNodes;
  const auto p = static_cast<double>(t.what.coarse_pixel);
  Grid<float> difference(n, n, 0.0F), weight(n, n, 0.0F), z = t.base;
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < t.border(r); ++c) {
      difference(r, c) = t.layer(r, c) - t.base(r, c);
      weight(r, c) = 1.0F;
    }
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(2.0 * p));
  const auto smooth = [&](const Grid<float>& in, std::ptrdiff_t dr, std::ptrdiff_t dc) {
    Grid<float> out(n, n, 0.0F);
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c)
        for (std::ptrdiff_t k = -reach; k <= reach; ++k)
          if (in.contains(r + k * dr, c + k * dc))
            out(r, c) += static_cast<float>(std::exp(-2.0 * static_cast<double>(k * k) / (p * p))) *
                         in(r + k * dr, c + k * dc);
    return out;
  };
  const Grid<float> low = smooth(smooth(difference, 0, 1), 1, 0);
  const Grid<float> seen = smooth(smooth(weight, 0, 1), 1, 0);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < t.border(r); ++c) {
      const float wide = low(r, c) / seen(r, c);
      const double d = depth(t, r, c);
      z(r, c) += static_cast<float>(std::min(1.0, d / (2.0 * p))) * wide +
                 static_cast<float>(std::min(1.0, d / 3.0)) * (difference(r, c) - wide);
    }
  return z;
}

struct Fused {
  Grid<float> z_m, sigma_m;
};
/// Ours: spectrum and white noise measured from the sources, `sigma` as they are said to have.
inline Fused fused(const Trial& t, bool restoring = true) {
  using namespace heightmap::detail;
  heightmap::PixelWindow window;
  window.height_m = t.layer;
  const Roughness law = measure_roughness(window, {1.0, 1.0});
  std::size_t levels = 1;
  while ((std::ptrdiff_t{1} << (levels - 1)) < t.what.coarse_pixel) ++levels;
  const WaveTable waves = wave_table(law, 1.0, static_cast<double>(Trial::kNodes), levels);
  Blend blend(waves, t.base,
              knowledge_of(waves, static_cast<double>(t.what.coarse_pixel), t.what.coarse_sigma_m),
              {}, restoring);
  blend.add(t.layer, knowledge_of(waves, 1.0, std::min(t.what.fine_sigma_m, law.noise_m)));
  return {blend.heights_m(), blend.sigma_m()};
}

/// Ours of the coarse source alone, whose spectrum and noise are known.
inline Grid<float> restored(const Trial& t) {
  using namespace heightmap::detail;
  std::size_t levels = 1;
  while ((std::ptrdiff_t{1} << (levels - 1)) < t.what.coarse_pixel) ++levels;
  const WaveTable waves =
      wave_table({t.what.hurst, 0.01, 0.0}, 1.0, static_cast<double>(Trial::kNodes), levels);
  return Blend(waves, t.base,
               knowledge_of(waves, static_cast<double>(t.what.coarse_pixel), t.what.coarse_sigma_m),
               {}, true)
      .take_heights_m();
}

/// Places of a trial, away from the grid's edge.
enum Place { kInside, kInsideBorder, kOutsideBorder, kOutside, kPlaces };

inline Place place_of(const Trial& t, std::ptrdiff_t r, std::ptrdiff_t c) {
  const std::ptrdiff_t from = c - t.border(r), p = t.what.coarse_pixel;
  return from < -p ? kInside : from < 0 ? kInsideBorder : from < p ? kOutsideBorder : kOutside;
}

constexpr std::ptrdiff_t kTrialMargin = 12;

template <class Each>
void for_trial_nodes(const Each& each) {
  for (std::ptrdiff_t r = kTrialMargin; r < Trial::kNodes - kTrialMargin; ++r)
    for (std::ptrdiff_t c = kTrialMargin; c < Trial::kNodes - kTrialMargin; ++c) each(r, c);
}

/// Sums of one method over trials.
struct Score {
  std::string name;
  std::array<double, kPlaces> square{}, nodes{};
  double step_square = 0.0, step_noise_square = 0.0;  ///< see add_step
  /// Of profiles along the border, up to a coarse pixel inside: power by octave (2 to 4, ... nodes)
  /// where relief is above the fine source's noise. A profile's octave has waves that cross it,
  /// too, which are shorter. Each trial alike, however rough its relief is.
  std::array<double, 4> power{}, true_power{};

  [[nodiscard]] double rmse(Place p) const { return std::sqrt(square[p] / nodes[p]); }
  [[nodiscard]] double rmse_at_border() const {
    return std::sqrt((square[kInsideBorder] + square[kOutsideBorder]) /
                     (nodes[kInsideBorder] + nodes[kOutsideBorder]));
  }
  [[nodiscard]] double rmse_of_all() const {
    double s = 0.0, n = 0.0;
    for (std::size_t p = 0; p < kPlaces; ++p) {
      s += square[p];
      n += nodes[p];
    }
    return std::sqrt(s / n);
  }
  /// Height of the step at the border, rms, in units of the base's noise.
  [[nodiscard]] double step() const { return std::sqrt(step_square / step_noise_square); }
};

/// Power of a profile in octaves of 2 to 4, 4 to 8, ... nodes, with Hann's window.
template <class Value>
std::array<double, 4> octave_powers(const Value& value) {
  constexpr std::ptrdiff_t n = Trial::kNodes;
  std::vector<Complex> line(n);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    line[static_cast<std::size_t>(r)] =
        value(r) * std::pow(std::sin(std::numbers::pi * static_cast<double>(r) / n), 2.0);
  fft(line, false);
  std::array<double, 4> out{};
  for (std::size_t k = 4; k < 64; ++k)
    out[static_cast<std::size_t>(5.999 - std::log2(static_cast<double>(k)))] += std::norm(line[k]);
  return out;
}

constexpr std::size_t kOctaves = 4;  ///< waves of 2 to 4, ... 16 to 32 nodes

/// Octave of a wave; kOctaves and more for those that are not looked at.
inline std::size_t octave_of(double fx, double fy) {
  const double octave = -1.0 - std::log2(std::max(1e-9, std::hypot(fx, fy)));
  return octave < 0.0 ? kOctaves : static_cast<std::size_t>(octave);
}

/// Power of waves by octave of their length, of n x n nodes from (r0, c0), with Hann's window: up
/// to n / 2 nodes long.
template <std::ptrdiff_t n, class Value>
std::array<double, kOctaves> wave_powers(const Value& value, std::ptrdiff_t r0, std::ptrdiff_t c0) {
  Grid<Complex> g(n, n);
  const auto window = [](std::ptrdiff_t i) {
    return std::pow(std::sin(std::numbers::pi * (static_cast<double>(i) + 0.5) / n), 2.0);
  };
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) g(r, c) = value(r0 + r, c0 + c) * window(r) * window(c);
  fft2(g, false);
  std::array<double, kOctaves> out{};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      if (const std::size_t k =
              octave_of(fusion_trial_detail::frequency(r, n), fusion_trial_detail::frequency(c, n));
          k < kOctaves)
        out[k] += std::norm(g(r, c));
  return out;
}

/// Relief as drawn, by octave of waves, m^2, and of profiles.
struct Expected {
  std::array<double, kOctaves> relief_m2{}, over_noise{};
  std::array<double, 4> profile_m2{}, profile_over_noise{};
};
inline Expected expected(const Trial& t) {
  Expected out;
  constexpr std::ptrdiff_t n = Trial::kNodes;
  const double noise_m2 = t.what.fine_sigma_m * t.what.fine_sigma_m / static_cast<double>(n * n);
  std::array<double, kOctaves> noise{};
  std::array<double, 4> profile_noise{};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) {
      const double fy = fusion_trial_detail::frequency(r, n),
                   fx = fusion_trial_detail::frequency(c, n);
      if (const std::size_t k = octave_of(fx, fy); k < kOctaves) {
        out.relief_m2[k] += t.spectrum(r, c);
        noise[k] += noise_m2;
      }
      if (r < 4 || r >= 64) continue;
      const auto k = static_cast<std::size_t>(5.999 - std::log2(static_cast<double>(r)));
      out.profile_m2[k] += t.spectrum(r, c);
      profile_noise[k] += noise_m2;
    }
  for (std::size_t k = 0; k < kOctaves; ++k) out.over_noise[k] = out.relief_m2[k] / noise[k];
  for (std::size_t k = 0; k < 4; ++k)
    out.profile_over_noise[k] = out.profile_m2[k] / profile_noise[k];
  return out;
}

/// Power of waves inside the fine source, over that of the truth, by octave and by how far relief
/// is above the noise there.
struct WaveLedger {
  static constexpr std::array<double, 3> kFrom{1.0, 2.0, 4.0};  ///< relief over noise
  static constexpr std::size_t kShown = 3;                      ///< octaves
  std::array<std::array<double, kFrom.size()>, kShown> ours{}, truth{}, trials{};
  template <class Heights>
  void add(const Trial& t, const Heights& z) {
    const Expected e = expected(t);
    std::array<double, kShown> a{}, b{};
    for (const std::ptrdiff_t r0 : {12, 36, 60, 84})
      for (const std::ptrdiff_t c0 : {13, 29}) {
        const auto x =
            wave_powers<32>([&](auto r, auto c) { return static_cast<double>(z(r, c)); }, r0, c0);
        const auto y = wave_powers<32>([&](auto r, auto c) { return t.truth(r, c); }, r0, c0);
        for (std::size_t k = 0; k < kShown; ++k) {
          a[k] += x[k] / e.relief_m2[k];
          b[k] += y[k] / e.relief_m2[k];
        }
      }
    for (std::size_t k = 0; k < kShown; ++k)
      for (std::size_t i = kFrom.size(); i-- > 0;)
        if (e.over_noise[k] >= kFrom[i]) {
          ours[k][i] += a[k];
          truth[k][i] += b[k];
          trials[k][i] += 1.0;
          break;
        }
  }
};

template <class Heights>
void add_to(Score& score, const Trial& t, const Heights& z) {
  const auto error = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return static_cast<double>(z(r, c)) - t.truth(r, c);
  };
  for_trial_nodes([&](auto r, auto c) {
    const Place p = place_of(t, r, c);
    score.square[p] += error(r, c) * error(r, c);
    score.nodes[p] += 1.0;
  });
  const std::ptrdiff_t p = t.what.coarse_pixel;
  // A step is what a run of nodes along the border has in common.
  for (std::ptrdiff_t r = kTrialMargin; r + p <= Trial::kNodes - kTrialMargin; r += p) {
    double step = 0.0;
    for (std::ptrdiff_t i = r; i < r + p; ++i)
      step += (error(i, t.border(i)) - error(i, t.border(i) - 1)) / static_cast<double>(p);
    score.step_square += step * step;
    score.step_noise_square += t.what.coarse_sigma_m * t.what.coarse_sigma_m;
  }
  const Expected e = expected(t);
  for (std::ptrdiff_t d = 1; d <= p; ++d) {
    const auto ours =
        octave_powers([&](std::ptrdiff_t r) { return double(z(r, t.border(r) - d)); });
    const auto truth = octave_powers([&](std::ptrdiff_t r) { return t.truth(r, t.border(r) - d); });
    for (std::size_t k = 0; k < ours.size(); ++k) {
      if (e.profile_over_noise[k] < 1.0) continue;
      score.power[k] += ours[k] / e.profile_m2[k] / static_cast<double>(p);
      score.true_power[k] += truth[k] / e.profile_m2[k] / static_cast<double>(p);
    }
  }
}

/// Share of errors within one and within 1.96 stated sigma.
struct Coverage {
  std::array<double, kPlaces> one{}, two{}, nodes{};
  std::array<double, 3> outermost{};  ///< of the fine source's outermost nodes: one, two, nodes
  void add(const Trial& t, const Fused& f) {
    for_trial_nodes([&](auto r, auto c) {
      const Place p = place_of(t, r, c);
      const double e = std::abs(static_cast<double>(f.z_m(r, c)) - t.truth(r, c));
      const auto s = static_cast<double>(f.sigma_m(r, c));
      one[p] += e < s ? 1.0 : 0.0;
      two[p] += e < 1.96 * s ? 1.0 : 0.0;
      nodes[p] += 1.0;
      if (c + 1 != t.border(r)) return;
      outermost[0] += e < s ? 1.0 : 0.0;
      outermost[1] += e < 1.96 * s ? 1.0 : 0.0;
      outermost[2] += 1.0;
    });
  }
};

struct FusionTable {
  std::vector<Score> scores;  ///< oracle, ours, ours without restoring, mosaic, feather, two bands
  Coverage coverage;
};

inline FusionTable fusion_table() {
  FusionTable table;
  for (const char* name : {"oracle (knows all)", "maquette", "maquette, restore = false",
                           "gdalwarp mosaic", "linear feather", "two-band blend"})
    table.scores.push_back({name});
  for (const TrialCase& what : trial_cases()) {
    const Trial t = make_trial(what);
    const Fused ours = fused(t);
    add_to(table.scores[0], t, oracle(t));
    add_to(table.scores[1], t, ours.z_m);
    add_to(table.scores[2], t, fused(t, false).z_m);
    add_to(table.scores[3], t, gdalwarp_mosaic(t));
    add_to(table.scores[4], t, linear_feather(t));
    add_to(table.scores[5], t, two_band_blend(t));
    table.coverage.add(t, ours);
  }
  return table;
}

}  // namespace maquette::testing_support
