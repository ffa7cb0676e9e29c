// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/coregister.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_reduce.h>
#include <Eigen/Dense>

#include "core/median.hpp"
#include "heightmap/detail/surface_pair.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr int kUnknowns = Coregistration::kUnknowns;
using Vector = Eigen::Matrix<double, kUnknowns, 1>;
using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;

constexpr double kLeastPixels = 30.0;
constexpr double kCapturePixels = 25.0;  // of the coarser surface: how far the start is searched
constexpr double kLeastCorrelation = 0.5;
constexpr double kMostSamples = 4e5;  // of a step
constexpr std::ptrdiff_t kMostLag = 12;
constexpr const char* kOneDirection = "the relief does not tell all directions apart";

/// Where the upper surface is looked up for a point p from the middle:
/// p + (dx, dy) + ((k, -r), (r, k)) p, and the height up + tilt . p that is added to it.
struct Pose {
  Vector v = Vector::Zero();  ///< dx, dy, up, tilt x, tilt y, r, k; lengths in finest cells
  [[nodiscard]] std::array<double, 2> look(double x, double y) const {
    return {x + v[0] - v[5] * y + v[6] * x, y + v[1] + v[5] * x + v[6] * y};
  }
};

struct Level {
  Grid<float> lower, upper;
  double cell = 1.0;  ///< in cells of the finest level
  /// Of cell (0, 0), from the middle of the nodes: not the middle of the cells where nodes are left
  /// over, and half a node of tilt is more than a mean height's noise.
  double x0 = 0.0, y0 = 0.0;
  [[nodiscard]] std::array<double, 2> from_middle(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return {x0 + static_cast<double>(c) * cell, y0 + static_cast<double>(r) * cell};
  }
};

/// From the surfaces on their cells to ones of at most 96 along the shorter side, finest first.
std::vector<Level> levels_of(SurfacePair&& pair, const Grid<float>& nodes) {
  const auto first = [&](std::ptrdiff_t n) {
    return 0.5 - 0.5 * static_cast<double>(n) / static_cast<double>(pair.nodes);
  };
  std::vector<Level> levels{{std::move(pair.lower), std::move(pair.upper), 1.0, first(nodes.cols()),
                             first(nodes.rows())}};
  while (std::min(levels.back().lower.rows(), levels.back().lower.cols()) > 96) {
    const Level& l = levels.back();
    levels.push_back({block_means(l.lower, 2), block_means(l.upper, 2), 2.0 * l.cell,
                      l.x0 + 0.5 * l.cell, l.y0 + 0.5 * l.cell});
  }
  return levels;
}

struct Samples {
  std::ptrdiff_t rows = 0, cols = 0;
  std::vector<double> residual;  ///< NaN where there is none
  /// Derivatives of the model by the slopes of the upper and of the lower surface.
  std::vector<Vector> upper, lower;
  bool by_upper = false;  ///< whose slopes residuals are weighed with
  [[nodiscard]] const std::vector<Vector>& weights() const { return by_upper ? upper : lower; }
};

/// Residuals and derivatives at every `stride`-th cell. Unknowns are in finest cells.
Samples compare(const Level& level, const Pose& pose, std::ptrdiff_t stride, bool by_upper) {
  Samples s;
  s.by_upper = by_upper;
  s.rows = (level.lower.rows() + stride - 1) / stride;
  s.cols = (level.lower.cols() + stride - 1) / stride;
  const auto n = static_cast<std::size_t>(s.rows * s.cols);
  s.residual.assign(n, NAN);
  s.upper.resize(n);
  s.lower.resize(n);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, s.rows, [&](std::ptrdiff_t i) {
    for (std::ptrdiff_t j = 0; j < s.cols; ++j) {
      const auto h = static_cast<double>(level.lower(i * stride, j * stride));
      if (std::isnan(h)) continue;
      const auto [x, y] = level.from_middle(i * stride, j * stride);
      const auto [u, v] = pose.look(x, y);
      const auto [z, gx_cell, gy_cell] =
          height_and_gradient(level.upper, static_cast<double>(j * stride) + (u - x) / level.cell,
                              static_cast<double>(i * stride) + (v - y) / level.cell);
      const auto [l, lx_cell, ly_cell] =
          height_and_gradient_at(level.lower, i * stride, j * stride);
      if (std::isnan(z + l)) continue;
      const auto row = [&, x = x, y = y](double gx, double gy) {
        Vector out;
        out << gx / level.cell, gy / level.cell, 1.0, x, y, (gy * x - gx * y) / level.cell,
            (gx * x + gy * y) / level.cell;
        return out;
      };
      const auto k = static_cast<std::size_t>(i * s.cols + j);
      s.residual[k] = h - z - pose.v[2] - pose.v[3] * x - pose.v[4] * y;
      s.upper[k] = row(gx_cell, gy_cell);
      s.lower[k] = row(lx_cell, ly_cell);
    }
  });
  return s;
}

