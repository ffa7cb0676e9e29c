// SPDX-License-Identifier: GPL-3.0-or-later

// All ranges too long by a: d = a along the beam. Over a small part that is a shift, so only
// the poses of several scans show it (poses.hpp).
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_scanner_range_bias(std::vector<Effect>& all) {
  Effect e;
  e.name = "scanner.range_bias";
  e.says = "all ranges are too long or too short by a constant";
  e.source = "zero offset of the instrument, Lichti and Licht 2006; up to mm";
  e.acts_on = "scanner";
  e.depends_on = "direction of view";
  e.looks_like = {"coating.thickness", "tool.length_offset", "scanner.registration"};
  e.separate_by = "a second station opposite";
  e.unknown_shift = std::string("r");  // what registration has taken of it
  e.signature_error = 0.02;
  e.needs = Needs::station;
  e.forms = [](const Scene& scene) {
    return of_instruments(scene, "constant", "range_bias", {"bias_mm", 1.0, 10.0},
                          [](const Observation& o) { return o.beam; });
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
