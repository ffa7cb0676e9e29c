// SPDX-License-Identifier: GPL-3.0-or-later

// The spindle warms up and grows: the tip sinks by A (1 - exp(-t / tau)), from the start or from
// when it ran faster, cut deeper or without coolant. 25 to 40 um, 15 to 30 minutes; Z. Li et al.,
// CIRP Annals 58 (2009), doi:10.1016/j.cirp.2009.03.034 for the order of size.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr double kSize_mm = 0.05;
/// Along a border between passes of quite other times the later ones cut into the earlier: grown so
/// far, three passes over.
constexpr double kLarge_mm = 0.25;
// Time constants, of the program: shorter ones are over before the cut, longer ones a straight
// line.
constexpr double kQuickest = 0.02, kSlowest = 2.5;
constexpr double kNear = 0.003;  // of the program, between starts
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
      /// @param start     share of the program before it
      /// @param step, by  ratio and distance to the next such form
      Form operator()(double tau, double step, double start = 0.0, double by = 0.0) const {
        const std::string late = start > 0.0 ? fmt::format(" from {:.3g} on", start) : "";
        Form f{
            fmt::format("time constant {:.3g} of the program{}", tau, late),
            {timed_column(fmt::format("thermal{:.5f}at{:.5f}", tau, start), {"growth_mm", 1.0, 1.0},
                          size_mm, radius_mm, [tau, start](const CutState& s) {
                            const double since = std::fmax(0.0, s.path_share - start);
                            return along_axis(2, std::expm1(-since / tau));
                          })}};
        f.sign = sign_of(size_mm);
        if (size_mm != 0.0) {
          f.made_of_mm = size_mm;
          f.at_size = [make = *this, tau, step, start, by](double size) {
            Make other = make;
            other.size_mm = size;
            Form at = other(tau, step, start, by);
            Column& c = at.columns[0];
            c = tangent_column(c.key + " tangent", c.parameter, size, make.radius_mm,
                               std::move(c.cut));
            c.by_program = true;
            return at;
          };
        }
        f.fixed = {{"time_constant_min", tau * minutes}, {"start_min", start * minutes}};
        if (start == 0.0)
          f.finer = finer_by_ratio(*this, tau, step, 4, 1.01);
        else if (by > kNear)
          f.finer = [make = *this, tau, start, ratio = std::sqrt(step), by] {
            std::vector<Form> near;
            for (int later = -2; later <= 2; ++later)
              for (int slower = -2; slower <= 2; ++slower)
                if (start + later * by > 0.0)
                  near.push_back(
                      make(tau * std::pow(ratio, slower), ratio, start + later * by, 0.5 * by));
            return near;
          };
        // A later start is as good as a quicker warm-up: sizes over both.
        f.alternatives = [make = *this, tau, start] {
          std::vector<Form> others;
          for (const double later :
               start > 0.0 ? std::vector{-0.04, -0.02, 0.0, 0.02, 0.04} : std::vector{0.0})
            for (int k = -8; k <= 8; ++k)
              if (const double other = tau * std::pow(1.3, k);
                  other > kQuickest && other < kSlowest && start + later >= 0.0)
                others.push_back(make(other, 1.0, start + later));
          return others;
        };
        return f;
      }
    };
    std::vector<Form> forms;
    auto sizes = sizes_of_drifts(scene, kSize_mm);
    if (scene.passes_meet) sizes.push_back(kLarge_mm);
    for (const double size : sizes) {
      const Make make{scene.duration_min, size, scene.ball_radius_mm};
      for (const double tau : {0.03, 0.07, 0.15, 0.3, 0.6, 1.2}) forms.push_back(make(tau, 2.1));
      // A quick one that starts late is a step.
      for (const double start : {0.08, 0.22, 0.38})
        for (const double tau : {0.15, 0.3, 0.6}) forms.push_back(make(tau, 2.1, start, 0.04));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
