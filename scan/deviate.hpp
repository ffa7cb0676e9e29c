// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file deviate.hpp
/// Scan against design: signed deviation with its statistics.
///
/// Room    scan:  cloud -> register -> [deviate] -> report
/// Takes   design ModelField (stones included where they are glued on), cloud(s), mm
/// Gives   signed deviation per point (positive: measured above the design, along
///         the design's normal), map on the design's nodes, statistics
///
/// What a best-fit registration hides: a constant offset of the whole surface (a
/// coating, a wrong tool length) and a tilt go into the pose, and the deviation does
/// not show them. Compare without registration, or on surfaces that tie the pose
/// (walls, reference marks), to see those.

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud.hpp"
#include "scan/mesh_distance.hpp"
#include "scan/register.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kReach{"SCAN_REACH"};

struct DeviationStatistics {
  std::uint64_t points = 0;    ///< that fall onto the design
  std::uint64_t off_part = 0;  ///< that do not, or farther than `reach`
  double mean_mm = 0.0, rms_mm = 0.0, sigma_mm = 0.0, median_mm = 0.0, nmad_mm = 0.0;
  double p05_mm = 0.0, p95_mm = 0.0;  ///< of the signed deviation
  double abs_p95_mm = 0.0, min_mm = 0.0, max_mm = 0.0;
  double coverage = 0.0;  ///< share of the design's nodes with a point within a spacing
};

struct Deviation {
  std::vector<float> per_point_mm;  ///< NaN: off the part
  Grid<float> map_mm;               ///< mean per node of the design; NaN: none
  DeviationStatistics statistics;
  std::vector<std::uint64_t> histogram;  ///< 101 bins over +- histogram_limit; what lies
                                         ///< beyond counts in the outermost bins
  double histogram_limit_mm = 0.0;       ///< 1, 2 or 5 times a power of ten
};

/// Exact distance to the triangulated design (surface_distance.hpp), each point for
/// itself; a point beside the outline, over a void, nearer to one of the part's walls
/// than to its surface, or farther than `reach` is off the part.
/// Memory beside cloud and design: 13 bytes per node, 8 per point.
/// @param reach  points farther from the design count as off the part; 0 < reach <= 1 m
/// @return the deviation, or
///   SCAN_CLOUD_EMPTY, SCAN_REACH (out of range)
///   SCAN_TOO_FEW_POINTS  no point at all is on the part
///   CORE_CANCELLED
[[nodiscard]] Result<Deviation> deviate(const Cloud& cloud, const RigidTransform& model_from_scan,
                                        const heightmap::ModelField& design,
                                        Millimetres reach = Millimetres{5.0},
                                        const RunContext& run = {});

struct MeshDeviation : Deviation {
  std::vector<float> per_vertex_mm;  ///< mean of the points nearest to each vertex; NaN: none
};

/// The same for a part given as triangles: distance to the nearest of them, signed
/// (mesh_distance.hpp), all sides of the part. A point whose nearest place is the border of an
/// open mesh is off the part. Coverage is a share of the mesh's area: of triangles by the share
/// of their corners that have a point on a triangle round them. The map is of the points within
/// reach of `top`.
/// @param top  upper_envelope() of the mesh
[[nodiscard]] Result<MeshDeviation> deviate(const Cloud& cloud,
                                            const RigidTransform& model_from_scan,
                                            const MeshDistance& mesh,
                                            const heightmap::ModelField& top,
                                            Millimetres reach = Millimetres{5.0},
                                            const RunContext& run = {});

/// summary.json: statistics and registration, flat keys (mean_mm, rms_mm, p95_mm, ...); with
/// one also `registration` with what it hides.
[[nodiscard]] std::string to_json(const DeviationStatistics& statistics,
                                  const Registration* registration);

/// The cloud in the model frame with its deviation as scalar field `deviation_mm` (NaN:
/// off the part), binary PLY.
[[nodiscard]] Result<void> write_deviation_ply(const Cloud& cloud,
                                               const RigidTransform& model_from_scan,
                                               const Deviation& deviation,
                                               const std::filesystem::path& path);

/// The mesh with `deviation_mm` per vertex, binary PLY.
[[nodiscard]] Result<void> write_deviation_mesh(const TriMesh& mesh, const MeshDeviation& deviation,
                                                const std::filesystem::path& path);

}  // namespace maquette::scan
