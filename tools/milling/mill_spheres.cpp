// SPDX-License-Identifier: GPL-3.0-or-later

// Reference spheres that tie scans to the machine: holes they rest in, and where they are.

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/mill.hpp"
#include "cnc/probed_spheres.hpp"
#include "cnc/probing.hpp"
#include "core/files.hpp"
#include "tools/milling/mill_program.hpp"
#include "tools/schema.hpp"
#include "tools/sphere_file.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr double kLevel_mm = 0.05;  // that a rim may be off the surface it is milled into
constexpr double kRimWidth_mm = 1.0;

/// The design from `nearest` to `farthest` around a seat must be from `least` to `most` high.
/// Beyond its outline nothing is known.
Result<void> keep_level(const heightmap::ModelField& design, const ReferenceSphere& sphere,
                        double nearest, double farthest, double least, double most,
                        const char* what) {
  const cnc::SphereSeat& seat = sphere.seat;
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r) {
    if (std::abs(design.y_mm(r) - seat.y_mm) > farthest) continue;
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c) {
      const double z = design.z_mm(r, c), x = design.x_mm(c), y = design.y_mm(r);
      const double away = std::hypot(x - seat.x_mm, y - seat.y_mm);
      if ((z >= least && z <= most) || away < nearest || away > farthest) continue;
      return fail(
          cnc::kProbingOptionOutOfRange,
          fmt::format("{} at x {} y {}: the design is {:.3f} mm high at x {} y {}; {} "
                      "needs it {}; move the sphere, or change its rim's height",
                      sphere.name, seat.x_mm, seat.y_mm, z, x, y, what,
                      std::isfinite(least) ? fmt::format("from {:.3f} to {:.3f}", least, most)
                                           : fmt::format("below {:.3f}", most)));
    }
  }
  return {};
}

json rows_of(const std::vector<ReferenceSphere>& spheres) {
  json rows = json::array();
  for (const ReferenceSphere& s : spheres) {
    const Vec3 c = s.centre_mm();
    rows.push_back({{"name", s.name}, {"centre_mm", {c.x, c.y, c.z}}});
  }
  return rows;
}

}  // namespace

Result<std::vector<ReferenceSphere>> spheres_of(const MillJob& job) {
  if (!job.spheres)
    return fail(kConfigInvalid, fmt::format("{}: no spheres are given; expected --spheres, a .toml "
                                            "file with a [[sphere]] for each",
                                            job.strategy));
  return read_spheres(*job.spheres);
}

Result<JobResult> sphere_seats_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto spheres, spheres_of(job));
  MAQUETTE_TRY(Piece piece, piece_of(job, 0.0));
  cnc::BoreOptions options;
  options.cutter_radius_mm = job.tool.cutter.radius_mm;
  options.ramp_angle_deg = job.ramp_deg;
  options.feed_mm_min = job.feed.value();
  options.clearance_mm = job.clearance.value();
  double top = piece.top_mm;
  std::vector<cnc::Toolpath> bores;
  for (const ReferenceSphere& s : spheres) {
    const double hole = s.seat.hole_radius_mm, rim = s.seat.rim_mm;
    MAQUETTE_TRY_VOID(
        keep_level(piece.design, s, 0.0, hole, -INFINITY, rim + kLevel_mm, "the bore"));
    MAQUETTE_TRY_VOID(keep_level(piece.design, s, hole, hole + kRimWidth_mm, rim - kLevel_mm,
                                 rim + kLevel_mm, "the rim"));
    MAQUETTE_TRY(bores.emplace_back(), cnc::bore_sphere_seat(s.seat, options));
    top = std::max(top, rim);
  }
  piece.depth.reset();
  piece.deepest_mm = options.cutter_radius_mm;  // a helix, full width
  const double radius = spheres.front().seat.sphere_radius_mm;
  MAQUETTE_TRY(
      auto program,
      MillProgram::begin(
          job, piece, out, top, Millimetres{cnc::share_tolerance(job.tolerance).blending_mm},
          {"frame of the model, x east, y north, z up",
           fmt::format("seats of {} reference spheres of radius {} mm", spheres.size(), radius)}));
  for (const cnc::Toolpath& bore : bores) MAQUETTE_TRY_VOID(program.add(bore));
  return program.finish(
      std::nullopt,
      {{"passes", spheres.size()}, {"sphere_radius_mm", radius}, {"spheres", rows_of(spheres)}},
      run);
}

