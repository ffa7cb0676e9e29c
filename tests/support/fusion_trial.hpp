// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fusion_trial.hpp
/// Gaussian relief that is known, two sources that saw it, and the best that can be made of them:
/// the oracle, which knows spectrum, noise and pixels, and solves for all nodes at once (Wiener's
/// combination where a source ends too). It shares nothing with heightmap/detail/blend.hpp.

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numbers>
#include <vector>

#include "core/grid.hpp"
#include "core/random.hpp"

namespace maquette::testing_support {

using Complex = std::complex<double>;

/// In place, length a power of two.
inline void fft(std::vector<Complex>& a, bool inverse) {
  const std::size_t n = a.size();
  static thread_local std::vector<Complex> turn;
  if (turn.size() != n / 2) {
    turn.resize(n / 2);
    for (std::size_t k = 0; k < turn.size(); ++k)
      turn[k] = std::polar(
          1.0, -2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(n));
  }
  for (std::size_t i = 1, j = 0; i < n; ++i) {
    std::size_t bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) std::swap(a[i], a[j]);
  }
  for (std::size_t len = 2; len <= n; len <<= 1)
    for (std::size_t i = 0; i < n; i += len)
      for (std::size_t k = 0; k < len / 2; ++k) {
        const Complex w = turn[k * (n / len)], b = a[i + k + len / 2];
        const double im = inverse ? -w.imag() : w.imag();
        const Complex v(b.real() * w.real() - b.imag() * im, b.real() * im + b.imag() * w.real());
        a[i + k + len / 2] = a[i + k] - v;
        a[i + k] += v;
      }
  if (inverse)
    for (Complex& v : a) v /= static_cast<double>(n);
}

inline void fft2(Grid<Complex>& g, bool inverse) {
  std::vector<Complex> line;
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r) {
    line.assign(g.row(r).begin(), g.row(r).end());
    fft(line, inverse);
    std::copy(line.begin(), line.end(), g.row(r).begin());
  }
  line.resize(static_cast<std::size_t>(g.rows()));
  for (std::ptrdiff_t c = 0; c < g.cols(); ++c) {
    for (std::ptrdiff_t r = 0; r < g.rows(); ++r) line[static_cast<std::size_t>(r)] = g(r, c);
    fft(line, inverse);
    for (std::ptrdiff_t r = 0; r < g.rows(); ++r) g(r, c) = line[static_cast<std::size_t>(r)];
  }
}

/// z -> spectrum * z, the spectrum by frequency.
inline Grid<double> filtered(const Grid<double>& z, const Grid<double>& by) {
  Grid<Complex> g(z.rows(), z.cols());
  for (std::size_t i = 0; i < z.cells().size(); ++i) g.cells()[i] = z.cells()[i];
  fft2(g, false);
  for (std::size_t i = 0; i < z.cells().size(); ++i) g.cells()[i] *= by.cells()[i];
  fft2(g, true);
  Grid<double> out(z.rows(), z.cols());
  for (std::size_t i = 0; i < z.cells().size(); ++i) out.cells()[i] = g.cells()[i].real();
  return out;
}

struct TrialCase {
  std::uint64_t seed = 1;
  double hurst = 0.7;
  double coarse_sigma_m = 1.0, fine_sigma_m = 0.1;
  std::ptrdiff_t coarse_pixel = 8;
};

/// Three kinds of relief, noise from half to fifty times the relief of waves of two to four nodes.
inline std::vector<TrialCase> trial_cases(std::uint64_t count = 10) {
  std::vector<TrialCase> out;
  for (std::uint64_t seed = 1; seed <= count; ++seed)
    out.push_back({seed, std::array{0.5, 0.7, 0.9}[seed % 3],
                   std::array{0.2, 0.5, 1.0, 2.0}[seed % 4],
                   std::array{0.03, 0.06, 0.1, 0.15, 0.2}[seed % 5], seed % 2 == 0 ? 4 : 8});
  return out;
}

struct Trial {
  static constexpr std::ptrdiff_t kNodes = 128;  // one metre apart
  TrialCase what;
  Grid<double> truth;     ///< means over the nodes' cells
  Grid<double> spectrum;  ///< expected power of each frequency of the truth, m^2
  Grid<double> coarse;    ///< pixels, coarse_pixel nodes wide
  Grid<float> base;       ///< the coarse pixels on nodes, by Keys' cubic convolution
  Grid<float> layer;      ///< fine source, a pixel a node, void (NaN) east of border()

