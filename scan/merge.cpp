// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/merge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>
#include <nanoflann.hpp>

#include "core/median.hpp"
#include "scan/detail/surfels.hpp"

namespace maquette::scan {
namespace {

using detail::Surfel;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr double kTukey = 4.685;  // 95 % efficiency for normal residuals
constexpr double kSameWay = 0.8;  // cosine between normals of one surface
constexpr std::size_t kLeastPieces = 30;

struct Pieces {
  std::vector<Surfel> surfels;
  [[nodiscard]] std::size_t kdtree_get_point_count() const { return surfels.size(); }
  [[nodiscard]] double kdtree_get_pt(std::size_t i, std::size_t k) const {
    const Vec3& c = surfels[i].centre_mm;
    return k == 0 ? c.x : k == 1 ? c.y : c.z;
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Pieces>,
                                                 Pieces, 3, std::uint32_t>;

/// A scan at one size of voxel, in its own old place.
struct Level {
  Pieces pieces;
  std::unique_ptr<Tree> tree;
};

/// How the voxels of a scan are turned. Two lattices that are parallel keep their pieces side by
/// side in one and the same direction all over the part; where slopes are smoothed within a
/// piece, every distance then errs by slope times that offset, and the poses by a good part of
/// it. Between lattices that are turned against each other the offsets go every way.
Quaternion lattice_of(std::size_t scan) {
  constexpr double kGoldenTurn = 2.399963229728653;  // no two scans alike
  return rotation_about(normalized(Vec3{0.3, 0.5, 1.0}), kGoldenTurn * static_cast<double>(scan));
}

Result<std::unique_ptr<Level>> make_level(const Cloud& scan, std::size_t index, double voxel) {
  auto level = std::make_unique<Level>();
  const Quaternion turn = lattice_of(index);
  const detail::Views views = detail::views_of(scan);
  Cloud cloud = scan;
  cloud.stations.clear();
  for (std::size_t v = 0; v < views.ends.size(); ++v) {
    ScanStation& s = cloud.stations.emplace_back();
    s.position_mm = rotate(turn, views.places_mm[v]);
    s.points = views.ends[v] - (v == 0 ? 0 : views.ends[v - 1]);
  }
  oneapi::tbb::parallel_for(std::size_t{0}, cloud.points_mm.size(), [&](std::size_t i) {
    cloud.points_mm[i] = rotate(turn, cloud.points_mm[i]);
  });
  Box3 box;
  for (const Vec3& p : cloud.points_mm) box.add(p);
  detail::VoxelGrid grid;
  if (!detail::make_voxel_grid(box, voxel, grid))
    return fail(kMergeOptions, fmt::format("voxels of {} mm are too small for a scan of {} mm",
                                           voxel, norm(box.max - box.min)));
  for (const Surfel& s : detail::make_surfels(cloud, grid))
    if (dot(s.normal, s.normal) > 0.5) level->pieces.surfels.push_back(s);
  const Quaternion back{turn.w, -turn.x, -turn.y, -turn.z};
  for (Surfel& s : level->pieces.surfels) {
    s.centre_mm = rotate(back, s.centre_mm);
    s.normal = rotate(back, s.normal);
  }
  level->tree =
      std::make_unique<Tree>(3, level->pieces, nanoflann::KDTreeSingleIndexAdaptorParams(12));
  level->tree->buildIndex();
  return level;
}

struct Match {
  std::uint32_t i, j;  // pieces of the first and of the second scan
  double distance = 0.0;
  Vec3 normal, place;
  double worth = 1.0;  // root of the points behind it: pieces that a voxel's side cuts off are few
};

/// Pieces of `a` with their nearest of `b`, at the present poses.
std::vector<Match> match(const Level& a, const RigidTransform& pose_a, const Level& b,
                         const RigidTransform& pose_b, double gate) {
  const RigidTransform b_from_a = pose_b.inverse() * pose_a;
  const std::size_t n = a.pieces.surfels.size();
  std::vector<std::uint32_t> nearest(n, detail::KeyMap::npos);
  oneapi::tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
    const Vec3 p = b_from_a.point(a.pieces.surfels[i].centre_mm);
    const double query[3] = {p.x, p.y, p.z};
    std::uint32_t found = 0;
    double square = 0.0;
    if (b.tree->knnSearch(query, 1, &found, &square) == 1 && square < gate * gate)
      nearest[i] = found;
  });
  std::vector<Match> matches;
  for (std::size_t i = 0; i < n; ++i) {
    if (nearest[i] == detail::KeyMap::npos) continue;
    const Surfel& s = a.pieces.surfels[i];
    const Surfel& t = b.pieces.surfels[nearest[i]];
    const Vec3 na = pose_a.direction(s.normal), nb = pose_b.direction(t.normal);
    if (dot(na, nb) < kSameWay) continue;
    const Vec3 normal = normalized(na + nb);
    const Vec3 p = pose_a.point(s.centre_mm), q = pose_b.point(t.centre_mm);
    const double na_points = s.points, nb_points = t.points;
    matches.push_back({static_cast<std::uint32_t>(i), nearest[i], dot(p - q, normal), normal, p,
                       std::sqrt(2.0 * na_points * nb_points / (na_points + nb_points))});
  }
  return matches;
}

/// Normal equations of one pair for a step of the first scan against the second, about `centre`.
struct PairSystem {
  Matrix6 normal = Matrix6::Zero();
  Vector6 right = Vector6::Zero();
  double sigma = 0.0;
  std::size_t pieces = 0;
};

PairSystem system_of(const std::vector<Match>& matches, Vec3 centre, double floor_mm) {
  PairSystem s;
  std::vector<double> size;
  size.reserve(matches.size());
  for (const Match& m : matches) size.push_back(m.worth * std::abs(m.distance));
  s.sigma = std::fmax(kMadToSigma * median(std::move(size)), floor_mm);
  const double limit = kTukey * s.sigma;
  for (const Match& m : matches) {
    const double u = m.worth * m.distance / limit;
    if (!(std::abs(u) < 1.0)) continue;
    const double weight = std::pow(m.worth * (1.0 - u * u) / s.sigma, 2);
    const Vec3 turn = cross(m.place - centre, m.normal);
    Vector6 row;
    row << m.normal.x, m.normal.y, m.normal.z, turn.x, turn.y, turn.z;
    s.normal += weight * row * row.transpose();
    s.right -= weight * m.distance * row;
    ++s.pieces;
  }
  return s;
}

RigidTransform moved(const RigidTransform& pose, const Vector6& step, Vec3 centre) {
  const Vec3 turn{step(3), step(4), step(5)};
  const double angle = norm(turn);
  RigidTransform t;
  if (angle > 0.0) t.rotation = rotation_about((1.0 / angle) * turn, angle);
  t.translation_mm = centre - rotate(t.rotation, centre) + Vec3{step(0), step(1), step(2)};
  RigidTransform result = t * pose;
  result.rotation = normalized(result.rotation);
  return result;
}

struct Edge {
  std::size_t a, b;
  std::vector<Match> matches;
  PairSystem system;
};

/// Scans that hang together with the first; empty names: all do.
std::vector<std::size_t> apart(std::size_t n, const std::vector<Edge>& edges) {
  std::vector<bool> reached(n, false);
  reached[0] = true;
  for (std::size_t round = 0; round < n; ++round)
    for (const Edge& e : edges)
      if (reached[e.a] || reached[e.b]) reached[e.a] = reached[e.b] = true;
  std::vector<std::size_t> rest;
  for (std::size_t i = 0; i < n; ++i)
    if (!reached[i]) rest.push_back(i + 1);
  return rest;
}

/// Covariance of the poses but the first: the sandwich of M-estimators with scores summed over
/// square blocks of a sixteenth of the part (cluster-robust: Liang and Zeger 1986), because the
/// pieces share points, and the part's small relief, with their neighbours. Its outer factors are
/// the derivative of the scores, psi' = (1 - u^2)(1 - 5 u^2), not the weights (Huber 1981, section
/// 6.3): at normal noise 0.76 against 0.91, a fifth of a standard deviation.
Eigen::MatrixXd covariance_of(const std::vector<Edge>& edges, std::size_t scans, const Box3& all,
                              Vec3 centre) {
  const auto size = static_cast<Eigen::Index>(6 * (scans - 1));
  Eigen::MatrixXd bread = Eigen::MatrixXd::Zero(size, size);
  const Vec3 extent = all.max - all.min;
  const double block = std::max({extent.x, extent.y, extent.z}) / 16.0;
  std::map<std::array<int, 3>, Eigen::VectorXd> scores;
  for (const Edge& e : edges) {
    const double limit = kTukey * e.system.sigma;
    Matrix6 curve = Matrix6::Zero();
    for (const Match& m : e.matches) {
      const double u = m.worth * m.distance / limit;
      if (!(std::abs(u) < 1.0)) continue;
      const double pull = std::pow(m.worth * (1.0 - u * u) / e.system.sigma, 2) * m.distance;
      const Vec3 turn = cross(m.place - centre, m.normal);
      Vector6 row;
      row << m.normal.x, m.normal.y, m.normal.z, turn.x, turn.y, turn.z;
      curve += std::pow(m.worth / e.system.sigma, 2) * (1.0 - u * u) * (1.0 - 5.0 * u * u) * row *
               row.transpose();
      const Vec3 at = (1.0 / block) * (m.place - all.min);
      auto& score = scores[{static_cast<int>(std::floor(at.x)), static_cast<int>(std::floor(at.y)),
                            static_cast<int>(std::floor(at.z))}];
      if (score.size() == 0) score = Eigen::VectorXd::Zero(size);
      if (e.a > 0) score.segment<6>(static_cast<Eigen::Index>(6 * (e.a - 1))) += pull * row;
      if (e.b > 0) score.segment<6>(static_cast<Eigen::Index>(6 * (e.b - 1))) -= pull * row;
    }
    const auto a = static_cast<Eigen::Index>(6 * e.a) - 6,
               b = static_cast<Eigen::Index>(6 * e.b) - 6;
    if (a >= 0) bread.block<6, 6>(a, a) += curve;
    if (b >= 0) bread.block<6, 6>(b, b) += curve;
    if (a < 0 || b < 0) continue;
    bread.block<6, 6>(a, b) -= curve;
    bread.block<6, 6>(b, a) -= curve;
  }
  Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(size, size);
  for (const auto& [key, score] : scores) meat += score * score.transpose();
  const auto blocks = static_cast<double>(scores.size());
  const double few = blocks > 1.5 * static_cast<double>(size)
                         ? blocks / (blocks - static_cast<double>(size))
                         : 3.0;
  const Eigen::MatrixXd inverse = bread.inverse();
  return few * inverse * meat * inverse;
}

/// Log gains per channel by robust least squares over all pairs, mean zero.
void balance(std::vector<MergedPose>& poses, const std::vector<std::unique_ptr<Level>>& levels,
             const std::vector<Edge>& edges) {
  const auto n = static_cast<Eigen::Index>(poses.size());
  for (std::size_t channel = 0; channel < 3; ++channel) {
    const auto value = [channel](const Surfel& s) {
      return static_cast<double>(channel == 0 ? s.red : channel == 1 ? s.green : s.blue);
    };
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    for (const Edge& e : edges) {
      std::vector<double> ratios;
      for (const Match& m : e.matches) {
        const double a = value(levels[e.a]->pieces.surfels[m.i]),
                     b = value(levels[e.b]->pieces.surfels[m.j]);
        // Black and clipped places say nothing about a gain.
        if (a > 400.0 && b > 400.0 && a < 64'000.0 && b < 64'000.0)
          ratios.push_back(std::log(b / a));
      }
      if (ratios.size() < kLeastPieces) continue;
      double middle = median(ratios);
      const double sigma = std::fmax(nmad(ratios), 1e-4);
      for (int round = 0; round < 5; ++round) {
        double sum = 0.0, weights = 0.0;
        for (const double r : ratios) {
          const double w = std::fmin(1.0, 1.345 * sigma / std::fmax(std::abs(r - middle), 1e-12));
          sum += w * r;
          weights += w;
        }
        middle = sum / weights;
      }
      const double weight = static_cast<double>(ratios.size()) / (sigma * sigma);
      const auto a = static_cast<Eigen::Index>(e.a), b = static_cast<Eigen::Index>(e.b);
      // gain a * a = gain b * b: log gain a - log gain b = log(b / a).
      normal(a, a) += weight;
      normal(b, b) += weight;
      normal(a, b) -= weight;
      normal(b, a) -= weight;
      right(a) += weight * middle;
      right(b) -= weight * middle;
    }
    // The mean stays zero.
    normal.array() += std::fmax(1.0, normal.trace() / static_cast<double>(n));
    const Eigen::VectorXd logs = normal.completeOrthogonalDecomposition().solve(right);
    for (Eigen::Index i = 0; i < n; ++i)
      poses[static_cast<std::size_t>(i)].gain[channel] = std::exp(logs(i));
  }
}

Result<void> check(std::span<const Cloud> scans, const MergeOptions& o) {
  if (scans.size() < 2)
    return fail(kMergeOptions, fmt::format("{} scan: merging takes two or more", scans.size()));
  for (std::size_t i = 0; i < scans.size(); ++i)
    if (scans[i].points_mm.size() < 100 || scans[i].points_mm.size() > 0xfffffff0U)
      return fail(kMergeOptions, fmt::format("scan {} has {} points; 100 to 4e9 can be merged",
                                             i + 1, scans[i].points_mm.size()));
  if (!(o.voxel_mm >= 0.0) || !(o.capture_mm >= 0.0) ||
      !(o.least_overlap > 0.0 && o.least_overlap <= 1.0))
    return fail(kMergeOptions,
                fmt::format("voxel {} mm and capture {} mm must not be negative, overlap {} must "
                            "be above 0 and at most 1",
                            o.voxel_mm, o.capture_mm, o.least_overlap));
  return {};
}

}  // namespace

Result<Merge> merge_scans(std::span<const Cloud> scans, const MergeOptions& options,
                          const RunContext& run) {
  MAQUETTE_TRY_VOID(check(scans, options));
  const std::size_t n = scans.size();
  Merge merge;
  merge.voxel_mm = options.voxel_mm;
  Box3 all;
  double densest = INFINITY;
  for (const Cloud& c : scans) {
    for (const Vec3& p : c.points_mm) all.add(p);
    if (merge.voxel_mm == 0.0) densest = std::min(densest, detail::voxel_for(c.points_mm, 8.0));
  }
  const double extent = norm(all.max - all.min);
  // Finer than this the pieces are more than the poses need.
  if (merge.voxel_mm == 0.0) merge.voxel_mm = std::fmax(densest, extent / 500.0);
  const double capture = options.capture_mm > 0.0 ? options.capture_mm : extent / 20.0;

  std::vector<RigidTransform> poses(n);
  std::vector<std::unique_ptr<Level>> levels(n);
  std::vector<Edge> edges;
  const Vec3 centre = 0.5 * (all.min + all.max);
  // 8, 4, 2, 1 times the finest voxel, as far as the capture asks for it.
  int doublings = 0;
  while (doublings < 3 && merge.voxel_mm * (2 << doublings) < capture) ++doublings;
  for (int level = options.poses ? doublings : 0; level >= 0; --level) {
    const double voxel = merge.voxel_mm * (1 << level);
    for (std::size_t i = 0; i < n; ++i) {
      MAQUETTE_TRY(levels[i], make_level(scans[i], i, voxel));
    }
    // Wide at first, then as wide as neighbouring pieces lie apart.
    double gate =
        level == doublings && options.poses ? std::fmax(capture, 2.0 * voxel) : 2.0 * voxel;
    bool rest = false;
    for (int round = 0; round < options.most_rounds && !rest; ++round) {
      if (run.stopped()) return fail(kCancelled, "the merge was cancelled");
      run.progress((doublings - level + round / (1.0 + options.most_rounds)) / (doublings + 1.0));
      edges.clear();
      for (std::size_t a = 0; a < n; ++a)
        for (std::size_t b = a + 1; b < n; ++b) {
          Edge e{a, b, match(*levels[a], poses[a], *levels[b], poses[b], gate), {}};
          const double smaller = static_cast<double>(
              std::min(levels[a]->pieces.surfels.size(), levels[b]->pieces.surfels.size()));
          if (e.matches.size() < kLeastPieces ||
              static_cast<double>(e.matches.size()) < options.least_overlap * smaller)
            continue;
          e.system = system_of(e.matches, centre, 1e-6 * voxel);
          edges.push_back(std::move(e));
        }
      if (const auto rest_of = apart(n, edges); !rest_of.empty())
        return fail(kMergeApart,
                    fmt::format("scan {} has less than {:.0f} % in common with those before it "
                                "within {:.3g} mm; bring the scans nearer to their places",
                                fmt::join(rest_of, ", "), 100.0 * options.least_overlap, gate));
      if (!options.poses) break;

      const auto size = static_cast<Eigen::Index>(6 * n);
      Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(size, size);
      Eigen::VectorXd right = Eigen::VectorXd::Zero(size);
      for (const Edge& e : edges) {
        const auto a = static_cast<Eigen::Index>(6 * e.a), b = static_cast<Eigen::Index>(6 * e.b);
        normal.block<6, 6>(a, a) += e.system.normal;
        normal.block<6, 6>(b, b) += e.system.normal;
        normal.block<6, 6>(a, b) -= e.system.normal;
        normal.block<6, 6>(b, a) -= e.system.normal;
        right.segment<6>(a) += e.system.right;
        right.segment<6>(b) -= e.system.right;
      }
      // The first scan stays. Rotations count at the part's radius, so that all are lengths.
      const Eigen::MatrixXd information = normal.bottomRightCorner(size - 6, size - 6);
      Eigen::VectorXd scale = Eigen::VectorXd::Ones(size - 6);
      for (Eigen::Index i = 0; i < size - 6; ++i)
        if (i % 6 >= 3) scale(i) = 2.0 / extent;
      const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
      const double least = eigen.eigenvalues()(0);
      // A direction that a step of one robust sigma of all pieces would not feel by a voxel.
      if (!(least > 1e-7 * eigen.eigenvalues()(size - 7)) || 1.0 / std::sqrt(least) > voxel)
        return fail(
            kMergeFree,
            fmt::format("the scans' common surface leaves a pose free (it is known to {:.3g} "
                        "mm only, pieces are {:.3g} mm): scan targets or edges with it",
                        1.0 / std::sqrt(std::fmax(least, 1e-300)), voxel));
      const Eigen::VectorXd step =
          scale.asDiagonal() * (eigen.eigenvectors() * (eigen.eigenvectors().transpose() *
                                                        (scale.asDiagonal() * right.tail(size - 6)))
                                                           .cwiseQuotient(eigen.eigenvalues()));
      double largest = 0.0;
      for (std::size_t i = 1; i < n; ++i) {
        const Vector6 s = step.segment<6>(static_cast<Eigen::Index>(6 * (i - 1)));
        poses[i] = moved(poses[i], s, centre);
        largest = std::max({largest, s.head<3>().norm(), 0.5 * extent * s.tail<3>().norm()});
      }
      ++merge.iterations;
      // Narrower while far apart; at rest when the step is small against what is known.
      const bool narrow = gate <= 2.0 * voxel * 1.0001;
      if (!narrow) gate = std::fmax(2.0 * voxel, std::fmin(0.6 * gate, 8.0 * largest + voxel));
      const double known = 1.0 / std::sqrt(least);
      rest = narrow &&
             (largest < std::fmax(0.05 * known, 1e-6) || (level > 0 && largest < 0.02 * voxel));
    }
    if (options.poses && !rest)
      return fail(
          kMergeNotConverged,
          fmt::format("the scans' poses did not come to rest with pieces of {:.3g} mm in {} "
                      "rounds; bring the scans nearer to their places",
                      voxel, options.most_rounds));
  }

  merge.scans.resize(n);
  if (options.poses) {
    const Eigen::MatrixXd covariance = covariance_of(edges, n, all, centre);
    for (std::size_t i = 0; i < n; ++i) {
      MergedPose& p = merge.scans[i];
      p.correction = poses[i];
      p.centre_mm = centre;
      if (i == 0) continue;
      const Matrix6 block = covariance.block<6, 6>(static_cast<Eigen::Index>(6 * (i - 1)),
                                                   static_cast<Eigen::Index>(6 * (i - 1)));
      for (Eigen::Index r = 0; r < 6; ++r)
        for (Eigen::Index c = 0; c < 6; ++c)
          p.covariance[static_cast<std::size_t>(6 * r + c)] = block(r, c);
    }
  }
  std::vector<std::vector<bool>> shared(n);
  for (std::size_t i = 0; i < n; ++i) shared[i].resize(levels[i]->pieces.surfels.size());
  for (Edge& e : edges) {
    MergePair pair{e.a, e.b, e.matches.size(), 0.0, e.system.sigma, 0.0, 0.0, 0.0};
    pair.overlap = static_cast<double>(e.matches.size()) /
                   static_cast<double>(std::min(shared[e.a].size(), shared[e.b].size()));
    // The step of the first scan that this pair alone asks for, about its own middle.
    Vec3 middle;
    for (const Match& m : e.matches) {
      shared[e.a][m.i] = shared[e.b][m.j] = true;
      middle += (1.0 / static_cast<double>(e.matches.size())) * m.place;
    }
    const PairSystem own = system_of(e.matches, middle, 1e-6 * merge.voxel_mm);
    const Vector6 step = own.normal.completeOrthogonalDecomposition().solve(own.right);
    pair.misfit_mm = step.head<3>().norm();
    pair.misfit_rad = step.tail<3>().norm();
    pair.chi_squared = step.dot(own.normal * step);
    merge.pairs.push_back(pair);
  }
  for (std::size_t i = 0; i < n; ++i)
    merge.scans[i].overlap =
        static_cast<double>(std::count(shared[i].begin(), shared[i].end(), true)) /
        static_cast<double>(std::max<std::size_t>(1, shared[i].size()));
  const bool coloured =
      std::all_of(scans.begin(), scans.end(), [](const Cloud& c) { return !c.colours.empty(); });
  if (options.balance_colour && coloured) balance(merge.scans, levels, edges);
  run.progress(1.0);
  return merge;
}

}  // namespace maquette::scan
