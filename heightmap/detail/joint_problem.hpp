// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file joint_problem.hpp
/// The least-squares problem behind joint_adjustment.hpp: pairs, unknowns, samples.

#include <cmath>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "heightmap/detail/joint_adjustment.hpp"
#include "heightmap/detail/surface_pair.hpp"

namespace maquette::heightmap::detail {

inline constexpr std::size_t kRigid = 5;  ///< east, north, up, two tilts

struct AlignedPair {
  std::size_t i = 0, j = 0;
  SurfacePair cells;
  double pixel_m = 1.0, nmad = 1.0;
  std::ptrdiff_t stride = 1;
  Coregistration alone;
};

/// Where a surface's unknowns stand among all.
struct JointBlock {
  std::ptrdiff_t first = -1;  ///< -1: it is not moved
  std::size_t bow = 0, seams = 0;
  [[nodiscard]] std::size_t size() const { return kRigid + bow + seams; }
};

struct JointSystem {
  Eigen::MatrixXd a;
  Eigen::VectorXd b;
};

/// One sample of a pair: residual, and derivatives of the model by the slopes of both surfaces.
struct JointSample {
  double residual = NAN, x = 0.0, y = 0.0;
  Eigen::VectorXd row_lower, row_upper;
};

class JointProblem {
 public:
  JointProblem(const std::vector<JointSurface>& surfaces, double spacing_m);
  bool pair_up();
  void lay_out();
  bool solve();
  JointAdjustment result();

 private:
  [[nodiscard]] JointSample sample(const AlignedPair& p, std::ptrdiff_t r, std::ptrdiff_t c,
                                   bool with_rows) const;
  template <class Each>
  void for_samples(const AlignedPair& p, std::ptrdiff_t r, const Each& each,
                   bool with_rows = true) const;
  [[nodiscard]] double limit(const AlignedPair& p) const { return kTukey * p.nmad; }
  [[nodiscard]] JointSystem system_of(const AlignedPair& p) const;
  [[nodiscard]] Spread spread(const AlignedPair& p) const;
  [[nodiscard]] Eigen::MatrixXd meat() const;
  void report_pairs(JointAdjustment& out) const;

  const std::vector<JointSurface>* s_;
  double spacing_, half_;
  std::vector<AlignedPair> pairs_;
  std::vector<JointBlock> blocks_;
  std::vector<JointPose> pose_;
  Eigen::Index unknowns_ = 0;
  Eigen::MatrixXd bread_;
};

template <class Each>
void JointProblem::for_samples(const AlignedPair& p, std::ptrdiff_t r, const Each& each,
                               bool with_rows) const {
  for (std::ptrdiff_t c = 0; c < p.cells.lower.cols(); c += p.stride)
    if (const JointSample q = sample(p, r, c, with_rows); !std::isnan(q.residual)) each(q);
}

/// Inverse after scaling to a unit diagonal; empty if unknowns cannot be told apart.
[[nodiscard]] Eigen::MatrixXd scaled_inverse(const Eigen::MatrixXd& a);

}  // namespace maquette::heightmap::detail
