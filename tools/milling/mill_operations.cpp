// SPDX-License-Identifier: GPL-3.0-or-later

// Several operations, one program: each cuts what the one before has left.

#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/check.hpp"
#include "core/files.hpp"
#include "core/run_part.hpp"
#include "tools/milling/joined_program.hpp"
#include "tools/operations.hpp"
#include "tools/tool_table.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;

Result<JobResult> mill_operations_job(std::span<const MillJob> jobs, const fs::path& out,
                                      const RunContext& run) {
  MAQUETTE_CHECK(!jobs.empty(), "no operations");
  MAQUETTE_TRY(auto joined, JoinedProgram::create(jobs.front(), out));
  // What operations leave, and programs of theirs that nobody needs, until all is done.
  MAQUETTE_TRY(
      const Waiting waiting,
      Waiting::beside(out.parent_path() / fmt::format("{}-operations", out.stem().string())));
  json figures = json::array();
  std::vector<fs::path> beside_it;
  std::optional<fs::path> stock = jobs.front().stock;
  for (std::size_t k = 0; k < jobs.size(); ++k) {
    MillJob job = jobs[k];
    job.stock = stock;
    job.joined = &joined;
    const fs::path own = waiting.file(
        fmt::format("{}.{}{}", out.stem().string(), job.name, out.extension().string()));
    const auto share = [&](std::size_t jobs_done) {
      return static_cast<double>(jobs_done) / static_cast<double>(jobs.size() + 1);
    };
    auto done = mill_job(job, own, part(run, share(k), share(k + 1)));
    if (!done) return tl::unexpected(std::move(done.error()).within("operation " + job.name));
    figures.push_back(json::parse(done->figures_json));
    for (const fs::path& file : done->outputs) {
      if (file.extension() != ".tif") continue;
      beside_it.push_back(file);
      if (file == beside(own, "stock")) stock = file;
    }
  }
  MAQUETTE_TRY(auto result, joined.finish(jobs.front(), std::move(figures), run));
  for (const fs::path& file : beside_it) {
    result.outputs.push_back(out.parent_path() / file.filename());
    std::error_code ec;
    fs::rename(file, result.outputs.back(), ec);
    if (ec) return tl::unexpected(write_error(result.outputs.back(), ec.value()));
  }
  if (std::any_of(jobs.begin(), jobs.end(), cuts_into_design)) {
    MAQUETTE_TRY(const auto machined,
                 machined_job(jobs, jobs.front().design, beside(out, "machined")));
    result.outputs.push_back(machined.outputs.front());
  }
  result.outputs.push_back(out.parent_path() / (out.stem().string() + ".tools.toml"));
  MAQUETTE_TRY_VOID(write_file(result.outputs.back(), tool_table_text(tools_of(jobs))));
  return result;
}

}  // namespace maquette::tools
