// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "heightmap/detail/artefact_finders.hpp"
#include "heightmap/detail/void_fill.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr std::ptrdiff_t kSmallest = 16;  // pixels of a side
constexpr double kSeamSide = 2.0;         // pixels shown on either side

void shown(Cleaned& out, std::ptrdiff_t r, std::ptrdiff_t c, std::uint8_t what, double doubt_m) {
  out.mask(r, c) = static_cast<std::uint8_t>(out.mask(r, c) | what);
  out.doubt_m(r, c) =
      static_cast<float>(std::hypot(static_cast<double>(out.doubt_m(r, c)), doubt_m));
}

/// Takes spikes and boxes out of `work` and fills their places.
void patch(Grid<float>& work, Cleaned& out, bool remove) {
  const auto spikes = find_spikes(work);
  out.report.spikes = static_cast<std::ptrdiff_t>(spikes.size());
  Grid<std::uint8_t> made(work.rows(), work.cols(), 0);
  for (const Spike& s : spikes) {
    work(s.row, s.col) = NAN;
    made(s.row, s.col) = 1;
    shown(out, s.row, s.col, kSpike, remove ? 0.0 : std::abs(static_cast<double>(s.off_m)));
  }
  if (!spikes.empty()) std::ignore = fill_voids(work, &made);  // or their steps would hide boxes
  out.report.boxes = find_boxes(work, steps_of(work), out.report.box_limit_m);
  for (const BoxArtefact& b : out.report.boxes)
    for (std::ptrdiff_t r = b.row; r < b.row + b.rows; ++r)
      for (std::ptrdiff_t c = b.col; c < b.col + b.cols; ++c)
        if (!std::isnan(work(r, c))) {
          made(r, c) = 1;
          shown(out, r, c, kBox, remove ? 0.0 : std::abs(b.offset_m));
        }
  for (std::size_t i = 0; i < made.cells().size(); ++i)
    if (made.cells()[i] != 0) work.cells()[i] = NAN;
  const VoidFill fill = fill_voids(work, &made);
  if (!remove || fill.filled == 0) return;
  for (std::ptrdiff_t r = 0; r < work.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < work.cols(); ++c)
      if (made(r, c) != 0 && !std::isnan(work(r, c)))
        shown(out, r, c, kTakenAway, static_cast<double>(fill.sigma(r, c)));
  out.made = std::move(made);
}

/// Pixels from the seam, across it; beyond it from zero on.
double beyond(const SeamArtefact& s, const Grid<float>& h, std::ptrdiff_t r, std::ptrdiff_t c) {
  const std::ptrdiff_t along = s.level ? c : r, across = s.level ? r : c;
  const std::ptrdiff_t length = s.level ? h.cols() : h.rows();
  const double from_middle = static_cast<double>(along) - 0.5 * static_cast<double>(length - 1);
  return static_cast<double>(across) - std::round(s.slant * from_middle) - s.at;
}

/// Moves what lies beyond separable seams; the mean over all pixels stays.
void join(Grid<float>& work, Cleaned& out, bool remove) {
  out.report.seams = find_seams(work, steps_of(work));
  for (const SeamArtefact& s : out.report.seams) {
    double moved = 0.0, n = 0.0;
    for (std::ptrdiff_t r = 0; r < work.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < work.cols(); ++c) {
        if (std::isnan(work(r, c))) continue;
        const double past = beyond(s, work, r, c);
        n += 1.0;
        if (past >= 0.0) moved += s.step_m;
        const double along = s.level ? static_cast<double>(c) / static_cast<double>(work.cols())
                                     : static_cast<double>(r) / static_cast<double>(work.rows());
        if (std::abs(past + 0.5) > kSeamSide || along < s.from || along >= s.to) continue;
        const bool taken = remove && s.separable;
        shown(out, r, c, static_cast<std::uint8_t>(taken ? kSeam | kTakenAway : kSeam),
              taken ? s.sigma_m : 0.5 * std::abs(s.step_m));
      }
    if (!s.separable || n == 0.0) continue;
    for (std::ptrdiff_t r = 0; r < work.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < work.cols(); ++c)
        work(r, c) -=
            static_cast<float>((beyond(s, work, r, c) >= 0.0 ? s.step_m : 0.0) - moved / n);
  }
}

/// Takes separable waves away and shows all where they are half as strong as over the whole.
void still(Grid<float>& work, Cleaned& out, bool remove) {
  FoundWaves found = find_waves(work);
  out.report.waves = std::move(found.waves);
  for (const bool separable : {true, false}) {
    const Grid<float>& wave = separable ? found.separable_m : found.left_m;
    if (wave.empty()) continue;
    double square = 0.0, alike = 1.0;
    for (const float v : wave.cells()) square += static_cast<double>(v) * static_cast<double>(v);
    const double rms = std::sqrt(square / static_cast<double>(wave.cells().size()));
    for (const WaveArtefact& w : out.report.waves)
      if (w.separable == separable) alike = std::min(alike, w.alike);
    const bool taken = remove && separable;
    // What is not alike along the crests stays.
    const double doubt = taken ? rms * std::sqrt(std::max(0.0, 1.0 - alike)) : rms;
    for (std::ptrdiff_t r = 0; r < wave.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < wave.cols(); ++c) {
        if (std::isnan(work(r, c))) continue;
        if (std::abs(static_cast<double>(wave(r, c))) > 0.5 * rms)
          shown(out, r, c, static_cast<std::uint8_t>(taken ? kWaves | kTakenAway : kWaves), doubt);
        if (separable) work(r, c) -= wave(r, c);
      }
  }
}

}  // namespace

Cleaned clean(Grid<float>& h, Clean what) {
  Cleaned out;
  if (what == Clean::off || std::min(h.rows(), h.cols()) < kSmallest) return out;
  const bool remove = what == Clean::remove;
  out.mask = Grid<std::uint8_t>(h.rows(), h.cols(), 0);
  out.doubt_m = Grid<float>(h.rows(), h.cols(), 0.0F);
  // Each finder looks at what the ones before have left, whether it is kept or not.
  Grid<float> work = h;
  patch(work, out, remove);
  join(work, out, remove);
  still(work, out, remove);
  std::ptrdiff_t masked = 0;
  for (const std::uint8_t m : out.mask.cells()) masked += m != 0 ? 1 : 0;
  out.report.masked_share =
      static_cast<double>(masked) / static_cast<double>(out.mask.cells().size());
  if (masked == 0) {
    out.mask = {};
    out.doubt_m = {};
    return out;
  }
  if (remove) h = std::move(work);
  return out;
}

}  // namespace maquette::heightmap::detail
