// SPDX-License-Identifier: GPL-3.0-or-later

// Length of the tool or datum of z wrong by c: d = c along z everywhere. Registration takes all of
// it; only the poses of the scans can show it (poses.hpp).
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_tool_length_offset(std::vector<Effect>& all) {
  Effect e;
  e.name = "tool.length_offset";
  e.says = "the tool length or the datum of z is off";
  e.source = "touch-off; 50 to 200 um";
  e.acts_on = "machine";
  e.depends_on = "nothing: a constant height";
  e.looks_like = {"coating.thickness", "scanner.registration", "scanner.range_bias"};
  e.separate_by = "datum pads beside the part, left uncoated";
  e.correction = "touch off again";
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
