// SPDX-License-Identifier: GPL-3.0-or-later

// The renderer of hidden photographs against closed forms, for nothing else vouches for it:
//   a place of the model is where a pinhole has it; the way back is the same ray, distorted or not
//   a ray meets the first place of the surface: slow march on random relief, three ways to fill
//   cells a plane under a lamp: scale x albedo x cosine x (reference / distance)^2 a ball is dark
//   beyond its terminator and lit before; an edge throws shadow as far as it must a disc's penumbra
//   is as wide as the distance from the edge says a bowl sees itself by the share of the sphere
//   that it is; that much light it returns paints at angles where their formulas are one number a
//   case file tells nothing of what is hidden; the same case is the same bytes; an effect weighs as
//   the closed form of the simplest says
//   kernels have the moments of disc and line; discs are those of a thin lens, smears those of
//   rays that turn; rooms light as their integrals say; a veil leaves the mean; counts scatter as
//   they must
// Seeds are in the tests; tolerances are derived where they stand.

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include <gmock/gmock.h>

#include "challenge/photo_blur.hpp"
#include "challenge/photo_case.hpp"
#include "core/random.hpp"
#include "heightmap/height_field.hpp"

namespace challenge {
namespace {

using maquette::normalized;

template <class Height>
Field field_of(int n, double step, const Height& height) {
  Field f = make_field(n, step);
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c) f.at(r, c) = height(c * step, r * step);
  return f;
}

/// Looks straight down from above a place, x of the picture along x of the model.
PhotoCamera from_above(Vec3 place, double focal_px, int width, int height) {
  PhotoCamera c;
  c.place = place;
  c.width = width;
  c.height = height;
  c.focal_px = focal_px;
  return c;
}

PhotoLamp lamp_at(Vec3 place, Vec3 target) {
  PhotoLamp lamp;
  lamp.place = place;
  lamp.target = target;
  lamp.reference = maquette::norm(place - target);
  return lamp;
}

TEST(PhotoCamera, HasAPlaceWhereAPinholeHasIt) {
  const PhotoCamera c = from_above({80, 70, 500}, 4000, 1024, 768);
  const auto [x, y] = pixel_of(c, {90, 75, 100}, 1);
  EXPECT_NEAR(x, 512 + 4000 * 10 / 400.0, 1e-9);
  EXPECT_NEAR(y, 384 - 4000 * 5 / 400.0, 1e-9);
}

TEST(PhotoCamera, LooksAtItsTarget) {
  PhotoCamera c;
  c.place = {100, -400, 700};
  for (const double roll : {0.0, 0.3}) {
    c.turn = looking(c.place, {80, 80, 20}, roll);
    const auto [x, y] = pixel_of(c, {80, 80, 20}, 1);
    EXPECT_NEAR(x, 512, 1e-8);
    EXPECT_NEAR(y, 384, 1e-8);
    // What stands upright is upright in the picture, and leans by the roll.
    const auto [u, v] = pixel_of(c, {80, 80, 30}, 1);
    EXPECT_NEAR(std::atan2(u - x, y - v), roll, 1e-8);
  }
}

TEST(PhotoCamera, RayGoesToThePlaceThatThePictureHasThere) {
  PhotoCamera c;
  c.place = {100, -400, 700};
  c.turn = looking(c.place, {80, 80, 20}, 0.2);
  c.k1 = 0.3;
  c.k2 = -2;
  c.band_scale = {1.002, 1, 0.998};
  c.band_k1 = {0.1, 0, -0.1};
  for (int k = 0; k < 50; ++k) {
    const Vec3 place{maquette::random_uniform(1, static_cast<unsigned>(2 * k)) * 160,
                     maquette::random_uniform(1, static_cast<unsigned>(2 * k + 1)) * 160, 20};
    for (int band = 0; band < 3; ++band) {
      const auto [x, y] = pixel_of(c, place, band);
      const Vec3 along = ray_at(c, x, y, band);
      EXPECT_LT(maquette::norm(maquette::cross(along, normalized(place - c.place))), 1e-12);
    }
  }
}

TEST(PhotoRelief, TrianglesAreThoseOfTheContract) {
  Draw d{std::mt19937_64(3)};
  const Field f = draw_terrain(d);
  maquette::heightmap::ModelField model{
      maquette::Grid<float>(f.n, f.n), maquette::Millimetres{f.step}, {}, {}};
  for (int r = 0; r < f.n; ++r)
    for (int c = 0; c < f.n; ++c) model.z_mm(r, c) = static_cast<float>(f.at(r, c));
  const Relief relief(f, Relief::Between::triangles);
  for (int k = 0; k < 1000; ++k) {
    const double x = d.uniform(0, 160), y = d.uniform(0, 160);
    EXPECT_NEAR(relief.height(x, y), maquette::heightmap::height_at(model, x, y), 1e-9);
  }
}

class PhotoReliefMeets : public testing::TestWithParam<Relief::Between> {};

TEST_P(PhotoReliefMeets, TheFirstPlaceThatASlowMarchFinds) {
  Draw d{std::mt19937_64(7)};
  const Relief relief(draw_terrain(d), GetParam());
  int met = 0;
  for (int k = 0; k < 400; ++k) {
    const Vec3 from{d.uniform(-50, 210), d.uniform(-50, 210), d.uniform(60, 200)};
    const Vec3 to{d.uniform(5, 155), d.uniform(5, 155), d.uniform(12, 26)};
    const Vec3 along = normalized(to - from);
    const double t = relief.meet(from, along);
    // A hundredth of a millimetre a step; what dips less deep between two of them than rounding is
    // no place either way.
    double slow = -1;
    bool inside = false, side = false;
    for (double s = 0; s < 400 && slow < 0; s += 0.01) {
      const Vec3 p = from + s * along;
      const bool over = p.x >= 0 && p.y >= 0 && p.x <= 160 && p.y <= 160;
      if (over && !inside && p.z < relief.height(p.x, p.y)) {
        side = true;
        break;
      }
      inside |= over;
      if (over && p.z < relief.height(p.x, p.y)) slow = s;
    }
    if (side || slow < 0) {
      EXPECT_LT(t, 0) << k;
      continue;
    }
    ++met;
    EXPECT_LE(t, slow + 1e-9) << k;
    EXPECT_GT(t, slow - 0.0100001) << k;
    const Vec3 p = from + t * along;
    EXPECT_NEAR(p.z, relief.height(p.x, p.y), 1e-4) << k;
  }
  EXPECT_GT(met, 200);
}
INSTANTIATE_TEST_SUITE_P(Cells, PhotoReliefMeets,
                         testing::Values(Relief::Between::bilinear, Relief::Between::triangles,
                                         Relief::Between::smooth),
                         [](const auto& each) {
                           return std::string(each.param == Relief::Between::bilinear ? "bilinear"
                                              : each.param == Relief::Between::triangles
                                                  ? "triangles"
                                                  : "smooth");
                         });

// A plane that leans by 0.2 along x and -0.1 along y.
TEST(PhotoRender, PlaneUnderALampIsTheClosedForm) {
  const Relief relief(field_of(161, 1.0, [](double x, double y) { return 20 + 0.2 * x - 0.1 * y; }),
                      Relief::Between::bilinear);
  PhotoScene scene;
  scene.relief = &relief;
  scene.paint.albedo = 0.4;
  PhotoLamp lamp = lamp_at({-300, 200, 500}, {80, 80, 30});
  lamp.scale = 1.7;
  const PhotoCamera camera = from_above({80, 80, 700}, 800, 128, 96);
  const Picture picture = render(scene, camera, lamp, {}, 0, 1, 5);
  const Vec3 n = normalized(Vec3{-0.2, 0.1, 1});
  for (int row = 0; row < 96; ++row)
    for (int col = 0; col < 128; ++col) {
      const Vec3 along{(col + 0.5 - 64) / 800, (48 - row - 0.5) / 800, -1};
      // On the plane: 700 - t = 20 + 0.2 (80 + t ax) - 0.1 (80 + t ay).
      const double t = (700 - 20 - 16 + 8) / (1 + 0.2 * along.x - 0.1 * along.y);
      const Vec3 p = camera.place + t * along, beam = lamp.place - p;
      const double want = 1.7 * 0.4 * maquette::dot(n, normalized(beam)) *
                          maquette::dot(lamp.place - lamp.target, lamp.place - lamp.target) /
                          maquette::dot(beam, beam);
      // A pixel is 0.84 mm of 600: light changes by 0.5 % over it, four places drawn in its
      // quarters miss its middle by 0.07 of that, one sigma; five of these.
      ASSERT_NEAR(static_cast<double>(picture[0].at(row, col)), want, 0.002 * want);
    }
}

TEST(PhotoRender, NothingOutsideTheBeam) {
  PhotoLamp lamp = lamp_at({0, 0, 1000}, {0, 0, 0});
  lamp.beam_half = std::atan(0.1);
  EXPECT_NEAR(light_at(lamp, lamp.place, {99, 0, 0}), 1 / (1 + 0.099 * 0.099), 1e-12);
  EXPECT_EQ(light_at(lamp, lamp.place, {101, 0, 0}), 0);
}

TEST(PhotoRender, BallIsDarkBeyondItsTerminator) {
  // A cap that reaches 60 degrees under a lamp 35 degrees high, 100 m away.
  constexpr double kRadius = 60, kStep = 0.5;
  const Relief relief(field_of(321, kStep,
                               [](double x, double y) {
                                 const double q = std::hypot(x - 80, y - 80),
                                              rim = kRadius * std::sin(kPi / 3);
                                 return q < rim ? std::sqrt(kRadius * kRadius - q * q)
                                                : kRadius * std::cos(kPi / 3);
                               }),
                      Relief::Between::bilinear);
  const Vec3 light = direction(0.4, 35 * kPi / 180), lamp = Vec3{80, 80, 30} + 1e5 * light;
  // Normals of a cell are off by half a cell's turn, chords of a cell lie below the ball by
  // step^2 / 8 R, which hides sqrt(2 x that / R) of its turn: together 0.018 rad.
  const double doubt =
      0.5 * kStep * std::sqrt(2.0) / kRadius + kStep * std::sqrt(2.0) / (2 * kRadius);
  int lit = 0, dark = 0;
  Draw d{std::mt19937_64(11)};
  for (int k = 0; k < 4000; ++k) {
    const double q = 50 * std::sqrt(d.uniform(0, 1)), a = d.uniform(0, 2 * kPi);
    const double x = 80 + q * std::cos(a), y = 80 + q * std::sin(a);
    const Vec3 ball = normalized(Vec3{x - 80, y - 80, std::sqrt(kRadius * kRadius - q * q)});
    const double height = std::asin(maquette::dot(ball, light));
    const Vec3 n = relief.normal(x, y);
    const Vec3 place = Vec3{x, y, relief.height(x, y)} + 1e-5 * n;
    const bool is_lit = maquette::dot(n, light) > 0 && relief.sees(place, lamp);
    if (height > doubt) {
      EXPECT_TRUE(is_lit) << x << " " << y;
      ++lit;
    } else if (height < -doubt) {
      EXPECT_FALSE(is_lit) << x << " " << y;
      ++dark;
    }
  }
  EXPECT_GT(lit, 2000);
  EXPECT_GT(dark, 100);
}

/// A plateau of 10 mm that ends at x = 60 over half a millimetre.
Relief step_down() {
  return {field_of(321, 0.5, [](double x, double) { return x <= 60 ? 20.0 : 10.0; }),
          Relief::Between::bilinear};
}

TEST(PhotoRender, ShadowIsAsLongAsTheEdgeIsHigh) {
  const Relief relief = step_down();
  const Vec3 lamp{80 - 2000, 80, 10 + 1000};
  // Over the edge (60, 20): to the floor 10 mm below.
  const double reach = 60 + 10 * (60 + 1920.0) / (1010 - 20.0);
  EXPECT_FALSE(relief.sees({reach - 0.01, 80, 10 + 1e-5}, lamp));
  EXPECT_TRUE(relief.sees({reach + 0.01, 80, 10 + 1e-5}, lamp));
}

TEST(PhotoRender, PenumbraIsAsWideAsTheLampSays) {
  const Relief relief = step_down();
  PhotoScene scene;
  scene.relief = &relief;
  scene.paint.albedo = 1;
  PhotoLamp lamp = lamp_at({80 - 2000, 80, 10 + 1000}, {80, 80, 10});
  lamp.diameter = 200;
  // 0.05 mm a pixel around the shadow's edge, at x = 80.
  const PhotoCamera camera = from_above({80, 80, 1010}, 20000, 400, 60);
  const Picture picture = render(scene, camera, lamp, {}, 0, 1, 9);
  // The edge hides the disc line by line: the floor at x sees of it what lies above the plane
  // through the edge, which for the line at (px, pz) is x = 60 + 10 (60 - px) / (pz - 20). Each
  // line weighs as it is long, and by the light that it throws on the floor there.
  double all = 0, mean = 0, square = 0;
  const Vec3 axis = normalized(lamp.target - lamp.place);
  const Vec3 up = normalized(Vec3{0, 0, 1} - axis.z * axis);
  for (int k = 0; k < 2000; ++k) {
    const double s = -1 + (k + 0.5) / 1000;
    const Vec3 p = lamp.place + 100 * s * up;
    const double x = 60 + 10 * (60 - p.x) / (p.z - 20);
    const Vec3 beam = p - Vec3{x, 80, 10};
    const double d = maquette::norm(beam), weight = std::sqrt(1 - s * s) * beam.z / (d * d * d);
    all += weight;
    mean += weight * x;
    square += weight * x * x;
  }
  mean /= all;
  const double sigma = std::sqrt(square / all - mean * mean);
  // The same from the picture: moments of the slope of the rows' mean.
  double m0 = 0, m1 = 0, m2 = 0;
  const auto value = [&](int col) {
    double v = 0;
    for (int row = 0; row < 60; ++row) v += static_cast<double>(picture[0].at(row, col));
    // What the floor would have in full light falls by 0.1 % a mm: divided out.
    const Vec3 p{80 + 0.05 * (col + 0.5 - 200), 80, 10};
    const Vec3 beam = lamp.place - p;
    return v / 60 / (light_at(lamp, lamp.place, p) * beam.z / maquette::norm(beam));
  };
  for (int col = 1; col < 399; ++col) {
    const double x = 80 + 0.05 * (col - 199.5), slope = value(col + 1) - value(col - 1);
    m0 += slope;
    m1 += slope * x;
    m2 += slope * x * x;
  }
  EXPECT_NEAR(0.5 * m0, 1, 0.02);
  EXPECT_NEAR(m1 / m0, mean, 0.03);
  // Sixty rows of sixty-four points of the lamp: 1 %, and 3 of these. Where pixels that happen to
  // see all of the lamp are not looked at again it is 4 % too narrow.
  EXPECT_NEAR(std::sqrt(m2 / m0 - m1 * m1 / (m0 * m0)), sigma, 0.03 * sigma);
  EXPECT_GT(sigma, 0.5);
}

/// A bowl of a sphere that reaches 50 degrees.
constexpr double kBowl = 50 * kPi / 180;
Relief bowl() {
  return {field_of(321, 0.5,
                   [](double x, double y) {
                     constexpr double kRadius = 80;
                     const double q = std::hypot(x - 80, y - 80), rim = kRadius * std::sin(kBowl);
                     return q < rim ? 100 - std::sqrt(kRadius * kRadius - q * q)
                                    : 100 - kRadius * std::cos(kBowl);
                   }),
          Relief::Between::smooth};
}

TEST(PhotoLight, BowlSeesTheSkyByTheShareOfTheSphereThatIsMissing) {
  // Every place inside a sphere sees equal areas of it equally.
  const Field open = openness_of(bowl(), {}, 4.0, 1024, 3);
  const double want = 0.5 * (1 + std::cos(kBowl));
  double sum = 0;
  int count = 0;
  for (int r = 0; r < open.n; ++r)
    for (int c = 0; c < open.n; ++c)
      if (std::hypot(4.0 * c - 80, 4.0 * r - 80) < 55) {
        // 32 x 32 strata: a place errs by less than sqrt(0.18 x 0.82 / 1024), more than 4 of it
        // never; slopes between nodes turn the normal by less than 0.006.
        EXPECT_NEAR(open.at(r, c), want, 0.04);
        sum += open.at(r, c);
        ++count;
      }
  EXPECT_NEAR(sum / count, want, 0.003);
  EXPECT_EQ(open.at(0, 0), 1.0);
}

TEST(PhotoLight, RoomsLightALevelPlaceAlikeAndWallsByWhereTheyAre) {
  const Relief level(field_of(5, 40.0, [](double, double) { return 20.0; }),
                     Relief::Between::bilinear);
  // A slope of 45 degrees that looks along x.
  const Relief slope(field_of(5, 40.0, [](double x, double) { return 200 - x; }),
                     Relief::Between::bilinear);
  Room overcast, side;
  overcast.zenith = 1;
  side.side = {0.5, 0, 0};
  // 64 x 64 strata of values up to 9/7: well below a hundredth; the rim of the level sees nothing
  // else.
  for (const Room& room : {Room{}, overcast, side})
    EXPECT_NEAR(openness_of(level, room, 80, 4096, 3).at(1, 1), 1, 0.01);
  const double c = std::cos(kPi / 4);
  EXPECT_NEAR(openness_of(slope, {}, 80, 4096, 3).at(1, 1), 0.5 * (1 + c), 0.01);
  // The integral of cosine times direction over the upper quarter that the slope sees, by a plain
  // sum over heights and azimuths.
  const auto integral = [&](const Room& room) {
    double sum = 0;
    for (int i = 0; i < 400; ++i)
      for (int k = 0; k < 800; ++k) {
        const double h = 0.5 * kPi * (i + 0.5) / 400, a = 2 * kPi * (k + 0.5) / 800;
        const Vec3 d{std::cos(h) * std::cos(a), std::cos(h) * std::sin(a), std::sin(h)};
        sum += room.from(d) * std::max(0.0, c * (d.x + d.z)) * std::cos(h);
      }
    return sum * 0.5 * kPi / 400 * 2 * kPi / 800 / kPi;
  };
  for (const Room& room : {overcast, side})
    EXPECT_NEAR(openness_of(slope, room, 80, 4096, 3).at(1, 1), integral(room), 0.01);
}

TEST(PhotoLight, BowlLightsItselfWithTheMeanOfWhatFallsOnIt) {
  // One reflection: albedo x share of the sphere x mean light on the bowl, everywhere alike.
  const Relief relief = bowl();
  Paint paint;
  paint.albedo = 0.5;
  // From high above: nothing in shadow, and light falls as the cosine.
  const PhotoLamp lamp = lamp_at({80, 80, 1e6}, {80, 80, 20});
  const Field once = bounced_light(relief, paint, lamp, 1, 8.0, 1024, 5);
  // Mean cosine over a cap: (1 + cos) / 2; the cap's share of the sphere: (1 - cos) / 2.
  const double f = 0.5 * (1 - std::cos(kBowl)), mean = 0.5 * (1 + std::cos(kBowl));
  const Field thrice = bounced_light(relief, paint, lamp, 3, 8.0, 1024, 5);
  double sum = 0, sum3 = 0;
  int count = 0;
  for (int r = 0; r < once.n; ++r)
    for (int c = 0; c < once.n; ++c)
      if (std::hypot(8.0 * c - 80, 8.0 * r - 80) < 55) {
        sum += once.at(r, c);
        sum3 += thrice.at(r, c);
        ++count;
      }
  const double want = 0.5 * f * mean, again = 0.5 * f;
  EXPECT_NEAR(sum / count, want, 0.02 * want);
  // Maps of 8 mm mix the rim with the flat ground outside, which sees nothing of the bowl: the
  // second reflection, 9 % of the first, loses a fifth.
  EXPECT_NEAR(sum3 / count, want * (1 + again + again * again), 0.03 * want);
}

TEST(PhotoPaint, OneNumberWhereFormulasAre) {
  const Vec3 up{0, 0, 1};
  const auto at = [](double angle) { return Vec3{std::sin(angle), 0, std::cos(angle)}; };
  Paint p;
  EXPECT_NEAR(reflected(p, 0.3, up, at(0.7), at(-0.2)), 0.3 * std::cos(0.7), 1e-12);
  EXPECT_EQ(reflected(p, 0.3, up, at(1.6), up), 0);
  p.roughness = 0.5;
  const double a = 1 - 0.5 * 0.25 / (0.25 + 0.33), b = 0.45 * 0.25 / (0.25 + 0.09);
  EXPECT_NEAR(reflected(p, 0.3, up, up, at(0.4)), 0.3 * a, 1e-12);
  // Back where it came from: sin alpha tan beta is sin tan.
  EXPECT_NEAR(reflected(p, 0.3, up, at(0.6), at(0.6)),
              0.3 * std::cos(0.6) * (a + b * std::sin(0.6) * std::tan(0.6)), 1e-12);
  // To the other side: A alone.
  EXPECT_NEAR(reflected(p, 0.3, up, at(0.6), at(-0.5)), 0.3 * std::cos(0.6) * a, 1e-12);
  p = {};
  p.surge = 0.8;
  p.width = 0.1;
  EXPECT_NEAR(reflected(p, 0.3, up, at(0.5), at(0.5)), 0.3 * std::cos(0.5) * 1.8, 1e-5);
  EXPECT_NEAR(reflected(p, 0.3, up, at(0.5), at(-0.3)),
              0.3 * std::cos(0.5) * (1 + 0.8 / (1 + std::tan(0.4) / 0.1)), 1e-9);
  p = {};
  p.gloss = 0.04;
  p.lobe = 0.3;
  EXPECT_NEAR(reflected(p, 0.0, up, up, up), 0.04 / (4 * 0.09), 1e-12);
}

TEST(PhotoLens, KernelsHaveTheMomentsOfDiscAndLine) {
  Lens lens;
  lens.defocus_px = 5;
  // A disc has a quarter of its diameter each way; 62 points across it leave out half a per cent.
  const double disc = 25 / 16.0, pixel = 0.01;
  EXPECT_NEAR(std::pow(kernel_of(lens).spread_px(1, 0), 2), disc, pixel);
  EXPECT_NEAR(std::pow(kernel_of(lens).spread_px(0.6, 0.8), 2), disc, pixel);
  lens.motion_px = {3, 4};
  EXPECT_NEAR(std::pow(kernel_of(lens).spread_px(0.6, 0.8), 2), disc + 25 / 12.0, pixel);
  EXPECT_NEAR(std::pow(kernel_of(lens).spread_px(0.8, -0.6), 2), disc, pixel);
}

/// A picture with light in one pixel of 96 x 72 and the margin, that lies 800 mm before the camera.
struct Spot {
  Relief relief{field_of(161, 1.0, [](double, double) { return 20.0; }), Relief::Between::bilinear};
  PhotoCamera camera = from_above({80, 80, 820}, 800, 96, 72);
  int row = 10, col = 80;

