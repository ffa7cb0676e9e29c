// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_offset.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/ball_offset.hpp"
#include "cnc/fillet.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::tools {

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
