// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_lod.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/stones.hpp"

namespace maquette::tools {

using nlohmann::json;

Result<JobResult> lod_job(const LodJob& job, const fs::path& folder, const RunContext& run) {
  MAQUETTE_TRY(const auto field, heightmap::read_model_field(job.design));
  std::vector<meshing::PlacedStone> stones;
  if (job.stones) {
    MAQUETTE_TRY(stones, meshing::read_stone_plan(*job.stones));
  }
  auto report = exporting::write_lod_set(field, stones, job.options, folder, run);
  if (!report) return tl::unexpected(std::move(report.error()).within(job.design.string()));
  JobResult result;
  result.outputs = {folder / "tileset.json", folder / "lod.json"};
  if (!stones.empty()) {
    for (const exporting::LodStones& file : report->stones)
      result.outputs.push_back(folder / exporting::lod_stones_uri(file));
    result.outputs.push_back(folder / "stones.json");
    const fs::path plan = result.outputs.back();
    MAQUETTE_TRY_VOID(meshing::write_stone_plan(stones, plan));
    for (fs::path& file : meshing::stone_body_files(stones, plan))
      result.outputs.push_back(std::move(file));
  }
  json figures = json::parse(exporting::to_json(*report, job.options, field));
  figures.erase("tiles");
  const auto kept = std::count_if(report->tiles.begin(), report->tiles.end(),
                                  [](const auto& tile) { return tile.kept; });
  figures["kept_tiles"] = kept;
  std::uint64_t stones_bytes = 0;
  for (const exporting::LodStones& file : report->stones) stones_bytes += file.bytes;
  figures["stones"] = {{"files", report->stones.size()}, {"bytes", stones_bytes}};
  result.note =
      fmt::format("{} levels, {} tiles, {}, {:.3f} bytes a triangle", report->levels.size(),
                  report->tiles.size(), human_bytes(figures["bytes"].get<double>()),
                  figures["bytes_per_triangle"].get<double>());
  if (kept > 0) result.note += fmt::format(" ({} tiles were there)", kept);
  if (job.heightmap_quads) {
    const exporting::HeightmapOptions maps{.tile_quads = *job.heightmap_quads,
                                           .filter = job.options.filter,
                                           .scale_denominator = job.options.asset.scale_denominator,
                                           .place = job.options.place};
    auto made = exporting::write_heightmaps(field, maps, folder / "heightmaps", run);
    if (!made) return tl::unexpected(std::move(made.error()).within(job.design.string()));
    figures["heightmaps"] = json::parse(exporting::to_json(*made, maps));
    result.outputs.push_back(folder / "heightmaps" / "heights.json");
    result.outputs.push_back(folder / "heightmaps" / "heights.tif");
    result.note +=
        fmt::format("; heightmaps of {} nodes a side, {}, rounded by {:.3g} mm at most",
                    *job.heightmap_quads + 1, human_bytes(static_cast<double>(made->bytes)),
                    1e3 * made->levels[0].rounding_m);
  }
  result.figures_json = figures.dump();
  return result;
}

}  // namespace maquette::tools
