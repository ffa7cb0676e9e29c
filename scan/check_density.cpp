// SPDX-License-Identifier: GPL-3.0-or-later

// Where ground turns away from a scanner, its points lie farther apart. Counts over cells, without
// what goes slowly over the part (range, the instrument's own pattern of directions), are compared
// with what the places on a circle about the part would have left.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <vector>

#include <fmt/format.h>

#include "scan/check_stations.hpp"
#include "scan/detail/check_each_place.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;

constexpr double kPerCell = 50.0, kLeastInCell = 8.0;
constexpr std::size_t kLeastCells = 300;
constexpr double kMostCells = 40'000.0;  // the way round the part takes 0.2 s of them
constexpr std::ptrdiff_t kAround = 3;    // cells to each side: what goes more slowly is taken out
constexpr int kSub = 3;                  // places a side at which the design is looked at in a cell
constexpr double kHidden = 0.05;         // cosine times secant, instead of none
constexpr double kStepRad = 15.0 * std::numbers::pi / 180.0;  // then thirds of it
// What must be explained from elsewhere, and how much more than from the stated place: points that
// were thinned by voxels or at random, or left out where they met the surface at a grazing angle,
// have the scanner's own direction in what is left of it, or none. Of 344 such clouds another place
// explained at most 0.043 more.
constexpr double kLeastExplained = 0.12, kMoreExplained = 0.09;
constexpr double kLeastTurnRad = 25.0 * std::numbers::pi / 180.0;
constexpr double kOfRange = 0.2;

/// Cells of the design that the scan covers, with their neighbours.
struct Cells {
  std::ptrdiff_t rows = 0, cols = 0;
  double side_mm = 0.0;
  std::vector<double> count;
  std::vector<char> covered;
  Vec3 middle_mm;  ///< of the points
  [[nodiscard]] std::size_t index(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<std::size_t>(r * cols + c);
  }
};

std::optional<Cells> cells_of(const Cloud& cloud, std::size_t first, std::size_t n,
                              const RigidTransform& model_from_scan, const ModelField& design) {
  Cells cells;
  const double x0 = design.x0.value(), y0 = design.y0.value();
  const double wide = design.x_mm(design.z_mm.cols() - 1) - x0;
  const double deep = design.y_mm(design.z_mm.rows() - 1) - y0;
  cells.side_mm = std::fmax(
      std::sqrt(wide * deep * std::fmax(kPerCell / static_cast<double>(n), 1.0 / kMostCells)),
      2.0 * design.spacing.value());
  cells.rows = static_cast<std::ptrdiff_t>(deep / cells.side_mm);
  cells.cols = static_cast<std::ptrdiff_t>(wide / cells.side_mm);
  if (cells.rows * cells.cols < static_cast<std::ptrdiff_t>(kLeastCells)) return std::nullopt;
  cells.count.assign(static_cast<std::size_t>(cells.rows * cells.cols), 0.0);
  double counted = 0.0;
  for (std::size_t i = first; i < first + n; ++i) {
    const Vec3 p = model_from_scan.point(cloud.points_mm[i]);
    const double u = (p.x - x0) / cells.side_mm, v = (p.y - y0) / cells.side_mm;
    if (!(u >= 0.0 && v >= 0.0 && u < static_cast<double>(cells.cols) &&
          v < static_cast<double>(cells.rows)))
      continue;
    cells.count[cells.index(static_cast<std::ptrdiff_t>(v), static_cast<std::ptrdiff_t>(u))] += 1.0;
    cells.middle_mm += p;
    counted += 1.0;
  }
  if (counted == 0.0) return std::nullopt;
  cells.middle_mm = (1.0 / counted) * cells.middle_mm;
  cells.covered.assign(cells.count.size(), 0);
  for (std::ptrdiff_t r = 1; r + 1 < cells.rows; ++r)
    for (std::ptrdiff_t c = 1; c + 1 < cells.cols; ++c) {
      bool all = true;
      for (std::ptrdiff_t a = -1; a <= 1; ++a)
        for (std::ptrdiff_t b = -1; b <= 1; ++b)
          all = all && cells.count[cells.index(r + a, c + b)] >= kLeastInCell;
      cells.covered[cells.index(r, c)] = all ? 1 : 0;
    }
  return cells;
}

