// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numeric>

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/many_places.hpp"
#include "diagnosis/detail/points.hpp"

namespace maquette::diagnosis::detail {
namespace {
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
}  // namespace

std::vector<Theta> plain_thetas(double cell) {
  std::vector<Theta> all{{}};
  const auto add = [&](bool gauss, double length) {
    for (const double ratio : {0.7, 3.0, 12.0, 50.0, 200.0, 1000.0})
      all.push_back({gauss, length * cell, ratio});
  };
  for (const double length : {0.6, 1.2, 2.5, 5.0, 10.0, 20.0}) add(false, length);
  // Smooth processes far above the white part tell their length well: steps of 1.5.
  for (const double length : {0.6, 0.9, 1.35, 2.0, 3.0, 4.5, 7.0, 10.5, 16.0, 24.0})
    add(true, length);
  return all;
}

std::vector<Theta> thetas(double cell) {
  auto all = plain_thetas(cell);
  for (const double length : {4.5, 7.0, 10.5, 16.0})
    for (const double rough : {0.2, 0.5, 0.8})
      for (const double ratio : {12.0, 50.0, 200.0})
        all.push_back({true, length * cell, ratio, rough});
  return all;
}

OfSets which_of(const std::vector<int>& sets) {
  OfSets of{};
  for (const int set : sets) of[static_cast<std::size_t>(set)] = true;
  return of;
}

double TopSums::points() const {
  return std::accumulate(weight.begin(), weight.end(), 0.0);
}

namespace {

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

/// Of the correlation of a coat that is rough within a cell.
constexpr double kCoatCells = 0.6;

/// Heights of a process of ratio 1 as means over cells see them; that of a Gaussian process is
/// nearly Gaussian again.
MatrixXd process(const TopSums& s, const Theta& theta, double cell_mm) {
  if (theta.rough > 0.0)
    return (1.0 - theta.rough) * process(s, {theta.gauss, theta.length_mm, theta.ratio}, cell_mm) +
           theta.rough * process(s, {false, kCoatCells * cell_mm, theta.ratio}, cell_mm);
  const auto m = static_cast<Index>(s.weight.size());
  const auto at = [](Index i) { return static_cast<std::size_t>(i); };
  const double own = theta.length_mm * theta.length_mm,
               wide = own + (theta.gauss ? cell_mm * cell_mm / 6.0 : 0.0);
  MatrixXd c = MatrixXd::Zero(m, m);
  for (Index i = 0; i < m; ++i)
    for (Index j = 0; j <= i; ++j) {
      if (s.which[at(i)] != s.which[at(j)]) continue;
      const Vec3 d = s.centre[at(i)] - s.centre[at(j)];
      const double r2 = (d.x * d.x + d.y * d.y) / wide;
      c(i, j) = own / wide * s.rise[at(i)] * s.rise[at(j)] *
                std::exp(theta.gauss ? -0.5 * r2 : -std::sqrt(r2));
      c(j, i) = c(i, j);
    }
  return c;
}

/// Planes as means over cells see them: height, slope along x, slope along y about the cells'
/// middle, three columns for each of `which`.
MatrixXd planes(const TopSums& s) {
  Vec3 middle;
  std::uint32_t most = 0;
  for (std::size_t i = 0; i < s.weight.size(); ++i) {
    middle += (1.0 / static_cast<double>(s.weight.size())) * s.centre[i];
    most = std::max(most, s.which[i]);
  }
  MatrixXd z = MatrixXd::Zero(static_cast<Index>(s.weight.size()), 3 * (Index{most} + 1));
  for (std::size_t i = 0; i < s.weight.size(); ++i) {
    const Vec3 off = s.centre[i] - middle;
    z.block<1, 3>(static_cast<Index>(i), 3 * Index{s.which[i]}) << s.rise[i], s.rise[i] * off.x,
        s.rise[i] * off.y;
  }
  return z;
}
/// What gives the plane that fits means best.
MatrixXd best_plane(const MatrixXd& z) {
  return z.completeOrthogonalDecomposition().pseudoInverse();
}

/// Of a process of ratio 1, mm. A process has no plane: that is where the part lies, which the
/// poses say. One as long as the part would let their height be said by how slopes differ within
/// cells, and 0.002 mm that a simulation is wrong by on slopes becomes 0.1 mm of height.
MatrixXd without_plane(MatrixXd c, const MatrixXd& plane, const MatrixXd& fit) {
  c -= plane * (fit * c);
  c -= (c * fit.transpose()) * plane.transpose();
  return c;
}

/// Cholesky's factors of the means' covariances: white, and a process in several ratios to it.
void factorise(TopSums& sums, std::vector<Points::Top>& parts, const std::vector<Theta>& theta,
               double cell_mm) {
  const auto rows = static_cast<Index>(sums.weight.size());
  const double mean = sums.points() / static_cast<double>(rows);
  const MatrixXd plane = planes(sums), fit = best_plane(plane);
  // Thetas of one process follow each other.
  std::vector<std::size_t> begin;
  for (std::size_t t = 0; t < theta.size(); ++t)
    if (t == 0 || theta[t].gauss != theta[t - 1].gauss ||
        theta[t].length_mm != theta[t - 1].length_mm || theta[t].rough != theta[t - 1].rough)
      begin.push_back(t);
  begin.push_back(theta.size());
  oneapi::tbb::parallel_for(std::size_t{0}, begin.size() - 1, [&](std::size_t k) {
    MatrixXd smooth = MatrixXd::Zero(rows, rows);
    if (theta[begin[k]].ratio > 0.0)
      smooth = without_plane(process(sums, theta[begin[k]], cell_mm), plane, fit);
    for (std::size_t t = begin[k]; t < begin[k + 1]; ++t) {
      MatrixXd c = theta[t].ratio * smooth;
      for (Index i = 0; i < rows; ++i) c(i, i) += mean / sums.weight[static_cast<std::size_t>(i)];
      const Eigen::LLT<MatrixXd> llt(c);
      Points::Top& top = parts[t];
      top.factor = llt.matrixLLT();
      for (Index i = 0; i < rows; ++i) sums.log_det[t] += 2.0 * std::log(top.factor(i, i));
      top.white = MatrixXd(rows, 0);
    }
  });
}

/// Means of the cells of a set (kSets: of all), or differences between their set-ups.
MatrixXd means_of(const Points& points, const FloatRows& block, std::size_t set, std::size_t top,
                  std::size_t count) {
  MatrixXd means(static_cast<Index>(count), block.cols());
  Index at = 0;
  for (const Points::Cell& c : points.cells) {
    if (set < kSets && static_cast<std::size_t>(c.set) != set) continue;
    if (top == 0)
      means.row(at++) = block.row(c.mean).cast<double>();
    else
      for (const Index a : c.differences) means.row(at++) = block.row(c.mean + a).cast<double>();
  }
  return means;
}

/// Calls work(sums, what they were made of, set or kSets, top) for all sums of means that are not
/// empty.
template <class Work>
void each_top(Bank& bank, const Work& work) {
  for (std::size_t set = 0; set < kSets; ++set)
    for (std::size_t u = 0; u < kTops; ++u)
      if (TopSums& sums = bank.sets[set].top[u]; !sums.weight.empty())
        work(sums, bank.points->top[set][u], set, u);
  if (!bank.joint.weight.empty())
    work(bank.joint, bank.points->joint, std::size_t{kSets}, std::size_t{0});
}

}  // namespace

Eigen::Matrix3d plane_covariance(const Bank& bank, const Fit& fit, double cell_mm) {
  const TopSums& means = *tops_of(bank, kAll, 0).front();
  const MatrixXd plane = best_plane(planes(means));
  const Theta& theta = bank.theta[static_cast<std::size_t>(fit.theta[0])];
  if (theta.ratio == 0.0) return Eigen::Matrix3d::Zero();
  return fit.top_variance[0] * theta.ratio * plane * process(means, theta, cell_mm) *
         plane.transpose();
}

namespace {

/// Sums of products of a cell's columns with the residual: a pass over floats that memory bounds.
/// @param few  the columns that are wanted, in rising order; empty: all
void add_products(const Points& p, const Points::Cell& cell, std::size_t group,
                  const std::vector<Index>& few, double* to) {
  const Index first = cell.row[group], rows = cell.rows[group];
  Index before = 0;
  auto next = few.begin();
  for (const FloatRows& block : p.blocks) {
    const Index columns = block.cols();
    double* sums = to + before;
    const auto own = next;
    while (next != few.end() && *next < before + columns) ++next;
    for (Index i = first; i < first + rows; ++i) {
      const double y = static_cast<double>(p.residual(i, 0));
      const float* row = block.data() + i * columns;
      if (few.empty())
        for (Index j = 0; j < columns; ++j) sums[j] += static_cast<double>(row[j]) * y;
      else
        for (auto j = own; j != next; ++j)
          sums[*j - before] += static_cast<double>(row[*j - before]) * y;
    }
    before += columns;
  }
}

/// @param set  kSets: all of them
bool is_told(const Points& p, std::size_t set) {
  return set < kSets ? p.told[set] : p.told == kEverySet;
}

/// Answers of the columns that are wanted.
void give_answers(Bank& bank, const std::vector<char>& wanted) {
  const Points& p = *bank.points;
  const Index k = bank.y();
  std::vector<Index> which;
  for (Index j = 0; j < k; ++j)
    if (wanted[static_cast<std::size_t>(j)] != 0) which.push_back(j);
  if (which.empty()) return;
  const bool few = 4 * which.size() < static_cast<std::size_t>(k);
  const std::vector<Index> read = few ? which : std::vector<Index>();
  Sums sums = zeros(k, 1);
  each_cell(p, [&](std::size_t stripe, const Points::Cell& cell) {
    if (!p.told[static_cast<std::size_t>(cell.set)]) return;
    for (std::size_t g = 0; g < kGroups; ++g)
      add_products(p, cell, g, read, sums[stripe][static_cast<std::size_t>(cell.set)][g].data());
  });
  for (std::size_t set = 0; set < kSets; ++set)
    for (std::size_t g = 0; p.told[set] && g < kGroups; ++g) {
      const MatrixXd all = total(sums, set, g);
      MatrixXd& gram = bank.sets[set].gram[g];
      for (const Index j : which) gram(j, k) = gram(k, j) = all(j, 0);
    }
  each_top(bank, [&](TopSums& sum, std::vector<Points::Top>& parts, std::size_t set, std::size_t) {
    if (!is_told(p, set)) return;
    oneapi::tbb::parallel_for(std::size_t{0}, bank.theta.size(), [&](std::size_t t) {
      MatrixXd& gram = sum.gram[t];
      for (const Index j : which)
        gram(j, k) = gram(k, j) = parts[t].white.col(j).dot(parts[t].white_y);
    });
  });
  for (const Index j : which) bank.points->answered[static_cast<std::size_t>(j)] = 1;
}

/// The gram matrices' last column, set by set.
template <class Take>
void each_gram(Bank& bank, const Take& take) {
  for (SetSums& s : bank.sets)
    for (MatrixXd& g : s.gram) take(g);
  each_top(bank, [&](TopSums& sum, std::vector<Points::Top>&, std::size_t, std::size_t) {
    for (MatrixXd& g : sum.gram) take(g);
  });
}

}  // namespace

void exchange_residuals(Bank& bank, const std::vector<double>& residual,
                        const std::vector<int>* columns, const std::vector<int>& of_sets) {
  Points& p = *bank.points;
  p.told = which_of(of_sets);
  p.residual = details_of(
      p, 1, [&](std::uint32_t o, Index) { return residual[o]; }, p.told);
  const Index k = bank.y();
  Sums sums = zeros(1, 1);
  each_cell(p, [&](std::size_t stripe, const Points::Cell& cell) {
    if (!p.told[static_cast<std::size_t>(cell.set)]) return;
    for (std::size_t g = 0; g < kGroups; ++g)
      sums[stripe][static_cast<std::size_t>(cell.set)][g](0, 0) +=
          p.residual.col(0).segment(cell.row[g], cell.rows[g]).cast<double>().squaredNorm();
  });
  // Whoever reads an answer that was not asked for sees it.
  each_gram(bank, [&](MatrixXd& gram) {
    gram.col(k).head(k + 1).setConstant(NAN);
    gram.row(k).head(k + 1).setConstant(NAN);
  });
  for (std::size_t set = 0; set < kSets; ++set)
    for (std::size_t g = 0; p.told[set] && g < kGroups; ++g)
      bank.sets[set].gram[g](k, k) = total(sums, set, g)(0, 0);
  each_top(bank,
           [&](TopSums& sum, std::vector<Points::Top>& parts, std::size_t set, std::size_t u) {
             const VectorXd means = means_of(p, p.residual, set, u, sum.weight.size());
             if (!is_told(p, set)) {
               for (Points::Top& top : parts) top.white_y = means;  // NaN
               return;
             }
             oneapi::tbb::parallel_for(std::size_t{0}, bank.theta.size(), [&](std::size_t t) {
               Points::Top& top = parts[t];
               top.white_y = top.factor.triangularView<Eigen::Lower>().solve(means);
               sum.gram[t](k, k) = top.white_y.squaredNorm();
             });
           });
  p.answered.assign(static_cast<std::size_t>(k), 0);
  if (columns == nullptr)
    answer_all(bank);
  else
    answer(bank, *columns);
}

std::vector<char> those_in(const Bank& bank, Set set, std::size_t count) {
  std::vector<char> in(count, 0);
  for (const Points::Cell& cell : bank.points->cells)
    for (std::size_t i = cell.begin; cell.set == set && i < cell.end; ++i)
      in[bank.points->order[i].second] = 1;
  return in;
}

void answer(Bank& bank, const std::vector<int>& columns) {
  const std::vector<char>& answered = bank.points->answered;
  std::vector<char> wanted(answered.size(), 0);
  for (const int j : columns)
    wanted[static_cast<std::size_t>(j)] = answered[static_cast<std::size_t>(j)] == 0 ? 1 : 0;
  give_answers(bank, wanted);
}

bool answer_all(Bank& bank) {
  std::vector<char> wanted = bank.points->answered;
  for (char& w : wanted) w = w == 0 ? 1 : 0;
  give_answers(bank, wanted);
  return std::find(wanted.begin(), wanted.end(), 1) != wanted.end();
}

Answers answers_of(Bank& bank) {
  const Points& p = *bank.points;
  const Index k = bank.y();
  Answers a{p.told, p.residual, p.answered, {}, {}};
  each_gram(bank, [&](MatrixXd& gram) { a.products.emplace_back(gram.col(k).head(k + 1)); });
  each_top(bank, [&](TopSums&, std::vector<Points::Top>& parts, std::size_t, std::size_t) {
    for (const Points::Top& top : parts) a.white.push_back(top.white_y);
  });
  return a;
}

void restore_answers(Bank& bank, const Answers& a) {
  Points& p = *bank.points;
  const Index k = bank.y(), then = static_cast<Index>(a.answered.size());
  p.told = a.told;
  p.residual = a.residual;
  p.answered = a.answered;
  p.answered.resize(static_cast<std::size_t>(k), 0);
  std::size_t next = 0;
  each_gram(bank, [&](MatrixXd& gram) {
    const VectorXd& products = a.products[next++];
    gram.col(k).head(k).setConstant(NAN);
    gram.col(k).head(then) = products.head(then);
    gram(k, k) = products(then);
    gram.row(k).head(k) = gram.col(k).head(k).transpose();
  });
  next = 0;
  each_top(bank, [&](TopSums&, std::vector<Points::Top>& parts, std::size_t, std::size_t) {
    for (Points::Top& top : parts) top.white_y = a.white[next++];
  });
}

namespace {

/// Columns come a few at a time: room for a quarter more, that sums need not move each time.
Index with_room(Index columns) {
  return columns + columns / 4;
}

/// Adds columns behind the first `before`, and moves the residual behind them.
/// @param more  products of the new columns: with those before, themselves, the residual
void widen(MatrixXd& gram, Index before, const MatrixXd& more) {
  const Index m = more.cols(), k = before + m;
  if (gram.rows() < k + 1) {
    MatrixXd wide(with_room(k) + 1, with_room(k) + 1);
    wide.topLeftCorner(before + 1, before + 1) = gram.topLeftCorner(before + 1, before + 1);
    gram = std::move(wide);
  }
  gram(k, k) = gram(before, before);
  gram.row(k).head(before) = gram.row(before).head(before);
  gram.block(0, before, before, m) = more.topRows(before);
  gram.block(before, before, m, m) = more.middleRows(before, m);
  gram.block(before, 0, m, before) = more.topRows(before).transpose();
  gram.row(k).segment(before, m) = more.row(k);
  gram.col(k).head(k) = gram.row(k).head(k).transpose();
}

}  // namespace

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
  FloatRows block;
  {
    std::vector<std::function<double(const Observation&)>> value;
    for (const Column& c : fresh) value.push_back(at_many_places(c, all));
    block = details_of(
        p, m, [&](std::uint32_t o, Index j) { return value[static_cast<std::size_t>(j)](all[o]); });
  }
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
  for (std::size_t set = 0; set < kSets; ++set) {
    SetSums& s = bank.sets[set];
    for (std::size_t g = 0; g < kGroups; ++g) {
      MatrixXd more = total(sums, set, g);
      more.middleRows(before, m).triangularView<Eigen::StrictlyUpper>() =
          MatrixXd(more.middleRows(before, m).transpose());
      widen(s.gram[g], before, more);
    }
    for (TopSums& top : s.top)
      if (top.weight.empty())
        for (MatrixXd& g : top.gram) g = MatrixXd::Zero(k + 1, k + 1);
  }
  each_top(bank,
           [&](TopSums& sum, std::vector<Points::Top>& parts, std::size_t set, std::size_t u) {
             const MatrixXd means = means_of(p, block, set, u, sum.weight.size());
             oneapi::tbb::parallel_for(std::size_t{0}, bank.theta.size(), [&](std::size_t t) {
               Points::Top& top = parts[t];
               if (top.white.cols() < k)
                 top.white.conservativeResize(Eigen::NoChange, with_room(k));
               auto white = top.white.middleCols(before, m);
               white = means;
               top.factor.triangularView<Eigen::Lower>().solveInPlace(white);
               MatrixXd more(k + 1, m);
               more.topRows(before).noalias() = top.white.leftCols(before).transpose() * white;
               more.middleRows(before, m).noalias() = white.transpose() * white;
               more.row(k) = top.white_y.transpose() * white;
               widen(sum.gram[t], before, more);
             });
           });
  p.blocks.push_back(std::move(block));
  p.answered.resize(static_cast<std::size_t>(k), 1);
}

