// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/compensate.hpp"

#include <deque>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "diagnosis/compensation.hpp"
#include "heightmap/field_io.hpp"
#include "tools/adjustment.hpp"
#include "tools/extended.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;

Result<cnc::MachineErrors> read_compensation(const fs::path& file) {
  cnc::MachineErrors e;
  struct Table {
    std::string along = "x", moves = "z";
    std::vector<double> position_mm, error_mm;
  };
  std::deque<Table> tables;
  std::string schema = "maquette.compensation/1";
  constexpr double kInf = INFINITY;
  Schema t;
  t.add({"schema", &schema, "", -kInf, kInf, {"maquette.compensation/1"}, true});
  t.add({"exact_at_mm", &e.exact_at_mm, "where scale and squareness displace nothing"});
  const auto key = [&](const char* name, double* to, const char* says, double most) {
    t.add({name, to, says, -most, most});
  };
  key("machine.scale_x_um_per_m", &e.scale_um_per_m.x, "> 0: travels too far", 1e5);
  key("machine.scale_y_um_per_m", &e.scale_um_per_m.y, "> 0: travels too far", 1e5);
  key("machine.scale_z_um_per_m", &e.scale_um_per_m.z, "> 0: travels too far", 1e5);
  key("machine.squareness_xy_urad", &e.squareness_xy_urad, "x goes along with y", 1e5);
  key("machine.squareness_xz_urad", &e.squareness_xz_urad, "x goes along with z", 1e5);
  key("machine.squareness_yz_urad", &e.squareness_yz_urad, "y goes along with z", 1e5);
  key("machine.backlash_x_mm", &e.backlash_mm.x, "lost motion", 5);
  key("machine.backlash_y_mm", &e.backlash_mm.y, "lost motion", 5);
  key("machine.backlash_z_mm", &e.backlash_mm.z, "lost motion", 5);
  key("tool.radius_error_mm", &e.radius_error_mm, "larger than programmed", 10);
  key("tool.length_offset_mm", &e.length_offset_mm, "its tip stands higher than called", 100);
  t.array("straightness", "tables of a guide", [&] {
    Table& table = tables.emplace_back();
    Schema row;
    row.add({"along", &table.along, "the axis that travels", -kInf, kInf, {"x", "y", "z"}, true});
    row.add(
        {"moves", &table.moves, "where it leaves the line", -kInf, kInf, {"x", "y", "z"}, true});
    row.add({"position_mm", &table.position_mm, "increasing", -1e6, 1e6, {}, true});
    row.add({"error_mm", &table.error_mm, "as many", -100, 100, {}, true});
    return row;
  });
  MAQUETTE_TRY_VOID(t.read(file));
  for (Table& table : tables) {
    if (table.position_mm.size() != table.error_mm.size() ||
        std::adjacent_find(table.position_mm.begin(), table.position_mm.end(),
                           std::greater_equal<>()) != table.position_mm.end())
      return fail(
          kConfigInvalid,
          fmt::format("{}: [[straightness]] along {}: {} positions and {} errors; expected "
                      "as many, positions increasing",
                      file.string(), table.along, table.position_mm.size(), table.error_mm.size()));
    e.straightness.push_back({table.along[0] - 'x', table.moves[0] - 'x',
                              std::move(table.position_mm), std::move(table.error_mm)});
  }
  return e;
}

Result<JobResult> compensate_job(const CompensateJob& job, const fs::path& folder,
                                 const RunContext& run) {
  MAQUETTE_TRY(const auto errors, read_compensation(job.by));
  std::optional<diagnosis::CaseInput> extended;
  if (job.extended) {
    MAQUETTE_TRY(const auto c, read_case(*job.extended));
    extended = diagnosis_input(*c, 1);
    extended->programs = job.programs;
  }
  const double ball = extended ? extended->ball_diameter_mm : job.ball_diameter_mm;
  std::optional<heightmap::ModelField> design;
  if (errors.radius_error_mm != 0.0) {
    if (!job.design && !extended)
      return fail(kConfigInvalid,
                  fmt::format("{}: tool.radius_error_mm: a ball of another radius needs what it is "
                              "to touch; give --design, or the case as --extended",
                              job.by.string()));
    MAQUETTE_TRY(design,
                 heightmap::read_model_field(job.design                 ? *job.design
                                             : extended->ground.empty() ? extended->design
                                                                        : extended->ground));
  }
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  cnc::CompensateOptions options;
  options.design = design ? &*design : nullptr;
  options.ball_radius_mm = 0.5 * ball;
  MAQUETTE_TRY(const std::string hash, sha256_file(job.by));
  options.head = head_of({errors, Adjustment::File{job.by, hash}, {}, false, {}});
  JobResult result;
  cnc::CompensateFigures all;
  for (const fs::path& program : job.programs) {
    const fs::path out = folder / program.filename();
    if (fs::equivalent(program, out, ec))
      return fail(kConfigInvalid,
                  fmt::format("{}: would be overwritten; choose another --out", program.string()));
    MAQUETTE_TRY(const auto f, cnc::compensate(program, errors, options, out, run));
    all.moves += f.moves;
    all.lines += f.lines;
    all.take_ups += f.take_ups;
    all.largest_mm = std::max(all.largest_mm, f.largest_mm);
    result.outputs.push_back(out);
  }
  nlohmann::ordered_json figures{{"moves", all.moves},
                                 {"lines", all.lines},
                                 {"take_ups", all.take_ups},
                                 {"largest_change_mm", all.largest_mm}};
  result.note = fmt::format("{} moves, at most {:.4f} mm elsewhere", all.moves, all.largest_mm);
  if (extended) {
    MAQUETTE_TRY(const auto gain, diagnosis::improvement(*extended, result.outputs, run));
    figures["rms_before_mm"] = gain.rms_before_mm;
    figures["rms_after_mm"] = gain.rms_after_mm;
    figures["max_before_mm"] = gain.max_before_mm;
    figures["max_after_mm"] = gain.max_after_mm;
    result.note += fmt::format("; the part would be {:.4f} mm rms off before, {:.4f} after",
                               gain.rms_before_mm, gain.rms_after_mm);
  }
  result.figures_json = figures.dump();
  return result;
}

}  // namespace maquette::tools
