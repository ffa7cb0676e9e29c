// SPDX-License-Identifier: GPL-3.0-or-later

// Slanting beams read long: a tan^2 i, or a (1 / cos i - 1) of a stretched spot, along the beam.
// Zamecnikova and Neuner, VGI 2015; up to mm at grazing incidence.
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/incidence_laws.hpp"

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
    std::vector<Form> forms;
    for (const IncidenceLaw& law : kIncidenceLaws)
      forms.push_back(
          {law.name,
           {moving_column(
               law.key, {"coefficient_mm", 1.0, 20.0}, [of = law.of](const Observation& o) {
                 if (!o.has_station) return Vec3{};
                 return of(std::fmax(kLeastCosine, -dot(o.beam, o.slope_normal))) * o.beam;
               })}});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
