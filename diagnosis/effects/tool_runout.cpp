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
  e.forms = [](const Scene& scene) {
    // The body swept by a ball that runs out is that of balls moved towards the place.
    const double radius = scene.ball_radius_mm;
    std::vector<Form> forms;
    for (const double size : {0.01, 0.05, 0.12}) {
      Form f{fmt::format("eccentric by about {} mm", size),
             {cut_column(fmt::format("runout{}", size), {"eccentricity_mm", 1.0, 0.5}, size, radius,
                         [=](const Observation&, const CutState&, Vec3 n) {
                           const double h = std::hypot(n.x, n.y);
                           // Closer to its middle than it runs out the ball is flat.
                           const double share = -std::fmin(1.0, radius * h / size);
                           return h > 0.0 ? CutChange{{share * n.x / h, share * n.y / h, 0.0}, 0.0}
                                          : CutChange{};
                         })}};
      f.sign = 1;
      forms.push_back(std::move(f));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
