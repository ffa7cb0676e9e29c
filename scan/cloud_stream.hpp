// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cloud_stream.hpp
/// Clouds of any size, batch by batch, in constant memory.
///
///   MAQUETTE_TRY(const auto reader, open_cloud("scan.e57"));
///   MAQUETTE_TRY(const auto writer, create_cloud("scan.ply"));
///   PointBatch batch;
///   while (true) {
///     MAQUETTE_TRY(const bool more, reader->next(batch));
///     if (!more) break;
///     if (batch.begins_station)
///       MAQUETTE_TRY_VOID(writer->begin_station(reader->stations()[batch.station]));
///     MAQUETTE_TRY_VOID(writer->write(batch));
///   }
///   MAQUETTE_TRY_VOID(writer->finish());
///
/// Frame   A batch is in the frame of its station; the station's model_from_station brings
///         it to the model frame. Formats without poses have the identity. Scan angles are
///         those of points_mm: azimuth atan2(y, x), elevation atan2(z, hypot(x, y)).
/// Order   As in the file, always.
/// Units   Batches are in millimetres. On disk:
///
///   format      unit           stations            what is held beside x y z
///   E57         metres (said)  any, poses          all but scan angle and statistics; colour 8 or
///                                                  16 bit
///   PTX         metres         any, poses          grid (every cell, column by column),
///                                                  intensity 0 to 1, colour 8 bit
///   PTS         metres         any, without poses  intensity -2048 to 2047, colour 8 bit
///   PCD         millimetres    one, position       all but flags, scan angle and statistics;
///                                                  colour 8 bit;
///                                                  read: NaN in a grid is kNoPosition
///   LAS         metres         one, no position    intensity and colour 16 bit, time, returns,
///                                                  scan angle
///   PLY         millimetres    one, position       all but flags; colour 8 or 16 bit
///   XYZ, CSV    millimetres    one, position       all but flags; colour 8 bit
///
///         Only E57 defines its unit. The others follow their makers' habit or, for PLY, PCD,
///         XYZ and CSV, which have none, this project's; `unit_mm` says otherwise.
/// Memory  One batch and a few megabytes, but binary_compressed PCD is held as a whole: the
///         format stores it field by field. It holds 4 GiB; writing takes up to three times
///         its size.
/// Safety  Files are taken as hostile: no count of a header decides how much memory is
///         taken or how long work goes on before the file's size has been compared with it.

#include <functional>
#include <memory>

#include "scan/cloud.hpp"

