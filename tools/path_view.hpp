// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_view.hpp
/// Programs in three dimensions for a browser: orbit, zoom and pan with mouse or fingers, colour by
/// height, feed or engagement, one operation or all, programs, rapids and ground each on or off.
/// One page, no network: the drawing is done by WebGL 2 in a script of ours (path_view.js), data
/// are inside.
///
/// Scene (JSON, schema maquette.path_view/1): places as 16-bit shares of the scene's box (2 m: 0.03
/// mm), feed as mm/min, engagement as 65535 (log10(mm^2) + 4) / 8; all little-endian base64.
/// The ground is the design's lowest height around each of at most 200 x 200 nodes, so that no path
/// on the design is hidden by it.

#include <filesystem>
#include <span>
#include <string>

#include "cnc/path_sketch.hpp"
#include "core/result.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::tools {

struct ViewProgram {
  std::string name;
  std::string operation;  ///< what the view offers to show alone, where there are several
  double cut_mm = 0.0, time_min = 0.0;
  const cnc::Sketch* sketch = nullptr;
};
/// @param design  null: no ground
[[nodiscard]] std::string path_scene_json(std::span<const ViewProgram> programs, bool engagement,
                                          const heightmap::ModelField* design);

/// Style and script, once a page, before the first view.
[[nodiscard]] std::string path_view_head();
/// One view of a scene.
[[nodiscard]] std::string path_view_html(const std::string& scene_json);
/// A page that holds one view only.
[[nodiscard]] Result<void> write_path_page(const std::string& title, const std::string& scene_json,
                                           const std::filesystem::path& out);

}  // namespace maquette::tools
