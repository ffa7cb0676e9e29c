// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/patches.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "core/median.hpp"

namespace maquette::scan::detail {
namespace {

struct Patch {
  std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> cells;
};

double step_of(const Layer& layer, std::ptrdiff_t r, std::ptrdiff_t c) {
  const Cell& cell = layer.cells(r, c);
  return cell.sum / cell.n - static_cast<double>(layer.background_mm(r, c));
}

/// Cells that touch, corners included, of one sign.
std::vector<Patch> patches_of(const Layer& layer) {
  const std::ptrdiff_t rows = layer.marked.rows(), cols = layer.marked.cols();
  Grid<std::uint8_t> seen(rows, cols, 0);
  std::vector<Patch> patches;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      if (layer.marked(r, c) == 0 || seen(r, c) != 0) continue;
      const bool up = step_of(layer, r, c) > 0.0;
      Patch patch;
      patch.cells.emplace_back(r, c);
      seen(r, c) = 1;
      for (std::size_t i = 0; i < patch.cells.size(); ++i)
        for (std::ptrdiff_t a = -1; a <= 1; ++a)
          for (std::ptrdiff_t b = -1; b <= 1; ++b) {
            const std::ptrdiff_t y = patch.cells[i].first + a, x = patch.cells[i].second + b;
            if (!layer.marked.contains(y, x) || seen(y, x) != 0 || layer.marked(y, x) == 0 ||
                (step_of(layer, y, x) > 0.0) != up)
              continue;
            seen(y, x) = 1;
            patch.cells.emplace_back(y, x);
          }
      patches.push_back(std::move(patch));
    }
  return patches;
}

/// Weighted mean with the standard deviation that the cells state.
struct Mean {
  double sum = 0.0, weight = 0.0, cells = 0.0;
  void add(double value, double sigma) {
    sum += value / (sigma * sigma);
    weight += 1.0 / (sigma * sigma);
    cells += 1.0;
  }
  [[nodiscard]] double value() const { return weight > 0.0 ? sum / weight : 0.0; }
  [[nodiscard]] double sigma() const { return weight > 0.0 ? 1.0 / std::sqrt(weight) : 0.0; }
};

struct Height {
  double value = 0.0, sigma = 0.0;
  int full = 0;         ///< the mean of cells so deep in the patch (Window::full); 0: of mixed ones
  double cosine = 1.0;  ///< of the design's slope, weighted as the height is
};

/// A window of the map round a patch, where its extent is found anew.
class Window {
 public:
  static constexpr std::ptrdiff_t kAround = 6;
  Window(const Layer& layer, const Patch& patch) : layer_(&layer) {
    std::ptrdiff_t r0 = layer.marked.rows(), r1 = 0, c0 = layer.marked.cols(), c1 = 0;
    for (const auto& [r, c] : patch.cells) {
      r0 = std::min(r0, r), r1 = std::max(r1, r);
      c0 = std::min(c0, c), c1 = std::max(c1, c);
    }
    top_ = std::max<std::ptrdiff_t>(0, r0 - kAround);
    left_ = std::max<std::ptrdiff_t>(0, c0 - kAround);
    in_ = Grid<std::uint8_t>(std::min(layer.marked.rows() - 1, r1 + kAround) - top_ + 1,
                             std::min(layer.marked.cols() - 1, c1 + kAround) - left_ + 1, 0);
    for (const auto& [r, c] : patch.cells) in_(r - top_, c - left_) = 1;
    measure();
    for (int i = 0; i < 4; ++i) {
      refine();
      measure();
    }
  }

