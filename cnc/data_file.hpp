// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file data_file.hpp
/// A flat TOML file whose every key is known, as machines and materials are written.
/// Whatever is wrong with it is said at once: file, line, key, what is allowed, and for an
/// unknown key the nearest known one.

#include <cmath>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

/// A machine or material file with an unknown key, a missing one, a wrong type or range, or
/// that is not TOML.
inline constexpr ErrorCode kDataFile{"CNC_DATA_FILE"};

struct DataKey {
  std::string name;
  std::variant<double*, int*, Vec3*, std::string*, std::vector<double>*> to;
  double min = -INFINITY, max = INFINITY;  ///< numbers, and elements of lists
  bool required = true;                    ///< else what `to` holds stays
};

/// @param place  file in messages
/// @return CNC_DATA_FILE with one finding a line: "machine.toml:7: key 'x' ...". On failure
///         the targets are in an unspecified state.
[[nodiscard]] Result<void> read_data(std::string_view text, std::string_view place,
                                     std::span<const DataKey> keys);

/// The text of a file of assets/<kind>/<name>.toml, which the program carries; "" if there is
/// none of that name.
[[nodiscard]] std::string_view built_in_data(std::string_view kind, std::string_view name);
/// In alphabetical order.
[[nodiscard]] std::vector<std::string> built_in_names(std::string_view kind);

}  // namespace maquette::cnc
