// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/check.hpp"
#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {
namespace {
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The sums of a model's columns: small dense matrices.
struct Small {
  std::array<MatrixXd, kGroups> gram;
  std::array<double, kGroups> count{};
  struct Top {
    MatrixXd grams;  // by theta, side by side
    std::vector<double> log_det;
    double count = 0.0;
    [[nodiscard]] auto gram(std::size_t theta) const {
      return grams.middleCols(static_cast<Index>(theta) * grams.rows(), grams.rows());
    }
  };
  std::array<Top, kTops> top;
  std::vector<double> ratio;  // of what is smooth, by theta
  Index nuisances = 0;        // the first columns
};

Small pick(const Bank& bank, const std::vector<int>& model, const std::vector<int>& sets) {
  Small s;
  std::vector<int> at = model;
  at.push_back(bank.y());
  const auto n = static_cast<Index>(at.size());
  for (std::size_t g = 0; g < kGroups; ++g) {
    s.gram[g] = MatrixXd::Zero(n, n);
    for (const int set : sets) {
      const SetSums& from = bank.sets[static_cast<std::size_t>(set)];
      s.gram[g].noalias() += bank.weight[g] * from.gram[g](at, at);
      s.count[g] += bank.weight[g] * from.count[g];
    }
  }
  MAQUETTE_CHECK(!std::isnan(s.gram[0].sum()), "columns without answers are fitted");
  for (std::size_t u = 0; u < kTops; ++u) {
    Small::Top& top = s.top[u];
    top.grams = MatrixXd::Zero(n, n * static_cast<Index>(bank.tried));
    top.log_det.assign(bank.tried, 0.0);
    for (const TopSums* from : tops_of(bank, sets, u)) {
      top.count += static_cast<double>(from->weight.size());
      for (std::size_t t = 0; t < bank.tried; ++t) {
        auto to = top.grams.middleCols(static_cast<Index>(t) * n, n);
        // By hand: gram[t](at, at) copies the indices twice, for each theta.
        const MatrixXd& all = from->gram[t];
        for (Index j = 0; j < n; ++j) {
          const double* column = &all(0, at[static_cast<std::size_t>(j)]);
          for (Index i = 0; i < n; ++i) to(i, j) += column[at[static_cast<std::size_t>(i)]];
        }
        top.log_det[t] += from->log_det[t];
      }
    }
  }
  for (const Theta& theta : bank.theta) s.ratio.push_back(theta.smooth_ratio());
  s.nuisances = std::min<Index>(bank.nuisances, n - 1);
  return s;
}

/// @param gram  products of columns, the residual last; symmetric
template <class Gram>
double rss(const Gram& gram, const VectorXd& b) {
  const Index p = b.size();
  double sum = gram(p, p);
  for (Index j = 0; j < p; ++j) sum += b(j) * (b.dot(gram.col(j).head(p)) - 2.0 * gram(j, p));
  return std::fmax(0.0, sum);
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

/// Information on the nuisances and the logarithm of its determinant.
struct Information {
  VectorXd d;
  Eigen::LLT<MatrixXd> llt;
  double log_det = 0.0;

  explicit Information(const MatrixXd& a)
      // Of nuisances that these data do not show nothing is taken.
      : d((a.diagonal().array() > 0.0).select(a.diagonal().cwiseSqrt().cwiseInverse(), 1.0)) {
    MatrixXd scaled = d.asDiagonal() * a * d.asDiagonal();
    scaled.diagonal().array() += 1e-10;
    llt.compute(scaled);
    for (Index i = 0; i < a.rows(); ++i)
      log_det += 2.0 * (std::log(llt.matrixLLT()(i, i)) - std::log(d(i)));
  }
  [[nodiscard]] MatrixXd inverse() const {
    return d.asDiagonal() * llt.solve(MatrixXd::Identity(d.size(), d.size())) * d.asDiagonal();
  }
};
/// Degrees of freedom that nuisances of such an inverse information take of data with such sums and
/// variance.
template <class Gram>
double taken(const MatrixXd& inverse, const Gram& gram, double variance) {
  return inverse.cwiseProduct(gram.topLeftCorner(inverse.rows(), inverse.cols())).sum() / variance;
}

/// Unevenness without a cause is rarely more than hundredths: its standard deviation is taken to be
/// half-normal, mm. Without this a process of tenths over half the part holds a warp at no price.
constexpr double kUsualUnevenness_mm = 0.02;
double unusual(double ratio, double variance) {
  return ratio * variance / (kUsualUnevenness_mm * kUsualUnevenness_mm);
}

/// One of the means' processes, given what the rest says of the nuisances.
struct TopFit {
  double variance = 1.0, objective = INFINITY;
};
/// @param rounds  0: good to a few tenths of the objective, at a third of the cost
TopFit fit_top(const Small::Top& top, std::size_t t, double ratio, const VectorXd& b,
               const MatrixXd& rest, int rounds) {
  const double squares = rss(top.gram(t), b);
  const auto own = top.gram(t).topLeftCorner(rest.rows(), rest.cols());
  TopFit f;
  f.variance = std::fmax(kLeastVariance, squares / top.count);
  for (int round = 0; round < rounds; ++round) {
    const MatrixXd inverse = Information(rest + own / f.variance).inverse();
    const double free = std::fmax(1.0, top.count - taken(inverse, top.gram(t), f.variance));
    f.variance = std::fmax(kLeastVariance, squares / free);
  }
  f.objective = top.log_det[t] + top.count * std::log(f.variance) + squares / f.variance +
                Information(rest + own / f.variance).log_det + unusual(ratio, f.variance);
  return f;
}

/// Beyond this no nuisances make up for a worse likelihood: variances of processes differ by less
/// than 1e4, and a set-up has six.
constexpr double kHopeless = 50.0;
/// What a rough fit of a process may be wrong by.
constexpr double kRough = 2.0;

/// Of the process that a fit has.
auto top_gram(const Small& s, const Fit& f, std::size_t u) {
  return s.top[u].gram(static_cast<std::size_t>(f.theta[u]));
}

/// Coefficients given the noise. @param a  the normal equations' matrix
void solve_given_noise(const Small& s, Fit& f, MatrixXd& a) {
  const Index p = s.gram[0].rows() - 1;
  a = MatrixXd::Zero(p, p);
  VectorXd b = VectorXd::Zero(p);
  const auto add = [&](const auto& gram, double variance) {
    a += gram.topLeftCorner(p, p) / variance;
    b += gram.col(p).head(p) / variance;
  };
  for (std::size_t g = 0; g < kGroups; ++g) add(s.gram[g], f.variance[g]);
  for (std::size_t u = 0; u < kTops; ++u)
    if (s.top[u].count > 0.0) add(top_gram(s, f, u), f.top_variance[u]);
  f.coefficients = solve(a, b, nullptr);
}

/// One turn of "coefficients given the noise, noise given the coefficients and what nuisances have
/// taken" (restricted likelihood: Patterson & Thompson, Biometrika 58 (1971),
/// doi:10.1093/biomet/58.3.545; fixed point: Harville, JASA 72 (1977), eq. 5.1,
/// doi:10.1080/01621459.1977.10480998). @param free  theta is chosen anew, else held
void improve(const Small& s, Fit& f, bool free, MatrixXd& a) {
  const Index n = s.nuisances;
  solve_given_noise(s, f, a);
  MatrixXd known = a.topLeftCorner(n, n);
  {
    const MatrixXd before = Information(known).inverse();
    for (std::size_t g = 0; g < kGroups; ++g) {
      if (!(s.count[g] > 0.0)) continue;
      const double left = std::fmax(1.0, s.count[g] - taken(before, s.gram[g], f.variance[g]));
      const double variance = std::fmax(kLeastVariance, rss(s.gram[g], f.coefficients) / left);
      known += s.gram[g].topLeftCorner(n, n) * (1.0 / variance - 1.0 / f.variance[g]);
      f.variance[g] = variance;
    }
  }
  for (std::size_t u = 0; u < kTops; ++u) {
    const Small::Top& top = s.top[u];
    if (!(top.count > 0.0)) continue;
    known -= top_gram(s, f, u).topLeftCorner(n, n) / f.top_variance[u];
    const auto held = static_cast<std::size_t>(f.theta[u]);
    std::vector<double> plain(top.log_det.size(), INFINITY);
    for (std::size_t t = free ? 0 : held; t < (free ? top.log_det.size() : held + 1); ++t)
      plain[t] = top.log_det[t] +
                 top.count * std::log(std::fmax(kLeastVariance,
                                                rss(top.gram(t), f.coefficients) / top.count));
    const double limit = *std::min_element(plain.begin(), plain.end()) + kHopeless;
    std::vector<double> rough(plain.size(), INFINITY);
    if (free)
      for (std::size_t t = 0; t < plain.size(); ++t)
        if (plain[t] <= limit)
          rough[t] = fit_top(top, t, s.ratio[t], f.coefficients, known, 0).objective;
    const double close = free ? *std::min_element(rough.begin(), rough.end()) + kRough : INFINITY;
    TopFit best;
    for (std::size_t t = free ? 0 : held; t < (free ? plain.size() : held + 1); ++t) {
      if (!(rough[t] <= close)) continue;
      const TopFit here = fit_top(top, t, s.ratio[t], f.coefficients, known, 2);
      if (!(here.objective < best.objective)) continue;
      best = here;
      f.theta[u] = static_cast<int>(t);
    }
    f.top_variance[u] = best.variance;
    known += top_gram(s, f, u).topLeftCorner(n, n) / best.variance;
  }
  f.objective = Information(known).log_det;
  for (std::size_t g = 0; g < kGroups; ++g)
    if (s.count[g] > 0.0)
      f.objective +=
          s.count[g] * std::log(f.variance[g]) + rss(s.gram[g], f.coefficients) / f.variance[g];
  for (std::size_t u = 0; u < kTops; ++u)
    if (s.top[u].count > 0.0)
      f.objective += s.top[u].log_det[static_cast<std::size_t>(f.theta[u])] +
                     s.top[u].count * std::log(f.top_variance[u]) +
                     rss(top_gram(s, f, u), f.coefficients) / f.top_variance[u] +
                     unusual(s.ratio[static_cast<std::size_t>(f.theta[u])], f.top_variance[u]);
}

/// Starts that are looked at more closely.
constexpr std::size_t kStarts = 6;
/// Two turns without what nuisances take, theta held: enough to tell hopeless starts.
void roughly(const Small& s, Fit& f) {
  MatrixXd a;
  for (int round = 0; round < 2; ++round) {
    solve_given_noise(s, f, a);
    f.objective = 0.0;
    const auto take = [&](const auto& gram, double count, double& variance) {
      variance = std::fmax(kLeastVariance, rss(gram, f.coefficients) / count);
      f.objective += count * std::log(variance);
    };
    for (std::size_t g = 0; g < kGroups; ++g)
      if (s.count[g] > 0.0) take(s.gram[g], s.count[g], f.variance[g]);
    for (std::size_t u = 0; u < kTops; ++u) {
      if (!(s.top[u].count > 0.0)) continue;
      take(top_gram(s, f, u), s.top[u].count, f.top_variance[u]);
      f.objective += s.top[u].log_det[static_cast<std::size_t>(f.theta[u])];
    }
  }
}

}  // namespace

std::vector<const TopSums*> tops_of(const Bank& bank, const std::vector<int>& sets,
                                    std::size_t top) {
  if (top == 0 && sets.size() == kSets && !bank.joint.weight.empty()) return {&bank.joint};
  std::vector<const TopSums*> all;
  for (const int set : sets) {
    const TopSums& own = bank.sets[static_cast<std::size_t>(set)].top[top];
    if (!own.weight.empty()) all.push_back(&own);
  }
  return all;
}

Fit fit(const Bank& bank, const std::vector<int>& model, const std::vector<int>& sets) {
  const Small s = pick(bank, model, sets);
  const auto p = static_cast<Index>(model.size());
  Fit start;
  for (std::size_t g = 0; g < kGroups; ++g)
    start.variance[g] =
        std::fmax(kLeastVariance, s.count[g] > 0.0 ? s.gram[g](p, p) / s.count[g] : 1.0);
  for (std::size_t u = 0; u < kTops; ++u)
    start.top_variance[u] =
        std::fmax(kLeastVariance, s.top[u].grams(p, p) / std::fmax(1.0, s.top[u].count));
  // There are several optima: a drift is a cause, or a long process. One start for each process
  // (with one ratio alone a longer curve once had less gain than the shorter that it holds), the
  // best two followed to rest.
  MatrixXd a;
  std::vector<Fit> starts;
  for (std::size_t t = 0; t < bank.tried; ++t) {
    Fit f = start;
    f.theta[0] = static_cast<int>(t);
    roughly(s, f);
    starts.push_back(std::move(f));
  }
  const auto better = [](const Fit& x, const Fit& y) { return x.objective < y.objective; };
  std::sort(starts.begin(), starts.end(), better);
  starts.resize(std::min(kStarts, starts.size()));
  for (Fit& f : starts)
    for (int round = 0; round < 3; ++round) improve(s, f, false, a);
  std::sort(starts.begin(), starts.end(), better);
  Fit best;
  for (std::size_t k = 0; k < std::min<std::size_t>(2, starts.size()); ++k) {
    Fit& f = starts[k];
    for (int round = 0; round < 20; ++round) {
      const double before = f.objective;
      improve(s, f, true, a);
      if (std::abs(before - f.objective) < 0.01) break;
    }
    if (f.objective < best.objective) {
      best = f;
      solve(a, VectorXd::Zero(p), &best.covariance);
    }
  }
  return best;
}

MatrixXd covariance_over_laws(const Bank& bank, const std::vector<int>& model, const Fit& best,
                              const std::vector<int>& sets) {
  constexpr double kFarOff = 12.0;  // a law that the data call e^-6 as likely counts for nothing
  const Small s = pick(bank, model, sets);
  const auto p = static_cast<Index>(model.size());
  MatrixXd sum = MatrixXd::Zero(p, p), a;
  double weight = 0.0;
  for (std::size_t t = 0; t < bank.tried; ++t) {
    Fit f = best;
    f.theta[0] = static_cast<int>(t);
    for (int round = 0; round < 3; ++round) improve(s, f, false, a);
    if (!(f.objective < best.objective + kFarOff)) continue;
    solve(a, VectorXd::Zero(p), &f.covariance);
    const double w = std::exp(-0.5 * (f.objective - best.objective));
    const VectorXd off = f.coefficients - best.coefficients;
    sum += w * (f.covariance + off * off.transpose());
    weight += w;
  }
  return weight > 0.0 ? MatrixXd(sum / weight) : best.covariance;
}

Beside beside(const Bank& bank, const std::vector<int>& model, const Fit& f, int column,
              const std::vector<int>& sets) {
  std::vector<int> wide = model;
  wide.push_back(column);
  const Small s = pick(bank, wide, sets);
  const Index p = static_cast<Index>(wide.size());
  MatrixXd a = MatrixXd::Zero(p + 1, p + 1);
  for (std::size_t g = 0; g < kGroups; ++g) a += s.gram[g] / f.variance[g];
  for (std::size_t u = 0; u < kTops; ++u)
    if (s.top[u].count > 0.0) a += top_gram(s, f, u) / f.top_variance[u];
  Beside b;
  b.absorbed = solve(a.topLeftCorner(p - 1, p - 1), a.col(p - 1).head(p - 1), nullptr);
  b.information = std::fmax(1e-12 * a(p - 1, p - 1),
                            a(p - 1, p - 1) - b.absorbed.dot(a.col(p - 1).head(p - 1)));
  b.estimate = (a(p, p - 1) - b.absorbed.dot(a.col(p).head(p - 1))) / b.information;
  return b;
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
  moved.weight = bank.weight;
  moved.theta = bank.theta;
  moved.tried = bank.tried;
  for (const int set : sets) {
    const SetSums& from = bank.sets[static_cast<std::size_t>(set)];
    SetSums& to = moved.sets[static_cast<std::size_t>(set)];
    for (std::size_t g = 0; g < kGroups; ++g) {
      to.gram[g] = map.transpose() * from.gram[g](at, at) * map;
      to.count[g] = from.count[g];
    }
    for (std::size_t u = 0; u < kTops; ++u) {
      to.top[u].weight = from.top[u].weight;
      to.top[u].log_det = from.top[u].log_det;
      to.top[u].gram.resize(from.top[u].gram.size());
      for (std::size_t t = 0; t < from.top[u].gram.size(); ++t)
        to.top[u].gram[t] = map.transpose() * from.top[u].gram[t](at, at) * map;
    }
  }
  std::vector<int> nuisances(static_cast<std::size_t>(free_columns));
  std::iota(nuisances.begin(), nuisances.end(), 0);
  return fit(moved, nuisances, sets).objective;
}

SmoothLaw smooth_law(const Bank& bank, const Layout& layout) {
  constexpr double kLeastCells = 1.2, kMostCells = 8.0, kLeastNugget = 1e-3;
  std::vector<int> nuisances(static_cast<std::size_t>(bank.nuisances));
  std::iota(nuisances.begin(), nuisances.end(), 0);
  const Theta& theta = bank.theta[static_cast<std::size_t>(fit(bank, nuisances, kAll).theta[0])];
  if (!theta.gauss || theta.ratio == 0.0 || theta.length_mm < kLeastCells * layout.cell_mm)
    return {};
  // What a coat adds to a cell's mean is its own.
  return {std::fmin(theta.length_mm, kMostCells * layout.cell_mm),
          std::fmax(kLeastNugget, (1.0 + theta.rough * theta.ratio) / theta.smooth_ratio())};
}

}  // namespace maquette::diagnosis::detail
