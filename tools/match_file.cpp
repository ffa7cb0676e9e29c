// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/match_file.hpp"

#include <algorithm>
#include <set>
#include <sstream>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "core/files.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
namespace {

constexpr double kInf = INFINITY;

/// Strings that name a file beside the scene name it from another folder.
void move_paths(toml::node& node, const fs::path& from, const fs::path& to) {
  if (auto* table = node.as_table()) {
    for (auto&& [key, value] : *table) move_paths(value, from, to);
  } else if (auto* array = node.as_array()) {
    for (auto&& value : *array) move_paths(value, from, to);
  } else if (auto* text = node.as_string()) {
    const fs::path path(text->get());
    std::error_code ignored;
    if (path.empty() || path.is_absolute() || !fs::is_regular_file(from / path, ignored)) return;
    *text = fs::proximate(from / path, to, ignored).generic_string();
  }
}

}  // namespace

Result<MatchFile> read_match(const fs::path& path) {
  MatchFile m;
  Schema s;
  s.add({"schema", &m.schema_name, "", -kInf, kInf, {"maquette.match/1"}, true});
  s.add({"scene",
         &m.scene,
         "what `render` takes: surface, lamp and camera to start with",
         -kInf,
         kInf,
         {},
         true});
  s.add({"search",
         &m.search,
         "",
         -kInf,
         kInf,
         {"exposure", "exposure_each", "white_balance", "lamp_position", "lamp_brightness", "pose"},
         true});
  s.add({"finest_px", &m.finest_px, "pictures are rendered no wider than this", 64, 100000});
  s.array("photo", "photographs by the scene's camera", [&m] {
    MatchFilePhoto& p = m.photos.emplace_back();
    Schema e;
    e.add({"image", &p.image, "8 bits: sRGB, else linear", -kInf, kInf, {}, true});
    e.add({"camera_position_mm", &p.camera_position_mm, "the scene's unless given"});
    e.add({"camera_quaternion_wxyz", &p.camera_quaternion_wxyz, "model_from_camera", -1, 1});
    e.add({"camera_target_mm", &p.camera_target_mm, "looked at, instead of the quaternion"});
    e.add({"exposure_scale", &p.exposure_scale, "0: the scene's", 0, 1e9});
    e.add({"held_out", &p.held_out, "has no part in the search, is compared with what was found"});
    return e;
  });
  MAQUETTE_TRY_VOID(s.read(path));
  const auto wrong = [&](const std::string& what) {
    return fail(kConfigInvalid, fmt::format("{}: {}", path.string(), what));
  };
  if (std::all_of(m.photos.begin(), m.photos.end(), [](const auto& p) { return p.held_out; }))
    return wrong("no [[photo]] that is not held out: nothing to search in");
  std::set<std::string> stems;
  for (const MatchFilePhoto& p : m.photos)
    if (!stems.insert(p.image.stem().string()).second)
      return wrong(
          fmt::format("two photographs are called {}; each is to have a scene file of its "
                      "name",
                      p.image.stem().string()));
  const auto wanted = [&](const char* what) {
    return std::find(m.search.begin(), m.search.end(), what) != m.search.end();
  };
  if (wanted("exposure") && wanted("exposure_each"))
    return wrong("search: exposure is one factor for all, exposure_each one for each; take one");
  return m;
}

Result<void> write_changed_scene(const fs::path& scene, const SceneChanges& changes,
                                 const fs::path& to) {
  MAQUETTE_TRY(const std::string text, read_file(scene));
  toml::table table;
  try {
    table = toml::parse(text, scene.string());
  } catch (const toml::parse_error& e) {
    return fail(kConfigSyntax, fmt::format("{}: {}", scene.string(), e.description()));
  }
  for (const std::string& key : changes.without) table.erase(key);
  move_paths(table, scene.parent_path(), to.parent_path());
  for (const auto& [key, list] : changes.lists) {
    toml::array values;
    for (const double v : list) values.push_back(v);
    table.insert_or_assign(key, std::move(values));
  }
  for (const auto& [key, value] : changes.numbers) table.insert_or_assign(key, value);
  std::ostringstream out;
  out << table << "\n";
  return write_file(to, out.str());
}

}  // namespace maquette::tools
