// SPDX-License-Identifier: GPL-3.0-or-later

// The whole block grows by k, by moisture or temperature: d = k (p - centre). 54 to 72 um/m per
// kelvin for polyurethane foam.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_stock_swelling(std::vector<Effect>& all) {
  Effect e;
  e.name = "stock.swelling";
  e.says = "the block has grown or shrunk in all directions";
  e.source = "thermal expansion 54 to 72 um/m/K of polyurethane; moisture";
  e.acts_on = "stock";
  e.depends_on = "position";
  e.unknown_shift = std::string("xyzr");
  e.looks_like = {"scanner.range_scale", "machine.scale_x"};
  e.separate_by = "temperature log; invar bar in the scene";
  e.signature_error = 0.03;
  e.correction = "";
  e.forms = [](const Scene& scene) {
    const Vec3 c = scene.centre();
    const double half = scene.half_mm();
    return std::vector<Form>{
        {"isotropic",
         {moving_column("swelling", {"growth_um_per_m", 1e6 / half, 20000.0},
                        [=](const Observation& o) { return (1.0 / half) * (o.place - c); })}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
