// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file post_text.hpp
/// A post's texts filled in, and whether a control can have the options. Used by program only.

#include <optional>
#include <string>
#include <string_view>

#include "cnc/posts.hpp"
#include "cnc/program.hpp"

namespace maquette::cnc {

/// What the words in braces are replaced by.
struct PostWords {
  std::string name, tolerance, safe;
  int number = 1, tool = 1;
  double rpm = 0.0;
};
[[nodiscard]] std::string filled(std::string_view text, const PostWords& words);

/// At most `places` decimals, no trailing zeros; `point`: also of whole numbers.
[[nodiscard]] std::string shortest(double value, int places, bool point);
/// Letters, digits, - and _; others become _.
[[nodiscard]] std::string plain_name(std::string_view name);
/// Of 54 .. 59 and 591 .. 593 into Post::offsets.
[[nodiscard]] std::optional<std::size_t> offset_index(int code);
[[nodiscard]] Result<void> check_options(const ProgramOptions& options);

}  // namespace maquette::cnc
