// SPDX-License-Identifier: GPL-3.0-or-later

// Axes that are not at right angles: d = a y along x (xy), a z along x (xz), a z along y (yz).
// The other way round (y by x) is the same up to a rotation, which registration takes.
// 0.02 mm in 300 mm is a usual limit.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_machine_squareness(std::vector<Effect>& all) {
  struct Pair {
    int moved, by;
    const char* name;
  };
  for (const Pair p : {Pair{0, 1, "xy"}, Pair{0, 2, "xz"}, Pair{1, 2, "yz"}}) {
    Effect e;
    e.name = std::string("machine.squareness_") + p.name;
    e.says = std::string("axes ") + kAxisName[p.moved] + " and " + kAxisName[p.by] +
             " are not at right angles";
    e.source = "ISO 230-1; 0.02 mm in 300 mm";
    e.acts_on = "machine";
    e.depends_on = std::string("position along ") + kAxisName[p.by];
    e.unknown_shift = kAxisName[p.moved];
    e.looks_like = {"scanner.registration", "stock.warp"};
    e.separate_by = "mill a strip, turn the block by 180 degrees, mill its neighbour";
    e.signature_error = 0.03;
    e.correction = "square the axes, or shear the program by the angle";
    e.forms = [p](const Scene& scene) {
      const double half = scene.half_mm(), c = component(scene.centre(), p.by);
      return std::vector<Form>{
          {"shear",
           {tip_column(std::string("square_") + p.name, {"angle_urad", 1e6 / half, 100'000.0},
                       [=](const CutState& s) {
                         return along_axis(p.moved, (component(s.tip, p.by) - c) / half);
                       })}}};
    };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
