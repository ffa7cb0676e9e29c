// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file challenge_case.hpp
/// Cases whose truth is known, made with no code of cnc, scan, camera or diagnosis: own tool
/// paths, own cut, own scanner, own noise. Everything is drawn from the seed.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace challenge {

/// Effects that can be hidden, by the names of the library; and things without a name.
const std::vector<std::string>& hideable();
const std::vector<std::string>& nameless();

struct Truth {
  std::vector<std::string> effects;
  std::string summary;  ///< sizes, for the log
};

struct Options {
  std::uint64_t seed = 1;
  std::vector<std::string> effects;
  double size = 1.0;  ///< of all effects, over what is usual
  int points = 300'000;
};

/// design.tif, part.ngc, scan_a.ply, scan_b.ply, case.toml in `folder`.
Truth make_case(const Options& options, const std::filesystem::path& folder);

}  // namespace challenge
