// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/tool_table.hpp"

#include <algorithm>
#include <deque>

#include <fmt/format.h>

#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

constexpr double kInf = INFINITY;

struct HolderEntry {
  double height_mm = 0.0, lower_diameter_mm = 0.0, upper_diameter_mm = 0.0;
};
struct ToolEntry {
  std::int64_t number = 1, teeth = 2;
  std::string name, shape;
  double diameter_mm = 0.0, corner_radius_mm = NAN, flute_length_mm = 0.0, shank_diameter_mm = 0.0,
         stick_out_mm = 0.0;
  std::deque<HolderEntry> holder;  // its addresses stay
};

Schema holder_schema(HolderEntry& h) {
  Schema t;
  t.add({"height_mm", &h.height_mm, "", 0.01, 1000, {}, true});
  t.add({"lower_diameter_mm", &h.lower_diameter_mm, "", 0.01, 1000, {}, true});
  t.add({"upper_diameter_mm", &h.upper_diameter_mm, "", 0.01, 1000, {}, true});
  return t;
}

Schema tool_schema(ToolEntry& e) {
  Schema t;
  t.add({"number", &e.number, "T word", 1, 99999, {}, true});
  t.add({"name", &e.name, "for a person"});
  t.add({"shape", &e.shape, "of the cutting end", -kInf, kInf, {"ball", "bull", "flat"}, true});
  t.add({"diameter_mm", &e.diameter_mm, "of the flutes", 0.01, 500, {}, true});
  t.add({"corner_radius_mm", &e.corner_radius_mm, "of a bull nose", 0.001, 250});
  t.add({"teeth", &e.teeth, "", 1, 100});
  t.add({"flute_length_mm", &e.flute_length_mm, "above the tip", 0.01, 1000});
  t.add({"shank_diameter_mm", &e.shank_diameter_mm, "above the flutes", 0.01, 500});
  t.add({"stick_out_mm", &e.stick_out_mm, "tip to the holder's lower face", 0.01, 1000});
  t.array("holder", "frusta upwards", [&e] { return holder_schema(e.holder.emplace_back()); });
  return t;
}

/// What no single key can say about itself.
std::vector<std::string> contradictions(const ToolEntry& e) {
  std::vector<std::string> found;
  const auto say = [&](const std::string& what) {
    found.push_back(fmt::format("tool {}: {}", e.number, what));
  };
  const double radius = 0.5 * e.diameter_mm;
  if (e.shape == "bull" && !(e.corner_radius_mm < radius))
    say(fmt::format("a bull nose needs corner_radius_mm, below its radius of {} mm", radius));
  if (e.shape != "bull" && !std::isnan(e.corner_radius_mm))
    say(fmt::format("corner_radius_mm is of bull noses only, its shape is {}", e.shape));
  if (e.stick_out_mm > 0.0 && e.flute_length_mm == 0.0)
    say("stick_out_mm needs flute_length_mm: what is above the flutes must not touch anything");
  if (e.stick_out_mm > 0.0 && e.flute_length_mm > e.stick_out_mm)
    say(fmt::format("its flutes of {} mm are longer than it sticks out, {} mm", e.flute_length_mm,
                    e.stick_out_mm));
  if (!e.holder.empty() && e.stick_out_mm == 0.0)
    say("a holder needs stick_out_mm, the height of its lower face above the tip");
  return found;
}

cnc::Tool tool_of(const ToolEntry& e) {
  cnc::Tool tool;
  tool.number = static_cast<int>(e.number);
  tool.teeth = static_cast<int>(e.teeth);
  const double radius = 0.5 * e.diameter_mm;
  tool.cutter = e.shape == "ball"   ? cnc::Cutter::ball(radius)
                : e.shape == "flat" ? cnc::Cutter::flat(radius)
                                    : cnc::Cutter::bull(radius, e.corner_radius_mm);
  tool.cutter.flute_length_mm = e.flute_length_mm;
  tool.name = e.name.empty() ? shape_name(tool.cutter) : e.name;
  double at = e.flute_length_mm;
  if (e.stick_out_mm > at) {
    const double shank = e.shank_diameter_mm > 0.0 ? 0.5 * e.shank_diameter_mm : radius;
    tool.cutter.holder.push_back({at, e.stick_out_mm - at, shank, shank});
  }
  at = e.stick_out_mm;
  for (const HolderEntry& h : e.holder) {
    tool.cutter.holder.push_back(
        {at, h.height_mm, 0.5 * h.lower_diameter_mm, 0.5 * h.upper_diameter_mm});
    at += h.height_mm;
  }
  return tool;
}

}  // namespace

