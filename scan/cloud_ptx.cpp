// SPDX-License-Identifier: GPL-3.0-or-later

// PTX: scans as complete grids, one after the other. Each begins with ten lines: columns, rows,
// scanner position, its three axes, and a 4 x 4 matrix for row vectors (the last row is the
// translation); then one line per cell, column by column: x y z intensity [red green blue] in
// the scanner's frame, "0 0 0 0.5" where nothing came back.

#include <cmath>
#include <iterator>
#include <utility>

#include <fmt/format.h>

#include "core/check.hpp"
#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan::detail {
namespace {

class PtxReader final : public BasicReader {
 public:
  PtxReader(ByteSource source, const CloudReadOptions& options)
      : BasicReader(std::move(source), options, 1000.0) {}

  [[nodiscard]] std::string_view format() const override { return "PTX"; }

  Result<bool> next(PointBatch& batch) override {
    bool begins = false;
    if (stations_.empty() || done_ == stations_.back().points) {
      MAQUETTE_TRY(begins, next_station());
      if (!begins) return false;
    }
    start(batch, stations_.size() - 1, begins);
    const ScanStation& station = stations_.back();
    Row row{};
    while (batch.size() < batch_points_ && done_ < station.points) {
      MAQUETTE_TRY_VOID(read_cell(row));
      const bool missing = row[kX] == 0.0 && row[kY] == 0.0 && row[kZ] == 0.0;
      row[kRow] = static_cast<double>(done_ % station.rows);
      row[kColumn] = static_cast<double>(done_ / station.rows);
      MAQUETTE_TRY_VOID(append(plan_, row, points_read_, file(), batch,
                               missing ? std::uint8_t{kNoPosition} : std::uint8_t{0}, true));
      ++done_;
      ++points_read_;
    }
    return true;
  }

 private:
  [[nodiscard]] std::string where() const {
    return fmt::format("{}: line {}", file(), source_.line_number());
  }

  /// n numbers on a line of their own.
  Result<std::array<double, 4>> numbers(std::size_t n, std::string_view what) {
    std::array<double, 4> values{};
    auto line = source_.line();
    if (!line) return source_.ended(fmt::format("before the {} of a scan", what));
    for (std::size_t i = 0; i < n; ++i) {
      const std::string_view token = next_token(*line);
      const auto value = parse_number<double>(token);
      if (!value || !std::isfinite(*value))
        return fail(kCloudFormat,
                    fmt::format("{}: expected the {} of a scan ({} numbers), got '{}'", where(),
                                what, n, shown(token)));
      values[i] = *value;
    }
    if (!next_token(*line).empty())
      return fail(kCloudFormat,
                  fmt::format("{}: more than {} numbers for the {}", where(), n, what));
    return values;
  }

  Result<std::uint32_t> count(std::string_view what) {
    MAQUETTE_TRY(const auto value, numbers(1, what));
    if (!(value[0] >= 0.0 && value[0] <= 4294967295.0 && value[0] == std::floor(value[0])))
      return fail(kCloudFormat, fmt::format("{}: {} {}", where(), value[0], what));
    return static_cast<std::uint32_t>(value[0]);
  }

