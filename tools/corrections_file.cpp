// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/corrections_file.hpp"

#include <array>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <numbers>

#include <fmt/format.h>

#include "core/files.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

std::string list(Vec3 v) {
  return fmt::format("[{:.17g}, {:.17g}, {:.17g}]", v.x, v.y, v.z);
}

/// A number of TOML has a point or an exponent.
std::string number(double v) {
  const std::string text = fmt::format("{:.17g}", v);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

}  // namespace

std::string corrections_text(const Corrections& c) {
  const Quaternion& q = c.actual_from_planned.rotation;
  std::string text = fmt::format(
      "# Where the part and the axes really are; maquette render takes it.\n"
      "schema = \"maquette.corrections/1\"\n\n[surface]\n"
      "rotation_wxyz = [{:.17g}, {:.17g}, {:.17g}, {:.17g}]\ntranslation_mm = {}\n"
      "sigma_translation_mm = {}\nsigma_rotation_deg = {}\n",
      q.w, q.x, q.y, q.z, list(c.actual_from_planned.translation_mm),
      number(c.sigma_translation_mm), number(kDegrees * c.sigma_rotation_rad));
  for (const AxisCorrection& a : c.axes)
    text += fmt::format(
        "\n[[axis]]\nname = \"{}\"\norigin_mm = {}\ndirection = {}\nscale = {}\n"
        "sigma_origin_mm = {}\nsigma_direction_deg = {}\nsigma_scale = {}\nstraightness_mm = {}\n",
        a.name, list(a.fit.origin_mm), list(a.fit.direction), number(a.fit.scale),
        number(a.fit.sigma_origin_mm.x), number(kDegrees * a.fit.sigma_direction_rad),
        number(a.fit.sigma_scale), number(a.fit.straightness_mm));
  return text;
}

Result<Corrections> read_corrections(const std::filesystem::path& file) {
  struct Axis {
    std::string name;
    Vec3 origin_mm, direction{1.0, 0.0, 0.0};
    double scale = 1.0, sigma_origin = 0.0, sigma_direction_deg = 0.0, sigma_scale = 0.0,
           straightness = 0.0;
  };
  Corrections c;
  std::deque<Axis> axes;  // their addresses stay
  std::string schema = "maquette.corrections/1";
  double sigma_rotation_deg = 0.0;
  Schema t;
  t.add({"schema", &schema, "", -INFINITY, INFINITY, {"maquette.corrections/1"}});
  t.add({"surface.rotation_wxyz", &c.actual_from_planned.rotation, "", -1, 1});
  t.add({"surface.translation_mm", &c.actual_from_planned.translation_mm, "", -1e6, 1e6});
  t.add({"surface.sigma_translation_mm", &c.sigma_translation_mm, "", 0, 1e6});
  t.add({"surface.sigma_rotation_deg", &sigma_rotation_deg, "", 0, 360});
  t.array("axis", "linear axes", [&axes] {
    Axis& a = axes.emplace_back();
    Schema s;
    s.add({"name", &a.name, ""});
    s.add({"origin_mm", &a.origin_mm, "of the mark at position 0", -1e6, 1e6, {}, true});
    s.add({"direction", &a.direction, "unit", -1, 1, {}, true});
    s.add({"scale", &a.scale, "mm of travel per mm shown", 1e-3, 1e3});
    s.add({"sigma_origin_mm", &a.sigma_origin, "", 0, 1e6});
    s.add({"sigma_direction_deg", &a.sigma_direction_deg, "", 0, 360});
    s.add({"sigma_scale", &a.sigma_scale, "", 0, 1e3});
    s.add({"straightness_mm", &a.straightness, "", 0, 1e6});
    return s;
  });
  MAQUETTE_TRY_VOID(t.read(file));
  const Quaternion& q = c.actual_from_planned.rotation;
  const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  if (!(std::abs(length - 1.0) < 1e-6))
    return fail(kConfigInvalid, fmt::format("{}: surface.rotation_wxyz must be a unit quaternion, "
                                            "its length is {}",
                                            file.string(), length));
  c.sigma_rotation_rad = sigma_rotation_deg / kDegrees;
  for (const Axis& a : axes) {
    if (!(std::abs(norm(a.direction) - 1.0) < 1e-6))
      return fail(kConfigInvalid, fmt::format("{}: the direction of axis {} must be a unit vector",
                                              file.string(), a.name));
    scan::AxisFit fit;
    fit.origin_mm = a.origin_mm;
    fit.direction = a.direction;
    fit.scale = a.scale;
    fit.sigma_origin_mm = {a.sigma_origin, a.sigma_origin, a.sigma_origin};
    fit.sigma_direction_rad = a.sigma_direction_deg / kDegrees;
    fit.sigma_scale = a.sigma_scale;
    fit.straightness_mm = a.straightness;
    c.axes.push_back({a.name, fit});
  }
  return c;
}

Result<scan::AxisFit> read_axis_stops(const std::filesystem::path& csv) {
  MAQUETTE_TRY(const std::string text, read_file(csv));
  std::vector<scan::AxisStop> stops;
  std::size_t line = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string row = text.substr(at, end - at);
    at = end + 1;
    ++line;
    if (line == 1 || row.find_first_not_of(" \t\r") == std::string::npos) continue;
    std::array<double, 4> v{};
    const char* from = row.c_str();
    for (std::size_t k = 0; k < 4; ++k) {
      char* to = nullptr;
      v[k] = std::strtod(from, &to);
      const bool last = k == 3;
      if (to == from || (!last && *to != ','))
        return fail(kConfigInvalid,
                    fmt::format("{}:{}: expected position_mm,x_mm,y_mm,z_mm, found \"{}\"",
                                csv.string(), line, row));
      from = to + 1;
    }
    stops.push_back({v[0], {v[1], v[2], v[3]}});
  }
  auto fit = scan::fit_axis(stops);
  if (!fit) return tl::unexpected(std::move(fit.error()).within(csv.string()));
  return *fit;
}

}  // namespace maquette::tools
