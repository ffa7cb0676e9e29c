// SPDX-License-Identifier: GPL-3.0-or-later

// The chain against closed forms, and diagnoses of pictures of a surface that is a formula: rays
// meet it by Newton's method, slopes are its derivatives, no lamp casts a shadow.

#include "diagnosis/photographs.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "diagnosis/detail/cut_off.hpp"
#include "diagnosis/detail/photo_fit.hpp"
#include "diagnosis/detail/photo_standing.hpp"
#include "diagnosis/detail/photo_views.hpp"
#include "diagnosis/detail/sums.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::diagnosis {
namespace {

using testing_support::FailsWith;
using testing_support::Succeeds;

constexpr double kSide_mm = 40.0;
constexpr std::uint64_t kSeed = 20261123;

/// @param warp  of the part, 1/m: its height is that times the square of x - 20, in mm
double height(double x, double y, double warp = 0.0) {
  return 0.8 * std::cos(0.6 * x) * std::cos(0.5 * y) + 0.3 * std::sin(1.4 * x + 0.9 * y) +
         0.02 * x + 1e-3 * warp * (x - 20.0) * (x - 20.0);
}
Vec3 normal(double x, double y, double warp = 0.0) {
  const double gx = -0.48 * std::sin(0.6 * x) * std::cos(0.5 * y) +
                    0.42 * std::cos(1.4 * x + 0.9 * y) + 0.02 + 2e-3 * warp * (x - 20.0),
               gy = -0.4 * std::cos(0.6 * x) * std::sin(0.5 * y) +
                    0.27 * std::cos(1.4 * x + 0.9 * y);
  return normalized(Vec3{-gx, -gy, 1.0});
}

/// Turns a camera to the part's middle.
void look_at_the_middle(PhotoInput& p) {
  const Vec3 back = normalized(p.camera_position_mm - Vec3{20.0, 20.0, 0.0});
  const double tilt = std::acos(back.z);
  p.model_from_camera = rotation_about(normalized(cross({0.0, 0.0, 1.0}, back)), tilt);
}

/// Looks down at the part's middle.
PhotoInput photo(int number) {
  PhotoInput p;
  p.width_px = 256;
  p.height_px = 192;
  p.pixel_pitch_um = 20.0;
  p.focal_length_mm = 30.0;
  const double azimuth = 2.1 * number;
  p.camera_position_mm = {20.0 + 40.0 * std::cos(azimuth), 20.0 + 40.0 * std::sin(azimuth), 260.0};
  look_at_the_middle(p);
  p.lamp_position_mm = number % 2 == 0 ? Vec3{700.0, 100.0, 900.0} : Vec3{-500.0, 600.0, 900.0};
  p.lamp_target_mm = {20.0, 20.0, 0.0};
  p.exposure_scale = 1.5;
  p.full_well_e = 20000.0;
  p.as_milled = false;
  return p;
}

/// Where a pixel's ray meets the formula.
Vec3 place_at(const PhotoInput& p, double u, double v, double warp = 0.0) {
  const double f = p.focal_length_mm * 1000.0 / p.pixel_pitch_um;
  const Vec3 d = rotate(p.model_from_camera, normalized(Vec3{u, -v, -f}));
  double t = (p.camera_position_mm.z) / -d.z;
  for (int round = 0; round < 8; ++round) {
    const Vec3 at = p.camera_position_mm + t * d;
    const Vec3 n = normal(at.x, at.y, warp);
    t -= (at.z - height(at.x, at.y, warp)) * n.z / dot(n, d);
  }
  return p.camera_position_mm + t * d;
}
/// Light at a pixel's place, as the eye of a formula sees it; 0 beside the part.
double light_of(const PhotoInput& p, double u, double v, double warp) {
  const Vec3 at = place_at(p, u, v, warp);
  if (at.x < 0.0 || at.y < 0.0 || at.x > kSide_mm || at.y > kSide_mm) return 0.0;
  const Vec3 to = p.lamp_position_mm - at;
  const Vec3 target = p.lamp_position_mm - p.lamp_target_mm;
  return p.exposure_scale * p.albedo *
         std::fmax(0.0, dot(normal(at.x, at.y, warp), to) / norm(to)) * dot(target, target) /
         dot(to, to);
}
double light(const PhotoInput& p, double u, double v) {
  return light_of(p, u, v, 0.0);
}

struct Pictures {
  testing_support::ScratchFolder folder;
  CaseInput part;
  std::vector<PhotoInput> photos;
};

/// @param lens  light behind the lens at (u, v) of a picture, of `light`
/// @param sensor  value of a channel from that
/// @param stand  changes how a picture is taken
/// @param number  what is written for a value with its noise
void take(
    Pictures& made, const std::function<double(const PhotoInput&, double, double)>& lens,
    const std::function<double(double, int)>& sensor, double noise = 1.0,
    const std::function<void(PhotoInput&, int)>& stand = {},
    const std::function<double(double)>& number = [](double y) { return y; }) {
  heightmap::ModelField design{Grid<float>(401, 401, 0.0F), Millimetres{0.1}, Millimetres{0.0},
                               Millimetres{0.0}};
  for (std::ptrdiff_t r = 0; r < 401; ++r)
    for (std::ptrdiff_t c = 0; c < 401; ++c)
      design.z_mm(r, c) = static_cast<float>(height(design.x_mm(c), design.y_mm(r)));
  made.part.design = made.folder / "design.tif";
  ASSERT_THAT(heightmap::write_model_field(design, made.part.design), Succeeds());
  for (int k = 0; k < 3; ++k) {
    PhotoInput p = photo(k);
    if (stand) stand(p, k);
    p.image = made.folder / fmt::format("photo_{}.exr", k);
    std::array<Grid<float>, 3> image;
    image.fill(Grid<float>(p.height_px, p.width_px, 0.0F));
    for (int r = 0; r < p.height_px; ++r)
      for (int c = 0; c < p.width_px; ++c) {
        double mean = 0.0;  // over the pixel
        for (int i = 0; i < 16; ++i)
          mean += lens(p, c + (i % 4 + 0.5) / 4.0 - 0.5 * p.width_px,
                       r + (i / 4 + 0.5) / 4.0 - 0.5 * p.height_px) /
                  16.0;
        for (int ch = 0; ch < 3; ++ch) {
          const double y = sensor(mean, ch);
          const auto draw = static_cast<std::uint64_t>(((k * 192 + r) * 256 + c) * 3 + ch);
          image[static_cast<std::size_t>(ch)](r, c) =
              static_cast<float>(number(y + noise *
                                                std::sqrt(std::fmax(0.0, y) * p.full_well_e +
                                                          p.read_noise_e * p.read_noise_e) /
                                                p.full_well_e * random_normal(kSeed, draw)));
        }
      }
    ASSERT_THAT(camera::write_exr({{"R", &image[0]}, {"G", &image[1]}, {"B", &image[2]}}, p.image),
                Succeeds());
    made.photos.push_back(p);
  }
}

std::vector<std::string> names_of(const Diagnosis& d) {
  std::vector<std::string> names;
  for (const Cause& c : d.causes) names.push_back(c.effect);
  return names;
}

double as_it_is(double v, int) {
  return v;
}

void expect_unexplained(const Pictures& p, const char* kind) {
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  EXPECT_THAT(names_of(*d), ::testing::IsEmpty());
  EXPECT_EQ(d->verdict, "unexplained");
  EXPECT_THAT(d->remainder.kinds, ::testing::Contains(kind));
}

TEST(Photographs, NothingIsClaimedWhereNothingIs) {
  Pictures p;
  take(p, light, as_it_is);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  EXPECT_EQ(d->verdict, "consistent") << ::testing::PrintToString(names_of(*d));
  // What is left is noise: mean of the pixels' declared variances, and a fifth of it for slopes
  // between nodes.
  EXPECT_LT(d->rms_after, 1.2 * d->rms_noise);
}

TEST(Photographs, WhiteBalanceIsNamedWithItsSize) {
  Pictures p;
  take(p, light, [](double v, int ch) { return v * (ch == 0 ? 1.05 : ch == 2 ? 0.96 : 1.0); });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"photo.white_balance"});
  // 26 000 pixels of 1 % noise: 6e-5; a thousandth for what slopes between nodes change.
  EXPECT_NEAR(d->causes[0].parameters[0].value, 0.05, 1e-3);
  EXPECT_NEAR(d->causes[0].parameters[1].value, -0.04, 1e-3);
  EXPECT_LT(d->rms_after, 1.2 * d->rms_noise);
}

