// SPDX-License-Identifier: GPL-3.0-or-later

// Pitch of a screw or scale of an encoder: what is called 1 mm is 1 + k mm. d = k (tip - centre)
// along the axis; the centre is free, since a shift is registration. 20 to 100 um/m on screws.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_machine_scale(std::vector<Effect>& all) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::string a = kAxisName[axis];
    Effect e;
    e.name = "machine.scale_" + a;
    e.says = "the " + a + " axis travels too far or too short in proportion to the distance";
    e.source = "screw pitch and temperature, ISO 230-2; 20 to 100 um/m";
    e.acts_on = "machine";
    e.depends_on = "position along " + a;
    e.unknown_shift = a;
    e.looks_like = {"stock.swelling", "scanner.range_scale"};
    e.separate_by = "a gauge bar in the scene, or the distance of two milled marks by calliper";
    e.signature_error = 0.03;
    e.correction = "scale " + a + " in the control or in the program";
    e.forms = [axis, a](const Scene& scene) {
      const double half = scene.half_mm(), c = component(scene.centre(), axis);
      return std::vector<Form>{{"proportional",
                                {tip_column("scale_" + a, {"error_um_per_m", 1e6 / half, 100'000.0},
                                            [=](const CutState& s) {
                                              return along_axis(
                                                  axis, (component(s.tip, axis) - c) / half);
                                            })}}};
    };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
