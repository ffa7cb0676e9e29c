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
/// Of the first, those that vary slowly over the part.
const std::vector<std::string>& smooth_ones();

struct Truth {
  std::vector<std::string> effects;
  std::vector<double> sizes;  ///< of each effect, mm or a ratio
  std::string summary;        ///< sizes, for the log
};

struct Options {
  std::uint64_t seed = 1;
  std::vector<std::string> effects;
  double size = 1.0;          ///< of all effects, over what is usual
  std::vector<double> sizes;  ///< of each effect, besides; empty: 1
  double noise = 1.0;         ///< of ranges, coat and block, over what is usual
  int points = 300'000;       ///< of each scan
  /// Smooth random part of the block in the place of the drawn one, and no rough coat; below 0: as
  /// drawn.
  double wavy_mm = -1.0, wavy_length_mm = 100.0;
};

/// design.tif, part.ngc, scan_a.ply, scan_b.ply, case.toml in `folder`.
Truth make_case(const Options& options, const std::filesystem::path& folder);

/// How often each effect of a case exceeds its detection limit there.
///
/// The case is simulated without noise, with each effect alone and with none; what the effect moves
/// is weighed by the noise that the case will have, known here as nobody else knows it (range
/// noise, roughness, smooth random part, by their spectra), poses of the scans and the other
/// effects' signatures taken out: amplitude over standard deviation of the amplitude, the matched
/// filter. The limit is `kLimitSigma` of these, and no less than `kLimitRms_mm` of what is moved.
struct Shown {
  double over = 0.0;    ///< limits
  double rms_mm = 0.0;  ///< of what it moves along the normal that neither poses nor others take
};
std::vector<Shown> over_limit(const Options& options);

/// A cause whose coefficient is ten standard deviations of all data is 5.8 of a third of them:
/// chosen (price 20: 4.5) and confirmed (3.5) with 90 % (1.3).
inline constexpr double kLimitSigma = 10.0;
/// Below this the simulation is not believed, says the program.
inline constexpr double kLimitRms_mm = 0.0025;

}  // namespace challenge
