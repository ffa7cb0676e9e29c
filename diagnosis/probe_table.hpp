// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file probe_table.hpp
/// Probed or CMM points: CSV with a header line. Columns by name, in any order, any case; comma,
/// semicolon or tab: x_nominal_mm, y_nominal_mm, [z_nominal_mm], x_mm, y_mm, [z_mm], [sigma_mm].
/// Empty lines and lines that begin with # are passed over; other columns are ignored.
/// Without z_mm a row is a mark in plan; with it a point of the surface, and where the rows scatter
/// along the surface about as much as sigma_mm says, marks on it.

#include <filesystem>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::diagnosis {

struct ProbeRow {
  double x_nominal_mm, y_nominal_mm;
  std::optional<double> z_nominal_mm;
  double x_mm, y_mm;
  std::optional<double> z_mm, sigma_mm;
};
/// @return rows, or DIAGNOSIS_PROBE_TABLE with file, line and what was expected; CORE_FILE_*
[[nodiscard]] Result<std::vector<ProbeRow>> read_probe_table(const std::filesystem::path& path);

}  // namespace maquette::diagnosis
