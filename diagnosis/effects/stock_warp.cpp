// SPDX-License-Identifier: GPL-3.0-or-later

// The block bends after it is unclamped or as it takes up moisture: dz = w = k1 x^2 + k2 y^2 +
// k3 x y, the bending modes of a plate of even curvature. Normals of the plane that keeps its
// length stay normal to it (Kirchhoff): what lies h above goes sideways by -h times the gradient of
// w. How deep that plane lies is not known; in a part whose relief is small beside the block's
// thickness it shows as little.
#include <array>
#include <optional>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Below the middle of the part's box.
constexpr std::array kDepths_mm{0.0, 8.0, 24.0, 60.0};

struct Mode {
  const char* name;
  double (*rise)(double x, double y);  ///< of x and y from -1 to 1 over the part
  Vec3 (*gradient)(double x, double y);
};
constexpr std::array<Mode, 3> kModes{{
    {"xx", [](double x, double) { return x * x; },
     [](double x, double) {
       return Vec3{2.0 * x, 0.0, 0.0};
     }},
    {"yy", [](double, double y) { return y * y; },
     [](double, double y) {
       return Vec3{0.0, 2.0 * y, 0.0};
     }},
    {"xy", [](double x, double y) { return x * y; },
     [](double x, double y) {
       return Vec3{y, x, 0.0};
     }},
}};

struct Plate {
  Vec3 middle;
  double half_mm;

  /// @param depth_mm  of the plane that keeps its length; none: upright motion alone
  [[nodiscard]] Column column(const Mode& mode, std::optional<double> depth_mm) const {
    const std::string key =
        fmt::format("warp_{}{}", mode.name, depth_mm ? fmt::format("_over{:.4f}", *depth_mm) : "");
    return moving_column(key,
                         {fmt::format("{}_per_m", mode.name), 1000.0 / (half_mm * half_mm), 1000.0},
                         [plate = *this, mode, depth_mm](const Observation& o) {
                           const double x = (o.place.x - plate.middle.x) / plate.half_mm,
                                        y = (o.place.y - plate.middle.y) / plate.half_mm;
                           const Vec3 up{0.0, 0.0, mode.rise(x, y)};
                           if (!depth_mm) return up;
                           const double above_mm = o.place.z - plate.middle.z + *depth_mm;
                           return up - (above_mm / plate.half_mm) * mode.gradient(x, y);
                         });
  }
  /// @param by_mm  to the next such form
  [[nodiscard]] Form leaning(double depth_mm, double by_mm) const {
    constexpr double kNear_mm = 0.5;
    Form f{fmt::format("bent and twisted over a plane {:.3g} mm down", depth_mm), {}};
    for (const Mode& mode : kModes) f.columns.push_back(column(mode, depth_mm));
    f.fixed = {{"plane_depth_mm", depth_mm}};
    if (by_mm > kNear_mm)
      f.finer = [plate = *this, depth_mm, by_mm] {
        std::vector<Form> near;
        for (const double off : {-0.5, 0.0, 0.5})
          near.push_back(plate.leaning(depth_mm + off * by_mm, 0.5 * by_mm));
        return near;
      };
    return f;
  }
};

}  // namespace

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
    const Plate plate{scene.centre(), scene.half_mm()};
    const auto of = [&](std::size_t mode) { return plate.column(kModes.at(mode), std::nullopt); };
    std::vector<Form> forms{{"bent along x", {of(0)}},
                            {"bent along y", {of(1)}},
                            {"twisted", {of(2)}},
                            {"bent along x and y", {of(0), of(1)}},
                            {"bent and twisted", {of(0), of(1), of(2)}}};
    for (std::size_t i = 0; i < kDepths_mm.size(); ++i)
      forms.push_back(plate.leaning(
          kDepths_mm.at(i), i == 0 ? kDepths_mm[1] : kDepths_mm.at(i) - kDepths_mm.at(i - 1)));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
