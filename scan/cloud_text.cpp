// SPDX-License-Identifier: GPL-3.0-or-later

// XYZ and CSV clouds: one point a line.

#include <iterator>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan::detail {
namespace {

/// Fields of a line. CSV keeps empty fields, XYZ has none.
void split(std::string_view line, char csv_separator, std::vector<std::string_view>& fields) {
  fields.clear();
  if (csv_separator == 0) {
    for (auto t = next_token(line, " \t\r,;"); !t.empty(); t = next_token(line, " \t\r,;"))
      fields.push_back(t);
    return;
  }
  while (true) {
    const std::size_t end = line.find(csv_separator);
    std::string_view field = line.substr(0, end);
    fields.push_back(next_token(field));
    if (!next_token(field).empty()) fields.back() = line.substr(0, end);  // blanks inside
    if (end == std::string_view::npos) return;
    line.remove_prefix(end + 1);
  }
}

std::vector<std::size_t> columns_by_count(std::size_t count) {
  switch (count) {
    case 3:
      return {kX, kY, kZ};
    case 4:
      return {kX, kY, kZ, kIntensity};
    case 6:
      return {kX, kY, kZ, kNx, kNy, kNz};
    case 7:
      return {kX, kY, kZ, kIntensity, kNx, kNy, kNz};
    default:
      return {};
  }
}

/// What each column means, from a line of names or from how many there are.
Result<std::vector<std::size_t>> find_columns(const std::vector<std::string_view>& fields,
                                              bool named, const std::string& where) {
  std::vector<std::size_t> columns;
  if (!named) {
    columns = columns_by_count(fields.size());
    if (columns.empty())
      return fail(kCloudFormat,
                  fmt::format("{}: {} columns without names; expected x y z [intensity] [nx ny nz]",
                              where, fields.size()));
    return columns;
  }
  for (const auto name : fields) columns.push_back(channel_by_name(name));
  for (const std::size_t wanted : {kX, kY, kZ}) {
    bool found = false;
    for (const std::size_t c : columns) found |= c == wanted;
    if (!found)
      return fail(kCloudFormat,
                  fmt::format("{}: neither numbers nor a line of names with x, y and z; starts "
                              "with '{}'",
                              where, shown(fields.front())));
  }
  return columns;
}

class TextReader final : public BasicReader {
 public:
  TextReader(ByteSource source, const CloudReadOptions& options, bool is_csv)
      : BasicReader(std::move(source), options, 1.0), is_csv_(is_csv) {}

  /// Reads up to the first point, so that the columns are known.
  Result<void> open() {
    plan_.unit_mm = unit_mm_;
    stations_.emplace_back();
    if (source_.peek(3) == "\xEF\xBB\xBF") source_.skip(3);
    MAQUETTE_TRY(waiting_, next_row());
    stations_.front().fields = plan_.fields();
    return {};
  }

  [[nodiscard]] std::string_view format() const override { return is_csv_ ? "CSV" : "XYZ"; }

  Result<bool> next(PointBatch& batch) override {
    const bool begins = !begun_;
    begun_ = true;
    start(batch, 0, begins);
    while (waiting_ && batch.size() < batch_points_) {
      MAQUETTE_TRY_VOID(append(plan_, row_, points_read_, file(), batch));
      ++points_read_;
      MAQUETTE_TRY(waiting_, next_row());
    }
    return begins || batch.size() > 0;
  }

 private:
  [[nodiscard]] std::string where() const {
    return fmt::format("{}: line {}", file(), source_.line_number());
  }

