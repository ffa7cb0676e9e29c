// SPDX-License-Identifier: GPL-3.0-or-later

// PTS: sets of points, each a line with its count and then lines x y z [intensity] [red green
// blue], all in one frame. Intensities run from -2048 to 2047. A file without counts is one set.

#include <cmath>
#include <iterator>
#include <utility>

#include <fmt/format.h>

#include "core/check.hpp"
#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan::detail {
namespace {

constexpr double kDarkest = -2048.0, kBrightest = 2047.0;

class PtsReader final : public BasicReader {
 public:
  PtsReader(ByteSource source, const CloudReadOptions& options)
      : BasicReader(std::move(source), options, 1000.0) {}

  [[nodiscard]] std::string_view format() const override { return "PTS"; }

  Result<bool> next(PointBatch& batch) override {
    bool begins = false;
    if (stations_.empty() || left_ == 0) {
      MAQUETTE_TRY(begins, next_set());
      if (!begins) return false;
    }
    start(batch, stations_.size() - 1, begins);
    Row row{};
    while (batch.size() < batch_points_ && left_ > 0) {
      auto line = source_.line();
      if (!line && counted_) return source_.ended(fmt::format("{} points early", left_));
      if (!line) {
        left_ = 0;
        break;
      }
      if (!counted_ && line->find_first_not_of(" \t\r") == std::string_view::npos) continue;
      MAQUETTE_TRY_VOID(read_point(*line, row));
      MAQUETTE_TRY_VOID(append(plan_, row, points_read_, file(), batch));
      ++points_read_;
      --left_;
    }
    return true;
  }

 private:
  [[nodiscard]] std::string where() const {
    return fmt::format("{}: line {}", file(), source_.line_number());
  }

  /// The count of the next set, if there is one, and the columns of its first point.
  Result<bool> next_set() {
    std::string_view first;
    while (true) {  // up to a line that says something
      const std::string_view ahead = source_.peek(4096);
      first = ahead.substr(0, ahead.find('\n'));
      if (first.find_first_not_of(" \t\r") != std::string_view::npos) break;
      if (!source_.line()) return false;
    }
    ScanStation s;
    std::string_view rest = first;
    const std::string_view token = next_token(rest);
    counted_ = next_token(rest).empty();
    if (counted_) {
      (void)source_.line();
      const auto count = parse_number<std::uint64_t>(token);
      if (!count)
        return fail(kCloudFormat, fmt::format("{}: expected a number of points, got '{}'", where(),
                                              shown(token)));
      // The shortest line is "0 0 0" and its end, which the last may lack.
      const std::uint64_t room = (source_.remaining() + 1) / 6;
      if (*count > room)
        return fail(kCloudFormat,
                    fmt::format("{}: {} points are promised, but the file has room for at most {}; "
                                "it is truncated or its count is wrong",
                                where(), *count, room));
      s.points = left_ = *count;
      const std::string_view ahead = source_.peek(4096);
      first = ahead.substr(0, ahead.find('\n'));
    } else {
      left_ = UINT64_MAX;
    }
    plan_ = {};
    plan_.unit_mm = unit_mm_;
    columns_ = 0;
    if (left_ > 0) {
      while (!next_token(first).empty()) ++columns_;
      if (columns_ != 3 && columns_ != 4 && columns_ != 6 && columns_ != 7)
        return fail(kCloudFormat,
                    fmt::format("{}: line {}: {} columns; expected x y z [intensity] [red green "
                                "blue]",
                                file(), source_.line_number() + 1, columns_));
    }
    for (const std::size_t c : {kX, kY, kZ}) plan_.present[c] = true;
    plan_.present[kIntensity] = columns_ == 4 || columns_ == 7;
    for (const std::size_t c : {kRed, kGreen, kBlue}) plan_.present[c] = columns_ >= 6;
    s.fields = plan_.fields();
    s.intensity_limits = {kDarkest, kBrightest};
    stations_.push_back(std::move(s));
    return true;
  }

