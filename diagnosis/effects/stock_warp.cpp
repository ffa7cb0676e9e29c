// SPDX-License-Identifier: GPL-3.0-or-later

// The block bends after it is unclamped or as it takes up moisture: dz = k1 x^2 + k2 y^2 + k3 x y,
// the bending modes of a plate of even curvature.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_stock_warp(std::vector<Effect>& all) {
  Effect e;
  e.name = "stock.warp";
  e.says = "the block is bent or twisted";
  e.source = "plate of constant curvature; released stress 0.1 to 1 mm";
  e.acts_on = "stock";
  e.depends_on = "position in plan";
  e.unknown_shift = std::string("z");
  e.looks_like = {"machine.straightness_x", "machine.straightness_y", "machine.thermal_growth_z"};
  e.separate_by = "scan clamped and free";
  e.correction = "clamp evenly, let the block rest before the finish";
  e.forms = [](const Scene& scene) {
    const Vec3 c = scene.centre();
    const double half = scene.half_mm();
    const auto part = [=](const char* name, int kind) {
      return moving_column(std::string("warp_") + name,
                           {fmt::format("{}_per_m", name), 1000.0 / (half * half), 1000.0},
                           [=](const Observation& o) {
                             const double x = (o.place.x - c.x) / half,
                                          y = (o.place.y - c.y) / half;
                             return Vec3{0.0, 0.0, kind == 0 ? x * x : kind == 1 ? y * y : x * y};
                           });
    };
    const auto xx = part("xx", 0), yy = part("yy", 1), xy = part("xy", 2);
    return std::vector<Form>{{"bent along x", {xx}},
                             {"bent along y", {yy}},
                             {"twisted", {xy}},
                             {"bent along x and y", {xx, yy}},
                             {"bent and twisted", {xx, yy, xy}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
