// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/photo_chain.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "camera/reflectance.hpp"

namespace maquette::diagnosis {
namespace {

/// Light that comes back, over that of a white Lambert surface in full light (mu0 included).
double radiance_factor(const PhotoInput& photo, double albedo, const camera::Angles& a) {
  const camera::Bands bands{albedo, albedo, albedo};
  switch (photo.reflectance) {
    case PhotoInput::Law::lommel_seeliger:
      return camera::LommelSeeliger{bands}.radiance_factor(a)[0];
    case PhotoInput::Law::lunar_lambert:
      return camera::LunarLambert{bands, 0.5}.radiance_factor(a)[0];
    case PhotoInput::Law::lambert:
      break;
  }
  return a.front() ? albedo * a.mu0 : 0.0;
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

double radiance(const PhotoPixel& p, const PhotoState& s, const PhotoState& rendered,
                const PhotoScene& scene) {
  const PhotoInput& photo = scene.photos[p.photo];
  const std::size_t lamp = scene.lamp_of[p.photo];
  const Vec3 shift = s.lamp_mm[lamp] + s.lamp_refocused_mm[lamp];
  const Vec3 position = photo.lamp_position_mm + shift;
  const Vec3 aim = photo.lamp_target_mm - position;
  const Vec3 declared = photo.lamp_target_mm - photo.lamp_position_mm;
  const Vec3 kept = declared - s.lamp_refocused_mm[lamp];
  // Light comes from the middle of what is seen of the lamp.
  const SeenLamp of_lamp = seen(p, s.lamp_diameter_mm, rendered.lamp_diameter_mm, scene);
  Vec3 to = position - p.place;
  if (of_lamp.x_mm != 0.0F || of_lamp.y_mm != 0.0F) {
    const auto [right, up] = across(normalized(position - photo.lamp_target_mm));
    to += (1.0 / of_lamp.share) * (of_lamp.x_mm * right + of_lamp.y_mm * up);
  }
  const double squared = dot(to, to), distance = std::sqrt(squared);
  const Vec3 light = (1.0 / distance) * to;
  const double off_axis = -dot(light, aim) / norm(aim);
  const Vec3 view = normalized(photo.camera_position_mm + s.camera_mm[p.photo] - p.place);
  const camera::Angles angles{dot(p.normal, light), dot(p.normal, view), dot(light, view)};

  double albedo = photo.albedo * (1.0 + s.albedo);
  double map = 1.0;
  for (std::size_t k = 0; k < kAlbedoTerms; ++k)
    if (s.albedo_map[k] != 0.0) map += s.albedo_map[k] * albedo_wave(k, p.place, scene);
  albedo *= map;

  double e = 0.0;  // irradiance across the light, of that at the target
  if (off_axis >= std::cos(0.5 * photo.lamp_beam_deg * std::numbers::pi / 180.0))
    e = dot(kept, kept) / squared *
        (s.falloff == 0.0 ? 1.0 : std::pow(squared / dot(kept, kept), -0.5 * s.falloff)) *
        (s.beam_power == 0.0 ? 1.0 : std::pow(std::fmax(1e-9, off_axis), s.beam_power)) *
        static_cast<double>(of_lamp.share);
  double out = 0.0;
  if (angles.front() && e > 0.0) {
    double factor = radiance_factor(photo, albedo, angles) *
                    roughened(albedo, s.roughness_rad2, angles) *
                    roughened_short(s.roughness_short_rad2, angles);
    for (std::size_t k = 0; k < kSurgeWidths.size(); ++k)
      if (s.surge[k] != 0.0) {
        // tan(g / 2) by the half angle's formula
        const double c = std::clamp(angles.cos_phase, -1.0, 1.0);
        factor *= 1.0 + s.surge[k] / (1.0 + std::sqrt((1.0 - c) / std::fmax(1e-12, 1.0 + c)) /
                                                kSurgeWidths[k]);
      }
    for (std::size_t k = 0; k < kLobeExponents.size(); ++k)
      if (s.specular[k] != 0.0) {
        const Vec3 half = light + view;
        factor += s.specular[k] * angles.mu0 *
                  std::pow(std::fmax(0.0, dot(p.normal, half) / norm(half)), kLobeExponents[k]);
      }
    out += e * factor;
  }
  out += albedo * (s.ambient_sky * static_cast<double>(p.sky) + s.ambient_even +
                   s.bounce * static_cast<double>(p.bounce) +
                   s.bounce_all * static_cast<double>(p.bounce_all));
  return photo.exposure_scale * out;
}

double radius2(double u, double v, const PhotoInput& photo) {
  const double half = 0.5 * std::hypot(photo.width_px, photo.height_px);
  return (u * u + v * v) / (half * half);
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
  const Vec3 moved = from - s.camera_mm[p.photo] - cross(s.camera_rad[p.photo], from);
  const Vec3 seen = rotate(photo.model_from_camera.conjugate(), moved),
             was = rotate(photo.model_from_camera.conjugate(), from);
  return {radial * u + f * (seen.x / -seen.z - was.x / -was.z),
          radial * v - f * (seen.y / -seen.z - was.y / -was.z)};
}

double exposed(double behind_lens, double mean, double r2, int channel, const PhotoState& s) {
  double y = behind_lens * (1.0 + s.vignette_2 * r2 + s.vignette_4 * r2 * r2);
  y += s.veil * mean + s.veil_scattered * (mean - y);
  const double balance = channel == 0 ? s.red : channel == 2 ? s.blue : 0.0;
  y = y * (1.0 + s.exposure) * (1.0 + balance) + s.black;
  return s.gamma == 0.0 ? y : std::copysign(std::pow(std::abs(y), 1.0 + s.gamma), y);
}

bool same_light(const PhotoState& a, const PhotoState& b) {
  return a.albedo == b.albedo && a.albedo_map == b.albedo_map &&
         a.roughness_rad2 == b.roughness_rad2 && a.roughness_short_rad2 == b.roughness_short_rad2 &&
         a.surge == b.surge && a.specular == b.specular && a.bounce == b.bounce &&
         a.bounce_all == b.bounce_all && a.lamp_mm == b.lamp_mm &&
         a.lamp_refocused_mm == b.lamp_refocused_mm && a.lamp_diameter_mm == b.lamp_diameter_mm &&
         a.falloff == b.falloff && a.beam_power == b.beam_power && a.ambient_sky == b.ambient_sky &&
         a.ambient_even == b.ambient_even && a.camera_mm == b.camera_mm;
}

bool same_places(const PhotoState& a, const PhotoState& b) {
  return a.camera_mm == b.camera_mm && a.camera_rad == b.camera_rad && a.focal == b.focal &&
         a.radial_1 == b.radial_1 && a.radial_2 == b.radial_2 && a.red_scale == b.red_scale &&
         a.blue_scale == b.blue_scale;
}

double value_of(const PhotoPixel& p, int channel, double light, const PhotoState& s,
                const PhotoState& rendered, const PhotoScene& scene) {
  double y = static_cast<double>(p.value[static_cast<std::size_t>(channel)]) + light - p.light;
  const double uu = p.duu, uv = p.duv, vv = p.dvv;
  if (!same_places(s, rendered)) {
    const auto to = displacement(p, channel, s, scene),
               was = displacement(p, channel, rendered, scene);
    const double du = to[0] - was[0], dv = to[1] - was[1];
    y -= static_cast<double>(p.du) * du + static_cast<double>(p.dv) * dv;
    y += 0.5 * (uu * du * du + 2.0 * uv * du * dv + vv * dv * dv);
  }
  y += 0.5 * (s.blur_px2 - rendered.blur_px2) * (uu + vv);
  y += 0.5 * (uu * (s.smear_px2[0] - rendered.smear_px2[0]) +
              2.0 * uv * (s.smear_px2[1] - rendered.smear_px2[1]) +
              vv * (s.smear_px2[2] - rendered.smear_px2[2]));
  return exposed(y, static_cast<double>(p.mean[static_cast<std::size_t>(channel)]),
                 radius2(p.u, p.v, scene.photos[p.photo]), channel, s);
}

}  // namespace maquette::diagnosis
