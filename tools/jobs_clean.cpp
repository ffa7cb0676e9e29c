// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_clean.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/jobs.hpp"

namespace maquette::tools {

Result<JobResult> clean_job(const CleanJob& job, const fs::path& out, const RunContext& run) {
  scan::CleanOptions o = job.options;
  if (const auto* s = std::get_if<PhaseShiftScanner>(&job.scanner)) {
    o.beam_diameter_mm = s->preset.beam_diameter_mm;
    o.beam_divergence_mrad = s->preset.beam_divergence_mrad;
  } else {
    // A camera's pixel is as wide as its spacing.
    o.beam_diameter_mm = o.beam_divergence_mrad = 0.0;
    if (o.least_jump_mm == 0.0) o.least_jump_mm = 1.0;
  }
  if (job.part) {
    MAQUETTE_TRY(Box3 box, surface_bounds(*job.part));
    const Vec3 margin{job.margin_mm, job.margin_mm, job.margin_mm};
    box.min = box.min - margin;
    box.max = box.max + margin;
    o.part_mm = box;
  }
  MAQUETTE_TRY(const scan::CleanFigures f, scan::clean_cloud(job.cloud, out, o, run));
  if (f.not_judged > 0)
    run.warn(
        fmt::format("{} of the stations do not say where the scanner stood: their mixed "
                    "points stay",
                    f.not_judged));
  JobResult result;
  result.outputs = {out};
  result.note = fmt::format("{} of {} points: {} mixed, {} isolated, {} off the part", f.written,
                            f.points, f.mixed, f.isolated, f.off_part);
  result.figures_json =
      nlohmann::json{{"points", f.points},     {"without_position", f.without_position},
                     {"mixed", f.mixed},       {"isolated", f.isolated},
                     {"off_part", f.off_part}, {"kept", f.kept},
                     {"written", f.written},   {"stations_without_scanner_position", f.not_judged},
                     {"voxel_mm", f.voxel_mm}, {"range_noise_mm", f.range_noise_mm}}
          .dump();
  return result;
}

}  // namespace maquette::tools
