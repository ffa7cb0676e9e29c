// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/calibration_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include <fmt/format.h>

#include "tools/row_file.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

constexpr double kInf = INFINITY;

void add_frames(Schema& s, const std::string& name, const std::string& doc,
                std::deque<FrameFiles>& to) {
  s.array(name, doc, [&to] {
    FrameFiles& f = to.emplace_back();
    Schema e;
    e.add({"images", &f.images, "at least two, raw: one channel", -kInf, kInf, {}, true});
    e.add({"exposure_s", &f.exposure_s, "", 1e-9, 1e6, {}, true});
    return e;
  });
}

}  // namespace

Result<CalibrationFile> read_calibration(const std::filesystem::path& path) {
  CalibrationFile c;
  Schema s;
  s.add({"schema", &c.schema_name, "", -kInf, kInf, {"maquette.calibration/1"}, true});
  s.add({"name", &c.name, "of the camera that is written"});
  s.add({"camera", &c.camera, "name or .toml: what no data show stays as it is there"});
  s.add({"set", &c.set, "key=value of that camera"});
  s.add(
      {"white_dn", &c.white_dn,
       "converter's number that a whole-number file's highest value stands for; 0: files hold the "
       "numbers themselves",
       0, 1e9});
  s.add({"temperature_c", &c.temperature_c, "of the sensor; absent: the camera's", -200, 150});
  s.section("targets", "points on a target, seen in pictures");
  s.add({"targets.points", &c.points, "CSV: X_mm,Y_mm,Z_mm,u_px,v_px,image"});
  s.add({"targets.distortion", &c.distortion, "", -kInf, kInf, {"brown_conrady", "quotient"}});
  s.add({"targets.coefficients", &c.coefficients, "how many are estimated", 0, 8});
  s.add({"targets.principal_point", &c.principal_point, "estimate it"});
  s.add({"targets.aspect", &c.aspect, "estimate fy / fx"});
  s.add({"targets.skew", &c.skew, "estimate it"});
  s.section("vignetting", "from [[flat]]");
  s.add({"vignetting.law", &c.vignetting_law, "", -kInf, kInf, {"polynomial", "barrel"}});
  s.add({"vignetting.cosine_power", &c.cosine_power, "given, not estimated", 0, 20});
  add_frames(s, "dark", "frames with the lens covered", c.dark);
  add_frames(s, "bright", "frames of a steady light, even where it is measured", c.bright);
  add_frames(s, "flat", "frames of an evenly lit surface through the lens", c.flat);
  MAQUETTE_TRY_VOID(s.read(path));
  if (c.dark.empty() && c.bright.empty() && c.flat.empty() && c.points.empty())
    return fail(kConfigInvalid,
                fmt::format("{}: nothing to calibrate from: [[dark]] and [[bright]], [targets] or "
                            "[[flat]] expected",
                            path.string()));
  for (const auto* list : {&c.dark, &c.bright, &c.flat})
    for (const FrameFiles& f : *list)
      if (f.images.size() < 2)
        return fail(kConfigInvalid,
                    fmt::format("{}: {} of {} s: one frame only; the scatter between at least two "
                                "of the same light is what is measured",
                                path.string(),
                                list == &c.dark     ? "[[dark]]"
                                : list == &c.bright ? "[[bright]]"
                                                    : "[[flat]]",
                                f.exposure_s));
  return c;
}

Result<TargetTable> read_targets(const std::filesystem::path& path) {
  TargetTable table;
  const auto row = [&](std::string_view line, int number, const auto& wrong) -> Result<void> {
    std::array<double, 5> v{};
    if (const std::size_t column = take_numbers(line, v, false))
      return wrong(fmt::format(
          "five finite numbers and a picture's name expected; column {} is none", column));
    const std::string image(line);
    if (image.empty()) return wrong("the picture's name is missing");
    auto known = std::find(table.images.begin(), table.images.end(), image);
    if (known == table.images.end()) known = table.images.insert(known, image);
    table.points.push_back(
        {{v[0], v[1], v[2]}, {v[3], v[4]}, static_cast<int>(known - table.images.begin())});
    table.lines.push_back(number);
    return {};
  };
  MAQUETTE_TRY_VOID(each_row(path, "X_mm,Y_mm,Z_mm,u_px,v_px,image", kTargetFile, row));
  if (table.points.empty())
    return fail(kTargetFile,
                fmt::format("{}: no point; one row a point and picture expected", path.string()));
  return table;
}

}  // namespace maquette::tools