TEST(Photographs, WhatWasFoundHoldsForAPictureThatHadNoPart) {
  Pictures p;
  take(p, light, [](double v, int ch) { return v * (ch == 0 ? 1.05 : ch == 2 ? 0.96 : 1.0); });
  p.photos[1].held_out = true;
  const auto d = diagnose_photographs(p.part, p.photos, true);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"photo.white_balance"});
  ASSERT_EQ(d->held_out.size(), 1U);
  EXPECT_EQ(d->held_out[0].image, "photo_1.exr");
  // 5 % and 4 % of two of three channels, of a level of 0.3 to 0.45.
  EXPECT_GT(d->held_out[0].before, 2.0);
  // Slopes between nodes add a fifth to the noise, as above.
  EXPECT_LT(d->held_out[0].after, 1.2 * d->held_out[0].noise);
  ASSERT_TRUE(d->controls.has_value());
  EXPECT_TRUE(d->controls->passed());
  ASSERT_EQ(d->controls->recoveries.size(), 1U);
  ASSERT_EQ(d->controls->recoveries[0].sizes.size(), 2U);
  for (const auto& size : d->controls->recoveries[0].sizes)
    EXPECT_NEAR(size.found, size.injected, 4.0 * size.sigma) << size.parameter;
}

TEST(Photographs, AnExposureOfOnePictureIsItsOwn) {
  Pictures p;
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        return light(of, u, v) * (of.image.filename() == "photo_2.exr" ? 0.93 : 1.0);
      },
      as_it_is);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"photo.exposure"});
  EXPECT_EQ(d->causes[0].law, "factor, of photo_2.exr");
  EXPECT_NEAR(d->causes[0].parameters[0].value, -0.07, 1e-3);
}

/// Balls that lie on the part up to their middles, at places of (x, y), and how much of a white
/// surface's light they send back.
struct Stones {
  std::vector<Vec3> middle;
  double radius_mm, albedo;

  Stones() : radius_mm(1.2), albedo(0.12) {
    for (const auto& [x, y] :
         {std::pair{8.0, 9.0}, {30.0, 7.0}, {19.0, 21.0}, {33.0, 29.0}, {9.0, 32.0}})
      middle.push_back({x, y, height(x, y)});
  }
  /// Where a ray first meets one, from its beginning; infinite: nowhere. @param which  becomes it
  double meets(Vec3 from, Vec3 direction, Vec3& which) const {
    double first = INFINITY;
    for (const Vec3& m : middle) {
      const double along = dot(m - from, direction);
      const double off2 = dot(m - from, m - from) - along * along;
      if (off2 >= radius_mm * radius_mm) continue;
      const double t = along - std::sqrt(radius_mm * radius_mm - off2);
      if (t > 0.0 && t < first) {
        first = t;
        which = m;
      }
    }
    return first;
  }
  /// light() with the stones and their shadows.
  double light_of(const PhotoInput& p, double u, double v) const {
    const Vec3 ground = place_at(p, u, v), way = ground - p.camera_position_mm;
    Vec3 stone;
    if (const double t = meets(p.camera_position_mm, normalized(way), stone); t < norm(way)) {
      const Vec3 at = p.camera_position_mm + t * normalized(way);
      return p.exposure_scale * albedo *
             std::fmax(0.0, dot(normalized(at - stone), normalized(p.lamp_position_mm - at)));
    }
    const Vec3 to = p.lamp_position_mm - ground;
    return std::isfinite(meets(ground, normalized(to), stone)) ? 0.0 : light(p, u, v);
  }
  /// The part with them, as a raster.
  void add_to(heightmap::ModelField& design) const {
    for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
        for (const Vec3& m : middle) {
          const double off2 = std::pow(design.x_mm(c) - m.x, 2) + std::pow(design.y_mm(r) - m.y, 2);
          if (off2 < radius_mm * radius_mm)
            design.z_mm(r, c) =
                std::fmax(design.z_mm(r, c),
                          static_cast<float>(m.z + std::sqrt(radius_mm * radius_mm - off2)));
        }
  }
};

/// As in pictures of the bare part: 5 % too much red, 4 % too little blue, and nothing else.
void expect_white_balance(const Diagnosis& d) {
  ASSERT_EQ(names_of(d), std::vector<std::string>{"photo.white_balance"});
  EXPECT_EQ(d.verdict, "explained");
  EXPECT_NEAR(d.causes[0].parameters[0].value, 0.05, 1e-3);
  EXPECT_NEAR(d.causes[0].parameters[1].value, -0.04, 1e-3);
  EXPECT_LT(d.rms_after, 1.2 * d.rms_noise);
}

TEST(Photographs, StonesOnTheGroundHaveNoSay) {
  Pictures p;
  const Stones stones;
  take(
      p, [&](const PhotoInput& photo, double u, double v) { return stones.light_of(photo, u, v); },
      [](double v, int ch) {
        return v * (ch == 0 ? 1.05 : ch == 2 ? 0.96 : 1.0);
      });
  p.part.ground = p.folder / "ground.tif";
  auto design = heightmap::read_model_field(p.part.design);
  ASSERT_THAT(design, Succeeds());
  ASSERT_THAT(heightmap::write_model_field(*design, p.part.ground), Succeeds());
  stones.add_to(*design);
  p.part.design = p.folder / "with_stones.tif";
  ASSERT_THAT(heightmap::write_model_field(*design, p.part.design), Succeeds());
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  expect_white_balance(*d);
  EXPECT_THAT(d->notes, ::testing::Contains(::testing::HasSubstr("of a stone or its shadow")));
  // Who does not say that they are there sees them.
  p.part.ground.clear();
  const auto unsaid = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(unsaid, Succeeds());
  EXPECT_THAT(unsaid->verdict, ::testing::AnyOf("unexplained", "partly_explained"));
}

