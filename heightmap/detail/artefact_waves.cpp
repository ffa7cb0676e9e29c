// SPDX-License-Identifier: GPL-3.0-or-later

// Waves of one direction lie on a ray of the spectrum, as wide as the window lets it be. Along each
// ray the mean power of bands of a third of an octave is compared with the median of rays beside
// it; means of exponentially distributed powers are gamma distributed, which gives the chance.

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numbers>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>
#include <boost/math/special_functions/gamma.hpp>
#include <unsupported/Eigen/FFT>

#include "heightmap/detail/artefact_finders.hpp"

namespace maquette::heightmap::detail {
namespace {

using Complex = std::complex<float>;
constexpr double kPi = std::numbers::pi;
constexpr std::ptrdiff_t kSmallest = 64, kLargest = 4096;  // pixels of a side
constexpr double kChance = 1e-9;      // of one band of one ray; there are some ten thousand
constexpr double kAbove = 8.0;        // times the rays beside it
constexpr double kFewestWaves = 5.0;  // in the window: longer ones are relief
constexpr std::size_t kMostDirections = 6, kQuarters = 4, kParts = 12;
constexpr double kAlike = 0.65, kSpread = 0.45;
constexpr double kSkirt = 1.15;       // of a band: waves that wander in length leave it a little
constexpr double kHeldPixels = 20.0;  // lines of fewer pixels tell little

std::ptrdiff_t fft_size(std::ptrdiff_t at_least) {
  for (std::ptrdiff_t n = at_least;; ++n) {
    std::ptrdiff_t left = n;
    for (const std::ptrdiff_t p : {2, 3, 5})
      while (left % p == 0) left /= p;
    if (left == 1 && n % 2 == 0) return n;
  }
}

/// Heights less their plane; voids zero.
Grid<float> levelled(const Grid<float>& h) {
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  const auto first =
      std::find_if(h.cells().begin(), h.cells().end(), [](float v) { return !std::isnan(v); });
  const double level = first == h.cells().end() ? 0.0 : static_cast<double>(*first);
  for (std::ptrdiff_t r = 0; r < h.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < h.cols(); ++c) {
      if (std::isnan(h(r, c))) continue;
      const Eigen::Vector3d at(1.0, static_cast<double>(c), static_cast<double>(r));
      a += at * at.transpose();
      b += at * (static_cast<double>(h(r, c)) - level);
    }
  const Eigen::Vector3d plane = a.ldlt().solve(b);
  Grid<float> out(h.rows(), h.cols(), 0.0F);
  for (std::ptrdiff_t r = 0; r < h.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < h.cols(); ++c)
      if (!std::isnan(h(r, c)))
        out(r, c) = static_cast<float>(static_cast<double>(h(r, c)) - level - plane[0] -
                                       plane[1] * static_cast<double>(c) -
                                       plane[2] * static_cast<double>(r));
  return out;
}

/// Power by frequency, of the middle of a window under Hann's taper.
class Spectrum {
 public:
  explicit Spectrum(const Grid<float>& g) {
    const std::ptrdiff_t rows = std::min(g.rows(), kLargest), cols = std::min(g.cols(), kLargest);
    const std::ptrdiff_t r0 = (g.rows() - rows) / 2, c0 = (g.cols() - cols) / 2;
    n_ = fft_size(std::max(rows, cols));
    resolution_ = static_cast<double>(n_) / static_cast<double>(std::min(rows, cols));
    const auto taper = [](std::ptrdiff_t i, std::ptrdiff_t n) {
      return std::pow(std::sin(kPi * (static_cast<double>(i) + 0.5) / static_cast<double>(n)), 2.0);
    };
    const auto n = static_cast<std::size_t>(n_);
    // Rows first; of the columns' frequencies one half says all.
    Grid<Complex> half(rows, n_ / 2 + 1);
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
      std::vector<Complex> line(n), out(n);
      for (std::ptrdiff_t c = 0; c < cols; ++c)
        line[static_cast<std::size_t>(c)] = static_cast<float>(
            static_cast<double>(g(r0 + r, c0 + c)) * taper(r, rows) * taper(c, cols));
      Eigen::FFT<float> fft;
      fft.fwd(out, line);
      std::copy_n(out.begin(), half.cols(), half.row(r).begin());
    });
    power_ = Grid<float>(n_, half.cols());
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, half.cols(), [&](std::ptrdiff_t c) {
      std::vector<Complex> line(n), out(n);
      for (std::ptrdiff_t r = 0; r < rows; ++r) line[static_cast<std::size_t>(r)] = half(r, c);
      Eigen::FFT<float> fft;
      fft.fwd(out, line);
      for (std::ptrdiff_t r = 0; r < n_; ++r)
        power_(r, c) = std::norm(out[static_cast<std::size_t>(r)]);
    });
  }
  /// At k bins in a direction from the columns' to the rows'.
  [[nodiscard]] double at(double k, double towards_rad) const {
    auto x = std::lround(k * std::cos(towards_rad)), y = std::lround(k * std::sin(towards_rad));
    if (x < 0) {
      x = -x;
      y = -y;
    }
    return static_cast<double>(power_((y % n_ + n_) % n_, x));
  }
  [[nodiscard]] std::ptrdiff_t size() const { return n_; }
  /// Bins that the taper's window makes of one frequency.
  [[nodiscard]] double resolution() const { return resolution_; }

 private:
  std::ptrdiff_t n_ = 0;
  double resolution_ = 1.0;
  Grid<float> power_;
};

