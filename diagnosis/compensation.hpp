// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file compensation.hpp
/// What of a diagnosis the next program can make good, and what that would gain.
///
/// Takes   named causes
/// Gives   errors of machine and tool as cnc/compensate.hpp maps programs by; the improvement, by
///         cutting the rewritten program in simulation with all causes in the model
///
/// Scale, squareness, straightness, backlash, length and radius of the tool come back with every
/// part. Warm-up, lost steps, wear, chatter, stock and coat do not, or not the same: they are not
/// mapped. A cause that the data do not tell from others is not used either: the wrong cure would
/// harm.

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "cnc/compensate.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis {

struct Compensation {
  cnc::MachineErrors errors;
  std::vector<std::string> used;
  std::vector<std::pair<std::string, std::string>> left;  ///< cause, why not
};
[[nodiscard]] Compensation compensation_of(const Diagnosis& diagnosis, const Scene& scene);

/// compensation.toml, schema maquette.compensation/1; empty if nothing can be made good.
[[nodiscard]] std::string compensation_toml(const Diagnosis& diagnosis, const Scene& scene);

struct Improvement {
  double rms_before_mm = 0.0, rms_after_mm = 0.0;  ///< along the normal, registered
  double max_before_mm = 0.0, max_after_mm = 0.0;
  std::size_t nodes = 0;
};
/// The part as its programs were meant to cut it, and as built by `extended`: with its own
/// programs, and with the rewritten ones. At most 90 000 nodes; pose by least squares, as any part
/// is set up.
/// @return errors of ExtendedModel::make
[[nodiscard]] Result<Improvement> improvement(const CaseInput& extended,
                                              const std::vector<std::filesystem::path>& rewritten,
                                              const RunContext& run = {});

}  // namespace maquette::diagnosis
