// SPDX-License-Identifier: GPL-3.0-or-later

// What is to be left where a block is also milled for its stones and reference spheres.

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "heightmap/field_io.hpp"
#include "tools/milling/mill_program.hpp"
#include "tools/sphere_file.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
namespace {

using heightmap::ModelField;

/// A facet that comes this near has all its nodes nearer than that.
double reach_of_facets(const ModelField& field) {
  return std::numbers::sqrt2 * field.spacing.value();
}

/// f(z, distance in plan) for the nodes within `reach_mm` of the line.
template <class F>
void near_line(ModelField& field, const std::array<double, 2>& a, const std::array<double, 2>& b,
               double reach_mm, F&& f) {
  const double s = field.spacing.value(), ux = b[0] - a[0], uy = b[1] - a[1];
  const double length2 = ux * ux + uy * uy;
  const auto first = [&](double low, double zero) {
    return std::max<std::ptrdiff_t>(
        0, static_cast<std::ptrdiff_t>(std::ceil((low - reach_mm - zero) / s)));
  };
  const auto last = [&](double high, double zero, std::ptrdiff_t count) {
    return std::min(count - 1,
                    static_cast<std::ptrdiff_t>(std::floor((high + reach_mm - zero) / s)));
  };
  const double x0 = field.x0.value(), y0 = field.y0.value();
  const std::ptrdiff_t r1 = last(std::max(a[1], b[1]), y0, field.z_mm.rows()),
                       c0 = first(std::min(a[0], b[0]), x0),
                       c1 = last(std::max(a[0], b[0]), x0, field.z_mm.cols());
  for (std::ptrdiff_t r = first(std::min(a[1], b[1]), y0); r <= r1; ++r)
    for (std::ptrdiff_t c = c0; c <= c1; ++c) {
      const double px = field.x_mm(c) - a[0], py = field.y_mm(r) - a[1];
      const double t = length2 > 0.0 ? std::clamp((px * ux + py * uy) / length2, 0.0, 1.0) : 0.0;
      if (std::hypot(px - t * ux, py - t * uy) <= reach_mm) f(r, c);
    }
}

}  // namespace

bool cuts_into_design(const MillJob& job) {
  return job.strategy == "seats" || job.strategy == "outlines" || job.strategy == "sphere-seats";
}

Result<JobResult> machined_job(std::span<const MillJob> jobs, const fs::path& design,
                               const fs::path& out) {
  MAQUETTE_TRY(const ModelField meant, heightmap::read_model_field(design));
  ModelField left = meant;
  const auto lower = [&](std::ptrdiff_t r, std::ptrdiff_t c, double to_mm) {
    left.z_mm(r, c) = std::min(left.z_mm(r, c), static_cast<float>(to_mm));
  };
  std::size_t seats = 0, marks = 0, bores = 0;
  for (const MillJob& job : jobs) {
    const double facets = reach_of_facets(meant);
    if (job.strategy == "seats" || job.strategy == "outlines") {
      MAQUETTE_TRY(const auto places, seats_of(job, meant));
      if (job.strategy == "seats") {
        seats += places.size();
        left = cnc::with_seats(left, places);
        continue;
      }
      marks += places.size();
      // The ball goes down by the depth from where it touches: nowhere deeper than that.
      const double reach = job.tool.cutter.radius_mm + facets;
      for (const cnc::Seat& seat : places)
        for (std::size_t i = 0; i < seat.border_mm.size(); ++i)
          near_line(left, seat.border_mm[i], seat.border_mm[(i + 1) % seat.border_mm.size()], reach,
                    [&](std::ptrdiff_t r, std::ptrdiff_t c) {
                      lower(r, c, static_cast<double>(meant.z_mm(r, c)) - job.mark_depth_mm);
                    });
    } else if (job.strategy == "sphere-seats") {
      MAQUETTE_TRY(const auto spheres, spheres_of(job));
      bores += spheres.size();
      for (const ReferenceSphere& s : spheres) {
        const double floor = s.centre_mm().z - s.seat.sphere_radius_mm - s.seat.below_mm;
        const std::array<double, 2> middle{s.seat.x_mm, s.seat.y_mm};
        near_line(left, middle, middle, s.seat.hole_radius_mm + facets,
                  [&](std::ptrdiff_t r, std::ptrdiff_t c) { lower(r, c, floor); });
      }
    }
  }
  MAQUETTE_TRY_VOID(heightmap::write_model_field(left, out));
  JobResult result;
  result.outputs = {out};
  result.figures_json =
      nlohmann::json{{"seats", seats}, {"outlines", marks}, {"bores", bores}}.dump();
  result.note = fmt::format("{} seats, {} outlines, {} bores", seats, marks, bores);
  return result;
}

}  // namespace maquette::tools
