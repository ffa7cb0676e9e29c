// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file clean.hpp
/// Takes out of a scan what is no surface, thins it, and turns normals towards the scanner.
///
/// Mixed     A beam that meets two surfaces gives a range between them. A point is mixed if, along
///           one of the four lines through it in its station's directions, the surfaces on either
///           side lie at different ranges there (by least_jump_mm) and it lies between them,
///           farther from both than four standard deviations. Each side is the plane of up
///           to twelve points that are at least a beam's diameter away, so that their own beams are
///           clear of an edge within this point's. What Tang, Akinci and Huber (2009,
///           doi:10.1016/j.autcon.2009.07.001) ask of neighbours' ranges, here of their planes,
///           for a steep slope is no edge. Needs the scanner's position; a station's grid is used
///           where it has one. Points that wrap to before or behind both surfaces (a jump of more
///           than half the finest wavelength) are left to the next check.
/// Isolated  Fewer than least_neighbours points in the 27 voxels around a point's own. So every
///           point with fewer points than that within 2 sqrt(3) voxels is taken out, and none
///           with as many within one voxel. Mixed points and those off the part do not count.
/// Off part  Outside a box of the model frame.
/// Thinning  One point a voxel: the mean of its points, how many they are, their rms distance from
///           it, mean colour and intensity (PLY, XYZ and CSV hold the statistics).
/// Normals   That of least scatter of the points of the 27 voxels that stay, turned to where the
/// voxel's
///           points were seen from; zero where there is no plane or no scanner.
/// Accuracy  The Z+F 5006h at 1.4 m, noise 0.24 mm, stones of 20 to 60 mm on rough ground, 0.4 to
///           1.8 mm between points: of the points that float five standard deviations from every
///           surface in their beam 96 to 99 % are taken out with the station's grid, 97 %
///           without; 93 to 97 % of what is taken out does meet two surfaces, the rest is seen
///           at the grazing rims of stones and on bends narrower than two beams (0.4 % of very
///           rough ground, nothing of a plain slope). A surface that shows less than some four
///           beams wide is not known well enough to tell: of points in narrow gaps between stones a
///           quarter stays. Means of voxels to 1e-6 of their side.
/// Memory    Files are read four times, five with normals. Four to sixteen bytes a point for the
///           ranges until points are judged, one for the verdict, some 10 bytes a voxel of the
///           isolated check, 90 one of thinning or normals that holds points (noise spreads points
///           over more voxels than the surface has), and 25 a normal that is kept. More voxels than
///           voxels_at_once are gathered in runs of slices across x that hold so many, each of
///           which goes over the file once; thinned points come in this order. So 200 M points
///           take less than 8 GiB whatever they are thinned to, or not.

#include <filesystem>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"
#include "scan/cloud_stream.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kCleanOptions{"SCAN_CLEAN_OPTIONS"};

struct CleanOptions {
  bool mixed = true;
  double beam_diameter_mm = 3.0;       ///< at the scanner, 1/e^2
  double beam_divergence_mrad = 0.22;  ///< full angle
  double least_jump_mm = 0.0;          ///< between two surfaces; 0: two beam diameters
  std::uint32_t least_neighbours = 6;  ///< itself included; 0: isolated points stay
  double voxel_mm = 0.0;               ///< of that check and of normals; 0: eight points each
  std::optional<Box3> part_mm;         ///< what is outside is off the part
  double thin_mm = 0.0;                ///< side of the voxels; 0: every point stays
  bool normals = false;                ///< write them; thinned points always have them
  std::uint64_t voxels_at_once = 40'000'000;  ///< of thinning or normals
};

struct CleanFigures {
  std::uint64_t points = 0;            ///< with position
  std::uint64_t without_position = 0;  ///< left out
  std::uint64_t mixed = 0, isolated = 0, off_part = 0;
  std::uint64_t kept = 0;
  std::uint64_t written = 0;    ///< kept, or voxels
  std::size_t not_judged = 0;   ///< stations without a scanner's position: mixed points stay
  double voxel_mm = 0.0;        ///< of isolated points
  double range_noise_mm = 0.0;  ///< largest of the stations
};

/// Stations stay, in the order of the file, but for thinned clouds, which are one.
/// @return what was taken out, or SCAN_CLEAN_OPTIONS (which value, its range), errors of reading
///   and writing, SCAN_CLOUD_EMPTY if nothing is left, CORE_CANCELLED
[[nodiscard]] Result<CleanFigures> clean_cloud(const std::filesystem::path& from,
                                               const std::filesystem::path& to,
                                               const CleanOptions& options = {},
                                               const RunContext& run = {});

/// The same of what `from` opens, four or five times.
[[nodiscard]] Result<CleanFigures> clean_cloud(const OpenCloud& from,
                                               const std::filesystem::path& to,
                                               const CleanOptions& options = {},
                                               const RunContext& run = {});

/// The same in memory. Thinned: normals, counts and spread_mm are filled.
/// @param mixed  takes the mixed points, in their order, with their stations; null: they are lost
[[nodiscard]] Result<CleanFigures> clean_cloud(Cloud& cloud, const CleanOptions& options = {},
                                               const RunContext& run = {}, Cloud* mixed = nullptr);

}  // namespace maquette::scan