  [[nodiscard]] std::ptrdiff_t rows() const { return in_.rows(); }
  [[nodiscard]] std::ptrdiff_t cols() const { return in_.cols(); }
  [[nodiscard]] bool seen(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return in_.contains(i, j) && cell(i, j).n > 0.0;
  }
  [[nodiscard]] const Cell& cell(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return layer_->cells(top_ + i, left_ + j);
  }
  /// Against the part as a whole.
  [[nodiscard]] double step(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return step_of(*layer_, top_ + i, left_ + j);
  }
  [[nodiscard]] double sigma(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return static_cast<double>(layer_->sigma_mm(top_ + i, left_ + j));
  }
  [[nodiscard]] bool in(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return in_.contains(i, j) && in_(i, j) != 0;
  }
  /// Is a cell of the patch within so many steps, diagonals included?
  [[nodiscard]] bool near(std::ptrdiff_t i, std::ptrdiff_t j, int most) const {
    return steps_(i, j) <= most;
  }
  /// Is every cell within so many steps one of the patch?
  [[nodiscard]] bool deep(std::ptrdiff_t i, std::ptrdiff_t j, int least) const {
    return depth_(i, j) > least;
  }
  /// Is nothing but the patch in the cell? 1: its four neighbours belong to it, 2: three steps
  /// inside.
  [[nodiscard]] bool full(std::ptrdiff_t i, std::ptrdiff_t j, int depth) const {
    if (depth == 2) return deep(i, j, 2);
    return depth == 1 && in(i, j) && in(i - 1, j) && in(i + 1, j) && in(i, j - 1) && in(i, j + 1);
  }
  /// Mean of the neighbours of a cell without points; nothing where they are few.
  [[nodiscard]] std::optional<double> step_by_neighbours(std::ptrdiff_t i, std::ptrdiff_t j) const {
    double sum = 0.0, n = 0.0;
    for (std::ptrdiff_t a = -1; a <= 1; ++a)
      for (std::ptrdiff_t b = -1; b <= 1; ++b)
        if (seen(i + a, j + b)) sum += step(i + a, j + b), n += 1.0;
    if (n < 6.0) return std::nullopt;
    return sum / n;
  }
  [[nodiscard]] Patch patch() const {
    Patch p;
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j)
        if (in(i, j)) p.cells.emplace_back(top_ + i, left_ + j);
    return p;
  }
  /// Cells that make its base.
  [[nodiscard]] const FoundPatch::Cells& around() const { return around_; }
  /// Cells whose mean is its height; all of it where that is mixed.
  [[nodiscard]] FoundPatch::Cells inside() const {
    FoundPatch::Cells cells;
    each([&](std::ptrdiff_t i, std::ptrdiff_t j) {
      if (height.full > 0 ? full(i, j, height.full) : in(i, j))
        cells.emplace_back(top_ + i, left_ + j);
    });
    return cells;
  }
  [[nodiscard]] Vec3 middle(std::ptrdiff_t i, std::ptrdiff_t j) const {
    const CellMap& m = layer_->map;
    return {m.x0_mm + m.cell_mm * (static_cast<double>(left_ + j) + 0.5),
            m.y0_mm + m.cell_mm * (static_cast<double>(top_ + i) + 0.5), 0.0};
  }
  double base = 0.0, sigma_base = 0.0;  ///< surroundings against the part as a whole
  Height height;                        ///< against the surroundings

