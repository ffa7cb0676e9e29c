// SPDX-License-Identifier: GPL-3.0-or-later

// A wet film levels: thick in hollows, thin on ridges: the surface smoothed over the
// length over which the film flows, less the surface. Orchard, Appl. Sci. Res. A 11 (1963),
// doi:10.1007/BF03184629.
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
    for (std::size_t k = 0; k < kFilmLengths_mm.size(); ++k) {
      const double length = kFilmLengths_mm[k];
      const auto levelled = [](std::size_t at) {
        Column c = column(
            fmt::format("pooling{}", at),
            {fmt::format("levelled_share_over_{:.2g}_mm", kFilmLengths_mm[at]), 1.0, 10.0},
            [=](const Observation& o) {
              return o.on_surface
                         ? dot(o.along, o.normal) * o.normal.z * static_cast<double>(o.levelled[at])
                         : 0.0;
            });
        c.levels = Levels{kFilmLengths_mm[at], false};
        return c;
      };
      Form f{fmt::format("over {:.2g} mm", length), {levelled(k)}};
      f.sign = 1;
      f.fixed = {{"length_mm", length}};
      forms.push_back(f);
      if (k + 1 == kFilmLengths_mm.size()) continue;
      f.law = fmt::format("over {:.2g} to {:.2g} mm", length, kFilmLengths_mm[k + 1]);
      f.columns.push_back(levelled(k + 1));
      f.signed_columns = 2;
      f.fixed.clear();
      forms.push_back(std::move(f));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
