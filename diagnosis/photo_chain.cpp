// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/photo_chain.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace maquette::diagnosis {
namespace {

/// Light that comes back, over that of a white Lambert surface in full light (mu0 included).
/// @pre a.front()
double radiance_factor(const PhotoInput& photo, const camera::Angles& a) {
  return photo.law ? camera::radiance_factor(*photo.law, a)[1] : photo.albedo * a.mu0;
}

/// What facets of a rough surface change of an even one's light.
double roughened(double albedo, double variance_rad2, const camera::Angles& a) {
  if (variance_rad2 == 0.0 || !a.front()) return 1.0;
  const camera::Bands bands{albedo, albedo, albedo};
  const auto of = [&](double variance) {
    return camera::OrenNayar{bands, 180.0 / std::numbers::pi * std::sqrt(variance)}.radiance_factor(
        a)[0];
  };
  return of(std::fmax(0.0, variance_rad2)) / of(0.0);
}

/// The same in the form that most programs have: without light between facets.
double roughened_short(double variance, const camera::Angles& a) {
  if (variance == 0.0 || !a.front()) return 1.0;
  const double v = std::fmax(0.0, variance);
  const double alpha_sine = std::fmax(a.sin_incidence(), a.sin_emission()),
               beta_cosine = std::fmax(a.mu0, a.mu),
               beta_tangent = std::sqrt(std::fmax(0.0, 1.0 - beta_cosine * beta_cosine)) /
                              std::fmax(1e-9, beta_cosine);
  return 1.0 - 0.5 * v / (v + 0.33) +
         0.45 * v / (v + 0.09) * std::fmax(0.0, a.cos_azimuth()) * alpha_sine * beta_tangent;
}

/// What is seen of the lamp, between the diameters that were traced.
SeenLamp seen(const PhotoPixel& p, double diameter_mm, double rendered_mm,
              const PhotoScene& scene) {
  if (diameter_mm == rendered_mm) return p.lamp;
  double below = rendered_mm, above = INFINITY;
  SeenLamp at_below = p.lamp, at_above = p.lamp;
  for (std::size_t k = 0; k < kLampSizes; ++k) {
    const double d = scene.lamp_sizes_mm[k];
    if (d <= diameter_mm && (d > below || below > diameter_mm)) {
      below = d;
      at_below = p.lamp_of_size[k];
    }
    if (d >= diameter_mm && d < above) {
      above = d;
      at_above = p.lamp_of_size[k];
    }
  }
  if (rendered_mm >= diameter_mm && rendered_mm < above) {
    above = rendered_mm;
    at_above = p.lamp;
  }
  if (!std::isfinite(above) || !(above > below)) return at_below;
  const auto t = static_cast<float>((diameter_mm - below) / (above - below));
  return {std::lerp(at_below.share, at_above.share, t), std::lerp(at_below.x_mm, at_above.x_mm, t),
          std::lerp(at_below.y_mm, at_above.y_mm, t)};
}

/// Radiance factor of the lobes. Of facets: D F G / (4 mu0 mu), Torrance & Sparrow, J. Opt. Soc.
/// Am. 57 (1967) 1105, doi:10.1364/JOSA.57.001105, with Blinn's distribution, grooves that are
/// mirrors of a dielectric (n = 1.5: Schlick, Comput. Graph. Forum 13 (1994) 233), over what it is
/// where light, view and normal are one; or with the distribution GGX and Smith's masking, Walter
/// et al., Eurographics Symposium on Rendering 2007, equations 33 and 34.
double shine(Vec3 normal, Vec3 light, Vec3 view, const PhotoState& s) {
  constexpr double kNormalReflectance = 0.04;
  const Vec3 half = normalized(light + view);
  const double h = std::fmax(1e-6, dot(normal, half)), mu0 = dot(normal, light),
               mu = std::fmax(1e-6, dot(normal, view)), v = std::fmax(1e-6, dot(view, half));
  const double fresnel = 1.0 + (1.0 / kNormalReflectance - 1.0) * std::pow(1.0 - v, 5),
               open = std::fmin(1.0, 2.0 * h * std::fmin(mu, mu0) / v);
  double sum = 0.0;
  for (std::size_t k = 0; k < kLobeExponents.size(); ++k)
    if (s.specular[k] != 0.0 || s.facets[k] != 0.0)
      sum += (s.specular[k] * mu0 + s.facets[k] * fresnel * open / mu) *
             std::pow(h, kLobeExponents[k]);
  const double to_light = std::fmax(1e-6, mu0);
  for (std::size_t k = 0; k < kFacetSlopes.size(); ++k) {
    if (s.ggx[k] == 0.0) continue;
    const double a2 = kFacetSlopes[k] * kFacetSlopes[k];
    // Shares of the facets that are seen from one side, 1 upright.
    const auto seen_from = [&](double c) {
      return 2.0 * c / (c + std::sqrt(a2 + (1.0 - a2) * c * c));
    };
    sum += s.ggx[k] * fresnel * seen_from(to_light) * seen_from(mu) / mu *
           std::pow(a2 / (1.0 + h * h * (a2 - 1.0)), 2);
  }
  return sum;
}

/// Of a place before the camera, along its axis.
double depth(Vec3 place, const PhotoInput& photo) {
  return dot(place - photo.camera_position_mm,
             rotate(photo.model_from_camera, Vec3{0.0, 0.0, -1.0}));
}

constexpr std::array<double, 3> kInFocus{};

double spread_at(const std::array<double, 3>& of, double x) {
  return of[0] + x * (of[1] + x * of[2]);
}

/// What a halo adds to a place with that light: each share of it leaves and comes from around.
/// Means are of a picture that has the halo already; of two Gaussians, one after the other, the
/// wider says where light comes from.
double of_halo(double light, const Surroundings& around, const PhotoState& s) {
  double all = 0.0;
  for (const double share : s.halo) all += share;
  if (all == 0.0) return 0.0;
  double more = 0.0;
  for (std::size_t k = 0; k < s.halo.size(); ++k) {
    double without = around[k];
    for (std::size_t j = 0; j < s.halo.size(); ++j)
      without -= s.halo[j] * static_cast<double>(around[std::max(j, k)]);
    more += s.halo[k] * (without / (1.0 - all) - light);
  }
  return more;
}

}  // namespace

