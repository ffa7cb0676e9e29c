// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file merge.hpp
/// Several scans of one part become one cloud: poses, colours, and what is known about both.
///
/// Takes    scans in one frame by their poses, within about a twentieth of their size of the
///          truth, in millimetres; the first stays where it is
/// Pieces   Every scan is cut into voxels; the points of a voxel give a place, with its neighbours
///          a normal (turned to the scanner) and a scatter. Where two scans have pieces
///          near each other that face the same way, they are a pair.
/// Poses    All pairs at once: the sum over all scans' pairs of squared distances along the mean
///          of both normals (symmetric point to plane: Rusinkiewicz 2019,
///          doi:10.1145/3306346.3323037), with Tukey's biweight at 4.685 robust standard deviations
///          of each pair of scans, by Gauss-Newton, from coarse voxels to fine. This is the
///          minimum of the pose graph whose edges are the pairwise registrations with their
///          full information (Pulli 1999, doi:10.1109/IM.1999.805346), so loops close by
///          themselves; how well each pair alone would have agreed is stated.
/// Stated   6 x 6 covariance of each pose against the first scan's (cluster-robust over blocks of a
///          sixteenth of the part, derivative of the scores); per pair: overlap, robust
///          noise, the step that the pair alone would take (loop misfit) and its chi squared.
/// Accuracy Scans of 300 mm with 0.1 mm of noise and pieces of 2.6 mm come together within 0.005
/// mm,
///          and their errors are those of the stated covariance (mean square of normalised errors
///          1.05 over 12 pairs of scans of rough ground). The scans' voxels are turned against each
///          other, so that pieces lie beside each other in every direction: parallel lattices
///          made the errors 3.6 times the stated ones.
/// Cost     Four scans of 5 M points: 26 s of CPU (tests/bench/scan_merge_bench).
/// Colour   One gain per scan and channel: robust mean log ratio (Huber 1964) of the colours of
///          common pieces, least squares over all pairs, geometric mean 1.
/// Refuses  scans that overlap with none, poses that the shapes do not determine, iterations that
///          do not come to rest.

#include <array>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kMergeOptions{"SCAN_MERGE_OPTIONS"};
inline constexpr ErrorCode kMergeApart{"SCAN_MERGE_APART"};
inline constexpr ErrorCode kMergeFree{"SCAN_MERGE_FREE"};
inline constexpr ErrorCode kMergeNotConverged{"SCAN_MERGE_NOT_CONVERGED"};

struct MergeOptions {
  double voxel_mm = 0.0;        ///< finest pieces; 0: eight points each in the densest scan
  double capture_mm = 0.0;      ///< scans may be this far off; 0: a twentieth of their extent
  double least_overlap = 0.05;  ///< share of a scan's pieces that makes a pair
  int most_rounds = 60;         ///< of each size of pieces
  bool poses = true;            ///< false: only colours and statistics
  bool balance_colour = true;
};

struct MergePair {
  std::size_t first = 0, second = 0;
  std::size_t pieces = 0;
  double overlap = 0.0;    ///< share of the smaller scan's pieces
  double noise_mm = 0.0;   ///< robust standard deviation of a point between the scans
  double misfit_mm = 0.0;  ///< what this pair alone would still move the overlap by
  double misfit_rad = 0.0;
  double chi_squared = 0.0;  ///< of that step, 6 degrees of freedom
};

struct MergedPose {
  RigidTransform correction;            ///< new from old place, model frame
  std::array<double, 36> covariance{};  ///< translation of `centre_mm` (mm), rotation about it
  Vec3 centre_mm;
  std::array<double, 3> gain{1.0, 1.0, 1.0};  ///< of red, green, blue
  double overlap = 0.0;                       ///< share of pieces that another scan sees as well
};

struct Merge {
  std::vector<MergedPose> scans;
  std::vector<MergePair> pairs;
  double voxel_mm = 0.0;
  int iterations = 0;
};

/// The scans' poses and gains; the clouds are not changed.
/// @return the merge, or SCAN_MERGE_OPTIONS (fewer than two scans, an option out of range),
///   SCAN_MERGE_APART (names the scans that overlap with none of the others), SCAN_MERGE_FREE,
///   SCAN_MERGE_NOT_CONVERGED, CORE_CANCELLED
[[nodiscard]] Result<Merge> merge_scans(std::span<const Cloud> scans,
                                        const MergeOptions& options = {},
                                        const RunContext& run = {});

}  // namespace maquette::scan
