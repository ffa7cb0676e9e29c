// SPDX-License-Identifier: GPL-3.0-or-later

// Where on the design a cloud may lie, from nothing but its heights. Ground is no collection
// of distinct features, but it is nearly flat against its width: two directions of five are
// known from the plane of least scatter, the other four (azimuth, two shifts, height) are
// few enough to look at all of them, at a resolution from which the pyramid takes over.
//
// For each azimuth the heights of the cloud over its plane, as a map, are correlated with the
// design's at every shift. With masks m, heights f (zero where m is zero) and * for correlation
//   N = m1 * m2, S1 = f1 * m2, S2 = m1 * f2, S11 = f1^2 * m2, S22 = m1 * f2^2, S12 = f1 * f2
// the correlation coefficient over the common cells is
//   (S12 - S1 S2 / N) / sqrt((S11 - S1^2 / N) (S22 - S2^2 / N)).
// It counts by its Fisher transform times sqrt(N): a small overlap is easily alike.

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "scan/detail/registration_steps.hpp"

namespace maquette::scan::detail {
namespace {

using heightmap::ModelField;
using Complex = std::complex<double>;
using Image = std::vector<Complex>;

constexpr std::size_t kSide = 128;      // of the transforms
constexpr double kDesignCells = 44.0;   // longest side; with any turn of the cloud no wrap
constexpr int kAzimuths = 120;          // every 3 degrees: a cell at the rim
constexpr double kLeastOverlap = 0.25;  // of the smaller of the two
constexpr std::size_t kPeaksPerMap = 3;

/// Without the care for infinities that makes operator* slow.
Complex times(Complex a, Complex b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

/// In place, radix 2, decimation in time (Cooley and Tukey 1965, doi:10.2307/2003354).
void transform(Complex* x, const std::vector<Complex>& roots) {
  for (std::size_t i = 1, j = 0; i < kSide; ++i) {
    std::size_t bit = kSide >> 1;
    for (; (j & bit) != 0; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) std::swap(x[i], x[j]);
  }
  for (std::size_t half = 1; half < kSide; half *= 2)
    for (std::size_t start = 0; start < kSide; start += 2 * half)
      for (std::size_t k = 0; k < half; ++k) {
        Complex& a = x[start + k];
        Complex& b = x[start + k + half];
        const Complex t = times(b, roots[k * (kSide / (2 * half))]);
        b = a - t;
        a += t;
      }
}

/// Columns as rows: a stride of a power of two would meet in few lines of the cache.
void transpose(Image& image) {
  for (std::size_t r = 0; r < kSide; ++r)
    for (std::size_t c = 0; c < r; ++c) std::swap(image[r * kSide + c], image[c * kSide + r]);
}

void transform_2d(Image& image, bool inverse) {
  static const auto make = [](double sign) {
    std::vector<Complex> roots(kSide / 2);
    for (std::size_t k = 0; k < roots.size(); ++k)
      roots[k] = std::polar(
          1.0, sign * 2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(kSide));
    return roots;
  };
  static const std::vector<Complex> forward = make(-1.0), backward = make(1.0);
  const auto& roots = inverse ? backward : forward;
  for (int pass = 0; pass < 2; ++pass) {
    for (std::size_t r = 0; r < kSide; ++r) transform(&image[r * kSide], roots);
    transpose(image);
  }
  if (inverse)
    for (Complex& v : image) v /= static_cast<double>(kSide * kSide);
}

/// Spectra of a height map, its mask and its square.
struct Spectra {
  Image height, mask, square;
  double cells = 0.0;
};

/// @param sums, counts  per cell
Spectra spectra_of(const std::vector<double>& sums, const std::vector<double>& counts) {
  Spectra s;
  // Two real images in one transform: of a + i b, the spectrum of a is its Hermitian part.
  Image both(kSide * kSide);
  s.square.assign(kSide * kSide, {});
  for (std::size_t i = 0; i < both.size(); ++i) {
    if (counts[i] == 0.0) continue;
    const double h = sums[i] / counts[i];
    both[i] = {h, 1.0};
    s.square[i] = h * h;
    s.cells += 1.0;
  }
  transform_2d(both, false);
  transform_2d(s.square, false);
  s.height.resize(both.size());
  s.mask.resize(both.size());
  for (std::size_t r = 0; r < kSide; ++r)
    for (std::size_t c = 0; c < kSide; ++c) {
      const std::size_t i = r * kSide + c;
      const Complex z = both[i];
      const Complex w = std::conj(both[((kSide - r) % kSide) * kSide + (kSide - c) % kSide]);
      s.height[i] = 0.5 * (z + w);
      s.mask[i] = {0.5 * (z - w).imag(), -0.5 * (z - w).real()};
    }
  return s;
}

/// Two correlations at once: a1 * a2 and b1 * b2 as real and imaginary part.
Image correlate(const Image& a1, const Image& a2, const Image& b1, const Image& b2) {
  Image product(kSide * kSide);
  for (std::size_t i = 0; i < product.size(); ++i) {
    const Complex a = times(a1[i], std::conj(a2[i])), b = times(b1[i], std::conj(b2[i]));
    product[i] = {a.real() - b.imag(), a.imag() + b.real()};
  }
  transform_2d(product, true);
  return product;
}

struct Plane {
  Eigen::Vector3d centre;
  Eigen::Matrix3d axes;  // columns: two along, the last across; right-handed
};

Eigen::Vector3d eigen_of(Vec3 p) {
  return {p.x, p.y, p.z};
}

Plane plane_of(std::span<const Vec3> points) {
  Plane plane{Eigen::Vector3d::Zero(), Eigen::Matrix3d::Zero()};
  for (const Vec3& p : points) plane.centre += eigen_of(p);
  plane.centre /= static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Vec3& p : points) {
    const Eigen::Vector3d arm = eigen_of(p) - plane.centre;
    scatter += arm * arm.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(scatter);
  plane.axes.col(2) = eigen.eigenvectors().col(0);
  plane.axes.col(0) = eigen.eigenvectors().col(2);
  plane.axes.col(1) = plane.axes.col(2).cross(plane.axes.col(0));
  return plane;
}

void turn_over(Plane& plane) {
  plane.axes.col(1) *= -1.0;
  plane.axes.col(2) *= -1.0;
}

struct Place {
  double score = -INFINITY;
  bool over = false;
  int azimuth = 0;
  int row = 0, column = 0;  // shift in cells
  double lift_mm = 0.0;
};

void bin(std::span<const Eigen::Vector3d> local, double azimuth, double cell,
         std::vector<double>& sums, std::vector<double>& counts) {
  std::fill(sums.begin(), sums.end(), 0.0);
  std::fill(counts.begin(), counts.end(), 0.0);
  const double c = std::cos(azimuth) / cell, s = std::sin(azimuth) / cell;
  constexpr auto kMiddle = static_cast<double>(kSide / 2);
  for (const Eigen::Vector3d& p : local) {
    const double u = c * p(0) - s * p(1) + kMiddle, v = s * p(0) + c * p(1) + kMiddle;
    if (!(u >= 0.0 && v >= 0.0 && u < 2.0 * kMiddle && v < 2.0 * kMiddle)) continue;
    const std::size_t i = static_cast<std::size_t>(v) * kSide + static_cast<std::size_t>(u);
    sums[i] += p(2);
    counts[i] += 1.0;
  }
}

std::vector<Eigen::Vector3d> in_plane(std::span<const Vec3> points, const Plane& plane) {
  std::vector<Eigen::Vector3d> local;
  local.reserve(points.size());
  for (const Vec3& p : points)
    local.push_back(plane.axes.transpose() * (eigen_of(p) - plane.centre));
  return local;
}

std::vector<Place> best_shifts(const Spectra& design, const Spectra& cloud) {
  const Image n_s1 = correlate(design.mask, cloud.mask, design.height, cloud.mask);
  const Image s2_s11 = correlate(design.mask, cloud.height, design.square, cloud.mask);
  const Image s22_s12 = correlate(design.mask, cloud.square, design.height, cloud.height);
  std::vector<double> score(kSide * kSide, -INFINITY);
  const double least = std::fmax(8.0, kLeastOverlap * std::fmin(design.cells, cloud.cells));
  for (std::size_t i = 0; i < score.size(); ++i) {
    const double n = n_s1[i].real(), s1 = n_s1[i].imag();
    if (n < least) continue;
    const double s2 = s2_s11[i].real();
    const double v1 = s2_s11[i].imag() - s1 * s1 / n, v2 = s22_s12[i].real() - s2 * s2 / n;
    if (!(v1 > 0.0 && v2 > 0.0)) continue;
    const double r = std::clamp((s22_s12[i].imag() - s1 * s2 / n) / std::sqrt(v1 * v2), -1.0, 1.0);
    score[i] = std::atanh(0.999 * r) * std::sqrt(n);
  }
  std::vector<Place> best;
  const auto at = [&](std::size_t r, std::size_t c) {
    return score[(r % kSide) * kSide + c % kSide];
  };
  for (std::size_t r = 0; r < kSide; ++r)
    for (std::size_t c = 0; c < kSide; ++c) {
      const double here = at(r, c);
      if (!(here > 0.0)) continue;
      bool peak = true;
      for (const std::size_t i : {kSide - 1, std::size_t{0}, std::size_t{1}})
        for (const std::size_t j : {kSide - 1, std::size_t{0}, std::size_t{1}})
          peak = peak && at(r + i, c + j) <= here;
      if (!peak) continue;
      const std::size_t k = r * kSide + c;
      const auto shift = [](std::size_t a) {
        return a < kSide / 2 ? static_cast<int>(a) : static_cast<int>(a) - static_cast<int>(kSide);
      };
      best.push_back({here, false, 0, shift(r), shift(c),
                      (n_s1[k].imag() - s2_s11[k].real()) / n_s1[k].real()});
    }
  std::sort(best.begin(), best.end(),
            [](const Place& a, const Place& b) { return a.score > b.score; });
  if (best.size() > kPeaksPerMap) best.resize(kPeaksPerMap);
  return best;
}

}  // namespace

std::vector<Pose> places_anywhere(std::span<const Vec3> points, const ModelField& design,
                                  std::optional<Vec3> station, std::size_t most) {
  std::vector<Vec3> nodes;
  const std::ptrdiff_t rows = design.z_mm.rows(), cols = design.z_mm.cols();
  const auto stride = static_cast<std::ptrdiff_t>(
      std::fmax(1.0, static_cast<double>(std::max(rows, cols)) / (4.0 * kDesignCells)));
  for (std::ptrdiff_t r = 0; r < rows; r += stride)
    for (std::ptrdiff_t c = 0; c < cols; c += stride)
      if (!std::isnan(design.z_mm(r, c)))
        nodes.push_back({design.x_mm(c), design.y_mm(r), static_cast<double>(design.z_mm(r, c))});
  if (nodes.size() < kLeastPoints || points.size() < kLeastPoints) return {};
  Plane under = plane_of(nodes);
  if (under.axes(2, 2) < 0.0) turn_over(under);
  const double cell =
      design.spacing.value() * static_cast<double>(std::max(rows, cols) - 1) / kDesignCells;
  std::vector<double> sums(kSide * kSide), counts(kSide * kSide);
  bin(in_plane(nodes, under), 0.0, cell, sums, counts);
  const Spectra fixed = spectra_of(sums, counts);

  Plane first = plane_of(points);
  std::vector<Plane> sides{first};
  if (station) {
    if (first.axes.col(2).dot(eigen_of(*station) - first.centre) < 0.0) turn_over(sides[0]);
  } else {
    sides.push_back(first);
    turn_over(sides[1]);
  }
  std::vector<Place> all;
  for (std::size_t side = 0; side < sides.size(); ++side) {
    const auto local = in_plane(points, sides[side]);
    std::vector<std::vector<Place>> found(kAzimuths);
    oneapi::tbb::parallel_for(0, kAzimuths, [&](int a) {
      std::vector<double> sum(kSide * kSide), count(kSide * kSide);
      bin(local, 2.0 * std::numbers::pi * a / kAzimuths, cell, sum, count);
      auto best = best_shifts(fixed, spectra_of(sum, count));
      for (Place& p : best) p.azimuth = a, p.over = side == 1;
      found[static_cast<std::size_t>(a)] = std::move(best);
    });
    for (const auto& f : found) all.insert(all.end(), f.begin(), f.end());
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Place& a, const Place& b) { return a.score > b.score; });

