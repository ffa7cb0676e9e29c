// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What a lag and lost motion do together, beyond the sum of what each does alone.

#include <cmath>
#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "diagnosis/effect.hpp"

namespace maquette::diagnosis::detail {

/// Among the fixed values of a lost motion beside a lag: 1 where it is behind the drive that lags.
inline constexpr const char* kSlackBehindLag = "behind_the_lag";
/// What the form of a lag was made of.
inline constexpr const char* kFollowedLag = "followed_lag_mm";

/// Law of machine.servo_lag that is not among those it is chosen by: heights lag so much less that
/// passes of a zigzag lie above each other, which to first order they do not. Where it climbs that
/// is lost motion of the feed's axis; tried in the place of a lag and such lost motion.
[[nodiscard]] Form heights_ahead(const Scene& scene, double lag_mm, double ahead_mm);

/// A column of such a cause with its coefficient.
struct FollowedTerm {
  Follows what;
  double coefficient = 0.0;
};

/// The lag or width that a coefficient stands for: that of a lag is the square over its form's,
/// that of lost motion half the width. 0: none.
[[nodiscard]] inline double size_mm(const FollowedTerm& t) {
  const double c = std::fmax(0.0, t.coefficient);
  return t.what.lag ? t.what.size_mm * std::sqrt(c) : 2.0 * c;
}

/// Of one scene; trails are kept, for they cost a walk along the program each.
class LagAndSlack {
 public:
  explicit LagAndSlack(const Scene& scene) : make_(scene.slack_with_lag) {}
  /// Is the slack behind the drive that lags?
  bool lag_first = true;
  /// One for each pair of a lag and a lost motion among `terms`: what it changes of a pass.
  [[nodiscard]] std::vector<std::function<CutChange(const CutState&)>> changes(
      const std::vector<FollowedTerm>& terms);

 private:
  std::function<Trail(int, double, double, bool)> make_;
  std::map<std::tuple<int, double, int, bool>, std::shared_ptr<const Trail>> trails_;
};

}  // namespace maquette::diagnosis::detail