struct Band {
  double low = 0.0, high = 0.0;  ///< bins, then cycles per pixel
  double share = 0.0;            ///< of its power that is beyond that of directions beside it
};
struct Ray {
  double towards_rad = 0.0, energy = 0.0;
  std::vector<Band> bands;
};

/// The strongest ray that stands above those beside it; no bands if there is none.
Ray strongest(const Spectrum& s) {
  std::vector<Band> bands;
  for (double k = kFewestWaves * s.resolution(); k < 0.47 * static_cast<double>(s.size());) {
    const double next = std::max(k * std::cbrt(2.0), k + 2.0 * s.resolution());
    bands.push_back({k, std::min(next, 0.48 * static_cast<double>(s.size())), 0.0});
    k = next;
  }
  const auto rays = static_cast<std::ptrdiff_t>(kPi * 2.0 * static_cast<double>(s.size()));
  const double turn = kPi / static_cast<double>(rays);
  Grid<double> mean(static_cast<std::ptrdiff_t>(bands.size()), rays);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rays, [&](std::ptrdiff_t i) {
    for (std::size_t b = 0; b < bands.size(); ++b) {
      double sum = 0.0, n = 0.0;
      for (double k = bands[b].low; k < bands[b].high; k += 1.0, n += 1.0)
        sum += s.at(k, turn * static_cast<double>(i));
      mean(static_cast<std::ptrdiff_t>(b), i) = sum / n;
    }
  });
  Grid<double> share(mean.rows(), mean.cols(), 0.0);
  oneapi::tbb::parallel_for(std::size_t{0}, bands.size(), [&](std::size_t b) {
    const auto row = static_cast<std::ptrdiff_t>(b);
    const double middle = 0.5 * (bands[b].low + bands[b].high);
    // Powers a resolution apart are independent, nearly.
    const double n = std::max(1.0, (bands[b].high - bands[b].low) / (1.5 * s.resolution()));
    const double least = boost::math::gamma_q_inv(n, kChance) / n;
    const double median = boost::math::gamma_q_inv(n, 0.5) / n;
    const double aside = 1.5 * s.resolution() / middle / turn;  // rays
    std::vector<double> beside;
    for (std::ptrdiff_t i = 0; i < rays; ++i) {
      beside.clear();
      for (int j = 3; j <= 14; ++j)
        for (const double way : {-1.0, 1.0}) {
          const auto at = i + std::lround(way * aside * static_cast<double>(j));
          beside.push_back(mean(row, (at % rays + rays) % rays));
        }
      std::nth_element(beside.begin(), beside.begin() + 12, beside.end());
      double there = beside[12] / median;
      // Dunes of many directions are above the rays beside them too, but not above the next ones.
      for (const double j : {1.7, 2.7})
        for (const double way : {-1.0, 1.0}) {
          const auto at = i + std::lround(way * aside * j);
          there = std::max(there, mean(row, (at % rays + rays) % rays));
        }
      if (mean(row, i) > std::max(least, kAbove) * there)
        share(row, i) = 1.0 - there / mean(row, i);
    }
  });
  Ray best;
  std::ptrdiff_t best_ray = -1;
  for (std::ptrdiff_t i = 0; i < rays; ++i) {
    double energy = 0.0;
    for (std::size_t b = 0; b < bands.size(); ++b)
      energy += share(static_cast<std::ptrdiff_t>(b), i) * mean(static_cast<std::ptrdiff_t>(b), i) *
                (bands[b].high - bands[b].low);
    if (energy > best.energy) {
      best.energy = energy;
      best_ray = i;
    }
  }
  if (best_ray < 0) return best;
  best.towards_rad = turn * static_cast<double>(best_ray);
  for (std::size_t b = 0; b < bands.size(); ++b)
    if (const double v = share(static_cast<std::ptrdiff_t>(b), best_ray); v > 0.0)
      best.bands.push_back({bands[b].low / static_cast<double>(s.size()),
                            bands[b].high / static_cast<double>(s.size()), v});
  return best;
}

