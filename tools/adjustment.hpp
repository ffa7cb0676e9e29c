// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file adjustment.hpp
/// What programs make good: errors of machine and tool (compensation.toml of diagnose), and where a
/// part or its axes really are (corrections.toml of deviate). docs/compensation.md describes both.
///
/// Signs. compensation.toml says what the machine does, so programs call the opposite.
/// corrections.toml says where a point of the design really is, in the frame of the datums, which
/// must be the machine's (reference spheres that it has probed, docs/spheres.md):
///  - `this` part still lies there: programs go to where it is, p -> A p;
///  - the `next` part will be displaced as this one was, by a zero or a stop that is off:
///    programs call p -> A^-1 p, so that A brings it back.
/// Its axes named "x", "y" and "z" are the machine's: scale and direction are what the machine
/// does. They are exact where the work offset was set, the model's origin. Other axes are no
/// business of a mill.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "cnc/compensate.hpp"
#include "core/result.hpp"

namespace maquette::tools {

struct Adjustment {
  cnc::MachineErrors errors;
  struct File {
    std::filesystem::path path;
    std::string sha256;
  };
  std::optional<File> compensation, corrections;
  bool next_part = false;
  std::vector<std::string> other_axes;  ///< of corrections.toml, left alone
};

/// As a person asks for it; empty paths: nothing.
struct AdjustmentFiles {
  std::filesystem::path compensation, corrections;
  std::string corrections_for = "this";  ///< or "next"
  [[nodiscard]] bool any() const { return !compensation.empty() || !corrections.empty(); }
  [[nodiscard]] std::vector<std::filesystem::path> files() const;
};
/// @return nothing without files; TOOLS_CONFIG_INVALID for axes that both files have, or a part
///         tilted by more than 3 degrees; errors of the files
[[nodiscard]] Result<std::optional<Adjustment>> read_adjustment(const AdjustmentFiles& files);

/// For the head of programs: one comment a file.
[[nodiscard]] std::vector<std::string> head_of(const Adjustment& adjustment);
[[nodiscard]] nlohmann::json json_of(const Adjustment& adjustment);

/// The program as it was meant, beside the one that is called: part.ngc -> part.meant.ngc.
[[nodiscard]] std::filesystem::path meant_of(const std::filesystem::path& program);
/// Of one part of a split one: part_2.ngc -> part.meant_2.ngc, if that is there, else as above.
[[nodiscard]] std::filesystem::path meant_of_part(const std::filesystem::path& program);

}  // namespace maquette::tools
