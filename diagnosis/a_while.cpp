// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/a_while.hpp"

#include "diagnosis/detail/choosing.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr Eigen::Index kBins = 64;  // of the program's time
/// In -2 log likelihood, what two more parameters and the choice among 2080 windows cost: twice the
/// logarithm of that is 15, and up to four times as much where neighbouring blocks agree.
constexpr double kPrice = 60.0;

struct While {
  double from = 0.0, to = 1.0, gain = 0.0;
};

/// When a wave gains most beside the others, to first order. Residuals are about these.
/// @param whole  what it gains all the while
While best_while(const Form& wave, const Members& others, const Search& search, const Bank& bank,
                 const Linearised& residuals, double& whole) {
  const Fit f = residuals.fit_of(others);
  std::vector<Form> bins;
  std::vector<Column> columns;
  for (Eigen::Index b = 0; b < kBins; ++b) {
    bins.push_back(wave.during(static_cast<double>(b) / kBins, static_cast<double>(b + 1) / kBins));
    columns.insert(columns.end(), bins.back().columns.begin(), bins.back().columns.end());
  }
  const Bank small = bank_beside(search, bank, f, others, columns, {kChoose});
  const Eigen::MatrixXd rest = screen(small, others, {kChoose}).rest[0];
  std::vector<std::vector<int>> of_bin;
  for (const Form& bin : bins) {
    of_bin.emplace_back();
    for (const Column& c : bin.columns) of_bin.back().push_back(small.index.at(c.key));
  }
  const auto at = [&](Eigen::Index bin) -> const std::vector<int>& {
    return of_bin[static_cast<std::size_t>(bin)];
  };
  const auto count = static_cast<Eigen::Index>(wave.columns.size());
  While best;
  for (Eigen::Index from = 0; from < kBins; ++from) {
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(count, count);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(count);
    for (Eigen::Index to = from; to < kBins; ++to) {
      a += rest(at(to), at(to));
      for (Eigen::Index k = from; k < to; ++k) {
        const Eigen::MatrixXd across = rest(at(to), at(k));
        a += across + across.transpose();
      }
      b += rest(at(to), small.y());
      const Eigen::VectorXd size =
          (a + 1e-9 * Eigen::MatrixXd::Identity(count, count)).ldlt().solve(b);
      const double gain = size.dot(b);
      if (from == 0 && to + 1 == kBins) whole = gain;
      if (gain > best.gain)
        best = {static_cast<double>(from) / kBins, static_cast<double>(to + 1) / kBins, gain};
    }
  }
  return best;
}

/// The last member's ends where the model does best cut anew: to first order a wave misses that its
/// passes lie lower.
Members at_best_ends(Members model, const Search& search, Bank& bank, Linearised& residuals,
                     const std::vector<std::array<double, 2>>& also, const RunContext& run) {
  double now = residuals.score(model);
  Eigen::VectorXd sizes = residuals.fit_of(model).coefficients;
  auto ends = *ends_of(model.back().form.fixed, residuals.scene().duration_min);
  const auto better_at = [&](const std::array<double, 2>& other) {
    if (run.stopped() || !(other[0] >= 0.0 && other[1] <= 1.0 && other[0] < other[1])) return false;
    Members moved = model;
    moved.back().form = model.back().form.during(other[0], other[1]);
    add_columns(bank, search.observations, moved.back().form.columns);
    residuals.begin_at(moved, sizes);
    const double score = residuals.score(moved);
    if (!(score < now)) return false;
    now = score;
    ends = other;
    sizes = residuals.fit_of(moved).coefficients;
    model = std::move(moved);
    return true;
  };
  for (const auto& other : also) better_at(other);
  constexpr int kMoves = 3;  // at one distance
  for (const double d : {1.0 / 128, 1.0 / 256, 1.0 / 512, 1.0 / 1024})
    for (const std::size_t end : {0U, 1U})
      for (const double later : {d, -d}) {
        const auto moved = [&] {
          auto other = ends;
          other[end] += later;
          return other;
        };
        for (int i = 0; i < kMoves && better_at(moved()); ++i) {
        }
      }
  return model;
}

}  // namespace

std::optional<std::array<double, 2>> ends_of(
    const std::vector<std::pair<std::string, double>>& fixed, double duration_min) {
  std::optional<double> from, to;
  for (const auto& [name, value] : fixed) {
    if (name == "from_min") from = value / duration_min;
    if (name == "to_min") to = value / duration_min;
  }
  if (!from || !to || !(duration_min > 0.0)) return std::nullopt;
  return std::array{*from, *to};
}

Members lasting_a_while(Members with, Search& search, Bank& bank, Linearised& residuals,
                        const RunContext& run) {
  for (std::size_t k = 0; k < with.size() && !run.stopped(); ++k) {
    if (!with[k].form.during) continue;
    const Members others = without(with, k);
    const double now = residuals.score(with), duration_min = residuals.scene().duration_min;
    // Without steps, which stood for its ends.
    Members rest;
    std::vector<std::array<double, 2>> moments;
    for (const Member& m : others)
      if (!has_a_moment(m))
        rest.push_back(m);
      else if (m.form.fixed.size() == 2)
        moments.push_back(
            {m.form.fixed[0].second / duration_min, m.form.fixed[1].second / duration_min});
    Members unmoved = rest;
    unmoved.push_back(with[k]);
    const bool known = ends_of(with[k].form.fixed, duration_min).has_value();
    if (!known) {
      residuals.about(others);
      double whole = 0.0;
      const While found = best_while(with[k].form, others, search, bank, residuals, whole);
      if (!(found.gain > whole + kPrice)) continue;
      unmoved.back().form = with[k].form.during(found.from, found.to);
      add_columns(bank, search.observations, unmoved.back().form.columns);
      unmoved = at_best_ends(std::move(unmoved), search, bank, residuals, moments, run);
    } else if (rest.size() == others.size()) {
      continue;
    }
    const Member wave = unmoved.back();
    // What steps gain beside it is owed to its law as far as that may be wrong.
    const double owed = owed_to_its_law(unmoved, residuals);
    Members best = with;
    double least = now;
    const auto try_it = [&](Members trial, double price) {
      const double score = residuals.score(trial) + price;
      if (!(score < least)) return;
      least = score;
      best = std::move(trial);
    };
    const double price = known ? 0.0 : kPrice;
    try_it(unmoved, price - owed);
    for (std::size_t j = 0; j < rest.size(); ++j) try_it(without(unmoved, j), price - owed);
    if (!known && rest.size() < others.size()) {
      Members trial = others;
      trial.push_back(wave);
      try_it(trial, price);
      for (std::size_t j = 0; j < others.size(); ++j) try_it(without(trial, j), price);
    }
    if (!(least < now)) continue;
    with = std::move(best);
    if (!known)
      for (Candidate& c : search.candidates)
        if (c.effect == wave.effect) c.forms.push_back(wave.form);
    break;  // of the members others are left
  }
  residuals.about(with);
  return with;
}

}  // namespace maquette::diagnosis::detail
