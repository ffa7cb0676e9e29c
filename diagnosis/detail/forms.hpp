// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What the files of diagnosis/effects share.

#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/effect.hpp"

namespace maquette::diagnosis::detail {

inline constexpr const char* kAxisName[3] = {"x", "y", "z"};
[[nodiscard]] inline double component(Vec3 v, int axis) {
  return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}
[[nodiscard]] inline Column column(std::string key, Parameter parameter,
                                   std::function<double(const Observation&)> value) {
  return {std::move(key), std::move(parameter), std::move(value)};
}
/// A column of what moves the part with its ridges, or its points in a scan.
[[nodiscard]] inline Column moving_column(std::string key, Parameter parameter,
                                          std::function<Vec3(const Observation&)> moves) {
  Column c{std::move(key), std::move(parameter),
           [moves](const Observation& o) { return dot(level_along(o), moves(o)); }};
  c.moves = std::move(moves);
  return c;
}
/// An instrument's error that moves points by of_one(o): one instrument for all scans, or, where
/// there are several, for each its own and one of them in error.
template <class Moves>
[[nodiscard]] std::vector<Form> of_instruments(const Scene& scene, const std::string& law,
                                               const std::string& key, const Parameter& parameter,
                                               Moves of_one) {
  std::vector<Form> forms;
  const auto add = [&](std::string of, std::string its_key, auto is_its) {
    forms.push_back(
        {std::move(of), {moving_column(std::move(its_key), parameter, [=](const Observation& o) {
           return o.has_station && is_its(o.set_up) ? of_one(o) : Vec3{};
         })}});
  };
  add(law, key, [](std::uint32_t) { return true; });
  if (std::count(scene.has_station.begin(), scene.has_station.end(), true) < 2) return forms;
  for (std::uint32_t scan = 0; scan < scene.has_station.size(); ++scan)
    if (scene.has_station[scan])
      add(fmt::format("{}, in scan {} alone", law, scan + 1), fmt::format("{}_{}", key, scan + 1),
          [scan](std::uint32_t s) { return s == scan; });
  return forms;
}
/// What an even film of 1 mm moves: along the slope's normal, whatever the ridges do.
[[nodiscard]] inline double film(const Observation& o) {
  return o.on_surface ? dot(o.along, o.normal) * o.normal.z / o.slope_normal.z : 0.0;
}
/// No film is thinner than none, by more than what a part may have lost that was simulated too
/// large (0.2 mm, as much as a heavy coat).
[[nodiscard]] inline Parameter film_parameter(const Scene& scene, std::string name) {
  return {std::move(name), 1.0, 0.6, -(scene.coat_mm + 0.2)};
}
/// film() for a column.
[[nodiscard]] inline Column even_film(const Scene& scene, std::string name) {
  return column("film", film_parameter(scene, std::move(name)), film);
}
/// A column of tips that drift by d(state), small and alike for neighbouring passes.
template <class DriftOf>
[[nodiscard]] Column drift_column(std::string key, Parameter parameter, DriftOf d) {
  Column c{std::move(key), std::move(parameter), [d](const Observation& o) {
             CutState s = o;
             if (!std::isnan(o.level_tip.x)) s.tip = o.level_tip;
             return dot(level_along(o), d(s).at);
           }};
  c.cut = [d](const Observation&, const CutState& s, Vec3) {
    const Drift drift = d(s);
    CutChange change{drift.at, 0.0, drift.per_mm};
    change.curvature_per_mm = drift.curvature_per_mm;
    return change;
  };
  c.by_program = true;
  return c;
}
/// The same of tips that are displaced by d(state), hardly more with each mm of way.
template <class Displacement>
[[nodiscard]] Column tip_column(std::string key, Parameter parameter, Displacement d) {
  return drift_column(std::move(key), std::move(parameter), [d](const CutState& s) {
    return Drift{d(s), {}};
  });
}
/// A column of passes that are changed against each other by change(o, state, normal) for one unit
/// of the coefficient: the secant at `size` units, for other passes come to make the surface.
template <class Change>
[[nodiscard]] Column cut_column(std::string key, Parameter parameter, double size, double radius_mm,
                                Change change) {
  Column c{std::move(key), std::move(parameter), [=](const Observation& o) {
             return recut_mm(o, radius_mm,
                             [&](const CutState& s, Vec3 n) { return size * change(o, s, n); }) /
                    size;
           }};
  c.cut = change;
  c.secant = {0.0, size, radius_mm};
  return c;
}
/// The same, the tangent there: what one unit more moves once there are `size`. A ridge that is no
/// longer cut whatever the size has no say in it, where in the secant it would.
template <class Change>
[[nodiscard]] Column tangent_column(std::string key, Parameter parameter, double size,
                                    double radius_mm, Change change) {
  constexpr double kShare = 0.1;  // of the size, to either side
  Column c{std::move(key), std::move(parameter), [=](const Observation& o) {
             const auto at = [&](double of) {
               return recut_mm(o, radius_mm,
                               [&](const CutState& s, Vec3 n) { return of * change(o, s, n); });
             };
             return (at((1.0 + kShare) * size) - at((1.0 - kShare) * size)) / (2.0 * kShare * size);
           }};
  c.cut = change;
  c.secant = {(1.0 - kShare) * size, (1.0 + kShare) * size, radius_mm};
  return c;
}
/// By how much balls are larger or smaller in forms that are made of a size.
inline constexpr double kBallSizes_mm[] = {0.02, -0.02, 0.06, -0.06, 0.15, -0.15, 0.4, -0.4};
/// Form::sign of a form that is made of a size; 0: of none.
[[nodiscard]] constexpr int sign_of(double size_mm) {
  return size_mm > 0.0 ? 1 : size_mm < 0.0 ? -1 : 0;
}
/// Balls larger or smaller: sizes for themselves, for at hollows and ridges another pass comes to
/// make the surface.
struct BallForm {
  std::string before, after;  ///< the size in the law
  std::string key;
  Parameter parameter;
  double radius_mm;
  CutChange per_mm;

