// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stroke_letters.hpp
/// Letters as strokes, for pictures that must not depend on installed fonts and for engraving.

#include <array>
#include <string>
#include <vector>

namespace maquette {

/// Capitals are 12 high, small letters 8, the base line is at 0.
struct StrokeLetter {
  std::vector<std::vector<std::array<double, 2>>> strokes;
  double advance = 8.0;
};
inline constexpr double kCapitalHeight = 12.0;

/// Of UTF-8 text; what is not known is drawn as '?'.
[[nodiscard]] std::vector<StrokeLetter> stroke_letters(const std::string& utf8);
/// The signs of the text that are not known, each once, as UTF-8; bytes that are none as "?".
[[nodiscard]] std::string unknown_letters(const std::string& utf8);

}  // namespace maquette
