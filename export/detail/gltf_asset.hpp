// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <utility>

#include <nlohmann/json.hpp>

namespace maquette::exporting {

/// What every asset says of itself: version, maker, unit and frame, and `extras` after them.
[[nodiscard]] inline nlohmann::ordered_json gltf_asset(const nlohmann::ordered_json& extras) {
  nlohmann::ordered_json all{
      {"unit", "m"}, {"frame", "x = model x (east), y = model z (up), z = -model y (south)"}};
  all.update(extras);
  return {{"version", "2.0"}, {"generator", "maquette"}, {"extras", std::move(all)}};
}

}  // namespace maquette::exporting
