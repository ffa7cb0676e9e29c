// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stack.hpp
/// A camera as an ordered stack of effects: radiance in, picture out.
///
/// Room    camera:  render -> radiance and depth -> [stack] -> compare
/// Takes   Frame of linear radiance, one or three bands, with depth where an effect needs it
/// Gives   Frame of what the last effect gives
///
/// The order of `Effect`'s alternatives is the order in which light becomes a picture. A stack may
/// leave effects out, but not turn them round: check() says which is wrong and why.
///
/// The same bits for any number of threads; temporal noise is a function of (seed, time, effect,
/// pixel), fixed pattern of (serial, effect, pixel).

#include <string>
#include <variant>
#include <vector>

#include "camera/effects/adc.hpp"
#include "camera/effects/bayer.hpp"
#include "camera/effects/dark_current.hpp"
#include "camera/effects/demosaic.hpp"
#include "camera/effects/depth_of_field.hpp"
#include "camera/effects/diffraction.hpp"
#include "camera/effects/distortion.hpp"
#include "camera/effects/dsnu.hpp"
#include "camera/effects/exposure.hpp"
#include "camera/effects/full_well.hpp"
#include "camera/effects/hot_pixels.hpp"
#include "camera/effects/jpeg.hpp"
#include "camera/effects/motion.hpp"
#include "camera/effects/picture_noise.hpp"
#include "camera/effects/prnu.hpp"
#include "camera/effects/quantum_efficiency.hpp"
#include "camera/effects/read_noise.hpp"
#include "camera/effects/row_column_noise.hpp"
#include "camera/effects/shot_noise.hpp"
#include "camera/effects/smear.hpp"
#include "camera/effects/tone.hpp"
#include "camera/effects/veiling_glare.hpp"
#include "camera/effects/vignetting.hpp"
#include "camera/effects/white_balance.hpp"
#include "core/run_context.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kStackOrder{"CAMERA_STACK_ORDER"};

using Effect = std::variant<
    // light passes the lens
    MotionBlur, RollingShutter, DepthOfField, Distortion, Vignetting, Diffraction, VeilingGlare,
    // light becomes charge
    Exposure, Bayer, QuantumEfficiency, Prnu, Smear, DarkCurrent, HotPixels, DarkLibrary, ShotNoise,
    FullWell,
    // charge becomes numbers
    Dsnu, ReadNoise, RowColumnNoise, Adc,
    // numbers become a picture
    Demosaic, WhiteBalance, PictureNoise, Tone, Jpeg>;
using Stack = std::vector<Effect>;

[[nodiscard]] const EffectInfo& info(const Effect& effect);
/// All names in the physical order.
[[nodiscard]] std::vector<std::string_view> effect_names();

/// Order, signals from one effect to the next, and each effect's parameters.
/// @return CAMERA_STACK_ORDER: an effect before one that acts earlier, or twice, or what it takes
///         (photons, electrons, ...) is not what the one before gives; CAMERA_EFFECT_OUT_OF_RANGE;
///         CAMERA_INTRINSICS
[[nodiscard]] Result<void> check(const Stack& stack, const Shot& shot);

/// Grey light is the same in each band of a colour sensor (three quantum efficiencies); a grey
/// sensor sees the mean of three bands.
/// @return the picture; what check() returns; CAMERA_FRAME: no band, not one or three, sizes of
///         bands, depth and camera differ; CAMERA_IMAGE_FORMAT (Jpeg); CORE_CANCELLED
[[nodiscard]] Result<Frame> expose(const Stack& stack, const Shot& shot, Frame frame,
                                   const RunContext& run = {});

/// How much the picture would change if two effects stood in each other's place.
struct Swap {
  std::string first, second;
  double mean_abs_255 = 0.0;  ///< over pixels and bands of the whole picture; NaN: impossible
  double max_abs_255 = 0.0;
  std::string
      impossible{};  ///< why the two cannot change places, continues "because"; empty: they can
};
/// Every pair of the stack. Two can change places where both take and give the same kind of signal;
/// the rest of the stack stays as it is, and so does the noise that each draws. Pictures are
/// compared after all effects, in the scale of the last (display values 1 = 255; others in parts of
/// their range).
[[nodiscard]] Result<std::vector<Swap>> swaps(const Stack& stack, const Shot& shot,
                                              const Frame& frame, const RunContext& run = {});

}  // namespace maquette::camera
