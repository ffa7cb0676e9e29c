// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file measured_part.hpp
/// The scans of a case, brought onto the part.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "scan/cloud.hpp"
#include "scan/datums.hpp"
#include "scan/find_spheres.hpp"
#include "scan/joint_pose.hpp"
#include "scan/overhangs.hpp"
#include "scan/refit.hpp"
#include "scan/viewpoint.hpp"
#include "tools/corrections_file.hpp"
#include "tools/nominal_part.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {

/// Of all scans together, some 4 GB of what is known of each point. Of larger files an even share
/// is compared.
inline constexpr std::uint64_t kMostPoints = 30'000'000;

/// What is reported of a scan.
struct ScanFigures {
  std::string name;
  scan::Registration best;  ///< fit to the part
  std::uint64_t passed_over = 0, mixed = 0, used = 0;
  std::optional<scan::DatumRegistration> on_datums;
  scan::Absorbed absorbed;  ///< by the best fit, where there are datums
  std::optional<scan::SphereMatch> spheres;
  std::size_t spheres_found = 0;
};

/// What the width of beams did to ranges.
struct BeamFigures {
  double rms_mm = 0.0, largest_mm = 0.0;
  std::size_t at_edges = 0;  ///< points given up
};

/// Points that the edges of stones have mixed, in the model frame. They lie on no surface, so they
/// are compared with none; of stones they say where those edges are.
struct MixedPoints {
  std::vector<Vec3> points_mm;
  std::vector<scan::Viewpoint> views;
  std::vector<std::size_t> scan_of_view;
};

/// All scans in the model frame, and what is known of each point beside its place.
struct MeasuredPart {
  scan::Cloud cloud;
  std::vector<float> range_mm, incidence_deg, slope_deg;
  std::vector<scan::ScanPose> scans;
  std::vector<scan::Viewpoint> views;
  MixedPoints mixed;  ///< not in the cloud
  /// Where the part really is in the frame of the datums, by each scan.
  struct Where {
    RigidTransform actual_from_planned;
    double sigma_translation_mm, sigma_rotation_rad, points;
  };
  std::vector<Where> part;
  std::size_t at_rim = 0;             ///< left out: part of their beam passed the rim
  std::uint64_t passed_over = 0;      ///< of files larger than what is compared
  std::size_t overhung = 0;           ///< left out: heights cannot judge them (scan/overhangs.hpp)
  std::vector<scan::SeenAt> seen_at;  ///< of points near stones
  void make_room(std::size_t points) {
    cloud.points_mm.reserve(points);
    for (std::vector<float>* of : {&cloud.intensity, &range_mm, &incidence_deg, &slope_deg})
      of->reserve(points);
  }
  std::vector<ScanFigures> figures;  ///< of each scan
};

/// Reads a scan, finds its pose and adds its points; with datums the pose is theirs.
/// @return errors of reading and registration
[[nodiscard]] Result<void> add_scan(MeasuredPart& all, const CaseScan& entry, const Case& input,
                                    const NominalPart& nominal, const RunContext& run);

/// Which scan each viewpoint belongs to.
[[nodiscard]] std::vector<std::size_t> scans_of_views(const MeasuredPart& all);

/// Best fits once more, without what was found (scan/refit.hpp): points, viewpoints, poses and
/// their covariances follow.
/// @pre the poses are best fits to `surface`, not those of datums
/// @return the step of each scan; CORE_CANCELLED or what `search` returns
[[nodiscard]] Result<std::vector<RigidTransform>> fit_without_findings(
    MeasuredPart& all, const heightmap::ModelField& surface, const scan::Significance& found,
    const scan::Search& search, const RunContext& run);

/// Best fits once more, to points whose beams have been taken out; else as fit_without_findings().
[[nodiscard]] Result<std::vector<RigidTransform>> fit_without_beams(
    MeasuredPart& all, const heightmap::ModelField& surface, const RunContext& run);

/// Leaves out what heights cannot judge beside planned stones (scan/overhangs.hpp).
[[nodiscard]] Result<void> leave_out_overhung(MeasuredPart& all, const NominalPart& nominal,
                                              const Case& input, double noise_mm);
/// Where each point counts in means over places: where it lies, near stones where it was looked at.
[[nodiscard]] std::vector<Vec3> places_of(const MeasuredPart& all);

/// Every point as a ray in the middle of its beam would have measured it on what is expected; what
/// lies beside an edge is left out.
/// @return how far points were moved, nothing where all were rays; SCAN_TOO_FEW_POINTS
[[nodiscard]] Result<std::optional<BeamFigures>> take_out_beams(MeasuredPart& all,
                                                                const NominalPart& nominal,
                                                                double noise_mm,
                                                                const RunContext& run);

/// Where the part lies in the frame of the datums: the scans' mean by points, turned about the
/// part's middle, for rotations are small.
/// @pre there were datums
[[nodiscard]] Corrections corrections_of(const MeasuredPart& all,
                                         const heightmap::ModelField& design);

}  // namespace maquette::tools
