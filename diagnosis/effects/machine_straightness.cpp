// SPDX-License-Identifier: GPL-3.0-or-later

// A guide that is not straight: going along x, the tip leaves the line by f(x), upwards or
// sideways. f is a sum of Legendre polynomials; what is constant or linear is registration or
// squareness. 0.01 mm in 300 mm is a usual limit.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_machine_straightness(std::vector<Effect>& all) {
  for (int axis = 0; axis < 2; ++axis) {
    const std::string a = kAxisName[axis];
    Effect e;
    e.name = "machine.straightness_" + a;
    e.says = "the guide of the " + a + " axis is not straight";
    e.source = "ISO 230-1; 0.01 mm in 300 mm";
    e.acts_on = "machine";
    e.depends_on = "position along " + a + " alone";
    e.unknown_shift = std::string(axis == 0 ? "yz" : "xz");
    e.looks_like = {"stock.warp", "machine.thermal_growth_z", "scanner.encoder_eccentricity"};
    e.separate_by = "a straight edge scanned beside the part, or a second station";
    e.correction = "compensation table of the " + a + " axis from the fitted curve";
    e.forms = [axis, a](const Scene& scene) {
      const double c = component(scene.centre(), axis);
      const double half = 0.5 * component(scene.box.max - scene.box.min, axis);
      const auto part = [=](int out, int degree) {
        return tip_column("straight_" + a + kAxisName[out] + std::to_string(degree),
                          {std::string(out == 2 ? "vertical" : "sideways") + "_p" +
                               std::to_string(degree) + "_mm",
                           1.0, 2.0},
                          [=](const CutState& s) {
                            return along_axis(
                                out, legendre(degree, (component(s.tip, axis) - c) / half));
                          });
      };
      std::vector<Form> forms;
      for (const int out : {2, 1 - axis})
        for (const int most : {2, 3, 4, 6, 8, 10}) {
          Form f{fmt::format("{} curve of degree {}", out == 2 ? "vertical" : "sideways", most),
                 {}};
          for (int degree = 2; degree <= most; ++degree) f.columns.push_back(part(out, degree));
          forms.push_back(std::move(f));
        }
      return forms;
    };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
