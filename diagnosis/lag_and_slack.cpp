// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/lag_and_slack.hpp"

#include <cmath>

namespace maquette::diagnosis::detail {
namespace {
/// Lags are rounded to powers of this: what rounding leaves is a fortieth of what they do together.
constexpr double kLagStep = 1.05;
}  // namespace

std::vector<std::function<CutChange(const CutState&)>> LagAndSlack::changes(
    const std::vector<FollowedTerm>& terms) {
  std::vector<std::function<CutChange(const CutState&)>> all;
  if (!make_) return all;
  for (const FollowedTerm& lag : terms)
    for (const FollowedTerm& slack : terms) {
      if (!lag.what.lag || slack.what.lag || !(lag.coefficient > 0.0)) continue;
      const int step = static_cast<int>(std::lround(std::log(size_mm(lag)) / std::log(kLagStep)));
      auto& trail = trails_[{slack.what.axis, slack.what.size_mm, step, lag_first}];
      if (!trail)
        trail = std::make_shared<const Trail>(
            make_(slack.what.axis, slack.what.size_mm, std::pow(kLagStep, step), lag_first));
      all.emplace_back([trail, half = slack.coefficient](const CutState& s) {
        const Drift side = (*trail)(s);
        return CutChange{-half * side.at, 0.0, -half * side.per_mm};
      });
    }
  return all;
}

}  // namespace maquette::diagnosis::detail
