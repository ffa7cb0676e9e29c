// SPDX-License-Identifier: GPL-3.0-or-later

// A ball that runs out by e sweeps a body e wider in plan: slopes move by -e sqrt(1 - n_z^2).
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_tool_runout(std::vector<Effect>& all) {
  Effect e;
  e.name = "tool.runout";
  e.says = "the cutter runs out of true and cuts wider than its diameter";
  e.source = "envelope of an eccentric ball; 5 to 20 um";
  e.acts_on = "cutter";
  e.depends_on = "slope";
  e.unknown_shift = std::string("z");
  e.looks_like = {"tool.radius_error", "tool.deflection"};
  e.separate_by = "dial gauge on the cutter; marks at one tooth per turn under a microscope";
  e.correction = "clean or change the collet";
  e.forms = [](const Scene&) {
    std::vector<Form> forms;
    for (const double size : {0.01, 0.05}) {
      Form f{fmt::format("eccentric by about {} mm", size),
             {column(fmt::format("runout{}", size), {"eccentricity_mm", 1.0, 0.5},
                     [size](const Observation& o) {
                       if (!o.on_surface) return 0.0;
                       return recut_mm(o,
                                       [size](const CutState&, Vec3 n) {
                                         return -size * std::hypot(n.x, n.y) / n.z;
                                       }) /
                              size;
                     })}};
      f.sign = 1;
      forms.push_back(std::move(f));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
