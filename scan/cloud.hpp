// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cloud.hpp
/// Point clouds in memory. Files too large for it are read and written in batches:
/// scan/cloud_stream.hpp, which also says what each format holds.

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kCloudFormat{"SCAN_CLOUD_FORMAT"};
inline constexpr ErrorCode kCloudChecksum{"SCAN_CLOUD_CHECKSUM"};
inline constexpr ErrorCode kCloudEmpty{"SCAN_CLOUD_EMPTY"};
inline constexpr ErrorCode kCloudNotFinite{"SCAN_CLOUD_NOT_FINITE"};
inline constexpr ErrorCode kCloudCannotHold{"SCAN_CLOUD_CANNOT_HOLD"};

/// 0 is dark, 65535 full. Eight bits of a file are v * 257, so that 255 is full and nothing
/// is lost on the way back.
struct Colour {
  std::uint16_t red = 0, green = 0, blue = 0;
  friend constexpr bool operator==(const Colour&, const Colour&) = default;
};

/// Place in a station's grid; both count from 0.
struct GridIndex {
  std::uint32_t row = 0, column = 0;
  friend constexpr bool operator==(const GridIndex&, const GridIndex&) = default;
};

/// What a station's points carry beside their coordinates.
struct CloudFields {
  bool intensity = false, colour = false, normals = false, grid = false;
  bool time = false;        ///< seconds since the station's start, or GPS time (LAS)
  bool returns = false;     ///< which echo of how many
  bool scan_angle = false;  ///< of the mirror, from airborne instruments
  bool statistics = false;  ///< each point stands for several: how many, and their spread
  bool flags = false;       ///< some points lack something: PointFlag in cloud_stream.hpp
  friend constexpr bool operator==(const CloudFields&, const CloudFields&) = default;
};

/// One set-up of a scanner.
struct ScanStation {
  std::string name, guid, description;
  std::string sensor_vendor, sensor_model, sensor_serial;
  RigidTransform model_from_station;    ///< identity where the file has none
  std::optional<Vec3> position_mm;      ///< of the scanner, in the model frame
  std::uint32_t rows = 0, columns = 0;  ///< of its grid; 0 if there is none or it is not stated
  std::uint64_t points =
      0;  ///< records of the file, also those without position; in a Cloud: its own
  CloudFields fields;
  int colour_bits = 8;                               ///< that are worth keeping: 8 or 16
  std::array<double, 2> intensity_limits{0.0, 1.0};  ///< dark and full, as stated by the file
  double start_gps_s = 0.0;  ///< GPS time of the first point, 0 if not known
  friend bool operator==(const ScanStation&, const ScanStation&) = default;
};

struct Cloud {
  std::vector<Vec3> points_mm;
  std::vector<float> intensity;    ///< empty or one per point
  std::vector<Vec3> normals;       ///< empty or one per point; unit, or zero where unknown
  std::optional<Vec3> station_mm;  ///< scanner position in the cloud's frame, if there is one
  std::vector<Colour> colours;     ///< empty or one per point
  std::vector<GridIndex> grid;     ///< empty or one per point: its place in its station's grid
  /// Empty, or of thinned points: how many each stands for, and their rms distance from it.
  std::vector<std::uint32_t> counts;
  std::vector<float> spread_mm;
  /// Empty, or all stations in the order of their points, `points` of each: the points of
  /// the first station come first.
  std::vector<ScanStation> stations;
  std::uint64_t passed_over = 0;  ///< points of its file beside the share that was asked for
};

/// Coordinates beyond this are no model (a thousand kilometres) and are refused as not
/// finite: their squares and products would leave double precision.
inline constexpr double kLargestCoordinateMm = 1e9;

/// By extension (case does not matter): .e57 .ptx .pts .pcd .las .ply .xyz .txt .asc .csv.
/// All stations are brought into one frame by their poses, in the order of the file. Points
/// without position are left out. A part that only some stations have (intensity, colour,
/// normals, grid, statistics) is left out too. Units as in scan/cloud_stream.hpp.
/// @return the cloud, or
///   CORE_FILE_NOT_FOUND, CORE_FILE_NOT_READABLE
///   SCAN_CLOUD_FORMAT      line or byte offset and what was expected; a header that
///                          promises more than the file holds is refused before memory
///                          is taken
///   SCAN_CLOUD_CHECKSUM    a page of an E57 file is damaged: page and byte offset
///   SCAN_CLOUD_EMPTY       no points
///   SCAN_CLOUD_NOT_FINITE  a coordinate is not a number or absurd: index of the first
///   CORE_CANCELLED
/// @param most_points  of a file with more, an even random share stays (each point by its number,
///                     so the same every time): about that many
[[nodiscard]] Result<Cloud> read_cloud(const std::filesystem::path& path,
                                       const RunContext& run = {},
                                       std::uint64_t most_points = UINT64_MAX);
/// By extension, with the options' defaults of scan/cloud_stream.hpp. PLY: double coordinates
/// and normals, float intensity; reading gives the same bits. E57 and PTX keep every
/// station with its pose; the other formats hold one frame, and a scanner position only if
/// there is one station.
/// @return SCAN_CLOUD_FORMAT for an unknown extension, SCAN_CLOUD_CANNOT_HOLD,
///   CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL
[[nodiscard]] Result<void> write_cloud(const Cloud& cloud, const std::filesystem::path& path);

}  // namespace maquette::scan
