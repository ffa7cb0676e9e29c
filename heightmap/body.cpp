// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/body.hpp"

#include <algorithm>
#include <cctype>

namespace maquette::heightmap {

std::optional<Body> body_by_name(std::string_view name) {
  std::string lower(name);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (lower == "moon") return Body{"moon", 1737400.0, 1737400.0};
  if (lower == "mars") return Body{"mars", 3396190.0, 3376200.0};
  return std::nullopt;
}

}  // namespace maquette::heightmap