Bank sum_up(const std::vector<Observation>& all, const std::vector<Column>& nuisances,
            const std::vector<Column>& columns, const Layout& layout,
            const std::vector<Theta>* theta, int only) {
  Bank bank;
  bank.theta = theta != nullptr ? *theta : thetas(layout.cell_mm);
  bank.tried = bank.theta.size();
  bank.points = std::make_shared<Points>(sort_points(all, layout, only, bank));
  const auto start = [&](TopSums& sums) {
    sums.gram.assign(bank.theta.size(), MatrixXd::Zero(1, 1));
    sums.log_det.assign(bank.theta.size(), 0.0);
  };
  for (SetSums& s : bank.sets) {
    for (MatrixXd& g : s.gram) g = MatrixXd::Zero(1, 1);
    for (TopSums& sums : s.top) start(sums);
  }
  start(bank.joint);
  each_top(bank, [&](TopSums& sums, std::vector<Points::Top>& parts, std::size_t, std::size_t) {
    parts.resize(bank.theta.size());
    factorise(sums, parts, bank.theta, layout.cell_mm);
  });
  std::vector<double> residual(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) residual[i] = all[i].residual_mm;
  exchange_residuals(bank, residual);
  add_columns(bank, all, nuisances);
  bank.nuisances = bank.y();
  add_columns(bank, all, columns);
  return bank;
}

}  // namespace maquette::diagnosis::detail
