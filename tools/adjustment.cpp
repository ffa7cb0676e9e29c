// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/adjustment.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "tools/compensate.hpp"
#include "tools/corrections_file.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
namespace {

constexpr double kMostTilt_rad = 3.0 / 180.0 * std::numbers::pi;

Result<Adjustment::File> file_of(const fs::path& path) {
  MAQUETTE_TRY(const std::string hash, sha256_file(path));
  return Adjustment::File{path, hash};
}

/// Of a set of axes given by directions and scales, what the machine does more than it is called.
Result<void> add_axes(Adjustment& a, const Corrections& c, const fs::path& file) {
  cnc::MachineErrors& e = a.errors;
  for (const AxisCorrection& axis : c.axes) {
    const Vec3 d = axis.fit.scale * axis.fit.direction;
    if (axis.name == "x") {
      e.scale_um_per_m.x = 1e6 * (d.x - 1.0);
      e.squareness_yx_urad = 1e6 * d.y;
      e.squareness_zx_urad = 1e6 * d.z;
    } else if (axis.name == "y") {
      e.scale_um_per_m.y = 1e6 * (d.y - 1.0);
      e.squareness_xy_urad = 1e6 * d.x;
      e.squareness_zy_urad = 1e6 * d.z;
    } else if (axis.name == "z") {
      e.scale_um_per_m.z = 1e6 * (d.z - 1.0);
      e.squareness_xz_urad = 1e6 * d.x;
      e.squareness_yz_urad = 1e6 * d.y;
    } else {
      a.other_axes.push_back(axis.name);
      continue;
    }
    if (a.compensation)
      return fail(kConfigInvalid,
                  fmt::format("{}: the machine's axis {} is described here and by {}; give one of "
                              "both, or leave the axis out here",
                              file.string(), axis.name, a.compensation->path.string()));
    const Vec3 nominal{axis.name == "x" ? 1.0 : 0.0, axis.name == "y" ? 1.0 : 0.0,
                       axis.name == "z" ? 1.0 : 0.0};
    if (norm(d - nominal) > 0.05)
      return fail(
          kConfigInvalid,
          fmt::format("{}: axis {} goes ({}, {}, {}) for each mm shown, expected one within "
                      "0.05 of its own direction; is its frame that of the datums?",
                      file.string(), axis.name, d.x, d.y, d.z));
  }
  return {};
}

}  // namespace

std::vector<fs::path> AdjustmentFiles::files() const {
  std::vector<fs::path> all;
  for (const fs::path& file : {compensation, corrections})
    if (!file.empty()) all.push_back(file);
  return all;
}

Result<std::optional<Adjustment>> read_adjustment(const AdjustmentFiles& files) {
  if (!files.any()) return std::nullopt;
  Adjustment a;
  if (!files.compensation.empty()) {
    MAQUETTE_TRY(a.errors, read_compensation(files.compensation));
    MAQUETTE_TRY(a.compensation, file_of(files.compensation));
  }
  if (files.corrections.empty()) return a;
  MAQUETTE_TRY(const Corrections c, read_corrections(files.corrections));
  MAQUETTE_TRY(a.corrections, file_of(files.corrections));
  a.next_part = files.corrections_for == "next";
  a.errors.machine_from_part =
      a.next_part ? c.actual_from_planned.inverse() : c.actual_from_planned;
  const Vec3 up = a.errors.machine_from_part.direction({0.0, 0.0, 1.0});
  if (const double tilt = std::atan2(std::hypot(up.x, up.y), up.z); tilt > kMostTilt_rad)
    return fail(kConfigInvalid,
                fmt::format("{}: the surface is tilted by {:.2f} degrees, expected at most 3: a "
                            "cutter that stays upright does not follow farther",
                            files.corrections.string(), tilt * 180.0 / std::numbers::pi));
  MAQUETTE_TRY_VOID(add_axes(a, c, files.corrections));
  return a;
}

std::vector<std::string> head_of(const Adjustment& a) {
  std::vector<std::string> lines;
  const auto line = [&](const char* what, const Adjustment::File& file) {
    std::string name = file.path.filename().string();
    for (char& c : name)
      if (c == '(' || c == ')' || c == ';' || c == '%') c = '_';
    lines.push_back(fmt::format("{} {} sha256 {}", what, name, file.sha256.substr(0, 16)));
  };
  if (a.compensation) line("compensated by", *a.compensation);
  if (a.corrections)
    line(a.next_part ? "next part, displaced as by" : "part stands as in", *a.corrections);
  return lines;
}

nlohmann::json json_of(const Adjustment& a) {
  nlohmann::json j;
  const auto file = [](const Adjustment::File& f) {
    return nlohmann::json{{"file", f.path.filename().string()}, {"sha256", f.sha256}};
  };
  if (a.compensation) j["compensation"] = file(*a.compensation);
  if (a.corrections) {
    j["corrections"] = file(*a.corrections);
    j["corrections"]["for"] = a.next_part ? "next" : "this";
    const Vec3 t = a.errors.machine_from_part.translation_mm;
    j["corrections"]["translation_mm"] = {t.x, t.y, t.z};
    if (!a.other_axes.empty()) j["corrections"]["axes_left"] = a.other_axes;
  }
  return j;
}

fs::path meant_of(const fs::path& program) {
  return program.parent_path() /
         (program.stem().string() + ".meant" + program.extension().string());
}

fs::path meant_of_part(const fs::path& program) {
  const std::string stem = program.stem().string();
  const std::size_t at = stem.find_last_not_of("0123456789");
  if (at != std::string::npos && at > 0 && at + 1 < stem.size() && stem[at] == '_')
    if (fs::path part = program.parent_path() / (stem.substr(0, at) + ".meant" + stem.substr(at) +
                                                 program.extension().string());
        fs::exists(part))
      return part;
  return meant_of(program);
}

}  // namespace maquette::tools
