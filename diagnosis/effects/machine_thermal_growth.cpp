// SPDX-License-Identifier: GPL-3.0-or-later

// The spindle warms up and grows: the tip sinks by A (1 - exp(-t / tau)). 25 to 40 um, 15 to 30
// minutes; Z. Li et al., CIRP Annals 58 (2009), doi:10.1016/j.cirp.2009.03.034 for the order of
// size.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr double kSize_mm = 0.05;
// Time constants, of the program: shorter ones are over before the cut, longer ones a straight
// line.
constexpr double kQuickest = 0.02, kSlowest = 2.5;
}  // namespace

void add_machine_thermal_growth(std::vector<Effect>& all) {
  Effect e;
  e.name = "machine.thermal_growth_z";
  e.says = "the spindle grew as it warmed up";
  e.source = "exponential warm-up; 25 to 40 um in 15 to 30 min";
  e.acts_on = "machine";
  e.depends_on = "time since the program's start";
  e.unknown_shift = std::string("z");
  e.looks_like = {"tool.wear", "machine.straightness_y", "stock.warp", "machine.step_loss_z"};
  e.separate_by = "cut the first strip again at the end";
  e.signature_error = 0.06;
  e.correction = "let the spindle run warm before the finish";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    struct Make {
      double minutes, size_mm, radius_mm;
      Form operator()(double tau, double step) const {
        Form f{fmt::format("time constant {:.3g} of the program", tau),
               {timed_column(fmt::format("thermal{:.5f}", tau), {"growth_mm", 1.0, 1.0}, size_mm,
                             radius_mm, [tau](const CutState& s) {
                               return along_axis(2, std::expm1(-s.path_share / tau));
                             })}};
        f.sign = sign_of(size_mm);
        f.fixed = {{"time_constant_min", tau * minutes}};
        f.finer = finer_by_ratio(*this, tau, step, 4, 1.01);
        f.alternatives = [make = *this, tau] {
          std::vector<Form> others;
          for (int k = -8; k <= 8; ++k)
            if (const double other = tau * std::pow(1.3, k); other > kQuickest && other < kSlowest)
              others.push_back(make(other, 1.0));
          return others;
        };
        return f;
      }
    };
    std::vector<Form> forms;
    for (const double size : sizes_of_drifts(scene, kSize_mm))
      for (const double tau : {0.03, 0.07, 0.15, 0.3, 0.6, 1.2})
        forms.push_back(Make{scene.duration_min, size, scene.ball_radius_mm}(tau, 2.1));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
