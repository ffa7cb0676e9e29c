// SPDX-License-Identifier: GPL-3.0-or-later

// Servos of equal gain trail by e = v / Kv along the path. Along a line that is only late; in a
// bend the tip runs inside by e^2 / 2 times the curvature: peaks low, pits high, along the feed
// only. The path is filtered by p' = (c - p) / e and compared at the same place. e up to 1 mm. An
// axis of heights with a gain of its own is ahead of the others or behind: passes that climb are
// high, and those back are low.
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/lag_and_slack.hpp"

namespace maquette::diagnosis::detail {
namespace {

struct Make {
  double radius_mm;
  std::function<Trail(double)> lag;
  bool apart;             ///< heights have another lag
  double ahead_mm = 0.0;  ///< of which the second signature is made; 0: to first order
  /// `step`: ratio to the next such lag.
  Form operator()(double lag_mm, double step) const {
    // The coefficient is e^2 / 2 over that of the grid; reported as is.
    const Trail trail = lag(lag_mm);
    Form f{fmt::format("lag of about {:.3g} mm{}", lag_mm, apart ? ", heights of their own" : ""),
           {cut_column(fmt::format("lag{:.5f}", lag_mm),
                       {"half_square_lag_mm2", 0.5 * lag_mm * lag_mm, 10.0}, 1.0, radius_mm,
                       [trail](const Observation&, const CutState& s, Vec3) {
                         return CutChange{trail(s).at, 0.0};
                       })},
           {{kFollowedLag, lag_mm}},
           1};
    // The bent pass itself, wherever causes are cut together: a ball of 3 mm in a pit meets it
    // elsewhere than the straight command, 3 % of all that a lag of 1.8 mm does. Too dear to search
    // by.
    f.columns[0].cut = [trail](const Observation&, const CutState& s, Vec3) {
      CutChange c{trail(s).at, 0.0};
      c.bends = true;
      return c;
    };
    f.columns[0].by_program = true;
    if (apart) {
      const auto climbs = [trail](const CutState& s) {
        // As the tip climbs, not as its command does: that has corners.
        return Vec3{0, 0, s.feed.z + trail(s).per_mm.z};
      };
      f.columns.push_back(timed_column(fmt::format("lag_of_heights{:.5f}", lag_mm),
                                       {"heights_ahead_mm", 1.0, 5.0}, ahead_mm, radius_mm,
                                       climbs));
    }
    f.columns[0].follows = {true, 0, lag_mm};
    // What a lag does grows more slowly than its square, for bends are shorter: a size that is not
    // its form's is off.
    f.of_size = f.at_size = [make = *this](double size_mm) { return make(size_mm, 1.0); };
    f.finer = finer_by_ratio(*this, lag_mm, step, 3, 1.03);
    return f;
  }
};

}  // namespace

Form heights_ahead(const Scene& scene, double lag_mm, double ahead_mm) {
  return Make{scene.ball_radius_mm, scene.lag, true, ahead_mm}(lag_mm, 1.0);
}

void add_machine_servo_lag(std::vector<Effect>& all) {
  Effect e;
  e.name = "machine.servo_lag";
  e.says = "the machine cuts corners of the path: it trails the command";
  e.source = "following error v / Kv; Altintas, Manufacturing Automation, 2012, ch. 5";
  e.acts_on = "machine";
  e.depends_on = "curvature along the feed, square of the feed";
  e.looks_like = {"scanner.spot_blur", "coating.pooling", "tool.radius_error"};
  e.separate_by = "a patch at half the feed";
  e.signature_error = 0.04;
  e.correction = "lower feed, higher gain, or feed forward";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    for (const bool apart : {false, true})
      for (const double lag_mm : {0.3, 0.6, 1.0, 1.4, 1.9, 2.6})
        forms.push_back(Make{scene.ball_radius_mm, scene.lag, apart, 0.0}(lag_mm, 1.5));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
