// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/joint_adjustment.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "heightmap/detail/surface_pair.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr std::size_t kRigid = 5;  // east, north, up, two tilts
constexpr int kMostSteps = 30;
constexpr double kSettled_px = 5e-4;       // a tenth of what four surfaces of 128 pixels tell
constexpr double kSeamClearance_px = 2.0;  // of the coarser pixel: blurred over the seam
constexpr double kMostSamples = 4e5;       // of a pair
constexpr double kMostSigma_px = 0.1;      // of its pairs' coarsest
constexpr std::ptrdiff_t kMostLattice = 160;
constexpr std::ptrdiff_t kMostLag = 12;

struct Pair {
  std::size_t i = 0, j = 0;
  SurfacePair cells;
  double pixel_m = 1.0, nmad = 1.0;
  std::ptrdiff_t stride = 1;
  Coregistration alone;
};

/// Where a surface's unknowns stand among all.
struct Block {
  std::ptrdiff_t first = -1;  ///< -1: it is not moved
  std::size_t bow = 0, seams = 0;
  [[nodiscard]] std::size_t size() const { return kRigid + bow + seams; }
};

/// The derivatives of what is added to a surface at (x, y) by its unknowns beyond the shift;
/// (u, v) is the place in its own frame.
void height_terms(const JointSurface& s, const Block& b, double half, double x, double y, double u,
                  double v, double* out) {
  *out++ = 1.0;
  *out++ = x;
  *out++ = y;
  if (b.bow > 0) {
    const double p = x / half, q = y / half;
    *out++ = p * p;
    *out++ = p * q;
    *out++ = q * q;
  }
  for (const Seam& seam : s.seams) *out++ = seam.side(u, v);
}

struct System {
  Eigen::MatrixXd a;
  Eigen::VectorXd b;
};

/// One sample of a pair: residual, and derivatives of the model by the slopes of both surfaces.
struct Sample {
  double residual = NAN, x = 0.0, y = 0.0;
  Eigen::VectorXd row_lower, row_upper;
};

class Problem {
 public:
  Problem(const std::vector<JointSurface>& surfaces, double spacing_m);
  bool pair_up();
  void lay_out();
  bool solve();
  JointAdjustment result();

 private:
  [[nodiscard]] Sample sample(const Pair& p, std::ptrdiff_t r, std::ptrdiff_t c,
                              bool with_rows) const;
  template <class Each>
  void for_samples(const Pair& p, std::ptrdiff_t r, const Each& each, bool with_rows = true) const;
  [[nodiscard]] double limit(const Pair& p) const { return kTukey * std::max(p.nmad, 1e-9); }
  [[nodiscard]] System system_of(const Pair& p) const;
  [[nodiscard]] Spread spread(const Pair& p) const;
  [[nodiscard]] Eigen::MatrixXd meat() const;
  void report_pairs(JointAdjustment& out) const;

  const std::vector<JointSurface>* s_;
  double spacing_, half_;
  std::vector<Pair> pairs_;
  std::vector<Block> blocks_;
  std::vector<JointPose> pose_;
  Eigen::Index unknowns_ = 0;
  Eigen::MatrixXd bread_;
};

Problem::Problem(const std::vector<JointSurface>& surfaces, double spacing_m)
    : s_(&surfaces), spacing_(spacing_m), blocks_(surfaces.size()), pose_(surfaces.size()) {
  const Grid<float>& z = *surfaces.front().z_m;
  half_ = 0.5 * spacing_m * static_cast<double>(std::max(z.rows(), z.cols()) - 1);
  pose_[0].found = true;
}