/// A ball of `radius` about the origin, of 48 x 24 quads: its faces lie 0.4 % of that within.
void write_ball(const std::filesystem::path& path, double radius) {
  constexpr int kAround = 48, kUp = 24;
  std::ofstream out(path);
  for (int i = 0; i <= kUp; ++i)
    for (int j = 0; j < kAround; ++j) {
      const double a = std::numbers::pi * i / kUp, b = 2.0 * std::numbers::pi * j / kAround;
      out << fmt::format("v {} {} {}\n", radius * std::sin(a) * std::cos(b),
                         radius * std::sin(a) * std::sin(b), radius * std::cos(a));
    }
  const auto at = [](int i, int j) { return i * kAround + j % kAround + 1; };
  for (int i = 0; i < kUp; ++i)
    for (int j = 0; j < kAround; ++j)
      out << fmt::format("f {} {} {} {}\n", at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
}

// The same balls as meshes in the pictures, where design and ground are one.
TEST(Photographs, ObjectsThatStandOnThePartHaveNoSay) {
  Pictures p;
  const Stones balls;
  take(
      p, [&](const PhotoInput& photo, double u, double v) { return balls.light_of(photo, u, v); },
      [](double v, int ch) {
        return v * (ch == 0 ? 1.05 : ch == 2 ? 0.96 : 1.0);
      });
  write_ball(p.folder / "ball.obj", balls.radius_mm);
  for (const Vec3& middle : balls.middle)
    p.part.bodies.push_back({p.folder / "ball.obj", {Quaternion{}, middle}});
  p.part.bodies.push_back({p.folder / "ball.obj", {Quaternion{}, {0.0, 0.0, 1e5}}});
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  expect_white_balance(*d);
  EXPECT_THAT(d->notes, ::testing::Contains(::testing::HasSubstr("of an object or its shadow")));
  EXPECT_THAT(d->notes, ::testing::Contains(::testing::HasSubstr("none shows ball.obj")).Times(1));
}

// Lommel and Seeliger: 2 A mu0 / (mu0 + mu), a hundredth to a tenth beside Lambert's law here.
TEST(Photographs, ASurfaceSendsLightBackByItsDeclaredLaw) {
  Pictures p;
  const auto seeliger = [](const PhotoInput& of, double u, double v) {
    const Vec3 at = place_at(of, u, v), n = normal(at.x, at.y);
    const double mu0 = dot(n, normalized(of.lamp_position_mm - at)),
                 mu = dot(n, normalized(of.camera_position_mm - at));
    return light(of, u, v) * 2.0 / (mu0 + mu);
  };
  take(p, seeliger, as_it_is, 1.0, [](PhotoInput& of, int) {
    of.law = camera::LommelSeeliger{{of.albedo, of.albedo, of.albedo}};
  });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  EXPECT_EQ(d->verdict, "consistent") << ::testing::PrintToString(names_of(*d));
  for (PhotoInput& of : p.photos) of.law.reset();
  const auto other = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(other, Succeeds());
  EXPECT_NE(other->verdict, "consistent");
}

TEST(Photographs, GroundOfAnotherSizeIsRefused) {
  Pictures p;
  take(p, light, as_it_is);
  p.part.ground = p.folder / "ground.tif";
  ASSERT_THAT(heightmap::write_model_field(
                  {Grid<float>(11, 11, 0.0F), Millimetres{4.0}, Millimetres{0.0}, Millimetres{0.0}},
                  p.part.ground),
              Succeeds());
  EXPECT_THAT(diagnose_photographs(p.part, p.photos, false), FailsWith(kOtherPart));
}

TEST(Photographs, AllHeldOutIsRefused) {
  Pictures p;
  take(p, light, as_it_is);
  for (PhotoInput& of : p.photos) of.held_out = true;
  EXPECT_THAT(diagnose_photographs(p.part, p.photos, false), FailsWith(kPhotograph));
}

TEST(Photographs, AFocalLengthIsNoPose) {
  Pictures p;
  take(
      p, [](const PhotoInput& of, double u, double v) { return light(of, u / 1.01, v / 1.01); },
      as_it_is);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(d->causes.size(), 1U) << ::testing::PrintToString(names_of(*d));
  // From above a shorter way is hardly another focal length: one of the two, the other beside it.
  EXPECT_TRUE(d->causes[0].effect == "photo.focal_length" || d->causes[0].effect == "photo.pose");
  if (d->causes[0].effect == "photo.focal_length") {
    EXPECT_NEAR(d->causes[0].parameters[0].value, 0.01, 5e-4);
  }
}

// Poses are stated to a tenth of a pixel or two: what is off by that is no cause, and leaves
// nothing that would have to be explained.
TEST(Photographs, APoseLessThanAQuarterOfAPixelOffHasNoName) {
  for (const auto& [pixels, named] : {std::pair{0.08, false}, {0.17, false}, {0.5, true}}) {
    Pictures p;
    take(p, light, as_it_is);
    for (PhotoInput& of : p.photos) {
      const double pixel_mm = of.pixel_pitch_um / 1000.0 / of.focal_length_mm * 260.0;
      of.camera_position_mm.x += pixels * pixel_mm;
    }
    const auto d = diagnose_photographs(p.part, p.photos, false);
    ASSERT_THAT(d, Succeeds());
    EXPECT_THAT(names_of(*d),
                named ? std::vector<std::string>{"photo.pose"} : std::vector<std::string>{})
        << pixels;
    EXPECT_EQ(d->verdict, named ? "explained" : "consistent")
        << pixels << ::testing::PrintToString(d->remainder.kinds);
  }
}

TEST(Photographs, LampsThatStandEachElsewhereAreOneCause) {
  Pictures p;
  // As bright as they were: nearer ones light more. (Exposed anew, a way along the light would be
  // hardly told over 40 mm.)
  const std::array<Vec3, 2> moves{Vec3{25.0, -10.0, 15.0}, Vec3{-5.0, 20.0, 10.0}};
  take(
      p,
      [&](const PhotoInput& of, double u, double v) {
        PhotoInput stood = of;
        stood.lamp_position_mm += moves[of.lamp_position_mm.x > 0.0 ? 0 : 1];
        const Vec3 was = of.lamp_position_mm - of.lamp_target_mm,
                   is = stood.lamp_position_mm - stood.lamp_target_mm;
        return light(stood, u, v) * dot(was, was) / dot(is, is);
      },
      as_it_is);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"lamp.position"});
  EXPECT_EQ(d->causes[0].law, "each lamp, as bright");
  ASSERT_EQ(d->causes[0].parameters.size(), 6U);
  // Slopes are taken straight between nodes, 0.2 % flatter than waves of 1.7 rad / mm on a grid of
  // 0.1 mm: as if the lamp were higher by that of 1150 mm, and a third of it for noise.
  for (std::size_t lamp = 0; lamp < 2; ++lamp) {
    const Vec3 found{d->causes[0].parameters[3 * lamp].value,
                     d->causes[0].parameters[3 * lamp + 1].value,
                     d->causes[0].parameters[3 * lamp + 2].value};
    EXPECT_LT(norm(found - moves[lamp]), 3.0) << lamp;
  }
}

TEST(Photographs, ACoatThatThinsOutOneWayIsAnAlbedo) {
  Pictures p;
  // One wave of a map has nearly all of it: what most waves are like must not stand against it.
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        return light(of, u, v) * (1.0 + 0.08 * (place_at(of, u, v).x / kSide_mm - 0.5));
      },
      as_it_is);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"surface.albedo"});
  EXPECT_EQ(d->verdict, "explained");
  // cos(pi (x / 40 + 0.1) / 1.2) has -8 / pi^2 of a slope from -0.6 to 0.6, each 0.048; waves of
  // third order and more have the rest and are not quite apart from it on the part alone: a tenth.
  const auto& first = d->causes[0].parameters[0];
  EXPECT_EQ(first.name, "wave_1_0");
  EXPECT_NEAR(first.value, -0.048 * 8.0 / std::pow(std::numbers::pi, 2), 0.004);
}

TEST(Photographs, NoiseThatIsNotAsStatedIsNamed) {
  Pictures p;
  take(p, light, as_it_is, 1.5);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"photo.noise"});
  EXPECT_NEAR(d->causes[0].parameters[0].value, 1.5, 0.05);
}

// One picture is so dark that half of its noise would be below 0: its file has numbers from 0 up.
// (What they are too high by is an offset.)
TEST(Photographs, NoiseThatIsCutOffAtZeroIsNotLess) {
  Pictures p;
  take(
      p, light, as_it_is, 1.0,
      [](PhotoInput& of, int k) { of.exposure_scale = k == 0 ? 0.004 : 1.5; },
      [](double y) { return std::fmax(0.0, y); });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  EXPECT_THAT(names_of(*d), ::testing::Not(::testing::Contains("photo.noise")));
}

// Light would scatter by its shot noise, 600 electrons beside 300 of the lamp's and 400 of reading.
TEST(Photographs, AnOffsetIsToldFromLightByItsNoise) {
  Pictures p;
  take(
      p, light, as_it_is, 1.0, [](PhotoInput& of, int) { of.exposure_scale = 0.08; },
      [](double y) { return y + 0.03; });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"photo.black_level"});
}

void take_with_fringe(Pictures& p, double amplitude) {
  take(
      p,
      [=](const PhotoInput& of, double u, double v) {
        return light(of, u, v) *
               (1.0 + amplitude * std::sin(2.0 * std::numbers::pi * (0.8 * u + 0.6 * v) / 8.4));
      },
      as_it_is);
}

// Neighbouring pixels differ by a fringe as by noise.
TEST(Photographs, AFringeIsNoNoise) {
  Pictures p;
  take_with_fringe(p, 0.03);
  expect_unexplained(p, "a wave in a picture");
}

// What a file was compressed to goes together in neighbours: random knots every three pixels, of
// three times the noise, no lens and no sensor makes.
TEST(Photographs, NoiseThatNeighboursShareIsUnexplained) {
  Pictures p;
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        const auto knot = [&](double c, double r) {
          return random_normal(kSeed + 7, static_cast<std::uint64_t>((r + 500.0) * 1000.0 + c) +
                                              static_cast<std::uint64_t>(of.camera_position_mm.x));
        };
        const double c = std::floor(u / 3.0), r = std::floor(v / 3.0), a = u / 3.0 - c,
                     b = v / 3.0 - r;
        const double between = (1.0 - b) * ((1.0 - a) * knot(c, r) + a * knot(c + 1.0, r)) +
                               b * ((1.0 - a) * knot(c, r + 1.0) + a * knot(c + 1.0, r + 1.0));
        return light(of, u, v) * (1.0 + 0.03 * between);
      },
      as_it_is);
  expect_unexplained(p, "noise that neighbours share");
}

// As much as nodes that beat with pixels leave where slopes between them are not as rendered: it
// stands out of the noise, and took an even albedo its name.
TEST(Photographs, AFringeOfATenthOfAPercentIsNone) {
  Pictures p;
  take_with_fringe(p, 0.0015);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  EXPECT_EQ(d->verdict, "consistent");
}