struct Normal {
  Matrix a = Matrix::Zero();
  Vector b = Vector::Zero();
  MeanSlope slope;
};

/// Derivative and value of the sum of psi times slopes. The product of the upper's slopes with the
/// lower's is free of what the noise of each adds to its own slopes: with squares of one of them
/// steps would be too short and the covariance too small.
/// Fixed chunks summed in order: the same for any number of threads.
Normal normal_of(const Samples& s, double limit) {
  std::vector<Normal> part(static_cast<std::size_t>(s.rows));
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, s.rows, [&](std::ptrdiff_t i) {
    Normal& p = part[static_cast<std::size_t>(i)];
    for (std::ptrdiff_t j = 0; j < s.cols; ++j) {
      const auto k = static_cast<std::size_t>(i * s.cols + j);
      const double e = s.residual[k];
      if (std::isnan(e)) continue;
      p.slope.add(e, limit);
      p.b += psi(e, limit) * s.weights()[k];
      p.a.selfadjointView<Eigen::Lower>().rankUpdate(s.upper[k], s.lower[k], 0.5);
    }
  });
  Normal sum;
  for (const Normal& p : part) {
    sum.a += p.a;
    sum.b += p.b;
    sum.slope.add(p.slope);
  }
  sum.a = sum.slope.value() * Matrix(sum.a.selfadjointView<Eigen::Lower>());
  return sum;
}

using Free = std::array<bool, kUnknowns>;

/// Inverse over the free unknowns; nothing if they cannot be told apart.
std::optional<Matrix> inverse(const Matrix& a, const Free& free) {
  std::vector<int> at;
  for (int i = 0; i < kUnknowns; ++i)
    if (free[static_cast<std::size_t>(i)]) at.push_back(i);
  const auto n = static_cast<Eigen::Index>(at.size());
  Eigen::MatrixXd m(n, n);
  Eigen::VectorXd scale(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    scale[i] = std::sqrt(a(at[static_cast<std::size_t>(i)], at[static_cast<std::size_t>(i)]));
    if (!(scale[i] > 0.0)) return std::nullopt;  // of slopes' products: noise may make it negative
  }
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j)
      m(i, j) = a(at[static_cast<std::size_t>(i)], at[static_cast<std::size_t>(j)]) /
                (scale[i] * scale[j]);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(m);
  if (!(eigen.eigenvalues()[0] > 1e-9)) return std::nullopt;
  const Eigen::MatrixXd inv = m.inverse();
  Matrix out = Matrix::Zero();
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j)
      out(at[static_cast<std::size_t>(i)], at[static_cast<std::size_t>(j)]) =
          inv(i, j) / (scale[i] * scale[j]);
  return out;
}

