// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photo_chain.hpp
/// From lamp and surface to a pixel's value: the forward model of photographs, in physical order.
///
/// surface (albedo, roughness, opposition, specular, interreflection) -> lamp (place, size,
/// falloff, ambient) -> lens (pose, focal length, distortion, colours, defocus, motion,
/// vignetting, veiling glare) -> sensor (exposure, white balance, black level, gamma)
///
/// A PhotoState says by how much the chain differs from what the case file declares; a cause of the
/// library changes some of its numbers. Values are those of the case file: 1 saturates. Pixels: u
/// to the right, v down, from the principal point. Frame: model frame, millimetres.

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camera/reflectance.hpp"
#include "core/vec.hpp"

namespace maquette::diagnosis {

/// What the case file says of a photograph.
struct PhotoInput {
  std::filesystem::path image;
  bool srgb = false;  ///< 8-bit sRGB; else linear
  int width_px = 1024, height_px = 768;
  double principal_u_px = NAN, principal_v_px = NAN;  ///< from the upper left; NaN: the middle
  double pixel_pitch_um = 8.45, focal_length_mm = 35.0;
  Vec3 camera_position_mm;
  Quaternion model_from_camera;  ///< looks along -z, y up
  Vec3 lamp_position_mm, lamp_target_mm;
  double lamp_diameter_mm = 0.0, lamp_beam_deg = 56.0;
  double exposure_scale =
      1.0;  ///< value of a white Lambert surface that faces the lamp at its target
  double albedo = 0.3;
  /// How the surface sends the lamp's light back (the green band); none: as Lambert's law. What
  /// comes from around (sky, room, other slopes) it sends back evenly, by its albedo.
  std::optional<camera::Law> law;
  double full_well_e = 50000.0, read_noise_e = 20.0;
  bool as_milled = true;
  bool held_out = false;  ///< has no part in the choice: it is compared with what was chosen
};

/// Waves of an albedo map along each side.
inline constexpr int kAlbedoWaves = 11;
inline constexpr std::size_t kAlbedoTerms = (kAlbedoWaves + 1) * (kAlbedoWaves + 1);
/// Angular half widths of an opposition surge, and exponents of a specular lobe, that are tried.
inline constexpr std::array<double, 9> kSurgeWidths{0.02, 0.03, 0.045, 0.07, 0.1,
                                                    0.15, 0.2,  0.28,  0.4};
inline constexpr std::array<double, 11> kLobeExponents{4.0,  6.0,   10.0,  16.0,  25.0, 40.0,
                                                       60.0, 100.0, 150.0, 250.0, 400.0};
/// Slopes (alpha) of facets whose distribution has a long tail.
inline constexpr std::array<double, 7> kFacetSlopes{0.1, 0.15, 0.21, 0.29, 0.38, 0.48, 0.6};
/// Standard deviations of a halo's Gaussians, of the picture's width.
inline constexpr std::array<double, 3> kHaloWidths{0.015, 0.05, 0.15};
/// Means of a picture about a pixel, weighted by these.
using Surroundings = std::array<float, kHaloWidths.size()>;

/// Diameters of the lamp for which pixels know how much of it they see.
inline constexpr std::size_t kLampSizes = 6;

/// Differences of one photograph from what is declared; all 0: nothing.
struct PictureState {
  // lens
  Vec3 camera_mm, camera_rad;         ///< shift; turn about its place
  double blur_px2 = 0.0;              ///< variance of the point spread function
  std::array<double, 3> smear_px2{};  ///< uu, uv, vv of a straight motion
  double exposure = 0.0;              ///< relative
  double red = 0.0, blue = 0.0;       ///< relative
  double black = 0.0;
};

/// Differences from what is declared; all 0: nothing.
struct PhotoState {
  // surface
  double albedo = 0.0;  ///< relative
  /// Relative, of cos(i pi x') cos(j pi y') over the part and a rim, x', y' 0..1; (0, 0) is not
  /// used.
  std::array<double, kAlbedoTerms> albedo_map{};
  double roughness_rad2 = 0.0;        ///< Oren and Nayar's variance of facets' slopes, full fit
  double roughness_short_rad2 = 0.0;  ///< the same in their short form, equation 30
  std::array<double, kSurgeWidths.size()> surge{};
  std::array<double, kLobeExponents.size()> specular{};  ///< about the half vector, as it is
  std::array<double, kLobeExponents.size()> facets{};    ///< of facets that mask each other
  std::array<double, kFacetSlopes.size()> ggx{};         ///< the same, distributed as GGX
  double bounce = 0.0;                                   ///< share of the once interreflected light
  double bounce_all = 0.0;                               ///< share of all of it, however often
  // lamp
  std::vector<Vec3> lamp_mm;            ///< by lamp; its intensity stays
  std::vector<Vec3> lamp_refocused_mm;  ///< by lamp; the target's irradiance stays
  double lamp_diameter_mm = 0.0;
  double falloff = 0.0;       ///< irradiance falls with distance^-(2 + falloff)
  double beam_power = 0.0;    ///< and with cos^power of the angle off the lamp's axis
  double ambient_sky = 0.0;   ///< irradiance of an even sky, of a white surface's value
  double ambient_even = 0.0;  ///< the same without regard to what hides the sky
  /// Irradiance of an even sky that is the same wherever the lamp stands (lit by others than it),
  /// of a white surface's value under the first photograph's lamp.
  double ambient_steady = 0.0;
  /// Of a sky whose radiance grows evenly towards x, y, z: what an open place gets more where its
  /// normal leans by 1 that way; a level one gets nothing more of z.
  Vec3 ambient_side;
  /// Of an even sky, what red and blue get more than green.
  double ambient_red = 0.0, ambient_blue = 0.0;
  // lens
  std::vector<PictureState> picture;  ///< by photograph; lens and sensor
  /// Variance of the spread of a lens that is focused beside the part: of 1, nearness(), its
  /// square. A circle of confusion grows with the difference of two nearnesses.
  std::array<double, 3> focus_px2{};
  /// The same of a lens that is focused anew for each picture, of nearness_in_picture().
  std::array<double, 3> focus_anew_px2{};
  double focal = 0.0;                     ///< relative
  double radial_1 = 0.0, radial_2 = 0.0;  ///< Brown-Conrady, of u / focal length in pixels
  double red_scale = 0.0, blue_scale = 0.0;
  double vignette_2 = 0.0, vignette_4 = 0.0;  ///< of the radius over half the diagonal
  double veil = 0.0;                          ///< of the picture's mean, added
  double veil_scattered = 0.0;                ///< the same, taken off the picture
  /// Of the light, what the lens spreads about each place by one of kHaloWidths.
  std::array<double, kHaloWidths.size()> halo{};
  double halo_added = 0.0;  ///< of the light, what halos add to it (add_to_halo)
  // sensor
  double gamma = 0.0;  ///< exponent less 1
};

/// What all photographs of a case have in common.
struct PhotoScene {
  std::vector<PhotoInput> photos;
  std::vector<std::size_t> lamp_of;  ///< by photograph; those at one place are one lamp
  std::size_t lamps = 0;
  bool colour = false;
  Box3 box;
  /// The lamp's diameters that pixels know of, about that of the state; declared plus this.
  std::array<double, kLampSizes> lamp_sizes_mm{};
  [[nodiscard]] Vec3 middle() const { return 0.5 * (box.min + box.max); }
};

/// What a place sees of a lamp with a size.
struct SeenLamp {
  float share = 0.0F;              ///< of its disc
  float x_mm = 0.0F, y_mm = 0.0F;  ///< middle of that part times the share, along across()
};
/// Two directions across a third, all of length 1; across a lamp's: from its target to it.
[[nodiscard]] std::array<Vec3, 2> across(Vec3 direction);

/// Everything that the chain needs at a pixel, for states close to one that was rendered.
struct PhotoPixel {
  std::uint32_t photo = 0;
  float u = 0.0F, v = 0.0F;  ///< from the principal point, undistorted
  Vec3 place, normal;
  SeenLamp lamp{1.0F, 0.0F, 0.0F};
  std::array<SeenLamp, kLampSizes> lamp_of_size{};  ///< of lamps of those diameters
  float sky = 1.0F;                                 ///< of the hemisphere, by its cosine
  /// Mean direction of that times its share, over 2/3: an open place's normal.
  std::array<float, 3> sky_side{0.0F, 0.0F, 1.0F};
  float bounce = 0.0F;           ///< irradiance from the lit surface around
  float bounce_all = 0.0F;       ///< and from what that lights
  double light = 0.0;            ///< the chain's radiance as rendered
  std::array<float, 3> value{};  ///< behind the lens as rendered
  float du = 0.0F, dv = 0.0F;    ///< derivatives of it
  float duu = 0.0F, duv = 0.0F, dvv = 0.0F;
  std::array<float, 3> mean{};           ///< of its picture, behind the lens
  std::array<Surroundings, 3> around{};  ///< by channel, as measured: halo and veil included
};

/// A wave of an albedo map, -1 .. 1.
[[nodiscard]] double albedo_wave(std::size_t term, Vec3 place, const PhotoScene& scene);
/// Of a place to the camera along its axis: inverse of that depth over that of the scene's middle
/// in all photographs, less 1.
[[nodiscard]] double nearness(Vec3 place, std::size_t photo, const PhotoScene& scene);
/// The same over that of the scene's middle in its own photograph, less 1.
[[nodiscard]] double nearness_in_picture(Vec3 place, const PhotoInput& photo,
                                         const PhotoScene& scene);
/// Does the lens' focus spread places by their distance?
[[nodiscard]] bool spreads_by_distance(const PhotoState& state);
/// Variance that the lens' focus spreads a place by; below 0 where it is none (to first order).
[[nodiscard]] double focus_px2(Vec3 place, std::size_t photo, const PhotoState& state,
                               const PhotoScene& scene);
/// How far a feature of the scene moves in the picture, pixels.
[[nodiscard]] std::array<double, 2> displacement(const PhotoPixel& pixel, int channel,
                                                 const PhotoState& state, const PhotoScene& scene);
/// What a pixel shows more in a state whose features lie a little elsewhere than as rendered, to
/// second order.
[[nodiscard]] double shown_after(const PhotoPixel& pixel, int channel, const PhotoState& state,
                                 const PhotoState& rendered, const PhotoScene& scene);
/// Light behind the lens that red or blue gets more than green from surroundings of another colour;
/// of the stated albedo.
[[nodiscard]] double tint(const PhotoPixel& pixel, int channel, const PhotoState& state,
                          const PhotoScene& scene);
/// Square of the distance at which a photograph's lamp stands from its target, over that of the
/// first: what shines beside it is that much more in numbers of the same value under the lamp.
[[nodiscard]] double lamp_further(const PhotoInput& photo, const PhotoScene& scene);
/// Light of its own place that the lens spreads about it by one of kHaloWidths, nothing taken from
/// the place: as much more light, of which the halos then take their shares.
/// @pre all of the state's halo is added
void add_to_halo(PhotoState& state, std::size_t width, double share);
/// What the sensor makes of it.
/// @param around  of the picture with its halo, before the sensor
[[nodiscard]] double exposed(double behind_lens, double mean, const Surroundings& around,
                             double radius2, int channel, std::size_t photo,
                             const PhotoState& state);
/// From a number back to what came to the sensor, its veil included.
[[nodiscard]] double before_sensor(double number, int channel, std::size_t photo,
                                   const PhotoState& state);
/// Square of a pixel's radius over half the diagonal.
[[nodiscard]] double radius2(double u, double v, const PhotoInput& photo);
/// The same light comes to the lens; the same places to the same pixels.
[[nodiscard]] bool same_light(const PhotoState& a, const PhotoState& b);
/// A lamp stands where it stood, as wide.
[[nodiscard]] bool same_lamp(const PhotoState& a, const PhotoState& b, std::size_t lamp);
[[nodiscard]] bool same_stand(const PictureState& a, const PictureState& b);
[[nodiscard]] bool same_places(const PhotoState& a, const PhotoState& b);
/// Least radiance of the ambient light's sky above the horizon, of the lamp's; of one that is
/// brighter on one side less than nothing where no such sky can be.
[[nodiscard]] double darkest_sky(const PhotoState& state);
/// The same places are as sharp.
[[nodiscard]] bool same_sharpness(const PhotoState& a, const PhotoState& b);

/// The chain in a state, made ready for many pixels. Keeps references.
class PhotoChain {
 public:
  /// @param rendered  the state that pixels were rendered in
  PhotoChain(const PhotoState& state, const PhotoState& rendered, const PhotoScene& scene);
  /// Radiance of a place towards the camera, of a white Lambert surface's value at the lamp's
  /// target.
  [[nodiscard]] double radiance(const PhotoPixel& pixel) const;
  /// A pixel's value in a state close to the one that was rendered, to first order in what moves or
  /// blurs the picture.
  /// @param light  radiance() of the pixel in that state
  [[nodiscard]] double value(const PhotoPixel& pixel, int channel, double light) const;

