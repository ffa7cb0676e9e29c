// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file machine_run.hpp
/// Where a machine with known errors takes the tip, seen from the part: the way back of
/// compensate.hpp, so that a rewritten program can be certified for the machine it is written for.
///
/// Takes   motions as a program calls them, the errors of machine, tool and set-up
/// Gives   lines of the tip in the part's frame
///
/// Called to p, an axis with play w stands at a place that follows within w / 2 (the play operator;
/// M. A. Krasnosel'skii, A. V. Pokrovskii, "Systems with Hysteresis", 1989): it rests while the
/// slack is taken up. There the tip is displaced by MachineErrors::at(), and the part stands as
/// machine_from_part says. Lines end where slack ends and at the stops of straightness tables, and
/// are exact between them; arcs are followed by chords within kRunChord_mm. An axis that has not
/// moved yet has its slack taken up by its first move. The cutter's own radius is the caller's.
/// Cost: some 0.1 us a line.

#include <vector>

#include "cnc/compensate.hpp"
#include "cnc/gcode_reader.hpp"

namespace maquette::cnc {

inline constexpr double kRunChord_mm = 0.0002;

class MachineRun {
 public:
  /// @param tools  their corners, for parts that stand tilted; empty: balls of `ball_radius_mm`
  MachineRun(MachineErrors errors, std::vector<Tool> tools, double ball_radius_mm);

  /// Appends what the machine makes of it; nothing where the tip rests.
  void add(const Motion& called, std::vector<Motion>& made);
  /// Largest change of a coordinate so far.
  [[nodiscard]] double largest_mm() const { return largest_mm_; }

 private:
  void line(Vec3 from, Vec3 to, const Motion& called, std::vector<Motion>& made);
  [[nodiscard]] Vec3 tip(Vec3 called_mm, int tool) const;

  MachineErrors errors_;
  RigidTransform part_from_machine_;
  std::vector<Tool> tools_;
  double ball_radius_mm_;
  double behind_mm_[3] = {0.0, 0.0, 0.0};  ///< the axis stands that much beside where it is called
  bool moved_[3] = {false, false, false};
  double largest_mm_ = 0.0;
};

}  // namespace maquette::cnc