std::array<Vec3, 2> across(Vec3 d) {
  const Vec3 right =
      normalized(std::abs(d.z) < 0.9 ? cross(d, {0.0, 0.0, 1.0}) : cross(d, {1.0, 0.0, 0.0}));
  return {right, cross(d, right)};
}

double albedo_wave(std::size_t term, Vec3 place, const PhotoScene& scene) {
  const auto i = static_cast<double>(term % (kAlbedoWaves + 1)),
             j = static_cast<double>(term / (kAlbedoWaves + 1));
  // Over the part and a tenth of it more on each side: a map need not be level at the part's rim.
  const auto at = [](double v, double low, double high) {
    return std::numbers::pi * (v - low + 0.1 * (high - low)) / (1.2 * (high - low));
  };
  return std::cos(i * at(place.x, scene.box.min.x, scene.box.max.x)) *
         std::cos(j * at(place.y, scene.box.min.y, scene.box.max.y));
}

double radius2(double u, double v, const PhotoInput& photo) {
  const double half = 0.5 * std::hypot(photo.width_px, photo.height_px);
  return (u * u + v * v) / (half * half);
}

double nearness(Vec3 place, std::size_t photo, const PhotoScene& scene) {
  double mean = 0.0;
  for (const PhotoInput& of : scene.photos) mean += 1.0 / depth(scene.middle(), of);
  mean /= static_cast<double>(scene.photos.size());
  return 1.0 / (mean * depth(place, scene.photos[photo])) - 1.0;
}

double nearness_in_picture(Vec3 place, const PhotoInput& photo, const PhotoScene& scene) {
  return depth(scene.middle(), photo) / depth(place, photo) - 1.0;
}

bool spreads_by_distance(const PhotoState& s) {
  return s.focus_px2 != kInFocus || s.focus_anew_px2 != kInFocus;
}

double focus_px2(Vec3 place, std::size_t photo, const PhotoState& s, const PhotoScene& scene) {
  double sum = 0.0;
  if (s.focus_px2 != kInFocus) sum += spread_at(s.focus_px2, nearness(place, photo, scene));
  if (s.focus_anew_px2 != kInFocus)
    sum += spread_at(s.focus_anew_px2, nearness_in_picture(place, scene.photos[photo], scene));
  return sum;
}

