// SPDX-License-Identifier: GPL-3.0-or-later

// From one moment on the axis stands c away from where the control believes it: lost steps, a
// slipped coupling, a moved clamp. What has slipped once may slip again.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_machine_step_loss(std::vector<Effect>& all) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::string a = kAxisName[axis];
    Effect e;
    e.name = "machine.step_loss_" + a;
    e.says = "from one moment on the " + a + " axis was off by a constant";
    e.source = "open-loop stepper drives; one or more full steps";
    e.acts_on = "machine";
    e.depends_on = "before or after one or two moments of the program";
    e.unknown_shift = a;
    e.looks_like = axis == 2
                       ? std::vector<std::string>{"process.band_step", "machine.thermal_growth_z"}
                       : std::vector<std::string>{"machine.scale_" + a, "machine.backlash_" + a};
    if (axis == 2) e.never_beside = "process.band_step";
    e.separate_by = "touch off again and compare with the datum";
    e.signature_error = 0.03;
    e.correction = "lower acceleration; mill again what came after the moment";
    e.needs = Needs::path;
    e.forms = [axis](const Scene& scene) { return step_forms(axis, scene, kMostLosses); };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
