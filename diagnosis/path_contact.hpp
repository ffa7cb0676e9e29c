// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_contact.hpp
/// Which place of the program made a point of the surface, and what the machine was doing then.
///
/// Takes   programs (G-code), the ball's radius
/// Gives   at (x, y): height of the cut surface, the tip that made it, time, direction, play
///
/// Method. The surface of a ball swept along the path is the least underside over all cutting
/// moves; the one that is least made the point. Moves are lines (arcs as chords within 2 um), with
/// the underside in closed form (cnc/swept_cutter.hpp); squares of the plan hold their moves and
/// their lowest tip, so that those too high are passed over.
/// The normal is that of the ball, so displacing the tip by d moves the surface by normal . d to
/// first order (envelope theorem), also where two passes meet.
///
/// Time is length over feed; rapids take 10 m/min. Accelerations are left out.
/// Cost: 200 bytes a move, a trail 9 to 12 more; about 1 us a point at 0.5 mm between passes and a
/// 6 mm ball.

#include <filesystem>
#include <memory>
#include <optional>
#include <span>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "diagnosis/observation.hpp"

namespace maquette::diagnosis {

struct Contact : CutState {
  double height_mm = 0.0;
  Vec3 normal;
};

class CutPath {
 public:
  /// @return the path, or an error of the G-code reader
  [[nodiscard]] static Result<CutPath> read(std::span<const std::filesystem::path> programs,
                                            double ball_radius_mm, const RunContext& run);
  /// none: no cutting move within a radius.
  /// @param rivals  unless null: the other passes that come within kRivalHeight_mm of the surface
  ///   there, of nearly the same time within 0.2 mm, lowest first, at most kMostRivals
  [[nodiscard]] std::optional<Contact> at(double x_mm, double y_mm,
                                          std::vector<Rival>* rivals = nullptr) const;
  /// The nearest place of the program in plan; none: no cutting move within a radius.
  [[nodiscard]] std::optional<CutState> above(double x_mm, double y_mm) const;
  /// Of the cut surface alone, in half the time.
  [[nodiscard]] std::optional<double> height(double x_mm, double y_mm) const;
  /// The passes of these programs, for observations.
  [[nodiscard]] std::shared_ptr<const Pass> pass() const;
  /// Scene::slack of these programs: play operators of that width, followed through rapids too.
  [[nodiscard]] Trail slack(double width_mm) const;
  /// Scene::lag of these programs: p' = (c - p) / e in way at the feed that most of the cut has,
  /// compared at the same place.
  [[nodiscard]] Trail lag(double lag_mm) const;
  /// Scene::slack_with_lag of these programs.
  [[nodiscard]] Trail slack_with_lag(int axis, double width_mm, double lag_mm,
                                     bool lag_first) const;
  [[nodiscard]] double ball_radius_mm() const;
  [[nodiscard]] double duration_min() const;
  [[nodiscard]] double cut_mm() const;  ///< CutState::path_mm at its end
  /// Shares of the time at which a new tool, program or band begins; the first is left out. Bands
  /// are begun after lifts, where these are few or go elsewhere.
  [[nodiscard]] std::vector<double> section_starts() const;

 private:
  struct Moves;
  struct SlackTable;
  struct Walk;
  explicit CutPath(std::shared_ptr<const Moves> moves);
  std::shared_ptr<const Moves> moves_;  ///< trails keep it
};

}  // namespace maquette::diagnosis