/// Every pair that tells its shift, and the first poses along the pairs with the most ground.
bool Problem::pair_up() {
  const auto& s = *s_;
  for (std::size_t i = 0; i < s.size(); ++i)
    for (std::size_t j = i + 1; j < s.size(); ++j) {
      if (!s[i].horizontal || !s[j].horizontal) continue;
      // A bow or a step is in the residuals still: what they tell is judged in the end.
      CoregisterOptions options;
      if (s[i].bow || s[j].bow || !s[i].seams.empty() || !s[j].seams.empty())
        options.most_sigma_pixels = INFINITY;
      auto alone = coregister(*s[i].z_m, *s[j].z_m, spacing_, s[i].pixel_m, s[j].pixel_m, options);
      if (!alone || !alone->horizontal) continue;
      Pair p;
      p.i = i;
      p.j = j;
      p.pixel_m = std::max(s[i].pixel_m, s[j].pixel_m);
      p.cells = cells_of(*s[i].z_m, *s[j].z_m, spacing_, p.pixel_m);
      bring_to_one_resolution(p.cells, s[i].pixel_m, s[j].pixel_m);
      p.stride = static_cast<std::ptrdiff_t>(std::max(
          1.0,
          std::ceil(std::sqrt(static_cast<double>(p.cells.lower.cells().size()) / kMostSamples))));
      p.nmad = alone->nmad_after_m;
      p.alone = std::move(*alone);
      pairs_.push_back(std::move(p));
    }
  for (bool grown = true; grown;) {
    grown = false;
    const Pair* best = nullptr;
    for (const Pair& p : pairs_)
      if (pose_[p.i].found != pose_[p.j].found &&
          (best == nullptr || p.alone.overlap / p.pixel_m > best->alone.overlap / best->pixel_m))
        best = &p;
    if (best == nullptr) break;
    const bool forward = pose_[best->i].found;
    const JointPose& from = pose_[forward ? best->i : best->j];
    JointPose& to = pose_[forward ? best->j : best->i];
    const double sign = forward ? 1.0 : -1.0;
    to.east_m = from.east_m + sign * best->alone.east_m;
    to.north_m = from.north_m + sign * best->alone.north_m;
    to.up_m = from.up_m + sign * best->alone.up_m;
    to.tilt_east = from.tilt_east + sign * best->alone.tilt_east;
    to.tilt_north = from.tilt_north + sign * best->alone.tilt_north;
    to.found = grown = true;
  }
  std::erase_if(pairs_, [&](const Pair& p) { return !pose_[p.i].found; });
  return !pairs_.empty();
}

void Problem::lay_out() {
  unknowns_ = 0;
  for (std::size_t k = 0; k < blocks_.size(); ++k) {
    pose_[k].half_width_m = half_;
    pose_[k].steps_m.assign((*s_)[k].seams.size(), 0.0);
    Block& b = blocks_[k];
    b.seams = (*s_)[k].seams.size();
    if (k == 0) {  // stays, but its seams are steps too
      b.first = b.seams > 0 ? unknowns_ : -1;
      unknowns_ += static_cast<Eigen::Index>(b.seams);
      continue;
    }
    if (!pose_[k].found) continue;
    b.bow = (*s_)[k].bow ? 3 : 0;
    b.first = unknowns_;
    unknowns_ += static_cast<Eigen::Index>(b.size());
  }
}

