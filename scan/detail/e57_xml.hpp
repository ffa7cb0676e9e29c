// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file e57_xml.hpp
/// What the XML section of an E57 file says, as far as clouds need it.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.hpp"
#include "scan/cloud_stream.hpp"

namespace maquette::scan::detail {

/// One bytestream of the points' records. Missing attributes have the standard's defaults.
struct E57Field {
  enum class Kind { integer, scaled, real32, real64, text };
  std::string name;  ///< "cartesianX"; of nested structures "outer/inner"
  Kind kind = Kind::real64;
  std::int64_t minimum = INT64_MIN, maximum = INT64_MAX;  ///< integer and scaled
  double scale = 1.0, offset = 0.0;                       ///< scaled: scale * raw + offset
  /// Of one value; text: of the shortest value.
  [[nodiscard]] unsigned bits() const;
};

struct E57Limits {
  double minimum = 0.0, maximum = 0.0;
};

struct E57Station {
  ScanStation station;  ///< `points` is the record count
  std::uint64_t section_physical = 0;
  std::vector<E57Field> fields;
  bool states_intensity_limits = false;
  std::optional<E57Limits> colour;  ///< colorLimits of red
  std::int64_t row_minimum = 0, column_minimum = 0;
};

struct E57Contents {
  std::vector<E57Station> stations;
  std::vector<CloudImage> images;
};

/// @param file  name for messages
/// @return SCAN_CLOUD_FORMAT with the path of the element
[[nodiscard]] Result<E57Contents> parse_e57_xml(std::string_view xml, const std::string& file);

/// What the writer has to say about a station.
struct E57Written {
  ScanStation station;
  std::uint64_t section_physical = 0;
  std::vector<E57Field> fields;
  Box3 bounds_m;  ///< station's frame
};
[[nodiscard]] std::string format_e57_xml(const std::vector<E57Written>& stations,
                                         const std::string& guid);

}  // namespace maquette::scan::detail
