// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/composite_bands.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/detail/fourier.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kFlat = 1e-5;  // slopes of the other surface: rounding of float, or no gain at all
constexpr double kGapCrossovers = 4.0;  // beyond the edge, before the opposite edge

/// 0 to 1 with three derivatives of zero at both ends: no corner that a band would show.
double faded(double t) {
  return t * t * t * t * (35.0 + t * (-84.0 + t * (70.0 - 20.0 * t)));
}

/// Octaves by which a wave is shorter than sqrt(2) crossovers, 0 to 1.
double octave(double f_per_m, double crossover_m) {
  return std::clamp(std::log2(std::max(1e-30, f_per_m * crossover_m)) + 0.5, 0.0, 1.0);
}

/// Least-squares plane of a grid, taken from the middle.
struct Plane {
  double mean = 0.0, along_r = 0.0, along_c = 0.0;
};
Plane plane_of(const Grid<float>& z) {
  Plane p;
  const double r0 = 0.5 * static_cast<double>(z.rows() - 1),
               c0 = 0.5 * static_cast<double>(z.cols() - 1);
  double rr = 0.0, cc = 0.0;
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
      const double y = static_cast<double>(r) - r0, x = static_cast<double>(c) - c0,
                   h = static_cast<double>(z(r, c));
      p.mean += h;
      p.along_r += y * h;
      p.along_c += x * h;
      rr += y * y;
      cc += x * x;
    }
  p.mean /= static_cast<double>(z.cells().size());
  p.along_r /= std::max(1.0, rr);
  p.along_c /= std::max(1.0, cc);
  return p;
}

/// A line of n known values goes on to its whole length, as the file says of edges.
void extend(std::vector<double>& line, std::ptrdiff_t n) {
  const auto whole = static_cast<std::ptrdiff_t>(line.size()), gap = whole - n;
  const auto at = [&](std::ptrdiff_t i) {
    return line[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, n - 1))];
  };
  std::vector<double> beyond(static_cast<std::size_t>(gap));
  for (std::ptrdiff_t k = 0; k < gap; ++k) {
    const double after = 2.0 * at(n - 1) - at(n - 2 - k), before = 2.0 * at(0) - at(gap - k);
    const double t = static_cast<double>(k + 1) / static_cast<double>(gap + 1);
    beyond[static_cast<std::size_t>(k)] = after + faded(t) * (before - after);
  }
  std::copy(beyond.begin(), beyond.end(), line.begin() + n);
}

/// Both surfaces, the relief as real and the detail as imaginary part, on a torus.
class Waves {
 public:
  Waves(const Grid<float>& relief_m, const Grid<float>& detail_m, double spacing_m,
        double crossover_m)
      : rows_(relief_m.rows()), cols_(relief_m.cols()), spacing_(spacing_m) {
    const auto gap =
        static_cast<std::ptrdiff_t>(std::ceil(kGapCrossovers * crossover_m / spacing_m));
    n_ = smooth_size(std::max(rows_, cols_) + gap);
    a_.resize(static_cast<std::size_t>(n_ * n_));
    put(relief_m, false);
    put(detail_m, true);
    fourier(a_, n_, true);
  }