/// Cell (r, c) of a pair, in the lower surface's own frame.
Sample Problem::sample(const Pair& p, std::ptrdiff_t r, std::ptrdiff_t c, bool with_rows) const {
  Sample out;
  const auto lower = static_cast<double>(p.cells.lower(r, c));
  if (std::isnan(lower)) return out;
  const auto& s = *s_;
  const JointPose &low = pose_[p.i], &up = pose_[p.j];
  const Grid<float>& nodes = *s[0].z_m;
  const double m = static_cast<double>(p.cells.nodes);
  const double x_own =
      ((static_cast<double>(c) + 0.5) * m - 0.5 * static_cast<double>(nodes.cols())) * spacing_;
  const double y_own =
      ((static_cast<double>(r) + 0.5) * m - 0.5 * static_cast<double>(nodes.rows())) * spacing_;
  const double x = x_own + low.east_m, y = y_own + low.north_m;
  const double u = x - up.east_m, v = y - up.north_m;
  const double clear = kSeamClearance_px * p.pixel_m;
  for (const Seam& seam : s[p.i].seams)
    if (seam.distance_m(x_own, y_own) < clear) return out;
  for (const Seam& seam : s[p.j].seams)
    if (seam.distance_m(u, v) < clear) return out;
  const double cell = p.cells.cell_m;
  const auto [z, gx, gy] =
      height_and_gradient(p.cells.upper, static_cast<double>(c) + (u - x_own) / cell,
                          static_cast<double>(r) + (v - y_own) / cell);
  const auto [l, lx, ly] =
      height_and_gradient(p.cells.lower, static_cast<double>(c), static_cast<double>(r));
  if (std::isnan(z + l)) return out;
  out.x = x;
  out.y = y;
  out.residual = lower + low.raised_m(x, y, s[p.i].seams) - z - up.raised_m(x, y, s[p.j].seams);
  if (std::isnan(out.residual) || !with_rows) return out;
  const auto row = [&](double sx, double sy) {
    Eigen::VectorXd d = Eigen::VectorXd::Zero(unknowns_);
    double terms[64];
    const auto put = [&](std::size_t k, double sign, double own_x, double own_y) {
      const Block& b = blocks_[k];
      if (b.first < 0) return;
      height_terms(s[k], b, half_, x, y, own_x, own_y, terms);
      if (k == 0) {
        for (std::size_t t = 0; t < b.seams; ++t)
          d[b.first + static_cast<Eigen::Index>(t)] = sign * terms[3 + t];
        return;
      }
      d[b.first] = -sign * sx / cell;
      d[b.first + 1] = -sign * sy / cell;
      for (std::size_t t = 0; t + 2 < b.size(); ++t)
        d[b.first + 2 + static_cast<Eigen::Index>(t)] = sign * terms[t];
    };
    put(p.j, 1.0, u, v);
    put(p.i, -1.0, x_own, y_own);
    return d;
  };
  out.row_lower = row(lx, ly);
  out.row_upper = row(gx, gy);
  return out;
}

template <class Each>
void Problem::for_samples(const Pair& p, std::ptrdiff_t r, const Each& each, bool with_rows) const {
  for (std::ptrdiff_t c = 0; c < p.cells.lower.cols(); c += p.stride)
    if (const Sample q = sample(p, r, c, with_rows); !std::isnan(q.residual)) each(q);
}

Spread Problem::spread(const Pair& p) const {
  const std::ptrdiff_t rows = (p.cells.lower.rows() + p.stride - 1) / p.stride;
  std::vector<std::vector<double>> of_row(static_cast<std::size_t>(rows));
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t k) {
    for_samples(
        p, k * p.stride,
        [&](const Sample& q) { of_row[static_cast<std::size_t>(k)].push_back(q.residual); }, false);
  });
  std::vector<double> all;
  for (const auto& row : of_row) all.insert(all.end(), row.begin(), row.end());
  return spread_of(all);
}

/// Derivative and value of the sum of a pair's scores, weighed by its spread.
System Problem::system_of(const Pair& p) const {
  const std::ptrdiff_t rows = (p.cells.lower.rows() + p.stride - 1) / p.stride;
  struct Part {
    System s;
    double slope = 0.0, n = 0.0;
  };
  std::vector<Part> part(static_cast<std::size_t>(rows));
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t k) {
    Part& q = part[static_cast<std::size_t>(k)];
    q.s.a = Eigen::MatrixXd::Zero(unknowns_, unknowns_);
    q.s.b = Eigen::VectorXd::Zero(unknowns_);
    for_samples(p, k * p.stride, [&](const Sample& one) {
      q.slope += psi_slope(one.residual, limit(p));
      q.n += 1.0;
      q.s.b += psi(one.residual, limit(p)) * (p.cells.by_upper ? one.row_upper : one.row_lower);
      q.s.a.selfadjointView<Eigen::Lower>().rankUpdate(one.row_upper, one.row_lower, 0.5);
    });
  });
  Part sum{{Eigen::MatrixXd::Zero(unknowns_, unknowns_), Eigen::VectorXd::Zero(unknowns_)}};
  for (const Part& q : part) {  // in order: the same for any number of threads
    sum.s.a += q.s.a;
    sum.s.b += q.s.b;
    sum.slope += q.slope;
    sum.n += q.n;
  }
  const double weight = 1.0 / (p.nmad * p.nmad);
  sum.s.a = weight * (sum.slope / std::max(1.0, sum.n)) *
            Eigen::MatrixXd(sum.s.a.selfadjointView<Eigen::Lower>());
  sum.s.b *= weight;
  return sum.s;
}

