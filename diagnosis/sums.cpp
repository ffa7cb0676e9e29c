// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/sums.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <oneapi/tbb/parallel_for.h>

#include "core/random.hpp"

namespace maquette::diagnosis::detail {
namespace {
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::size_t kStripes = 8;  // fixed: sums do not depend on threads
}  // namespace

std::vector<Theta> thetas(double cell) {
  std::vector<Theta> all{{}};
  for (const bool per_set_up : {false, true})
    for (const bool gauss : {false, true})
      for (const double length : {1.5, 5.0, 18.0})
        for (const double ratio : {3.0, 100.0, 3000.0})
          all.push_back({gauss, length * cell, ratio, per_set_up});
  return all;
}

int Layout::block_of(double x, double y) const {
  const double side = cell_mm * static_cast<double>(block);
  const auto c = static_cast<std::ptrdiff_t>(std::floor((x - x0) / side));
  const auto r = static_cast<std::ptrdiff_t>(std::floor((y - y0) / side));
  const auto i = r * block_cols + c;
  return r < 0 || c < 0 || c >= block_cols || i >= static_cast<std::ptrdiff_t>(set_of_block.size())
             ? -1
             : static_cast<int>(i);
}

int Layout::set_of(double x, double y) const {
  const int b = block_of(x, y);
  if (b < 0) return -1;
  const int set = set_of_block[static_cast<std::size_t>(b)];
  for (const auto& [dx, dy] :
       {std::pair{buffer_mm, 0.0}, {-buffer_mm, 0.0}, {0.0, buffer_mm}, {0.0, -buffer_mm}}) {
    const int other = block_of(x + dx, y + dy);
    if (other >= 0 && set_of_block[static_cast<std::size_t>(other)] != set) return -1;
  }
  return set;
}

Layout lay_out(const Box3& box, std::uint64_t seed) {
  Layout l;
  const double wide = box.max.x - box.min.x, high = box.max.y - box.min.y;
  l.cell_mm = std::fmax(wide, high) / 24.0;
  l.x0 = box.min.x;
  l.y0 = box.min.y;
  l.cols = static_cast<std::ptrdiff_t>(std::ceil(wide / l.cell_mm - 1e-9));
  l.rows = static_cast<std::ptrdiff_t>(std::ceil(high / l.cell_mm - 1e-9));
  l.block = 4;
  l.buffer_mm = l.cell_mm / 8.0;
  l.block_cols = (l.cols + l.block - 1) / l.block;
  const std::ptrdiff_t block_rows = (l.rows + l.block - 1) / l.block;
  // Every row and column of blocks has all sets: (r + c) mod 3, its three names, rows and
  // columns drawn.
  const auto shuffled = [&](std::size_t n, std::uint64_t stream) {
    std::vector<std::size_t> order(n);
    std::iota(order.begin(), order.end(), std::size_t{0});
    for (std::size_t i = n; i > 1; --i)
      std::swap(order[i - 1], order[random_bits(mix64(seed) + stream, i) % i]);
    return order;
  };
  const auto rows = shuffled(static_cast<std::size_t>(block_rows), 1);
  const auto cols = shuffled(static_cast<std::size_t>(l.block_cols), 2);
  const auto names = shuffled(3, 3);
  for (const std::size_t r : rows)
    for (const std::size_t c : cols) l.set_of_block.push_back(static_cast<int>(names[(r + c) % 3]));
  return l;
}

namespace {

/// The observations of one cell of one set-up, sorted by its finest squares.
struct CellPoints {
  int set;
  std::size_t begin, end;
};

void add_cell(const std::vector<Observation>& all,
              const std::vector<std::pair<std::uint64_t, std::uint32_t>>& order,
              const CellPoints& cell, const std::vector<const Column*>& columns, SetSums& sums,
              RowMatrix& x) {
  const auto k = static_cast<Index>(columns.size());
  const auto n = static_cast<Index>(cell.end - cell.begin);
  x.resize(n, k + 1);
  for (Index i = 0; i < n; ++i) {
    const Observation& o = all[order[cell.begin + static_cast<std::size_t>(i)].second];
    for (Index j = 0; j < k; ++j) x(i, j) = columns[static_cast<std::size_t>(j)]->value(o);
    x(i, k) = o.residual_mm;
  }
  // Keys carry three pairs of bits below the cell: the squares of sides 1/2, 1/4, 1/8.
  std::vector<std::uint64_t> key(static_cast<std::size_t>(n));
  for (std::size_t i = 0; i < key.size(); ++i) key[i] = order[cell.begin + i].first;
  RowMatrix means = x;
  VectorXd weight = VectorXd::Ones(n);
  for (int scale = kScales - 1; scale >= 0; --scale) {
    // Merge runs of equal parent: points -> 1/8 -> 1/4 -> 1/2 -> cell.
    const int shift = 2 * (kScales - 1 - scale);
    std::vector<Index> first;
    for (Index i = 0; i < means.rows(); ++i)
      if (i == 0 || (key[static_cast<std::size_t>(i)] >> shift) !=
                        (key[static_cast<std::size_t>(i - 1)] >> shift))
        first.push_back(i);
    first.push_back(means.rows());
    const auto parents = static_cast<Index>(first.size()) - 1;
    RowMatrix next(parents, k + 1);
    VectorXd next_weight(parents);
    std::vector<std::uint64_t> next_key(static_cast<std::size_t>(parents));
    for (Index p = 0; p < parents; ++p) {
      const Index a = first[static_cast<std::size_t>(p)],
                  m = first[static_cast<std::size_t>(p + 1)] - a;
      next_weight(p) = weight.segment(a, m).sum();
      next.row(p) = weight.segment(a, m).transpose() * means.middleRows(a, m) / next_weight(p);
      next_key[static_cast<std::size_t>(p)] = key[static_cast<std::size_t>(a)];
      for (Index i = a; i < a + m; ++i)
        means.row(i) = std::sqrt(weight(i)) * (means.row(i) - next.row(p));
    }
    const auto at = static_cast<std::size_t>(scale);
    sums.gram[at].selfadjointView<Eigen::Lower>().rankUpdate(means.transpose());
    sums.count[at] += static_cast<double>(means.rows() - parents);
    means = std::move(next);
    weight = std::move(next_weight);
    key = std::move(next_key);
  }
  const Index row = static_cast<Index>(sums.weight.size());
  if (sums.rows.rows() <= row) sums.rows.conservativeResize(2 * row + 16, k + 1);
  sums.rows.row(row) = means.row(0);
  sums.weight.push_back(weight(0));
  Vec3 centre;
  for (std::size_t i = cell.begin; i < cell.end; ++i) centre += all[order[i].second].place;
  sums.centre.push_back((1.0 / static_cast<double>(n)) * centre);
  sums.set_up.push_back(all[order[cell.begin].second].set_up);
}

void whiten(SetSums& s, const std::vector<Theta>& theta) {
  const Index m = static_cast<Index>(s.weight.size());
  s.top.assign(theta.size(), MatrixXd());
  s.log_det.assign(theta.size(), 0.0);
  if (m == 0) return;
  const double mean =
      std::accumulate(s.weight.begin(), s.weight.end(), 0.0) / static_cast<double>(m);
  const auto at = [](Index i) { return static_cast<std::size_t>(i); };
  oneapi::tbb::parallel_for(std::size_t{0}, theta.size(), [&](std::size_t t) {
    const Theta& th = theta[t];
    MatrixXd c = MatrixXd::Zero(m, m);
    for (Index i = 0; i < m; ++i) {
      c(i, i) = mean / s.weight[at(i)];
      if (th.ratio == 0.0) continue;
      for (Index j = 0; j <= i; ++j) {
        if (th.per_set_up && s.set_up[at(i)] != s.set_up[at(j)]) continue;
        const Vec3 d = s.centre[at(i)] - s.centre[at(j)];
        const double r = std::hypot(d.x, d.y) / th.length_mm;
        c(i, j) += th.ratio * (th.gauss ? std::exp(-0.5 * r * r) : std::exp(-r));
      }
    }
    const Eigen::LLT<MatrixXd> llt(c);
    const MatrixXd white = llt.matrixL().solve(s.rows);
    s.top[t] = white.transpose() * white;
    double log_det = 0.0;
    for (Index i = 0; i < m; ++i) log_det += 2.0 * std::log(llt.matrixLLT()(i, i));
    s.log_det[t] = log_det;
  });
}

std::uint64_t interleave(std::uint64_t r, std::uint64_t c) {
  std::uint64_t key = 0;
  for (int b = 2; b >= 0; --b) key = (key << 2) | (((r >> b) & 1U) << 1) | ((c >> b) & 1U);
  return key;
}

}  // namespace

Bank sum_up(const std::vector<Observation>& all, const std::vector<Column>& nuisances,
            const std::vector<Column>& columns, const Layout& layout,
            const std::vector<Theta>* theta, int only) {
  Bank bank;
  bank.theta = theta != nullptr ? *theta : thetas(layout.cell_mm);
  const auto add = [&](const Column& c) {
    if (bank.index.emplace(c.key, static_cast<int>(bank.columns.size())).second)
      bank.columns.push_back(c);
  };
  for (const Column& c : nuisances) add(c);
  bank.nuisances = static_cast<int>(bank.columns.size());
  for (const Column& c : columns) add(c);
  std::vector<const Column*> pointers;
  for (const Column& c : bank.columns) pointers.push_back(&c);

  // Sorted by set-up, cell, square of a quarter, of a sixteenth...
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order;
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
    order.emplace_back(
        (((static_cast<std::uint64_t>(o.set_up) << 32) | cell) << 6) | interleave(r % 8, c % 8), i);
  }
  std::sort(order.begin(), order.end());
  std::vector<CellPoints> cells;
  for (std::size_t i = 0; i < order.size();) {
    std::size_t j = i;
    while (j < order.size() && (order[j].first >> 6) == (order[i].first >> 6)) ++j;
    const Vec3 p = all[order[i].second].place;
    cells.push_back({layout.set_of(p.x, p.y), i, j});
    i = j;
  }
  const auto k = static_cast<Index>(pointers.size()) + 1;
  struct Stripe {
    std::array<SetSums, kSets> sets;
  };
  std::vector<Stripe> stripes(kStripes);
  oneapi::tbb::parallel_for(std::size_t{0}, kStripes, [&](std::size_t s) {
    for (SetSums& set : stripes[s].sets)
      for (MatrixXd& g : set.gram) g = MatrixXd::Zero(k, k);
    RowMatrix x;
    for (std::size_t i = s * cells.size() / kStripes; i < (s + 1) * cells.size() / kStripes; ++i)
      add_cell(all, order, cells[i], pointers,
               stripes[s].sets[static_cast<std::size_t>(cells[i].set)], x);
  });
  for (int set = 0; set < kSets; ++set) {
    SetSums& to = bank.sets[static_cast<std::size_t>(set)];
    for (MatrixXd& g : to.gram) g = MatrixXd::Zero(k, k);
    Index rows = 0;
    for (Stripe& s : stripes)
      rows += static_cast<Index>(s.sets[static_cast<std::size_t>(set)].weight.size());
    to.rows.resize(rows, k);
    Index row = 0;
    for (Stripe& s : stripes) {
      SetSums& from = s.sets[static_cast<std::size_t>(set)];
      for (std::size_t g = 0; g < kScales; ++g) {
        to.gram[g] += from.gram[g];
        to.count[g] += from.count[g];
      }
      const auto m = static_cast<Index>(from.weight.size());
      if (m > 0) to.rows.middleRows(row, m) = from.rows.topRows(m);
      row += m;
      to.weight.insert(to.weight.end(), from.weight.begin(), from.weight.end());
      to.centre.insert(to.centre.end(), from.centre.begin(), from.centre.end());
      to.set_up.insert(to.set_up.end(), from.set_up.begin(), from.set_up.end());
    }
    for (MatrixXd& g : to.gram) g.triangularView<Eigen::StrictlyUpper>() = g.transpose();
    whiten(to, bank.theta);
  }
  return bank;
}