Result<JobResult> probe_spheres_job(const MillJob& job, const fs::path& out, const RunContext&) {
  MAQUETTE_TRY(const auto spheres, spheres_of(job));
  MAQUETTE_TRY(const Piece piece, piece_of(job, 0.0));
  cnc::ProbingOptions options;
  options.post = job.program.post;
  options.work_offset = job.program.work_offset;
  options.ball_radius_mm = job.tool.cutter.radius_mm;
  options.over_mm = piece.top_mm + options.search_mm;
  const double radius = spheres.front().seat.sphere_radius_mm;
  const double away = radius + options.ball_radius_mm + options.search_mm;
  double top = piece.top_mm;
  std::vector<Vec3> centres;
  Box3 box;
  for (const ReferenceSphere& s : spheres) {
    const Vec3 c = s.centre_mm();
    MAQUETTE_TRY_VOID(keep_level(piece.design, s, 0.0, away + options.ball_radius_mm, -INFINITY,
                                 c.z - options.ball_radius_mm - kLevel_mm,
                                 "the probe beside the sphere's equator"));
    top = std::max(top, c.z + radius);
    box.add(c - Vec3{away, away, options.ball_radius_mm});
    box.add({c.x + away, c.y + away, std::max(options.over_mm, top + options.search_mm)});
    centres.push_back(c);
  }
  MAQUETTE_TRY_VOID(cnc::check_travel(job.machine, box));
  std::string log = out.stem().string() + ".contacts.txt";
  for (char& c : log)
    if (c == '(' || c == ')' || c == '\n' || c == '\r') c = '_';
  MAQUETTE_TRY(const std::string touches, cnc::probe_spheres(centres, radius, log, options));
  MillJob still = job;
  still.spindle_rpm = 0.0;
  still.material.reset();
  still.clearance = Millimetres{std::max(job.clearance.value(), options.search_mm)};
  MAQUETTE_TRY(auto program,
               MillProgram::begin(still, piece, out, top, Millimetres{0.0},
                                  {fmt::format("touches {} reference spheres of radius {} mm, "
                                               "right to within {} mm; contacts go to {}",
                                               spheres.size(), radius, options.search_mm, log)}));
  program.writer().lines(touches);
  return program.finish_unread({{"passes", 0},
                                {"contacts", log},
                                {"sphere_radius_mm", radius},
                                {"spheres", rows_of(spheres)}});
}

Result<JobResult> probed_spheres_job(const fs::path& contacts, const fs::path& planned,
                                     double probe_radius_mm, const fs::path& out) {
  MAQUETTE_TRY(const auto spheres, read_spheres(planned));
  MAQUETTE_TRY(const auto tips, cnc::read_contacts(contacts));
  std::vector<Vec3> centres;
  for (const ReferenceSphere& s : spheres) centres.push_back(s.centre_mm());
  const double radius = spheres.front().seat.sphere_radius_mm;
  auto probed = cnc::spheres_of_contacts(tips, centres, radius, probe_radius_mm,
                                         std::sqrt(3.0) * cnc::ProbingOptions{}.search_mm);
  if (!probed) return tl::unexpected(std::move(probed.error()).within(contacts.string()));
  std::string text =
      "# Centres of the reference spheres as probed, in the model frame: datums of a case file\n"
      "# (datums = \"" +
      out.filename().string() + "\").\n";
  json rows = json::array();
  double farthest = 0.0;
  for (std::size_t k = 0; k < spheres.size(); ++k) {
    const Vec3 c = (*probed)[k].centre_mm, off = c - centres[k];
    farthest = std::max(farthest, norm(off));
    text += fmt::format(
        "\n[[datum]]\nkind = \"sphere\"\nname = {}\nat_mm = [{:.5f}, {:.5f}, {:.5f}]\n"
        "radius_mm = {:.5f}\n",
        json(spheres[k].name).dump(), c.x, c.y, c.z, radius);
    rows.push_back({{"name", spheres[k].name},
                    {"centre_mm", {c.x, c.y, c.z}},
                    {"off_plan_mm", {off.x, off.y, off.z}},
                    {"residual_mm", (*probed)[k].residual_mm}});
  }
  MAQUETTE_TRY_VOID(write_file(out, text));
  JobResult result;
  result.outputs = {out};
  result.figures_json = json{{"spheres", rows}, {"farthest_off_plan_mm", farthest}}.dump();
  result.note =
      fmt::format("{} spheres, at most {:.3f} mm off their plan", spheres.size(), farthest);
  return result;
}

}  // namespace maquette::tools
