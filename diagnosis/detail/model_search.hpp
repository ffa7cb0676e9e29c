// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Which causes together: beam search on one set, confirmation on another.

#include <functional>
#include <optional>
#include <vector>

#include "core/run_context.hpp"
#include "diagnosis/detail/sums.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// A cause in a model: an effect with one of its forms, as columns of a bank.
struct Member {
  const Effect* effect = nullptr;
  Form form;
};

/// In -2 log likelihood, a ratio of 100: causes closer than that are not told apart.
inline constexpr double kEquivalent = 9.2;

/// All but the k-th.
[[nodiscard]] std::vector<Member> without(std::vector<Member> members, std::size_t k);

struct Candidate {
  const Effect* effect = nullptr;
  std::vector<Form> forms;
};

/// Indices of nuisances and of the members' columns, each once.
[[nodiscard]] std::vector<int> columns_of(const Bank& bank, const std::vector<Member>& members);
/// Where a column is among a model's, and its coefficient in the model's fit.
/// @pre it is one of them
[[nodiscard]] Eigen::Index place_of(const Bank& bank, const std::vector<int>& model,
                                    const Column& column);

/// What a coefficient has to earn in -2 log likelihood to be worth it while choosing.
inline constexpr double kPricePerColumn = 6.0;
inline constexpr double kPricePerCause = 14.0;

/// Six directions of each set-up's pose, and the difference between cut and designed surface. Its
/// coefficient is 0 where the data show all that the cut leaves, the ridges between passes, and -1
/// where a scanner or a coat has smoothed them away.
inline constexpr const char* kMilledMinusDesign = "milled_minus_design";
[[nodiscard]] std::vector<Column> nuisances_of(const Measurements& measurements);
/// All causes with a form that these data can test. @param untestable  the names of the others
[[nodiscard]] std::vector<Candidate> candidates_of(const Scene& scene,
                                                   std::vector<std::string>& untestable);
[[nodiscard]] std::vector<Column> all_columns(const std::vector<Candidate>& candidates);

struct Search {
  const std::vector<Observation>& observations;
  const std::vector<Column>& nuisances;
  const Layout& layout;
  std::vector<Candidate> candidates;
};
/// The candidate of an effect; end: none.
[[nodiscard]] std::vector<Candidate>::const_iterator candidate_of(const Search& search,
                                                                  const Effect* effect);

/// Best combination on the choosing blocks. Refined forms are added to `bank`.
/// @param ranking  what each candidate gains alone, best first
[[nodiscard]] std::vector<Member> choose(Search& search, Bank& bank, std::vector<Ranked>& ranking,
                                         const RunContext& run);

/// Is the effect one of the members?
[[nodiscard]] bool has(const std::vector<Member>& members, const Effect* effect);
/// May the effect be beside these? Not one of them, nor one that says the same (never_beside).
[[nodiscard]] bool may_join(const std::vector<Member>& members, const Effect* effect);

/// Whether every size of a member is one that a workshop would believe.
/// @param model   columns_of() the fitted model
/// @param sigmas  standard errors by which a size may be beyond
[[nodiscard]] bool believable(const Bank& bank, const std::vector<int>& model, const Member& member,
                              const Fit& f, double sigmas = 0.0);
/// The same of all members of a model.
[[nodiscard]] bool believable(const Bank& bank, const std::vector<Member>& members, const Fit& f);

/// What a model costs while choosing.
[[nodiscard]] double price(const Bank& bank, const std::vector<Member>& members);

/// Makes the bank's residuals those that a model of these members is fitted to.
using Settle = std::function<void(const std::vector<Member>&)>;

/// A bank of the members' columns and some more, summed anew for few laws of unevenness: white and
/// those of a fit.
[[nodiscard]] Bank bank_beside(const Search& search, const Bank& bank, const Fit& fit,
                               const std::vector<Member>& members, const std::vector<Column>& more,
                               const std::vector<int>& sets);

/// The same causes with forms refined anew on the blocks of `sets`, each beside all others: a
/// moment or a length that was found while others were missing is a little off.
[[nodiscard]] std::vector<Member> polished(Search& search, Bank& bank, std::vector<Member> members,
                                           const Settle& settle,
                                           const std::vector<int>& sets = {kChoose});

struct Confirmed {
  Member member;
  double p_value = 1.0;
  /// With the moments that were chosen, where all blocks have others.
  std::optional<Form> chosen{};
  /// In the form that leaves the least squares (prefer_few_parameters).
  bool by_squares = false;
};
/// Those of `members` that hold on the confirming blocks.
/// @param sharp     the same, at the moments that all blocks ask for: by these it is told how much
///   neighbouring cells agree by themselves, which a border that is off by a part of a pass would
///   not leave to noise
/// @param rejected  the others, and why
[[nodiscard]] std::vector<Confirmed> confirm(const Bank& bank, std::vector<Member> members,
                                             std::vector<Member> sharp, double level,
                                             std::vector<Rejected>& rejected, const Settle& settle);

/// What columns would gain beside a model were its noise to stay: normal equations with the model's
/// columns eliminated, at the noise of its fit and, for a long process takes what a drift does,
/// with white means of cells.
struct Screen {
  std::array<Eigen::MatrixXd, 2> rest;  ///< columns of the bank, the residual last
  /// In -2 log likelihood at either noise; 0 where the coefficients are not physical.
  [[nodiscard]] std::array<double, 2> gain(const Bank& bank, const Form& form) const;
};
[[nodiscard]] Screen screen(const Bank& bank, const std::vector<Member>& model,
                            const std::vector<int>& sets);

/// Best objective over the forms of a candidate beside `others`, on `sets`. Of many forms those are
/// fitted that the screen finds best.
struct BestForm {
  double objective = INFINITY;
  std::size_t form = 0;
};
[[nodiscard]] BestForm best_form(const Bank& bank, const std::vector<Member>& others,
                                 const Candidate& candidate, const std::vector<int>& sets,
                                 bool priced, const Screen& screen);

}  // namespace maquette::diagnosis::detail