/// Covariance of the unknowns: inverse derivative of the scores (`bread`) around the covariance of
/// their sum, scores of neighbours being alike.
Matrix sandwich(const Samples& s, double limit, const Matrix& bread, const Free& free) {
  const std::size_t count = s.residual.size();
  std::vector<double> weighed(count, NAN);
  std::vector<Vector> score(count);
  for (std::size_t k = 0; k < count; ++k)
    if (!std::isnan(s.residual[k])) {
      weighed[k] = psi(s.residual[k], limit);
      score[k] = weighed[k] * s.weights()[k];
      for (int u = 0; u < kUnknowns; ++u)
        if (!free[static_cast<std::size_t>(u)]) score[k][u] = 0.0;
    }
  const auto for_pairs = [&](std::ptrdiff_t dr, std::ptrdiff_t dc, auto&& each) {
    const std::ptrdiff_t c_begin = std::max<std::ptrdiff_t>(0, -dc);
    const std::ptrdiff_t c_end = s.cols - std::max<std::ptrdiff_t>(0, dc);
    for (std::ptrdiff_t i = 0; i + dr < s.rows; ++i)
      for (std::ptrdiff_t j = c_begin; j < c_end; ++j) {
        const auto a = static_cast<std::size_t>(i * s.cols + j);
        const auto b = static_cast<std::size_t>((i + dr) * s.cols + j + dc);
        if (!std::isnan(weighed[a]) && !std::isnan(weighed[b])) each(a, b);
      }
  };
  // Lags of the half plane; lag 0 first.
  struct Lag {
    std::ptrdiff_t dr, dc;
    double far, product, n;
  };
  std::vector<Lag> lags;
  for (std::ptrdiff_t dr = 0; dr <= kMostLag; ++dr)
    for (std::ptrdiff_t dc = dr == 0 ? 0 : -kMostLag; dc <= kMostLag; ++dc)
      lags.push_back(
          {dr, dc, std::hypot(static_cast<double>(dr), static_cast<double>(dc)), 0.0, 0.0});
  oneapi::tbb::parallel_for(std::size_t{0}, lags.size(), [&](std::size_t k) {
    Lag& l = lags[k];
    for_pairs(l.dr, l.dc, [&](std::size_t a, std::size_t b) {
      l.product += weighed[a] * weighed[b];
      l.n += 1.0;
    });
  });
  // Flat-top window: full weight up to the lag behind which rings no longer correlate, then
  // falling to zero at twice that.
  const double c0 = lags[0].product / lags[0].n;
  std::vector<double> ring(static_cast<std::size_t>(kMostLag) + 1, 0.0), ring_n(ring);
  for (const Lag& l : lags)
    if (const auto r = static_cast<std::size_t>(std::lround(l.far)); r < ring.size()) {
      ring[r] += l.product;
      ring_n[r] += l.n;
    }
  const auto correlated = [&](std::ptrdiff_t r) {
    const auto i = static_cast<std::size_t>(r);
    return r <= kMostLag && ring_n[i] > 0.0 && std::abs(ring[i] / ring_n[i]) > 0.03 * c0;
  };
  std::ptrdiff_t m = 1;
  while (m < kMostLag && (correlated(m) || correlated(m + 1))) ++m;
  const auto weight = [m](const Lag& l) {
    return std::clamp(2.0 - l.far / static_cast<double>(m), 0.0, 1.0);
  };
  std::vector<Matrix> part(lags.size(), Matrix::Zero());
  oneapi::tbb::parallel_for(std::size_t{0}, lags.size(), [&](std::size_t k) {
    const Lag& l = lags[k];
    if (weight(l) == 0.0) return;
    Matrix sum = Matrix::Zero();
    for_pairs(l.dr, l.dc, [&](std::size_t a, std::size_t b) {
      sum.noalias() += score[a] * score[b].transpose();
    });
    part[k] = l.far == 0.0 ? sum : Matrix(weight(l) * (sum + sum.transpose()));
  });
  Matrix meat = Matrix::Zero();
  for (const Matrix& p : part) meat += p;
  // The fit took the longest waves out of the residuals: as many of the n / window independent
  // ones as there are unknowns.
  double window = -1.0;
  for (const Lag& l : lags) window += 2.0 * weight(l);
  const auto unknowns = static_cast<double>(std::count(free.begin(), free.end(), true));
  const double kept = 1.0 - unknowns * window / lags[0].n;
  return bread * meat * bread / std::fmax(0.1, kept);
}

