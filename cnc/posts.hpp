// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file posts.hpp
/// What differs from one machine control to the next, one row each.

#include <optional>
#include <string>
#include <string_view>

namespace maquette::cnc {

struct Post {
  std::string_view name;
  std::string_view preamble;  ///< modes, before the work offset
  bool blending;              ///< G64 P Q: leave the written path by at most P, never thin it
  std::string_view tool;      ///< tool change and length offset; empty: done by hand
};

[[nodiscard]] std::optional<Post> post_by_name(std::string_view name);
[[nodiscard]] std::string post_names();  ///< "linuxcnc, grbl"

}  // namespace maquette::cnc
