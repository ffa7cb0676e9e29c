// SPDX-License-Identifier: GPL-3.0-or-later

// A wet film levels: thick in hollows, thin on ridges, in proportion to the mean curvature at the
// length over which it flows. Orchard, Appl. Sci. Res. A 11 (1963), doi:10.1007/BF03184629.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_coating_pooling(std::vector<Effect>& all) {
  Effect e;
  e.name = "coating.pooling";
  e.says = "the coat has run into hollows and off ridges";
  e.source = "levelling under surface tension, Orchard 1963";
  e.acts_on = "coat";
  e.depends_on = "mean curvature of the surface";
  e.looks_like = {"scanner.spot_blur", "machine.servo_lag"};
  e.separate_by = "scan before and after the coat; another range changes only the spot";
  e.correction = "thinner coats, dried lying flat";
  e.forms = [](const Scene&) {
    std::vector<Form> forms;
    for (std::size_t k = 0; k < kCurvatureScales_mm.size(); ++k) {
      const double length = kCurvatureScales_mm[k] * std::sqrt(2.0);
      Form f{fmt::format("over {:.2g} mm", length),
             {column(fmt::format("pooling{}", k), {"levelled_share", 1.0, 10.0},
                     [=](const Observation& o) {
                       return o.on_surface
                                  ? 0.5 * length * length * o.normal.z * dot(o.along, o.normal) *
                                        static_cast<double>(o.curvature[k].xx + o.curvature[k].yy)
                                  : 0.0;
                     })}};
      f.sign = 1;
      f.fixed = {{"length_mm", length}};
      forms.push_back(std::move(f));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
