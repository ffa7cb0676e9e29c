// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_bands.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/grid_stream.hpp"
#include "tools/exploded_view.hpp"
#include "tools/jobs.hpp"
#include "tools/schema.hpp"
#include "tools/set_aside.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {
namespace {

using meshing::BandAxis;
using nlohmann::ordered_json;

constexpr const char* kSchema = "maquette.bands/1";

char letter(BandAxis axis) {
  return axis == BandAxis::x ? 'x' : 'y';
}

/// What a person has to know of a joint that could not keep off. One sentence.
std::string said(const meshing::JointAtStones& joint, BandAxis axis, double clearance_mm) {
  std::string text =
      fmt::format("joint {} at {} = {:.6g} mm", joint.joint, letter(axis), joint.at_mm);
  if (!joint.through.empty())
    text += fmt::format(" passes through stone{} {}", joint.through.size() > 1 ? "s" : "",
                        fmt::join(joint.through, ", "));
  if (!joint.near.empty())
    text +=
        fmt::format("{} is nearer than {:g} mm to stone{} {}", joint.through.empty() ? "" : ",",
                    clearance_mm, joint.near.size() > 1 ? "s" : "", fmt::join(joint.near, ", "));
  return text;
}

ordered_json layout_json(const heightmap::ModelField& design, const meshing::BandLayout& layout,
                         const BandLayoutJob& job, const std::vector<std::string>& warnings) {
  const BandAxis axis = layout.bands.front().axis;
  const auto at = [&](std::ptrdiff_t line) {
    return axis == BandAxis::x ? design.x_mm(line) : design.y_mm(line);
  };
  ordered_json bands = ordered_json::array(), joints = ordered_json::array();
  for (const meshing::Band& b : layout.bands) {
    bands.push_back({{"number", b.number},
                     {"from_mm", at(b.first)},
                     {"to_mm", at(b.last)},
                     {"width_mm", at(b.last) - at(b.first)}});
    if (b.number == 1) continue;
    ordered_json through = ordered_json::array(), near = ordered_json::array();
    for (const auto& kept : layout.kept)
      if (kept.joint == b.number - 1) through = kept.through, near = kept.near;
    joints.push_back({{"number", b.number - 1},
                      {"line", b.first},
                      {"at_mm", at(b.first)},
                      {"through_stones", through},
                      {"near_stones", near}});
  }
  return {{"schema", kSchema},
          {"unit", "mm"},
          {"axis", std::string(1, letter(axis))},
          {"even_bands", layout.even_bands},
          {"avoid_stones", job.avoid_stones && job.stones.has_value()},
          {"clearance_mm", job.clearance.value()},
          {"bands", bands},
          {"joints", joints},
          {"warnings", warnings}};
}

Result<ExplodedView> view_of(const heightmap::ModelField& design, const meshing::BandLayout& layout,
                             std::span<const meshing::PlacedStone> stones, const BandLayoutJob& job,
                             const std::vector<std::string>& warnings) {
  ExplodedView view;
  const bool along_x = layout.bands.front().axis == BandAxis::x;
  std::vector<meshing::Tile> tiles;
  for (const meshing::Band& b : layout.bands) {
    const int k = b.number - 1;
    view.parts.push_back({fmt::format("band {}", b.number), b.number,
                          meshing::band_window(design, b), along_x ? k : 0, along_x ? 0 : k});
    tiles.push_back(
        {b.number, along_x ? 1 : b.number, along_x ? b.number : 1, view.parts.back().nodes});
  }
  view.title = fmt::format("{:.6g} × {:.6g} mm in {} band{}",
                           design.x_mm(design.z_mm.cols() - 1) - design.x_mm(0),
                           design.y_mm(design.z_mm.rows() - 1) - design.y_mm(0),
                           layout.bands.size(), layout.bands.size() > 1 ? "s" : "");
  view.base_z = solid_options(design, job.base_thickness).base_z;
  view.stones = stones;
  for (const auto& kept : layout.kept) view.marked.insert(kept.through.begin(), kept.through.end());
  if (!stones.empty())
    view.notes.push_back(
        fmt::format("{} stones, {}.", stones.size(),
                    job.with_stones ? "of one piece with the bands" : "made apart and glued on"));
  // A picture shows some; bands.json has all.
  constexpr std::size_t kShown = 4;
  for (std::size_t i = 0; i < std::min(warnings.size(), kShown); ++i)
    view.notes.push_back((layout.kept[i].through.empty() ? "" : "Red: ") + warnings[i] +
                         (i + 1 == kShown ? " ..." : ""));
  MAQUETTE_TRY(view.holes,
               place_holes(design, tiles, view.base_z, job.base_thickness, job.in_joints));
  return view;
}

}  // namespace

