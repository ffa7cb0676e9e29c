// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cloud.hpp
/// Point clouds and their files.

#include <filesystem>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kCloudFormat{"SCAN_CLOUD_FORMAT"};
inline constexpr ErrorCode kCloudEmpty{"SCAN_CLOUD_EMPTY"};
inline constexpr ErrorCode kCloudNotFinite{"SCAN_CLOUD_NOT_FINITE"};

struct Cloud {
  std::vector<Vec3> points_mm;
  std::vector<float> intensity;    ///< empty or one per point
  std::vector<Vec3> normals;       ///< empty or one per point; unit, or zero where unknown
  std::optional<Vec3> station_mm;  ///< scanner position in the cloud's frame
};

/// Coordinates beyond this are no model (a thousand kilometres) and are refused as not
/// finite: their squares and products would leave double precision.
inline constexpr double kLargestCoordinateMm = 1e9;

/// By extension (case does not matter); units are millimetres.
///   .ply              ascii and both binary kinds, all scalar types, properties in any
///                     order, other properties, lists and elements are stepped over:
///                     x y z [intensity | scalar_intensity] [nx ny nz]
///   .xyz .txt .asc    numbers separated by blanks or commas: x y z, x y z intensity,
///                     x y z nx ny nz or x y z intensity nx ny nz, or a first line of names
///   .csv              comma or semicolon; a first line of names (x or x_mm, ...), other
///                     columns are ignored; without names as above
/// The station is a comment `scanner_position_mm x y z` (PLY `comment`, text `#`).
/// Normals are brought to unit length.
/// @return the cloud, or
///   CORE_FILE_NOT_FOUND, CORE_FILE_NOT_READABLE, CORE_FILE_TOO_LARGE (beyond 4 GiB)
///   SCAN_CLOUD_FORMAT      line or byte offset and what was expected; a header that
///                          promises more than the file holds is refused before memory
///                          is taken
///   SCAN_CLOUD_EMPTY       no points
///   SCAN_CLOUD_NOT_FINITE  a coordinate is not a number or absurd: index of the first
///   CORE_CANCELLED
[[nodiscard]] Result<Cloud> read_cloud(const std::filesystem::path& path,
                                       const RunContext& run = {});
/// Binary little-endian PLY; double coordinates and normals, float intensity; the
/// station as a comment that read_cloud understands. Reading gives the same bits.
[[nodiscard]] Result<void> write_cloud(const Cloud& cloud, const std::filesystem::path& path);

}  // namespace maquette::scan