/// Central differences, clipped at three times their spread so that no cliff or spike rules.
struct Slopes {
  Grid<float> x, y;
};
Slopes slopes_of(const Grid<float>& z) {
  Slopes s{Grid<float>(z.rows(), z.cols(), NAN), Grid<float>(z.rows(), z.cols(), NAN)};
  std::vector<double> size;
  for (std::ptrdiff_t r = 1; r + 1 < z.rows(); ++r)
    for (std::ptrdiff_t c = 1; c + 1 < z.cols(); ++c) {
      const float gx = z(r, c + 1) - z(r, c - 1), gy = z(r + 1, c) - z(r - 1, c);
      if (std::isnan(gx + gy)) continue;
      s.x(r, c) = gx;
      s.y(r, c) = gy;
      size.push_back(static_cast<double>(std::abs(gx)));
      size.push_back(static_cast<double>(std::abs(gy)));
    }
  const auto limit = static_cast<float>(3.0 * kMadToSigma * median(std::move(size), 0.0));
  for (Grid<float>* g : {&s.x, &s.y})
    for (float& v : g->cells())
      if (!std::isnan(v)) v = std::clamp(v, -limit, limit);
  return s;
}

/// Correlation of slopes with the upper surface looked up `dc`, `dr` cells further; 0 if less than
/// `least` cells are common.
double correlation(const Slopes& low, const Slopes& high, std::ptrdiff_t dr, std::ptrdiff_t dc,
                   double least) {
  double ll = 0.0, uu = 0.0, lu = 0.0, n = 0.0;
  const std::ptrdiff_t rows = low.x.rows(), cols = low.x.cols();
  for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, -dr); r < std::min(rows, high.x.rows() - dr);
       ++r)
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, -dc);
         c < std::min(cols, high.x.cols() - dc); ++c) {
      const auto lx = static_cast<double>(low.x(r, c)), ly = static_cast<double>(low.y(r, c));
      const auto ux = static_cast<double>(high.x(r + dr, c + dc)),
                 uy = static_cast<double>(high.y(r + dr, c + dc));
      if (std::isnan(lx + ux)) continue;
      ll += lx * lx + ly * ly;
      uu += ux * ux + uy * uy;
      lu += lx * ux + ly * uy;
      n += 1.0;
    }
  return n >= least && ll > 0.0 && uu > 0.0 ? lu / std::sqrt(ll * uu) : 0.0;
}

/// The upper surface looked up through a pose, on the lower's cells.
Grid<float> looked_up(const Level& level, const Pose& pose) {
  Grid<float> out(level.lower.rows(), level.lower.cols(), NAN);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, out.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) {
      const auto [x, y] = level.from_middle(r, c);
      const auto [u, v] = pose.look(x, y);
      out(r, c) = static_cast<float>(
          height_and_gradient(level.upper, static_cast<double>(c) + (u - x) / level.cell,
                              static_cast<double>(r) + (v - y) / level.cell)[0]);
    }
  });
  return out;
}

/// Best whole shift in cells of a level.
std::array<double, 2> search(const Level& level, double reach_cells) {
  const Slopes low = slopes_of(level.lower), high = slopes_of(level.upper);
  double common = 0.0;
  for (std::size_t k = 0; k < low.x.cells().size(); ++k)
    if (!std::isnan(low.x.cells()[k]) && !std::isnan(high.x.cells()[k])) common += 1.0;
  const auto most = std::min(level.lower.rows(), level.lower.cols()) / 2;
  const auto reach =
      std::min<std::ptrdiff_t>(most, static_cast<std::ptrdiff_t>(std::ceil(reach_cells)));
  const std::ptrdiff_t side = 2 * reach + 1;
  std::vector<double> score(static_cast<std::size_t>(side * side), 0.0);
  oneapi::tbb::parallel_for(std::size_t{0}, score.size(), [&](std::size_t k) {
    const std::ptrdiff_t dr = static_cast<std::ptrdiff_t>(k) / side - reach;
    const std::ptrdiff_t dc = static_cast<std::ptrdiff_t>(k) % side - reach;
    score[k] = correlation(low, high, dr, dc, std::max(20.0, 0.25 * common));
  });
  if (*std::max_element(score.begin(), score.end()) <= 0.0) return {0.0, 0.0};
  const auto best = std::max_element(score.begin(), score.end()) - score.begin();
  return {static_cast<double>(best % side - reach), static_cast<double>(best / side - reach)};
}

}  // namespace

