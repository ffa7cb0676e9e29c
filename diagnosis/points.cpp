// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/points.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace maquette::diagnosis::detail {
namespace {
using Eigen::Index;
using Eigen::MatrixXd;

constexpr double kLevel = 1e6, kTrend = 1e2;  // variances of level and slope over a cell
constexpr Index kQuadric = 6;
constexpr double kLeastRise = 0.2;  // steeper cells tell little of heights

std::uint64_t interleave(std::uint64_t r, std::uint64_t c) {
  std::uint64_t key = 0;
  for (int b = 2; b >= 0; --b) key = (key << 2) | (((r >> b) & 1U) << 1) | ((c >> b) & 1U);
  return key;
}

constexpr int kSetUpBits = 8;

/// Means of squares by set-up, in the order of the squares.
struct Level {
  RowMatrix value;
  std::vector<double> weight;
  std::vector<std::uint64_t> square;
  std::vector<std::uint32_t> set_up;
  [[nodiscard]] std::size_t size() const { return weight.size(); }
};

/// Means over runs of equal square and set-up; `value` becomes the scatter about them.
Level up(Level& level, int shift) {
  Level next;
  std::vector<Index> of(level.size());
  for (std::size_t i = 0; i < level.size(); ++i) {
    const std::uint64_t square = level.square[i] >> shift;
    std::size_t at = next.size();
    while (at > 0 && next.square[at - 1] == square && next.set_up[at - 1] != level.set_up[i]) --at;
    if (at > 0 && next.square[at - 1] == square) {
      next.weight[at - 1] += level.weight[i];
      of[i] = static_cast<Index>(at - 1);
    } else {
      of[i] = static_cast<Index>(next.size());
      next.weight.push_back(level.weight[i]);
      next.square.push_back(square);
      next.set_up.push_back(level.set_up[i]);
    }
  }
  next.value = RowMatrix::Zero(static_cast<Index>(next.size()), level.value.cols());
  for (std::size_t i = 0; i < level.size(); ++i)
    next.value.row(of[i]) += level.weight[i] / next.weight[static_cast<std::size_t>(of[i])] *
                             level.value.row(static_cast<Index>(i));
  for (std::size_t i = 0; i < level.size(); ++i)
    level.value.row(static_cast<Index>(i)) =
        std::sqrt(level.weight[i]) *
        (level.value.row(static_cast<Index>(i)) - next.value.row(of[i]));
  return next;
}

/// Runs of one square: calls run(first, end).
template <class Run>
void each_square(const Level& level, const Run& run) {
  for (std::size_t i = 0, j; i < level.size(); i = j) {
    for (j = i; j < level.size() && level.square[j] == level.square[i];) ++j;
    run(i, j);
  }
}

/// Terms of a quadric about the cell's centre, lengths in cells.
Eigen::Matrix<double, 1, kQuadric> quadric_at(double u, double v) {
  return (Eigen::Matrix<double, 1, kQuadric>() << 1.0, u, v, u * u, u * v, v * v).finished();
}

/// Covariance of the means of two squares of `side` cells (0: points), lengths in cells, their
/// correlation taken for a Gaussian again.
double smooth_covariance(Vec3 a, Vec3 b, double side_a, double side_b, double length) {
  const double own = length * length, wide = own + (side_a * side_a + side_b * side_b) / 12.0,
               dx = a.x - b.x, dy = a.y - b.y;
  return own / wide * std::exp(-0.5 * (dx * dx + dy * dy) / wide) + kLevel +
         kTrend * (a.x * b.x + a.y * b.y);
}

/// The quadric within each cell of a block, from the means of its cells.
std::vector<Eigen::MatrixXf> quadrics(const std::vector<Points::Cell>& all,
                                      const std::vector<std::size_t>& block, const Layout& layout) {
  const double cell_mm = layout.cell_mm, length = layout.smooth.length_mm / cell_mm;
  std::vector<Vec3> centre;
  Vec3 middle;
  double points = 0.0;
  for (const std::size_t i : block) {
    middle += (1.0 / static_cast<double>(block.size())) * all[i].centre;
    points = std::fmax(points, static_cast<double>(all[i].end - all[i].begin));
  }
  for (const std::size_t i : block) centre.push_back((1.0 / cell_mm) * (all[i].centre - middle));
  const auto n = static_cast<Index>(block.size());
  MatrixXd c(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j)
      c(i, j) = smooth_covariance(centre[static_cast<std::size_t>(i)],
                                  centre[static_cast<std::size_t>(j)], 1.0, 1.0, length);
  for (Index i = 0; i < n; ++i) {
    const Points::Cell& cell = all[block[static_cast<std::size_t>(i)]];
    c(i, i) += layout.smooth.nugget * points / static_cast<double>(cell.end - cell.begin);
  }
  const Eigen::LDLT<MatrixXd> solver(c);
  Eigen::VectorXd of_mean(n);  // height from a mean
  for (Index i = 0; i < n; ++i)
    of_mean(i) = 1.0 / std::fmax(kLeastRise, all[block[static_cast<std::size_t>(i)]].rise);
  // Nine places of a cell.
  constexpr double kPlace = 0.4;
  Eigen::Matrix<double, 9, kQuadric> terms;
  for (Index k = 0; k < 9; ++k)
    terms.row(k) = quadric_at(kPlace * static_cast<double>(k % 3 - 1),
                              kPlace * static_cast<double>(k / 3 - 1));
  const MatrixXd fit = (terms.transpose() * terms).ldlt().solve(terms.transpose());
  std::vector<Eigen::MatrixXf> result;
  for (const Vec3& at : centre) {
    MatrixXd to(n, 9);
    for (Index k = 0; k < 9; ++k) {
      const Vec3 place = at + Vec3{kPlace * static_cast<double>(k % 3 - 1),
                                   kPlace * static_cast<double>(k / 3 - 1), 0.0};
      for (Index i = 0; i < n; ++i)
        to(i, k) = smooth_covariance(place, centre[static_cast<std::size_t>(i)], 0.0, 1.0, length);
    }
    const MatrixXd heights = solver.solve(to).transpose() * of_mean.asDiagonal();  // 9 x n
    result.push_back((fit * heights).cast<float>());
  }
  return result;
}

/// Whether set-up `a` of a cell sees the same of it as those before: points a quarter, within what
/// so few of them scatter by. Where it does not, their means differ by what lies in between.
bool see_alike(const Level& quarters, const Level& cell, std::size_t a) {
  constexpr double kAlike = 0.7;
  std::map<std::uint64_t, std::array<double, 2>> points;
  for (std::size_t i = 0; i < quarters.size(); ++i)
    for (std::size_t k = 0; k <= a; ++k)
      if (quarters.set_up[i] == cell.set_up[k])
        points[quarters.square[i]][k < a ? 0 : 1] += quarters.weight[i];
  std::array<double, 2> all{};
  for (const auto& [quarter, n] : points)
    for (std::size_t k = 0; k < 2; ++k) all[k] += n[k];
  double alike = std::sqrt(1.0 / all[0] + 1.0 / all[1]);
  for (const auto& [quarter, n] : points) alike += std::fmin(n[0] / all[0], n[1] / all[1]);
  return alike > kAlike;
}

}  // namespace

