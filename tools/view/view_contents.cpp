// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/view_contents.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/render.hpp"
#include "core/files.hpp"
#include "heightmap/grid_frame.hpp"
#include "tools/scene_file.hpp"
#include "tools/trajectory_file.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr int kDeepest = 4;
constexpr std::size_t kMostPoses = 5000;    // of a trajectory
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

/// Relative to the folder; null for what is not there or lies elsewhere: that is not served.
json picture_inside(const fs::path& folder, const fs::path& file) {
  std::error_code ec;
  const fs::path root = fs::canonical(folder, ec), there = fs::canonical(file, ec);
  if (ec || !fs::is_regular_file(there, ec)) return nullptr;
  const std::string name = there.lexically_relative(root).generic_string();
  return name.starts_with("..") ? json(nullptr) : json(name);
}

struct Lens {
  double across_mm = 1.0, down_mm = 1.0, focal_mm = 1.0;
};

/// @param target  NaN: where the axis meets z = 0, or as far away as the model's origin is
json frame_of(const RigidTransform& pose, Vec3 target, const Lens& lens) {
  const Vec3 position = pose.translation_mm, along = pose.direction({0.0, 0.0, -1.0}),
             up = pose.direction({0.0, 1.0, 0.0});
  if (!std::isfinite(along.x + along.y + along.z)) return nullptr;
  if (!std::isfinite(target.x)) {
    const double down = along.z < 0.0 ? -position.z / along.z : -1.0;
    target = position + (down > 0.0 ? down : norm(position)) * along;
  }
  const auto vector = [](const Vec3& v) { return json{v.x, v.y, v.z}; };
  return {{"position_mm", vector(position)},
          {"target_mm", vector(target)},
          {"up", vector(up)},
          {"across_mm", lens.across_mm},
          {"down_mm", lens.down_mm},
          {"focal_mm", lens.focal_mm}};
}

void add(json& frames, json frame, const std::string& file, const std::string& name,
         const char* kind, json picture, bool linear) {
  if (frame.is_null()) return;
  frame["scene"] = file;
  frame["name"] = name;
  frame["kind"] = kind;
  frame["picture"] = std::move(picture);
  frame["linear"] = linear;
  frames.push_back(std::move(frame));
}

/// The picture of each pose, as `render` numbers them; empty: none was made.
std::vector<fs::path> trajectory_pictures(const fs::path& folder, std::size_t poses) {
  std::error_code ec;
  constexpr std::string_view kNote = "_frames.json";
  for (fs::directory_iterator it(folder, ec), end; !ec && it != end; it.increment(ec)) {
    const std::string name = it->path().filename().string();
    if (!name.ends_with(kNote)) continue;
    const auto text = read_file(it->path(), 1 << 16);
    const json note = text ? json::parse(*text, nullptr, false) : json();
    if (!note.is_object() || note.value("frames", std::size_t{0}) != poses) continue;
    std::vector<fs::path> pictures;
    for (std::size_t i = 1; i <= poses; ++i)
      pictures.push_back(
          folder / fmt::format("{}_{:04}.png", name.substr(0, name.size() - kNote.size()), i));
    return pictures;
  }
  return {};
}

