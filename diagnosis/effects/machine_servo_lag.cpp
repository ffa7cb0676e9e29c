// SPDX-License-Identifier: GPL-3.0-or-later

// Servos of equal gain trail by e = v / Kv along the path. Along a line that is only late; in a
// bend the tip runs inside by e^2 / 2 times the curvature: peaks low, pits high, along the feed
// only. The path is filtered by p' = (c - p) / e and compared at the same place. e up to 1 mm.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_machine_servo_lag(std::vector<Effect>& all) {
  Effect e;
  e.name = "machine.servo_lag";
  e.says = "the machine cuts corners of the path: it trails the command";
  e.source = "following error v / Kv; Altintas, Manufacturing Automation, 2012, ch. 5";
  e.acts_on = "machine";
  e.depends_on = "curvature along the feed, square of the feed";
  e.looks_like = {"scanner.spot_blur", "coating.pooling", "tool.radius_error"};
  e.separate_by = "a patch at half the feed";
  e.correction = "lower feed, higher gain, or feed forward";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    for (std::size_t k = 0; k < kLagLengths_mm.size(); ++k) {
      const double scale = 0.5 * kLagLengths_mm[k] * kLagLengths_mm[k];
      // The coefficient is e^2 / 2 over that of the grid; reported as is.
      Form f{fmt::format("lag of about {} mm", kLagLengths_mm[k]),
             {cut_column(fmt::format("lag{}", k), {"half_square_lag_mm2", scale, 10.0}, 1.0,
                         scene.ball_radius_mm, [k](const Observation&, const CutState& s, Vec3) {
                           return CutChange{s.lag[k], 0.0};
                         })}};
      f.sign = 1;
      forms.push_back(std::move(f));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