void transform(const Points& points, const Points::Cell& cell, RowMatrix& x, FloatRows& out) {
  Level level;
  level.value = std::move(x);
  for (std::size_t i = cell.begin; i < cell.end; ++i) {
    level.weight.push_back(1.0);
    level.square.push_back(points.order[i].first >> kSetUpBits);
    level.set_up.push_back(
        static_cast<std::uint32_t>(points.order[i].first & ((1U << kSetUpBits) - 1U)));
  }
  Level next = up(level, 0);
  out.middleRows(cell.row[kPointGroup], cell.rows[kPointGroup]) = level.value.cast<float>();
  Eigen::RowVectorXd mean;
  for (int scale = kScales - 1; scale >= 0; --scale) {
    level = std::move(next);
    next = up(level, 2);
    // Details of one square, turned into their mean over the set-ups and differences.
    Index common = cell.row[static_cast<std::size_t>(scale)],
          between = cell.row[static_cast<std::size_t>(kScales + scale)];
    each_square(level, [&](std::size_t i, std::size_t j) {
      mean = level.value.row(static_cast<Index>(i));
      double weight = level.weight[i];
      for (std::size_t k = i + 1; k < j; ++k) {
        const double w = level.weight[k], a = std::sqrt(weight / (weight + w)),
                     b = std::sqrt(w / (weight + w));
        const auto row = level.value.row(static_cast<Index>(k));
        out.row(between++) = (b * mean - a * row).cast<float>();
        mean = a * mean + b * row;
        weight += w;
      }
      out.row(common++) = mean.cast<float>();
    });
  }
  mean = next.value.row(0);
  double weight = next.weight[0];
  for (std::size_t k = 1; k < next.size(); ++k) {
    const auto row = next.value.row(static_cast<Index>(k));
    out.row(cell.mean + static_cast<Index>(k)) = (row - mean).cast<float>();
    mean = (weight * mean + next.weight[k] * row) / (weight + next.weight[k]);
    weight += next.weight[k];
  }
  out.row(cell.mean) = mean.cast<float>();
}