  /// The header of the next scan, if there is one.
  Result<bool> next_station() {
    while (true) {  // up to a line that says something
      const std::string_view ahead = source_.peek(4096);
      if (ahead.substr(0, ahead.find('\n')).find_first_not_of(" \t\r") != std::string_view::npos)
        break;
      if (!source_.line()) return false;
    }
    ScanStation s;
    MAQUETTE_TRY(s.columns, count("columns"));
    MAQUETTE_TRY(s.rows, count("rows"));
    MAQUETTE_TRY(const auto position, numbers(3, "scanner position"));
    for (int axis = 0; axis < 3; ++axis) {
      MAQUETTE_TRY(const auto unused, numbers(3, "scanner axes"));
      (void)unused;  // the matrix says it again
    }
    std::array<Vec3, 4> m;
    for (std::size_t i = 0; i < 4; ++i) {
      MAQUETTE_TRY(const auto v, numbers(4, "matrix"));
      m[i] = {v[0], v[1], v[2]};
      if (v[3] != (i == 3 ? 1.0 : 0.0))
        return fail(kCloudFormat, fmt::format("{}: the matrix's last column is not 0 0 0 1; it is "
                                              "no motion",
                                              where()));
    }
    const auto rotation = rotation_from_axes(m[0], m[1], m[2]);
    if (!rotation)
      return fail(kCloudFormat,
                  fmt::format("{}: the matrix is no rotation (scaled, skewed or mirrored); export "
                              "the scan with a rigid registration",
                              where()));
    s.model_from_station = {*rotation, unit_mm_ * m[3]};
    s.position_mm = unit_mm_ * Vec3{position[0], position[1], position[2]};
    for (const Vec3& p : {*s.position_mm, s.model_from_station.translation_mm})
      if (!(norm(p) <= kLargestCoordinateMm))
        return fail(kCloudFormat, fmt::format("{}: the scanner is {} mm away; at most {} is "
                                              "possible",
                                              where(), norm(p), kLargestCoordinateMm));
    s.name = fmt::format("scan {}", stations_.size() + 1);
    s.points = std::uint64_t{s.columns} * s.rows;
    // The shortest line is "0 0 0 0" and its end, which the last may lack.
    const std::uint64_t room = (source_.remaining() + 1) / 8;
    if (s.points > room)
      return fail(kCloudFormat,
                  fmt::format("{}: {} columns of {} rows are promised, but the file has room for "
                              "at most {} points; it is truncated or its header is wrong",
                              where(), s.columns, s.rows, room));
    plan_ = {};
    plan_.unit_mm = unit_mm_;
    plan_.rows = s.rows;
    plan_.columns = s.columns;
    for (const std::size_t c : {kX, kY, kZ, kIntensity, kRow, kColumn}) plan_.present[c] = true;
    MAQUETTE_TRY_VOID(find_colour(s));
    s.fields = plan_.fields();
    s.fields.flags = true;
    stations_.push_back(std::move(s));
    done_ = 0;
    return true;
  }

  /// Has the first cell seven numbers?
  Result<void> find_colour(const ScanStation& s) {
    if (s.points == 0) return {};
    std::string_view line = source_.peek(1024);
    line = line.substr(0, line.find('\n'));
    std::size_t n = 0;
    while (!next_token(line).empty()) ++n;
    if (n != 4 && n != 7)
      return fail(kCloudFormat,
                  fmt::format("{}: line {}: {} numbers in a cell; expected x y z intensity [red "
                              "green blue]",
                              file(), source_.line_number() + 1, n));
    if (n == 7)
      for (const std::size_t c : {kRed, kGreen, kBlue}) plan_.present[c] = true;
    return {};
  }

  Result<void> read_cell(Row& row) {
    auto line = source_.line();
    if (!line)
      return source_.ended(fmt::format("after {} of {} cells of scan {}", done_,
                                       stations_.back().points, stations_.size()));
    const std::array<std::size_t, 7> order{kX, kY, kZ, kIntensity, kRed, kGreen, kBlue};
    const std::size_t n = plan_.has_colour() ? 7 : 4;
    for (std::size_t i = 0; i < n; ++i) {
      const std::string_view token = next_token(*line);
      const auto value = parse_number<double>(token);
      if (!value)
        return fail(kCloudFormat, fmt::format("{}: expected {} numbers, got '{}' for number {}",
                                              where(), n, shown(token), i + 1));
      row[order[i]] = *value;
    }
    if (const std::string_view more = next_token(*line); !more.empty())
      return fail(kCloudFormat, fmt::format("{}: '{}' after {} numbers", where(), shown(more), n));
    return {};
  }

  std::uint64_t done_ = 0;  // cells of the last station
  RecordPlan plan_;
};

class PtxWriter final : public CloudWriter {
 public:
  PtxWriter(AtomicFile file, std::string name, double unit_mm)
      : file_(std::move(file)), name_(std::move(name)), unit_mm_(unit_mm) {}

  [[nodiscard]] bool keeps_poses() const override { return true; }

  Result<void> begin_station(const ScanStation& station) override {
    MAQUETTE_TRY_VOID(end_station());
    station_ = station;
    cells_ = 0;
    gridded_ =
        station.rows > 0 && station.columns > 0 &&
        (station.fields.grid || station.points == std::uint64_t{station.rows} * station.columns);
    header_at_ = written_;
    put(header());
    open_ = true;
    return {};
  }