// Facets by Beckmann's distribution, Fresnel's law for n = 1.5 and V-shaped grooves (Cook &
// Torrance, ACM Trans. Graph. 1 (1982) 7), seen from where they mirror the lamp, too: a lobe of the
// half vector alone left the exposure of one picture to be named.
TEST(Photographs, PaintThatShinesByFacetsIsSpecular) {
  const auto shine = [](const PhotoInput& of, double u, double v) {
    const double matt = light(of, u, v);
    if (matt <= 0.0) return 0.0;
    const Vec3 at = place_at(of, u, v), n = normal(at.x, at.y),
               l = normalized(of.lamp_position_mm - at), e = normalized(of.camera_position_mm - at),
               h = normalized(l + e);
    const double mu0 = dot(n, l), mu = dot(n, e), c = dot(n, h), b = dot(e, h);
    const double g = std::sqrt(1.5 * 1.5 - 1.0 + b * b),
                 fresnel = 0.5 * std::pow((g - b) / (g + b), 2) *
                           (1.0 + std::pow((b * (g + b) - 1.0) / (b * (g - b) + 1.0), 2));
    const double m2 = 0.3 * 0.3, t2 = (1.0 - c * c) / (c * c),
                 lobe = std::exp(-t2 / m2) / (m2 * std::pow(c, 4)),
                 open = std::min({1.0, 2.0 * c * mu / b, 2.0 * c * mu0 / b});
    // As a factor beside the matt albedo: a tenth of the paint is bare.
    return matt * (1.0 + 0.1 * fresnel * lobe * open / (4.0 * mu0 * mu) / of.albedo);
  };
  Pictures p;
  take(p, shine, as_it_is, 1.0, [](PhotoInput& of, int k) {
    if (k != 1) return;
    // Opposite the lamp, as far down.
    of.camera_position_mm = {170.0, -80.0, 200.0};
    look_at_the_middle(of);
  });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"surface.specular"});
  EXPECT_THAT(d->causes[0].law, ::testing::HasSubstr("facets"));
}

// A lobe narrower than the one that fits best while the offset is not known (Blinn's, as Lafortune
// & Willems normalise it): the offset was left out, for its step took the lobe's sizes below zero.
TEST(Photographs, ALobeBesideABlackLevelIsFitted) {
  constexpr double kExponent = 28.5, kShare = 0.03, kBlack = 0.021;
  const auto shine = [](const PhotoInput& of, double u, double v) {
    const double matt = light(of, u, v);
    if (matt <= 0.0) return 0.0;
    const Vec3 at = place_at(of, u, v), l = normalized(of.lamp_position_mm - at),
               e = normalized(of.camera_position_mm - at);
    const double c = dot(normal(at.x, at.y), normalized(l + e));
    return matt * (1.0 + kShare * (kExponent + 8.0) / 8.0 * std::pow(std::fmax(0.0, c), kExponent) /
                             of.albedo);
  };
  Pictures p;
  take(
      p, shine, [](double v, int) { return v + kBlack; }, 1.0,
      [](PhotoInput& of, int k) {
        if (k != 1) return;
        of.camera_position_mm = {170.0, -80.0, 200.0};
        look_at_the_middle(of);
      });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  EXPECT_THAT(names_of(*d),
              ::testing::UnorderedElementsAre("surface.specular", "photo.black_level"));
}

// Of a half width between those that are tried, of which none fits: a factor for each picture stood
// in the place of such a surge.
TEST(Photographs, ASurgeMayHaveAnyWidth) {
  const auto surge = [](const PhotoInput& of, double u, double v) {
    const double matt = light(of, u, v);
    if (matt <= 0.0) return 0.0;
    const Vec3 at = place_at(of, u, v);
    const double c =
        dot(normalized(of.lamp_position_mm - at), normalized(of.camera_position_mm - at));
    return matt * (1.0 + 0.15 / (1.0 + std::tan(0.5 * std::acos(c)) / 0.085));
  };
  Pictures p;
  take(p, surge, as_it_is, 1.0, [](PhotoInput& of, int k) {
    if (k != 1) return;
    // Before the lamp.
    of.camera_position_mm =
        Vec3{20.0, 20.0, 0.0} + 260.0 * normalized(of.lamp_position_mm - Vec3{20.0, 20.0, 0.0});
    look_at_the_middle(of);
  });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"surface.opposition"});
  double sum = 0.0;
  for (const Estimate& b : d->causes[0].parameters) sum += b.value;
  // Some of both is off by 3 % where both are highest, the nearer alone by 5.
  EXPECT_NEAR(sum, 0.15, 0.0055) << d->causes[0].law;
}

TEST(Photographs, RowsThatAFlickeringLampBandsAreUnexplained) {
  Pictures p;
  // 1.5 % of the light, 22 rows a period: as much as the noise of a pixel, in all of a row.
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        return light(of, u, v) * (1.0 + 0.015 * std::sin(2.0 * std::numbers::pi * v / 22.0));
      },
      as_it_is);
  expect_unexplained(p, "rows");
}

/// A zigzag over the formula, so fine that ridges between passes are a micrometre high.
void write_program(const std::filesystem::path& path, double radius) {
  std::string text = "G21 G90 G17\nF2000\nG0 X0 Y0 Z20\n";
  bool back = false;
  for (double y = 0.0; y < kSide_mm + 1e-9; y += 0.1, back = !back)
    for (double way = 0.0; way < kSide_mm + 1e-9; way += 0.1) {
      const double x = back ? kSide_mm - way : way;
      const Vec3 tip = Vec3{x, y, height(x, y)} + radius * (normal(x, y) - Vec3{0.0, 0.0, 1.0});
      text += fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f}\n", tip.x, tip.y, tip.z);
    }
  ASSERT_THAT(write_file(path, text + "G0 Z20\nM2\n"), Succeeds());
}

// A block that has bent by 0.2 mm leans by 20 mrad at its ends: with that in the model its pictures
// are as they should be, and without it are not.
TEST(Photographs, AMilledPartIsPicturedAsItsKnownCausesMakeIt) {
  constexpr double kWarp_per_m = 0.5;
  Pictures p;
  take(
      p, [](const PhotoInput& of, double u, double v) { return light_of(of, u, v, kWarp_per_m); },
      as_it_is, 1.0, [](PhotoInput& of, int) { of.as_milled = true; });
  p.part.ball_diameter_mm = 2.0;
  p.part.programs = {p.folder / "part.ngc"};
  write_program(p.part.programs[0], 1.0);
  const auto without = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(without, Succeeds());
  EXPECT_NE(without->verdict, "consistent");
  p.part.known = {{"stock.warp", "bent along x", {{"xx_per_m", kWarp_per_m}}, {}}};
  const auto with = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(with, Succeeds());
  EXPECT_EQ(with->verdict, "consistent") << ::testing::PrintToString(names_of(*with));
  EXPECT_LT(with->rms_before, without->rms_before);
}

bool odd(double from_middle, int size) {
  return static_cast<int>(std::floor(from_middle + 0.5 * size)) % 2 != 0;
}

// Every second row 0.8 pixels to the side: on a lattice of even rows nothing, on one of odd rows a
// pose.
TEST(Photographs, FieldsOfAnInterlacedPictureAreNoPose) {
  Pictures p;
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        return light(of, odd(v, of.height_px) ? u + 0.8 : u, v);
      },
      as_it_is);
  expect_unexplained(p, "even and odd rows or columns");
}

// Two greens of a mosaic whose gains differ by 3 %: half of that is no exposure.
TEST(Photographs, PixelsWhoseGainsAlternateAreNoExposure) {
  Pictures p;
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        return light(of, u, v) * (odd(u, of.width_px) != odd(v, of.height_px) ? 1.03 : 1.0);
      },
      as_it_is);
  expect_unexplained(p, "even and odd rows or columns");
}

// The cause is in all rows, what they differ by beside it.
TEST(Photographs, ACauseKeepsItsNameBesideRowsThatDiffer) {
  Pictures p;
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        return light(of, u, v) * (odd(v, of.height_px) ? 1.02 : 1.0);
      },
      [](double v, int channel) { return channel == 0 ? 1.2 * v : v; });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  EXPECT_EQ(names_of(*d), std::vector<std::string>{"photo.white_balance"});
  EXPECT_EQ(d->verdict, "partly_explained");
}

TEST(Photographs, AVeilIsAShareOfAllThatThePictureShows) {
  // A bench that is brighter than the part, and that fills two thirds of one picture.
  const auto seen = [](const PhotoInput& of, double u, double v) {
    const double part = light(of, u, v);
    return part > 0.0 ? part : 0.7;
  };
  const auto mean = [&](const PhotoInput& of) {
    double sum = 0.0;
    for (int r = 0; r < 96; ++r)
      for (int c = 0; c < 128; ++c) sum += seen(of, 2.0 * c + 1.0 - 128.0, 2.0 * r + 1.0 - 96.0);
    return sum / (96.0 * 128.0);
  };
  std::map<std::string, double> means;
  Pictures p;
  take(
      p,
      [&](const PhotoInput& of, double u, double v) {
        const auto [at, fresh] = means.try_emplace(of.image.string(), 0.0);
        if (fresh) at->second = mean(of);
        return seen(of, u, v) + 0.05 * at->second;
      },
      as_it_is, 1.0,
      [](PhotoInput& of, int number) {
        if (number == 1)
          of.camera_position_mm += 0.8 * (of.camera_position_mm - Vec3{20.0, 20.0, 0.0});
      });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"photo.veiling_glare"});
  // A lattice knows the bench's share to half a per cent; were its veil taken for bench, 2 % less.
  EXPECT_NEAR(d->causes[0].parameters[0].value, 0.05, 4e-4);
}