 private:
  /// Steps of a king to the nearest cell for which `is`; two passes are exact.
  template <class Is>
  Grid<int> count_steps(const Is& is) const {
    Grid<int> steps(rows(), cols(), 1'000'000);
    const auto pass = [&](std::ptrdiff_t i, std::ptrdiff_t j, std::ptrdiff_t way) {
      int least = is(i, j) ? 0 : steps(i, j);
      for (const auto& [a, b] :
           {std::pair<std::ptrdiff_t, std::ptrdiff_t>{-way, -1}, {-way, 0}, {-way, 1}, {0, -way}})
        if (steps.contains(i + a, j + b)) least = std::min(least, steps(i + a, j + b) + 1);
      steps(i, j) = least;
    };
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j) pass(i, j, 1);
    for (std::ptrdiff_t i = rows(); i-- > 0;)
      for (std::ptrdiff_t j = cols(); j-- > 0;) pass(i, j, -1);
    return steps;
  }

  template <class Visit>
  void each(const Visit& visit) const {
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j)
        if (seen(i, j)) visit(i, j);
  }

  void measure() {
    steps_ = count_steps([&](auto i, auto j) { return in(i, j); });
    depth_ = count_steps([&](auto i, auto j) { return !in(i, j); });
    measure_base();
    // Cells on slopes scatter less along the normal and weigh more: so do their cosines.
    struct Inside {
      Mean height, cosine;
    };
    Inside inside, far_inside;
    each([&](std::ptrdiff_t i, std::ptrdiff_t j) {
      if (!in(i, j)) return;
      const auto add = [&](Inside& to) {
        to.height.add(step(i, j) - base, sigma(i, j));
        to.cosine.add(cell(i, j).level / cell(i, j).n, sigma(i, j));
      };
      if (full(i, j, 2)) add(far_inside);
      if (full(i, j, 1)) add(inside);
    });
    constexpr double kEnough = 9.0;
    const int depth = far_inside.height.cells >= kEnough ? 2 : 1;
    if (depth == 2) inside = far_inside;
    height = {inside.height.value(), std::hypot(inside.height.sigma(), sigma_base), depth,
              inside.cosine.value()};
    if (inside.height.cells >= kEnough) return;
    const Height mixed = of_mixed_cells();
    if (inside.height.cells == 0.0 || mixed.sigma < height.sigma) height = mixed;
  }

  void measure_base() {
    // Its robust level first: other patches may lie in the surroundings.
    std::vector<double> steps;
    const auto around = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
      return near(i, j, kAround) && !near(i, j, 2);
    };
    each([&](std::ptrdiff_t i, std::ptrdiff_t j) {
      if (around(i, j)) steps.push_back(step(i, j));
    });
    base = sigma_base = noise2_ = 0.0;
    around_.clear();
    if (steps.empty()) return;
    const double middle = median(std::move(steps));
    constexpr double kOther = 4.0;  // standard deviations
    Mean mean;
    double own = 0.0, freedom = 0.0;
    each([&](std::ptrdiff_t i, std::ptrdiff_t j) {
      if (!around(i, j) || std::abs(step(i, j) - middle) > kOther * sigma(i, j)) return;
      mean.add(step(i, j), sigma(i, j));
      around_.emplace_back(top_ + i, left_ + j);
      const Cell& c = cell(i, j);
      own += std::fmax(0.0, c.square - c.sum * c.sum / c.n);
      freedom += c.n - 1.0;
    });
    base = mean.cells > 0.0 ? mean.value() : middle;
    sigma_base = mean.sigma();
    if (freedom > 0.0) noise2_ = own / freedom;
  }

  /// Height of a patch that no cell surely belongs to as a whole.
  [[nodiscard]] Height of_mixed_cells() const {
    double n = 0.0, first = 0.0, second = 0.0;
    each([&](std::ptrdiff_t i, std::ptrdiff_t j) {
      if (!near(i, j, 1)) return;
      const Cell& c = cell(i, j);
      const double zero = base + static_cast<double>(layer_->background_mm(top_ + i, left_ + j));
      n += c.n;
      first += c.sum - c.n * zero;
      second += c.square - 2.0 * zero * c.sum + c.n * (zero * zero - noise2_);
    });
    Mean all;
    each([&](std::ptrdiff_t i, std::ptrdiff_t j) {
      if (in(i, j)) all.add(step(i, j) - base, sigma(i, j));
    });
    const double plain = all.value(), h = second / first;
    // Noise may make nonsense of a few points.
    if (!(first * plain > 0.0) || !(h * plain > 0.0))
      return {plain, std::hypot(all.sigma(), sigma_base, 0.5 * plain), 0};
    const double scatter = noise2_ * h * h + 2.0 * noise2_ * noise2_;
    return {h, std::hypot(layer_->map.inflation * std::sqrt(n * scatter) / first, sigma_base), 0};
  }

  void refine() {
    Grid<std::uint8_t> next(rows(), cols(), 0);
    const double h = height.value;
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j) {
        if (!near(i, j, 2)) continue;
        Mean here;
        // A cell that is certain by itself needs no neighbours.
        const bool alone = seen(i, j) && std::abs(h) > 6.0 * sigma(i, j);
        const std::ptrdiff_t reach = alone ? 0 : 1;
        for (std::ptrdiff_t a = -reach; a <= reach; ++a)
          for (std::ptrdiff_t b = -reach; b <= reach; ++b)
            if (seen(i + a, j + b)) here.add(step(i + a, j + b), sigma(i + a, j + b));
        if (here.weight > 0.0 && (here.value() - base) * h > 0.5 * h * h) next(i, j) = 1;
      }
    if (std::any_of(next.cells().begin(), next.cells().end(), [](auto v) { return v != 0; }))
      in_ = std::move(next);
  }

  const Layer* layer_;
  std::ptrdiff_t top_ = 0, left_ = 0;
  Grid<std::uint8_t> in_;
  Grid<int> steps_, depth_;
  FoundPatch::Cells around_;
  double noise2_ = 0.0;  ///< variance of a point in the surroundings
};

