// SPDX-License-Identifier: GPL-3.0-or-later

// The cutter bends away from the wall it cuts, sideways only: n . d = (F / k)(n_x^2 + n_y^2). The
// force differs going up or down a ramp, feed_z, and with the wall on the left or on the right of
// the feed, (feed x n)_z, climb or conventional: two passes of a zigzag do not bend alike. A force
// that depends on the ramp alone is n . feed_z.
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
    // Tips that bend away from the wall by share(o, n) of the coefficient.
    const auto bent = [&](const char* name, const char* parameter, double size, auto share) {
      return cut_column(fmt::format("deflect_{}{}", name, size), {parameter, 1.0, 1.0}, size,
                        scene.ball_radius_mm,
                        [share](const Observation& o, const CutState& s, Vec3) {
                          const Vec3 n = o.slope_normal;
                          return CutChange{share(s.feed, n) * Vec3{n.x, n.y, 0.0}, 0.0};
                        });
    };
    for (const double size : {0.03, 0.1, 0.3}) {
      Form f{fmt::format("away from the wall, about {} mm", size),
             {bent("side", "sideways_mm", size, [](Vec3, Vec3) { return 1.0; })}};
      f.sign = 1;
      forms.push_back(f);
      f.law = fmt::format("away from the wall by ramp and side, about {} mm", size);
      f.columns.push_back(bent("up", "sideways_up_against_down_mm", 0.3 * size,
                               [](Vec3 feed, Vec3) { return feed.z; }));
      f.columns.push_back(bent("climb", "sideways_left_against_right_mm", 0.3 * size,
                               [](Vec3 feed, Vec3 n) { return feed.x * n.y - feed.y * n.x; }));
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
