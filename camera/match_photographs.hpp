// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file match_photographs.hpp
/// Exposure, white balance, lamp and camera poses that make renderings of a scene look like
/// photographs of it.
///
/// Room    camera:  scene, photographs, a start for each unknown -> [match] -> values, covariance
/// Takes   linear light of photographs, seen by a pinhole (distortion taken off before)
/// Gives   the start with what was searched in its place, and how sure each number is
///
/// Method
/// - A pixel of a photograph is exposure x white balance x rendered radiance, and noise. Gauss and
///   Newton, damped (Levenberg, Marquardt), from pictures of at least kCoarsest pixels across to
///   the finest, each of twice as many pixels; everything is rendered anew in each step.
/// - Derivatives: exposure and white balance are factors; of the lamp, differences of renderings on
///   both sides, where no shadow moves; of a pose, the rendering's own gradient times how far what
///   a pixel shows moves.
/// - Weights: residuals against the scatter of all pixels of the same brightness, Huber's loss,
///   within two pixels of an edge of light and shadow a tenth of the weight. Left out: saturated
///   pixels, background and what borders on it.
/// - Covariance from the residuals themselves: sums of scores over cells and their neighbours
///   (Conley, J. Econometrics 92 (1999), doi:10.1016/S0304-4076(98)00084-0), so that errors that
///   neighbours share count once. What is the same all over the picture (a wrong reflectance law, a
///   lamp that is larger) is in no residual's scatter and not in the covariance.
///
/// A lamp that moves keeps its target and its irradiance there.
/// The same bits for any number of threads.

#include <string>
#include <vector>

#include "camera/render.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kMatchPhotograph{"CAMERA_MATCH_PHOTOGRAPH"};
inline constexpr ErrorCode kMatchOpen{"CAMERA_MATCH_OPEN"};
inline constexpr ErrorCode kMatchNotConverged{"CAMERA_MATCH_NOT_CONVERGED"};

struct MatchPhoto {
  std::string name;                ///< for people
  std::vector<Grid<float>> light;  ///< one or three bands, linear; kSaturated and more is left out
  CameraModel camera;              ///< of the size of `light`
  RigidTransform model_from_camera;
  double exposure_scale = 1.0;  ///< as RenderOptions::exposure_scale
};

struct MatchSearch {
  bool exposure = false;         ///< one factor for all photographs
  bool exposure_each = false;    ///< a factor for each
  bool white_balance = false;    ///< red and blue against green, of all
  bool lamp_position = false;    ///< of the first lamp, three numbers
  bool lamp_brightness = false;  ///< irradiance of the first lamp at its target
  bool pose = false;             ///< of each photograph's camera, six numbers
};

struct MatchOptions {
  MatchSearch search;
  int finest_px = 1024;  ///< pictures are made no wider than this
  int most_steps = 40;   ///< in each size
  RenderOptions
      render;  ///< at least 16 samples are taken; exposure_scale and white_balance are not used
};

/// What is searched for, and what else makes a picture.
struct MatchState {
  std::vector<double> exposure_scale;  ///< by photograph
  Bands white_balance{1.0, 1.0, 1.0};
  Lighting lighting;
  std::vector<RigidTransform> model_from_camera;  ///< by photograph
};

struct MatchedNumber {
  std::string name;  ///< "exposure", "photo.png: right_mm"
  double start = 0.0, value = 0.0, sigma = 0.0;
};

struct PhotographMatch {
  MatchState state;
  /// Factors are relative (value over start), their sigma too; a lamp's place in mm of the model;
  /// of a pose how far it was moved in the camera's own frame: mm right, up, back; mrad about
  /// those.
  std::vector<MatchedNumber> numbers;
  std::vector<std::vector<double>> covariance;  ///< of `numbers`, in that order
  std::size_t pixels = 0;                       ///< values of the finest pictures that counted
  double independent_pixels = 0.0;              ///< as many independent values would say as much
  double rms_255 = 0.0;                         ///< of what is left, linear light, robust
  int steps = 0;
};

inline constexpr double kSaturated = 0.98;
inline constexpr int kCoarsest = 64;

/// @pre at least one photograph
/// @return CAMERA_MATCH_PHOTOGRAPH: sizes, bands, numbers that are not finite, nothing to search,
///         too little of the scene in a picture; CAMERA_MATCH_OPEN: numbers that make up for each
///         other, by name; CAMERA_MATCH_NOT_CONVERGED: steps do not end, or a photograph does not
///         look like its rendering in the end (correlation below 0.5); what render() returns
[[nodiscard]] Result<PhotographMatch> match_photographs(
    const PreparedScene& scene, const std::vector<MatchPhoto>& photos, const Lighting& lighting,
    const Bands& white_balance, const MatchOptions& options, const RunContext& run = {});

}  // namespace maquette::camera
