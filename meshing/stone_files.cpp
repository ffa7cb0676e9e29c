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
#include "meshing/stones.hpp"

namespace maquette::meshing {
namespace {

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

/// An object with these keys, no fewer and no more.
Result<void> expect_keys(const Node& node, std::initializer_list<std::string_view> keys) {
  if (!node.value->is_object()) return bad(node, "object");
  for (const std::string_view key : keys)
    if (!node.value->contains(key))
      return fail(kStonePlanFormat, fmt::format("{}/{}: key is missing", node.path, key));
  for (const auto& item : node.value->items())
    if (std::find(keys.begin(), keys.end(), item.key()) == keys.end())
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

Result<PlacedStone> stone_from(const Node& node) {
  MAQUETTE_TRY_VOID(expect_keys(node, {"number", "shape", "scale_mm", "rotation_wxyz",
                                       "translation_mm", "embedded_depth_mm"}));
  PlacedStone stone;
  MAQUETTE_TRY(stone.number, integer(child(node, "number"), 1, std::numeric_limits<int>::max()));
  MAQUETTE_TRY(stone.shape, shape_from(child(node, "shape")));
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

Result<std::vector<PlacedStone>> plan_from(const Json& plan) {
  const Node root{&plan, ""};
  MAQUETTE_TRY_VOID(expect_keys(root, {"schema", "frame", "unit", "stones"}));
  const auto expect_text = [&](std::string_view key, std::string_view text) -> Result<void> {
    const Node node = child(root, key);
    if (!node.value->is_string() || node.value->get_ref<const std::string&>() != text)
      return bad(node, fmt::format("\"{}\"", text));
    return {};
  };
  MAQUETTE_TRY_VOID(expect_text("schema", kSchema));
  MAQUETTE_TRY_VOID(expect_text("frame", "model"));
  MAQUETTE_TRY_VOID(expect_text("unit", "mm"));
  const Node list = child(root, "stones");
  if (!list.value->is_array()) return bad(list, "array");
  std::vector<PlacedStone> stones;
  for (std::size_t i = 0; i < list.value->size(); ++i) {
    MAQUETTE_TRY(auto stone, stone_from({&(*list.value)[i], fmt::format("{}/{}", list.path, i)}));
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

}  // namespace

Result<void> write_stone_plan(std::span<const PlacedStone> stones,
                              const std::filesystem::path& path) {
  Json list = Json::array();
  for (const PlacedStone& s : stones) {
    check_finite(s);
    const auto& [q, t] = s.model_from_stone;
    list.push_back({{"number", s.number},
                    {"shape",
                     {{"angularity", s.shape.angularity},
                      {"flatness", s.shape.flatness},
                      {"elongation", s.shape.elongation},
                      {"roughness", s.shape.roughness},
                      {"seed", s.shape.seed},
                      {"subdivisions", s.shape.subdivisions}}},
                    {"scale_mm", s.scale_mm},
                    {"rotation_wxyz", {q.w, q.x, q.y, q.z}},
                    {"translation_mm", {t.x, t.y, t.z}},
                    {"embedded_depth_mm", s.embedded_depth_mm}});
  }
  const Json plan{{"schema", kSchema}, {"frame", "model"}, {"unit", "mm"}, {"stones", list}};
  return write_file(path, plan.dump(1) + "\n");
}

Result<std::vector<PlacedStone>> read_stone_plan(const std::filesystem::path& path) {
  MAQUETTE_TRY(const std::string text, read_file(path, kLargestPlan));
  auto stones = parse(text).and_then(plan_from);
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
