// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photo_run.hpp
/// Hides effects in photographs, has them found, counts.
///   challenge --photo MAQUETTE [--null N] [--single N] [--double N] [--triple N] [--outside N]
///             [--full] [--seed S] [--from N] [--only I] [--effect NAME] [--size-factor X]
///             [--between bilinear|triangles|smooth] [--width PX] [--jobs N] [--keep FOLDER]
///             [--write-only] [--picture FILE] [--strict] [--all-right]
/// --full: 200 null, 440 single (20 of each effect), 200 double, 100 triple, 120 outside. A line a
/// case (how often the hidden effect exceeds its limit, sizes found and hidden, CPU seconds), then
/// the table. --single N takes the effects in turn; --effect: this one always. --size-factor: of
/// all effects, over what is usual. --between: what is between the nodes of the design. --width: of
/// the pictures, 4:3, the same view. --write-only: cases with their truth.json stay in --keep's
/// folder and nothing is diagnosed. The rest as for scans (challenge_main.cpp).

namespace challenge {

/// What an effect has to change, root mean square over lit pixels. Two ways to fill the design's
/// cells
/// (--between) differ by 0.5 to 1.0 there, without pattern: five limits are as much as that.
inline constexpr double kPhotoLimitRms_255 = 0.1;
/// As for scans: a third of the data has to choose, and another to confirm.
inline constexpr double kPhotoLimitSigma = 10.0;

/// @param argc, argv  what follows --photo
/// @return the program's exit code
int run_photos(int argc, char** argv);

}  // namespace challenge