 private:
  struct Lamp {
    Vec3 position, right, up;
    Vec3 aim;             ///< from the lamp to its target, of length 1
    double reference2;    ///< square of the distance at which its irradiance is known
    double least_cosine;  ///< of the angle off its axis
  };
  [[nodiscard]] double albedo_map(Vec3 place) const;

  const PhotoState& state_;
  const PhotoState& rendered_;
  const PhotoScene& scene_;
  std::vector<Lamp> lamps_;  ///< by photograph
  std::size_t waves_ = 0;    ///< of the albedo map, each way; 0: none
  bool moved_ = false, surge_ = false, specular_ = false;
};

/// One number that a cause changes.
struct PhotoParameter {
  std::string key;   ///< those of one key are the same
  std::string name;  ///< with its unit
  /// Derivatives are taken between these offsets from the rendered state.
  std::function<std::pair<double, double>(const PhotoState&, const PhotoScene&)> between;
  std::function<void(PhotoState&, double)> add;
  /// What is reported, of the parameter; empty: itself.
  std::function<double(double)> shown{};
  /// Of a factor on the surface's light: its derivative at a place; empty: others.
  std::function<double(Vec3 place, const PhotoScene&)> of_light{};
  /// It acts on this photograph alone; empty: it may act on all.
  std::optional<std::size_t> photo{};
};
struct PhotoForm {
  std::string law;
  std::vector<PhotoParameter> parameters;
  std::vector<std::pair<std::string, double>> fixed{};
  int sign = 0;  ///< 1 or -1: of the first parameter, the only physical one
  /// Of the first parameter: less is not told from what a rendering may be wrong by.
  double least = 0.0;
  bool all_of_sign = false;  ///< `sign` is that of all parameters
};

}  // namespace maquette::diagnosis
