// SPDX-License-Identifier: GPL-3.0-or-later

// The ball is larger than said by dR, its tip touched off right: the surface moves by dR (n_z - 1)
// along its normal, nothing on flats. Up to a shift in z this is a coat of -dR. 10 to 100 um.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_tool_radius_error(std::vector<Effect>& all) {
  Effect e;
  e.name = "tool.radius_error";
  e.says = "the cutter's radius is not the one programmed";
  e.source = "offset of the ball's envelope; 10 to 100 um";
  e.acts_on = "cutter";
  e.depends_on = "slope, whatever its direction";
  e.unknown_shift = std::string("z");
  e.looks_like = {"coating.thickness", "tool.runout", "scanner.incidence_bias", "tool.wear"};
  e.separate_by = "measure the cutter; or scan before the coat";
  e.signature_error = 0.04;
  e.correction = "program with the measured radius";
  e.forms = [](const Scene& scene) {
    const BallForm make{
        "", ", tip held", "radius", {"error_mm", 1.0, 1.0}, scene.ball_radius_mm, {{}, 1.0}};
    std::vector<Form> forms;
    for (const double size : kBallSizes_mm) forms.push_back(make(size));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