/// Normals of the design, (-dz/dx, -dz/dy, 1), at a few places of each cell.
struct Ground {
  std::vector<Vec3> at_mm, normal;  ///< kSub * kSub a cell
};

Ground ground_of(Cells& cells, const ModelField& design) {
  constexpr std::size_t kPlaces = std::size_t{kSub} * kSub;
  Ground ground;
  ground.at_mm.resize(cells.count.size() * kPlaces);
  ground.normal.resize(ground.at_mm.size());
  const double s = design.spacing.value();
  for (std::ptrdiff_t r = 0; r < cells.rows; ++r)
    for (std::ptrdiff_t c = 0; c < cells.cols; ++c) {
      const std::size_t cell = cells.index(r, c);
      if (cells.covered[cell] == 0) continue;
      for (int a = 0; a < kSub; ++a)
        for (int b = 0; b < kSub; ++b) {
          const double x =
              design.x0.value() + (static_cast<double>(c) + (b + 0.5) / kSub) * cells.side_mm;
          const double y =
              design.y0.value() + (static_cast<double>(r) + (a + 0.5) / kSub) * cells.side_mm;
          const auto h = [&](double dx, double dy) {
            return heightmap::height_at(design, x + dx, y + dy);
          };
          const std::size_t k = cell * kPlaces + static_cast<std::size_t>(a * kSub + b);
          ground.at_mm[k] = {x, y, h(0, 0)};
          ground.normal[k] = {(h(-s, 0) - h(s, 0)) / (2.0 * s), (h(0, -s) - h(0, s)) / (2.0 * s),
                              1.0};
          if (std::isnan(norm(ground.at_mm[k]) + norm(ground.normal[k]))) cells.covered[cell] = 0;
        }
    }
  return ground;
}

/// What differs from the mean of the cells around, over the cells that are covered.
std::vector<double> without_slow(const Cells& cells, const std::vector<double>& values) {
  std::vector<double> rest;
  for (std::ptrdiff_t r = 0; r < cells.rows; ++r)
    for (std::ptrdiff_t c = 0; c < cells.cols; ++c) {
      if (cells.covered[cells.index(r, c)] == 0) continue;
      double sum = 0.0, n = 0.0;
      for (std::ptrdiff_t a = std::max<std::ptrdiff_t>(0, r - kAround);
           a <= std::min(cells.rows - 1, r + kAround); ++a)
        for (std::ptrdiff_t b = std::max<std::ptrdiff_t>(0, c - kAround);
             b <= std::min(cells.cols - 1, c + kAround); ++b)
          if (const std::size_t k = cells.index(a, b); cells.covered[k] != 0)
            sum += values[k], n += 1.0;
      rest.push_back(std::clamp(values[cells.index(r, c)] - sum / n, -1.0, 1.0));
    }
  return rest;
}

/// Logarithm of points a surface's area that a scanner at `from` leaves, but for a factor.
std::vector<double> expected_from(Vec3 from, const Cells& cells, const Ground& ground) {
  constexpr std::size_t kPlaces = std::size_t{kSub} * kSub;
  std::vector<double> log(cells.count.size(), 0.0);
  for (std::size_t cell = 0; cell < log.size(); ++cell) {
    if (cells.covered[cell] == 0) continue;
    double seen = 0.0, area = 0.0;
    for (std::size_t k = cell * kPlaces; k < (cell + 1) * kPlaces; ++k) {
      const Vec3 look = normalized(from - ground.at_mm[k]);
      seen += std::fmax(0.0, dot(look, ground.normal[k]));
      area += norm(ground.normal[k]);
    }
    log[cell] = std::log(std::fmax(kHidden, seen / area));
  }
  return log;
}