/// Light of squares of eight pixels, as a Gaussian of 8 % of the width spreads it; nothing from
/// beyond the picture.
Grid<double> halo_of(const PhotoInput& p) {
  constexpr int kSquare = 8;
  const int rows = p.height_px / kSquare, cols = p.width_px / kSquare;
  Grid<double> from(rows, cols), to(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      for (int i = 0; i < 16; ++i)
        from(r, c) += light(p, kSquare * (c + (i % 4 + 0.5) / 4.0) - 0.5 * p.width_px,
                            kSquare * (r + (i / 4 + 0.5) / 4.0) - 0.5 * p.height_px) /
                      16.0;
  const double sigma = 0.08 * cols;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      for (int i = 0; i < rows; ++i)
        for (int k = 0; k < cols; ++k)
          to(r, c) += from(i, k) *
                      std::exp(-((r - i) * (r - i) + (c - k) * (c - k)) / (2.0 * sigma * sigma)) /
                      (2.0 * std::numbers::pi * sigma * sigma);
  return to;
}

// A tenth of the light, of a width between those that are tried.
TEST(Photographs, LightThatTheLensSpreadsAboutItsPlaceIsAVeil) {
  constexpr double kShare = 0.1;
  std::map<double, Grid<double>> known;  // by where the camera stands
  const auto spread = [&](const PhotoInput& of, double u, double v) {
    Grid<double>& halo = known[of.camera_position_mm.x];
    if (halo.empty()) halo = halo_of(of);
    const double row = (v + 0.5 * of.height_px) / 8.0 - 0.5,
                 col = (u + 0.5 * of.width_px) / 8.0 - 0.5;
    const auto r = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(row), 0, halo.rows() - 2),
               c = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(col), 0, halo.cols() - 2);
    const double b = row - static_cast<double>(r), a = col - static_cast<double>(c);
    const double around = (1.0 - b) * ((1.0 - a) * halo(r, c) + a * halo(r, c + 1)) +
                          b * ((1.0 - a) * halo(r + 1, c) + a * halo(r + 1, c + 1));
    return (1.0 - kShare) * light(of, u, v) + kShare * around;
  };
  Pictures p;
  take(p, spread, as_it_is);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"photo.veiling_glare"});
  EXPECT_EQ(d->verdict, "explained");
  double share = 0.0;
  for (const Estimate& e : d->causes[0].parameters) share += e.value;
  // Of means that have the halo in them, to first order: a tenth of a tenth.
  EXPECT_NEAR(share, kShare, 0.1 * kShare) << d->causes[0].law;
}

/// Cosine-weighted share of the sky above the horizon that the formula leaves open, at nodes 1 mm
/// apart; the part stands alone.
Grid<double> open_sky() {
  constexpr int kTurns = 24, kHeights = 10;
  constexpr double kStep_mm = 0.25, kHighest_mm = 2.0;
  Grid<double> open(41, 41, 0.0);
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 41; ++c) {
      const auto x = static_cast<double>(c), y = static_cast<double>(r);
      const Vec3 n = normal(x, y);
      for (int i = 0; i < kTurns; ++i)
        for (int k = 0; k < kHeights; ++k) {
          const double turn = 2.0 * std::numbers::pi * (i + 0.5) / kTurns,
                       up = (k + 0.5) / kHeights;  // even in solid angle
          const Vec3 d{std::sqrt(1.0 - up * up) * std::cos(turn),
                       std::sqrt(1.0 - up * up) * std::sin(turn), up};
          if (!(dot(n, d) > 0.0)) continue;
          bool free = true;
          for (double t = kStep_mm; free; t += kStep_mm) {
            const Vec3 at = Vec3{x, y, height(x, y)} + t * d;
            if (at.z > kHighest_mm || at.x < 0.0 || at.y < 0.0 || at.x > kSide_mm ||
                at.y > kSide_mm)
              break;
            free = at.z > height(at.x, at.y);
          }
          if (free) open(r, c) += 2.0 * dot(n, d) / (kTurns * kHeights);
        }
    }
  return open;
}

// A room lit by others than the lamp, which is carried to half its distance for one picture, the
// exposure less by as much.
TEST(Photographs, ARoomLitByOthersStaysWhereTheLampIsCarried) {
  constexpr double kRoom = 0.03;
  const Grid<double> open = open_sky();
  const auto far2 = [](const PhotoInput& p) {
    const Vec3 to = p.lamp_position_mm - p.lamp_target_mm;
    return dot(to, to);
  };
  const double first2 = far2(photo(0));
  const auto with_room = [&](const PhotoInput& of, double u, double v) {
    const Vec3 at = place_at(of, u, v);
    if (at.x < 0.0 || at.y < 0.0 || at.x > kSide_mm || at.y > kSide_mm) return 0.0;
    const auto c = std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(at.x), 39),
               r = std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(at.y), 39);
    const double a = at.x - static_cast<double>(c), b = at.y - static_cast<double>(r);
    const double sky = (1.0 - b) * ((1.0 - a) * open(r, c) + a * open(r, c + 1)) +
                       b * ((1.0 - a) * open(r + 1, c) + a * open(r + 1, c + 1));
    return light(of, u, v) + of.exposure_scale * of.albedo * kRoom * sky * far2(of) / first2;
  };
  Pictures p;
  take(p, with_room, as_it_is, 1.0, [](PhotoInput& of, int k) {
    if (k == 1)
      of.lamp_position_mm = of.lamp_target_mm + 0.5 * (of.lamp_position_mm - of.lamp_target_mm);
  });
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_EQ(names_of(*d), std::vector<std::string>{"lamp.ambient"});
  EXPECT_EQ(d->causes[0].law, "as far as the sky is seen, the same wherever the lamp stands");
  // Between nodes of 1 mm the sky is straight on: 2 % off where the ground curves most, to both
  // sides elsewhere.
  EXPECT_NEAR(d->causes[0].parameters[0].value, kRoom, 0.01 * kRoom);
}

// A disc of 3.3 pixels beside corners that have a quarter of the light. (The ground's nodes are
// finer than pixels: slopes of every kind are alike, and none makes up for the blur.)
TEST(Photographs, ADefocusBesideAVignettingHasItsName) {
  constexpr double kCorner = 0.74, kDisc_px = 3.3;
  Pictures p;
  take(
      p,
      [](const PhotoInput& of, double u, double v) {
        // A ring of the disc's variance.
        double mean = 0.0;
        for (int k = 0; k < 6; ++k) {
          const double turn = std::numbers::pi / 3.0 * k, off = kDisc_px / std::sqrt(8.0);
          mean += light(of, u + off * std::cos(turn), v + off * std::sin(turn)) / 6.0;
        }
        const double r = std::hypot(u, v) / std::hypot(0.5 * of.width_px, 0.5 * of.height_px);
        return mean * (1.0 - kCorner * std::pow(r, 4));
      },
      as_it_is);
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, Succeeds());
  ASSERT_THAT(names_of(*d), ::testing::UnorderedElementsAre("photo.vignetting", "photo.defocus"));
  // Standard deviation of a uniform disc along an axis.
  for (const Cause& c : d->causes) {
    if (c.effect != "photo.defocus") continue;
    EXPECT_NEAR(c.parameters[0].value, kDisc_px / 4.0, 0.03);
  }
}

TEST(Photographs, APictureOfAnotherSizeIsRefused) {
  Pictures p;
  take(p, light, as_it_is);
  p.photos[1].width_px = 128;
  const auto d = diagnose_photographs(p.part, p.photos, false);
  ASSERT_THAT(d, FailsWith(kPhotograph));
  EXPECT_NE(d.error().message.find("photo_1.exr"), std::string::npos) << d.error().message;
}

TEST(Photographs, ACameraThatLooksElsewhereIsRefused) {
  Pictures p;
  take(p, light, as_it_is);
  for (PhotoInput& of : p.photos)
    of.model_from_camera = rotation_about({1.0, 0.0, 0.0}, std::numbers::pi);  // upwards
  const auto d = diagnose_photographs(p.part, p.photos, false);
  EXPECT_THAT(d, FailsWith(kPhotograph));
}

