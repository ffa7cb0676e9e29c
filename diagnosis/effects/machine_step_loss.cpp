// SPDX-License-Identifier: GPL-3.0-or-later

// From one moment on the axis stands c away from where the control believes it: lost steps, a
// slipped coupling, a moved clamp.
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
    e.depends_on = "before or after a moment of the program";
    e.looks_like = axis == 2
                       ? std::vector<std::string>{"process.band_step", "machine.thermal_growth_z"}
                       : std::vector<std::string>{"machine.scale_" + a, "machine.backlash_" + a};
    e.separate_by = "touch off again and compare with the datum";
    e.correction = "lower acceleration; mill again what came after the moment";
    e.needs = Needs::path;
    e.forms = [axis, a](const Scene& scene) {
      struct Make {
        int axis;
        std::string a;
        double minutes;
        Form operator()(double share, double step) const {
          Form f{fmt::format("after {:.4f} of the program", share),
                 {column(fmt::format("steploss_{}{:.6f}", a, share), {"step_mm", 1.0, 5.0},
                         [axis = axis, share](const Observation& o) {
                           return o.path_share > share ? component(o.along, axis) : 0.0;
                         })}};
          f.fixed = {{"moment_min", share * minutes}};
          if (step > 1e-3)
            f.finer = [make = *this, share, step] {
              std::vector<Form> near;
              for (int k = -6; k <= 6; ++k)
                if (share + k * step / 7.0 > 0.0)
                  near.push_back(make(share + k * step / 7.0, step / 7.0));
              return near;
            };
          return f;
        }
      };
      std::vector<Form> forms;
      for (int k = 1; k < 16; ++k)
        forms.push_back(Make{axis, a, scene.duration_min}(k / 16.0, 1.0 / 16.0));
      return forms;
    };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
