// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/small_patches.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace maquette::scan::detail {
namespace {

// Discs as wide as so many of the finest cells are cut out of the points.
constexpr double kFitCells = 16.0;
// A patch that stands out by less has no shape but round.
constexpr double kShapeless = 16.0;  // standard deviations

/// Cells and their neighbours: what lies across the edge of a patch is neither.
void mark_with_rim(const FoundPatch::Cells& cells, Grid<std::uint8_t>& marked) {
  for (const auto& [r, c] : cells)
    for (std::ptrdiff_t a = -1; a <= 1; ++a)
      for (std::ptrdiff_t b = -1; b <= 1; ++b)
        if (marked.contains(r + a, c + b)) marked(r + a, c + b) = 1;
}

bool overlap(const Finding& a, const Finding& b) {
  return a.min_mm.x < b.max_mm.x && b.min_mm.x < a.max_mm.x && a.min_mm.y < b.max_mm.y &&
         b.min_mm.y < a.max_mm.y;
}

/// What a disc has found, or what has grown away from the cell that began it, is drawn all the
/// same.
void draw(const FoundPatch& patch, CellMap& map) {
  mark_with_rim(patch.all, map.in_patch);
  if (std::none_of(patch.all.begin(), patch.all.end(),
                   [&](const auto& cell) { return map.significant(cell.first, cell.second) != 0; }))
    for (const auto& [r, c] : patch.all) map.significant(r, c) = 1;
}

/// The layer in which a disc has some four cells across: fewer have no inside, of more each is mere
/// noise.
std::size_t size_for(double width_mm, std::span<const Layer> layers) {
  std::size_t size = 0;
  while (size + 1 < layers.size() && layers[size + 1].map.cell_mm < width_mm / 3.5) ++size;
  return size;
}

bool touch(const Disc& d, const Finding& f) {
  const double r = 0.5 * d.width_mm;
  return d.x_mm > f.min_mm.x - r && d.x_mm < f.max_mm.x + r && d.y_mm > f.min_mm.y - r &&
         d.y_mm < f.max_mm.y + r;
}

/// Discs that touch none of those that cells have shown, and none that stands out more.
std::vector<Disc> alone(std::span<const Disc> discs, std::span<const FoundPatch> known) {
  constexpr std::size_t kMost = 200;
  std::vector<Disc> found;
  for (const Disc& d : discs) {
    if (std::any_of(known.begin(), known.end(),
                    [&](const auto& g) { return touch(d, g.finding); }) ||
        std::any_of(found.begin(), found.end(), [&](const Disc& o) {
          return std::hypot(d.x_mm - o.x_mm, d.y_mm - o.y_mm) < 0.5 * (d.width_mm + o.width_mm);
        }))
      continue;
    found.push_back(d);
    if (found.size() == kMost) break;
  }
  return found;
}

/// The points about each disc, less the part as a whole.
std::vector<std::vector<Sample>> samples_about(
    std::span<const Disc> discs, std::span<const Vec3> points, std::span<const float> deviation,
    const std::function<double(double, double)>& level_mm, const CellMap& map) {
  std::vector<std::vector<Sample>> samples(discs.size());
  Grid<std::uint8_t> near(map.mean_mm.rows(), map.mean_mm.cols(), 0);
  const auto cell = [&](double at, double zero) {
    return static_cast<std::ptrdiff_t>((at - zero) / map.cell_mm);
  };
  for (const Disc& d : discs) {
    const double reach = kDiscWindow * d.width_mm;
    for (auto r = std::max<std::ptrdiff_t>(0, cell(d.y_mm - reach, map.y0_mm));
         r < near.rows() && r <= cell(d.y_mm + reach, map.y0_mm); ++r)
      for (auto c = std::max<std::ptrdiff_t>(0, cell(d.x_mm - reach, map.x0_mm));
           c < near.cols() && c <= cell(d.x_mm + reach, map.x0_mm); ++c)
        near(r, c) = 1;
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 p = points[i];
    if (std::isnan(deviation[i]) || near(cell(p.y, map.y0_mm), cell(p.x, map.x0_mm)) == 0) continue;
    for (std::size_t k = 0; k < discs.size(); ++k)
      if (std::hypot(p.x - discs[k].x_mm, p.y - discs[k].y_mm) < kDiscWindow * discs[k].width_mm)
        samples[k].push_back({p.x, p.y, static_cast<double>(deviation[i]) - level_mm(p.x, p.y)});
  }
  return samples;
}

/// A disc as a patch of a layer.
FoundPatch patch_of(const DiscFit& fit, const Layer& layer) {
  const CellMap& map = layer.map;
  const double r = 0.5 * fit.diameter_mm;
  FoundPatch patch;
  const auto row = static_cast<std::ptrdiff_t>((fit.y_mm - map.y0_mm) / map.cell_mm);
  const auto col = static_cast<std::ptrdiff_t>((fit.x_mm - map.x0_mm) / map.cell_mm);
  const auto reach = static_cast<std::ptrdiff_t>(kDiscWindow * fit.diameter_mm / map.cell_mm) + 1;
  double level = 0.0, points = 0.0;
  for (std::ptrdiff_t i = row - reach; i <= row + reach; ++i)
    for (std::ptrdiff_t j = col - reach; j <= col + reach; ++j) {
      if (!map.mean_mm.contains(i, j)) continue;
      const double off =
          std::hypot(map.x0_mm + map.cell_mm * (static_cast<double>(j) + 0.5) - fit.x_mm,
                     map.y0_mm + map.cell_mm * (static_cast<double>(i) + 0.5) - fit.y_mm);
      if (off < r || (i == row && j == col)) {
        patch.all.emplace_back(i, j);
        level += layer.cells(i, j).level, points += layer.cells(i, j).n;
      } else if (off > kDiscBase * fit.diameter_mm && off < kDiscWindow * fit.diameter_mm) {
        patch.around.emplace_back(i, j);
      }
    }
  patch.inside = patch.all;
  Finding& f = patch.finding;
  f.cell_mm = map.cell_mm;
  f.centre_mm = {fit.x_mm, fit.y_mm, 0.0};
  f.height_mm = fit.height_mm, f.sigma_height_mm = fit.sigma_height_mm;
  f.along_z_mm = points > 0.0 ? fit.height_mm * points / level : fit.height_mm;
  f.area_mm2 = fit.area_mm2;
  f.diameter_mm = fit.diameter_mm, f.sigma_diameter_mm = fit.sigma_diameter_mm;
  f.length_mm = f.width_mm = 0.5 * std::sqrt(3.0) * fit.diameter_mm;  // equal second moments
  f.volume_mm3 = fit.volume_mm3, f.sigma_volume_mm3 = fit.sigma_volume_mm3;
  f.min_mm = {fit.x_mm - r, fit.y_mm - r, 0.0};
  f.max_mm = {fit.x_mm + r, fit.y_mm + r, 0.0};
  return patch;
}

/// The patch that cells show at a disc.
std::optional<FoundPatch> patch_by_cells(const Disc& d, const Layer& layer) {
  const CellMap& map = layer.map;
  const auto row = static_cast<std::ptrdiff_t>((d.y_mm - map.y0_mm) / map.cell_mm);
  const auto col = static_cast<std::ptrdiff_t>((d.x_mm - map.x0_mm) / map.cell_mm);
  FoundPatch::Cells cells;
  for (std::ptrdiff_t r = row - 2; r <= row + 2; ++r)
    for (std::ptrdiff_t c = col - 2; c <= col + 2; ++c) {
      const double x = map.x0_mm + map.cell_mm * (static_cast<double>(c) + 0.5) - d.x_mm,
                   y = map.y0_mm + map.cell_mm * (static_cast<double>(r) + 0.5) - d.y_mm;
      const bool inside = std::hypot(x, y) < 0.35 * d.width_mm || (r == row && c == col);
      if (inside && map.mean_mm.contains(r, c)) cells.emplace_back(r, c);
    }
  return patch_at(layer, std::move(cells));
}

/// The gain of a patch as its cells have it: of all its points, on the base of the disc.
double gain_of(const FoundPatch& patch, const DiscFit& fit, std::span<const Layer> layers) {
  const auto layer =
      std::min_element(layers.begin(), layers.end(), [&](const auto& a, const auto& b) {
        return std::abs(a.map.cell_mm - patch.finding.cell_mm) <
               std::abs(b.map.cell_mm - patch.finding.cell_mm);
      });
  double n = 0.0, sum = 0.0;
  for (const auto& [r, c] : patch.all) {
    const Cell& cell = layer->cells(r, c);
    n += cell.n;
    sum += cell.sum - cell.n * (fit.base_mm + static_cast<double>(layer->background_mm(r, c)));
  }
  return n > 0.0 ? sum * sum / n / fit.variance : 0.0;
}

}  // namespace