namespace maquette::scan {

/// What a point lacks; bits of PointBatch::flags.
enum PointFlag : std::uint8_t {
  kDirectionOnly = 1,  ///< no range: points_mm is a unit vector from the station
  kNoPosition = 2,     ///< nothing came back: points_mm is zero
  kNoIntensity = 4,
  kNoColour = 8,
  kNoTime = 16,
};

/// Consecutive points of one station. Each array is empty or as long as points_mm, as the
/// station's `fields` say.
struct PointBatch {
  std::size_t station = 0;      ///< index into CloudReader::stations()
  bool begins_station = false;  ///< its first points (a station without points has one empty batch)
  std::vector<Vec3> points_mm;  ///< in the station's frame
  std::vector<float> intensity;
  std::vector<Colour> colours;
  std::vector<Vec3> normals;  ///< station's frame; unit, or zero where unknown
  std::vector<GridIndex> grid;
  std::vector<double> time_s;
  std::vector<std::uint8_t> return_index, return_count;  ///< index counts from 0
  std::vector<float> scan_angle_rad;
  std::vector<std::uint32_t> counts;  ///< of thinned points: how many each stands for
  std::vector<float> spread_mm;       ///< their rms distance from it; with counts
  std::vector<std::uint8_t> flags;    ///< PointFlag; empty if every point has everything
  [[nodiscard]] std::size_t size() const { return points_mm.size(); }
  [[nodiscard]] bool has_position(std::size_t i) const {
    return flags.empty() || (flags[i] & (kDirectionOnly | kNoPosition)) == 0;
  }
  void clear();  ///< keeps the memory
};

struct CloudReadOptions {
  std::optional<double> unit_mm;      ///< length of the file's unit, against the table above
  std::size_t batch_points = 65'536;  ///< at most this many per batch
};

/// A picture in an E57 file; named, not read.
struct CloudImage {
  std::string name, kind;    ///< kind: pinhole, spherical, cylindrical, visual
  std::string station_guid;  ///< of the station it belongs to, may be empty
  std::uint64_t bytes = 0;
};

class CloudReader {
 public:
  virtual ~CloudReader() = default;
  /// "E57", "PTX", ...
  [[nodiscard]] virtual std::string_view format() const = 0;
  /// PTX and PTS: those met so far; the others: all, from the beginning.
  [[nodiscard]] virtual const std::vector<ScanStation>& stations() const = 0;
  [[nodiscard]] virtual const std::vector<CloudImage>& images() const = 0;
  /// Replaces `batch` by the next points. @return false at the end, else errors as read_cloud
  [[nodiscard]] virtual Result<bool> next(PointBatch& batch) = 0;
  /// Share of the file that has been read, 0 to 1.
  [[nodiscard]] virtual double progress() const = 0;
};

/// @return SCAN_CLOUD_FORMAT for an unknown extension; CORE_FILE_NOT_FOUND,
///   CORE_FILE_NOT_READABLE; what is wrong with the file's header
[[nodiscard]] Result<std::unique_ptr<CloudReader>> open_cloud(const std::filesystem::path& path,
                                                              const CloudReadOptions& options = {});

/// Opens one and the same cloud at its beginning, as often as it is asked.
using OpenCloud = std::function<Result<std::unique_ptr<CloudReader>>()>;

struct CloudWriteOptions {
  std::optional<double> unit_mm;  ///< length of the file's unit, against the table above
  /// E57: 0 writes doubles; else coordinates are rounded to this step and packed in 32 bits
  /// (12 instead of 24 bytes per point), within 2^31 steps of the station.
  double e57_step_mm = 0.0;
  double las_step_mm = 0.001;  ///< LAS: coordinates are whole steps, within 2^31 of zero
  int las_minor = 2;           ///< LAS 1.2, 1.3 or 1.4; only 1.4 holds more than 2^32 - 1 points
  enum class Pcd { binary, ascii, binary_compressed } pcd = Pcd::binary;
};

class CloudWriter {
 public:
  virtual ~CloudWriter() = default;
  /// Does the format store poses? If not, points are brought to the model frame.
  [[nodiscard]] virtual bool keeps_poses() const = 0;
  /// Name, pose, fields and limits of the points that follow. `points` may be 0 for unknown.
  /// SCAN_CLOUD_CANNOT_HOLD if the format has one record layout and this station another.
  [[nodiscard]] virtual Result<void> begin_station(const ScanStation& station) = 0;
  /// What the format does not hold is left out; so are points without position where it cannot
  /// say so. SCAN_CLOUD_CANNOT_HOLD if a value does not fit, with the value and what to do.
  /// @pre begin_station; the batch has exactly the arrays of the station's `fields`
  [[nodiscard]] virtual Result<void> write(const PointBatch& batch) = 0;
  /// Completes headers and gives the file its name. Without it nothing remains.
  [[nodiscard]] virtual Result<void> finish() = 0;
};

/// Accuracy: what is written is read again to
///   PLY, PCD, XYZ, CSV   the bit (millimetres)
///   E57, PTX, PTS        2 ulp per coordinate, the two of conversion to metres and back
///   E57 with a step      half a step;  LAS half a step (and an ulp of its offset)
///   normals              unit length costs an ulp or two; float in E57 and PCD
/// Intensity is float; where the format has fixed limits, the station's limits are mapped onto
/// them: PTX to float, LAS and PTS to whole numbers. If a station's position is not the origin
/// of its pose, E57 (where it must be) gets the points moved to it.
[[nodiscard]] Result<std::unique_ptr<CloudWriter>> create_cloud(
    const std::filesystem::path& path, const CloudWriteOptions& options = {});

/// A look at a whole file in constant memory.
struct CloudInfo {
  std::string format;
  std::vector<ScanStation> stations;  ///< `points`: records met, also where the file states none
  std::vector<CloudImage> images;
  std::uint64_t points = 0;  ///< with position
  std::uint64_t without_position = 0;
  Box3 bounds_mm;  ///< in the model frame
};
[[nodiscard]] Result<CloudInfo> inspect_cloud(const std::filesystem::path& path,
                                              const CloudReadOptions& options = {},
                                              const RunContext& run = {});

}  // namespace maquette::scan
