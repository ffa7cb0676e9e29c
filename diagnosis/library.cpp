// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis {

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