std::array<double, 2> displacement(const PhotoPixel& p, int channel, const PhotoState& s,
                                   const PhotoScene& scene) {
  const PhotoInput& photo = scene.photos[p.photo];
  const double f = photo.focal_length_mm * 1000.0 / photo.pixel_pitch_um;
  const double u = p.u, v = p.v, r2 = (u * u + v * v) / (f * f);
  const double colour = channel == 0 ? s.red_scale : channel == 2 ? s.blue_scale : 0.0;
  const double radial = s.focal + s.radial_1 * r2 + s.radial_2 * r2 * r2 + colour;
  // The place as the moved camera sees it, in its own frame (x right, y up, looks along -z).
  const Vec3 from = p.place - photo.camera_position_mm;
  const PictureState& own = s.picture[p.photo];
  const Vec3 moved = from - own.camera_mm - cross(own.camera_rad, from);
  const Vec3 seen = rotate(photo.model_from_camera.conjugate(), moved),
             was = rotate(photo.model_from_camera.conjugate(), from);
  return {radial * u + f * (seen.x / -seen.z - was.x / -was.z),
          radial * v - f * (seen.y / -seen.z - was.y / -was.z)};
}

double shown_after(const PhotoPixel& p, int channel, const PhotoState& state,
                   const PhotoState& rendered, const PhotoScene& scene) {
  const auto to = displacement(p, channel, state, scene),
             was = displacement(p, channel, rendered, scene);
  const double du = to[0] - was[0], dv = to[1] - was[1];
  return -static_cast<double>(p.du) * du - static_cast<double>(p.dv) * dv +
         0.5 * (static_cast<double>(p.duu) * du * du + 2.0 * static_cast<double>(p.duv) * du * dv +
                static_cast<double>(p.dvv) * dv * dv);
}

// What is fainter at the part leaves the rest the more of the exposure.
double lamp_further(const PhotoInput& photo, const PhotoScene& scene) {
  const auto squared = [](const PhotoInput& of) {
    const Vec3 to = of.lamp_position_mm - of.lamp_target_mm;
    return dot(to, to);
  };
  return squared(photo) / squared(scene.photos.front());
}

// (1 + all) (1 - sum h) is 1 with h = added / (1 + all).
void add_to_halo(PhotoState& s, std::size_t width, double share) {
  const double more = (1.0 + s.halo_added + share) / (1.0 + s.halo_added);
  for (double& h : s.halo) h /= more;
  s.halo_added += share;
  s.halo[width] += share / (1.0 + s.halo_added);
  for (PictureState& own : s.picture) own.exposure = (1.0 + own.exposure) * more - 1.0;
}

double tint(const PhotoPixel& p, int channel, const PhotoState& s, const PhotoScene& scene) {
  const double more = channel == 0 ? s.ambient_red : channel == 2 ? s.ambient_blue : 0.0;
  if (more == 0.0) return 0.0;
  const PhotoInput& photo = scene.photos[p.photo];
  return photo.exposure_scale * photo.albedo * more * static_cast<double>(p.sky);
}

double exposed(double behind_lens, double mean, const Surroundings& around, double r2, int channel,
               std::size_t photo, const PhotoState& s) {
  double y = behind_lens * (1.0 + s.vignette_2 * r2 + s.vignette_4 * r2 * r2);
  y += s.veil * mean + s.veil_scattered * (mean - y) + of_halo(y, around, s);
  const PictureState& own = s.picture[photo];
  const double balance = channel == 0 ? own.red : channel == 2 ? own.blue : 0.0;
  y = y * (1.0 + own.exposure) * (1.0 + balance) + own.black;
  return s.gamma == 0.0 ? y : std::copysign(std::pow(std::abs(y), 1.0 + s.gamma), y);
}

double before_sensor(double number, int channel, std::size_t photo, const PhotoState& s) {
  const PictureState& own = s.picture[photo];
  const double balance = channel == 0 ? own.red : channel == 2 ? own.blue : 0.0;
  const double linear =
      s.gamma == 0.0 ? number
                     : std::copysign(std::pow(std::abs(number), 1.0 / (1.0 + s.gamma)), number);
  return (linear - own.black) / ((1.0 + own.exposure) * (1.0 + balance));
}

bool same_light(const PhotoState& a, const PhotoState& b) {
  return a.albedo == b.albedo && a.albedo_map == b.albedo_map &&
         a.roughness_rad2 == b.roughness_rad2 && a.roughness_short_rad2 == b.roughness_short_rad2 &&
         a.surge == b.surge && a.specular == b.specular && a.facets == b.facets && a.ggx == b.ggx &&
         a.bounce == b.bounce && a.bounce_all == b.bounce_all && a.lamp_mm == b.lamp_mm &&
         a.lamp_refocused_mm == b.lamp_refocused_mm && a.lamp_diameter_mm == b.lamp_diameter_mm &&
         a.falloff == b.falloff && a.beam_power == b.beam_power && a.ambient_sky == b.ambient_sky &&
         a.ambient_even == b.ambient_even && a.ambient_steady == b.ambient_steady &&
         a.ambient_side == b.ambient_side &&
         std::equal(a.picture.begin(), a.picture.end(), b.picture.begin(),
                    [](const PictureState& x, const PictureState& y) {
                      return x.camera_mm == y.camera_mm;
                    });
}