/// Inverse after scaling to a unit diagonal; empty if unknowns cannot be told apart.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& a) {
  const Eigen::VectorXd d = a.diagonal();
  if (!(d.minCoeff() > 0.0)) return {};
  const Eigen::VectorXd scale = d.cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd m = scale.asDiagonal() * a * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(m);
  if (!(eigen.eigenvalues()[0] > 1e-8)) return {};
  return scale.asDiagonal() * m.inverse() * scale.asDiagonal();
}

bool Problem::solve() {
  double finest = INFINITY;
  for (const Pair& p : pairs_) finest = std::min(finest, p.pixel_m);
  for (int i = 0; i < kMostSteps; ++i) {
    System sum{Eigen::MatrixXd::Zero(unknowns_, unknowns_), Eigen::VectorXd::Zero(unknowns_)};
    for (Pair& p : pairs_) {
      p.nmad = std::max(1e-9, spread(p).nmad);
      const System one = system_of(p);
      sum.a += one.a;
      sum.b += one.b;
    }
    bread_ = inverse(sum.a);
    if (bread_.size() == 0) return false;
    const Eigen::VectorXd step = bread_ * sum.b;
    double moved = 0.0;
    for (std::size_t k = 0; k < blocks_.size(); ++k) {
      const Block& b = blocks_[k];
      if (b.first < 0) continue;
      JointPose& pose = pose_[k];
      Eigen::Index at = b.first;
      if (k > 0) {
        moved = std::max(moved, std::hypot(step[at], step[at + 1]));
        pose.east_m += step[at++];
        pose.north_m += step[at++];
        pose.up_m += step[at++];
        pose.tilt_east += step[at++];
        pose.tilt_north += step[at++];
        for (std::size_t t = 0; t < b.bow; ++t) pose.bow_m[t] += step[at++];
      }
      for (double& one : pose.steps_m) one += step[at++];
    }
    if (moved < kSettled_px * finest && i > 1) return true;
  }
  return false;
}

