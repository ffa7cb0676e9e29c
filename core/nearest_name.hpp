// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file nearest_name.hpp
/// What a mistyped name was meant to be, for messages.

#include <string>
#include <string_view>
#include <vector>

namespace maquette {

/// The candidate closest to `word` by edit distance, or "" if none is close.
[[nodiscard]] std::string nearest_name(std::string_view word,
                                       const std::vector<std::string>& candidates);

}  // namespace maquette
