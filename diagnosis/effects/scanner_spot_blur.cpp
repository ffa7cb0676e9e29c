// SPDX-License-Identifier: GPL-3.0-or-later

// The spot sees the mean over its width: hollows read high, ridges low. The mean is taken over the
// beams of a Gaussian spot that meet the simulated surface (surface.hpp), for a few widths; what
// lies between two of them is a mixture.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_scanner_spot_blur(std::vector<Effect>& all) {
  Effect e;
  e.name = "scanner.spot_blur";
  e.says = "the scanner's spot is wide enough to blur relief";
  e.source = "spot of 3 to 4 mm of phase scanners";
  e.acts_on = "scanner";
  e.depends_on = "curvature, incidence";
  e.looks_like = {"coating.pooling", "machine.servo_lag"};
  e.separate_by = "a scan from another range";
  e.needs = Needs::station;
  e.forms = [](const Scene&) {
    std::vector<Form> forms;
    for (std::size_t k = 0; k < kSpotWidths_mm.size(); ++k) {
      const auto spot = [](std::size_t width) {
        Column c =
            column(fmt::format("blur{}", width),
                   {fmt::format("share_of_{:.2g}_mm", 2.0 * kSpotWidths_mm[width]), 1.0, 10.0},
                   [=](const Observation& o) {
                     return o.has_station && o.on_surface
                                ? dot(o.along, o.beam) * static_cast<double>(o.spot[width])
                                : 0.0;
                   });
        c.levels = Levels{kSpotWidths_mm[width], true};
        return c;
      };
      const double width = 2.0 * kSpotWidths_mm[k];
      Form f{fmt::format("spot of about {:.2g} mm", width), {spot(k)}};
      f.sign = 1;
      f.fixed = {{"spot_width_mm", width}};
      forms.push_back(f);
      if (k + 1 == kSpotWidths_mm.size()) continue;
      f.law = fmt::format("spot between {:.2g} and {:.2g} mm", width, 2.0 * kSpotWidths_mm[k + 1]);
      f.columns.push_back(spot(k + 1));
      f.signed_columns = 2;
      f.fixed.clear();
      forms.push_back(std::move(f));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