void add_scene(json& frames, const fs::path& folder, const fs::path& file) {
  const auto scene = read_scene(file);
  if (!scene) return;
  const Scene& s = **scene;
  if (s.resolution_px.size() != 2) return;
  const std::string name = relative_name(folder, file);
  const Lens lens{1e-3 * s.pixel_pitch_um * s.resolution_px[0],
                  1e-3 * s.pixel_pitch_um * s.resolution_px[1], s.focal_length_mm};
  if (s.trajectory.empty()) {
    const bool by_target = std::isfinite(s.camera_target_mm.x);
    const RigidTransform pose =
        by_target ? camera::look_at(s.camera_position_mm, s.camera_target_mm)
                  : RigidTransform{normalized(s.camera_quaternion_wxyz), s.camera_position_mm};
    add(frames, frame_of(pose, s.camera_target_mm, lens), name, name, "scene",
        picture_inside(folder, file.parent_path() / "picture.png"), false);
    return;
  }
  const auto poses = read_trajectory(s.trajectory);
  if (!poses) return;
  const auto pictures = trajectory_pictures(file.parent_path(), poses->size());
  for (std::size_t i = 0; i < poses->size() && i < kMostPoses; ++i) {
    json frame = frame_of((*poses)[i].model_from_camera, {NAN, NAN, NAN}, lens);
    frame["time_s"] = (*poses)[i].time_s;
    add(frames, std::move(frame), name, fmt::format("{} {:04}", name, i + 1), "trajectory",
        pictures.empty() ? json(nullptr) : picture_inside(folder, pictures[i]), false);
  }
}

/// @param seen  photographs that another case has named
void add_photographs(json& frames, const fs::path& folder, const fs::path& file,
                     std::set<fs::path>& seen) {
  const auto c = read_case(file);
  if (!c) return;
  const std::string name = relative_name(folder, file);
  for (const CasePhoto& p : (*c)->photos) {
    std::error_code ec;
    if (p.resolution_px.size() != 2 || !seen.insert(fs::weakly_canonical(p.image, ec)).second)
      continue;
    json frame =
        frame_of({normalized(p.camera_quaternion_wxyz), p.camera_position_mm}, {NAN, NAN, NAN},
                 {1e-3 * p.pixel_pitch_um * p.resolution_px[0],
                  1e-3 * p.pixel_pitch_um * p.resolution_px[1], p.focal_length_mm});
    frame["held_out"] = p.held_out;
    add(frames, std::move(frame), name, fmt::format("{} {}", name, p.image.filename().string()),
        "photo", picture_inside(folder, p.image), p.encoding != "srgb");
  }
}

/// What a .toml file says that it is.
std::string schema_of(const fs::path& file) {
  const auto text = read_file(file, 1 << 20);
  if (!text) return {};
  for (const char* schema : {"maquette.scene/1", "maquette.case/1"})
    if (text->find(fmt::format("\"{}\"", schema)) != std::string::npos) return schema;
  return {};
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
  std::vector<fs::path> cases;
  for (const fs::path& file : files_of(folder)) {
    const std::string name = file.filename().string();
    const fs::path here = file.parent_path();
    // The implicit tileset is the same tiles once more: shown where it is the only one.
    if (name == "tileset.json" ||
        (name == "tileset_implicit.json" && !fs::exists(here / "tileset.json", ec))) {
      j["tilesets"].push_back({{"path", relative_name(folder, file)},
                               {"lod", name_if_there(folder, here / "lod.json")},
                               {"stones", name_if_there(folder, here / "stones.json")}});
    } else if (name == "stones.json" && !fs::exists(here / "tileset.json", ec) &&
               !fs::exists(here / "tileset_implicit.json", ec)) {
      j["plans"].push_back(relative_name(folder, file));
    } else if (name == "paths.json") {
      j["paths"].push_back(relative_name(folder, file));
    } else if (name == "report.html") {
      j["reports"].push_back(relative_name(folder, file));
    } else if (file.extension() == ".tif") {
      add_field(j["fields"], folder, file);
    } else if (file.extension() == ".toml") {
      const std::string schema = schema_of(file);
      if (schema == "maquette.scene/1") add_scene(j["frames"], folder, file);
      if (schema == "maquette.case/1") cases.push_back(file);
    }
  }
  // A diagnosis' extended.toml has the photographs of its case.
  std::stable_partition(cases.begin(), cases.end(),
                        [](const fs::path& f) { return f.filename() != "extended.toml"; });
  std::set<fs::path> photographs;
  for (const fs::path& file : cases) add_photographs(j["frames"], folder, file, photographs);
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
