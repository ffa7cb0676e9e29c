// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What the stones show once ground and poses are settled: each stone's ranges against those of its
// mesh (scan/find_stones.hpp).
//
// Seats     go where the causes of the machine have moved them; what the coat does at a stone (was
//           it there before the stones or after?) is not known: a common height of all stones and a
//           film on them are no finding where there is a coat, declared or found.
// Size      of all stones together, their poses free: by a share (shrinkage) or by a length (the
//           process, a film), whichever fits better, at the level of one claim. The plan is brought
//           to that size, standing on its lowest point or about its origin as the heights have it.
// Poses     each by a score test at the level that all stones share.
// Gain      fitted to every second patch of a millimetre, measured on the others.

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// Adds stone.missing, stone.shrink, stone.pose to the causes and `stones` to the diagnosis; says
/// in the notes what stands there that none of them explains. Nothing where the case has no stones.
/// @pre poses, noise, causes and remainder are those of the ground
/// @return SCAN_EMBREE_FAILED
[[nodiscard]] Result<void> add_stone_causes(const Measurements& measurements, Diagnosis& diagnosis,
                                            const RunContext& run);

/// Brings causes that are known (extended.toml) into the plan.
/// @return DIAGNOSIS_UNKNOWN_CAUSE for a stone that the plan has not
[[nodiscard]] Result<void> apply_known(const std::vector<KnownCause>& known, StonePlan& plan);

/// Seats go where known causes of the machine have moved the tip that made them.
[[nodiscard]] Result<void> shift_seats(const std::vector<KnownCause>& known,
                                       const Measurements& measurements, StonePlan& plan);

/// The same beams on simulated stones: the plan, with `causes` or without, at the poses of the
/// diagnosis, with its noise.
[[nodiscard]] Result<StonesSeen> simulated_stones(const Measurements& measurements,
                                                  const Diagnosis& diagnosis, bool causes,
                                                  std::uint64_t seed);

}  // namespace maquette::diagnosis::detail