void lift(const Points& p, FloatRows& details, const OfSets& sets) {
  oneapi::tbb::parallel_for(std::size_t{0}, p.smooth.size(), [&](std::size_t b) {
    const Points::Block& block = p.smooth[b];
    if (!sets[static_cast<std::size_t>(p.cells[block.cells[0]].set)]) return;
    FloatRows means(static_cast<Index>(block.cells.size()), details.cols());
    for (std::size_t i = 0; i < block.cells.size(); ++i)
      means.row(static_cast<Index>(i)) = details.row(p.cells[block.cells[i]].mean);
    for (std::size_t i = 0; i < block.cells.size(); ++i) {
      const Points::Cell& cell = p.cells[block.cells[i]];
      const Index first = cell.row[0], rows = cell.mean + cell.means - first;
      const FloatRows expected = block.quadric[i] * means;
      details.middleRows(first, rows).noalias() -= p.shape.middleRows(first, rows) * expected;
    }
  });
}

Points sort_points(const std::vector<Observation>& all, const Layout& layout, int only,
                   Bank& bank) {
  Points p;
  std::array<SetSums, kSets>& sets = bank.sets;
  const double square = layout.cell_mm / 8.0;
  for (std::uint32_t i = 0; i < all.size(); ++i) {
    const Observation& o = all[i];
    if (const int set = layout.set_of(o.place.x, o.place.y); set < 0 || (only >= 0 && set != only))
      continue;
    const auto c = static_cast<std::uint64_t>(std::clamp(
        (o.place.x - layout.x0) / square, 0.0, 8.0 * static_cast<double>(layout.cols) - 1e-6));
    const auto r = static_cast<std::uint64_t>(std::clamp(
        (o.place.y - layout.y0) / square, 0.0, 8.0 * static_cast<double>(layout.rows) - 1e-6));
    const std::uint64_t cell = (r / 8) * static_cast<std::uint64_t>(layout.cols) + c / 8;
    p.order.emplace_back((((cell << 6) | interleave(r % 8, c % 8)) << kSetUpBits) |
                             (o.set_up & ((1U << kSetUpBits) - 1U)),
                         i);
  }
  std::sort(p.order.begin(), p.order.end());
  const auto cell_of = [&](std::size_t i) { return p.order[i].first >> (6 + kSetUpBits); };
  for (std::size_t i = 0, j; i < p.order.size(); i = j) {
    for (j = i; j < p.order.size() && cell_of(j) == cell_of(i);) ++j;
    const Vec3 first = all[p.order[i].second].place;
    Points::Cell cell{layout.set_of(first.x, first.y), i, j, {}, {}, 0, 0, 0, {}, 1.0};
    SetSums& set = sets[static_cast<std::size_t>(cell.set)];
    Level level;
    Vec3 centre;
    double rise = 0.0;
    for (std::size_t a = i; a < j; ++a) {
      centre += (1.0 / static_cast<double>(j - i)) * all[p.order[a].second].place;
      rise += all[p.order[a].second].along.z / static_cast<double>(j - i);
      level.weight.push_back(1.0);
      level.square.push_back(p.order[a].first >> kSetUpBits);
      level.set_up.push_back(all[p.order[a].second].set_up);
    }
    level.value.resize(static_cast<Index>(level.size()), 0);
    const auto squares = [](const Level& l) {
      Index n = 0;
      each_square(l, [&](std::size_t, std::size_t) { ++n; });
      return n;
    };
    Level next = up(level, 0);
    cell.rows[kPointGroup] = static_cast<Index>(level.size());
    set.count[kPointGroup] += static_cast<double>(level.size() - next.size());
    for (int scale = kScales - 1; scale >= 0; --scale) {
      level = std::move(next);
      next = up(level, 2);
      const auto c = static_cast<std::size_t>(scale), d = static_cast<std::size_t>(kScales + scale);
      cell.rows[c] = squares(level);
      cell.rows[d] = static_cast<Index>(level.size()) - cell.rows[c];
      const Index parents = squares(next);
      set.count[c] += static_cast<double>(cell.rows[c] - parents);
      set.count[d] +=
          static_cast<double>(cell.rows[d] - (static_cast<Index>(next.size()) - parents));
    }
    for (std::size_t g = 0; g < kGroups; ++g) {
      cell.row[g] = p.rows;
      p.rows += cell.rows[g];
    }
    cell.mean = p.rows;
    cell.means = static_cast<Index>(next.size());
    p.rows += cell.means;
    double weight = next.weight[0];
    for (std::size_t a = 1; a < next.size(); ++a) {
      if (see_alike(level, next, a)) {
        set.top[1].weight.push_back(weight * next.weight[a] / (weight + next.weight[a]));
        set.top[1].centre.push_back(centre);
        set.top[1].rise.push_back(rise);
        set.top[1].which.push_back(static_cast<std::uint32_t>(a));
        cell.differences.push_back(static_cast<Index>(a));
      }
      weight += next.weight[a];
    }
    for (TopSums* top : {&set.top[0], &bank.joint}) {
      if (top == &bank.joint && only >= 0) continue;
      top->weight.push_back(weight);
      top->centre.push_back(centre);
      top->rise.push_back(rise);
      top->which.push_back(0);
    }
    cell.at = cell_of(i) & 0xffffffffU;
    cell.centre = centre;
    cell.rise = rise;
    p.cells.push_back(cell);
  }
  p.cells_a_row = static_cast<std::uint64_t>(layout.cols);
  if (!(layout.smooth.length_mm > 0.0)) return p;
  std::map<int, std::vector<std::size_t>> by_block;
  for (std::size_t i = 0; i < p.cells.size(); ++i)
    by_block[layout.block_of(p.cells[i].centre.x, p.cells[i].centre.y)].push_back(i);
  for (auto& [block, cells] : by_block) {
    auto quadric = quadrics(p.cells, cells, layout);
    p.smooth.push_back({std::move(cells), std::move(quadric)});
  }
  p.shape.resize(p.rows, kQuadric);
  each_cell(p, [&](std::size_t, const Points::Cell& cell) {
    RowMatrix x(static_cast<Index>(cell.end - cell.begin), kQuadric);
    for (Index i = 0; i < x.rows(); ++i) {
      const Observation& o = all[p.order[cell.begin + static_cast<std::size_t>(i)].second];
      const Vec3 off = (1.0 / layout.cell_mm) * (o.place - cell.centre);
      x.row(i) = o.along.z * quadric_at(off.x, off.y);
    }
    transform(p, cell, x, p.shape);
    p.shape.row(cell.mean).setZero();
  });
  return p;
}

}  // namespace maquette::diagnosis::detail
