// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/compare_perceptual.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "camera/srgb.hpp"

namespace maquette::camera {
namespace {

using Kernel = std::vector<float>;  ///< odd, its middle in the middle
using Range = tbb::blocked_range<std::ptrdiff_t>;
constexpr double kPi = std::numbers::pi;

/// Rows with `across`, then columns with `down`; the edge goes on.
Grid<float> filtered(const Grid<float>& g, const Kernel& across, const Kernel& down) {
  const std::ptrdiff_t rows = g.rows(), cols = g.cols();
  const auto rx = static_cast<std::ptrdiff_t>(across.size() / 2);
  const auto ry = static_cast<std::ptrdiff_t>(down.size() / 2);
  Grid<float> half(rows, cols), out(rows, cols);
  tbb::parallel_for(Range(0, rows, 16), [&](const Range& range) {
    std::vector<float> padded(static_cast<std::size_t>(cols + 2 * rx));
    for (std::ptrdiff_t r = range.begin(); r != range.end(); ++r) {
      const auto row = g.row(r);
      std::copy(row.begin(), row.end(), padded.begin() + rx);
      std::fill(padded.begin(), padded.begin() + rx, row.front());
      std::fill(padded.end() - rx, padded.end(), row.back());
      float* to = half.row(r).data();
      for (std::size_t k = 0; k < across.size(); ++k) {
        const float w = across[k];
        const float* from = padded.data() + k;
        for (std::ptrdiff_t c = 0; c < cols; ++c) to[c] += w * from[c];
      }
    }
  });
  tbb::parallel_for(Range(0, rows, 16), [&](const Range& range) {
    for (std::ptrdiff_t r = range.begin(); r != range.end(); ++r) {
      float* to = out.row(r).data();
      for (std::size_t k = 0; k < down.size(); ++k) {
        const std::ptrdiff_t at =
            std::clamp(r + static_cast<std::ptrdiff_t>(k) - ry, std::ptrdiff_t{0}, rows - 1);
        const float w = down[k];
        const float* from = half.row(at).data();
        for (std::ptrdiff_t c = 0; c < cols; ++c) to[c] += w * from[c];
      }
    }
  });
  return out;
}

template <class F>
Kernel kernel_of(int radius, const F& value) {
  Kernel k;
  for (int i = -radius; i <= radius; ++i) k.push_back(static_cast<float>(value(i)));
  return k;
}

Kernel normalised(Kernel k) {
  double sum = 0.0;
  for (const float v : k) sum += static_cast<double>(v);
  for (float& v : k) v = static_cast<float>(static_cast<double>(v) / sum);
  return k;
}

Grid<float> product(const Grid<float>& a, const Grid<float>& b) {
  Grid<float> p(a.rows(), a.cols());
  for (std::size_t i = 0; i < p.cells().size(); ++i) p.cells()[i] = a.cells()[i] * b.cells()[i];
  return p;
}

using Colour = std::array<double, 3>;

// sRGB primaries and white D65, IEC 61966-2-1, with the digits of the FLIP paper's supplement.
constexpr double kM[3][3] = {
    {10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0},
    {2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0},
    {1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0}};

Colour xyz(const Colour& rgb) {
  Colour out{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) out[i] += kM[i][j] * rgb[j];
  return out;
}
Colour white() {
  static const Colour w = xyz({1.0, 1.0, 1.0});
  return w;
}
/// Inverse of kM by Cramer, once.
Colour rgb_of(const Colour& v) {
  static const std::array<Colour, 3> inverse = [] {
    std::array<Colour, 3> inv{};
    const auto& m = kM;
    const double det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                       m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                       m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) {
        const std::size_t a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
        inv[i][j] = (m[a][c] * m[b][d] - m[a][d] * m[b][c]) / det;
      }
    return inv;
  }();
  Colour out{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) out[i] += inverse[i][j] * v[j];
  return out;
}

/// L, a, b with Hunt's adjustment: chroma counts less in the dark.
Colour hunt_lab(const Colour& rgb) {
  const Colour v = xyz(rgb), w = white();
  const auto f = [](double t) {
    constexpr double kDelta = 6.0 / 29.0;
    return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3.0 * kDelta * kDelta) + 4.0 / 29.0;
  };
  const double x = f(v[0] / w[0]), y = f(v[1] / w[1]), z = f(v[2] / w[2]);
  const double l = 116.0 * y - 16.0;
  return {l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)};
}

