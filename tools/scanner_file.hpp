// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scanner_file.hpp
/// Scanners by name or as TOML files with documented keys, of either kind.

#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "core/result.hpp"
#include "scan/scanner_sim.hpp"
#include "scan/structured_light.hpp"

namespace maquette::tools {

struct PhaseShiftScanner {
  assets::ScannerPreset preset;
  scan::AngularErrors angular;
  scan::RangeErrors range;
  int footprint_rays = 7;
};
using Scanner = std::variant<PhaseShiftScanner, assets::StructuredLightPreset>;

[[nodiscard]] std::vector<std::string> scanner_names();
[[nodiscard]] const std::string& scanner_name(const Scanner& scanner);

/// A preset by its name, or a file that ends in ".toml": `kind` says which keys it may have, and
/// keys that are absent have the values of the preset that `preset` names (the first of the kind).
/// @return TOOLS_UNKNOWN_NAME, TOOLS_CONFIG_SYNTAX, TOOLS_CONFIG_INVALID, CORE_FILE_*
[[nodiscard]] Result<Scanner> find_scanner(const std::string& name_or_path);

/// The commented file of a scanner, all values written out.
[[nodiscard]] std::string scanner_file_text(const Scanner& scanner);

}  // namespace maquette::tools
