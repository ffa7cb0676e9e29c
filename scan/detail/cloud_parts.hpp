// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cloud_parts.hpp
/// What the readers and writers of cloud files share.

#include <array>
#include <charconv>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/files.hpp"
#include "core/result.hpp"
#include "scan/cloud_stream.hpp"
#include "scan/detail/byte_source.hpp"

namespace maquette::scan::detail {

/// What a column or property of a cloud file can mean to us.
enum Channel : std::size_t {
  kX,
  kY,
  kZ,
  kIntensity,
  kNx,
  kNy,
  kNz,
  kRed,
  kGreen,
  kBlue,
  kRow,
  kColumn,
  kTime,
  kReturnIndex,
  kReturnCount,
  kScanAngle,
  kCount,
  kSpread,
  kChannels
};
inline constexpr std::size_t kIgnored = kChannels;
/// One point, as the file states it; the last place takes what is ignored.
using Row = std::array<double, kChannels + 1>;

/// By name as files write it: "x", "X_mm", "scalar_intensity", "normal_x", "red", ...;
/// kIgnored if none.
[[nodiscard]] std::size_t channel_by_name(std::string_view name);

/// Which channels a file has and how its numbers become a batch's.
struct RecordPlan {
  std::array<bool, kChannels> present{};
  double unit_mm = 1.0;
  double colour_scale = 257.0, colour_offset = 0.0;  ///< full 16 bit = scale * (value - offset)
  std::uint32_t rows = 0, columns = 0;               ///< bounds of the grid; 0: none known

  /// @return false if the channel was there already
  [[nodiscard]] bool declare(std::size_t channel);
  [[nodiscard]] bool has(std::size_t channel) const { return present[channel]; }
  [[nodiscard]] bool has_position() const { return has(kX) && has(kY) && has(kZ); }
  [[nodiscard]] bool has_normals() const { return has(kNx) && has(kNy) && has(kNz); }
  [[nodiscard]] bool has_colour() const { return has(kRed) && has(kGreen) && has(kBlue); }
  [[nodiscard]] bool has_grid() const { return has(kRow) && has(kColumn); }
  [[nodiscard]] CloudFields fields() const;
};

/// Appends one point to a batch. With kNoPosition or kDirectionOnly in `flags`, x y z are not
/// checked or converted (kNoPosition: zero). `flags` is kept only if `with_flags`.
/// @param index  of the point in the file, for messages
/// @return SCAN_CLOUD_NOT_FINITE; SCAN_CLOUD_FORMAT if it lies outside its grid
[[nodiscard]] Result<void> append(const RecordPlan& plan, const Row& row, std::uint64_t index,
                                  const std::string& file, PointBatch& batch,
                                  std::uint8_t flags = 0, bool with_flags = false);

/// A whole token as a number (a leading + and nan, inf are understood); nothing if it
/// is not one.
template <class T>
[[nodiscard]] std::optional<T> parse_number(std::string_view token) {
  if (!token.empty() && token.front() == '+') token.remove_prefix(1);
  T value{};
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (error == std::errc::result_out_of_range || end != token.data() + token.size() ||
      error != std::errc())
    return std::nullopt;
  return value;
}

/// Takes the next token (no blanks inside) off the front of `text`; empty at the end.
[[nodiscard]] std::string_view next_token(std::string_view& text,
                                          std::string_view separators = " \t\r");

/// Reads "scanner_position_mm x y z"; nothing if the comment says something else.
[[nodiscard]] Result<std::optional<Vec3>> station_comment(std::string_view comment,
                                                          std::string_view where);
/// The comment that station_comment reads.
[[nodiscard]] std::string scanner_position_text(Vec3 position_mm);

/// A token as an error message may show it: printable, not long.
[[nodiscard]] std::string shown(std::string_view token);

/// The rotation whose columns are the axes x, y, z; nothing if they are not orthonormal to
/// within 1e-4 or are left-handed.
[[nodiscard]] std::optional<Quaternion> rotation_from_axes(Vec3 x, Vec3 y, Vec3 z);

/// Common to all readers.
class BasicReader : public CloudReader {
 public:
  BasicReader(ByteSource source, const CloudReadOptions& options, double default_unit_mm)
      : source_(std::move(source)),
        batch_points_(std::max<std::size_t>(1, options.batch_points)),
        unit_mm_(options.unit_mm.value_or(default_unit_mm)) {}
  [[nodiscard]] const std::vector<ScanStation>& stations() const final { return stations_; }
  [[nodiscard]] const std::vector<CloudImage>& images() const final { return images_; }
  [[nodiscard]] double progress() const final { return source_.progress(); }

 protected:
  [[nodiscard]] const std::string& file() const { return source_.name(); }
  /// Clears the batch for points of `station`.
  void start(PointBatch& batch, std::size_t station, bool begins) const;