  /// First column without the fine source.
  [[nodiscard]] std::ptrdiff_t border(std::ptrdiff_t r) const {
    return 68 + static_cast<std::ptrdiff_t>(std::lround(
                    6.0 * std::sin(2.0 * std::numbers::pi * static_cast<double>(r) / kNodes)));
  }
};

namespace fusion_trial_detail {

inline double keys_weight(double t) {
  t = std::abs(t);
  return t < 1.0   ? (1.5 * t - 2.5) * t * t + 1.0
         : t < 2.0 ? ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0
                   : 0.0;
}

/// Frequency of index i of n, cycles per sample.
inline double frequency(std::ptrdiff_t i, std::ptrdiff_t n) {
  return static_cast<double>(i < n / 2 ? i : i - n) / static_cast<double>(n);
}

inline Grid<double> block_means(const Grid<double>& z, std::ptrdiff_t m) {
  Grid<double> out(z.rows() / m, z.cols() / m, 0.0);
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      out(r / m, c / m) += z(r, c) / static_cast<double>(m * m);
  return out;
}

}  // namespace fusion_trial_detail

/// Relief with V(1 m) = 0.01 m^2 as means over cells of half a metre, averaged to those of nodes.
inline Trial make_trial(const TrialCase& what) {
  using namespace fusion_trial_detail;
  Trial t;
  t.what = what;
  constexpr std::ptrdiff_t n = Trial::kNodes, m = 2 * n;
  const double pi = std::numbers::pi, h = what.hurst;
  const double integral =
      std::tgamma(1.0 - h) / (std::exp2(2.0 * h + 1.0) * h * std::tgamma(1.0 + h));
  const double a = 0.01 / (4.0 * pi * std::pow(2.0 * pi, 2.0 * h) * integral);
  // Spectrum in cycles per metre, with what means over half a metre leave of waves that are shorter
  // than two of them; a discrete frequency stands for 1 / n^2 of the plane.
  const auto mean = [pi](double f) {
    return f == 0.0 ? 1.0 : std::sin(0.5 * pi * f) / (0.5 * pi * f);
  };
  Grid<double> half(m, m, 0.0);
  for (std::ptrdiff_t r = 0; r < m; ++r)
    for (std::ptrdiff_t c = 0; c < m; ++c)
      for (int i = -1; i <= 1; ++i)
        for (int j = -1; j <= 1; ++j) {
          if (r == 0 && c == 0) continue;
          const double fy = 2.0 * (frequency(r, m) + i), fx = 2.0 * (frequency(c, m) + j);
          half(r, c) += a * std::pow(mean(fy) * mean(fx), 2.0) *
                        std::pow(std::hypot(fy, fx), -2.0 * h - 2.0) / static_cast<double>(n * n);
        }
  Grid<double> white(m, m), root(m, m);
  for (std::size_t i = 0; i < white.cells().size(); ++i) {
    white.cells()[i] = random_normal(what.seed, i);
    root.cells()[i] = std::sqrt(half.cells()[i]) * static_cast<double>(m);
  }
  t.truth = block_means(filtered(white, root), 2);
  t.spectrum = Grid<double>(n, n, 0.0);
  for (std::ptrdiff_t r = 0; r < m; ++r)
    for (std::ptrdiff_t c = 0; c < m; ++c) {
      const double of_two = std::cos(pi * frequency(r, m)) * std::cos(pi * frequency(c, m));
      t.spectrum(r % n, c % n) += half(r, c) * of_two * of_two;
    }
  const std::ptrdiff_t p = what.coarse_pixel;
  t.coarse = block_means(t.truth, p);
  for (std::size_t i = 0; i < t.coarse.cells().size(); ++i)
    t.coarse.cells()[i] += what.coarse_sigma_m * random_normal(1000 + what.seed, i);
  t.base = Grid<float>(n, n);
  t.layer = Grid<float>(n, n, NAN);
  const auto pixel = [&](std::ptrdiff_t i) {
    return (i + t.coarse.rows()) % t.coarse.rows();  // the relief is periodic
  };
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) {
      const double v = (static_cast<double>(r) + 0.5) / static_cast<double>(p) - 0.5;
      const double u = (static_cast<double>(c) + 0.5) / static_cast<double>(p) - 0.5;
      const auto i0 = static_cast<std::ptrdiff_t>(std::floor(v)) - 1;
      const auto j0 = static_cast<std::ptrdiff_t>(std::floor(u)) - 1;
      double sum = 0.0;
      for (std::ptrdiff_t i = i0; i < i0 + 4; ++i)
        for (std::ptrdiff_t j = j0; j < j0 + 4; ++j)
          sum += keys_weight(v - static_cast<double>(i)) * keys_weight(u - static_cast<double>(j)) *
                 t.coarse(pixel(i), pixel(j));
      t.base(r, c) = static_cast<float>(sum);
      if (c < t.border(r))
        t.layer(r, c) = static_cast<float>(
            t.truth(r, c) +
            what.fine_sigma_m *
                random_normal(2000 + what.seed, static_cast<std::uint64_t>(r * n + c)));
    }
  return t;
}