  /// The next point into row_; false at the end.
  Result<bool> next_row() {
    while (const auto next = source_.line()) {
      std::string_view line = *next;
      const std::size_t first = line.find_first_not_of(" \t\r");
      if (first == std::string_view::npos) continue;
      if (line[first] == '#' || line.substr(first).starts_with("//")) {
        line.remove_prefix(std::min(line.find_first_not_of("#/ \t", first), line.size()));
        MAQUETTE_TRY(const auto station, station_comment(line, where()));
        if (station) stations_.front().position_mm = station;
        continue;
      }
      if (columns_.empty()) {
        if (is_csv_) separator_ = line.find(';') != std::string_view::npos ? ';' : ',';
        split(line, separator_, fields_);
        if (fields_.empty()) return fail(kCloudFormat, fmt::format("{}: no fields", where()));
        const bool named = !parse_number<double>(fields_.front());
        MAQUETTE_TRY(columns_, find_columns(fields_, named, where()));
        for (const std::size_t c : columns_)
          if (c != kIgnored && !plan_.declare(c))
            return fail(kCloudFormat, fmt::format("{}: a column name stands twice", where()));
        if (named) continue;
      } else {
        split(line, separator_, fields_);
      }
      if (fields_.size() != columns_.size())
        return fail(kCloudFormat, fmt::format("{}: expected {} columns, got {}", where(),
                                              columns_.size(), fields_.size()));
      for (std::size_t i = 0; i < columns_.size(); ++i) {
        if (columns_[i] == kIgnored) continue;
        const auto value = parse_number<double>(fields_[i]);
        if (!value)
          return fail(kCloudFormat, fmt::format("{}: column {}: '{}' is no number", where(), i + 1,
                                                shown(fields_[i])));
        row_[columns_[i]] = *value;
      }
      return true;
    }
    return false;
  }

  bool is_csv_;
  char separator_ = 0;
  RecordPlan plan_;
  std::vector<std::size_t> columns_;
  std::vector<std::string_view> fields_;
  Row row_{};
  bool waiting_ = false, begun_ = false;
};

class TextWriter final : public FlatWriter {
 public:
  TextWriter(AtomicFile file, std::string name, double unit_mm, bool is_csv)
      : FlatWriter(std::move(file), std::move(name), unit_mm), separator_(is_csv ? ',' : ' ') {}

 private:
  Result<std::string> header(bool /*complete*/) override {
    const CloudFields& f = first_.fields;
    std::string text;
    if (first_.position_mm) {
      const std::string position = scanner_position_text(*first_.position_mm);
      text += fmt::format("# {:<{}}\n", stations_ > 1 ? "" : position, position.size());
    }
    std::string names = "x y z";
    if (f.intensity) names += " intensity";
    if (f.normals) names += " nx ny nz";
    // Up to here the number of columns says what they are.
    const bool more = f.colour || f.grid || f.time || f.returns || f.scan_angle || f.statistics;
    if (f.colour) names += " red green blue";
    if (f.grid) names += " row column";
    if (f.time) names += " time_s";
    if (f.returns) names += " return_index return_count";
    if (f.scan_angle) names += " scan_angle_rad";
    if (f.statistics) names += " point_count spread";
    if (separator_ == ',') std::replace(names.begin(), names.end(), ' ', ',');
    if (more || separator_ == ',') text += names + "\n";
    return text;
  }

  template <class... Values>
  void put(Values... values) {
    (fmt::format_to(std::back_inserter(rows_), "{}{}", separator_, values), ...);
  }

  Result<void> point(const PointBatch& b, std::size_t i, Vec3 p, Vec3 n) override {
    const CloudFields& f = first_.fields;
    fmt::format_to(std::back_inserter(rows_), "{}", p.x / unit_mm_);
    put(p.y / unit_mm_, p.z / unit_mm_);
    if (f.intensity) put(b.intensity[i]);
    if (f.normals) put(n.x, n.y, n.z);
    if (f.colour)
      put(eight_bits(b.colours[i].red), eight_bits(b.colours[i].green),
          eight_bits(b.colours[i].blue));
    if (f.grid) put(b.grid[i].row, b.grid[i].column);
    if (f.time) put(b.time_s[i]);
    if (f.returns) put(b.return_index[i], b.return_count[i]);
    if (f.scan_angle) put(b.scan_angle_rad[i]);
    if (f.statistics)
      put(b.counts[i], static_cast<float>(static_cast<double>(b.spread_mm[i]) / unit_mm_));
    rows_ += '\n';
    return {};
  }

  char separator_;
};

}  // namespace

ReaderResult open_text(ByteSource source, const CloudReadOptions& options, bool is_csv) {
  auto reader = std::make_unique<TextReader>(std::move(source), options, is_csv);
  MAQUETTE_TRY_VOID(reader->open());
  return reader;
}

WriterResult create_text(const std::filesystem::path& path, const CloudWriteOptions& options,
                         bool is_csv) {
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  return std::make_unique<TextWriter>(std::move(file), path.string(), options.unit_mm.value_or(1.0),
                                      is_csv);
}

}  // namespace maquette::scan::detail
