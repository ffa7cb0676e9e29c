// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/probe_table.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <string>

#include <fmt/format.h>

#include "core/files.hpp"
#include "diagnosis/case_input.hpp"

namespace maquette::diagnosis {
namespace {

std::vector<std::string> cells_of(std::string_view line, char separator) {
  std::vector<std::string> cells(1);
  for (const char c : line)
    if (c == separator)
      cells.emplace_back();
    else if (c != ' ' && c != '"' && c != '\r' && (c != '\t' || separator == '\t'))
      cells.back() += c;
  return cells;
}

}  // namespace

Result<std::vector<ProbeRow>> read_probe_table(const std::filesystem::path& path) {
  MAQUETTE_TRY(std::string text, read_file(path));
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
  const std::vector<std::string> names{"x_nominal_mm", "y_nominal_mm", "z_nominal_mm", "x_mm",
                                       "y_mm",         "z_mm",         "sigma_mm"};
  std::vector<int> column_of(names.size(), -1);
  std::vector<ProbeRow> rows;
  bool header = false;
  char separator = ',';
  std::size_t number = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::string_view line(text.data() + at, end - at);
    at = end + 1;
    ++number;
    if (line.find_first_not_of(" \t\r") == std::string_view::npos || line[0] == '#') continue;
    if (!header) {
      separator = line.find(';') != std::string_view::npos   ? ';'
                  : line.find(',') != std::string_view::npos ? ','
                                                             : '\t';
      const auto cells = cells_of(line, separator);
      for (std::size_t i = 0; i < cells.size(); ++i) {
        std::string name = cells[i];
        std::transform(name.begin(), name.end(), name.begin(),
                       [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
        for (std::size_t k = 0; k < names.size(); ++k)
          if (name == names[k]) column_of[k] = static_cast<int>(i);
      }
      for (const std::size_t k : {0U, 1U, 3U, 4U})
        if (column_of[k] < 0)
          return fail(
              kProbeTable,
              fmt::format("{}:{}: no column {}; the first line must name x_nominal_mm, "
                          "y_nominal_mm, x_mm, y_mm and may name z_nominal_mm, z_mm, sigma_mm",
                          path.string(), number, names[k]));
      header = true;
      continue;
    }
    const auto cells = cells_of(line, separator);
    std::vector<std::optional<double>> v(names.size());
    for (std::size_t k = 0; k < names.size(); ++k) {
      if (column_of[k] < 0) continue;
      const auto i = static_cast<std::size_t>(column_of[k]);
      if (i >= cells.size() || cells[i].empty()) {
        if (k == 0 || k == 1 || k == 3 || k == 4)
          return fail(kProbeTable, fmt::format("{}:{}: {} is missing; expected a number",
                                               path.string(), number, names[k]));
        continue;
      }
      double value = 0.0;
      std::string cell = cells[i];
      if (separator == ';') std::replace(cell.begin(), cell.end(), ',', '.');
      const char* from = cell.data() + (cell[0] == '+' ? 1 : 0);
      const auto [rest, error] = std::from_chars(from, cell.data() + cell.size(), value);
      if (error != std::errc{} || rest != cell.data() + cell.size() || !std::isfinite(value))
        return fail(kProbeTable, fmt::format("{}:{}: {} is \"{}\", expected a number",
                                             path.string(), number, names[k], cells[i]));
      v[k] = value;
    }
    if (v[6] && !(*v[6] > 0.0))
      return fail(kProbeTable, fmt::format("{}:{}: sigma_mm is {}, expected above 0", path.string(),
                                           number, *v[6]));
    rows.push_back({*v[0], *v[1], v[2], *v[3], *v[4], v[5], v[6]});
  }
  if (rows.empty())
    return fail(
        kProbeTable,
        fmt::format("{}: no points; expected a header line and one point a line", path.string()));
  return rows;
}

}  // namespace maquette::diagnosis