  std::vector<Pose> poses;
  std::vector<Place> taken;
  for (const Place& p : all) {
    if (poses.size() >= most) break;
    const bool known = std::any_of(taken.begin(), taken.end(), [&](const Place& t) {
      const int turn = std::abs(t.azimuth - p.azimuth);
      return t.over == p.over && std::min(turn, kAzimuths - turn) <= 2 &&
             std::abs(t.row - p.row) <= 2 && std::abs(t.column - p.column) <= 2;
    });
    if (known) continue;
    taken.push_back(p);
    const Plane& from = sides[p.over ? 1 : 0];
    const double angle = 2.0 * std::numbers::pi * p.azimuth / kAzimuths;
    const Eigen::Matrix3d turn =
        under.axes * Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()) * from.axes.transpose();
    const Eigen::Vector3d shift =
        under.centre + under.axes * Eigen::Vector3d(p.column * cell, p.row * cell, p.lift_mm) -
        turn * from.centre;
    const Eigen::Quaterniond q(turn);
    Pose pose;
    pose.rigid.rotation = normalized(Quaternion{q.w(), q.x(), q.y(), q.z()});
    pose.rigid.translation_mm = {shift(0), shift(1), shift(2)};
    poses.push_back(pose);
  }
  return poses;
}

}  // namespace maquette::scan::detail