namespace {

/// The sums of a model's columns: small dense matrices.
struct Small {
  std::array<MatrixXd, kScales> gram;
  std::array<double, kScales> count{};
  std::vector<MatrixXd> top;
  std::vector<double> log_det;
  double top_count = 0.0;
};

Small pick(const Bank& bank, const std::vector<int>& model, const std::vector<int>& sets) {
  Small s;
  std::vector<int> at = model;
  at.push_back(bank.y());
  for (std::size_t g = 0; g < kScales; ++g) {
    s.gram[g] = MatrixXd::Zero(static_cast<Index>(at.size()), static_cast<Index>(at.size()));
    for (const int set : sets) {
      const SetSums& from = bank.sets[static_cast<std::size_t>(set)];
      s.gram[g] += from.gram[g](at, at);
      s.count[g] += from.count[g];
    }
  }
  s.top.resize(bank.theta.size());
  s.log_det.assign(bank.theta.size(), 0.0);
  for (const int set : sets)
    s.top_count += static_cast<double>(bank.sets[static_cast<std::size_t>(set)].weight.size());
  for (std::size_t t = 0; t < bank.theta.size(); ++t) {
    s.top[t] = MatrixXd::Zero(static_cast<Index>(at.size()), static_cast<Index>(at.size()));
    for (const int set : sets) {
      const SetSums& from = bank.sets[static_cast<std::size_t>(set)];
      if (from.weight.empty()) continue;
      s.top[t] += from.top[t](at, at);
      s.log_det[t] += from.log_det[t];
    }
  }
  return s;
}

double rss(const MatrixXd& gram, const VectorXd& b) {
  const Index p = b.size();
  return std::fmax(
      0.0, gram(p, p) - 2.0 * b.dot(gram.col(p).head(p)) + b.dot(gram.topLeftCorner(p, p) * b));
}

constexpr double kLeastVariance = 1e-12;  // a nanometre: exact data keep finite logarithms

/// Solves for the coefficients, given variances; columns that add nothing get none.
VectorXd solve(const MatrixXd& a, const VectorXd& b, MatrixXd* covariance) {
  const VectorXd d = a.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = d.asDiagonal() * a * d.asDiagonal();
  scaled.diagonal().array() += 1e-10;
  const Eigen::LDLT<MatrixXd> ldlt(scaled);
  if (covariance != nullptr)
    *covariance =
        d.asDiagonal() * ldlt.solve(MatrixXd::Identity(a.rows(), a.cols())) * d.asDiagonal();
  return d.asDiagonal() * ldlt.solve(d.asDiagonal() * b);
}

}  // namespace

