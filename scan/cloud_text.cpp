// SPDX-License-Identifier: GPL-3.0-or-later

// Reader of XYZ and CSV clouds: one point a line.

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

}  // namespace

Result<Cloud> read_text_cloud(std::string_view data, const std::string& file, bool is_csv,
                              const RunContext& run) {
  CloudBuilder builder(file);
  std::vector<std::size_t> columns;
  std::vector<std::string_view> fields;
  char separator = 0;
  std::size_t at = data.starts_with("\xEF\xBB\xBF") ? 3 : 0;
  std::uint64_t line_number = 0;
  while (at < data.size()) {
    if (line_number % 500'000 == 0) {
      if (run.stopped()) return fail(kCancelled, fmt::format("{}: reading was cancelled", file));
      run.progress(static_cast<double>(at) / static_cast<double>(data.size()));
    }
    std::string_view line = next_line(data, at);
    ++line_number;
    const std::size_t first = line.find_first_not_of(" \t\r");
    if (first == std::string_view::npos) continue;
    if (line[first] == '#' || line.substr(first).starts_with("//")) {
      line.remove_prefix(std::min(line.find_first_not_of("#/ \t", first), line.size()));
      MAQUETTE_TRY(const auto station,
                   station_comment(line, fmt::format("{}: line {}", file, line_number)));
      if (station) builder.set_station(*station);
      continue;
    }
    if (columns.empty()) {
      if (is_csv) separator = line.find(';') != std::string_view::npos ? ';' : ',';
      split(line, separator, fields);
      const std::string where = fmt::format("{}: line {}", file, line_number);
      if (fields.empty()) return fail(kCloudFormat, fmt::format("{}: no fields", where));
      const bool named = !parse_number<double>(fields.front());
      MAQUETTE_TRY(columns, find_columns(fields, named, where));
      for (const std::size_t c : columns)
        if (c != kIgnored && !builder.declare(c))
          return fail(kCloudFormat, fmt::format("{}: a column name stands twice", where));
      if (named) continue;
    } else {
      split(line, separator, fields);
    }
    if (fields.size() != columns.size())
      return fail(kCloudFormat, fmt::format("{}: line {}: expected {} columns, got {}", file,
                                            line_number, columns.size(), fields.size()));
    std::array<double, kChannels + 1> row{};
    for (std::size_t i = 0; i < columns.size(); ++i) {
      if (columns[i] == kIgnored) continue;
      const auto value = parse_number<double>(fields[i]);
      if (!value)
        return fail(kCloudFormat, fmt::format("{}: line {}: column {}: '{}' is no number", file,
                                              line_number, i + 1, shown(fields[i])));
      row[columns[i]] = *value;
    }
    MAQUETTE_TRY_VOID(builder.add(row));
  }
  return std::move(builder).finish();
}

}  // namespace maquette::scan::detail
