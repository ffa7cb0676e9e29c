// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_undercoat.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/undercoat.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::tools {

Result<JobResult> undercoat_job(const fs::path& design_path, Millimetres thickness,
                                const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  auto under = cnc::undercoat(design, thickness, run);
  if (!under) return tl::unexpected(std::move(under.error()).within(design_path.string()));
  MAQUETTE_TRY_VOID(heightmap::write_model_field(under->surface, out));
  JobResult result;
  result.outputs = {out};
  result.figures_json = nlohmann::json{{"coating_mm", thickness.value()},
                                       {"max_missing_mm", under->max_missing_mm},
                                       {"rms_missing_mm", under->rms_missing_mm},
                                       {"max_excess_mm", under->max_excess_mm}}
                            .dump();
  result.note = fmt::format("with its coat at most {:.4f} mm below the design, {:.4f} above",
                            under->max_missing_mm, under->max_excess_mm);
  return result;
}

}  // namespace maquette::tools
