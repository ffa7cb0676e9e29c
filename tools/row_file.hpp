// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file row_file.hpp
/// Files of numbers, a row a line under a fixed head.

#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include "core/files.hpp"
#include "core/result.hpp"

namespace maquette::tools {

/// Calls row(line, number, wrong) for each line under the head; empty lines and those that begin
/// with # are passed over. `wrong(what)` is the error with file and line that a row may return.
/// @return errors of reading, of the head, or of a row
template <class Row>
[[nodiscard]] Result<void> each_row(const std::filesystem::path& path, std::string_view head,
                                    ErrorCode code, Row row) {
  MAQUETTE_TRY(const std::string file, read_file(path));
  std::string_view text = file;
  for (int number = 1; !text.empty(); ++number) {
    const auto end = text.find('\n');
    std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    const auto wrong = [&](const std::string& what) {
      return fail(code, fmt::format("{}: line {}: {}", path.string(), number, what));
    };
    if (number == 1) {
      if (line != head) return wrong(fmt::format("the head {} expected", head));
    } else if (!line.empty() && line.front() != '#') {
      MAQUETTE_TRY_VOID(row(line, number, wrong));
    }
  }
  return {};
}

/// The line's first numbers, a comma behind each but, where `whole`, the last; `line` is then what
/// is left of it.
/// @return 0, or the column (from 1) that is no finite number
template <std::size_t N>
[[nodiscard]] std::size_t take_numbers(std::string_view& line, std::array<double, N>& values,
                                       bool whole) {
  const char* at = line.data();
  const char* const last = at + line.size();
  for (std::size_t i = 0; i < N; ++i) {
    const auto read = std::from_chars(at, last, values[i]);
    const bool ended =
        whole && i + 1 == N ? read.ptr == last : read.ptr != last && *read.ptr == ',';
    if (read.ec != std::errc{} || !ended || !std::isfinite(values[i])) return i + 1;
    at = read.ptr != last ? read.ptr + 1 : last;
  }
  line = {at, static_cast<std::size_t>(last - at)};
  return 0;
}

}  // namespace maquette::tools
