// SPDX-License-Identifier: GPL-3.0-or-later

// The ball loses w over the program as a power of the length cut: evenly, fast at first, or late;
// or evenly once the new edge is broken in (the wear curve of Taylor's tests; ISO 8688-2).
// What is worn from all sides leaves the surface higher by w along the normal; after wear the tip
// is still where the control thinks it is if lengths are measured again: w (1 - n_z). 10 to 100 um.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr double kSize_mm = 0.05;  // at which other passes are let in

/// A column of wear.
struct Loss {
  bool tip_held;
  double radius_mm;
  /// @param of  share of the loss, by that of the length cut
  template <class Share>
  Column operator()(std::string key, const char* name, Share of) const {
    return cut_column(key + (tip_held ? "1" : "0"), {name, 1.0, 1.0}, kSize_mm, radius_mm,
                      [of, held = tip_held](const Observation&, const CutState& s, Vec3) {
                        const double loss = of(s.cut_share);
                        return CutChange{{0.0, 0.0, held ? 0.0 : loss}, -loss};
                      });
  }
  [[nodiscard]] const char* where() const { return tip_held ? "tip held" : "all round"; }
};

struct ByPower {
  Loss lost;
  Form operator()(double power, double step) const {
    const std::string how = power == 1.0   ? "even"
                            : power == 0.5 ? "fast at first"
                            : power == 2.0 ? "late"
                                           : fmt::format("as the length to the {:.3g}", power);
    Form f{fmt::format("{}, {}", how, lost.where()),
           {lost(fmt::format("wear{:.4f}", power), "radius_loss_mm",
                 [power](double share) { return std::pow(share, power); })},
           {},
           1};
    f.fixed = {{"exponent", power}, {"tip_held", lost.tip_held ? 1.0 : 0.0}};
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

struct BrokenIn {
  Loss lost;
  Form operator()(double break_in, double step) const {
    Form f{
        fmt::format("even after a break-in of {:.3g} of the program, {}", break_in, lost.where()),
        {lost("wear1.0000", "radius_loss_mm", [](double share) { return share; }),
         lost(fmt::format("break_in{:.4f}", break_in), "of_it_in_break_in_mm",
              [break_in](double share) {
                return std::expm1(-share / break_in) / std::expm1(-1.0 / break_in) - share;
              })},
        {},
        1,
        2};
    f.fixed = {{"break_in_share", break_in}, {"tip_held", lost.tip_held ? 1.0 : 0.0}};
    f.finer = finer_by_ratio(*this, break_in, step, 4, 1.2);
    return f;
  }
};
}  // namespace

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
    std::vector<Form> forms;
    for (const bool tip_held : {true, false}) {
      const Loss lost{tip_held, scene.ball_radius_mm};
      for (const double power : {1.0, 0.5, 2.0}) forms.push_back(ByPower{lost}(power, 2.0));
      forms.push_back(BrokenIn{lost}(0.08, 2.0));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