  /// Where its light is and how it is spread: mean and variance of x and y, and their covariance.
  std::array<double, 5> through(const Lens& lens) const {
    const int margin = place_margin_of(lens, camera, relief);
    EXPECT_GT(margin, 0);
    Picture picture;
    for (Plane& plane : picture) {
      plane = make_plane(96 + 2 * margin, 72 + 2 * margin);
      plane.at(row + margin, col + margin) = 1;
    }
    blur_by_place(lens, camera, relief, margin, 0, picture);
    EXPECT_EQ(picture[0].width, 96);
    std::array<double, 5> m{};
    double all = 0;
    for (int r = 0; r < 72; ++r)
      for (int c = 0; c < 96; ++c) {
        const double v = static_cast<double>(picture[2].at(r, c)), x = c - col, y = r - row;
        all += v;
        m[0] += v * x;
        m[1] += v * y;
        m[2] += v * x * x;
        m[3] += v * y * y;
        m[4] += v * x * y;
      }
    EXPECT_NEAR(all, 1, 0.01);
    return m;
  }
};

TEST(PhotoLens, DiscsAreAsLargeAsAThinLensMakesThem) {
  Spot spot;
  Lens lens;
  lens.pupil_mm = 10;
  lens.focus_mm = 500;
  // 800 px x 10 mm x |1 / 800 - 1 / 500|
  const double disc = 800 * 10 * (1 / 500.0 - 1 / 800.0);
  EXPECT_NEAR(confusion_px(lens, spot.camera, 800), disc, 1e-9);
  const auto m = spot.through(lens);
  // A disc's variance is a sixteenth of its diameter's square; kernels have steps of a sixteenth
  // of a pixel: half of it is 1.3 % of the diameter.
  EXPECT_NEAR(m[2], disc * disc / 16, 0.03 * disc * disc / 16);
  EXPECT_NEAR(m[3], disc * disc / 16, 0.03 * disc * disc / 16);
  EXPECT_NEAR(m[0], 0, 1e-3);
}

TEST(PhotoLens, ATurningCameraSmearsAsItsRaysGo) {
  Spot spot;
  Lens lens;
  // About its y axis: the picture moves along x; 800 px x 0.01.
  lens.turning_rad = {0, 0.01, 0};
  const double x = (80.5 - 48) / 800, length = 8 * (1 + x * x);
  auto m = spot.through(lens);
  EXPECT_NEAR(m[2], length * length / 12, 0.02 * length * length / 12);
  EXPECT_NEAR(m[3], 0, 1e-3);
  // About its axis: across the radius, (32.5, -25.5) pixels from the middle.
  lens.turning_rad = {0, 0, 0.2};
  m = spot.through(lens);
  const double along_x = 0.2 * 25.5, along_y = 0.2 * 32.5;
  // An arc of 0.2 rad is shorter than its tangent by 0.2 % at its ends.
  EXPECT_NEAR(m[2] - m[0] * m[0], along_x * along_x / 12, 0.04 * along_x * along_x / 12);
  EXPECT_NEAR(m[3] - m[1] * m[1], along_y * along_y / 12, 0.04 * along_y * along_y / 12);
  // Both axes grow together: x right and y down of what circles about the middle, upper right.
  EXPECT_NEAR(m[4] - m[0] * m[1], along_x * along_y / 12, 0.04 * along_x * along_y / 12);
}

TEST(PhotoLens, VeilLeavesTheMeanAndCornersAreDim) {
  Picture picture;
  for (Plane& plane : picture) {
    plane = make_plane(64, 48);
    for (int r = 0; r < 48; ++r)
      for (int c = 0; c < 64; ++c) plane.at(r, c) = c < 32 ? 0.8F : 0.0F;
  }
  Lens lens;
  lens.veil = 0.05;
  pass(lens, picture);
  EXPECT_NEAR(static_cast<double>(picture[1].at(5, 40)), 0.02, 1e-6);
  EXPECT_NEAR(static_cast<double>(picture[1].at(5, 20)), 0.95 * 0.8 + 0.02, 1e-6);
  for (Plane& plane : picture) std::fill(plane.v.begin(), plane.v.end(), 0.5F);
  lens = {};
  lens.fall2 = -0.1;
  lens.fall4 = -0.05;
  pass(lens, picture);
  const double q2 = (31.5 * 31.5 + 23.5 * 23.5) / (32.0 * 32 + 24 * 24);
  EXPECT_NEAR(static_cast<double>(picture[2].at(0, 63)), 0.5 * (1 - 0.1 * q2 - 0.05 * q2 * q2),
              1e-6);
}

TEST(PhotoSensor, CountsScatterAsElectronsDo) {
  for (const double light : {1e-4, 2e-3, 0.1, 0.6}) {
    Picture picture;
    for (Plane& plane : picture) {
      plane = make_plane(400, 300);
      std::fill(plane.v.begin(), plane.v.end(), static_cast<float>(light));
    }
    Sensor s;
    s.gain = {1, 1, 1.2};
    expose(s, picture, 17, 2);
    for (std::size_t band = 0; band < 3; ++band) {
      double sum = 0, square = 0;
      for (const float v : picture[band].v) {
        sum += static_cast<double>(v);
        square += static_cast<double>(v) * static_cast<double>(v);
      }
      const auto n = static_cast<double>(picture[band].v.size());
      const double mean = sum / n, variance = square / n - mean * mean;
      // The ADC's steps add a twelfth of their square; 120 000 numbers: 0.4 %, four of these.
      const double step = 1 / 16383.0, noise = noise_of(50000, 20, light) * s.gain[band];
      EXPECT_NEAR(mean, light * s.gain[band], 4 * noise / std::sqrt(n));
      EXPECT_NEAR(variance, noise * noise + step * step / 12, 0.016 * noise * noise);
      EXPECT_NEAR(expected(s, band, light), light * s.gain[band], 1e-12);
    }
  }
}

TEST(PhotoEffects, EveryNameCanBeHiddenAndNothingElse) {
  PhotoOptions o;
  o.seed = 4;
  Draw d{std::mt19937_64(4)};
  const PhotoWorld declared = draw_photo_world(o, d);
  for (const auto* names : {&photo_hideable(), &photo_nameless()})
    for (const std::string& name : *names) {
      PhotoWorld w = declared;
      Draw e{std::mt19937_64(5)};
      const PhotoHidden h = hide_in_photos(name, 1.0, w, e);
      EXPECT_FALSE(h.parameters.empty()) << name;
      EXPECT_EQ(h.effect, name);
    }
  PhotoWorld w = declared;
  EXPECT_THROW(hide_in_photos("photo.luck", 1.0, w, d), std::runtime_error);
}

/// Of this test alone, gone at its end.
struct Folder {
  std::filesystem::path path;

  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "maquette-test-XXXXXX").string();
    path = ::mkdtemp(name.data());
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  std::filesystem::path operator/(const std::string& name) const { return path / name; }
};

