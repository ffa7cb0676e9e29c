// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/linearised.hpp"

#include <cmath>

#include "diagnosis/detail/squares.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Of fitting and cutting anew.
constexpr int kRounds = 4;
/// Second order of a fiftieth of a size is a hundredth of second order.
constexpr double kAtRest = 0.02, kAtRestSigmas = 0.2;

bool at_rest(const Eigen::VectorXd& last, const Fit& f, Eigen::Index nuisances) {
  for (Eigen::Index k = nuisances; k < last.size(); ++k)
    if (!(std::abs(f.coefficients(k) - last(k)) <
          kAtRest * std::abs(last(k)) +
              kAtRestSigmas * std::sqrt(std::fmax(0.0, f.covariance(k, k)))))
      return false;
  return true;
}

}  // namespace

Linearised::Linearised(const Scene& scene, std::vector<Observation>& observations, Bank& bank)
    : scene_(scene), observations_(observations), bank_(bank), lag_and_slack_(scene) {
  for (const Observation& o : observations) given_.push_back(o.residual_mm);
}

void Linearised::recut(const Members& model, const Eigen::VectorXd& coefficients) {
  auto beyond = beyond_linear(observations_, model, bank_, coefficients, scene_.ball_radius_mm,
                              signatures_, lag_and_slack_);
  for (std::size_t i = 0; i < given_.size(); ++i)
    observations_[i].residual_mm = beyond[i] = given_[i] - beyond[i];
  exchange_residuals(bank_, beyond);
}

void Linearised::about(const Members& model) {
  Keys keys, cut;
  bool levels = false;
  for (const Member& k : model)
    for (const Column& c : k.form.columns) {
      keys.push_back(c.key);
      if (c.cut) cut.push_back(c.key);
      levels |= c.levels.has_value();
    }
  if (levels && model.size() > 1) cut = keys;  // what any of them moves is levelled
  if (cut == about_) return;
  about_ = std::move(cut);
  Eigen::VectorXd last;
  for (int round = 0; round < (about_.empty() ? 1 : kRounds); ++round) {
    Fit f;
    if (const auto before = rested_.find(keys); round == 0 && before != rested_.end())
      f.coefficients = before->second;
    else
      f = fit_of(model);
    if (round > 0 && at_rest(last, f, bank_.nuisances)) break;
    last = f.coefficients;
    recut(model, last);
  }
  rested_[keys] = last;
}

Fit Linearised::fit_of(const Members& model) const {
  return fit(bank_, columns_of(bank_, model), kAll);
}

double Linearised::score_as_is(const Members& model) const {
  return fit(bank_, columns_of(bank_, model), {kChoose}).objective + price(bank_, model);
}

double Linearised::score(const Members& model) {
  about(model);
  return score_as_is(model);
}

double Linearised::left_by(const Members& model, double* points) const {
  return squares(bank_, columns_of(bank_, model), fit_of(model).coefficients, kAll, points);
}

void Linearised::take_order(bool lag_first) {
  lag_and_slack_.lag_first = lag_first;
  about_.clear();
  rested_.clear();
}

}  // namespace maquette::diagnosis::detail