/// Covariance of the sum of all scores, on a lattice of places in the first surface's frame.
Eigen::MatrixXd Problem::meat() const {
  double cell = 2.0 * half_ / static_cast<double>(kMostLattice);
  for (const Pair& p : pairs_) cell = std::max(cell, p.cells.cell_m);
  const auto n = static_cast<std::ptrdiff_t>(std::ceil(2.0 * half_ / cell)) + 3;
  const auto lattice = [&](double x, double y) -> std::ptrdiff_t {
    const auto c = static_cast<std::ptrdiff_t>(std::floor((x + half_) / cell)) + 1;
    const auto r = static_cast<std::ptrdiff_t>(std::floor((y + half_) / cell)) + 1;
    return std::clamp<std::ptrdiff_t>(r, 0, n - 1) * n + std::clamp<std::ptrdiff_t>(c, 0, n - 1);
  };
  const auto count = static_cast<std::size_t>(n * n);
  Eigen::MatrixXd score = Eigen::MatrixXd::Zero(unknowns_, n * n);
  std::ptrdiff_t window = 1;
  double used = 0.0;
  for (const Pair& p : pairs_) {
    std::vector<double> weighed(count, 0.0), samples(count, 0.0);
    const double weight = 1.0 / (p.nmad * p.nmad);
    for (std::ptrdiff_t r = 0; r < p.cells.lower.rows(); r += p.stride)
      for_samples(p, r, [&](const Sample& q) {
        const std::ptrdiff_t at = lattice(q.x, q.y);
        const double e = psi(q.residual, limit(p));
        weighed[static_cast<std::size_t>(at)] += e;
        samples[static_cast<std::size_t>(at)] += 1.0;
        score.col(at) += weight * e * (p.cells.by_upper ? q.row_upper : q.row_lower);
      });
    // Up to which ring cells of this pair are alike.
    std::vector<double> ring(kMostLag + 2, 0.0), ring_n(kMostLag + 2, 0.0);
    const auto at = [n](std::ptrdiff_t r, std::ptrdiff_t c) {
      return static_cast<std::size_t>(r * n + c);
    };
    for (std::ptrdiff_t dr = 0; dr <= kMostLag; ++dr)
      for (std::ptrdiff_t dc = -kMostLag; dc <= kMostLag; ++dc) {
        const auto far = std::lround(std::hypot(static_cast<double>(dr), static_cast<double>(dc)));
        if (far > kMostLag) continue;
        for (std::ptrdiff_t r = 0; r + dr < n; ++r)
          for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, -dc);
               c < n - std::max<std::ptrdiff_t>(0, dc); ++c) {
            const std::size_t a = at(r, c), b = at(r + dr, c + dc);
            if (samples[a] == 0.0 || samples[b] == 0.0) continue;
            ring[static_cast<std::size_t>(far)] += weighed[a] * weighed[b];
            ring_n[static_cast<std::size_t>(far)] += 1.0;
          }
      }
    const double c0 = ring[0] / std::max(1.0, ring_n[0]);
    const auto alike = [&](std::ptrdiff_t r) {
      const auto k = static_cast<std::size_t>(r);
      return r <= kMostLag && ring_n[k] > 0.0 && std::abs(ring[k] / ring_n[k]) > 0.03 * c0;
    };
    std::ptrdiff_t m = 1;
    while (m < kMostLag && (alike(m) || alike(m + 1))) ++m;
    window = std::max(window, m);
    used += ring_n[0];
  }
  used /= static_cast<double>(pairs_.size());
  const auto taper = [window](double far) {
    return std::clamp(2.0 - far / static_cast<double>(window), 0.0, 1.0);
  };
  std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> lags;
  double weights = -1.0;
  for (std::ptrdiff_t dr = 0; dr < 2 * window; ++dr)
    for (std::ptrdiff_t dc = dr == 0 ? 0 : -2 * window; dc <= 2 * window; ++dc)
      if (const double w = taper(std::hypot(dr, dc)); w > 0.0) {
        lags.emplace_back(dr, dc);
        weights += 2.0 * w;
      }
  std::vector<Eigen::MatrixXd> part(lags.size());
  oneapi::tbb::parallel_for(std::size_t{0}, lags.size(), [&](std::size_t k) {
    const auto [dr, dc] = lags[k];
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(unknowns_, unknowns_);
    for (std::ptrdiff_t r = 0; r + dr < n; ++r) {
      const std::ptrdiff_t c0 = std::max<std::ptrdiff_t>(0, -dc);
      const std::ptrdiff_t length = n - std::max<std::ptrdiff_t>(0, dc) - c0;
      sum.noalias() += score.middleCols(r * n + c0, length) *
                       score.middleCols((r + dr) * n + c0 + dc, length).transpose();
    }
    part[k] = dr == 0 && dc == 0
                  ? sum
                  : Eigen::MatrixXd(taper(std::hypot(dr, dc)) * (sum + sum.transpose()));
  });
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(unknowns_, unknowns_);
  for (const Eigen::MatrixXd& p : part) out += p;
  // The fit took the longest waves out of the residuals (coregister.cpp), of each surface its own.
  double moved = 0.0;
  for (const JointPose& pose : pose_) moved += pose.found ? 1.0 : 0.0;
  const double taken =
      static_cast<double>(unknowns_) / std::max(1.0, moved - 1.0) * weights / std::max(1.0, used);
  return out / std::fmax(0.1, 1.0 - taken);
}