double hyab(const Colour& a, const Colour& b) {
  return std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]);
}

/// What one picture is reduced to.
struct Seen {
  Grid<float> y, cx, cz;      ///< opponent colours, filtered by contrast sensitivity
  Grid<float> edges, points;  ///< magnitudes of first and second derivatives
};

Seen seen(const std::vector<Grid<float>>& bands, double ppd) {
  const std::ptrdiff_t rows = bands[0].rows(), cols = bands[0].cols();
  Grid<float> y(rows, cols), cx(rows, cols), cz(rows, cols), luma(rows, cols);
  const Colour w = white();
  tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      Colour rgb{};
      for (std::size_t b = 0; b < 3; ++b)
        rgb[b] = linear_of_srgb(
            std::clamp(static_cast<double>(bands[bands.size() == 3 ? b : 0](r, c)), 0.0, 1.0));
      const Colour v = xyz(rgb);
      const double yn = v[1] / w[1];
      y(r, c) = static_cast<float>(116.0 * yn - 16.0);
      cx(r, c) = static_cast<float>(500.0 * (v[0] / w[0] - yn));
      cz(r, c) = static_cast<float>(200.0 * (yn - v[2] / w[2]));
      luma(r, c) = static_cast<float>(yn);
    }
  });
  // Contrast sensitivity: Gaussians exp(-pi^2 x^2 / b), x in degrees.
  const int radius = static_cast<int>(std::ceil(3.0 * std::sqrt(0.04 / (2.0 * kPi * kPi)) * ppd));
  const auto gauss = [&](double b) {
    return kernel_of(radius,
                     [&](int i) { return std::exp(-kPi * kPi * (i / ppd) * (i / ppd) / b); });
  };
  const auto volume = [](const Kernel& k) {
    double sum = 0.0;
    for (const float v : k) sum += static_cast<double>(v);
    return sum * sum;
  };
  Seen s;
  const Kernel light = normalised(gauss(0.0047)), red = normalised(gauss(0.0053));
  s.y = filtered(y, light, light);
  s.cx = filtered(cx, red, red);
  const Kernel wide = gauss(0.04), narrow = gauss(0.025);
  const double a = 34.1 * std::sqrt(kPi / 0.04) * volume(wide);
  const double b = 13.5 * std::sqrt(kPi / 0.025) * volume(narrow);
  const Grid<float> first = filtered(cz, normalised(wide), normalised(wide));
  s.cz = filtered(cz, normalised(narrow), normalised(narrow));
  for (std::size_t i = 0; i < s.cz.cells().size(); ++i)
    s.cz.cells()[i] = static_cast<float>(
        (a * static_cast<double>(first.cells()[i]) + b * static_cast<double>(s.cz.cells()[i])) /
        (a + b));
  // Features: derivatives of a Gaussian 0.082 degrees wide.
  const double sd = 0.5 * 0.082 * ppd;
  const int reach = static_cast<int>(std::ceil(3.0 * sd));
  const auto g = [&](int i) { return std::exp(-0.5 * i * i / (sd * sd)); };
  const Kernel smooth = normalised(kernel_of(reach, g));
  const auto balanced = [](Kernel k) {  // positive and negative weights add up to 1 each
    double plus = 0.0, minus = 0.0;
    for (const float v : k) (v > 0.0F ? plus : minus) += std::abs(static_cast<double>(v));
    for (float& v : k) v = static_cast<float>(static_cast<double>(v) / (v > 0.0F ? plus : minus));
    return k;
  };
  const Kernel slope = balanced(kernel_of(reach, [&](int i) { return -i * g(i); }));
  const Kernel bend =
      balanced(kernel_of(reach, [&](int i) { return (i * i / (sd * sd) - 1.0) * g(i); }));
  const auto magnitude = [&](const Kernel& k) {
    Grid<float> across = filtered(luma, k, smooth);
    const Grid<float> down = filtered(luma, smooth, k);
    for (std::size_t i = 0; i < across.cells().size(); ++i)
      across.cells()[i] = std::hypot(across.cells()[i], down.cells()[i]);
    return across;
  };
  s.edges = magnitude(slope);
  s.points = magnitude(bend);
  return s;
}