  Result<void> write(const PointBatch& batch) override {
    MAQUETTE_CHECK(open_, "write before begin_station");
    check_batch(station_.fields, batch);
    const double low = station_.intensity_limits[0], high = station_.intensity_limits[1];
    for (std::size_t i = 0; i < batch.size(); ++i) {
      if (gridded_ && !batch.grid.empty()) {
        const GridIndex& g = batch.grid[i];
        const std::uint64_t cell = std::uint64_t{g.column} * station_.rows + g.row;
        if (g.row >= station_.rows || g.column >= station_.columns || cell < cells_)
          return fail(
              kCloudCannotHold,
              fmt::format("{}: PTX holds a grid column by column; row {}, column {} of {} x "
                          "{} comes out of this order; write E57, or sort the points",
                          name_, g.row, g.column, station_.rows, station_.columns));
        while (cells_ < cell) missing();
      }
      if (!batch.has_position(i)) {
        missing();
        continue;
      }
      const Vec3 p = batch.points_mm[i];
      double intensity = 0.5;
      if (station_.fields.intensity) {
        intensity = static_cast<double>(batch.intensity[i]);
        if (high > low) intensity = std::clamp((intensity - low) / (high - low), 0.0, 1.0);
      }
      fmt::format_to(std::back_inserter(rows_), "{} {} {} {}", p.x / unit_mm_, p.y / unit_mm_,
                     p.z / unit_mm_, static_cast<float>(intensity));
      if (station_.fields.colour) {
        const Colour& c = batch.colours[i];
        fmt::format_to(std::back_inserter(rows_), " {} {} {}", eight_bits(c.red),
                       eight_bits(c.green), eight_bits(c.blue));
      }
      rows_ += '\n';
      end_cell();
    }
    return {};
  }

  Result<void> finish() override {
    MAQUETTE_TRY_VOID(end_station());
    flush();
    return file_.commit();
  }

 private:
  /// Of fixed length: counts are completed at the end of the station.
  [[nodiscard]] std::string header() const {
    const std::uint64_t columns = gridded_ ? station_.columns : cells_;
    const RigidTransform& pose = station_.model_from_station;
    const Vec3 t = pose.translation_mm, at = station_.position_mm.value_or(t);
    std::string text =
        padded_count(columns) + "\n" + padded_count(gridded_ ? station_.rows : 1) + "\n";
    const auto line = [&](Vec3 v, double unit, std::string_view last) {
      fmt::format_to(std::back_inserter(text), "{} {} {}{}\n", v.x / unit, v.y / unit, v.z / unit,
                     last);
    };
    const std::array<Vec3, 3> axes{pose.direction({1, 0, 0}), pose.direction({0, 1, 0}),
                                   pose.direction({0, 0, 1})};
    line(at, unit_mm_, "");
    for (const Vec3& axis : axes) line(axis, 1.0, "");
    for (const Vec3& axis : axes) line(axis, 1.0, " 0");
    line(t, unit_mm_, " 1");
    return text;
  }

  void missing() {
    rows_ += station_.fields.colour ? "0 0 0 0.5 0 0 0\n" : "0 0 0 0.5\n";
    end_cell();
  }

  void end_cell() {
    ++cells_;
    if (rows_.size() > (std::size_t{1} << 20)) flush();
  }

  void flush() {
    put(rows_);
    rows_.clear();
  }

  void put(std::string_view text) {
    file_.write(text);
    written_ += text.size();
  }

  Result<void> end_station() {
    if (!open_) return {};
    open_ = false;
    const std::uint64_t all = std::uint64_t{station_.rows} * station_.columns;
    if (gridded_)
      while (cells_ < all) missing();
    flush();
    if (gridded_ && cells_ > all)
      return fail(kCloudCannotHold, fmt::format("{}: {} points in a grid of {} x {}", name_, cells_,
                                                station_.rows, station_.columns));
    file_.rewrite(header_at_, header());
    return {};
  }

  AtomicFile file_;
  std::string name_;
  double unit_mm_;
  ScanStation station_;
  bool gridded_ = false, open_ = false;
  std::uint64_t cells_ = 0, written_ = 0, header_at_ = 0;
  std::string rows_;
};

}  // namespace

ReaderResult open_ptx(ByteSource source, const CloudReadOptions& options) {
  return std::make_unique<PtxReader>(std::move(source), options);
}

WriterResult create_ptx(const std::filesystem::path& path, const CloudWriteOptions& options) {
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  return std::make_unique<PtxWriter>(std::move(file), path.string(),
                                     options.unit_mm.value_or(1000.0));
}

}  // namespace maquette::scan::detail