void Problem::report_pairs(JointAdjustment& out) const {
  std::map<std::pair<std::size_t, std::size_t>, const JointPair*> by;
  for (const Pair& p : pairs_) {
    JointPair r;
    r.lower = p.i;
    r.upper = p.j;
    r.pixel_m = p.pixel_m;
    r.before_east_m = p.alone.east_m;
    r.before_north_m = p.alone.north_m;
    r.median_before_m = p.alone.median_before_m;
    r.nmad_before_m = p.alone.nmad_before_m;
    r.overlap = p.alone.overlap;
    const Spread after = spread(p);
    r.median_after_m = after.median;
    r.nmad_after_m = after.nmad;
    // A step of the upper (or lower, if the upper stays) surface alone.
    const System one = system_of(p);
    const bool upper = blocks_[p.j].first >= 0 && p.j > 0;
    const Block& b = blocks_[upper ? p.j : p.i];
    const auto size = static_cast<Eigen::Index>(kRigid);
    const Eigen::MatrixXd inv = inverse(one.a.block(b.first, b.first, size, size));
    if (inv.size() > 0) {
      const Eigen::VectorXd step = inv * one.b.segment(b.first, size);
      r.off_east_m = (upper ? 1.0 : -1.0) * step[0];
      r.off_north_m = (upper ? 1.0 : -1.0) * step[1];
    }
    out.pairs.push_back(r);
  }
  for (const JointPair& p : out.pairs) by[{p.lower, p.upper}] = &p;
  for (const JointPair& ij : out.pairs)
    for (const JointPair& jk : out.pairs) {
      const auto ik = by.find({ij.lower, jk.upper});
      if (jk.lower != ij.upper || ik == by.end()) continue;
      const JointPair& far = *ik->second;
      const double pixel = std::max({ij.pixel_m, jk.pixel_m, far.pixel_m});
      out.loop_before_px =
          std::max(out.loop_before_px,
                   std::hypot(ij.before_east_m + jk.before_east_m - far.before_east_m,
                              ij.before_north_m + jk.before_north_m - far.before_north_m) /
                       pixel);
      out.loop_after_px = std::max(out.loop_after_px,
                                   std::hypot(ij.off_east_m + jk.off_east_m - far.off_east_m,
                                              ij.off_north_m + jk.off_north_m - far.off_north_m) /
                                       pixel);
    }
}

JointAdjustment Problem::result() {
  const Eigen::MatrixXd covariance = bread_ * meat() * bread_;
  for (std::size_t k = 0; k < pose_.size(); ++k) {
    const Block& b = blocks_[k];
    if (b.first < 0) continue;
    const auto size = static_cast<Eigen::Index>(k == 0 ? b.seams : b.size());
    const Eigen::MatrixXd own = covariance.block(b.first, b.first, size, size);
    pose_[k].covariance.assign(own.data(), own.data() + own.size());
    double pixel_m = 0.0;
    for (const Pair& p : pairs_)
      if (p.i == k || p.j == k) pixel_m = std::max(pixel_m, p.pixel_m);
    if (k > 0 && !(std::sqrt(std::max(own(0, 0), own(1, 1))) <= kMostSigma_px * pixel_m))
      pose_[k].found = false;
  }
  JointAdjustment out;
  report_pairs(out);
  out.poses = pose_;
  return out;
}

}  // namespace

double Seam::side(double x, double y) const {
  const double cross =
      (end_x_m - begin_x_m) * (y - begin_y_m) - (end_y_m - begin_y_m) * (x - begin_x_m);
  return cross >= 0.0 ? 0.5 : -0.5;
}

double Seam::distance_m(double x, double y) const {
  const double cross =
      (end_x_m - begin_x_m) * (y - begin_y_m) - (end_y_m - begin_y_m) * (x - begin_x_m);
  return std::abs(cross) / std::hypot(end_x_m - begin_x_m, end_y_m - begin_y_m);
}

double JointPose::raised_m(double x, double y, const std::vector<Seam>& seams) const {
  const double p = x / half_width_m, q = y / half_width_m;
  double up = up_m + tilt_east * x + tilt_north * y + bow_m[0] * p * p + bow_m[1] * p * q +
              bow_m[2] * q * q;
  for (std::size_t i = 0; i < steps_m.size(); ++i)
    up += steps_m[i] * seams[i].side(x - east_m, y - north_m);
  return up;
}

std::optional<JointAdjustment> joint_adjustment(const std::vector<JointSurface>& surfaces,
                                                double spacing_m) {
  Problem problem(surfaces, spacing_m);
  if (!problem.pair_up()) return std::nullopt;
  problem.lay_out();
  if (!problem.solve()) return std::nullopt;
  return problem.result();
}

}  // namespace maquette::heightmap::detail