/// Mean of the relief given all pixels of both sources: solves (1/S + A' A / s^2 + ...) z =
/// A' y / s^2 + ... by conjugate gradients.
inline Grid<double> oracle(const Trial& t) {
  using namespace fusion_trial_detail;
  constexpr std::ptrdiff_t n = Trial::kNodes;
  const std::ptrdiff_t p = t.what.coarse_pixel;
  const double fine = std::pow(t.what.fine_sigma_m, -2.0);
  const double wide = std::pow(t.what.coarse_sigma_m, -2.0) / static_cast<double>(p * p);
  Grid<double> prior(n, n), guess_fine(n, n), guess_wide(n, n);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) {
      // The truth's mean is zero, and known.
      prior(r, c) = r == 0 && c == 0 ? 1e9 : 1.0 / (t.spectrum(r, c) * n * n);
      guess_fine(r, c) = 1.0 / (prior(r, c) + fine);
      const auto mean = [p](double f) {
        return f == 0.0 ? 1.0
                        : std::sin(std::numbers::pi * f * static_cast<double>(p)) /
                              (static_cast<double>(p) * std::sin(std::numbers::pi * f));
      };
      guess_wide(r, c) =
          1.0 / (prior(r, c) + wide * std::pow(mean(frequency(r, n)) * mean(frequency(c, n)), 2.0));
    }
  // Roughly the inverse: that of either region, each in its place.
  const auto nearly_solved = [&](const Grid<double>& b) {
    Grid<double> inside = b, outside = b;
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c) (c < t.border(r) ? outside : inside)(r, c) = 0.0;
    inside = filtered(inside, guess_fine);
    outside = filtered(outside, guess_wide);
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c)
        if (c >= t.border(r)) inside(r, c) = outside(r, c);
    return inside;
  };
  const auto spread = [&](const Grid<double>& pixels) {
    Grid<double> z(n, n);
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c) z(r, c) = pixels(r / p, c / p);
    return z;
  };
  const auto precision = [&](const Grid<double>& z) {
    Grid<double> out = filtered(z, prior);
    const Grid<double> means = spread(block_means(z, p));
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t c = 0; c < n; ++c)
        out(r, c) += wide * means(r, c) + (c < t.border(r) ? fine * z(r, c) : 0.0);
    return out;
  };
  const auto dot = [](const Grid<double>& a, const Grid<double>& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.cells().size(); ++i) sum += a.cells()[i] * b.cells()[i];
    return sum;
  };
  Grid<double> z(n, n, 0.0), residual = spread(t.coarse);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      residual(r, c) = wide * residual(r, c) +
                       (c < t.border(r) ? fine * static_cast<double>(t.layer(r, c)) : 0.0);
  Grid<double> scaled = nearly_solved(residual), way = scaled;
  double size = dot(residual, scaled);
  const double enough = 1e-10 * size;
  for (int i = 0; i < 300 && size > enough; ++i) {
    const Grid<double> image = precision(way);
    const double step = size / dot(way, image);
    for (std::size_t k = 0; k < z.cells().size(); ++k) {
      z.cells()[k] += step * way.cells()[k];
      residual.cells()[k] -= step * image.cells()[k];
    }
    scaled = nearly_solved(residual);
    const double next = dot(residual, scaled);
    for (std::size_t k = 0; k < z.cells().size(); ++k)
      way.cells()[k] = scaled.cells()[k] + next / size * way.cells()[k];
    size = next;
  }
  return z;
}

}  // namespace maquette::testing_support