/// Do the surroundings stand out rather than the patch? What lies as expected between two steps, or
/// between a step and the rim, is lower than all around it.
bool is_what_is_left(const Window& w) {
  return std::abs(w.base + w.height.value) < 0.5 * std::abs(w.base);
}

/// Its window grows with the patch until that is whole. A patch beside a large step that grew over
/// all that is not the step would have its height with the wrong sign: such a one stays as it was
/// met.
Window whole_patch(const Layer& layer, Patch patch) {
  const auto cells = layer.cells.cells();
  const auto seen = static_cast<std::size_t>(
      std::count_if(cells.begin(), cells.end(), [](const Cell& c) { return c.n > 0.0; }));
  Window w(layer, patch);
  if (2 * patch.cells.size() > seen) return w;
  const Window met = w;
  for (int i = 0; i < 60; ++i) {
    Patch now = w.patch();
    if (now.cells == patch.cells) break;
    if (2 * now.cells.size() > seen || is_what_is_left(w)) return met;
    patch = std::move(now);
    w = Window(layer, patch);
  }
  return w;
}

/// A rectangle of sides a and b has second moments a^2 / 12 and b^2 / 12. Of the cells of the patch
/// alone: far rims would weigh noise by the square of their distance.
void set_sides(const Window& w, double area, Finding& f) {
  double xx = 0.0, xy = 0.0, yy = 0.0;
  Vec3 sum;
  std::vector<Vec3> places;
  for (std::ptrdiff_t i = 0; i < w.rows(); ++i)
    for (std::ptrdiff_t j = 0; j < w.cols(); ++j)
      if (w.in(i, j)) {
        places.push_back(w.middle(i, j));
        sum += places.back();
      }
  const double n = static_cast<double>(places.size());
  for (const Vec3& p : places) {
    const Vec3 off = p - (1.0 / n) * sum;
    xx += off.x * off.x / n, xy += off.x * off.y / n, yy += off.y * off.y / n;
  }
  const double half = 0.5 * (xx + yy), root = std::hypot(0.5 * (xx - yy), xy);
  f.length_mm = std::sqrt(12.0 * std::fmax(0.0, half + root) + area);
  f.width_mm = std::sqrt(12.0 * std::fmax(0.0, half - root) + area);
}

/// Of a cell's mean, where points of two heights may mix.
double edge_sigma(const Window& w, std::ptrdiff_t i, std::ptrdiff_t j, double inflation) {
  const Cell& c = w.cell(i, j);
  if (c.n < 2.0 || w.deep(i, j, 1)) return w.sigma(i, j);
  const double own = std::fmax(0.0, c.square - c.sum * c.sum / c.n) / (c.n - 1.0);
  return inflation * std::sqrt(own / c.n);
}

