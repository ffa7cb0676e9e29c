// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_simplify.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/check.hpp"
#include "core/files.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/simplify.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {

Result<JobResult> simplify_job(const SimplifyJob& job, const fs::path& out, const RunContext& run) {
  MAQUETTE_CHECK(job.triangles.has_value() != job.max_deviation.has_value(), "one of the two");
  MAQUETTE_TRY(const TriMesh mesh, meshing::read_mesh(job.mesh, RunContext{.stop = run.stop}));
  auto fewer = job.triangles ? meshing::simplify(mesh, *job.triangles, run)
                             : meshing::simplify_within(mesh, *job.max_deviation, run);
  if (!fewer) return tl::unexpected(std::move(fewer.error()).within(job.mesh.string()));
  MAQUETTE_TRY_VOID(meshing::write_ply(fewer->mesh, out));
  auto text = nlohmann::ordered_json::parse(meshing::to_json(fewer->certificate));
  text["triangles_before"] = mesh.triangles.size();
  text["max_deviation_mm"] = fewer->deviation_mm;
  JobResult result;
  result.outputs = {out, certificate_path(out)};
  result.figures_json = text.dump(2) + "\n";
  MAQUETTE_TRY_VOID(write_file(result.outputs.back(), result.figures_json));
  result.note =
      fmt::format("{} of {} triangles, at most {:.4g} mm apart", fewer->mesh.triangles.size(),
                  mesh.triangles.size(), fewer->deviation_mm);
  return result;
}

}  // namespace maquette::tools
