// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file view_contents.hpp
/// What a folder holds that `maquette view` can show, so that its page needs no guess.
///
/// JSON, schema maquette.view/1; paths are relative to the folder, with slashes:
///   name       of the folder
///   tilesets   [{path, lod, stones}]: what `maquette lod` has written, tileset.json or, where that
///   is
///              missing, tileset_implicit.json; stones is null or a plan
///   fields     [{path, kind, unit, nodes, spacing_mm, origin_mm}]: rasters in the model frame.
///              kind: "height", "signed" (deviations; zero is the middle), "positive"
///   plans      stones.json outside of tilesets
///   paths      backplot/paths.json: thinned programs (tools/path_view.hpp)
///   frames     [{name, kind, scene, picture, linear, position_mm, target_mm, up, across_mm,
///   down_mm,
///              focal_mm}]: cameras and what they saw. kind: "scene" (of a scene file),
///              "trajectory" (also time_s; in their order) or "photo" (of a case file; also
///              held_out). scene: the file that says so. picture: null where it is not there or
///              lies outside of the folder; linear: it holds light, not sRGB
///   reports    pages
///   manifest   of `maquette run`, or null

#include <filesystem>
#include <string>

#include "core/result.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kViewNothing{"TOOLS_VIEW_NOTHING"};

/// Looks four folders deep, neither into tiles nor through symbolic links to folders. Files that
/// cannot be read are left out.
/// @return CORE_FILE_NOT_FOUND   no such folder, or not one
///         TOOLS_VIEW_NOTHING    neither tileset nor field in it
[[nodiscard]] Result<std::string> view_contents_json(const std::filesystem::path& folder);

}  // namespace maquette::tools