bool same_lamp(const PhotoState& a, const PhotoState& b, std::size_t lamp) {
  return a.lamp_mm[lamp] == b.lamp_mm[lamp] &&
         a.lamp_refocused_mm[lamp] == b.lamp_refocused_mm[lamp] &&
         a.lamp_diameter_mm == b.lamp_diameter_mm;
}

bool same_stand(const PictureState& a, const PictureState& b) {
  return a.camera_mm == b.camera_mm && a.camera_rad == b.camera_rad;
}

// Radiance towards d is sky - side.z + 1.5 side . d: radiance() and PhotoViews::look_around().
double darkest_sky(const PhotoState& s) {
  const Vec3 side = s.ambient_side;
  const double level = std::hypot(side.x, side.y);
  return s.ambient_sky - side.z - 1.5 * (side.z > 0.0 ? level : std::hypot(level, side.z));
}

bool same_places(const PhotoState& a, const PhotoState& b) {
  return std::equal(a.picture.begin(), a.picture.end(), b.picture.begin(), same_stand) &&
         a.focal == b.focal && a.radial_1 == b.radial_1 && a.radial_2 == b.radial_2 &&
         a.red_scale == b.red_scale && a.blue_scale == b.blue_scale;
}

bool same_sharpness(const PhotoState& a, const PhotoState& b) {
  return a.focus_px2 == b.focus_px2 && a.focus_anew_px2 == b.focus_anew_px2 &&
         std::equal(a.picture.begin(), a.picture.end(), b.picture.begin(),
                    [](const PictureState& x, const PictureState& y) {
                      return x.blur_px2 == y.blur_px2 && x.smear_px2 == y.smear_px2;
                    });
}

PhotoChain::PhotoChain(const PhotoState& state, const PhotoState& rendered, const PhotoScene& scene)
    : state_(state), rendered_(rendered), scene_(scene), moved_(!same_places(state, rendered)) {
  for (std::size_t k = 0; k < scene.photos.size(); ++k) {
    const PhotoInput& photo = scene.photos[k];
    const Vec3 &moved = state.lamp_mm[scene.lamp_of[k]],
               &refocused = state.lamp_refocused_mm[scene.lamp_of[k]];
    Lamp lamp;
    lamp.position = photo.lamp_position_mm + moved + refocused;
    lamp.aim = normalized(photo.lamp_target_mm - lamp.position);
    const auto axes = across(-lamp.aim);
    lamp.right = axes[0];
    lamp.up = axes[1];
    const Vec3 kept = photo.lamp_target_mm - photo.lamp_position_mm - refocused;
    lamp.reference2 = dot(kept, kept);
    lamp.least_cosine = std::cos(0.5 * photo.lamp_beam_deg * std::numbers::pi / 180.0);
    lamps_.push_back(lamp);
  }
  for (std::size_t k = 0; k < kAlbedoTerms; ++k)
    if (state.albedo_map[k] != 0.0)
      waves_ = std::max({waves_, k % (kAlbedoWaves + 1), k / (kAlbedoWaves + 1)});
  const auto any = [](const auto& values) {
    return std::any_of(values.begin(), values.end(), [](double v) { return v != 0.0; });
  };
  surge_ = any(state.surge);
  specular_ = any(state.specular) || any(state.facets) || any(state.ggx);
}

double PhotoChain::albedo_map(Vec3 place) const {
  if (waves_ == 0) return 1.0;
  // cos((i + 1) a) = 2 cos(a) cos(i a) - cos((i - 1) a)
  std::array<double, kAlbedoWaves + 1> x{}, y{};
  x[0] = y[0] = 1.0;
  x[1] = albedo_wave(1, place, scene_);
  y[1] = albedo_wave(kAlbedoWaves + 1, place, scene_);
  for (std::size_t i = 2; i <= waves_; ++i) {
    x[i] = 2.0 * x[1] * x[i - 1] - x[i - 2];
    y[i] = 2.0 * y[1] * y[i - 1] - y[i - 2];
  }
  double map = 1.0;
  for (std::size_t j = 0; j <= waves_; ++j) {
    double row = 0.0;
    for (std::size_t i = 0; i <= waves_; ++i)
      row += state_.albedo_map[j * (kAlbedoWaves + 1) + i] * x[i];
    map += row * y[j];
  }
  return map;
}