void keep(FoundPatch patch, CellMap& map, std::vector<FoundPatch>& kept) {
  if (std::any_of(kept.begin(), kept.end(),
                  [&](const FoundPatch& g) { return overlap(patch.finding, g.finding); }))
    return;
  draw(patch, map);
  kept.push_back(std::move(patch));
}

void search_by_discs(std::span<const Layer> layers, double typical, const DiscSearch& discs,
                     std::span<const Vec3> points, std::span<const float> deviation,
                     const std::function<double(double, double)>& level_mm, double beam_diameter_mm,
                     std::vector<CellMap>& maps, std::vector<FoundPatch>& kept) {
  const double widest = kFitCells * layers.front().map.cell_mm;
  struct Seed {
    Disc disc;
    std::ptrdiff_t of_kept = -1;
  };
  std::vector<Seed> seeds;
  for (std::size_t k = 0; k < kept.size(); ++k) {
    const Finding& f = kept[k].finding;
    if (f.certainty > kShapeless) continue;
    const auto d = std::find_if(discs.found.begin(), discs.found.end(), [&](const auto& o) {
      return (o.z > 0.0) == (f.height_mm > 0.0) && o.width_mm < widest && touch(o, f);
    });
    if (d != discs.found.end()) seeds.push_back({*d, static_cast<std::ptrdiff_t>(k)});
  }
  for (const Disc& d : alone(discs.found, kept)) seeds.push_back({d, -1});

  std::vector<Disc> narrow;
  std::vector<std::size_t> seed_of;
  for (std::size_t k = 0; k < seeds.size(); ++k)
    if (seeds[k].disc.width_mm < widest) {
      narrow.push_back(seeds[k].disc);
      seed_of.push_back(k);
    }
  std::vector<std::optional<DiscFit>> fits(seeds.size());
  const auto samples = samples_about(narrow, points, deviation, level_mm, layers.front().map);
  for (std::size_t k = 0; k < narrow.size(); ++k)
    if (auto fit = fit_disc(narrow[k], samples[k], typical, beam_diameter_mm);
        fit && fit->gain < kShapeless * kShapeless)
      fits[seed_of[k]] = *fit;

  std::vector<std::pair<FoundPatch, std::size_t>> found;
  for (std::size_t k = 0; k < seeds.size(); ++k) {
    const Disc& d = seeds[k].disc;
    const auto& fit = fits[k];
    const std::size_t size = size_for(fit ? fit->diameter_mm : d.width_mm, layers);
    const auto by_disc = [&](double certainty) {
      FoundPatch patch = patch_of(*fit, layers[size]);
      patch.finding.certainty = std::fmax(certainty, std::abs(d.z));
      return patch;
    };
    if (seeds[k].of_kept >= 0) {
      const auto of = static_cast<std::size_t>(seeds[k].of_kept);
      const double certainty = kept[of].finding.certainty;
      if (!fit || fit->gain < gain_of(kept[of], *fit, layers)) continue;
      kept[of] = by_disc(certainty);
      draw(kept[of], maps[size]);
      continue;
    }
    auto patch = patch_by_cells(d, layers[size]);
    if (patch) patch->finding.certainty = std::fmax(patch->finding.certainty, std::abs(d.z));
    if (fit && (!patch || fit->gain >= gain_of(*patch, *fit, layers))) patch = by_disc(0.0);
    if (patch) found.emplace_back(*std::move(patch), size);
  }
  // Of cells of several sizes two may have met one patch.
  for (std::size_t k = 0; k < kept.size(); ++k)
    kept.erase(std::remove_if(kept.begin() + static_cast<std::ptrdiff_t>(k) + 1, kept.end(),
                              [&](const auto& g) {
                                return overlap(kept[k].finding, g.finding) &&
                                       kept[k].finding.height_mm * g.finding.height_mm > 0.0;
                              }),
               kept.end());
  for (auto& [patch, size] : found) keep(std::move(patch), maps[size], kept);
}

}  // namespace maquette::scan::detail
