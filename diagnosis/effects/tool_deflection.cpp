// SPDX-License-Identifier: GPL-3.0-or-later

// The cutter bends away from the wall it cuts, sideways only: n . d = (F / k)(n_x^2 + n_y^2). With
// a force that depends on going up or down, n_h . feed adds an asymmetry along the feed.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_tool_deflection(std::vector<Effect>& all) {
  Effect e;
  e.name = "tool.deflection";
  e.says = "the cutter bends away from what it cuts";
  e.source = "F / k of a slender cutter; 1 to 20 um in foam, more in wood";
  e.acts_on = "cutter";
  e.depends_on = "slope, engagement, up or down the slope";
  e.unknown_shift = std::string("z");
  e.looks_like = {"tool.radius_error", "machine.backlash_x", "tool.runout"};
  e.separate_by = "a spring pass over one patch";
  e.correction = "shorter tool, lower feed, or a spring pass";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    for (const double size : {0.03, 0.1, 0.3}) {
      Form f{fmt::format("away from the wall, about {} mm", size),
             {cut_column(fmt::format("deflect_side{}", size), {"sideways_mm", 1.0, 1.0}, size,
                         scene.ball_radius_mm, [](const Observation& o, const CutState&, Vec3) {
                           return CutChange{{o.slope_normal.x, o.slope_normal.y, 0.0}, 0.0};
                         })}};
      f.sign = 1;
      forms.push_back(std::move(f));
    }
    const auto ramp = column("deflect_ramp", {"ramp_mm", 1.0, 1.0}, [](const Observation& o) {
      return o.on_surface ? dot(o.along, o.normal) * o.feed.z : 0.0;
    });
    forms.push_back({"up against down", {ramp}});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