  ByteSource source_;
  std::vector<ScanStation> stations_;
  std::vector<CloudImage> images_;
  std::size_t batch_points_;
  double unit_mm_;
  std::uint64_t points_read_ = 0;  ///< of the file, for messages
};

/// Keeps the points whose index is listed, ascending.
void pick(PointBatch& batch, const std::vector<std::uint32_t>& wanted);

/// Where a station's points were seen from, model frame: its position, or else the origin of its
/// pose, if it has one.
[[nodiscard]] std::optional<Vec3> scanner_of(const ScanStation& station);

/// Reads a cloud in memory, which must outlive the reader, station by station, each in its frame.
[[nodiscard]] std::unique_ptr<CloudReader> reader_of(const Cloud& cloud);

using ReaderResult = Result<std::unique_ptr<CloudReader>>;
[[nodiscard]] ReaderResult open_e57(ByteSource source, const CloudReadOptions& options);
[[nodiscard]] ReaderResult open_las(ByteSource source, const CloudReadOptions& options);
[[nodiscard]] ReaderResult open_pcd(ByteSource source, const CloudReadOptions& options);
[[nodiscard]] ReaderResult open_pts(ByteSource source, const CloudReadOptions& options);
[[nodiscard]] ReaderResult open_ptx(ByteSource source, const CloudReadOptions& options);
[[nodiscard]] ReaderResult open_ply(ByteSource source, const CloudReadOptions& options);
[[nodiscard]] ReaderResult open_text(ByteSource source, const CloudReadOptions& options,
                                     bool is_csv);
/// By the extension of the source's name.
[[nodiscard]] ReaderResult open_source(ByteSource source, const CloudReadOptions& options);
/// All that a reader gives, or an even random share of it.
[[nodiscard]] Result<Cloud> read_all(CloudReader& reader, const std::string& file,
                                     const RunContext& run, double share = 1.0);

/// For writers of one record layout and one frame: refuses a station of another layout,
/// brings batches to the model frame and drops points without position.
class FlatWriter : public CloudWriter {
 public:
  FlatWriter(AtomicFile file, std::string name, double unit_mm)
      : file_(std::move(file)), name_(std::move(name)), unit_mm_(unit_mm) {}
  [[nodiscard]] bool keeps_poses() const final { return false; }
  [[nodiscard]] Result<void> begin_station(const ScanStation& station) final;
  [[nodiscard]] Result<void> write(const PointBatch& batch) final;
  [[nodiscard]] Result<void> finish() final;

 protected:
  /// Layout and position from first_ are known. A header of fixed length; `complete` is true
  /// when it is written again over itself with the right counts.
  [[nodiscard]] virtual Result<std::string> header(bool complete) = 0;
  /// Point i of the batch, p and n in the model frame.
  [[nodiscard]] virtual Result<void> point(const PointBatch& batch, std::size_t i, Vec3 p_mm,
                                           Vec3 n) = 0;
  /// Before the header is written the last time.
  [[nodiscard]] virtual Result<void> end() { return {}; }
  void flush_rows();

  AtomicFile file_;
  std::string name_;
  double unit_mm_;
  ScanStation first_;  ///< the first station, with what the file can say of it
  std::uint64_t stations_ = 0;
  std::uint64_t count_ = 0;  ///< points written
  std::string rows_;         ///< waiting to be written

 private:
  RigidTransform model_from_station_;
  bool moves_ = false;
  std::size_t header_bytes_ = 0;
};

/// A full-scale colour in eight bits: exact where it came from eight.
[[nodiscard]] constexpr std::uint8_t eight_bits(std::uint16_t v) {
  return static_cast<std::uint8_t>((v + 128) / 257);
}

/// A count in a fixed number of characters, so that a header can be completed in place.
[[nodiscard]] std::string padded_count(std::uint64_t count);

/// @pre the batch has exactly the arrays of `fields`
void check_batch(const CloudFields& fields, const PointBatch& batch);

using WriterResult = Result<std::unique_ptr<CloudWriter>>;
[[nodiscard]] WriterResult create_e57(const std::filesystem::path& path,
                                      const CloudWriteOptions& options);
[[nodiscard]] WriterResult create_las(const std::filesystem::path& path,
                                      const CloudWriteOptions& options);
[[nodiscard]] WriterResult create_pcd(const std::filesystem::path& path,
                                      const CloudWriteOptions& options);
[[nodiscard]] WriterResult create_pts(const std::filesystem::path& path,
                                      const CloudWriteOptions& options);
[[nodiscard]] WriterResult create_ptx(const std::filesystem::path& path,
                                      const CloudWriteOptions& options);
/// @param scalar  one more float per point: name of the property; its values are `values`, in the
///                order of the points written
struct ExtraScalar {
  std::string_view name;
  const std::vector<float>* values;
};
[[nodiscard]] WriterResult create_ply(const std::filesystem::path& path,
                                      const CloudWriteOptions& options,
                                      const ExtraScalar* extra = nullptr);
[[nodiscard]] WriterResult create_text(const std::filesystem::path& path,
                                       const CloudWriteOptions& options, bool is_csv);
/// The cloud as one or several stations. `transform` is applied to points, normals and
/// positions.
[[nodiscard]] Result<void> write_all(const Cloud& cloud, const RigidTransform* transform,
                                     CloudWriter& writer);

}  // namespace maquette::scan::detail
