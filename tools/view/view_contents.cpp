// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/view_contents.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/render.hpp"
#include "core/files.hpp"
#include "heightmap/grid_frame.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr int kDeepest = 4;
constexpr std::size_t kMostFiles = 20'000;  // a home folder given by mistake

std::string relative_name(const fs::path& folder, const fs::path& file) {
  return file.lexically_relative(folder).generic_string();
}

json name_if_there(const fs::path& folder, const fs::path& file) {
  std::error_code ec;
  return fs::is_regular_file(file, ec) ? json(relative_name(folder, file)) : json(nullptr);
}

/// Files in order of their names; of a run's and of lod's inner folders nothing is shown.
std::vector<fs::path> files_of(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code ec;
  fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, ec);
  for (; !ec && it != fs::recursive_directory_iterator(); it.increment(ec)) {
    const std::string name = it->path().filename().string();
    std::error_code ignored;
    if (it->is_directory(ignored)) {
      if (name == "tiles" || name == "subtrees" || name == "node_modules" || name[0] == '.' ||
          it.depth() + 1 >= kDeepest)
        it.disable_recursion_pending();
    } else if (it->is_regular_file(ignored) && name[0] != '.') {
      if (files.size() == kMostFiles) break;
      files.push_back(it->path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// By the names that our verbs give; masks and classes are no quantity to colour by.
const char* kind_of(const std::string& name) {
  if (name == "artefacts.tif" || name == "source.tif") return nullptr;
  if (name == "deviation.tif" || name.starts_with("residual")) return "signed";
  if (name == "sigma.tif" || name == "reach.tif" || name == "slope.tif" ||
      name.ends_with(".scallop.tif"))
    return "positive";
  return "height";
}

void add_field(json& fields, const fs::path& folder, const fs::path& file) {
  const char* kind = kind_of(file.filename().string());
  if (kind == nullptr) return;
  const auto frame = heightmap::read_grid_frame(file);
  if (!frame) return;
  fields.push_back({{"path", relative_name(folder, file)},
                    {"kind", kind},
                    {"unit", frame->unit.empty() ? "mm" : frame->unit},
                    {"nodes", {frame->cols, frame->rows}},
                    {"spacing_mm", frame->spacing.value()},
                    {"origin_mm", {frame->x0.value(), frame->y0.value()}}});
}

void add_frame(json& frames, const fs::path& folder, const fs::path& file) {
  const auto scene = read_scene(file);
  if (!scene) return;
  const Scene& s = **scene;
  if (s.resolution_px.size() != 2) return;
  const bool by_target = std::isfinite(s.camera_target_mm.x);
  const RigidTransform pose =
      by_target ? camera::look_at(s.camera_position_mm, s.camera_target_mm)
                : RigidTransform{normalized(s.camera_quaternion_wxyz), s.camera_position_mm};
  const Vec3 along = pose.direction({0.0, 0.0, -1.0}), up = pose.direction({0.0, 1.0, 0.0});
  if (!std::isfinite(along.x + along.y + along.z)) return;
  const double distance =
      by_target ? norm(s.camera_target_mm - s.camera_position_mm) : norm(s.camera_position_mm);
  const Vec3 target = s.camera_position_mm + distance * along;
  const auto vector = [](const Vec3& v) { return json{v.x, v.y, v.z}; };
  frames.push_back({{"scene", relative_name(folder, file)},
                    {"picture", name_if_there(folder, file.parent_path() / "picture.png")},
                    {"position_mm", vector(s.camera_position_mm)},
                    {"target_mm", vector(target)},
                    {"up", vector(up)},
                    {"across_mm", 1e-3 * s.pixel_pitch_um * s.resolution_px[0]},
                    {"down_mm", 1e-3 * s.pixel_pitch_um * s.resolution_px[1]},
                    {"focal_mm", s.focal_length_mm}});
}

}  // namespace

Result<std::string> view_contents_json(const fs::path& folder) {
  std::error_code ec;
  if (!fs::is_directory(folder, ec))
    return fail(kFileNotFound,
                fmt::format("{}: {}; expected a folder that `maquette lod` or `maquette run` has "
                            "written",
                            folder.string(),
                            fs::exists(folder, ec) ? "is not a folder" : "no such folder"));
  json j{{"schema", "maquette.view/1"},
         {"name", fs::canonical(folder, ec).filename().string()},
         {"manifest", name_if_there(folder, folder / "manifest.json")}};
  for (const char* list : {"tilesets", "fields", "plans", "paths", "frames", "reports"})
    j[list] = json::array();
  for (const fs::path& file : files_of(folder)) {
    const std::string name = file.filename().string();
    const fs::path here = file.parent_path();
    if (name == "tileset.json") {
      j["tilesets"].push_back({{"path", relative_name(folder, file)},
                               {"lod", name_if_there(folder, here / "lod.json")},
                               {"stones", name_if_there(folder, here / "stones.json")}});
    } else if (name == "stones.json" && !fs::exists(here / "tileset.json", ec)) {
      j["plans"].push_back(relative_name(folder, file));
    } else if (name == "paths.json") {
      j["paths"].push_back(relative_name(folder, file));
    } else if (name == "report.html") {
      j["reports"].push_back(relative_name(folder, file));
    } else if (file.extension() == ".tif") {
      add_field(j["fields"], folder, file);
    } else if (name == "scene.toml") {
      add_frame(j["frames"], folder, file);
    }
  }
  if (j["tilesets"].empty() && j["fields"].empty())
    return fail(
        kViewNothing,
        fmt::format("{}: holds neither a tileset.json nor a raster in the model frame; give "
                    "the folder of `maquette lod design.tif --out DIR` or of `maquette run "
                    "site.toml --out DIR`",
                    folder.string()));
  return j.dump(1, ' ', false, json::error_handler_t::replace);
}

}  // namespace maquette::tools
