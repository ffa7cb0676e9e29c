// SPDX-License-Identifier: GPL-3.0-or-later

// A ball that runs out by e sweeps a body e wider in plan: slopes move by -e sqrt(1 - n_z^2), and
// what lies nearly level is cut flat.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

CutChange out_of_true(const Observation&, const CutState&, Vec3) {
  CutChange c;
  c.runout_mm = 1.0;
  return c;
}

struct Make {
  double radius_mm;
  Form operator()(double size_mm) const {
    return form(size_mm, cut_column(key(size_mm), kParameter, size_mm, radius_mm, out_of_true));
  }

 private:
  static inline const Parameter kParameter{"eccentricity_mm", 1.0, 0.5};
  static std::string key(double size_mm) { return fmt::format("runout{:.6f}", size_mm); }
  Form form(double size_mm, Column column) const {
    Form f{fmt::format("eccentric by about {:.3g} mm", size_mm),
           {std::move(column)},
           {{"signature_at_mm", size_mm}},
           1};
    f.made_of_mm = size_mm;
    f.of_size = *this;
    // Ground that lies nearly level is cut flat, and stays so, whatever the size.
    f.at_size = [make = *this](double size) {
      return make.form(size, tangent_column(make.key(size) + " tangent", kParameter, size,
                                            make.radius_mm, out_of_true));
    };
    return f;
  }
};

}  // namespace

void add_tool_runout(std::vector<Effect>& all) {
  Effect e;
  e.name = "tool.runout";
  e.says = "the cutter runs out of true and cuts wider than its diameter";
  e.source = "envelope of an eccentric ball; 5 to 20 um";
  e.acts_on = "cutter";
  e.depends_on = "slope";
  e.unknown_shift = std::string("z");
  e.looks_like = {"tool.radius_error", "tool.deflection"};
  e.separate_by = "dial gauge on the cutter; marks at one tooth per turn under a microscope";
  e.signature_error = 0.05;
  e.correction = "clean or change the collet";
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    for (const double size_mm : {0.01, 0.05, 0.12})
      forms.push_back(Make{scene.ball_radius_mm}(size_mm));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