PhotoScene one_photo() {
  PhotoScene s;
  PhotoInput p;
  p.camera_position_mm = {0.0, 0.0, 500.0};
  p.lamp_position_mm = {300.0, 0.0, 400.0};
  p.lamp_target_mm = {0.0, 0.0, 0.0};
  s.photos = {p};
  s.lamp_of = {0};
  s.lamps = 1;
  s.box.add({-50.0, -50.0, 0.0});
  s.box.add({50.0, 50.0, 10.0});
  return s;
}
PhotoState nothing() {
  PhotoState s;
  s.lamp_mm.resize(1);
  s.lamp_refocused_mm.resize(1);
  s.picture.resize(1);
  return s;
}

/// The formula's surface in one picture; what was measured is even.
class Views : public testing::Test {
 protected:
  Views()
      : field_{Grid<float>(401, 401, 0.0F), Millimetres{0.1}, Millimetres{0.0}, Millimetres{0.0}},
        scene_(one_photo()) {
    for (std::ptrdiff_t r = 0; r < 401; ++r)
      for (std::ptrdiff_t c = 0; c < 401; ++c)
        field_.z_mm(r, c) = static_cast<float>(height(field_.x_mm(c), field_.y_mm(r)));
    scene_.photos[0] = photo(0);
    scene_.photos[0].principal_u_px = 128.0;
    scene_.photos[0].principal_v_px = 96.0;
    scene_.box = {};
    scene_.box.add({0.0, 0.0, -1.2});
    scene_.box.add({40.0, 40.0, 2.0});
    detail::Photograph grey;
    grey.value.push_back(Grid<float>(192, 256, 0.3F));
    views_.emplace(scene_, std::vector<detail::Photograph>{grey},
                   std::vector<const heightmap::ModelField*>{&field_});
  }
  heightmap::ModelField field_;
  PhotoScene scene_;
  std::optional<detail::PhotoViews> views_;
};

TEST_F(Views, RenderThePixelsThatAreLookedAtAsBefore) {
  views_->render(nothing(), detail::Normals::smooth);
  const auto all = views_->pixels();
  const auto is_left = [](const Vec3& place) { return place.x < 13.0; };
  views_->look_at(is_left);
  // Somewhere else in between, so that all is rendered anew.
  PhotoState turned = nothing();
  turned.picture[0].camera_rad = {0.002, 0.0, 0.0};
  views_->render(turned, detail::Normals::smooth);
  views_->render(nothing(), detail::Normals::smooth);
  std::size_t at = 0;
  for (const auto& p : views_->pixels()) {
    while (at < all.size() && all[at].at != p.at) ++at;
    ASSERT_LT(at, all.size());
    EXPECT_TRUE(is_left(p.place));
    EXPECT_EQ(p.value, all[at].value);
    EXPECT_EQ(p.du, all[at].du);
  }
  EXPECT_EQ(static_cast<std::ptrdiff_t>(views_->pixels().size()),
            std::count_if(all.begin(), all.end(), [&](const auto& p) { return is_left(p.place); }));
  views_->look_at({});
  views_->render(nothing(), detail::Normals::smooth);
  EXPECT_EQ(views_->pixels().size(), all.size());
}

// Else a model would seem the better for having more noise, or for which was rendered before it.
TEST_F(Views, AreComparedByTheNoiseOfWhatWasMeasured) {
  views_->render(nothing(), detail::Normals::smooth);
  const auto as_stated = views_->pixels();
  PhotoState with = nothing();
  with.picture[0].black = 0.05;
  with.albedo = -0.2;
  views_->render(with, detail::Normals::smooth);
  const auto& offset = views_->pixels();
  ASSERT_EQ(offset.size(), as_stated.size());
  // 0.3 of full scale everywhere.
  const double sigma2 = (0.3 * 20000.0 + std::pow(scene_.photos[0].read_noise_e, 2)) / 4e8;
  for (std::size_t i = 0; i < offset.size(); ++i) {
    ASSERT_EQ(offset[i].variance_around[0], as_stated[i].variance_around[0]);
    ASSERT_NEAR(offset[i].variance_around[0], sigma2, 1e-6 * sigma2);
    ASSERT_NE(offset[i].variance[0], as_stated[i].variance[0]);
  }
}

// Light that a model adds has shot noise, which the measured value has or not whatever the model.
TEST_F(Views, WeighPixelsAlikeUnderModelsOfMoreOrLessLight) {
  const detail::Layout layout = detail::lay_out(scene_.box, kSeed, false);
  detail::PhotoFit fit(*views_, layout);
  const Effect* ambient = find_effect("lamp.ambient");
  const auto forms = ambient->photo_forms(scene_);
  const std::vector<const PhotoParameter*> by{&forms[0].parameters[0]};  // each rendered as a whole
  const detail::PhotoLinear dark = fit.about({}, by);
  const detail::PhotoLinear lit =
      fit.about({{ambient, forms[0], std::vector<double>(forms[0].parameters.size(), 0.05)}}, by);
  ASSERT_EQ(lit.sigma.size(), dark.sigma.size());
  EXPECT_GT((dark.residual - lit.residual).cwiseAbs().minCoeff(), 1.0F);  // the light is seen
  // What light may be rendered wrong by, 0.2 % of it, is 2.5 % of this; the model's own shot noise
  // would be 10.
  EXPECT_LT((lit.sigma.cwiseQuotient(dark.sigma).array() - 1.0F).abs().maxCoeff(), 0.03F);
}

// Where rays from both ends of the disc over an edge of the relief's height meet level ground.
TEST_F(Views, KnowHowFarALowLampStretchesAPenumbra) {
  constexpr double kDiameter = 30.0, kHeight = 3.2;
  const PhotoInput& of = scene_.photos[0];
  const Vec3 lamp = of.lamp_position_mm - of.lamp_target_mm;
  const double way = norm(lamp), across = std::hypot(lamp.x, lamp.y);
  const auto shadow = [&](double end) {  // of the disc, which faces the target
    const double z = lamp.z + end * across / way, x = across - end * lamp.z / way;
    return kHeight * x / (z - kHeight);
  };
  const double wide = shadow(-0.5 * kDiameter) - shadow(0.5 * kDiameter);
  const double pixel = of.pixel_pitch_um / 1000.0 / of.focal_length_mm *
                       norm(of.camera_position_mm - of.lamp_target_mm);
  views_->render(nothing(), detail::Normals::smooth);
  EXPECT_NEAR(views_->penumbra_px(kDiameter), wide / pixel, 0.02 * wide / pixel);
}

// Twice the stated read noise in shadow, in a file of numbers from 0 up: what is dark is not
// lighter than it was for that.
TEST_F(Views, KnowTheNoiseOfTheDarkAndWhatIsCutOffThere) {
  constexpr double kSigma = 0.002;
  scene_.photos[0].lamp_position_mm = {900.0, 100.0, 250.0};  // low: a part is in shadow
  for (const bool cut : {false, true}) {
    detail::Photograph dark;
    dark.value.push_back(Grid<float>(192, 256, 0.0F));
    for (std::size_t i = 0; i < dark.value[0].cells().size(); ++i) {
      const double number = kSigma * random_normal(kSeed, i);
      dark.value[0].cells()[i] = static_cast<float>(cut ? std::fmax(0.0, number) : number);
    }
    detail::PhotoViews views(scene_, {dark}, {&field_});
    views.render(nothing(), detail::Normals::smooth);
    double seen = 0.0;
    for (const auto& p : views.pixels()) {
      if (p.lamp.share > 0.0F) continue;
      seen += 1.0;
      // A quantile of some thousand numbers: 3 %.
      if (cut) {
        EXPECT_NEAR(p.cut_sigma[0], kSigma, 0.08 * kSigma);
        EXPECT_NEAR(views.number_of(p, 0, 0.0F), kSigma / std::sqrt(2.0 * std::numbers::pi),
                    0.08 * 0.4 * kSigma);
      } else {
        EXPECT_EQ(p.cut_sigma[0], 0.0F);
        EXPECT_EQ(views.number_of(p, 0, 0.0F), 0.0);
        EXPECT_NEAR(std::sqrt(p.variance_around[0]), kSigma, 0.1 * kSigma);
      }
    }
    EXPECT_GT(seen, 500.0);
  }
}

// In focus at the part's middle, and more than a pixel off beside it.
TEST_F(Views, ABlurByDistanceCountsWhereItIsWidest) {
  views_->render(nothing(), detail::Normals::smooth);
  const detail::PhotoFit fit(*views_, detail::lay_out(scene_.box, kSeed, false));
  const Effect* defocus = find_effect("photo.defocus");
  for (const PhotoForm& form : defocus->photo_forms(scene_)) {
    if (form.law != "by distance, of a lens focused elsewhere") continue;
    double widest = 0.0;
    PhotoState state = nothing();
    form.parameters[2].add(state, 1.0);
    for (const auto& p : views_->pixels())
      widest = std::fmax(widest, focus_px2(p.place, 0, state, scene_));
    // Nine tenths of the pixels have less than is asked for; then nearly all of those have more.
    EXPECT_FALSE(
        detail::is_large_enough(fit, {defocus, form, {0.0, 0.0, form.least / widest}}, 1.0));
    EXPECT_TRUE(
        detail::is_large_enough(fit, {defocus, form, {0.0, 0.0, 10.0 * form.least / widest}}, 1.0));
    return;
  }
  FAIL() << "no such law";
}

