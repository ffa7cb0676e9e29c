// SPDX-License-Identifier: GPL-3.0-or-later

// The spot sees the mean over its width: hollows read high, ridges low. With a Gaussian spot of
// standard deviation w across the beam, the surface's curvature H and the spot's footprint in
// plan M = w^2 (P P')_xy, P the projection along the beam onto the tangent plane, the reading moves
// by n_z tr(H M) / 2 along the normal.
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
    for (std::size_t k = 0; k < kCurvatureScales_mm.size(); ++k) {
      const double w = kCurvatureScales_mm[k] * std::sqrt(2.0);
      Form f{fmt::format("spot of about {:.2g} mm", 2.0 * w),
             {column(fmt::format("blur{}", k), {"of_square_width", 1.0, 10.0},
                     [=](const Observation& o) {
                       if (!o.has_station || !o.on_surface) return 0.0;
                       const double across = std::fmin(-0.2, dot(o.normal, o.beam));
                       const Vec3 g = (1.0 / across) * o.normal;  // P v = v - (g . v) beam
                       const Vec3 px = Vec3{1.0, 0.0, 0.0} - o.beam.x * g,
                                  py = Vec3{0.0, 1.0, 0.0} - o.beam.y * g;
                       return 0.5 * w * w * o.normal.z * dot(o.along, o.normal) *
                              (static_cast<double>(o.curvature[k].xx) * dot(px, px) +
                               2.0 * static_cast<double>(o.curvature[k].xy) * dot(px, py) +
                               static_cast<double>(o.curvature[k].yy) * dot(py, py));
                     })}};
      f.sign = 1;
      f.fixed = {{"spot_width_mm", 2.0 * w}};
      forms.push_back(std::move(f));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
