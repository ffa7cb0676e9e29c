// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/clean_layer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "heightmap/detail/artefact_finders.hpp"
#include "heightmap/detail/void_fill.hpp"

namespace maquette::heightmap::detail {
namespace {

/// Values of the window's pixels on the nodes; 0 outside.
template <class Value>
Result<Grid<Value>> on_nodes(const Grid<Value>& of_pixels, const PixelWindow& window,
                             const NodeMap& map, const RunContext& run) {
  PixelWindow values = window;
  values.radii = false;
  std::copy(of_pixels.cells().begin(), of_pixels.cells().end(), values.height_m.cells().begin());
  MAQUETTE_TRY(const Grid<float> sampled, map.sample_nearest(values, run));
  Grid<Value> out(sampled.rows(), sampled.cols(), Value{0});
  for (std::size_t i = 0; i < out.cells().size(); ++i)
    if (!std::isnan(sampled.cells()[i])) out.cells()[i] = static_cast<Value>(sampled.cells()[i]);
  return out;
}

/// Fills voids named by `which` and adds them to what was made up.
void fill_named(Grid<float>& h, const Grid<std::uint8_t>& which, Cleaned& cleaned,
                CleanedLayer& out) {
  const VoidFill fill = fill_voids(h, &which);
  if (fill.filled == 0) return;
  if (cleaned.made.empty()) cleaned.made = Grid<std::uint8_t>(h.rows(), h.cols(), 0);
  if (cleaned.doubt_m.empty()) cleaned.doubt_m = Grid<float>(h.rows(), h.cols(), 0.0F);
  for (std::size_t i = 0; i < which.cells().size(); ++i)
    if (which.cells()[i] != 0 && !std::isnan(fill.sigma.cells()[i])) {
      cleaned.made.cells()[i] = 1;
      cleaned.doubt_m.cells()[i] = fill.sigma.cells()[i];
    }
  out.filled_share = static_cast<double>(fill.filled) / static_cast<double>(which.cells().size());
}

}  // namespace

Result<CleanedLayer> clean_layer(PixelWindow& window, const PixelSize& pixel, const NodeMap& map,
                                 Clean what, double widest_void_m, const RunContext& run) {
  CleanedLayer out;
  Grid<float>& h = window.height_m;
  const Grid<std::uint8_t> narrow =
      narrow_voids(h, widest_void_m / (pixel.longer_m() * std::max(window.step_u, window.step_v)));
  Cleaned cleaned = clean(h, what);
  out.report = std::move(cleaned.report);
  if (!narrow.empty()) fill_named(h, narrow, cleaned, out);
  if (run.stopped()) return fail(kCancelled, "looking for artefacts was stopped");
  if (!cleaned.mask.empty()) {
    MAQUETTE_TRY(out.marks.artefacts, on_nodes(cleaned.mask, window, map, run));
  }
  if (!cleaned.doubt_m.empty()) {
    MAQUETTE_TRY(out.marks.doubt_m, on_nodes(cleaned.doubt_m, window, map, run));
  }
  if (!cleaned.made.empty()) {
    MAQUETTE_TRY(out.marks.made, on_nodes(cleaned.made, window, map, run));
  }
  return out;
}

std::string in_words(const ArtefactReport& report, double pixel_m) {
  std::vector<std::string> found;
  if (report.spikes > 0)
    found.push_back(fmt::format("{} spike{}", report.spikes, report.spikes > 1 ? "s" : ""));
  if (!report.boxes.empty()) {
    double most = 0.0;
    for (const BoxArtefact& b : report.boxes) most = std::max(most, std::abs(b.offset_m));
    found.push_back(fmt::format("{} box{} of up to {:.1f} m", report.boxes.size(),
                                report.boxes.size() > 1 ? "es" : "", most));
  }
  for (const SeamArtefact& s : report.seams)
    found.push_back(s.sigma_m >= std::abs(s.step_m)  // of either sign
                        ? fmt::format("steps of {:.2g} m rms along a {} (not separable)", s.step_m,
                                      s.level ? "row" : "column")
                        : fmt::format("a seam of {:.2f} +- {:.2f} m{}", std::abs(s.step_m),
                                      s.sigma_m, s.separable ? "" : " (not separable)"));
  for (const WaveArtefact& w : report.waves)
    found.push_back(fmt::format("waves of {:.3g} to {:.3g} m, {:.2f} m rms{}",
                                w.shortest_pixels * pixel_m, w.longest_pixels * pixel_m, w.rms_m,
                                w.separable ? "" : " (not separable)"));
  return fmt::format("{}", fmt::join(found, ", "));
}

}  // namespace maquette::heightmap::detail