TEST(CutOff, HasTheMeanOfWhatIsLeft) {
  // Against sums over the normal distribution.
  for (const double y : {-0.5, 0.0, 0.3, 1.0, 2.5, 6.0}) {
    double mean = 0.0, more = 0.0, all = 0.0;
    constexpr double kStep = 1e-4, kChange = 1e-3;
    for (double t = -8.0; t < 8.0; t += kStep) {
      const double w = std::exp(-0.5 * t * t);
      all += w;
      mean += w * std::fmax(0.0, y + t);
      more += w * std::fmax(0.0, y + kChange + t);
    }
    EXPECT_NEAR(detail::cut_off(3.0 * y, 3.0).mean, 3.0 * mean / all, 1e-5);
    EXPECT_NEAR(detail::cut_off(3.0 * y, 3.0).slope, (more - mean) / all / kChange, 1e-3);
  }
  EXPECT_EQ(detail::cut_off(-0.1, 0.0).mean, -0.1);  // nothing is cut off
}

TEST(CutOff, TellsTheNoiseByItsZeros) {
  for (const double offset : {-0.5, 0.0, 0.7}) {
    std::vector<float> numbers;
    for (std::uint64_t i = 0; i < 4000; ++i)
      numbers.push_back(
          static_cast<float>(std::fmax(0.0, 2.0 * (offset + random_normal(kSeed, i)))));
    // A median of two thousand and a share of zeros: 3 %.
    EXPECT_NEAR(detail::sigma_of_cut(numbers), 2.0, 0.15) << offset;
    for (float& x : numbers) x += 20.0F;
    EXPECT_EQ(detail::sigma_of_cut(numbers), 0.0);
  }
}

TEST_F(Views, ShowASmallMoveByTheirDerivatives) {
  PhotoState turned = nothing();
  turned.picture[0].camera_rad = {0.0, 1e-4, 0.0};  // 1500 pixels of focal length: 0.15 pixels
  views_->render(nothing(), detail::Normals::smooth);
  const auto before = views_->pixels();
  views_->render(turned, detail::Normals::smooth, false, false);
  const auto shifted = views_->pixels();
  views_->render(turned, detail::Normals::smooth);
  const auto rendered = views_->pixels();
  ASSERT_EQ(shifted.size(), rendered.size());
  double moved = 0.0, missed = 0.0;
  for (std::size_t i = 0; i < rendered.size(); ++i) {
    moved += std::pow(rendered[i].value[0] - before[i].value[0], 2);
    missed += std::pow(rendered[i].value[0] - shifted[i].value[0], 2);
  }
  ASSERT_GT(moved, 0.0);
  // Third derivatives of waves of 20 pixels and more, and rays that meet other cells.
  EXPECT_LT(std::sqrt(missed / moved), 0.1);
  EXPECT_GT(missed, 0.0) << "it was rendered anew";
}

TEST(PhotoChain, ALambertPlaneFollowsTheInverseSquareOfTheDistance) {
  const PhotoScene scene = one_photo();
  const PhotoState s = nothing();
  PhotoPixel p;
  p.normal = {0.0, 0.0, 1.0};
  for (const double x : {-40.0, 0.0, 40.0}) {
    p.place = {x, 0.0, 0.0};
    const double squared = (300.0 - x) * (300.0 - x) + 400.0 * 400.0;
    EXPECT_NEAR(PhotoChain(s, s, scene).radiance(p),
                0.3 * 400.0 / std::sqrt(squared) * 500.0 * 500.0 / squared, 1e-12);
  }
  p.place = {-100.0, 300.0, 0.0};  // 45 degrees off a lamp of 56
  EXPECT_EQ(PhotoChain(s, s, scene).radiance(p), 0.0);
}

// Hapke's law of 1981, w = 0.5, phase 60, incidence 45 and emission 30 degrees: 0.0832883.
TEST(PhotoChain, APlaneOfADeclaredLawHasItsPublishedValue) {
  PhotoScene scene = one_photo();
  PhotoInput& photo = scene.photos[0];
  const double i = std::numbers::pi / 4.0, e = std::numbers::pi / 6.0,
               azimuth = std::acos((std::cos(std::numbers::pi / 3.0) - std::cos(i) * std::cos(e)) /
                                   (std::sin(i) * std::sin(e)));
  photo.lamp_position_mm = 1500.0 * Vec3{std::sin(i), 0.0, std::cos(i)};
  photo.lamp_target_mm = {0.0, 0.0, 0.0};
  photo.camera_position_mm =
      600.0 * Vec3{std::sin(e) * std::cos(azimuth), std::sin(e) * std::sin(azimuth), std::cos(e)};
  camera::Hapke hapke;
  hapke.form = camera::Hapke::Form::y1981;
  hapke.w = {0.5, 0.5, 0.5};
  photo.law = hapke;
  PhotoPixel p;
  p.normal = {0.0, 0.0, 1.0};
  PhotoState s = nothing();
  const double plain = PhotoChain(s, s, scene).radiance(p);
  EXPECT_NEAR(plain / photo.exposure_scale, 0.0832883, 1e-6);
  s.albedo = 0.02;  // all of it brighter
  EXPECT_NEAR(PhotoChain(s, s, scene).radiance(p), 1.02 * plain, 1e-12);
}

// D F G / (4 mu0 mu) with GGX in tangents (Walter et al. 2007, equations 33 and 34), over what it
// is where light, view and normal are one.
TEST(PhotoChain, FacetsWithALongTailFollowTheirLaw) {
  PhotoScene scene = one_photo();
  PhotoPixel p;
  p.normal = normalized(Vec3{0.1, -0.2, 1.0});
  const PhotoState none = nothing();
  for (std::size_t k = 0; k < kFacetSlopes.size(); ++k)
    for (const Vec3 camera : {Vec3{0.0, 0.0, 500.0}, Vec3{-400.0, 100.0, 350.0}}) {
      scene.photos[0].camera_position_mm = camera;
      PhotoState s = nothing();
      s.ggx[k] = 0.02;
      const Vec3 l = normalized(scene.photos[0].lamp_position_mm), e = normalized(camera),
                 h = normalized(l + e);
      const double mu0 = dot(p.normal, l), mu = dot(p.normal, e), c = dot(p.normal, h),
                   a2 = kFacetSlopes[k] * kFacetSlopes[k];
      const auto tan2 = [](double cosine) { return 1.0 / (cosine * cosine) - 1.0; };
      const auto masked = [&](double cosine) {
        return 2.0 / (1.0 + std::sqrt(1.0 + a2 * tan2(cosine)));
      };
      const double d = std::pow(a2 / (c * c * (a2 + tan2(c))), 2),  // over that at 0
          fresnel = (0.04 + 0.96 * std::pow(1.0 - dot(e, h), 5)) / 0.04;
      const double distance = norm(scene.photos[0].lamp_position_mm);
      ASSERT_NEAR(distance, 500.0, 1e-9);  // the place is the target: irradiance across light is 1
      EXPECT_NEAR(
          PhotoChain(s, s, scene).radiance(p) - PhotoChain(none, none, scene).radiance(p),
          scene.photos[0].exposure_scale * 0.02 * d * fresnel * masked(mu0) * masked(mu) / mu, 1e-9)
          << k;
    }
}

TEST(PhotoChain, PlacesMoveAsAPinholeProjectsThem) {
  const PhotoScene scene = one_photo();
  const double f = 35.0 * 1000.0 / 8.45;
  PhotoPixel p;
  p.place = {30.0, -20.0, 5.0};
  p.u = static_cast<float>(f * 30.0 / 495.0);
  p.v = static_cast<float>(f * 20.0 / 495.0);
  PhotoState s = nothing();
  s.picture[0].camera_mm = {0.4, 0.0, 0.3};
  const auto moved = displacement(p, 1, s, scene);
  EXPECT_NEAR(moved[0], f * (29.6 / 495.3 - 30.0 / 495.0), 1e-6);
  EXPECT_NEAR(moved[1], f * (20.0 / 495.3 - 20.0 / 495.0), 1e-6);
  s = nothing();
  s.radial_1 = 0.05;  // Brown: u (1 + k1 r^2), r of u over the focal length
  const double r2 = (30.0 * 30.0 + 20.0 * 20.0) / (495.0 * 495.0);
  EXPECT_NEAR(displacement(p, 1, s, scene)[0], 0.05 * r2 * f * 30.0 / 495.0, 1e-4);
  s = nothing();
  s.red_scale = 1e-3;
  EXPECT_NEAR(displacement(p, 0, s, scene)[1], 1e-3 * f * 20.0 / 495.0, 1e-5);
  EXPECT_EQ(displacement(p, 2, s, scene)[1], 0.0);
}