Fit fit(const Bank& bank, const std::vector<int>& model, const std::vector<int>& sets) {
  const Small s = pick(bank, model, sets);
  const auto p = static_cast<Index>(model.size());
  Fit best;
  std::array<double, kScales> start{};
  for (std::size_t g = 0; g < kScales; ++g)
    start[g] = std::fmax(kLeastVariance, s.count[g] > 0.0 ? s.gram[g](p, p) / s.count[g] : 1.0);
  const double start_top = std::fmax(kLeastVariance, s.top[0](p, p) / std::fmax(1.0, s.top_count));
  for (std::size_t t = 0; t < bank.theta.size(); ++t) {
    Fit f;
    f.theta = static_cast<int>(t);
    f.variance = best.coefficients.size() == p ? best.variance : start;
    f.top_variance = best.coefficients.size() == p ? best.top_variance : start_top;
    MatrixXd a;
    for (int round = 0; round < 4; ++round) {
      a = s.top[t].topLeftCorner(p, p) / f.top_variance;
      VectorXd b = s.top[t].col(p).head(p) / f.top_variance;
      for (std::size_t g = 0; g < kScales; ++g) {
        a += s.gram[g].topLeftCorner(p, p) / f.variance[g];
        b += s.gram[g].col(p).head(p) / f.variance[g];
      }
      f.coefficients = solve(a, b, nullptr);
      for (std::size_t g = 0; g < kScales; ++g)
        if (s.count[g] > 0.0)
          f.variance[g] = std::fmax(kLeastVariance, rss(s.gram[g], f.coefficients) / s.count[g]);
      f.top_variance = std::fmax(
          kLeastVariance, rss(s.top[t], f.coefficients) /
                              std::fmax(1.0, s.top_count - static_cast<double>(bank.nuisances)));
      double objective = s.log_det[t] + s.top_count * std::log(f.top_variance);
      for (std::size_t g = 0; g < kScales; ++g) objective += s.count[g] * std::log(f.variance[g]);
      const bool rest = std::abs(objective - f.objective) < 0.01;
      f.objective = objective;
      if (rest) break;
      if (round == 1 && objective > best.objective + 200.0) break;
    }
    if (f.objective < best.objective) {
      best = f;
      solve(a, VectorXd::Zero(p), &best.covariance);
    }
  }
  return best;
}

