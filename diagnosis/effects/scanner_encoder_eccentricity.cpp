// SPDX-License-Identifier: GPL-3.0-or-later

// A circle that turns off its centre reads angles wrong by a cos + b sin of the angle (once a turn)
// or twice that. d = distance from the axis times the error, across the beam. A constant error is a
// rotation. 5 to 25 arc seconds and more. The phase is the instrument's: each scan has its own.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_scanner_encoder_eccentricity(std::vector<Effect>& all) {
  Effect e;
  e.name = "scanner.encoder_eccentricity";
  e.says = "the scanner's angle readings are wrong in a cycle of its turn";
  e.source = "Lichti, ISPRS J. 61 (2007), doi:10.1016/j.isprsjprs.2006.10.004; 5 to 25 arc seconds";
  e.acts_on = "scanner";
  e.depends_on = "azimuth or elevation seen from the station";
  e.looks_like = {"machine.scale_x", "machine.squareness_xy", "machine.straightness_x"};
  e.separate_by = "both faces, or the scanner turned by 90 degrees on the same station";
  e.signature_error = 0.04;
  e.needs = Needs::station;
  e.forms = [](const Scene& scene) {
    const auto part = [](bool vertical, int cycle, bool sine, int set_up) {
      const auto key =
          fmt::format("encoder{}{}{}_{}", vertical ? "v" : "h", cycle, sine ? "s" : "c", set_up);
      return moving_column(
          key,
          {fmt::format("{}{}_urad", sine ? "sine" : "cosine",
                       set_up < 0 ? "" : fmt::format("_{}", set_up + 1)),
           1000.0, 1e5},
          [=](const Observation& o) {
            if (!o.has_station || (set_up >= 0 && static_cast<int>(o.set_up) != set_up))
              return Vec3{};
            const double plan = std::hypot(o.beam.x, o.beam.y);
            const double azimuth = std::atan2(o.beam.y, o.beam.x);
            const double elevation = std::atan2(o.beam.z, plan);
            const double angle = cycle * (vertical ? elevation : azimuth);
            const Vec3 across =
                vertical ? Vec3{-std::sin(elevation) * std::cos(azimuth),
                                -std::sin(elevation) * std::sin(azimuth), std::cos(elevation)}
                         : Vec3{-plan * std::sin(azimuth), plan * std::cos(azimuth), 0.0};
            return 1e-3 * o.range_mm * (sine ? std::sin(angle) : std::cos(angle)) * across;
          });
    };
    std::vector<Form> forms;
    for (const bool vertical : {false, true})
      for (const int cycle : {1, 2}) {
        forms.push_back(
            {fmt::format("{} circle, {} a turn, same in all scans",
                         vertical ? "vertical" : "horizontal", cycle == 1 ? "once" : "twice"),
             {part(vertical, cycle, false, -1), part(vertical, cycle, true, -1)}});
        if (scene.has_station.size() < 2 || scene.has_station.size() > 3) continue;
        Form f{fmt::format("{} circle, {} a turn", vertical ? "vertical" : "horizontal",
                           cycle == 1 ? "once" : "twice"),
               {}};
        for (int s = 0; s < static_cast<int>(scene.has_station.size()); ++s)
          if (scene.has_station[static_cast<std::size_t>(s)]) {
            f.columns.push_back(part(vertical, cycle, false, s));
            f.columns.push_back(part(vertical, cycle, true, s));
          }
        forms.push_back(std::move(f));
      }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
