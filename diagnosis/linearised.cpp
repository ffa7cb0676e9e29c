// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/linearised.hpp"

#include <cmath>
#include <utility>

#include "diagnosis/detail/squares.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Of fitting and cutting anew.
constexpr int kRounds = 4;
/// The same where a size goes on by more than its step (further()).
constexpr int kSlowRounds = 8;
/// Second order of a fiftieth of a size is a hundredth of second order.
constexpr double kAtRest = 0.02, kAtRestSigmas = 0.2;
/// Models whose residuals are kept: 10 MB each for 600 000 points.
constexpr std::size_t kMostStates = 24;

bool at_rest(const Eigen::VectorXd& last, const Fit& f, Eigen::Index nuisances) {
  for (Eigen::Index k = nuisances; k < last.size(); ++k)
    if (!(std::abs(f.coefficients(k) - last(k)) <
          kAtRest * std::abs(last(k)) +
              kAtRestSigmas * std::sqrt(std::fmax(0.0, f.covariance(k, k)))))
      return false;
  return true;
}

/// Sizes of two that fit against each other grow without end where they are cut anew.
bool runs_away(const Bank& bank, const Members& model, const Fit& f) {
  constexpr double kFar = 3.0;  // of what a workshop would believe
  const auto columns = columns_of(bank, model);
  for (const Member& m : model)
    for (const Column& c : m.form.columns) {
      const double size = f.coefficients(place_of(bank, columns, c)) * c.parameter.per_column;
      if (!(std::abs(size) < kFar * c.parameter.plausible)) return true;
    }
  return false;
}

/// What to go beyond a step, by secants, each cause along its own last way. Where passes swing most
/// of the wave is cut away by their neighbours, what is left answers to a fifth of the size, and
/// steps of first order shrink by a fifth each.
/// @param way  between the last two sizes @param step_before, step  that fits wanted from these
Eigen::VectorXd further(const Bank& bank, const Members& model, const Eigen::VectorXd& way,
                        const Eigen::VectorXd& step_before, const Eigen::VectorXd& step) {
  constexpr double kLeastAnswer = 0.25, kFullAnswer = 0.75;
  const auto columns = columns_of(bank, model);
  Eigen::VectorXd more = Eigen::VectorXd::Zero(step.size());
  for (const Member& m : model) {
    std::vector<Eigen::Index> at;
    for (const Column& c : m.form.columns) at.push_back(place_of(bank, columns, c));
    const Eigen::VectorXd own = way(at);
    const double answer =
        own.dot(Eigen::VectorXd(step_before(at) - step(at))) / std::fmax(1e-300, own.dot(own));
    if (!(answer > 0.0) || answer > kFullAnswer) continue;
    const double factor = 1.0 / std::fmax(kLeastAnswer, answer) - 1.0;
    for (const Eigen::Index k : at) more(k) = factor * step(k);
  }
  return more;
}

}  // namespace

Linearised::Linearised(const Scene& scene, std::vector<Observation>& observations, Bank& bank)
    : scene_(scene),
      observations_(observations),
      bank_(bank),
      choosing_(those_in(bank, kChoose, observations.size())),
      lag_and_slack_(scene) {
  for (const Observation& o : observations) given_.push_back(o.residual_mm);
}

void Linearised::recut(const Members& model, const Eigen::VectorXd& coefficients) {
  auto beyond =
      beyond_linear(observations_, given_, model, bank_, coefficients, scene_.ball_radius_mm,
                    scene_.has_path, signatures_, lag_and_slack_, all() ? nullptr : &choosing_);
  for (std::size_t i = 0; i < given_.size(); ++i)
    observations_[i].residual_mm = beyond[i] =
        all() || choosing_[i] != 0 ? given_[i] - beyond[i] : NAN;
  const auto own = columns_of(bank_, model);
  exchange_residuals(bank_, beyond, &own, sets_);
}

void Linearised::look_at(const std::vector<int>& sets) {
  if (sets == sets_) return;
  sets_ = sets;
  about_.clear();
  now_.clear();
  recut({}, {});
}

Linearised Linearised::in_other_sums(Bank& sums) const {
  Linearised other(scene_, observations_, sums);
  other.look_at(sets_);
  if (other.lag_first() != lag_first()) other.take_order(lag_first());
  return other;
}