Result<void> write_exploded(const heightmap::ModelField& design, const ExplodedView& view,
                            const fs::path& folder, std::vector<fs::path>& outputs) {
  const Drawing drawing = exploded_drawing(design, view);
  outputs.push_back(folder / "exploded.svg");
  MAQUETTE_TRY_VOID(write_file(outputs.back(), to_svg(drawing, view.title)));
  outputs.push_back(folder / "exploded.png");
  return camera::write_png(to_pixels(drawing), outputs.back(), {});
}

Result<JobResult> band_layout_job(const BandLayoutJob& job, const fs::path& folder,
                                  const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(job.design));
  std::vector<meshing::PlacedStone> stones;
  if (job.stones) {
    MAQUETTE_TRY(stones, meshing::read_stone_plan(*job.stones));
  }
  const std::span<const meshing::PlacedStone> avoided =
      job.avoid_stones ? std::span<const meshing::PlacedStone>(stones)
                       : std::span<const meshing::PlacedStone>{};
  auto layout = meshing::split_beside_stones(design, job.split, avoided, job.clearance);
  if (!layout) return tl::unexpected(std::move(layout.error()).within(job.design.string()));
  // What no band could be made of is said before anything is written.
  if (const auto solid =
          meshing::GridSolidStream::create(design, solid_options(design, job.base_thickness));
      !solid)
    return tl::unexpected(Error(solid.error()).within(job.design.string()));
  if (job.most_bands > 0 && layout->bands.size() > job.most_bands)
    return fail(meshing::kBandsDegenerate,
                fmt::format("{}: joints that keep off the stones make {} bands, but work offsets "
                            "are there for {}; take wider bands (bands.max_width_mm), one offset "
                            "for all (mill.work_offset_per_band) or even bands "
                            "(bands.avoid_stones = false)",
                            job.design.string(), layout->bands.size(), job.most_bands));
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  MAQUETTE_TRY_VOID(set_aside_beyond(folder, "band_", layout->bands.size(), run));
  std::vector<std::string> warnings;
  for (const auto& kept : layout->kept) {
    warnings.push_back(said(kept, layout->bands.front().axis, job.clearance.value()));
    run.warn(warnings.back() +
             (job.split.count > 0 ? ": nowhere near the even place is there a better one; other "
                                    "numbers of bands, or other stones, would do"
                                  : ": no line within the bands' width keeps off all stones; wider "
                                    "bands, a smaller clearance or other stones would do"));
  }
  run.progress(0.3);

  JobResult result;
  result.outputs.push_back(folder / "bands.json");
  const ordered_json figures = layout_json(design, *layout, job, warnings);
  MAQUETTE_TRY_VOID(write_file(result.outputs.back(), figures.dump(1) + "\n"));
  auto view = view_of(design, *layout, stones, job, warnings);
  if (!view) return tl::unexpected(std::move(view.error()).within(job.design.string()));
  MAQUETTE_TRY_VOID(write_exploded(design, *view, folder, result.outputs));
  result.figures_json = figures.dump();
  result.note = fmt::format("{} bands", layout->bands.size());
  if (layout->bands.size() > layout->even_bands)
    result.note +=
        fmt::format(" instead of {}, so that joints keep off stones", layout->even_bands);
  if (!warnings.empty())
    result.note +=
        fmt::format(", {} joint{} at stones", warnings.size(), warnings.size() > 1 ? "s" : "");
  return result;
}

Result<meshing::BandSplit> read_band_layout(const fs::path& path) {
  MAQUETTE_TRY(const std::string text, read_file(path));
  const auto bad = [&](const std::string& key, const std::string& what) {
    return fail(kConfigInvalid, fmt::format("{}: {} {}", path.string(), key, what));
  };
  nlohmann::json j;
  try {
    j = nlohmann::json::parse(text);
  } catch (const nlohmann::json::parse_error& e) {
    return fail(kConfigSyntax, fmt::format("{}: {}", path.string(), e.what()));
  }
  if (!j.is_object() || j.value("schema", nlohmann::json()) != kSchema)
    return bad("/schema", fmt::format("must be \"{}\"", kSchema));
  const auto axis = j.value("axis", nlohmann::json());
  if (axis != "x" && axis != "y") return bad("/axis", "must be \"x\" or \"y\"");
  meshing::BandSplit split{.axis = axis == "x" ? BandAxis::x : BandAxis::y};
  split.joints.emplace();
  if (!j.contains("joints") || !j["joints"].is_array()) return bad("/joints", "must be an array");
  for (std::size_t i = 0; i < j["joints"].size(); ++i) {
    const auto& joint = j["joints"][i];
    if (!joint.is_object() || !joint.contains("line") || !joint["line"].is_number_integer())
      return bad(fmt::format("/joints/{}/line", i), "must be a whole number");
    split.joints->push_back(joint["line"].get<std::ptrdiff_t>());
  }
  return split;
}

}  // namespace maquette::tools