Colour lab_at(const Seen& s, std::size_t i) {
  const Colour w = white();
  const double yn = (static_cast<double>(s.y.cells()[i]) + 16.0) / 116.0;
  const double xn = yn + static_cast<double>(s.cx.cells()[i]) / 500.0;
  const double zn = yn - static_cast<double>(s.cz.cells()[i]) / 200.0;
  Colour rgb = rgb_of({xn * w[0], yn * w[1], zn * w[2]});
  for (double& v : rgb) v = std::clamp(v, 0.0, 1.0);
  return hunt_lab(rgb);
}

}  // namespace

double structural_similarity(const Grid<float>& a, const Grid<float>& b) {
  constexpr int kRadius = 5;
  if (a.rows() < 2 * kRadius + 1 || a.cols() < 2 * kRadius + 1) return NAN;
  const Kernel w =
      normalised(kernel_of(kRadius, [](int i) { return std::exp(-0.5 * i * i / 2.25); }));
  const Grid<float> ma = filtered(a, w, w), mb = filtered(b, w, w);
  const Grid<float> aa = filtered(product(a, a), w, w), bb = filtered(product(b, b), w, w),
                    ab = filtered(product(a, b), w, w);
  constexpr double kC1 = 1e-4, kC2 = 9e-4;
  double sum = 0.0;
  std::size_t count = 0;
  for (std::ptrdiff_t r = kRadius; r < a.rows() - kRadius; ++r)
    for (std::ptrdiff_t c = kRadius; c < a.cols() - kRadius; ++c, ++count) {
      const auto x = static_cast<double>(ma(r, c)), y = static_cast<double>(mb(r, c));
      const double vx = static_cast<double>(aa(r, c)) - x * x;
      const double vy = static_cast<double>(bb(r, c)) - y * y;
      const double xy = static_cast<double>(ab(r, c)) - x * y;
      sum += (2.0 * x * y + kC1) * (2.0 * xy + kC2) / ((x * x + y * y + kC1) * (vx + vy + kC2));
    }
  return sum / static_cast<double>(count);
}

Grid<float> flip(const std::vector<Grid<float>>& a, const std::vector<Grid<float>>& b,
                 double pixels_per_degree) {
  const Seen sa = seen(a, pixels_per_degree), sb = seen(b, pixels_per_degree);
  constexpr double kPower = 0.7, kKnee = 0.4, kKneeValue = 0.95;
  const double most = std::pow(hyab(hunt_lab({0.0, 1.0, 0.0}), hunt_lab({0.0, 0.0, 1.0})), kPower);
  Grid<float> out(a[0].rows(), a[0].cols());
  tbb::parallel_for(std::ptrdiff_t{0}, out.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) {
      const auto i = static_cast<std::size_t>(r * out.cols() + c);
      const double e = std::pow(hyab(lab_at(sa, i), lab_at(sb, i)), kPower);
      const double colour =
          e < kKnee * most
              ? kKneeValue * e / (kKnee * most)
              : kKneeValue + (1.0 - kKneeValue) * (e - kKnee * most) / ((1.0 - kKnee) * most);
      const double edge = std::abs(static_cast<double>(sa.edges.cells()[i] - sb.edges.cells()[i]));
      const double point =
          std::abs(static_cast<double>(sa.points.cells()[i] - sb.points.cells()[i]));
      const double feature = std::sqrt(std::max(edge, point) / std::numbers::sqrt2);
      out.cells()[i] = static_cast<float>(std::pow(colour, 1.0 - std::min(1.0, feature)));
    }
  });
  return out;
}

}  // namespace maquette::camera
