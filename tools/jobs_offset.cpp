// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_offset.hpp"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/ball_offset.hpp"
#include "cnc/fillet.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/solid.hpp"
#include "meshing/stones.hpp"

namespace maquette::tools {

Result<JobResult> relief_job(const fs::path& design_path, const fs::path& stones_path,
                             const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  MAQUETTE_TRY(const auto stones, meshing::read_stone_plan(stones_path));
  for (const auto& stone : stones) {
    const Box3 box = meshing::stone_mesh(stone).bounds();
    if (!(box.min.x > design.x_mm(0) && box.max.x < design.x_mm(design.z_mm.cols() - 1) &&
          box.min.y > design.y_mm(0) && box.max.y < design.y_mm(design.z_mm.rows() - 1)))
      return fail(meshing::kNotASolid,
                  fmt::format("{}: stone {} (x {:.2f} to {:.2f}, y {:.2f} to {:.2f} mm) sticks out "
                              "of the outline of {}; leave it out or move it inside",
                              stones_path.string(), stone.number, box.min.x, box.max.x, box.min.y,
                              box.max.y, design_path.string()));
  }
  run.progress(0.2);
  const heightmap::ModelField relief = meshing::with_stones(design, stones);
  MAQUETTE_TRY_VOID(heightmap::write_model_field(relief, out));
  double sum_mm = 0.0, highest_mm = 0.0;
  for (std::size_t i = 0; i < relief.z_mm.cells().size(); ++i) {
    const double rise =
        static_cast<double>(relief.z_mm.cells()[i]) - static_cast<double>(design.z_mm.cells()[i]);
    if (!(rise > 0.0)) continue;  // a void, too
    sum_mm += rise;
    highest_mm = std::fmax(highest_mm, rise);
  }
  const double above_mm3 = sum_mm * design.spacing.value() * design.spacing.value();
  JobResult result;
  result.outputs = {out};
  result.figures_json =
      nlohmann::json{{"stones", stones.size()}, {"added_mm3", above_mm3}, {"most_mm", highest_mm}}
          .dump();
  result.note = fmt::format("{} stones, up to {:.2f} mm and {:.0f} mm^3 above the terrain",
                            stones.size(), highest_mm, above_mm3);
  return result;
}

Result<JobResult> offset_job(const fs::path& design_path, Millimetres distance, const fs::path& out,
                             const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  auto moved = cnc::offset_surface(design, distance, run);
  if (!moved) return tl::unexpected(std::move(moved.error()).within(design_path.string()));
  MAQUETTE_TRY_VOID(heightmap::write_model_field(*moved, out));
  const auto range = heightmap::height_range(moved->z_mm);
  JobResult result;
  result.outputs = {out};
  result.figures_json = nlohmann::json{
      {"offset_mm", distance.value()},
      {"lowest_mm", range.min},
      {"highest_mm",
       range.max}}.dump();
  result.note = fmt::format("{:g} mm {}", std::abs(distance.value()),
                            distance.value() < 0.0 ? "inwards" : "outwards");
  return result;
}

Result<JobResult> fillet_job(const fs::path& design_path, Millimetres radius, const fs::path& out,
                             const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  auto fillet = cnc::fillet_surface(design, radius, Millimetres{0.02}, run);
  if (!fillet) return tl::unexpected(std::move(fillet.error()).within(design_path.string()));
  MAQUETTE_TRY_VOID(heightmap::write_model_field(fillet->surface, out));
  JobResult result;
  result.outputs = {out};
  result.figures_json = nlohmann::json{
      {"fillet_mm", radius.value()},
      {"raised_area_mm2", fillet->area_mm2},
      {"added_mm3", fillet->volume_mm3},
      {"most_mm",
       fillet->highest_mm}}.dump();
  result.note = fmt::format("raised by at most {:.3f} mm, {:.0f} mm^2, {:.0f} mm^3 in all",
                            fillet->highest_mm, fillet->area_mm2, fillet->volume_mm3);
  return result;
}

}  // namespace maquette::tools
