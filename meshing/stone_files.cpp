// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/check.hpp"
#include "core/files.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"

namespace maquette::meshing {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
constexpr std::string_view kSchema = "maquette.stones/1";
constexpr std::size_t kLargestPlan = std::size_t{64} << 20;

// ---- reading -----------------------------------------------------------------

/// A value and the path to it, for messages.
struct Node {
  const Json* value;
  std::string path;  ///< "/stones/3/shape"
};

tl::unexpected<Error> bad(const Node& node, std::string_view expected) {
  return fail(kStonePlanFormat,
              fmt::format("{}: {} expected", node.path.empty() ? "/" : node.path, expected));
}

/// An object with these keys, no fewer and no more, but for one that may be missing.
Result<void> expect_keys(const Node& node, std::initializer_list<std::string_view> keys,
                         std::string_view optional = {}) {
  if (!node.value->is_object()) return bad(node, "object");
  for (const std::string_view key : keys)
    if (!node.value->contains(key))
      return fail(kStonePlanFormat, fmt::format("{}/{}: key is missing", node.path, key));
  for (const auto& item : node.value->items())
    if (item.key() != optional && std::find(keys.begin(), keys.end(), item.key()) == keys.end())
      return fail(kStonePlanFormat, fmt::format("{}/{}: unknown key", node.path, item.key()));
  return {};
}

Node child(const Node& node, std::string_view key) {
  return {&(*node.value)[std::string(key)], fmt::format("{}/{}", node.path, key)};
}

Result<double> number(const Node& node, double min, double max) {
  const double x = node.value->is_number() ? node.value->get<double>() : NAN;
  if (!(x >= min && x <= max))
    return bad(node, std::isfinite(max) ? fmt::format("number within {} .. {}", min, max)
                                        : std::string("number"));
  return x;
}

constexpr double kAny = std::numeric_limits<double>::max();

Result<int> integer(const Node& node, int min, int max) {
  if (!node.value->is_number_integer()) return bad(node, "integer");
  MAQUETTE_TRY(const double x, number(node, min, max));
  return static_cast<int>(x);
}

Result<std::vector<double>> numbers(const Node& node, std::size_t count) {
  if (!node.value->is_array() || node.value->size() != count)
    return bad(node, fmt::format("array of {} numbers", count));
  std::vector<double> all;
  for (std::size_t i = 0; i < count; ++i) {
    MAQUETTE_TRY(const double x,
                 number({&(*node.value)[i], fmt::format("{}/{}", node.path, i)}, -kAny, kAny));
    all.push_back(x);
  }
  return all;
}

Result<std::string> text(const Node& node) {
  if (!node.value->is_string()) return bad(node, "text");
  return node.value->get<std::string>();
}

/// A name that stays within the folder of bodies.
Result<std::string> body_name(const Node& node) {
  MAQUETTE_TRY(auto name, text(node));
  if (name.empty() || name.front() == '.' || name.find('/') != std::string::npos)
    return bad(node, "name of a file in stone_bodies without its extension");
  return name;
}

fs::path body_path(const fs::path& plan, const std::string& name) {
  return plan.parent_path() / "stone_bodies" / (name + ".ply");
}

Result<StoneBodyPtr> body_from(const Node& node, const fs::path& plan) {
  MAQUETTE_TRY_VOID(expect_keys(node, {"name", "sha256", "source", "source_sha256", "mm_per_unit",
                                       "diameter_mm", "volume_mm3", "repairs"}));
  auto body = std::make_shared<StoneBody>();
  MAQUETTE_TRY(body->name, body_name(child(node, "name")));
  MAQUETTE_TRY(body->source, text(child(node, "source")));
  MAQUETTE_TRY(body->source_sha256, text(child(node, "source_sha256")));
  MAQUETTE_TRY(body->repairs, text(child(node, "repairs")));
  MAQUETTE_TRY(body->mm_per_unit, number(child(node, "mm_per_unit"), 0.0, kAny));
  MAQUETTE_TRY(body->diameter_mm, number(child(node, "diameter_mm"), 0.0, kAny));
  MAQUETTE_TRY(body->volume_mm3, number(child(node, "volume_mm3"), 0.0, kAny));
  const fs::path file = body_path(plan, body->name);
  MAQUETTE_TRY(const std::string hash, sha256_file(file));
  const Node stated = child(node, "sha256");
  if (!stated.value->is_string() || stated.value->get_ref<const std::string&>() != hash)
    return fail(kStonePlanFormat,
                fmt::format("{}: {} is not the file that the plan was written with; write both "
                            "again with `maquette stones`",
                            stated.path, file.string()));
  MAQUETTE_TRY(body->mesh, read_mesh(file));
  return body;
}

Result<assets::RockShape> shape_from(const Node& node) {
  MAQUETTE_TRY_VOID(expect_keys(
      node, {"angularity", "flatness", "elongation", "roughness", "seed", "subdivisions"}));
  assets::RockShape shape;
  MAQUETTE_TRY(shape.angularity, number(child(node, "angularity"), 0.0, 1.0));
  MAQUETTE_TRY(shape.flatness, number(child(node, "flatness"), 0.3, 1.0));
  MAQUETTE_TRY(shape.elongation, number(child(node, "elongation"), 0.4, 1.0));
  MAQUETTE_TRY(shape.roughness, number(child(node, "roughness"), 0.0, 0.1));
  MAQUETTE_TRY(shape.subdivisions, integer(child(node, "subdivisions"), 0, 7));
  const Node seed = child(node, "seed");
  if (!seed.value->is_number_unsigned()) return bad(seed, "integer within 0 .. 2^64 - 1");
  shape.seed = seed.value->get<std::uint64_t>();
  return shape;
}

Result<PlacedStone> stone_from(const Node& node, const std::vector<StoneBodyPtr>& bodies) {
  MAQUETTE_TRY_VOID(expect_keys(node, {"number", "shape", "scale_mm", "rotation_wxyz",
                                       "translation_mm", "embedded_depth_mm"}));
  PlacedStone stone;
  MAQUETTE_TRY(stone.number, integer(child(node, "number"), 1, std::numeric_limits<int>::max()));
  const Node shape = child(node, "shape");
  if (shape.value->is_object() && shape.value->contains("body")) {
    MAQUETTE_TRY_VOID(expect_keys(shape, {"body"}));
    MAQUETTE_TRY(const std::string name, text(child(shape, "body")));
    const auto body = std::find_if(bodies.begin(), bodies.end(),
                                   [&](const StoneBodyPtr& b) { return b->name == name; });
    if (body == bodies.end()) return bad(child(shape, "body"), "name of one of /bodies");
    stone.body = *body;
  } else {
    MAQUETTE_TRY(stone.shape, shape_from(shape));
  }
  const Node scale = child(node, "scale_mm");
  MAQUETTE_TRY(stone.scale_mm, number(scale, 0.0, kAny));
  if (stone.scale_mm == 0.0) return bad(scale, "number above 0");
  const Node rotation = child(node, "rotation_wxyz");
  MAQUETTE_TRY(const auto q, numbers(rotation, 4));
  const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(std::abs(length - 1.0) < 1e-6)) return bad(rotation, "quaternion of length 1");
  MAQUETTE_TRY(const auto t, numbers(child(node, "translation_mm"), 3));
  stone.model_from_stone = {.rotation = {q[0], q[1], q[2], q[3]},
                            .translation_mm = {t[0], t[1], t[2]}};
  MAQUETTE_TRY(stone.embedded_depth_mm, number(child(node, "embedded_depth_mm"), -kAny, kAny));
  return stone;
}