/// Correlation; 0 where one of both is nothing but zeros.
double alike(const std::vector<double>& a, const std::vector<double>& b) {
  double aa = 0.0, bb = 0.0, ab = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i)
    aa += a[i] * a[i], bb += b[i] * b[i], ab += a[i] * b[i];
  return aa > 0.0 && bb > 0.0 ? ab / std::sqrt(aa * bb) : 0.0;
}

Result<void> check_place(Vec3 from, Cells cells, const ModelField& design) {
  const Ground ground = ground_of(cells, design);
  std::vector<double> log(cells.count.size(), 0.0);
  for (std::size_t cell = 0; cell < log.size(); ++cell) {
    if (cells.covered[cell] == 0) continue;
    double area = 0.0;
    for (std::size_t k = cell * kSub * kSub; k < (cell + 1) * kSub * kSub; ++k)
      area += norm(ground.normal[k]);
    log[cell] = std::log(cells.count[cell] / area);
  }
  const std::vector<double> seen = without_slow(cells, log);
  if (seen.size() < kLeastCells) return {};
  const Vec3 out{from.x - cells.middle_mm.x, from.y - cells.middle_mm.y, 0.0};
  const auto place = [&](double turn) {
    return from - out +
           Vec3{out.x * std::cos(turn) - out.y * std::sin(turn),
                out.x * std::sin(turn) + out.y * std::cos(turn), 0.0};
  };
  const auto explained_from = [&](Vec3 at) {
    const double r =
        std::fmax(0.0, alike(seen, without_slow(cells, expected_from(at, cells, ground))));
    return r * r;
  };
  const double stated = explained_from(from);
  double best = stated, best_turn = 0.0;
  const auto look = [&](double turn) {
    if (const double there = explained_from(place(turn)); there > best)
      best = there, best_turn = std::remainder(turn, 2.0 * std::numbers::pi);
  };
  for (double turn = kStepRad; turn < 2.0 * std::numbers::pi - 1e-9; turn += kStepRad) look(turn);
  for (const double about = best_turn; const double thirds : {-2.0, -1.0, 1.0, 2.0})
    look(about + thirds / 3.0 * kStepRad);
  // Heights on a raster are as dense as if seen from straight above, wherever they come from.
  const Vec3 above{cells.middle_mm.x, cells.middle_mm.y, 1e3 * norm(from - cells.middle_mm)};
  const Vec3 there = place(best_turn);
  if (best < kLeastExplained || best - std::fmax(stated, explained_from(above)) < kMoreExplained ||
      std::abs(best_turn) < kLeastTurnRad ||
      norm(there - from) < kOfRange * norm(from - cells.middle_mm))
    return {};
  return fail(
      kStationPose,
      fmt::format("the scan's points lie as dense as from x {:.0f}, y {:.0f}, z {:.0f} mm "
                  "of the model frame ({:.0f} % of how their density goes with the "
                  "ground), not as from x {:.0f}, y {:.0f}, z {:.0f} mm ({:.0f} %); give "
                  "the scanner's place in the frame of the cloud, or none",
                  there.x, there.y, there.z, 100.0 * best, from.x, from.y, from.z, 100.0 * stated));
}

}  // namespace

Result<void> check_density(const Cloud& cloud, const RigidTransform& model_from_scan,
                           const ModelField& design) {
  if (!cloud.grid.empty() || !cloud.counts.empty()) return {};
  const auto check = [&](Vec3 place, std::size_t first, std::size_t n) -> Result<void> {
    if (n == 0) return {};
    auto cells = cells_of(cloud, first, n, model_from_scan, design);
    if (!cells) return {};
    return check_place(model_from_scan.point(place), std::move(*cells), design);
  };
  return check_each_place(cloud, check);
}

}  // namespace maquette::scan