double objective_held(const Bank& bank, const std::vector<int>& model, const VectorXd& coefficients,
                      int free_columns, const std::vector<int>& sets) {
  // The held part is moved to the residual's side.
  Bank moved;
  std::vector<int> at = model;
  at.push_back(bank.y());
  MatrixXd map = MatrixXd::Zero(static_cast<Index>(at.size()), free_columns + 1);
  map.topLeftCorner(free_columns, free_columns).setIdentity();
  map(static_cast<Index>(at.size()) - 1, free_columns) = 1.0;
  for (Index i = free_columns; i < static_cast<Index>(model.size()); ++i)
    map(i, free_columns) = -coefficients(i);
  moved.columns.resize(static_cast<std::size_t>(free_columns));
  moved.nuisances = bank.nuisances;
  moved.theta = bank.theta;
  for (const int set : sets) {
    const SetSums& from = bank.sets[static_cast<std::size_t>(set)];
    SetSums& to = moved.sets[static_cast<std::size_t>(set)];
    for (std::size_t g = 0; g < kScales; ++g) {
      to.gram[g] = map.transpose() * from.gram[g](at, at) * map;
      to.count[g] = from.count[g];
    }
    to.weight = from.weight;
    to.log_det = from.log_det;
    to.top.resize(from.top.size());
    for (std::size_t t = 0; t < from.top.size(); ++t)
      if (from.top[t].size() > 0) to.top[t] = map.transpose() * from.top[t](at, at) * map;
  }
  std::vector<int> nuisances(static_cast<std::size_t>(free_columns));
  std::iota(nuisances.begin(), nuisances.end(), 0);
  return fit(moved, nuisances, sets).objective;
}

}  // namespace maquette::diagnosis::detail