Finding describe(const Layer& layer, const Window& w) {
  const double side = layer.map.cell_mm, area = side * side;
  Finding f;
  f.cell_mm = side;
  f.height_mm = w.height.value;
  f.sigma_height_mm = w.height.sigma;
  f.min_mm = {INFINITY, INFINITY, 0.0};
  f.max_mm = {-INFINITY, -INFINITY, 0.0};
  Vec3 first;
  // `rest`: of cells beside those whose mean is the height.
  double noise = 0.0, used = 0.0, points = 0.0, level = 0.0;
  double variance = 0.0, rest = 0.0, rest_variance = 0.0, rest_used = 0.0;
  for (std::ptrdiff_t i = 0; i < w.rows(); ++i)
    for (std::ptrdiff_t j = 0; j < w.cols(); ++j) {
      if (!w.near(i, j, 1)) continue;
      const bool seen = w.seen(i, j);
      const auto step = seen ? std::optional{w.step(i, j)} : w.step_by_neighbours(i, j);
      if (!step) continue;
      const double volume = (*step - w.base) * area;
      const Vec3 at = w.middle(i, j);
      const double edge = seen ? edge_sigma(w, i, j, layer.map.inflation) * area : 0.0;
      f.volume_mm3 += volume;
      variance += edge * edge;
      if (seen) noise += std::pow(w.sigma(i, j) * area, 2);
      used += area;
      first += volume * at;
      if (!w.full(i, j, w.height.full)) {
        rest += volume;
        rest_variance += edge * edge;
        rest_used += area;
      }
      if (!w.in(i, j)) continue;
      points += w.cell(i, j).n;
      level += w.cell(i, j).level;
      const Vec3 half{0.5 * side, 0.5 * side, 0.0};
      const Vec3 low = at - half, high = at + half;
      f.min_mm = {std::fmin(f.min_mm.x, low.x), std::fmin(f.min_mm.y, low.y), 0.0};
      f.max_mm = {std::fmax(f.max_mm.x, high.x), std::fmax(f.max_mm.y, high.y), 0.0};
    }
  f.sigma_volume_mm3 = std::hypot(std::sqrt(variance), used * w.sigma_base);
  if (f.volume_mm3 == 0.0 || f.height_mm == 0.0 || points == 0.0) return f;
  f.certainty = std::abs(f.volume_mm3) / std::hypot(std::sqrt(noise), used * w.sigma_base);
  f.along_z_mm = f.height_mm / (w.height.full > 0 ? w.height.cosine : level / points);
  f.centre_mm = (1.0 / f.volume_mm3) * first;
  f.area_mm2 = std::fmax(0.0, f.volume_mm3 / f.height_mm);
  f.diameter_mm = 2.0 * std::sqrt(f.area_mm2 / std::numbers::pi);
  // Cells that are full count with their whole area, whatever their height turns out to be.
  const double sigma_area = std::hypot(std::sqrt(rest_variance), rest_used * w.sigma_base,
                                       rest / f.height_mm * f.sigma_height_mm) /
                            std::abs(f.height_mm);
  if (f.area_mm2 > 0.0) f.sigma_diameter_mm = sigma_area / (0.5 * std::numbers::pi * f.diameter_mm);
  set_sides(w, area, f);
  return f;
}

}  // namespace

double typical_variance(const Grid<Cell>& cells) {
  std::vector<double> variances, counts;
  for (const Cell& c : cells.cells())
    if (c.n >= 3.0) {
      variances.push_back(std::fmax(0.0, (c.square - c.sum * c.sum / c.n) / (c.n - 1.0)));
      counts.push_back(c.n);
    }
  if (variances.empty()) return 0.0;
  // The median of s^2 with few degrees of freedom lies below its mean: Wilson and Hilferty.
  const double freedom = std::fmax(2.0, median(std::move(counts)) - 1.0);
  const double to_mean = 1.0 / std::pow(1.0 - 2.0 / (9.0 * freedom), 3.0);
  return std::fmax(1e-12, to_mean * median(std::move(variances)));
}

double pose_variance(const CellMap& map, std::ptrdiff_t r, std::ptrdiff_t c) {
  const double all = static_cast<double>(map.lod_mm(r, c)) / kLevelOfDetection,
               noise = static_cast<double>(map.sigma_mm(r, c));
  return std::isnan(all) ? 0.0 : std::fmax(0.0, all * all - noise * noise);
}

std::optional<FoundPatch> patch_at(const Layer& layer, FoundPatch::Cells some) {
  const Window w = whole_patch(layer, {std::move(some)});
  if (is_what_is_left(w)) return std::nullopt;
  FoundPatch found{describe(layer, w), w.patch().cells, w.inside(), w.around()};
  if (!(found.finding.certainty > 0.0)) return std::nullopt;
  return found;
}

std::vector<FoundPatch> find_patches(const Layer& layer) {
  std::vector<FoundPatch> found;
  for (Patch& patch : patches_of(layer))
    if (auto f = patch_at(layer, std::move(patch.cells))) found.push_back(*std::move(f));
  return found;
}

}  // namespace maquette::scan::detail
