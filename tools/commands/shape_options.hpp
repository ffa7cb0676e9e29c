// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/jobs_shaped.hpp"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace maquette::tools {

/// The options of `mesh` and `bands` that change underside and walls.
struct ShapeOptions {
  double hollow_mm = 0.0, rib_mm = 3.0, pocket_mm = 40.0, ceiling_step_mm = 0.0;  // 0: not hollow
  std::string label{}, side = "south";
  double scale_bar = 0.0, letter_mm = 5.0, depth_mm = 0.6, stroke_mm = 0.0;
  std::vector<CLI::Option*> given{};  ///< all of them
};

/// @param label_help  what is engraved
void add_shape_options(CLI::App& app, ShapeOptions& options, const std::string& label_help);

/// What they ask for. Fails where options of engraving are given and nothing to engrave.
[[nodiscard]] Result<void> take_shape_options(const ShapeOptions& options, Shape& shape);

}  // namespace maquette::tools