void Linearised::begin_at(const Members& model, const Eigen::VectorXd& coefficients) {
  Keys keys;
  for (const Member& k : model)
    for (const Column& c : k.form.columns) keys.push_back(c.key);
  rested_[all()].try_emplace(std::move(keys), coefficients);
}

/// Coefficients with which the present model came to rest, on other blocks if need be.
const Eigen::VectorXd* Linearised::rested_before() const {
  for (const std::size_t which : {all(), 1 - all()})
    if (const auto before = rested_[which].find(now_); before != rested_[which].end())
      return &before->second;
  return nullptr;
}

void Linearised::about(const Members& model) {
  about_alone(model);
  if (answer_all(bank_)) keep();
}

void Linearised::about_alone(const Members& model) {
  Keys keys, cut, moving;
  bool levels = false;
  for (const Member& k : model)
    for (const Column& c : k.form.columns) {
      keys.push_back(c.key);
      if (c.cut) cut.push_back(c.key);
      if (c.moves) moving.push_back(c.key);
      levels |= c.levels.has_value();
    }
  if (levels && model.size() > 1)
    cut = keys;                              // what any of them moves is levelled
  else if (!cut.empty() || scene_.has_path)  // poses alone are small: scans lie on the part
    cut.insert(cut.end(), moving.begin(), moving.end());
  if (cut != about_) {
    about_ = std::move(cut);
    now_ = std::move(keys);
    const auto known = states_[all()].find(now_);
    if (known != states_[all()].end() && known->second.weight == bank_.weight)
      restore(known->second);
    else
      come_to_rest(model);
  }
  answer(bank_, columns_of(bank_, model));
}

void Linearised::come_to_rest(const Members& model) {
  Eigen::VectorXd last, before_last, step, step_before;
  double least = INFINITY;  // of the objective, cut anew about before_last
  int rounds = about_.empty() ? 1 : kRounds;
  for (int round = 0; round < rounds; ++round) {
    Fit f;
    if (const auto* before = rested_before(); round == 0 && before != nullptr) {
      f.coefficients = *before;
    } else {
      answer(bank_, columns_of(bank_, model));
      f = fit_of(model);
    }
    if (round > 0 && at_rest(last, f, bank_.nuisances)) break;
    if (round > 0 && runs_away(bank_, model, f)) break;
    // A signature that has a say where size has none any more (ridges that are no longer cut) leads
    // on past what fits best.
    if (round > 1 && f.objective > least) {
      last = before_last;
      recut(model, last);
      break;
    }
    least = round > 0 ? f.objective : INFINITY;
    if (round > 0) {
      step_before = std::exchange(step, f.coefficients - last);
      if (round > 1) {
        const Eigen::VectorXd more = further(bank_, model, last - before_last, step_before, step);
        if (!more.isZero(0.0)) rounds = kSlowRounds;
        f.coefficients += more;
      }
    }
    before_last = std::exchange(last, f.coefficients);
    recut(model, last);
  }
  rested_[all()][now_] = last;
  keep();
}

void Linearised::keep() {
  auto& states = states_[all()];
  if (states.size() >= kMostStates) states.clear();
  State& state = states[now_];
  state = {{}, answers_of(bank_), bank_.weight};
  state.residual.reserve(observations_.size());
  for (const Observation& o : observations_)
    state.residual.push_back(static_cast<float>(o.residual_mm));
}

void Linearised::restore(const State& state) {
  for (std::size_t i = 0; i < observations_.size(); ++i)
    observations_[i].residual_mm = static_cast<double>(state.residual[i]);
  restore_answers(bank_, state.answers);
}

Fit Linearised::fit_of(const Members& model) const {
  return fit(bank_, columns_of(bank_, model), sets_);
}

double Linearised::score_as_is(const Members& model) const {
  const Fit f = fit(bank_, columns_of(bank_, model), {kChoose});
  return believable(bank_, model, f) ? f.objective + price(bank_, model) : INFINITY;
}

double Linearised::score(const Members& model) {
  about_alone(model);
  return score_as_is(model);
}

double Linearised::left_by(const Members& model, double* points) const {
  return squares(bank_, columns_of(bank_, model), fit_of(model).coefficients, sets_, points);
}

void Linearised::take_order(bool lag_first) {
  lag_and_slack_.lag_first = lag_first;
  about_.clear();
  rested_ = {};
  states_ = {};
}

}  // namespace maquette::diagnosis::detail