  Form operator()(double size_mm) const {
    return form(size_mm, cut_column(name(size_mm), parameter, size_mm, radius_mm, Change{per_mm}));
  }

 private:
  struct Change {
    CutChange per_mm;
    CutChange operator()(const Observation&, const CutState&, Vec3) const { return per_mm; }
  };
  [[nodiscard]] std::string name(double size_mm) const {
    return fmt::format("{}{:.6f}", key, size_mm);
  }
  [[nodiscard]] Form form(double size_mm, Column column) const {
    Form f{fmt::format("{}about {:.3g} mm{}", before, size_mm, after),
           {std::move(column)},
           {{"signature_at_mm", size_mm}}};
    f.sign = sign_of(size_mm);
    f.made_of_mm = size_mm;
    f.of_size = *this;
    f.at_size = [make = *this](double size) {
      return make.form(size, tangent_column(make.name(size) + " tangent", make.parameter, size,
                                            make.radius_mm, Change{make.per_mm}));
    };
    return f;
  }
};
/// Form::finer of make(value, step), a form of one positive parameter whose grid has the ratio
/// `step`: three neighbours on either side at the `parts`-th root of it; none from `least` on.
template <class Make>
[[nodiscard]] std::function<std::vector<Form>()> finer_by_ratio(Make make, double value,
                                                                double step, int parts,
                                                                double least) {
  if (!(step > least)) return {};
  return [make = std::move(make), value, fine = std::pow(step, 1.0 / parts)] {
    std::vector<Form> near;
    for (int k = -3; k <= 3; ++k) near.push_back(make(value * std::pow(fine, k), fine));
    return near;
  };
}
/// Legendre polynomial of degree 0 .. 10.
[[nodiscard]] inline double legendre(int degree, double u) {
  // Of the recurrence, divided once: guides' curves are asked for at every pass of every place.
  struct Step {
    double now, before;
  };
  constexpr auto kSteps = [] {
    std::array<Step, 10> steps{};
    for (std::size_t k = 0; k < steps.size(); ++k) {
      const auto n = static_cast<double>(k);
      steps[k] = {(2.0 * n + 1.0) / (n + 1.0), n / (n + 1.0)};
    }
    return steps;
  }();
  double before = 0.0, now = 1.0;
  for (std::size_t k = 0; k < static_cast<std::size_t>(degree); ++k)
    before = std::exchange(now, kSteps[k].now * u * now - kSteps[k].before * before);
  return now;
}

[[nodiscard]] inline Vec3 along_axis(int axis, double value) {
  return {axis == 0 ? value : 0.0, axis == 1 ? value : 0.0, axis == 2 ? value : 0.0};
}

/// A column of tips that are displaced by d(state): to first order, or where passes cross, which
/// then one by one stay or no longer stay in the surface, the secant at `size_mm` (0: first order).
template <class Displacement>
[[nodiscard]] Column timed_column(std::string key, Parameter parameter, double size_mm,
                                  double radius_mm, Displacement d) {
  if (size_mm == 0.0) return tip_column(std::move(key), std::move(parameter), d);
  Column c =
      cut_column(fmt::format("{}of{}", key, size_mm), std::move(parameter), size_mm, radius_mm,
                 [d](const Observation&, const CutState& s, Vec3) { return CutChange{d(s)}; });
  c.by_program = true;
  return c;
}
/// Size of the secants of steps in height, up and down. A ball that is 0.1 mm deeper reaches over
/// the border by more than a pass, one that is higher leaves as much to the other side.
inline constexpr double kStepUp_mm = 0.09;
/// From a moment of the program on, the tip is off by a constant along one axis; in plan about the
/// middle between before and after, for a shift of all is the pose's, and passes that have gone
/// three aside are looked for two aside at most.
/// @param tangent  at that size, instead of the secant
[[nodiscard]] inline Column step_after(int axis, double share, std::string name, double size_mm,
                                       double radius_mm, bool tangent = false) {
  const auto is_after = [share](const CutState& s) { return s.path_share > share; };
  Column c = timed_column(
      fmt::format("step_{}{:.6f}", kAxisName[axis], share), {std::move(name), 1.0, 5.0}, size_mm,
      radius_mm, [axis, is_after, middle = axis == 2 ? 0.0 : 1.0 - share](const CutState& s) {
        return along_axis(axis, (is_after(s) ? 1.0 : 0.0) - middle);
      });
  if (axis != 2 || size_mm == 0.0) return c;
  if (tangent) {
    c = tangent_column(c.key + " tangent", c.parameter, size_mm, radius_mm, std::move(c.cut));
    c.by_program = true;
  }
  c.secant.reset();
  // Lowered alike, passes stay who they are.
  c.value = [is_after, beside = std::move(c.value)](const Observation& o) {
    const bool after = is_after(o);
    for (const auto& rival : rivals_of(o))
      if (is_after(rival.state) != after) return beside(o);
    return after ? level_along(o).z : 0.0;
  };
  return c;
}
/// Of forms that displace passes against each other: first order where neighbours move alike, up
/// and down by `usual_mm` where passes cross.
[[nodiscard]] inline std::vector<double> sizes_of_drifts(const Scene& scene, double usual_mm) {
  return scene.passes_cross ? std::vector{usual_mm, -usual_mm} : std::vector{0.0};
}
/// Fixed by the law of a drive that its control moves further than it loses.
inline constexpr const char* kOvercompensatedWidth = "overcompensated_width_mm";
/// Law of bands that begin where the program says.
inline constexpr const char* kBandsOfTheProgram = "bands of the program";
/// Moments at which a drive may have lost steps: with more it would look like any drift.
inline constexpr std::size_t kMostLosses = 2;
/// Steps along an axis (step_forms.cpp): at one moment, those that the data show and 15 even ones;
/// at two that the data show, and up to `most` of the sharpest.
[[nodiscard]] std::vector<Form> step_forms(int axis, const Scene& scene, std::size_t most);
/// Steps at those moments, each up or down, one of them refined after the other; none where two are
/// too close to be told apart.
[[nodiscard]] std::vector<Form> refined_steps(int axis, const Scene& scene,
                                              std::vector<double> moments);
/// Steps in height where sections of the program start.
[[nodiscard]] std::vector<Form> steps_of_sections(const Scene& scene);

// One function a family, each in its own file; library.cpp lists them in order.
void add_machine_scale(std::vector<Effect>& all);
void add_machine_squareness(std::vector<Effect>& all);
void add_machine_straightness(std::vector<Effect>& all);
void add_machine_backlash(std::vector<Effect>& all);
void add_machine_servo_lag(std::vector<Effect>& all);
void add_machine_thermal_growth(std::vector<Effect>& all);
void add_machine_step_loss(std::vector<Effect>& all);
void add_tool_radius_error(std::vector<Effect>& all);
void add_tool_length_offset(std::vector<Effect>& all);
void add_tool_wear(std::vector<Effect>& all);
void add_tool_runout(std::vector<Effect>& all);
void add_tool_deflection(std::vector<Effect>& all);
void add_process_band_step(std::vector<Effect>& all);
void add_process_chatter(std::vector<Effect>& all);
void add_stock_warp(std::vector<Effect>& all);
void add_stones(std::vector<Effect>& all);
void add_stock_swelling(std::vector<Effect>& all);
void add_coating_thickness(std::vector<Effect>& all);
void add_coating_pooling(std::vector<Effect>& all);
void add_coating_shadow(std::vector<Effect>& all);
void add_scanner_range_bias(std::vector<Effect>& all);
void add_scanner_range_scale(std::vector<Effect>& all);
void add_scanner_incidence_bias(std::vector<Effect>& all);
void add_scanner_encoder_eccentricity(std::vector<Effect>& all);
void add_scanner_registration(std::vector<Effect>& all);
void add_scanner_spot_blur(std::vector<Effect>& all);
void add_photo_exposure(std::vector<Effect>& all);
void add_photo_white_balance(std::vector<Effect>& all);
void add_photo_black_level(std::vector<Effect>& all);
void add_photo_gamma(std::vector<Effect>& all);
void add_photo_vignetting(std::vector<Effect>& all);
void add_photo_focal_length(std::vector<Effect>& all);
void add_photo_radial_distortion(std::vector<Effect>& all);
void add_photo_chromatic_aberration(std::vector<Effect>& all);
void add_photo_defocus(std::vector<Effect>& all);
void add_photo_motion_blur(std::vector<Effect>& all);
void add_photo_veiling_glare(std::vector<Effect>& all);
void add_photo_pose(std::vector<Effect>& all);
void add_photo_noise(std::vector<Effect>& all);
void add_lamp_position(std::vector<Effect>& all);
void add_lamp_size(std::vector<Effect>& all);
void add_lamp_falloff(std::vector<Effect>& all);
void add_lamp_ambient(std::vector<Effect>& all);
void add_surface_albedo(std::vector<Effect>& all);
void add_surface_roughness(std::vector<Effect>& all);
void add_surface_opposition(std::vector<Effect>& all);
void add_surface_specular(std::vector<Effect>& all);
void add_surface_interreflection(std::vector<Effect>& all);

}  // namespace maquette::diagnosis::detail