double PhotoChain::radiance(const PhotoPixel& p) const {
  const PhotoState& s = state_;
  const PhotoInput& photo = scene_.photos[p.photo];
  const Lamp& lamp = lamps_[p.photo];
  // Light comes from the middle of what is seen of the lamp.
  const SeenLamp of_lamp = seen(p, s.lamp_diameter_mm, rendered_.lamp_diameter_mm, scene_);
  Vec3 to = lamp.position - p.place;
  if (of_lamp.x_mm != 0.0F || of_lamp.y_mm != 0.0F)
    to += (1.0 / of_lamp.share) * (of_lamp.x_mm * lamp.right + of_lamp.y_mm * lamp.up);
  const double squared = dot(to, to);
  const Vec3 light = (1.0 / std::sqrt(squared)) * to;
  const double off_axis = -dot(light, lamp.aim);
  const Vec3 view = normalized(photo.camera_position_mm + s.picture[p.photo].camera_mm - p.place);
  const camera::Angles angles{dot(p.normal, light), dot(p.normal, view), dot(light, view)};

  const double relative = (1.0 + s.albedo) * albedo_map(p.place), albedo = photo.albedo * relative;
  double e = 0.0;  // irradiance across the light, of that at the target
  if (off_axis >= lamp.least_cosine)
    e = lamp.reference2 / squared *
        (s.falloff == 0.0 ? 1.0 : std::pow(squared / lamp.reference2, -0.5 * s.falloff)) *
        (s.beam_power == 0.0 ? 1.0 : std::pow(std::fmax(1e-9, off_axis), s.beam_power)) *
        static_cast<double>(of_lamp.share);
  double out = 0.0;
  if (angles.front() && e > 0.0) {
    double factor = relative * radiance_factor(photo, angles) *
                    roughened(albedo, s.roughness_rad2, angles) *
                    roughened_short(s.roughness_short_rad2, angles);
    for (std::size_t k = 0; surge_ && k < kSurgeWidths.size(); ++k)
      if (s.surge[k] != 0.0) {
        // tan(g / 2) by the half angle's formula
        const double c = std::clamp(angles.cos_phase, -1.0, 1.0);
        factor *= 1.0 + s.surge[k] / (1.0 + std::sqrt((1.0 - c) / std::fmax(1e-12, 1.0 + c)) /
                                                kSurgeWidths[k]);
      }
    if (specular_) factor += shine(p.normal, light, view, s);
    out += e * factor;
  }
  const auto toward = [&](std::size_t axis) { return static_cast<double>(p.sky_side[axis]); };
  double even = s.ambient_sky;
  if (s.ambient_steady != 0.0) even += s.ambient_steady * lamp_further(photo, scene_);
  const double whole = p.sky, sky = even * whole + s.ambient_side.x * toward(0) +
                                    s.ambient_side.y * toward(1) +
                                    s.ambient_side.z * (toward(2) - whole);
  out += albedo * (sky + s.ambient_even + s.bounce * static_cast<double>(p.bounce) +
                   s.bounce_all * static_cast<double>(p.bounce_all));
  return photo.exposure_scale * out;
}

double PhotoChain::value(const PhotoPixel& p, int channel, double light) const {
  const PhotoState& s = state_;
  double y = static_cast<double>(p.value[static_cast<std::size_t>(channel)]) + light - p.light +
             tint(p, channel, s, scene_) - tint(p, channel, rendered_, scene_);
  const double uu = p.duu, uv = p.duv, vv = p.dvv;
  if (moved_) y += shown_after(p, channel, s, rendered_, scene_);
  const PictureState &own = s.picture[p.photo], &was = rendered_.picture[p.photo];
  const double blur = own.blur_px2 - was.blur_px2 + focus_px2(p.place, p.photo, s, scene_) -
                      focus_px2(p.place, p.photo, rendered_, scene_);
  y += 0.5 * blur * (uu + vv);
  y += 0.5 * (uu * (own.smear_px2[0] - was.smear_px2[0]) +
              2.0 * uv * (own.smear_px2[1] - was.smear_px2[1]) +
              vv * (own.smear_px2[2] - was.smear_px2[2]));
  const auto at = static_cast<std::size_t>(channel);
  return exposed(y, static_cast<double>(p.mean[at]), p.around[at],
                 radius2(p.u, p.v, scene_.photos[p.photo]), channel, p.photo, s);
}

}  // namespace maquette::diagnosis
