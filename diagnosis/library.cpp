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
                           detail::add_scanner_range_bias,
                           detail::add_scanner_range_scale,
                           detail::add_scanner_incidence_bias,
                           detail::add_scanner_encoder_eccentricity,
                           detail::add_scanner_registration,
                           detail::add_scanner_spot_blur})
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
