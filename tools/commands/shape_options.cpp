// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/commands/shape_options.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "tools/commands/commands.hpp"

namespace maquette::tools {
namespace {

constexpr std::array kSides{"south", "east", "north", "west"};  // as meshing::WallSide

}  // namespace

void add_shape_options(CLI::App& app, ShapeOptions& o, const std::string& label_help) {
  auto* hollow = app.add_option("--hollow-mm", o.hollow_mm,
                                "opens the underside, leaves walls at least that thick")
                     ->check(CLI::Range(0.1, 1000.0));
  o.given.push_back(hollow);
  const auto hollow_only = [&](const char* name, double& value, double least, double most,
                               const char* help) {
    o.given.push_back(app.add_option(name, value, help)
                          ->capture_default_str()
                          ->check(CLI::Range(least, most))
                          ->needs(hollow));
  };
  hollow_only("--rib-mm", o.rib_mm, 0.1, 1000.0, "thickness of ribs between pockets");
  hollow_only("--pocket-mm", o.pocket_mm, 1.0, 1e4, "widest pocket between ribs");
  hollow_only("--ceiling-step-mm", o.ceiling_step_mm, 0.0, 1000.0,
              "widest triangles of the pockets' ceilings (0: four spacings of the design)");
  o.given.push_back(app.add_option("--label", o.label, label_help));
  o.given.push_back(app.add_option("--scale-bar", o.scale_bar,
                                   "N of 1:N: engraves a bar of a round length on the ground")
                        ->check(CLI::Range(1e-3, 1e12)));
  o.given.push_back(
      app.add_option("--label-side", o.side, "wall that is engraved")
          ->capture_default_str()
          ->check(CLI::IsMember(std::vector<std::string>(kSides.begin(), kSides.end()))));
  const auto engraved_only = [&](const char* name, double& value, double least, const char* help) {
    o.given.push_back(
        app.add_option(name, value, help)->capture_default_str()->check(CLI::Range(least, 1000.0)));
  };
  engraved_only("--letter-mm", o.letter_mm, 0.1, "height of engraved capitals");
  engraved_only("--engrave-depth-mm", o.depth_mm, 0.02, "of engraved strokes");
  engraved_only("--stroke-mm", o.stroke_mm, 0.0,
                "width of engraved strokes (0: an eighth of the letters' height)");
}

Result<void> take_shape_options(const ShapeOptions& o, Shape& shape) {
  const auto is_given = [&](const std::string& name) {
    return std::any_of(o.given.begin(), o.given.end(), [&](const CLI::Option* option) {
      return option->count() > 0 && option->check_lname(name);
    });
  };
  if (is_given("label") && o.label.empty())
    return fail(kUsage, "--label: an empty text; leave it out, or say what to engrave");
  if (!is_given("label") && !is_given("scale-bar"))
    for (const char* name : {"label-side", "letter-mm", "engrave-depth-mm", "stroke-mm"})
      if (is_given(name))
        return fail(kUsage,
                    fmt::format("--{} is of --label or --scale-bar; give one of them", name));
  if (o.hollow_mm > 0.0)
    shape.hollow = {.wall = Millimetres{o.hollow_mm},
                    .rib = Millimetres{o.rib_mm},
                    .pocket = Millimetres{o.pocket_mm},
                    .step = Millimetres{o.ceiling_step_mm}};
  shape.label = o.label;
  shape.scale_denominator = o.scale_bar;
  const auto side = std::find(kSides.begin(), kSides.end(), o.side) - kSides.begin();
  shape.engraving = {.side = static_cast<meshing::WallSide>(side),
                     .letter = Millimetres{o.letter_mm},
                     .depth = Millimetres{o.depth_mm},
                     .stroke = Millimetres{o.stroke_mm}};
  return {};
}

}  // namespace maquette::tools
