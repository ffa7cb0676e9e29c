// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// A bending cutter that is drawn behind the feed. In a zigzag that is lost motion of the feed's
// axis but for the way on which it is taken up, so no such law is among those that are chosen: it
// is tried in the place of a bending cutter, beside the others and without each of them.

#include <vector>

#include "diagnosis/effect.hpp"

namespace maquette::diagnosis::detail {

/// Laws of tool.deflection beside those that it is chosen by. Columns: away from the wall, of that
/// up against down and left against right of the feed, behind the feed, and up against down.
[[nodiscard]] std::vector<Form> drawn_behind(const Scene& scene);
[[nodiscard]] bool is_drawn_behind(const Form& form);

}  // namespace maquette::diagnosis::detail
