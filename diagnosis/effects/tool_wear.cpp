// SPDX-License-Identifier: GPL-3.0-or-later

// The ball loses w over the program as a power of the length cut: evenly, fast at first, or late.
// What is worn from all sides leaves the surface higher by w along the normal; after wear the tip
// is still where the control thinks it is if lengths are measured again: w (1 - n_z). 10 to 100 um.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr double kSize_mm = 0.05;  // at which other passes are let in
}

void add_tool_wear(std::vector<Effect>& all) {
  Effect e;
  e.name = "tool.wear";
  e.says = "the cutter wore off during the program";
  e.source = "radius falling with the length cut; 10 to 100 um";
  e.acts_on = "cutter";
  e.depends_on = "length cut so far, slope";
  e.unknown_shift = std::string("z");
  e.looks_like = {"machine.thermal_growth_z", "tool.radius_error", "coating.thickness"};
  e.separate_by = "cut the first strip again with a new cutter";
  e.correction = "change the cutter earlier";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    struct Make {
      bool tip_held;
      double radius_mm;
      Form operator()(double power, double step) const {
        const std::string how = power == 1.0   ? "even"
                                : power == 0.5 ? "fast at first"
                                : power == 2.0 ? "late"
                                               : fmt::format("as the length to the {:.3g}", power);
        Form f{fmt::format("{}, {}", how, tip_held ? "tip held" : "all round"),
               {cut_column(fmt::format("wear{:.4f}{}", power, tip_held),
                           {"radius_loss_mm", 1.0, 1.0}, kSize_mm, radius_mm,
                           [power, held = tip_held](const Observation&, const CutState& s, Vec3) {
                             const double loss = std::pow(s.cut_share, power);
                             return CutChange{{0.0, 0.0, held ? 0.0 : loss}, -loss};
                           })},
               {},
               1};
        f.fixed = {{"exponent", power}, {"tip_held", tip_held ? 1.0 : 0.0}};
        f.finer = finer_by_ratio(*this, power, step, 4, 1.1);
        // A wear that is told from others by little is not told how it went on, and what it came to
        // hangs on that: even wear of 0.3 mm was 0.19 +- 0.01 mm, fast at first.
        f.alternatives = [make = *this] {
          std::vector<Form> others;
          for (int k = -2; k <= 2; ++k) others.push_back(make(std::exp2(0.5 * k), 1.0));
          return others;
        };
        return f;
      }
    };
    std::vector<Form> forms;
    for (const double power : {1.0, 0.5, 2.0})
      for (const bool tip_held : {true, false})
        forms.push_back(Make{tip_held, scene.ball_radius_mm}(power, 2.0));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