  Result<void> read_point(std::string_view line, Row& row) const {
    const std::array<std::size_t, 7> order{kX, kY, kZ, kIntensity, kRed, kGreen, kBlue};
    std::size_t n = 0;
    for (const std::size_t channel : order) {
      if (!plan_.has(channel)) continue;
      const std::string_view token = next_token(line);
      const auto value = parse_number<double>(token);
      ++n;
      if (!value)
        return fail(kCloudFormat, fmt::format("{}: expected {} columns, got '{}' for column {}",
                                              where(), columns_, shown(token), n));
      row[channel] = *value;
    }
    if (const std::string_view more = next_token(line); !more.empty())
      return fail(kCloudFormat, fmt::format("{}: '{}' after {} columns", where(), shown(more), n));
    return {};
  }

  bool counted_ = false;
  std::uint64_t left_ = 0;  // points of the set
  std::size_t columns_ = 0;
  RecordPlan plan_;
};

class PtsWriter final : public CloudWriter {
 public:
  PtsWriter(AtomicFile file, double unit_mm) : file_(std::move(file)), unit_mm_(unit_mm) {}

  [[nodiscard]] bool keeps_poses() const override { return false; }

  Result<void> begin_station(const ScanStation& station) override {
    end_station();
    station_ = station;
    count_ = 0;
    count_at_ = written_;
    put(padded_count(0) + "\n");
    open_ = true;
    return {};
  }

  Result<void> write(const PointBatch& batch) override {
    MAQUETTE_CHECK(open_, "write before begin_station");
    check_batch(station_.fields, batch);
    const double low = station_.intensity_limits[0], high = station_.intensity_limits[1];
    const bool moves = station_.model_from_station != RigidTransform{};
    for (std::size_t i = 0; i < batch.size(); ++i) {
      if (!batch.has_position(i)) continue;
      const Vec3 p =
          moves ? station_.model_from_station.point(batch.points_mm[i]) : batch.points_mm[i];
      fmt::format_to(std::back_inserter(rows_), "{} {} {}", p.x / unit_mm_, p.y / unit_mm_,
                     p.z / unit_mm_);
      if (station_.fields.intensity) {
        double v = static_cast<double>(batch.intensity[i]);
        if (high > low) v = kDarkest + (kBrightest - kDarkest) * ((v - low) / (high - low));
        v = std::round(std::clamp(v, kDarkest, kBrightest));
        fmt::format_to(std::back_inserter(rows_), " {}", std::isnan(v) ? 0 : static_cast<int>(v));
      }
      if (station_.fields.colour) {
        const Colour& c = batch.colours[i];
        fmt::format_to(std::back_inserter(rows_), " {} {} {}", eight_bits(c.red),
                       eight_bits(c.green), eight_bits(c.blue));
      }
      rows_ += '\n';
      ++count_;
      if (rows_.size() > (std::size_t{1} << 20)) flush();
    }
    return {};
  }

  Result<void> finish() override {
    end_station();
    return file_.commit();
  }

 private:
  void flush() {
    put(rows_);
    rows_.clear();
  }
  void put(std::string_view text) {
    file_.write(text);
    written_ += text.size();
  }
  void end_station() {
    if (!open_) return;
    open_ = false;
    flush();
    file_.rewrite(count_at_, padded_count(count_));
  }

  AtomicFile file_;
  double unit_mm_;
  ScanStation station_;
  bool open_ = false;
  std::uint64_t count_ = 0, count_at_ = 0, written_ = 0;
  std::string rows_;
};

}  // namespace

ReaderResult open_pts(ByteSource source, const CloudReadOptions& options) {
  return std::make_unique<PtsReader>(std::move(source), options);
}

WriterResult create_pts(const std::filesystem::path& path, const CloudWriteOptions& options) {
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  return std::make_unique<PtsWriter>(std::move(file), options.unit_mm.value_or(1000.0));
}

}  // namespace maquette::scan::detail
