// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numeric>

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {
namespace {
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using FloatRows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::size_t kStripes = 8;  // fixed: sums do not depend on threads
}  // namespace

/// Details as floats: sums are of doubles, and a column rounded to 24 bits is a column as good.
struct Points {
  struct Cell {
    int set;
    std::size_t begin, end;                // of `order`
    std::array<Index, kGroups> row, rows;  // of its details
    Index mean, means;                     // one over the set-ups, then differences
    std::size_t top, between;              // rows among the set's
    std::uint64_t at = 0;                  // row of cells times their number a row, plus column
  };
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order;  // by cell, square, set-up
  std::vector<Cell> cells;
  std::uint64_t cells_a_row = 1;
  Index rows = 0;
  std::vector<FloatRows> blocks;  // columns, in the bank's order
  FloatRows residual;
  struct Top {
    MatrixXd factor, white;  // Cholesky's, of the means' covariance; means of the columns over it
    VectorXd white_y;
  };
  std::array<std::array<std::vector<Top>, kTops>, kSets> top;  // by theta
};

std::vector<Theta> thetas(double cell) {
  std::vector<Theta> all{{}};
  const auto add = [&](bool gauss, double length) {
    for (const double ratio : {0.7, 3.0, kStartRatio, 50.0, 200.0, 1000.0})
      all.push_back({gauss, length * cell, ratio});
  };
  for (const double length : {0.6, 1.2, 2.5, 5.0, 10.0, 20.0}) add(false, length);
  // Smooth processes far above the white part tell their length well: steps of 1.5.
  for (const double length : {0.6, 0.9, 1.35, 2.0, 3.0, 4.5, 7.0, 10.5, 16.0, 24.0})
    add(true, length);
  return all;
}

double TopSums::points() const {
  return std::accumulate(weight.begin(), weight.end(), 0.0);
}

namespace {

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

/// Details of a cell's values, from points up to its means.
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

/// Calls work(stripe, cell) for all cells, stripes in parallel.
template <class Work>
void each_cell(const Points& points, const Work& work) {
  oneapi::tbb::parallel_for(std::size_t{0}, kStripes, [&](std::size_t s) {
    const std::size_t n = points.cells.size();
    for (std::size_t i = s * n / kStripes; i < (s + 1) * n / kStripes; ++i)
      work(s, points.cells[i]);
  });
}

using Sums = std::vector<std::array<std::array<MatrixXd, kGroups>, kSets>>;  // by stripe
Sums zeros(Index rows, Index cols) {
  Sums sums(kStripes);
  for (auto& stripe : sums)
    for (auto& set : stripe)
      for (MatrixXd& m : set) m = MatrixXd::Zero(rows, cols);
  return sums;
}
MatrixXd total(const Sums& sums, std::size_t set, std::size_t scale) {
  MatrixXd all = sums[0][set][scale];
  for (std::size_t s = 1; s < sums.size(); ++s) all += sums[s][set][scale];
  return all;
}

MatrixXd covariance(const TopSums& s, const Theta& theta) {
  const auto m = static_cast<Index>(s.weight.size());
  const double mean = s.points() / static_cast<double>(m);
  const auto at = [](Index i) { return static_cast<std::size_t>(i); };
  MatrixXd c = MatrixXd::Zero(m, m);
  for (Index i = 0; i < m; ++i) {
    c(i, i) = mean / s.weight[at(i)];
    if (theta.ratio == 0.0) continue;
    for (Index j = 0; j <= i; ++j) {
      if (s.which[at(i)] != s.which[at(j)]) continue;
      const Vec3 d = s.centre[at(i)] - s.centre[at(j)];
      const double r = std::hypot(d.x, d.y) / theta.length_mm;
      c(i, j) += theta.ratio * (theta.gauss ? std::exp(-0.5 * r * r) : std::exp(-r));
    }
  }
  return c;
}

/// Means of the cells of a set, or differences between their set-ups.
MatrixXd means_of(const Points& points, const FloatRows& block, std::size_t set, std::size_t top,
                  std::size_t count) {
  MatrixXd means(static_cast<Index>(count), block.cols());
  for (const Points::Cell& c : points.cells) {
    if (static_cast<std::size_t>(c.set) != set) continue;
    if (top == 0)
      means.row(static_cast<Index>(c.top)) = block.row(c.mean).cast<double>();
    else
      means.middleRows(static_cast<Index>(c.between), c.means - 1) =
          block.middleRows(c.mean + 1, c.means - 1).cast<double>();
  }
  return means;
}

}  // namespace

void exchange_residuals(Bank& bank, const std::vector<double>& residual) {
  Points& p = *bank.points;
  p.residual.resize(p.rows, 1);
  each_cell(p, [&](std::size_t, const Points::Cell& cell) {
    RowMatrix x(static_cast<Index>(cell.end - cell.begin), 1);
    for (Index i = 0; i < x.rows(); ++i)
      x(i, 0) = residual[p.order[cell.begin + static_cast<std::size_t>(i)].second];
    transform(p, cell, x, p.residual);
  });
  const Index k = bank.y();
  Sums sums = zeros(k + 1, 1);
  each_cell(p, [&](std::size_t stripe, const Points::Cell& cell) {
    for (std::size_t g = 0; g < kGroups; ++g) {
      MatrixXd& to = sums[stripe][static_cast<std::size_t>(cell.set)][g];
      const VectorXd y = p.residual.col(0).segment(cell.row[g], cell.rows[g]).cast<double>();
      Index at = 0;
      for (const FloatRows& block : p.blocks) {
        to.block(at, 0, block.cols(), 1) +=
            block.middleRows(cell.row[g], cell.rows[g]).cast<double>().transpose() * y;
        at += block.cols();
      }
      to(k, 0) += y.squaredNorm();
    }
  });
  for (std::size_t set = 0; set < kSets; ++set) {
    SetSums& s = bank.sets[set];
    for (std::size_t g = 0; g < kGroups; ++g) {
      s.gram[g].col(k) = total(sums, set, g);
      s.gram[g].row(k) = s.gram[g].col(k).transpose();
    }
    for (std::size_t u = 0; u < kTops; ++u) {
      if (s.top[u].weight.empty()) continue;
      const VectorXd means = means_of(p, p.residual, set, u, s.top[u].weight.size());
      oneapi::tbb::parallel_for(std::size_t{0}, bank.theta.size(), [&](std::size_t t) {
        Points::Top& top = p.top[set][u][t];
        MatrixXd& gram = s.top[u].gram[t];
        top.white_y = top.factor.triangularView<Eigen::Lower>().solve(means);
        gram.col(k).head(k) = top.white.transpose() * top.white_y;
        gram(k, k) = top.white_y.squaredNorm();
        gram.row(k) = gram.col(k).transpose();
      });
    }
  }
}

Weights effective_weights(const Bank& bank, const std::vector<int>& model, const Fit& fit) {
  const Points& p = *bank.points;
  const Index k = bank.y();
  // Scores of each cell and column.
  std::vector<std::array<VectorXd, kGroups>> scores(p.cells.size());
  VectorXd coefficients = VectorXd::Zero(k);
  for (std::size_t i = 0; i < model.size(); ++i)
    coefficients(model[i]) = fit.coefficients(static_cast<Index>(i));
  each_cell(p, [&](std::size_t, const Points::Cell& cell) {
    auto& score = scores[static_cast<std::size_t>(&cell - p.cells.data())];
    for (std::size_t g = 0; g < kGroups; ++g) {
      VectorXd e = p.residual.col(0).segment(cell.row[g], cell.rows[g]).cast<double>();
      Index at = 0;
      for (const FloatRows& block : p.blocks) {
        const VectorXd b = coefficients.segment(at, block.cols());
        if (b.squaredNorm() > 0.0)
          e -= block.middleRows(cell.row[g], cell.rows[g]).cast<double>() * b;
        at += block.cols();
      }
      score[g].resize(k);
      at = 0;
      for (const FloatRows& block : p.blocks) {
        score[g].segment(at, block.cols()) =
            block.middleRows(cell.row[g], cell.rows[g]).cast<double>().transpose() * e;
        at += block.cols();
      }
    }
  });
  std::unordered_map<std::uint64_t, std::size_t> index;
  for (std::size_t i = 0; i < p.cells.size(); ++i) index[p.cells[i].at] = i;
  Weights weights;
  for (std::size_t g = 0; g < kGroups; ++g) {
    VectorXd real = VectorXd::Zero(k), free = VectorXd::Zero(k);
    for (std::size_t i = 0; i < p.cells.size(); ++i) {
      VectorXd near = VectorXd::Zero(k);
      const std::uint64_t r = p.cells[i].at / p.cells_a_row, c = p.cells[i].at % p.cells_a_row;
      for (std::uint64_t row = r == 0 ? 0 : r - 1; row <= r + 1; ++row)
        for (std::uint64_t col = c == 0 ? 0 : c - 1; col <= c + 1 && col < p.cells_a_row; ++col)
          if (const auto at = index.find(row * p.cells_a_row + col);
              at != index.end() && p.cells[at->second].set == p.cells[i].set)
            near += scores[at->second][g];
      real += scores[i][g].cwiseProduct(near);
    }
    for (const SetSums& s : bank.sets) free += fit.variance[g] * s.gram[g].diagonal().head(k);
    std::vector<double> ratio;
    for (Index j = bank.nuisances; j < k; ++j)
      if (free(j) > 0.0) ratio.push_back(real(j) / free(j));
    weights[g] = 1.0;
    if (ratio.empty()) continue;
    const auto middle = ratio.begin() + static_cast<std::ptrdiff_t>(ratio.size() / 2);
    std::nth_element(ratio.begin(), middle, ratio.end());
    weights[g] = 1.0 / std::fmax(1.0, *middle);
  }
  return weights;
}

void add_columns(Bank& bank, const std::vector<Observation>& all,
                 const std::vector<Column>& columns) {
  std::vector<Column> fresh;
  const Index before = bank.y();
  for (const Column& c : columns)
    if (bank.index.emplace(c.key, static_cast<int>(bank.columns.size())).second) {
      bank.columns.push_back(c);
      fresh.push_back(c);
    }
  if (fresh.empty()) return;
  Points& p = *bank.points;
  const auto m = static_cast<Index>(fresh.size());
  FloatRows block(p.rows, m);
  each_cell(p, [&](std::size_t, const Points::Cell& cell) {
    RowMatrix x(static_cast<Index>(cell.end - cell.begin), m);
    for (Index i = 0; i < x.rows(); ++i) {
      const Observation& o = all[p.order[cell.begin + static_cast<std::size_t>(i)].second];
      for (Index j = 0; j < m; ++j) x(i, j) = fresh[static_cast<std::size_t>(j)].value(o);
    }
    transform(p, cell, x, block);
  });
  // Products of the new with all: columns before, themselves, the residual.
  Sums sums = zeros(before + m + 1, m);
  each_cell(p, [&](std::size_t stripe, const Points::Cell& cell) {
    for (std::size_t g = 0; g < kGroups; ++g) {
      if (cell.rows[g] == 0) continue;  // seen from one set-up only
      MatrixXd& to = sums[stripe][static_cast<std::size_t>(cell.set)][g];
      const MatrixXd x = block.middleRows(cell.row[g], cell.rows[g]).cast<double>();
      Index at = 0;
      for (const FloatRows& old : p.blocks) {
        const MatrixXd o = old.middleRows(cell.row[g], cell.rows[g]).cast<double>();
        to.middleRows(at, old.cols()).noalias() += o.transpose() * x;
        at += old.cols();
      }
      to.middleRows(at, m).selfadjointView<Eigen::Lower>().rankUpdate(x.transpose());
      to.row(before + m).noalias() +=
          p.residual.col(0).segment(cell.row[g], cell.rows[g]).cast<double>().transpose() * x;
    }
  });
  const Index k = before + m;
  const auto widened = [&](const MatrixXd& old, const MatrixXd& more) {
    MatrixXd wide(k + 1, k + 1);
    wide.topLeftCorner(before, before) = old.topLeftCorner(before, before);
    wide.middleCols(before, m) = more;
    wide.block(before, 0, m, before) = more.topRows(before).transpose();
    wide.row(k).head(before) = old.row(before).head(before);
    wide(k, k) = old(before, before);
    wide.col(k).head(k) = wide.row(k).head(k).transpose();
    return wide;
  };
  for (std::size_t set = 0; set < kSets; ++set) {
    SetSums& s = bank.sets[set];
    for (std::size_t g = 0; g < kGroups; ++g) {
      MatrixXd more = total(sums, set, g);
      more.middleRows(before, m).triangularView<Eigen::StrictlyUpper>() =
          MatrixXd(more.middleRows(before, m).transpose());
      s.gram[g] = widened(s.gram[g], more);
    }
    for (std::size_t u = 0; u < kTops; ++u) {
      if (s.top[u].weight.empty()) {
        for (MatrixXd& g : s.top[u].gram) g = MatrixXd::Zero(k + 1, k + 1);
        continue;
      }
      const MatrixXd means = means_of(p, block, set, u, s.top[u].weight.size());
      oneapi::tbb::parallel_for(std::size_t{0}, bank.theta.size(), [&](std::size_t t) {
        Points::Top& top = p.top[set][u][t];
        const MatrixXd white = top.factor.triangularView<Eigen::Lower>().solve(means);
        MatrixXd more(k + 1, m);
        more.topRows(before).noalias() = top.white.transpose() * white;
        more.middleRows(before, m).noalias() = white.transpose() * white;
        more.row(k) = top.white_y.transpose() * white;
        s.top[u].gram[t] = widened(s.top[u].gram[t], more);
        top.white.conservativeResize(Eigen::NoChange, k);
        top.white.rightCols(m) = white;
      });
    }
  }
  p.blocks.push_back(std::move(block));
}

Bank sum_up(const std::vector<Observation>& all, const std::vector<Column>& nuisances,
            const std::vector<Column>& columns, const Layout& layout,
            const std::vector<Theta>* theta, int only) {
  Bank bank;
  bank.theta = theta != nullptr ? *theta : thetas(layout.cell_mm);
  bank.points = std::make_shared<Points>();
  Points& p = *bank.points;
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
    Points::Cell cell{layout.set_of(first.x, first.y), i, j, {}, {}, 0, 0, 0, 0};
    SetSums& set = bank.sets[static_cast<std::size_t>(cell.set)];
    Level level;
    Vec3 centre;
    for (std::size_t a = i; a < j; ++a) {
      centre += (1.0 / static_cast<double>(j - i)) * all[p.order[a].second].place;
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
    cell.top = set.top[0].weight.size();
    cell.between = set.top[1].weight.size();
    double weight = next.weight[0];
    for (std::size_t a = 1; a < next.size(); ++a) {
      set.top[1].weight.push_back(weight * next.weight[a] / (weight + next.weight[a]));
      set.top[1].centre.push_back(centre);
      set.top[1].which.push_back(static_cast<std::uint32_t>(a));
      weight += next.weight[a];
    }
    set.top[0].weight.push_back(weight);
    set.top[0].centre.push_back(centre);
    set.top[0].which.push_back(0);
    cell.at = cell_of(i) & 0xffffffffU;
    p.cells.push_back(cell);
  }
  p.cells_a_row = static_cast<std::uint64_t>(layout.cols);
  for (std::size_t set = 0; set < kSets; ++set) {
    SetSums& s = bank.sets[set];
    for (MatrixXd& g : s.gram) g = MatrixXd::Zero(1, 1);
    for (std::size_t u = 0; u < kTops; ++u) {
      TopSums& sums = s.top[u];
      sums.gram.assign(bank.theta.size(), MatrixXd::Zero(1, 1));
      sums.log_det.assign(bank.theta.size(), 0.0);
      p.top[set][u].resize(bank.theta.size());
      if (sums.weight.empty()) continue;
      const auto m = static_cast<Index>(sums.weight.size());
      oneapi::tbb::parallel_for(std::size_t{0}, bank.theta.size(), [&](std::size_t t) {
        const Eigen::LLT<MatrixXd> llt(covariance(sums, bank.theta[t]));
        Points::Top& top = p.top[set][u][t];
        top.factor = llt.matrixLLT();
        for (Index i = 0; i < m; ++i) sums.log_det[t] += 2.0 * std::log(top.factor(i, i));
        top.white = MatrixXd(m, 0);
      });
    }
  }
  std::vector<double> residual(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) residual[i] = all[i].residual_mm;
  exchange_residuals(bank, residual);
  add_columns(bank, all, nuisances);
  bank.nuisances = bank.y();
  add_columns(bank, all, columns);
  return bank;
}

}  // namespace maquette::diagnosis::detail