/// Means along lines across a direction, one a pixel of the way; quarters of the lines apart.
struct Profile {
  std::vector<double> mean, pixels;
};
struct Geometry {
  double cos = 1.0, sin = 0.0, first = 0.0;
  std::size_t length = 0;
  double side_first = 0.0, side_length = 1.0;
  Geometry(const Grid<float>& g, double towards_rad)
      : cos(std::cos(towards_rad)), sin(std::sin(towards_rad)) {
    const auto x = static_cast<double>(g.cols() - 1), y = static_cast<double>(g.rows() - 1);
    first = std::min(0.0, x * cos) + std::min(0.0, y * sin);
    const double last = std::max(0.0, x * cos) + std::max(0.0, y * sin);
    length = static_cast<std::size_t>(std::ceil(last - first)) + 2;
    side_first = std::min(0.0, -x * sin) + std::min(0.0, y * cos);
    side_length = std::max(0.0, -x * sin) + std::max(0.0, y * cos) - side_first + 1.0;
  }
  [[nodiscard]] double along(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<double>(c) * cos + static_cast<double>(r) * sin - first;
  }
  [[nodiscard]] std::size_t quarter(std::ptrdiff_t r, std::ptrdiff_t c) const {
    const double side = static_cast<double>(r) * cos - static_cast<double>(c) * sin - side_first;
    return std::min(kQuarters - 1,
                    static_cast<std::size_t>(static_cast<double>(kQuarters) * side / side_length));
  }
};

std::array<Profile, kQuarters> profiles(const Grid<float>& g, const Grid<float>& h,
                                        const Geometry& way) {
  std::array<Profile, kQuarters> out;
  for (Profile& p : out) {
    p.mean.assign(way.length, 0.0);
    p.pixels.assign(way.length, 0.0);
  }
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < g.cols(); ++c) {
      if (std::isnan(h(r, c))) continue;
      const double t = way.along(r, c);
      const auto i = static_cast<std::size_t>(t);
      const double part = t - static_cast<double>(i);
      Profile& p = out[way.quarter(r, c)];
      p.mean[i] += (1.0 - part) * static_cast<double>(g(r, c));
      p.mean[i + 1] += part * static_cast<double>(g(r, c));
      p.pixels[i] += 1.0 - part;
      p.pixels[i + 1] += part;
    }
  return out;
}

Profile together(const std::array<Profile, kQuarters>& quarters) {
  Profile all = quarters[0];
  for (std::size_t q = 1; q < kQuarters; ++q)
    for (std::size_t i = 0; i < all.mean.size(); ++i) {
      all.mean[i] += quarters[q].mean[i];
      all.pixels[i] += quarters[q].pixels[i];
    }
  return all;
}

/// A profile in the ray's bands, each by its share; sums become means, small ones held back.
std::vector<double> in_bands(const Profile& p, const std::vector<Band>& bands) {
  const std::size_t n = p.mean.size();
  const auto padded = static_cast<std::size_t>(fft_size(static_cast<std::ptrdiff_t>(2 * n)));
  // There and back, so that the ends meet.
  std::vector<double> line(padded, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const double v = p.mean[i] / (p.pixels[i] + kHeldPixels);
    line[i] = v;
    line[padded - 1 - i] = v;
  }
  for (std::size_t i = n; i < padded - n; ++i)
    line[i] = p.mean[n - 1] / (p.pixels[n - 1] + kHeldPixels);
  Eigen::FFT<double> fft;
  std::vector<std::complex<double>> waves;
  fft.fwd(waves, line);
  for (std::size_t k = 0; k < waves.size(); ++k) {
    const double f =
        static_cast<double>(std::min(k, waves.size() - k)) / static_cast<double>(waves.size());
    double share = 0.0;
    for (const Band& b : bands) {
      const double out = f < b.low ? b.low / f : f / b.high;
      share = std::max(share, b.share * std::clamp((kSkirt - out) / (kSkirt - 1.0), 0.0, 1.0));
    }
    waves[k] *= share;
  }
  fft.inv(line, waves);
  line.resize(n);
  return line;
}

double energy_of(const std::vector<double>& line, const Profile& p) {
  double sum = 0.0;
  for (std::size_t i = 0; i < line.size(); ++i) sum += line[i] * line[i] * p.pixels[i];
  return sum;
}