Result<std::vector<PlacedStone>> plan_from(const Json& plan, const fs::path& path) {
  const Node root{&plan, ""};
  MAQUETTE_TRY_VOID(expect_keys(root, {"schema", "frame", "unit", "stones"}, "bodies"));
  const auto expect_text = [&](std::string_view key, std::string_view text) -> Result<void> {
    const Node node = child(root, key);
    if (!node.value->is_string() || node.value->get_ref<const std::string&>() != text)
      return bad(node, fmt::format("\"{}\"", text));
    return {};
  };
  MAQUETTE_TRY_VOID(expect_text("schema", kSchema));
  MAQUETTE_TRY_VOID(expect_text("frame", "model"));
  MAQUETTE_TRY_VOID(expect_text("unit", "mm"));
  std::vector<StoneBodyPtr> bodies;
  if (plan.contains("bodies")) {
    const Node all = child(root, "bodies");
    if (!all.value->is_array()) return bad(all, "array");
    for (std::size_t i = 0; i < all.value->size(); ++i) {
      MAQUETTE_TRY(auto body,
                   body_from({&(*all.value)[i], fmt::format("{}/{}", all.path, i)}, path));
      bodies.push_back(std::move(body));
    }
  }
  const Node list = child(root, "stones");
  if (!list.value->is_array()) return bad(list, "array");
  std::vector<PlacedStone> stones;
  for (std::size_t i = 0; i < list.value->size(); ++i) {
    MAQUETTE_TRY(auto stone,
                 stone_from({&(*list.value)[i], fmt::format("{}/{}", list.path, i)}, bodies));
    stones.push_back(std::move(stone));
  }
  return stones;
}

/// "line 3, column 7" of a byte counted from 1.
std::string place(std::string_view text, std::size_t byte) {
  const std::string_view before = text.substr(0, byte > 0 ? std::min(byte - 1, text.size()) : 0);
  const auto line = 1 + std::count(before.begin(), before.end(), '\n');
  const std::size_t start = before.rfind('\n') + 1;  // npos + 1 is 0
  return fmt::format("line {}, column {}", line, before.size() - start + 1);
}

