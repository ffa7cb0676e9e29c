// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file match_unknowns.hpp
/// Which number of a step is what of a MatchState.

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "camera/match_photographs.hpp"

namespace maquette::camera::detail {

/// Of what one photograph depends on, in this order: exposure, red, blue, lamp x, y, z, brightness,
/// pose (mm right, up, back; rad about those).
inline constexpr Eigen::Index kOwn = 13;
enum Own : Eigen::Index {
  kExposure = 0,
  kRed = 1,
  kBlue = 2,
  kLamp = 3,
  kBrightness = 6,
  kPose = 7
};

class Unknowns {
 public:
  Unknowns(const MatchSearch& search, std::size_t photos);

  [[nodiscard]] Eigen::Index count() const { return count_; }
  /// Where number `own` of a photograph stands in a step; nothing: it is not searched.
  [[nodiscard]] std::optional<Eigen::Index> place(std::size_t photo, Eigen::Index own) const {
    const Eigen::Index at = places_[photo][static_cast<std::size_t>(own)];
    return at < 0 ? std::nullopt : std::optional(at);
  }
  [[nodiscard]] const MatchSearch& search() const { return search_; }

  /// Factors by their logarithms.
  [[nodiscard]] MatchState moved(MatchState state, const Eigen::VectorXd& step) const;
  /// Names, starts and values; sigma by the covariance of a step's numbers, which becomes that of
  /// what is named.
  [[nodiscard]] std::vector<MatchedNumber> numbers(const MatchState& start, const MatchState& now,
                                                   const std::vector<MatchPhoto>& photos,
                                                   Eigen::MatrixXd& covariance) const;
  [[nodiscard]] std::vector<std::string> names(const std::vector<MatchPhoto>& photos) const;

 private:
  MatchSearch search_;
  std::vector<std::array<Eigen::Index, kOwn>> places_;
  Eigen::Index count_ = 0;
};

}  // namespace maquette::camera::detail
