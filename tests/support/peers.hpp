// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file peers.hpp
/// Where `tools/setup --peers` puts other people's programs.

#include <cstdlib>
#include <filesystem>
#include <string>

namespace maquette::testing_support {

inline std::filesystem::path peers_folder() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::filesystem::path(value != nullptr ? value : "");
  };
  if (const auto given = variable("MAQUETTE_PEERS"); !given.empty()) return given;
  const auto cache = variable("XDG_CACHE_HOME");
  return (cache.empty() ? variable("HOME") / ".cache" : cache) / "maquette/peers";
}

}  // namespace maquette::testing_support
