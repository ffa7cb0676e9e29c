// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Residuals as a model sees them.
//
// Signatures are of first order and of one cause alone. What the cut of a model's causes together
// moves beyond them is taken off the residuals, so that what is left answers to coefficients in
// straight lines: Gauss and Newton with a fixed Jacobian. So residuals belong to a model, and are
// those of the model asked for last.

#include <array>
#include <map>
#include <string>
#include <vector>

#include "diagnosis/detail/residuals.hpp"

namespace maquette::diagnosis::detail {

/// Causes that make a model.
using Members = std::vector<Member>;

class Linearised {
 public:
  /// All three are kept by reference; `observations` and `bank` get the residuals.
  Linearised(const Scene& scene, std::vector<Observation>& observations, Bank& bank);

  /// Makes the residuals those of a model; nothing where they are that already. Models asked for
  /// not long ago are as they came to rest, others asked for before begin there.
  void about(const Members& model);
  /// The same for fits of that model and of parts of it alone: the bank has no other columns'
  /// products with these residuals.
  void about_alone(const Members& model);
  /// As a Settle.
  [[nodiscard]] Settle settle() {
    return [this](const Members& model) { about(model); };
  }
  [[nodiscard]] Settle settle_alone() {
    return [this](const Members& model) { about_alone(model); };
  }

  /// The same residuals in other sums of the same sets, as few columns as are needed. Both are
  /// about nothing when it is made and when this one is asked again.
  [[nodiscard]] Linearised in_other_sums(Bank& sums) const;

  /// Coefficients with which a model that was not asked for yet begins to come to rest.
  void begin_at(const Members& model, const Eigen::VectorXd& coefficients);

  /// From here on residuals are cut anew, models fitted and squares summed on the choosing blocks
  /// alone, a third of the work, or on all blocks again; elsewhere residuals are NaN.
  void look_at(const std::vector<int>& sets);

  /// Fit of a model on the blocks that are looked at, with residuals as they are.
  [[nodiscard]] Fit fit_of(const Members& model) const;
  /// -2 log likelihood on the choosing blocks with the price of a model, residuals as they are;
  /// less is better. Infinite where a size is not one to believe.
  [[nodiscard]] double score_as_is(const Members& model) const;
  /// The same with residuals about the model.
  [[nodiscard]] double score(const Members& model);
  /// Squares that a model leaves on the blocks that are looked at, all points alike, residuals as
  /// they are.
  /// @param points  how many, or nullptr
  [[nodiscard]] double left_by(const Members& model, double* points = nullptr) const;

  [[nodiscard]] const Scene& scene() const { return scene_; }
  /// Whether slack is behind the drive that lags, where a model has both.
  [[nodiscard]] bool lag_first() const { return lag_and_slack_.lag_first; }
  void take_order(bool lag_first);

 private:
  using Keys = std::vector<std::string>;
  /// Of the choosing blocks alone, and of all.
  template <class T>
  using Known = std::array<std::map<Keys, T>, 2>;
  struct State {
    std::vector<float> residual;
    Answers answers;
    Weights weight;  // with which it came to rest
  };
  [[nodiscard]] std::size_t all() const { return sets_.size() == kSets ? 1 : 0; }
  [[nodiscard]] const Eigen::VectorXd* rested_before() const;
  void recut(const Members& model, const Eigen::VectorXd& coefficients);
  void come_to_rest(const Members& model);
  void keep();
  void restore(const State& state);

  const Scene& scene_;
  std::vector<Observation>& observations_;
  Bank& bank_;
  std::vector<double> given_;  // residuals as measured
  Keys about_;                 // columns that second order hangs on
  Keys now_;                   // all columns of the model whose residuals these are
  std::vector<int> sets_ = kAll;
  std::vector<char> choosing_;  // whether an observation is in those blocks
  Known<Eigen::VectorXd> rested_;
  Known<State> states_;
  Signatures signatures_;
  LagAndSlack lag_and_slack_;
};

}  // namespace maquette::diagnosis::detail
