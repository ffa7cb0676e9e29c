// SPDX-License-Identifier: GPL-3.0-or-later

// Lost motion b: the table follows only after the slack is taken up, so it trails by b / 2 on the
// side it comes from. The state of each axis is followed through the whole program (play operator),
// rapids included. 5 to 70 um. Neighbouring passes of a zigzag are off to opposite sides; where
// that is more than the ridge between them the lower pass makes all of the surface, so each width
// has a form of its own (displaced_mm). A control that compensates for more than there is leaves
// the table ahead by as much.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// A pass that slides further along itself is swept as it is: half the square of the way times its
/// curvature is what a lag does, and was taken for one (0.4 mm: 0.02 mm2).
constexpr double kLong_mm = 0.05;

struct Make {
  int axis;
  double radius_mm;
  std::function<Trail(double)> slack;
  bool ahead = false;
  /// Play of one width; `step`: ratio to the next such width.
  Form operator()(double width_mm, double step) const {
    Form f = form(width_mm, cut_column(key(width_mm), parameter(), width_mm / per_column(),
                                       radius_mm, change(width_mm)));
    f.finer = finer_by_ratio(*this, width_mm, step, 3, 1.03);
    return f;
  }

 private:
  /// Of a play columns are of half its width, as lags and it are followed together.
  [[nodiscard]] double per_column() const { return ahead ? 1.0 : 2.0; }
  [[nodiscard]] Parameter parameter() const { return {"width_mm", per_column(), 1.0}; }
  [[nodiscard]] std::string key(double width_mm) const {
    return fmt::format("backlash_{}{}{:.6f}", kAxisName[axis], ahead ? "_ahead" : "", width_mm);
  }
  [[nodiscard]] std::function<CutChange(const Observation&, const CutState&, Vec3)> change(
      double width_mm) const {
    return [axis = axis, width_mm, unit = ahead ? 0.5 : -1.0, at = slack(width_mm)](
               const Observation&, const CutState& s, Vec3) {
      const Drift off = at(s);
      return CutChange{along_axis(axis, unit * component(off.at, axis)), 0.0,
                       along_axis(axis, unit * component(off.per_mm, axis)),
                       off.bends[static_cast<std::size_t>(axis)] ||
                           std::abs(0.5 * width_mm * component(s.feed, axis)) > kLong_mm};
    };
  }
  [[nodiscard]] Form form(double width_mm, Column column) const {
    Form f{fmt::format("{} of about {:.3g} mm", ahead ? "overcompensation" : "play", width_mm),
           {std::move(column)},
           {{ahead ? kOvercompensatedWidth : "followed_width_mm", width_mm}},
           1};
    f.columns[0].by_program = true;
    if (ahead)
      f.made_of_mm = width_mm;
    else
      f.columns[0].follows = {false, axis, width_mm};
    f.of_size = [make = *this](double size_mm) { return make(size_mm, 1.0); };
    f.at_size = [make = *this](double size_mm) {
      return make.form(size_mm, tangent_column(make.key(size_mm) + " tangent", make.parameter(),
                                               size_mm / make.per_column(), make.radius_mm,
                                               make.change(size_mm)));
    };
    return f;
  }
};

}  // namespace

void add_machine_backlash(std::vector<Effect>& all) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::string a = kAxisName[axis];
    Effect e;
    e.name = "machine.backlash_" + a;
    e.says =
        "lost motion of the " + a + " axis: the part depends on the side it was approached from";
    e.source = "ISO 230-2, reversal value; 5 to 70 um";
    e.acts_on = "machine";
    e.depends_on = "direction of motion along " + a + ", slope along " + a;
    e.unknown_shift = a;
    e.looks_like = {"machine.servo_lag", "tool.deflection"};
    e.separate_by = "one-way passes on a test strip";
    e.signature_error = 0.05;
    e.correction = "backlash compensation of the " + a + " axis, or one-way passes";
    e.needs = Needs::path;
    e.forms = [axis](const Scene& scene) {
      std::vector<Form> forms;
      for (const double width_mm : {0.02, 0.05, 0.1, 0.2, 0.4})
        forms.push_back(Make{axis, scene.ball_radius_mm, scene.slack}(width_mm, 2.0));
      for (const double width_mm : {0.05, 0.1, 0.2, 0.4})
        forms.push_back(Make{axis, scene.ball_radius_mm, scene.slack, true}(width_mm, 2.0));
      return forms;
    };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
