// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis {

namespace detail {

namespace {

constexpr double kStepAside_mm = 0.2;
constexpr double kNearby =
    1.0 / 64;  // of the program: as far as a moment that the data show is off

/// A step whose moment is refined; `step`: distance to the next such form.
struct MakeStep {
  int axis;
  double size_mm, radius_mm, minutes;
  Form operator()(double share, double step) const {
    Form f{fmt::format("after {:.4f} of the program", share),
           {step_after(axis, share, "step_mm", size_mm, radius_mm)}};
    f.fixed = {{"moment_min", share * minutes}};
    f.sign = sign_of(size_mm);
    f.at_moment = [make = *this](double at) { return make(at, kNearby); };
    if (step > 1e-3)
      f.finer = [make = *this, share, step] {
        std::vector<Form> near;
        for (int k = -6; k <= 6; ++k)
          if (share + k * step / 7.0 > 0.0)
            near.push_back(make(share + k * step / 7.0, step / 7.0));
        return near;
      };
    return f;
  }
};

}  // namespace

std::vector<Form> step_forms(int axis, const Scene& scene) {
  std::vector<Form> forms;
  const auto sizes =
      axis == 2 ? std::vector{kStepUp_mm, -kStepUp_mm} : sizes_of_drifts(scene, kStepAside_mm);
  for (const double size : sizes) {
    const MakeStep make{axis, size, scene.ball_radius_mm, scene.duration_min};
    for (const double share : scene.steps[static_cast<std::size_t>(axis)])
      forms.push_back(make(share, kNearby));
    for (int k = 1; k < 16; ++k) forms.push_back(make(k / 16.0, 1.0 / 16.0));
  }
  return forms;
}

}  // namespace detail

const std::vector<Effect>& library() {
  static const std::vector<Effect> all = [] {
    std::vector<Effect> effects;
    for (const auto add : {detail::add_machine_scale,
                           detail::add_machine_squareness,
                           detail::add_machine_straightness,
                           detail::add_machine_backlash,
                           detail::add_machine_servo_lag,
                           detail::add_machine_thermal_growth,
                           detail::add_machine_step_loss,
                           detail::add_tool_radius_error,
                           detail::add_tool_length_offset,
                           detail::add_tool_wear,
                           detail::add_tool_runout,
                           detail::add_tool_deflection,
                           detail::add_process_band_step,
                           detail::add_process_chatter,
                           detail::add_stock_warp,
                           detail::add_stock_swelling,
                           detail::add_coating_thickness,
                           detail::add_coating_pooling,
                           detail::add_coating_shadow,
                           detail::add_stones,
                           detail::add_scanner_range_bias,
                           detail::add_scanner_range_scale,
                           detail::add_scanner_incidence_bias,
                           detail::add_scanner_encoder_eccentricity,
                           detail::add_scanner_registration,
                           detail::add_scanner_spot_blur,
                           detail::add_photo_exposure,
                           detail::add_photo_white_balance,
                           detail::add_photo_black_level,
                           detail::add_photo_gamma,
                           detail::add_photo_vignetting,
                           detail::add_photo_focal_length,
                           detail::add_photo_radial_distortion,
                           detail::add_photo_chromatic_aberration,
                           detail::add_photo_defocus,
                           detail::add_photo_motion_blur,
                           detail::add_photo_veiling_glare,
                           detail::add_photo_pose,
                           detail::add_photo_noise,
                           detail::add_lamp_position,
                           detail::add_lamp_size,
                           detail::add_lamp_falloff,
                           detail::add_lamp_ambient,
                           detail::add_surface_albedo,
                           detail::add_surface_roughness,
                           detail::add_surface_opposition,
                           detail::add_surface_specular,
                           detail::add_surface_interreflection})
      add(effects);
    return effects;
  }();
  return all;
}

const Effect* find_effect(const std::string& name) {
  const auto& all = library();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Effect& e) { return e.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace maquette::diagnosis
