// SPDX-License-Identifier: GPL-3.0-or-later

// The pose of one scan is wrong. Always a nuisance; a cause only where one pose stands out
// (poses.hpp).
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_scanner_registration(std::vector<Effect>& all) {
  Effect e;
  e.name = "scanner.registration";
  e.says = "a scan is not where its file says";
  e.source = "targets and fit; 0.003 to 0.03 mm where all goes well";
  e.acts_on = "scanner";
  e.depends_on = "a shift and a turn of a whole scan";
  e.looks_like = {"tool.length_offset", "scanner.range_bias", "machine.squareness_xz"};
  e.separate_by = "register again on targets";
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