TEST(PhotoChain, ARoomLightsByHowAPlaceLeansAndByBand) {
  const PhotoScene scene = one_photo();
  PhotoPixel p;
  p.place = {0.0, 0.0, 0.0};
  p.normal = normalized(Vec3{0.6, -0.2, 1.0});
  p.sky = 0.9F;
  const PhotoState dark = nothing();
  PhotoState s = nothing();
  s.ambient_sky = 0.03;
  s.ambient_side = {0.01, -0.004, 0.02};
  p.sky_side = {0.5F, -0.1F, 0.8F};
  const double lamp = PhotoChain(dark, dark, scene).radiance(p);
  EXPECT_NEAR(PhotoChain(s, s, scene).radiance(p) - lamp,
              0.3 * (0.9 * 0.03 + 0.5 * 0.01 + 0.1 * 0.004 - (0.9 - 0.8) * 0.02), 1e-8);
  // Of a band alone, whatever the others: a white balance would be a factor on the lamp's, too.
  s.ambient_red = -0.01;
  s.ambient_blue = 0.006;
  p.light = PhotoChain(s, dark, scene).radiance(p);
  for (const auto& [channel, more] : {std::pair{0, -0.01}, {1, 0.0}, {2, 0.006}})
    EXPECT_NEAR(PhotoChain(s, dark, scene).value(p, channel, p.light), 0.3 * 0.9 * more, 1e-8);
}

TEST(PhotoChain, OtherLightIsMoreOfTheExposureWhereTheLampIsFurther) {
  PhotoScene scene = one_photo();
  scene.photos.push_back(scene.photos[0]);
  scene.photos[1].lamp_position_mm = 2.0 * scene.photos[0].lamp_position_mm;
  scene.lamp_of = {0, 1};
  scene.lamps = 2;
  PhotoState dark;
  dark.lamp_mm.resize(2);
  dark.lamp_refocused_mm.resize(2);
  dark.picture.resize(2);
  PhotoState s = dark;
  s.ambient_steady = 0.03;
  PhotoPixel p;
  p.normal = {0.0, 0.0, 1.0};
  p.sky = 0.9F;
  for (const std::uint32_t k : {0U, 1U}) {
    p.photo = k;
    EXPECT_NEAR(PhotoChain(s, dark, scene).radiance(p) - PhotoChain(dark, dark, scene).radiance(p),
                0.3 * 0.9 * 0.03 * (k == 0 ? 1.0 : 4.0), 1e-8);
  }
}

TEST(PhotoChain, AHaloThatIsAddedTakesNothing) {
  PhotoState s = nothing();
  add_to_halo(s, 0, 0.06);
  add_to_halo(s, 2, 0.04);
  // A place alone in the dark keeps its light; one among its like gets all shares.
  EXPECT_NEAR(exposed(0.5, 0.0, {}, 0.0, 1, 0, s), 0.5, 1e-12);
  EXPECT_NEAR(exposed(0.5, 0.5, {0.5F, 0.5F, 0.5F}, 0.0, 1, 0, s), 0.5 * 1.1, 1e-7);
  // In the middle of what the narrow halo sees, alone in what the wide one does.
  const float seen_wide = 0.0F;
  const double narrow =
      exposed(0.5, 0.0, {0.5F * (1.0F - 0.04F / 1.1F), seen_wide, seen_wide}, 0.0, 1, 0, s);
  EXPECT_NEAR(narrow, 0.5 * 1.06, 2e-4);
}

TEST(PhotoChain, TheDarkestOfASkyIsTheLeastOfAllDirections) {
  for (const Vec3 side : {Vec3{0.0, 0.0, 0.0}, Vec3{0.1, -0.3, 0.2}, Vec3{0.05, 0.02, -0.4},
                          Vec3{0.0, 0.0, 0.3}, Vec3{0.0, 0.0, -0.3}}) {
    PhotoState state;
    state.ambient_sky = 0.25;
    state.ambient_side = side;
    double least = INFINITY;
    for (int i = 0; i <= 90; ++i)
      for (int k = 0; k < 360; ++k) {
        const double up = i * std::numbers::pi / 180.0, around = k * std::numbers::pi / 180.0;
        const Vec3 d{std::cos(up) * std::cos(around), std::cos(up) * std::sin(around),
                     std::sin(up)};
        // As a level place gathers 2/3 of what grows upward, that counts less the level's share.
        least = std::fmin(least, 0.25 + 1.5 * dot(side, d) - side.z);
      }
    // Half a degree off the darkest direction is 4e-5 of the amplitude.
    EXPECT_NEAR(darkest_sky(state), least, 1e-4);
  }
}

TEST(PhotoChain, ALensFocusedBesideThePartSpreadsByDistance) {
  const PhotoScene scene = one_photo();  // looks down from 500 mm; the box's middle is 5 mm high
  // A disc of C |1 / d - 1 / F| pixels, its variance a sixteenth of its square.
  constexpr double kDisc = 26000.0, kFocus = 540.0, kReference = 495.0;
  const double a = kDisc / 4.0 / kReference, off = 1.0 - kReference / kFocus;
  PhotoState s = nothing();
  const PhotoState sharp = nothing();  // chains keep references
  s.focus_px2 = {a * a * off * off, 2.0 * a * a * off, a * a};
  PhotoPixel p;
  p.duu = 0.01F;
  p.dvv = -0.004F;
  for (const double z : {0.0, 5.0, 40.0}) {
    p.place = {30.0, -20.0, z};  // depth is along the axis
    const double disc = kDisc * (1.0 / (500.0 - z) - 1.0 / kFocus);
    EXPECT_NEAR(focus_px2(p.place, 0, s, scene), disc * disc / 16.0, 1e-9);
    EXPECT_NEAR(PhotoChain(s, sharp, scene).value(p, 1, 0.0),
                0.5 * disc * disc / 16.0 * (0.01 - 0.004), 1e-8);
  }
}

// Each picture at 0.93 of its own distance, whatever that is; a lens that is focused once has one.
TEST(PhotoChain, ALensFocusedAnewSpreadsByTheDistanceInItsPicture) {
  PhotoScene scene = one_photo();
  scene.photos.push_back(scene.photos[0]);
  scene.photos[1].camera_position_mm.z = 350.0;
  scene.lamp_of = {0, 0};
  constexpr double kRadius_px = 22.0, kShare = 0.93;
  const auto forms = find_effect("photo.defocus")->photo_forms(scene);
  const auto form = std::find_if(forms.begin(), forms.end(), [](const PhotoForm& f) {
    return f.law == "by distance, of a lens focused anew for each picture";
  });
  ASSERT_NE(form, forms.end());
  PhotoState s = nothing();
  s.picture.resize(2);
  const double near = 1.0 - kShare, quarter = kRadius_px * kRadius_px / 4.0;
  const std::array<double, 3> values{quarter * near * near, -2.0 * quarter * near * kShare,
                                     quarter * kShare * kShare};
  for (std::size_t i = 0; i < values.size(); ++i) form->parameters[i].add(s, values[i]);
  for (const std::size_t k : {0U, 1U})
    for (const double z : {0.0, 5.0, 40.0}) {
      const double camera = scene.photos[k].camera_position_mm.z, middle = camera - 5.0;
      const double radius = kRadius_px * (1.0 - kShare * middle / (camera - z));
      EXPECT_NEAR(focus_px2({30.0, -20.0, z}, k, s, scene), radius * radius / 4.0, 1e-9);
    }
}

TEST(PhotoChain, TheSensorsStepsComeInTheirOrder) {
  PhotoState s = nothing();
  s.picture[0].exposure = 0.1;
  s.picture[0].red = 0.2;
  s.picture[0].black = 0.05;
  s.gamma = -0.5;
  s.vignette_2 = -0.3;
  s.veil = 0.02;
  EXPECT_NEAR(exposed(0.4, 0.3, {}, 0.5, 0, 0, s),
              std::sqrt((0.4 * (1.0 - 0.15) + 0.02 * 0.3) * 1.1 * 1.2 + 0.05), 1e-15);
}

}  // namespace
}  // namespace maquette::diagnosis
