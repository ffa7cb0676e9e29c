// SPDX-License-Identifier: GPL-3.0-or-later

// Slanting beams read long: a tan^2 i, or a (1 / cos i - 1) of a stretched spot, along the beam.
// Zamecnikova and Neuner, VGI 2015; up to mm at grazing incidence.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_scanner_incidence_bias(std::vector<Effect>& all) {
  Effect e;
  e.name = "scanner.incidence_bias";
  e.says = "ranges depend on how obliquely the surface is seen";
  e.source = "Zamecnikova and Neuner 2015; stretched spot";
  e.acts_on = "scanner";
  e.depends_on = "angle of incidence";
  e.looks_like = {"tool.radius_error", "coating.shadow"};
  e.separate_by = "a second station at another height";
  e.unknown_shift = std::string("r");
  e.needs = Needs::station;
  e.forms = [](const Scene&) {
    const auto law = [](const char* key, const char* name, int kind) {
      return Form{name,
                  {moving_column(key, {"coefficient_mm", 1.0, 20.0}, [kind](const Observation& o) {
                    if (!o.has_station) return Vec3{};
                    const double c = std::fmax(0.15, -dot(o.beam, o.slope_normal));
                    const double f = kind == 0   ? 1.0 / (c * c) - 1.0
                                     : kind == 1 ? 1.0 / c - 1.0
                                     : kind == 2 ? 1.0 - c * c
                                                 : std::sqrt(std::fmax(0.0, 1.0 / (c * c) - 1.0));
                    return f * o.beam;
                  })}};
    };
    return std::vector<Form>{law("incidence_tan2", "tan^2", 0),
                             law("incidence_sec", "1 / cos - 1", 1),
                             law("incidence_sin2", "sin^2", 2), law("incidence_tan", "tan", 3)};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
