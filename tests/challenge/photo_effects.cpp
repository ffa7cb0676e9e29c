// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "challenge/photo_case.hpp"

namespace challenge {

const std::vector<std::string>& photo_hideable() {
  static const std::vector<std::string> all{"photo.exposure",
                                            "photo.white_balance",
                                            "photo.black_level",
                                            "photo.gamma",
                                            "photo.vignetting",
                                            "photo.focal_length",
                                            "photo.radial_distortion",
                                            "photo.chromatic_aberration",
                                            "photo.defocus",
                                            "photo.motion_blur",
                                            "photo.veiling_glare",
                                            "photo.pose",
                                            "photo.noise",
                                            "lamp.position",
                                            "lamp.size",
                                            "lamp.falloff",
                                            "lamp.ambient",
                                            "surface.albedo",
                                            "surface.roughness",
                                            "surface.opposition",
                                            "surface.specular",
                                            "surface.interreflection"};
  return all;
}
const std::vector<std::string>& photo_nameless() {
  static const std::vector<std::string> all{"spots", "dust", "ghost", "hair", "flicker", "leak"};
  return all;
}

namespace {

double half_diagonal(const PhotoCamera& c) {
  return 0.5 * std::hypot(c.width, c.height);
}

Vec3 unit(Draw& d) {
  const double z = d.uniform(-1, 1), a = d.uniform(0, 2 * kPi), r = std::sqrt(1 - z * z);
  return {r * std::cos(a), r * std::sin(a), z};
}

/// Even mottle of a surface: waves of random direction, root mean square 1 over all seeds.
Field mottle(double side, double step, double length, Draw& d) {
  Field f = make_field(static_cast<int>(std::lround(side / step)) + 1, step);
  constexpr int kWaves = 60;
  for (int i = 0; i < kWaves; ++i) {
    const double kx = d.normal() / length, ky = d.normal() / length, phase = d.uniform(0, 2 * kPi);
    for (int r = 0; r < f.n; ++r)
      for (int c = 0; c < f.n; ++c)
        f.at(r, c) += std::sqrt(2.0 / kWaves) * std::cos(kx * c * step + ky * r * step + phase);
  }
  return f;
}

double smooth_step(double x) {
  const double t = std::clamp(x, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

/// The same even box twice each way.
Plane soft(const Plane& from, int reach) {
  Plane a = from;
  for (int turn = 0; turn < 4; ++turn) {
    Plane b = a;
    const bool rows = turn % 2 == 0;
    const int lines = rows ? a.height : a.width, length = rows ? a.width : a.height;
    const auto get = [&](int line, int i) { return rows ? a.at(line, i) : a.at(i, line); };
    for (int line = 0; line < lines; ++line) {
      double sum = 0;
      for (int i = -reach; i <= reach; ++i)
        sum += static_cast<double>(get(line, std::clamp(i, 0, length - 1)));
      for (int i = 0; i < length; ++i) {
        (rows ? b.at(line, i) : b.at(i, line)) = static_cast<float>(sum / (2 * reach + 1));
        sum += static_cast<double>(get(line, std::min(i + reach + 1, length - 1)) -
                                   get(line, std::max(i - reach, 0)));
      }
    }
    a = std::move(b);
  }
  return a;
}

template <class Factor>
void dim(Picture& picture, const Factor& factor) {
  for (int r = 0; r < picture[0].height; ++r)
    for (int c = 0; c < picture[0].width; ++c) {
      const double f = factor(c + 0.5, r + 0.5);
      if (f != 1)
        for (Plane& plane : picture) plane.at(r, c) *= static_cast<float>(f);
    }
}

void hide_nameless(const std::string& e, double size, PhotoWorld& w, Draw& d, PhotoHidden& h) {
  const int width = w.photos[0].camera.width, height = w.photos[0].camera.height;
  const double side = w.design.step * (w.design.n - 1);
  if (e == "spots") {
    // Dirt on the surface: seen from all sides at the same place, edges a few tenths of a mm.
    const int count = static_cast<int>(d.uniform(1, 4));
    Field f = make_field(static_cast<int>(std::lround(side / 0.2)) + 1, 0.2);
    std::fill(f.z.begin(), f.z.end(), 1.0);
    const double loss = size * d.uniform(0.15, 0.35);
    for (int k = 0; k < count; ++k) {
      const double x = d.uniform(0.2, 0.8) * side, y = d.uniform(0.2, 0.8) * side,
                   radius = d.uniform(3, 7), edge = d.uniform(0.4, 1.0);
      for (int r = 0; r < f.n; ++r)
        for (int c = 0; c < f.n; ++c)
          f.at(r, c) *=
              1 - loss * (1 - smooth_step((std::hypot(c * f.step - x, r * f.step - y) - radius) /
                                          edge));
    }
    w.paint.factor = std::move(f);
    h.parameters = {{"loss", loss}, {"count", count}};
  } else if (e == "dust") {
    const int count = static_cast<int>(d.uniform(2, 6));
    const double loss = std::min(0.9, size * d.uniform(0.1, 0.25));
    std::vector<std::array<double, 3>> blobs;
    for (int k = 0; k < count; ++k)
      blobs.push_back(
          {d.uniform(0.2, 0.8) * width, d.uniform(0.2, 0.8) * height, d.uniform(10, 25)});
    w.stains.emplace_back([=](Picture& p, int) {
      dim(p, [&](double x, double y) {
        double f = 1;
        for (const auto& b : blobs)
          f *= 1 - loss * (1 - smooth_step((std::hypot(x - b[0], y - b[1]) / b[2] - 0.6) / 0.6));
        return f;
      });
    });
    h.parameters = {{"loss", loss}, {"count", count}};
  } else if (e == "ghost") {
    const double share = size * d.uniform(0.015, 0.04), x0 = d.uniform(-60, 60),
                 y0 = d.uniform(-60, 60);
    const int reach = static_cast<int>(d.uniform(4, 15));
    w.stains.emplace_back([=](Picture& p, int) {
      for (Plane& plane : p) {
        const Plane image = soft(plane, reach);
        for (int r = 0; r < plane.height; ++r)
          for (int c = 0; c < plane.width; ++c) {
            const int cc = plane.width - 1 - c + static_cast<int>(x0),
                      rr = plane.height - 1 - r + static_cast<int>(y0);
            if (cc >= 0 && cc < plane.width && rr >= 0 && rr < plane.height)
              plane.at(r, c) += static_cast<float>(share) * image.at(rr, cc);
          }
      }
    });
    h.parameters = {{"share", share}};
  } else if (e == "hair") {
    const double loss = std::min(0.9, size * d.uniform(0.3, 0.6)), wide = d.uniform(1.0, 2.0);
    std::vector<std::array<double, 2>> line;
    double x = d.uniform(0.3, 0.7) * width, y = d.uniform(0.3, 0.7) * height,
           angle = d.uniform(0, 2 * kPi), turn = 0;
    for (int k = 0; k < static_cast<int>(d.uniform(150, 300)); ++k) {
      line.push_back({x, y});
      turn += 0.004 * d.normal();
      turn = std::clamp(turn, -0.03, 0.03);
      angle += turn;
      x += std::cos(angle);
      y += std::sin(angle);
    }
    w.stains.emplace_back([=](Picture& p, int) {
      Plane shade = make_plane(p[0].width, p[0].height);
      const int reach = static_cast<int>(std::ceil(wide)) + 1;
      for (const auto& q : line)
        for (int r = static_cast<int>(q[1]) - reach; r <= static_cast<int>(q[1]) + reach; ++r)
          for (int c = static_cast<int>(q[0]) - reach; c <= static_cast<int>(q[0]) + reach; ++c)
            if (r >= 0 && c >= 0 && r < shade.height && c < shade.width)
              shade.at(r, c) = std::max(
                  shade.at(r, c),
                  static_cast<float>(
                      loss *
                      (1 - smooth_step(std::hypot(c + 0.5 - q[0], r + 0.5 - q[1]) - wide + 0.5))));
      dim(p, [&](double px, double py) {
        return 1 - static_cast<double>(shade.at(static_cast<int>(py), static_cast<int>(px)));
      });
    });
    h.parameters = {{"loss", loss}, {"length_px", static_cast<double>(line.size())}};
  } else if (e == "flicker") {
    // Rows read one after the other under a lamp that pulses; each photograph at another moment.
    const double a = size * d.uniform(0.02, 0.05), rows = d.uniform(60, 250);
    std::array<double, kPhotos> phase{};
    for (double& p : phase) p = d.uniform(0, 2 * kPi);
    w.stains.emplace_back([=](Picture& p, int photo) {
      dim(p, [&](double, double y) {
        return 1 + a * std::sin(2 * kPi * y / rows + phase[static_cast<std::size_t>(photo)]);
      });
    });
    h.parameters = {{"share", a}, {"period_px", rows}};
  } else if (e == "leak") {
    // Light that gets past the lens: a wedge from one corner, in all photographs the same.
    const double a = size * d.uniform(0.01, 0.03), reach = d.uniform(150, 350),
                 x0 = d.sign() > 0 ? width : 0, y0 = d.uniform(0, height);
    w.stains.emplace_back([=](Picture& p, int) {
      for (Plane& plane : p)
        for (int r = 0; r < plane.height; ++r)
          for (int c = 0; c < plane.width; ++c)
            plane.at(r, c) += static_cast<float>(
                a * std::exp(-std::hypot(c + 0.5 - x0, 0.5 * (r + 0.5 - y0)) / reach));
    });
    h.parameters = {{"value", a}};
  } else {
    throw std::runtime_error("no effect of photographs: " + e);
  }
}

}  // namespace

PhotoHidden hide_in_photos(const std::string& e, double size, PhotoWorld& w, Draw& d) {
  PhotoHidden h;
  h.effect = e;
  h.size = size;
  // All photographs, or one of them where that can be.
  const bool single = d.uniform(0, 1) < 0.3;
  const int only = static_cast<int>(d.uniform(0, kPhotos));
  const auto each = [&](bool may_be_one, const auto& change) {
    const bool one = may_be_one && single;
    if (one) h.photographs = std::to_string(only + 1);
    for (int k = 0; k < kPhotos; ++k)
      if (!one || k == only) change(w.photos[static_cast<std::size_t>(k)], k);
  };
  const PhotoCamera& camera = w.photos[0].camera;
  const double corner = half_diagonal(camera), tangent = corner / camera.focal_px;
  const double side = w.design.step * (w.design.n - 1);

  if (e == "photo.exposure") {
    const double gain = 1 + size * d.size(0.03, 0.12);
    each(true, [&](Photo& p, int) { p.sensor.exposure *= gain; });
    h.parameters = {{"gain", gain}};
  } else if (e == "photo.white_balance") {
    // In light (a filter) or in numbers (a gain): the noise tells them apart, nothing else.
    const bool filter = d.uniform(0, 1) < 0.5;
    const double way = d.sign(), red = 1 + size * way * d.uniform(0.03, 0.15),
                 blue = 1 - size * way * d.uniform(0.03, 0.15);
    each(false, [&](Photo& p, int) {
      auto& bands = filter ? p.sensor.filter : p.sensor.gain;
      bands[0] *= red;
      bands[2] *= blue;
    });
    h.parameters = {{"red", red}, {"blue", blue}, {"in_light", filter ? 1.0 : 0.0}};
  } else if (e == "photo.black_level") {
    const double black = size * d.uniform(0.006, 0.03) * (d.uniform(0, 1) < 0.7 ? 1 : -1);
    each(false, [&](Photo& p, int) { p.sensor.black += black; });
    h.parameters = {{"value", black}};
  } else if (e == "photo.gamma") {
    const double exponent = std::exp(size * d.size(0.05, 0.25));
    each(false, [&](Photo& p, int) { p.sensor.gamma *= exponent; });
    h.parameters = {{"exponent", exponent}};
  } else if (e == "photo.vignetting") {
    const double fall = size * d.uniform(0.06, 0.25), share4 = d.uniform(0, 0.5);
    each(false, [&](Photo& p, int) {
      p.lens.fall2 -= fall * (1 - share4);
      p.lens.fall4 -= fall * share4;
    });
    h.parameters = {{"corner", fall}, {"share_of_fourth_power", share4}};
  } else if (e == "photo.focal_length") {
    const double ratio = 1 + size * d.size(0.0015, 0.006);
    each(false, [&](Photo& p, int) { p.camera.focal_px *= ratio; });
    h.parameters = {{"ratio", ratio}};
  } else if (e == "photo.radial_distortion") {
    const double px = size * d.size(1.0, 4.0), k1 = px / corner / (tangent * tangent);
    each(false, [&](Photo& p, int) { p.camera.k1 += k1; });
    h.parameters = {{"k1", k1}, {"corner_px", px}};
  } else if (e == "photo.chromatic_aberration") {
    const double way = d.sign(), red = size * way * d.uniform(0.5, 1.6),
                 blue = -size * way * d.uniform(0.5, 1.6);
    const bool cubic = d.uniform(0, 1) < 0.3;
    each(false, [&](Photo& p, int) {
      // A scale of each band; or what grows with the third power, as wide lenses have it.
      if (cubic) {
        p.camera.band_k1[0] += red / corner / (tangent * tangent);
        p.camera.band_k1[2] += blue / corner / (tangent * tangent);
      } else {
        p.camera.band_scale[0] *= 1 + red / corner;
        p.camera.band_scale[2] *= 1 + blue / corner;
      }
    });
    h.parameters = {{"red_corner_px", red}, {"blue_corner_px", blue}, {"cubic", cubic ? 1.0 : 0.0}};
  } else if (e == "photo.defocus") {
    const double disc = size * d.uniform(2.0, 6.0);
    const double kind = d.uniform(0, 1), f_number = d.uniform(4, 8), way = d.sign();
    if (kind < 0.5) {
      each(true, [&](Photo& p, int) { p.lens.defocus_px = disc; });
      h.parameters = {{"disc_px", disc}, {"sigma_px", disc / 4}};
    } else {
      // A thin lens that is focused once, before or behind the part: that disc in the part's middle
      // as the mean camera sees it, others nearer and farther.
      const double pupil = w.focal_mm / f_number;
      double inverse = 0;
      for (const Photo& p : w.photos)
        inverse += 1 / maquette::norm(p.camera.place - Vec3{side / 2, side / 2, 20}) / kPhotos;
      const double focus = 1 / (inverse + way * disc / (camera.focal_px * pupil));
      each(false, [&](Photo& p, int) {
        p.lens.pupil_mm = pupil;
        p.lens.focus_mm = focus;
      });
      h.parameters = {{"disc_in_the_middle_px", disc}, {"focus_mm", focus}, {"pupil_mm", pupil}};
    }
  } else if (e == "photo.motion_blur") {
    const double length = size * d.uniform(2.5, 7.0), angle = d.uniform(0, kPi);
    const bool turning = d.uniform(0, 1) < 0.4;
    const double roll = d.uniform(-1, 1);
    if (turning) {
      // A stand that swings: mostly about axes across the view, as far about it.
      const double rad = length / camera.focal_px;
      each(true, [&](Photo& p, int) {
        p.lens.turning_rad = rad * Vec3{std::sin(angle), std::cos(angle), roll};
      });
      h.parameters = {{"length_in_the_middle_px", length},
                      {"angle_deg", angle * 180 / kPi},
                      {"roll_mrad", 1e3 * rad * roll}};
    } else {
      each(true, [&](Photo& p, int) {
        p.lens.motion_px = {length * std::cos(angle), length * std::sin(angle)};
      });
      h.parameters = {{"length_px", length}, {"angle_deg", angle * 180 / kPi}};
    }
  } else if (e == "photo.veiling_glare") {
    const double share = size * d.uniform(0.02, 0.08);
    each(false, [&](Photo& p, int) { p.lens.veil = share; });
    h.parameters = {{"share", share}};
  } else if (e == "photo.pose") {
    double shift_mm = 0, turn_mrad = 0;
    // Drawn for all whichever are moved. Each photograph stands elsewhere; or all of one pose
    // alike, taken from one stand under one lamp after the other.
    std::array<std::array<Vec3, 2>, kPhotos> moves;
    for (auto& m : moves) m = {d.uniform(0.3, 1.5) * unit(d), d.uniform(0.3, 1.5) * unit(d)};
    const double stands = d.uniform(0, 1);
    const int stand = static_cast<int>(d.uniform(0, kPoses));
    each(stands >= 0.5, [&](Photo& p, int k) {
      // Half on stands; half of these all but one where they should be.
      if (stands < 0.25 && k / kLamps != stand) return;
      const auto& m = moves[static_cast<std::size_t>(stands < 0.5 ? k / kLamps : k)];
      const double turn = size * maquette::norm(m[1]);
      p.camera.place += size * m[0];
      p.camera.turn = maquette::normalized(
          maquette::rotation_about(maquette::normalized(m[1]), 1e-3 * turn) * p.camera.turn);
      shift_mm = std::max(shift_mm, size * maquette::norm(m[0]));
      turn_mrad = std::max(turn_mrad, turn);
    });
    if (stands < 0.25) h.photographs = "pose " + std::to_string(stand + 1);
    if (stands >= 0.25 && stands < 0.5) h.photographs = "all, by stand";
    h.parameters = {{"largest_shift_mm", shift_mm}, {"largest_turn_mrad", turn_mrad}};
  } else if (e == "photo.noise") {
    const double kind = d.uniform(0, 1), much = d.uniform(0, 1);
    if (kind < 0.4) {
      const double factor = 1 + size * (1 + 4 * much);
      each(false, [&](Photo& p, int) { p.sensor.read_noise_e *= factor; });
      h.parameters = {{"read_noise_factor", factor}};
    } else if (kind < 0.8) {
      const double factor = 1 + size * (0.5 + 2 * much);
      each(false, [&](Photo& p, int) { p.sensor.full_well_e /= factor; });
      // Read noise is told in numbers: the same number of fewer electrons.
      each(false, [&](Photo& p, int) { p.sensor.read_noise_e /= factor; });
      h.parameters = {{"shot_variance_factor", factor}};
    } else {
      const double share = size * (0.006 + 0.014 * much);
      each(false, [&](Photo& p, int) { p.sensor.pixels = share; });
      h.parameters = {{"pixel_sensitivity_sigma", share}};
    }
  } else if (e == "lamp.position") {
    // By an angle as seen from the target: one lamp, or each its own way. Its power is known, or
    // the exposure was set where it stands.
    const int which = static_cast<int>(d.uniform(0, kLamps));
    const double angle = size * d.uniform(0.01, 0.05);
    const Vec3 way = unit(d);
    const bool both = d.uniform(0, 1) < 0.4, anew = d.uniform(0, 1) < 0.35;
    const double other_angle = size * d.uniform(0.01, 0.05);
    const Vec3 other_way = unit(d);
    std::array<Vec3, kLamps> moves;
    for (int k = 0; k < kPhotos; ++k)
      if (both || k % kLamps == which) {
        PhotoLamp& lamp = w.photos[static_cast<std::size_t>(k)].lamp;
        Vec3& move = moves[static_cast<std::size_t>(k % kLamps)];
        move = k % kLamps == which ? angle * lamp.reference * way
                                   : other_angle * lamp.reference * other_way;
        lamp.place += move;
        if (anew) lamp.reference = maquette::norm(lamp.place - lamp.target);
      }
    const Vec3 move = moves[static_cast<std::size_t>(which)],
               other = moves[static_cast<std::size_t>(1 - which)];
    h.photographs = both ? "each lamp" : "lamp " + std::to_string(which + 1);
    h.parameters = {{"dx_mm", move.x}, {"dy_mm", move.y}, {"dz_mm", move.z}};
    if (both)
      h.parameters.insert(
          h.parameters.end(),
          {{"other_dx_mm", other.x}, {"other_dy_mm", other.y}, {"other_dz_mm", other.z}});
    h.parameters.emplace_back("exposed_anew", anew ? 1.0 : 0.0);
  } else if (e == "lamp.size") {
    // As an angle: a penumbra is that times the distance from what casts it.
    const double angle = size * d.uniform(0.03, 0.1), distance = w.photos[0].lamp.reference;
    each(false, [&](Photo& p, int) { p.lamp.diameter = angle * distance; });
    h.parameters = {{"diameter_mm", angle * distance}};
  } else if (e == "lamp.falloff") {
    if (d.uniform(0, 1) < 0.5) {
      const double power = 2 + size * d.size(0.3, 1.0);
      each(false, [&](Photo& p, int) { p.lamp.power = power; });
      h.parameters = {{"distance_power", power}};
    } else {
      // The beam's brightness at 80 mm from its axis at the nearer lamp.
      const double loss = std::min(0.9, size * d.uniform(0.04, 0.15));
      double near = 1e9;
      for (const Photo& p : w.photos) near = std::min(near, p.lamp.reference);
      const double width = 80.0 / near / std::sqrt(-2 * std::log(1 - loss));
      each(false, [&](Photo& p, int) { p.lamp.hot_spot = width; });
      h.parameters = {{"beam_sigma_deg", width * 180 / kPi}, {"loss_at_80_mm", loss}};
    }
  } else if (e == "lamp.ambient") {
    // An even room, a bright ceiling, a wall with windows; and what is not of the lamp's colour.
    const double share = size * d.uniform(0.01, 0.05), room = d.uniform(0, 1),
                 azimuth = d.uniform(0, 2 * kPi), side_share = d.uniform(0.3, 0.8),
                 colour = d.uniform(0, 1) < 0.4 ? d.size(0.1, 0.4) : 0;
    w.ambient = {share * (1 - colour), share, share * (1 + colour)};
    if (room > 0.7)
      w.room.side = side_share * Vec3{std::cos(azimuth), std::sin(azimuth), 0};
    else if (room > 0.4)
      w.room.zenith = 1;
    h.parameters = {{"share", share},
                    {"ceiling", w.room.zenith},
                    {"side", maquette::norm(w.room.side)},
                    {"blue_over_green_less_1", colour}};
  } else if (e == "surface.albedo") {
    const double sigma = size * d.uniform(0.015, 0.05), length = d.uniform(20, 60);
    // exp(-r^2 / 2 l^2): waves of Gaussian wave numbers.
    Field f = mottle(side, 2.0, length, d);
    const double kind = d.uniform(0, 1);
    if (kind < 0.4) {
      for (double& v : f.z) v = std::max(0.1, 1 + sigma * v);
      h.parameters = {{"sigma", sigma}, {"correlation_mm", length}};
    } else if (kind < 0.7) {
      // Thicker coats to one side.
      const double from_side_to_side = size * d.uniform(0.04, 0.15), angle = d.uniform(0, 2 * kPi);
      for (int r = 0; r < f.n; ++r)
        for (int c = 0; c < f.n; ++c)
          f.at(r, c) =
              std::max(0.1, 1 + from_side_to_side * ((c * f.step / side - 0.5) * std::cos(angle) +
                                                     (r * f.step / side - 0.5) * std::sin(angle)));
      h.parameters = {{"from_side_to_side", from_side_to_side}, {"angle_deg", angle * 180 / kPi}};
    } else {
      // What was spilt and ran out: long as wide, or longer; no edge.
      const double loss = std::min(0.9, size * d.uniform(0.08, 0.3)), radius = d.uniform(8, 22),
                   stretch = d.uniform(1, 1.8), angle = d.uniform(0, kPi),
                   x0 = d.uniform(0.2, 0.8) * side, y0 = d.uniform(0.2, 0.8) * side;
      for (int r = 0; r < f.n; ++r)
        for (int c = 0; c < f.n; ++c) {
          const double x = c * f.step - x0, y = r * f.step - y0,
                       along = (x * std::cos(angle) + y * std::sin(angle)) / (radius * stretch),
                       across = (y * std::cos(angle) - x * std::sin(angle)) / radius;
          f.at(r, c) = 1 - loss * std::exp(-0.5 * (along * along + across * across));
        }
      h.parameters = {{"stain_loss", loss}, {"stain_radius_mm", radius}, {"stretch", stretch}};
    }
    w.paint.factor = std::move(f);
  } else if (e == "surface.roughness") {
    w.paint.roughness = std::min(1.0, size * d.uniform(12, 35) * kPi / 180);
    h.parameters = {{"sigma_deg", w.paint.roughness * 180 / kPi}};
  } else if (e == "surface.opposition") {
    w.paint.surge = size * d.uniform(0.25, 0.9);
    w.paint.width = d.uniform(0.06, 0.3);
    h.parameters = {{"b0", w.paint.surge}, {"h", w.paint.width}};
  } else if (e == "surface.specular") {
    w.paint.gloss = size * d.uniform(0.005, 0.03);
    w.paint.lobe = d.uniform(0.2, 0.4);
    h.parameters = {{"reflectance_at_normal_incidence", w.paint.gloss},
                    {"beckmann_slope", w.paint.lobe}};
  } else if (e == "surface.interreflection") {
    w.bounce = size;
    w.bounces = 1 + static_cast<int>(d.uniform(0, 3));
    h.parameters = {{"share", w.bounce}, {"bounces", w.bounces}};
  } else {
    hide_nameless(e, size, w, d, h);
  }
  return h;
}

}  // namespace challenge