  /// The surfaces' waves, each multiplied by keep(cycles per metre).
  template <class Keep>
  [[nodiscard]] std::vector<std::complex<float>> filtered(const Keep& keep) const {
    std::vector<std::complex<float>> out(a_.size());
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, n_, [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < n_; ++c) {
        const auto i = static_cast<std::size_t>(r * n_ + c);
        out[i] = a_[i] * static_cast<float>(keep(frequency(r, c)));
      }
    });
    fourier(out, n_, false);
    return out;
  }

  /// Root mean square of both, of the nodes that are `margin` from the edge.
  [[nodiscard]] std::array<double, 2> rms(const std::vector<std::complex<float>>& of,
                                          std::ptrdiff_t margin) const {
    double real = 0.0, imaginary = 0.0, n = 0.0;
    for (std::ptrdiff_t r = margin; r < rows_ - margin; ++r)
      for (std::ptrdiff_t c = margin; c < cols_ - margin; ++c) {
        const std::complex<double> v(of[static_cast<std::size_t>(r * n_ + c)]);
        real += v.real() * v.real();
        imaginary += v.imag() * v.imag();
        n += 1.0;
      }
    return {std::sqrt(real / n), std::sqrt(imaginary / n)};
  }

  /// Independent values that a band has on an area, all its waves alike.
  template <class Keep>
  [[nodiscard]] double degrees_of_freedom(const Keep& keep, double area_m2) const {
    double sum = 0.0, square = 0.0;
    for (std::ptrdiff_t r = 0; r < n_; ++r)
      for (std::ptrdiff_t c = 0; c < n_; ++c) {
        const double w = std::pow(keep(frequency(r, c)), 2);
        sum += w;
        square += w * w;
      }
    const double side_m = static_cast<double>(n_) * spacing_;
    return square > 0.0 ? sum * sum / square * area_m2 / (side_m * side_m) : 0.0;
  }
  [[nodiscard]] std::ptrdiff_t side() const { return n_; }

 private:
  [[nodiscard]] double frequency(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return std::hypot(static_cast<double>(std::min(r, n_ - r)),
                      static_cast<double>(std::min(c, n_ - c))) /
           (static_cast<double>(n_) * spacing_);
  }

  void put(const Grid<float>& z, bool imaginary) {
    const Plane plane = plane_of(z);
    const auto set = [&](std::ptrdiff_t r, std::ptrdiff_t c, double v) {
      auto& a = a_[static_cast<std::size_t>(r * n_ + c)];
      a = imaginary ? std::complex<float>(a.real(), static_cast<float>(v))
                    : std::complex<float>(static_cast<float>(v), a.imag());
    };
    const auto get = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
      const auto& a = a_[static_cast<std::size_t>(r * n_ + c)];
      return static_cast<double>(imaginary ? a.imag() : a.real());
    };
    const double r0 = 0.5 * static_cast<double>(rows_ - 1),
                 c0 = 0.5 * static_cast<double>(cols_ - 1);
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows_, [&](std::ptrdiff_t r) {
      std::vector<double> line(static_cast<std::size_t>(n_));
      for (std::ptrdiff_t c = 0; c < cols_; ++c)
        line[static_cast<std::size_t>(c)] = static_cast<double>(z(r, c)) - plane.mean -
                                            plane.along_r * (static_cast<double>(r) - r0) -
                                            plane.along_c * (static_cast<double>(c) - c0);
      extend(line, cols_);
      for (std::ptrdiff_t c = 0; c < n_; ++c) set(r, c, line[static_cast<std::size_t>(c)]);
    });
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, n_, [&](std::ptrdiff_t c) {
      std::vector<double> line(static_cast<std::size_t>(n_));
      for (std::ptrdiff_t r = 0; r < rows_; ++r) line[static_cast<std::size_t>(r)] = get(r, c);
      extend(line, rows_);
      for (std::ptrdiff_t r = rows_; r < n_; ++r) set(r, c, line[static_cast<std::size_t>(r)]);
    });
  }

  std::ptrdiff_t rows_, cols_, n_ = 0;
  double spacing_;
  std::vector<std::complex<float>> a_;
};

/// Slopes of the octave around a wavelength.
auto slopes_around(double wavelength_m) {
  return
      [wavelength_m](double f) { return 2.0 * kPi * f * std::sin(kPi * octave(f, wavelength_m)); };
}

}  // namespace

CompositeMatch match_slopes(const Grid<float>& relief_m, const Grid<float>& detail_m,
                            double spacing_m, double crossover_m) {
  const Waves waves(relief_m, detail_m, spacing_m, crossover_m);
  const std::ptrdiff_t shorter = std::min(relief_m.rows(), relief_m.cols());
  const auto margin =
      std::min(static_cast<std::ptrdiff_t>(std::lround(crossover_m / spacing_m)), shorter / 8);
  CompositeMatch out;
  out.crossover_m = crossover_m;
  const auto here = slopes_around(crossover_m), longer = slopes_around(2.0 * crossover_m);
  const auto [relief, detail] = waves.rms(waves.filtered(here), margin);
  out.relief_slope = relief;
  out.detail_slope = detail;
  if (!(detail > kFlat * relief && relief > kFlat * detail)) return out;
  out.gain = relief / detail;
  const double width_m = spacing_m * static_cast<double>(relief_m.cols() - 2 * margin),
               height_m = spacing_m * static_cast<double>(relief_m.rows() - 2 * margin);
  // Of each power 2 / n, of the root of their ratio a quarter of both.
  out.gain_sigma = out.gain / std::sqrt(waves.degrees_of_freedom(here, width_m * height_m));
  const auto [relief_longer, detail_longer] = waves.rms(waves.filtered(longer), margin);
  out.gain_longer = detail_longer > 0.0 ? relief_longer / detail_longer : 0.0;
  return out;
}

Grid<float> exchanged_waves(const Grid<float>& relief_m, const Grid<float>& detail_m,
                            double spacing_m, const CompositeMatch& match) {
  const Waves waves(relief_m, detail_m, spacing_m, match.crossover_m);
  const auto angle = [&](double f) { return 0.5 * kPi * faded(octave(f, match.crossover_m)); };
  Grid<float> out(relief_m.rows(), relief_m.cols());
  const auto at = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return static_cast<std::size_t>(r * waves.side() + c);
  };
  const auto away = waves.filtered([&](double f) { return 1.0 - std::cos(angle(f)); });
  for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) out(r, c) = -away[at(r, c)].real();
  const auto in = waves.filtered([&](double f) { return std::sin(angle(f)); });
  const auto gain = static_cast<float>(match.gain);
  for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) out(r, c) += gain * in[at(r, c)].imag();
  return out;
}

}  // namespace maquette::heightmap::detail
