// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/photo_render.hpp"

#include <algorithm>
#include <cmath>

#include "core/random.hpp"

namespace challenge {
namespace {

using maquette::cross;
using maquette::dot;
using maquette::norm;
using maquette::normalized;

constexpr double kAbove = 1e-5;  // mm, from which a place looks at the lamp

/// Two unit vectors across a third.
std::array<Vec3, 2> across(Vec3 n) {
  const Vec3 a = normalized(cross(std::abs(n.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{1, 0, 0}, n));
  return {a, cross(n, a)};
}

struct Seen {
  double value = 0;
  bool met = false, edge = false;  ///< edge: some points of the lamp are seen, some not
};

class Eye {
 public:
  Eye(const PhotoScene& scene, const PhotoCamera& camera, const PhotoLamp& lamp,
      const Field& bounced)
      : scene_(scene), camera_(camera), lamp_(lamp), bounced_(bounced) {
    disc_ = across(normalized(lamp.target - lamp.place));
  }

  /// @param u  four numbers in [0, 1) for the lamp's points, one pair
  Seen at(double px, double py, int band, double u, double v) const {
    const Vec3 along = ray_at(camera_, px, py, band);
    const Relief& relief = *scene_.relief;
    const double t = relief.meet(camera_.place, along);
    if (t < 0) return {};
    const Vec3 place = camera_.place + t * along;
    const Vec3 n = relief.normal(place.x, place.y), above = place + kAbove * n;
    const double albedo = scene_.paint.albedo_at(place.x, place.y);
    Seen s;
    s.met = true;
    const auto point = [&](Vec3 from) {
      const Vec3 to_lamp = normalized(from - place);
      if (dot(to_lamp, n) <= 0 || !relief.sees(above, from)) return false;
      s.value += light_at(lamp_, from, place) * reflected(scene_.paint, albedo, n, to_lamp, -along);
      return true;
    };
    if (lamp_.diameter > 0) {
      int lit = 0;
      for (int k = 0; k < 4; ++k) {
        // A quarter of the disc's area for each: radius and angle by halves.
        const double radius = 0.5 * lamp_.diameter * std::sqrt(0.5 * (k % 2 + u)),
                     angle = kPi * (k / 2 + v);
        lit += point(lamp_.place + radius * std::cos(angle) * disc_[0] +
                     radius * std::sin(angle) * disc_[1]);
      }
      s.value /= 4;
      s.edge = lit > 0 && lit < 4;
      // A place that sees nearly all of the lamp, or nearly none, is to be looked at again like the
      // rest of the penumbra: else its first points' luck would stand, and penumbras end too soon.
      for (int k = 0; k < 6 && !s.edge; ++k) {
        const double radius = 0.5 * lamp_.diameter, angle = kPi * k / 3;
        const Vec3 rim =
            lamp_.place + radius * std::cos(angle) * disc_[0] + radius * std::sin(angle) * disc_[1];
        s.edge = (dot(rim - place, n) > 0 && relief.sees(above, rim)) != (lit > 0);
      }
    } else {
      point(lamp_.place);
    }
    if (scene_.openness.n > 0)
      s.value += albedo * lamp_.scale * scene_.ambient[static_cast<std::size_t>(band)] *
                 scene_.openness.height(place.x, place.y);
    if (bounced_.n > 0) s.value += albedo * bounced_.height(place.x, place.y);
    return s;
  }

 private:
  const PhotoScene& scene_;
  const PhotoCamera& camera_;
  const PhotoLamp& lamp_;
  const Field& bounced_;
  std::array<Vec3, 2> disc_;
};

/// Directions about a normal, as many as their cosines say: `side` x `side`, one in each cell.
template <class Each>
void cosine_rays(Vec3 n, int side, std::uint64_t seed, std::uint64_t place, const Each& each) {
  const auto [a, b] = across(n);
  for (int i = 0; i < side * side; ++i) {
    const std::uint64_t counter =
        2 * (place * static_cast<std::uint64_t>(side * side) + static_cast<std::uint64_t>(i));
    const double u = (i / side + maquette::random_uniform(seed, counter)) / side,
                 v = (i % side + maquette::random_uniform(seed, counter + 1)) / side;
    const double r = std::sqrt(u), angle = 2 * kPi * v;
    each(r * std::cos(angle) * a + r * std::sin(angle) * b + std::sqrt(1 - u) * n);
  }
}

template <class Value>
Field on_grid(const Relief& relief, double step, const Value& value) {
  Field f = make_field(static_cast<int>(std::lround(relief.side() / step)) + 1, step);
  for (int r = 0; r < f.n; ++r)
    for (int c = 0; c < f.n; ++c) {
      // The rim itself would look at the sides.
      const double x = std::clamp(c * step, 1e-6, relief.side() - 1e-6),
                   y = std::clamp(r * step, 1e-6, relief.side() - 1e-6);
      const Vec3 n = relief.normal(x, y);
      f.at(r, c) = value(Vec3{x, y, relief.height(x, y)} + kAbove * n, n,
                         static_cast<std::uint64_t>(r * f.n + c));
    }
  return f;
}

}  // namespace

Plane make_plane(int width, int height) {
  return {width, height,
          std::vector<float>(static_cast<std::size_t>(width) * static_cast<std::size_t>(height))};
}

Vec3 ray_at(const PhotoCamera& c, double px, double py, int band) {
  const double scale = c.band_scale[static_cast<std::size_t>(band)] * c.focal_px;
  double x = (px - 0.5 * c.width) / scale, y = (0.5 * c.height - py) / scale;
  const double k1 = c.k1 + c.band_k1[static_cast<std::size_t>(band)];
  if (k1 != 0 || c.k2 != 0) {
    const double real = std::hypot(x, y);
    double ideal = real;
    for (int i = 0; i < 8; ++i) {
      const double q = ideal * ideal;
      ideal -= (ideal * (1 + k1 * q + c.k2 * q * q) - real) / (1 + 3 * k1 * q + 5 * c.k2 * q * q);
    }
    if (real > 0) {
      x *= ideal / real;
      y *= ideal / real;
    }
  }
  return normalized(maquette::rotate(c.turn, Vec3{x, y, -1}));
}

std::array<double, 2> pixel_of(const PhotoCamera& c, Vec3 place, int band) {
  const Vec3 p = maquette::rotate(c.turn.conjugate(), place - c.place);
  const double x = -p.x / p.z, y = -p.y / p.z, q = x * x + y * y;
  const auto b = static_cast<std::size_t>(band);
  const double scale =
      c.band_scale[b] * c.focal_px * (1 + (c.k1 + c.band_k1[b]) * q + c.k2 * q * q);
  return {0.5 * c.width + scale * x, 0.5 * c.height - scale * y};
}

maquette::Quaternion looking(Vec3 place, Vec3 target, double roll) {
  const Vec3 back = normalized(place - target);
  const Vec3 right =
      normalized(cross(std::abs(back.z) < 0.999 ? Vec3{0, 0, 1} : Vec3{0, 1, 0}, back));
  // First -z onto the view, then about it until x is `right`.
  const Vec3 z{0, 0, 1};
  const double c = std::clamp(dot(z, back), -1.0, 1.0);
  const Vec3 axis = cross(z, back);
  const maquette::Quaternion tilt = norm(axis) > 1e-12
                                        ? maquette::rotation_about(normalized(axis), std::acos(c))
                                        : maquette::Quaternion{};
  const Vec3 x = maquette::rotate(tilt, {1, 0, 0});
  const double twist = std::atan2(dot(right, cross(back, x)), dot(right, x));
  return maquette::normalized(maquette::rotation_about(back, twist + roll) * tilt);
}

double light_at(const PhotoLamp& lamp, Vec3 from, Vec3 place) {
  const Vec3 beam = place - from;
  const double d = norm(beam);
  const Vec3 axis = normalized(lamp.target - from);
  const double angle = std::atan2(norm(cross(axis, beam)), dot(axis, beam));
  if (angle > lamp.beam_half) return 0;
  const double ratio = lamp.reference / d;
  double light = lamp.scale * (lamp.power == 2 ? ratio * ratio : std::pow(ratio, lamp.power));
  if (lamp.hot_spot > 0) light *= std::exp(-0.5 * angle * angle / (lamp.hot_spot * lamp.hot_spot));
  return light;
}

double Paint::albedo_at(double x, double y) const {
  return factor.n > 0 ? albedo * factor.height(x, y) : albedo;
}

double reflected(const Paint& paint, double albedo, Vec3 n, Vec3 to_lamp, Vec3 to_eye) {
  const double ci = dot(n, to_lamp), ce = dot(n, to_eye);
  if (ci <= 0) return 0;
  double diffuse = albedo * ci;
  if (paint.roughness > 0) {
    // Oren and Nayar 1994, doi:10.1145/192161.192213, their simple form.
    const double q = paint.roughness * paint.roughness;
    const double a = 1 - 0.5 * q / (q + 0.33), b = 0.45 * q / (q + 0.09);
    const double si = std::sqrt(std::max(0.0, 1 - ci * ci)),
                 se = std::sqrt(std::max(0.0, 1 - ce * ce));
    // sin alpha tan beta cos(azimuth) = (l.v - ci ce) / max(ci, ce), for sines cancel.
    const double side = dot(to_lamp, to_eye) - ci * ce;
    diffuse *= a + (si * se > 0 && side > 0 ? b * side / std::max({ci, ce, 1e-9}) : 0.0);
  }
  const double cg = std::clamp(dot(to_lamp, to_eye), -1.0, 1.0);
  if (paint.surge > 0)
    diffuse *= 1 + paint.surge / (1 + std::sqrt((1 - cg) / (1 + cg + 1e-12)) / paint.width);
  if (paint.gloss <= 0 || ce <= 0) return diffuse;
  // Cook and Torrance 1982, doi:10.1145/357290.357293; Schlick's Fresnel.
  const Vec3 half = normalized(to_lamp + to_eye);
  const double ch = std::max(1e-9, dot(n, half)), vh = std::max(1e-9, dot(to_eye, half));
  const double m = paint.lobe * paint.lobe, c2 = ch * ch;
  const double spread = std::exp(-(1 - c2) / (c2 * m)) / (kPi * m * c2 * c2);
  const double blocked = std::min({1.0, 2 * ch * ce / vh, 2 * ch * ci / vh});
  const double fresnel = paint.gloss + (1 - paint.gloss) * std::pow(1 - vh, 5);
  return diffuse + kPi * spread * blocked * fresnel / (4 * ce);
}

double Room::from(Vec3 d) const {
  // Moon and Spencer 1942: (1 + 2 sin h) / 3 of the zenith, on a level place 7/9 of it.
  return 1 + zenith * (3.0 / 7 * (1 + 2 * d.z) - 1) + dot(side, d);
}

Field openness_of(const Relief& relief, const Room& room, double step, int rays,
                  std::uint64_t seed) {
  const int side = std::max(1, static_cast<int>(std::sqrt(rays)));
  return on_grid(relief, step, [&](Vec3 place, Vec3 n, std::uint64_t k) {
    double open = 0;
    cosine_rays(n, side, seed, k, [&](Vec3 d) {
      if (d.z > 0 && relief.meet(place, d) < 0) open += room.from(d);
    });
    return open / (side * side);
  });
}

Field bounced_light(const Relief& relief, const Paint& paint, const PhotoLamp& lamp, int bounces,
                    double step, int rays, std::uint64_t seed) {
  const int side = std::max(1, static_cast<int>(std::sqrt(rays)));
  Field last, sum;
  for (int bounce = 0; bounce < bounces; ++bounce) {
    const Field now = on_grid(relief, step, [&](Vec3 place, Vec3 n, std::uint64_t k) {
      double all = 0;
      cosine_rays(n, side, seed, k, [&](Vec3 d) {
        const double t = relief.meet(place, d);
        if (t < 0) return;
        const Vec3 there = place + t * d;
        double e = 0;
        if (bounce == 0) {
          const Vec3 m = relief.normal(there.x, there.y), to_lamp = normalized(lamp.place - there);
          const double c = dot(m, to_lamp);
          if (c > 0 && relief.sees(there + kAbove * m, lamp.place))
            e = c * light_at(lamp, lamp.place, there);
        } else {
          e = last.height(there.x, there.y);
        }
        all += e * paint.albedo_at(there.x, there.y);
      });
      return all / (side * side);
    });
    last = now;
    if (bounce == 0)
      sum = now;
    else
      for (std::size_t i = 0; i < sum.z.size(); ++i) sum.z[i] += now.z[i];
  }
  return sum;
}

Picture render(const PhotoScene& scene, const PhotoCamera& camera, const PhotoLamp& lamp,
               const Field& bounced, int margin, int stride, std::uint64_t seed) {
  const Eye eye(scene, camera, lamp, bounced);
  const auto alike = [](const auto& band) { return band[0] == band[1] && band[1] == band[2]; };
  const bool same = alike(camera.band_scale) && alike(camera.band_k1) && alike(scene.ambient);
  const int width = camera.width / stride + 2 * margin,
            height = camera.height / stride + 2 * margin;
  Picture picture;
  for (int band = 0; band < (same ? 1 : 3); ++band) {
    Plane& plane = picture[static_cast<std::size_t>(band)] = make_plane(width, height);
    for (int row = 0; row < height; ++row)
      for (int col = 0; col < width; ++col) {
        const int i = (row - margin) * stride + stride / 2,
                  j = (col - margin) * stride + stride / 2;
        std::uint64_t counter =
            (static_cast<std::uint64_t>(row * width + col) * 3 + static_cast<std::uint64_t>(band)) *
            128;
        const auto draw = [&] { return maquette::random_uniform(seed, counter++); };
        const auto mean = [&](int side, bool& differs) {
          double sum = 0, low = 1e9, high = -1e9;
          int met = 0;
          bool edge = false;
          for (int a = 0; a < side; ++a)
            for (int b = 0; b < side; ++b) {
              const double py = i + (a + draw()) / side, px = j + (b + draw()) / side;
              const double u = lamp.diameter > 0 ? draw() : 0, v = lamp.diameter > 0 ? draw() : 0;
              const Seen s = eye.at(px, py, band, u, v);
              sum += s.value;
              low = std::min(low, s.value);
              high = std::max(high, s.value);
              met += s.met;
              edge |= s.edge;
            }
          differs = edge || high - low > kFine * lamp.scale * scene.paint.albedo ||
                    (met > 0 && met < side * side);
          return sum / (side * side);
        };
        bool differs = false;
        double value = mean(2, differs);
        if (differs) value = mean(4, differs);
        plane.at(row, col) = static_cast<float>(value);
      }
  }
  if (same) picture[1] = picture[2] = picture[0];
  return picture;
}

}  // namespace challenge