Result<std::vector<cnc::Tool>> read_tool_table(const std::filesystem::path& file) {
  std::deque<ToolEntry> entries;
  Schema t;
  std::string schema = "maquette.tools/1";
  t.add({"schema", &schema, "version of this file's keys", -kInf, kInf, {"maquette.tools/1"}});
  t.array("tool", "", [&] { return tool_schema(entries.emplace_back()); });
  MAQUETTE_TRY_VOID(t.read(file));
  std::vector<std::string> found;
  std::vector<cnc::Tool> tools;
  for (const ToolEntry& e : entries) {
    for (const std::string& f : contradictions(e)) found.push_back(f);
    for (const cnc::Tool& other : tools)
      if (other.number == e.number)
        found.push_back(fmt::format("tool {} is there twice", e.number));
    tools.push_back(tool_of(e));
  }
  if (tools.empty()) found.emplace_back("no [[tool]] is there");
  if (!found.empty())
    return fail(kConfigInvalid,
                fmt::format("{}: {}", file.string(),
                            fmt::join(found, fmt::format("\n{}: ", file.string()))));
  return tools;
}

std::string tool_table_text(std::span<const cnc::Tool> tools) {
  std::string text =
      "# Tools of the programs beside this file. Add stick_out_mm, flute_length_mm and holders\n"
      "# (docs/tool_table.md) to have shank and holder looked at by `maquette verify --tools`.\n"
      "schema = \"maquette.tools/1\"\n";
  for (const cnc::Tool& tool : tools) {
    const cnc::Cutter& c = tool.cutter;
    text +=
        fmt::format("\n[[tool]]\nnumber = {}\nname = \"{}\"\nshape = \"{}\"\ndiameter_mm = {}\n",
                    tool.number, tool.name.empty() ? shape_name(c) : tool.name,
                    c.is_ball()                ? "ball"
                    : c.corner_radius_mm > 0.0 ? "bull"
                                               : "flat",
                    2.0 * c.radius_mm);
    if (!c.is_ball() && c.corner_radius_mm > 0.0)
      text += fmt::format("corner_radius_mm = {}\n", c.corner_radius_mm);
    text += fmt::format("teeth = {}\n", tool.teeth);
    if (c.flute_length_mm > 0.0) text += fmt::format("flute_length_mm = {}\n", c.flute_length_mm);
    bool shank = true;
    for (const cnc::HolderPart& part : c.holder) {
      const bool is_shank = shank && part.bottom_mm == c.flute_length_mm &&
                            part.bottom_radius_mm == part.top_radius_mm;
      if (is_shank)
        text += fmt::format("shank_diameter_mm = {}\nstick_out_mm = {}\n",
                            2.0 * part.bottom_radius_mm, part.bottom_mm + part.height_mm);
      else
        text += fmt::format(
            "[[tool.holder]]\nheight_mm = {}\nlower_diameter_mm = {}\nupper_diameter_mm = {}\n",
            part.height_mm, 2.0 * part.bottom_radius_mm, 2.0 * part.top_radius_mm);
      shank = false;
    }
  }
  return text;
}

double gauge_length_mm(const cnc::Tool& tool) {
  double top = 0.0;
  for (const cnc::HolderPart& part : tool.cutter.holder)
    top = std::max(top, part.bottom_mm + part.height_mm);
  return top;
}

std::string shape_name(const cnc::Cutter& c) {
  return fmt::format("{} {} mm",
                     c.is_ball()                ? "ball nose"
                     : c.corner_radius_mm > 0.0 ? "bull nose"
                                                : "flat",
                     2.0 * c.radius_mm);
}

}  // namespace maquette::tools