/// Turns a ray to where its waves are strongest, a twentieth of a ray's width at a time.
double refined(const Grid<float>& g, const Grid<float>& h, const Ray& ray) {
  double highest = 0.0;
  for (const Band& b : ray.bands) highest = std::max(highest, b.high);
  const double width = 1.0 / (highest * static_cast<double>(std::max(g.rows(), g.cols())));
  constexpr int kTries = 10;
  std::array<double, 2 * kTries + 1> energy{};
  oneapi::tbb::parallel_for(-kTries, kTries + 1, [&](int i) {
    const Geometry way(g, ray.towards_rad + 0.08 * width * i);
    const Profile p = together(profiles(g, h, way));
    energy[static_cast<std::size_t>(i + kTries)] = energy_of(in_bands(p, ray.bands), p);
  });
  const auto best = std::max_element(energy.begin(), energy.end()) - energy.begin();
  return ray.towards_rad + 0.08 * width * (static_cast<double>(best) - kTries);
}

/// Mean correlation of the quarters' profiles.
double alikeness(const std::array<Profile, kQuarters>& quarters, const std::vector<Band>& bands) {
  std::array<std::vector<double>, kQuarters> lines;
  for (std::size_t q = 0; q < kQuarters; ++q) lines[q] = in_bands(quarters[q], bands);
  double sum = 0.0, n = 0.0;
  for (std::size_t a = 0; a < kQuarters; ++a)
    for (std::size_t b = a + 1; b < kQuarters; ++b) {
      double ab = 0.0, aa = 0.0, bb = 0.0;
      for (std::size_t i = 0; i < lines[a].size(); ++i) {
        if (std::min(quarters[a].pixels[i], quarters[b].pixels[i]) < 4.0) continue;
        ab += lines[a][i] * lines[b][i];
        aa += lines[a][i] * lines[a][i];
        bb += lines[b][i] * lines[b][i];
      }
      if (aa <= 0.0 || bb <= 0.0) continue;
      sum += ab / std::sqrt(aa * bb);
      n += 1.0;
    }
  return n > 0.0 ? sum / n : 0.0;
}

/// One where waves are as strong all along the way, 1 / kParts where they stand in one place.
double spread_of(const std::vector<double>& line) {
  std::array<double, kParts> part{};
  for (std::size_t i = 0; i < line.size(); ++i) part[kParts * i / line.size()] += line[i] * line[i];
  double sum = 0.0, squares = 0.0;
  for (const double v : part) {
    sum += v;
    squares += v * v;
  }
  return squares > 0.0 ? sum * sum / (static_cast<double>(kParts) * squares) : 0.0;
}

}  // namespace

FoundWaves find_waves(const Grid<float>& h) {
  FoundWaves out;
  if (std::min(h.rows(), h.cols()) < kSmallest) return out;
  Grid<float> g = levelled(h);
  for (std::size_t round = 0; round < kMostDirections; ++round) {
    Ray ray = strongest(Spectrum(g));
    if (ray.bands.empty()) break;
    ray.towards_rad = refined(g, h, ray);
    const Geometry way(g, ray.towards_rad);
    const auto quarters = profiles(g, h, way);
    const Profile all = together(quarters);
    const std::vector<double> line = in_bands(all, ray.bands);
    WaveArtefact wave;
    wave.towards_deg = ray.towards_rad * 180.0 / kPi;
    wave.longest_pixels = 1.0 / ray.bands.front().low;
    wave.shortest_pixels = 1.0 / ray.bands.back().high;
    wave.alike = alikeness(quarters, ray.bands);
    wave.separable = wave.alike > kAlike && spread_of(line) > kSpread;
    Grid<float>& to = wave.separable ? out.separable_m : out.left_m;
    if (to.empty()) to = Grid<float>(h.rows(), h.cols(), 0.0F);
    double square = 0.0, n = 0.0;
    for (std::ptrdiff_t r = 0; r < h.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < h.cols(); ++c) {
        if (std::isnan(h(r, c))) continue;
        const double t = way.along(r, c);
        const auto i = static_cast<std::size_t>(t);
        const double part = t - static_cast<double>(i);
        const double v = (1.0 - part) * line[i] + part * line[i + 1];
        to(r, c) += static_cast<float>(v);
        g(r, c) -= static_cast<float>(v);
        square += v * v;
        n += 1.0;
      }
    wave.rms_m = n > 0.0 ? std::sqrt(square / n) : 0.0;
    out.waves.push_back(wave);
  }
  return out;
}

}  // namespace maquette::heightmap::detail