double Coregistration::sigma(Unknown u) const {
  const auto i = static_cast<std::size_t>(u);
  return std::sqrt(covariance[i][i]);
}

std::array<double, 2> Coregistration::origin_of(double x_m, double y_m) const {
  const double x = x_m - east_m, y = y_m - north_m;
  const double c = std::cos(rotation_rad) / scale, s = std::sin(rotation_rad) / scale;
  return {c * x + s * y, -s * x + c * y};
}

namespace {

/// Lower less upper, cell by cell.
std::vector<double> difference_of(const SurfacePair& pair) {
  std::vector<double> difference(pair.lower.cells().size());
  for (std::size_t i = 0; i < difference.size(); ++i)
    difference[i] =
        static_cast<double>(pair.lower.cells()[i]) - static_cast<double>(pair.upper.cells()[i]);
  return difference;
}

}  // namespace

std::optional<Coregistration> coregister(const Grid<float>& lower, const Grid<float>& upper,
                                         double spacing_m, double lower_pixel_m,
                                         double upper_pixel_m, const CoregisterOptions& options) {
  const double coarse_m = std::max(lower_pixel_m, upper_pixel_m);
  SurfacePair pair = cells_of(lower, upper, spacing_m, coarse_m);
  const double cell_m = pair.cell_m;

  Coregistration result;
  const Spread raw = spread_of(difference_of(pair));
  if (raw.n == 0) return std::nullopt;
  result.overlap = static_cast<double>(raw.n) / static_cast<double>(pair.lower.cells().size());
  result.median_before_m = result.up_m = raw.median;
  result.nmad_before_m = result.nmad_after_m = raw.nmad;  // and a median of zero
  const auto refused = [&](std::string why) {
    result.refusal = std::move(why);
    return result;
  };
  if (options.height_only) return refused("nothing else was asked for");
  const double pixels = result.overlap * static_cast<double>(lower.rows()) *
                        static_cast<double>(lower.cols()) * std::pow(spacing_m / coarse_m, 2.0);
  if (!pair.resolved || pixels < kLeastPixels)
    return refused(fmt::format("only {:.1f} pixels of {:.4g} m are common, {:.0f} are needed",
                               pixels, coarse_m, kLeastPixels));

  const double pixel_cells = coarse_m / cell_m;
  bring_to_one_resolution(pair, lower_pixel_m, upper_pixel_m);
  // Before and after are of one resolution, or most of the gain would be the blur's.
  const Spread before = spread_of(difference_of(pair));
  result.median_before_m = before.median;
  result.nmad_before_m = result.nmad_after_m = before.nmad;
  const bool by_upper = pair.by_upper;
  const std::vector<Level> levels = levels_of(std::move(pair), lower);

  Pose pose;
  {
    const Level& l = levels.back();
    const auto [x, y] = search(l, kCapturePixels * pixel_cells / l.cell);
    pose.v[0] = x * l.cell;
    pose.v[1] = y * l.cell;
    pose.v[2] = spread_of(compare(l, pose, 1, false).residual).median;
  }
  const double least = pair.least_spread_m;
  const Free free{true, true, true, true, true, options.rotation, options.scale};
  const double half =
      0.5 * static_cast<double>(std::max(levels[0].lower.rows(), levels[0].lower.cols()));
  Samples samples;
  Spread spread;
  bool settled = false;
  for (std::size_t k = levels.size(); k-- > 0;) {
    const Level& l = levels[k];
    const auto stride = static_cast<std::ptrdiff_t>(std::max(
        1.0, std::ceil(std::sqrt(static_cast<double>(l.lower.cells().size()) / kMostSamples))));
    settled = false;
    // A sample that left the common ground stays out, or steps to and fro over an edge never end.
    std::vector<bool> left;
    for (int i = 0; i < 30 && !settled; ++i) {
      samples = compare(l, pose, stride, by_upper);
      left.resize(samples.residual.size(), false);
      for (std::size_t j = 0; j < left.size(); ++j) {
        if (left[j]) samples.residual[j] = NAN;
        left[j] = std::isnan(samples.residual[j]);
      }
      spread = spread_of(samples.residual);
      if (spread.n < 3 * kUnknowns) return refused("too few heights are common at any shift found");
      const Normal n = normal_of(samples, kTukey * std::max(spread.nmad, least));
      const auto inv = inverse(n.a, free);
      if (!inv) return refused(kOneDirection);
      Vector step = *inv * n.b;
      // A step beyond the relief's own waves is no step: at most one pixel or level's cell.
      const double far = std::hypot(step[0], step[1]) / std::max(pixel_cells, 2.0 * l.cell);
      if (far > 1.0) step /= far;
      pose.v += step;
      settled = std::hypot(step[0], step[1]) < 1e-4 * pixel_cells &&
                half * std::hypot(step[5], step[6]) < 1e-3 * pixel_cells &&
                std::abs(step[2]) + half * (std::abs(step[3]) + std::abs(step[4])) <
                    1e-3 * std::max(spread.nmad, least);
    }
  }
  const double moved = std::hypot(pose.v[0], pose.v[1]) / pixel_cells;
  if (!settled) return refused("the alignment did not settle");
  if (moved > 2.0 * kCapturePixels)
    return refused(fmt::format("the best shift, {:.1f} pixels, is out of reach", moved));

  const double limit = kTukey * std::max(spread.nmad, least);
  const auto bread = inverse(normal_of(samples, limit).a, free);
  if (!bread) return refused(kOneDirection);
  Matrix cov = sandwich(samples, limit, *bread, free);
  for (int i : {0, 1}) cov(i, i) += std::pow(kInterpolation_px * pixel_cells, 2.0);
  const double sigma_pixels = std::sqrt(std::max(cov(0, 0), cov(1, 1))) / pixel_cells;
  if (!(sigma_pixels <= options.most_sigma_pixels))
    return refused(fmt::format("the relief tells the shift to {:.2f} pixels only, {:g} are needed",
                               sigma_pixels, options.most_sigma_pixels));
  // Where coarser cells serve as well, they are faster.
  const Level& judged = *std::find_if(levels.begin(), levels.end(), [](const Level& l) {
    return l.lower.cells().size() <= 1'000'000 || l.lower.rows() <= 96;
  });
  const double alike =
      correlation(slopes_of(judged.lower), slopes_of(looked_up(judged, pose)), 0, 0, 1.0);
  if (alike < kLeastCorrelation)
    return refused(fmt::format("slopes of both correlate by {:.2f} only, {:.1f} are needed", alike,
                               kLeastCorrelation));

  // From "looked up at" to "moved by", in metres.
  const double turn = pose.v[5], grow = 1.0 + pose.v[6];
  result.horizontal = true;
  result.rotation_rad = -std::atan2(turn, grow);
  result.scale = 1.0 / std::hypot(grow, turn);
  const double c = std::cos(result.rotation_rad) * result.scale,
               s = std::sin(result.rotation_rad) * result.scale;
  result.east_m = -(c * pose.v[0] - s * pose.v[1]) * cell_m;
  result.north_m = -(s * pose.v[0] + c * pose.v[1]) * cell_m;
  result.up_m = pose.v[2];
  result.tilt_east = pose.v[3] / cell_m;
  result.tilt_north = pose.v[4] / cell_m;
  const std::array<double, kUnknowns> unit{-cell_m,      -cell_m, 1.0, 1.0 / cell_m,
                                           1.0 / cell_m, -1.0,    -1.0};
  for (std::size_t i = 0; i < kUnknowns; ++i)
    for (std::size_t j = 0; j < kUnknowns; ++j)
      result.covariance[i][j] = unit[i] * unit[j] * cov(static_cast<int>(i), static_cast<int>(j));
  result.median_after_m = spread.median;
  result.nmad_after_m = spread.nmad;
  return result;
}

}  // namespace maquette::heightmap::detail