std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(PhotoCase, TellsNothingOfWhatIsHiddenAndIsTheSameTwice) {
  const Folder folder;
  PhotoOptions o;
  o.seed = 12;
  o.width = 96;
  o.height = 72;
  make_photo_case(o, folder / "null");
  for (const char* effect : {"lamp.position", "photo.focal_length", "surface.albedo"}) {
    o.effects = {effect};
    make_photo_case(o, folder / "once");
    make_photo_case(o, folder / "twice");
    for (const char* file : {"case.toml", "design.tif"})
      EXPECT_EQ(bytes_of(folder / "null" / file), bytes_of(folder / "once" / file)) << effect;
    for (int k = 1; k <= kPhotos; ++k) {
      const std::string photo = "photo_" + std::to_string(k) + ".exr";
      EXPECT_GT(bytes_of(folder / "once" / photo).size(), 10'000U);
      EXPECT_EQ(bytes_of(folder / "once" / photo), bytes_of(folder / "twice" / photo)) << effect;
    }
  }
}

TEST(PhotoCase, AGainWeighsAsItsClosedForm) {
  const Folder folder;
  PhotoOptions o;
  o.width = 96;
  o.height = 72;
  // Of seeds the first whose gain is on all photographs.
  PhotoHidden h;
  for (o.seed = 1; h.photographs != "all" || h.effect.empty(); ++o.seed) {
    o.effects = {"photo.exposure"};
    h = make_photo_case(o, folder.path).front();
  }
  --o.seed;
  Draw d{std::mt19937_64(o.seed * 7919 + 13)};
  const PhotoWorld w = draw_photo_world(o, d);
  const Relief relief(w.design, o.between);
  PhotoScene scene;
  scene.relief = &relief;
  scene.paint = w.paint;
  const double change = h.parameters.front().second - 1;
  double squares = 0, seen = 0, ratio = 0;
  for (const Photo& photo : w.photos) {
    const Picture p = render(scene, photo.camera, photo.lamp, {}, 0, 1, 99);
    for (const float f : p[0].v) {
      const double v = static_cast<double>(f);
      if (v <= 0) continue;
      squares += v * v;
      ratio += 3 * v * v / (v * 50000 + 400) * 2.5e9;
      seen += 1;
    }
  }
  // One pixel of 36 is weighed: of 96 x 72 x 6 lit by half some 600, whose values scatter by a
  // third: 1.5 %, three of these; the noise's figure is a sum of them, whose count scatters too.
  EXPECT_NEAR(h.rms_255, 255 * std::abs(change) * std::sqrt(squares / seen), 0.045 * h.rms_255);
  EXPECT_NEAR(h.over_noise, std::abs(change) * std::sqrt(ratio), 0.08 * h.over_noise);
}

}  // namespace
}  // namespace challenge
