// SPDX-License-Identifier: GPL-3.0-or-later

// All ranges too long by a share k: d = k range along the beam. About the station what swelling is
// about the centre; the difference is a shift. 10 to 50 ppm.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_scanner_range_scale(std::vector<Effect>& all) {
  Effect e;
  e.name = "scanner.range_scale";
  e.says = "ranges are too long or too short in proportion";
  e.source = "scale of the instrument's oscillator; 10 to 50 ppm";
  e.acts_on = "scanner";
  e.depends_on = "range";
  e.looks_like = {"stock.swelling"};
  e.separate_by = "a scale bar in the scene";
  e.signature_error = 0.02;
  e.unknown_shift = std::string("r");
  e.needs = Needs::station;
  e.forms = [](const Scene& scene) {
    const double half = scene.half_mm();
    return of_instruments(scene, "proportional", "range_scale",
                          {"error_um_per_m", 1e6 / half, 20'000.0},
                          [half](const Observation& o) { return (o.range_mm / half) * o.beam; });
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
