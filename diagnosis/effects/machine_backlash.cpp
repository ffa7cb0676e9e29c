// SPDX-License-Identifier: GPL-3.0-or-later

// Lost motion b: the table follows only after the slack is taken up, so it trails by b / 2 on the
// side it comes from. The state of each axis is followed through the whole program (play operator),
// rapids included. 5 to 70 um. Neighbouring passes of a zigzag are off to opposite sides; where
// that is more than the ridge between them the lower pass makes all of the surface, so each width
// has a form of its own (displaced_mm).
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_machine_backlash(std::vector<Effect>& all) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::string a = kAxisName[axis];
    Effect e;
    e.name = "machine.backlash_" + a;
    e.says =
        "lost motion of the " + a + " axis: the part depends on the side it was approached from";
    e.source = "ISO 230-2, reversal value; 5 to 70 um";
    e.acts_on = "machine";
    e.depends_on = "direction of motion along " + a + ", slope along " + a;
    e.unknown_shift = a;
    e.looks_like = {"machine.servo_lag", "tool.deflection"};
    e.separate_by = "one-way passes on a test strip";
    e.correction = "backlash compensation of the " + a + " axis, or one-way passes";
    e.needs = Needs::path;
    e.forms = [axis, a](const Scene& scene) {
      std::vector<Form> forms;
      for (std::size_t k = 0; k < kPlayWidths_mm.size(); ++k)
        forms.push_back(
            {fmt::format("play of about {} mm", kPlayWidths_mm[k]),
             {cut_column(fmt::format("backlash_{}{}", a, k), {"width_mm", 2.0, 1.0},
                         0.5 * kPlayWidths_mm[k], scene.ball_radius_mm,
                         [=](const Observation&, const CutState& s, Vec3) {
                           return CutChange{along_axis(axis, -component(s.play[k], axis)), 0.0};
                         })},
             {},
             1});
      return forms;
    };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
