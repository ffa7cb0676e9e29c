// SPDX-License-Identifier: GPL-3.0-or-later

// A guide that is not straight: going along x, the tip leaves the line by f(x), upwards or
// sideways. f is a sum of Legendre polynomials, or a wave; what is constant or linear is
// registration or squareness. 0.01 mm in 300 mm is a usual limit.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Rails bolted down at even distances, a screw that is bent: one wave, upright.
struct Wave {
  int axis;
  double span_mm;
  Form operator()(double waves, double step) const {
    const double k = 2.0 * 3.14159265358979323846 * waves / span_mm;
    const auto part = [&, axis = axis](const char* name, double quarter) {
      return tip_column(fmt::format("guide_wave_{}{:.4f}{}", kAxisName[axis], waves, name),
                        {fmt::format("{}_mm", name), 1.0, 2.0}, [=](const CutState& s) {
                          return along_axis(2, std::sin(k * component(s.tip, axis) + quarter));
                        });
    };
    Form f{fmt::format("vertical wave of {:.3f} mm", span_mm / waves),
           {part("sine", 0.0), part("cosine", 0.5 * 3.14159265358979323846)}};
    f.fixed = {{"wavelength_mm", span_mm / waves}};
    if (step > 0.01)
      f.finer = [make = *this, waves, step] {
        std::vector<Form> near;
        for (int i = -3; i <= 3; ++i) near.push_back(make(waves + i * step / 4.0, step / 4.0));
        return near;
      };
    return f;
  }
};

}  // namespace

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
      for (const double waves : axis == 0 ? scene.slow_waves_x : scene.slow_waves_y)
        forms.push_back(Wave{axis, 2.0 * scene.half_mm()}(waves, 0.25));
      return forms;
    };
    all.push_back(std::move(e));
  }
}

}  // namespace maquette::diagnosis::detail