Result<Json> parse(std::string_view text) {
  try {
    return Json::parse(text);
  } catch (const Json::parse_error& e) {
    return fail(kStonePlanFormat, fmt::format("{}: not JSON: {}", place(text, e.byte), e.what()));
  } catch (const Json::exception& e) {  // a number beyond double, for example
    return fail(kStonePlanFormat, fmt::format("not JSON: {}", e.what()));
  }
}

// ---- writing -----------------------------------------------------------------

void check_finite(const PlacedStone& s) {
  const auto& [q, t] = s.model_from_stone;
  for (const double x :
       {s.shape.angularity, s.shape.flatness, s.shape.elongation, s.shape.roughness, s.scale_mm,
        q.w, q.x, q.y, q.z, t.x, t.y, t.z, s.embedded_depth_mm})
    MAQUETTE_CHECK(std::isfinite(x), "stone {}", s.number);
}

/// Each once, in order of first appearance.
std::vector<const StoneBody*> bodies_of(std::span<const PlacedStone> stones) {
  std::vector<const StoneBody*> all;
  for (const PlacedStone& s : stones) {
    if (s.body == nullptr) continue;
    const auto known = std::find_if(all.begin(), all.end(),
                                    [&](const StoneBody* b) { return b->name == s.body->name; });
    if (known == all.end())
      all.push_back(s.body.get());
    else
      MAQUETTE_CHECK(*known == s.body.get() || **known == *s.body, "two bodies are called {}",
                     s.body->name);
  }
  return all;
}

Result<Json> write_bodies(const std::vector<const StoneBody*>& bodies, const fs::path& plan) {
  Json list = Json::array();
  std::error_code ec;
  const fs::path folder = plan.parent_path() / "stone_bodies";
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  for (const StoneBody* body : bodies) {
    const fs::path file = body_path(plan, body->name);
    MAQUETTE_TRY_VOID(write_ply(body->mesh, file));
    MAQUETTE_TRY(const std::string hash, sha256_file(file));
    list.push_back({{"name", body->name},
                    {"sha256", hash},
                    {"source", body->source},
                    {"source_sha256", body->source_sha256},
                    {"mm_per_unit", body->mm_per_unit},
                    {"diameter_mm", body->diameter_mm},
                    {"volume_mm3", body->volume_mm3},
                    {"repairs", body->repairs}});
  }
  return list;
}

Json shape_json(const PlacedStone& s) {
  if (s.body != nullptr) return {{"body", s.body->name}};
  return {{"angularity", s.shape.angularity},
          {"flatness", s.shape.flatness},
          {"elongation", s.shape.elongation},
          {"roughness", s.shape.roughness},
          {"seed", s.shape.seed},
          {"subdivisions", s.shape.subdivisions}};
}

}  // namespace

Result<void> write_stone_plan(std::span<const PlacedStone> stones,
                              const std::filesystem::path& path) {
  Json list = Json::array();
  for (const PlacedStone& s : stones) {
    check_finite(s);
    const auto& [q, t] = s.model_from_stone;
    list.push_back({{"number", s.number},
                    {"shape", shape_json(s)},
                    {"scale_mm", s.scale_mm},
                    {"rotation_wxyz", {q.w, q.x, q.y, q.z}},
                    {"translation_mm", {t.x, t.y, t.z}},
                    {"embedded_depth_mm", s.embedded_depth_mm}});
  }
  Json plan{{"schema", kSchema}, {"frame", "model"}, {"unit", "mm"}};
  if (const auto bodies = bodies_of(stones); !bodies.empty()) {
    MAQUETTE_TRY(plan["bodies"], write_bodies(bodies, path));
  }
  plan["stones"] = std::move(list);
  return write_file(path, plan.dump(1) + "\n");
}

std::vector<fs::path> stone_body_files(std::span<const PlacedStone> stones, const fs::path& path) {
  std::vector<fs::path> files;
  for (const StoneBody* body : bodies_of(stones)) files.push_back(body_path(path, body->name));
  return files;
}

Result<std::vector<PlacedStone>> read_stone_plan(const std::filesystem::path& path) {
  MAQUETTE_TRY(const std::string text, read_file(path, kLargestPlan));
  auto stones = parse(text).and_then([&](const Json& plan) { return plan_from(plan, path); });
  if (!stones) return tl::unexpected(std::move(stones).error().within(path.string()));
  return stones;
}

Result<void> write_stone_table(std::span<const PlacedStone> stones,
                               const std::filesystem::path& path) {
  std::string table = "number,x_mm,y_mm,z_mm,qw,qx,qy,qz,diameter_mm,embedded_depth_mm\n";
  for (const PlacedStone& s : stones) {
    check_finite(s);
    const auto& [q, t] = s.model_from_stone;
    table +=
        fmt::format("{},{:.4f},{:.4f},{:.4f},{:.9f},{:.9f},{:.9f},{:.9f},{:.4f},{:.4f}\n", s.number,
                    t.x, t.y, t.z, q.w, q.x, q.y, q.z, s.scale_mm, s.embedded_depth_mm);
  }
  return write_file(path, table);
}

}  // namespace maquette::meshing
