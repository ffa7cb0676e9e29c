// SPDX-License-Identifier: GPL-3.0-or-later

// camera/lamp.hpp, camera/spectrum.hpp, lamps and surroundings of camera/render.hpp:
//   irradiance of a plane ............ several lamps add; a table scales by angle; a sun is even
//   many places together ............. the same light as one by one, to the bit
//   penumbra of a sun ................ width = height times angular diameter, 2 %
//   tables ........................... LM-63 of every symmetry, CSV; bad files name the line
//   surroundings ..................... even: albedo times radiance; a panel: its form factor
//   one bounce ....................... inside of a sphere: rho (1 + rho) E
//   foil ............................. a field of even radiance gives the directional albedo
//   adaptive sampling ................ more samples where it is noisy, the target is kept
//   spectra .......................... Stefan's and Wien's laws, illuminance back from radiance

#include "camera/lamp.hpp"

#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "camera/render.hpp"
#include "camera/spectrum.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::camera {
namespace {

using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::sphere_solid;
using testing_support::Succeeds;

constexpr double kPi = std::numbers::pi, kRad = kPi / 180.0;

Material lambert(double albedo) {
  return {"grey", Lambert{{albedo, albedo, albedo}}};
}
std::filesystem::path written(const std::string& name, const std::string& text) {
  static const testing_support::ScratchFolder folder;
  const auto path = folder / name;
  std::ofstream(path) << text;
  return path;
}

// ---- lamps on a plane -------------------------------------------------------

class LampsOnAPlane : public testing::Test {
 protected:
  TriMesh slab = box_solid({-500, -500, -10}, {500, 500, 0});
  CameraModel camera{24, 16, 100.0, 8.0};
  RigidTransform pose = look_at({50, -150, 260}, {10, 20, 0});

  Image picture(const Lighting& lighting, const RenderOptions& options = {1}) const {
    const auto scene = PreparedScene::build({{&slab, lambert(0.4)}});
    auto image = scene->render(camera, pose, lighting, options);
    EXPECT_THAT(image, Succeeds());
    return *std::move(image);
  }
  /// Visits what each pixel's centre sees of the plane.
  template <class Visit>
  void each(const Visit& visit) const {
    for (std::ptrdiff_t r = 0; r < 16; ++r)
      for (std::ptrdiff_t c = 0; c < 24; ++c) {
        const Vec3 way =
            pose.direction(normalized(Vec3{(static_cast<double>(c) + 0.5 - 12) * 0.1,
                                           (8 - static_cast<double>(r) - 0.5) * 0.1, -8.0}));
        const Vec3 p = pose.translation_mm + (-pose.translation_mm.z / way.z) * way;
        if (std::abs(p.x) < 499 && std::abs(p.y) < 499) visit(r, c, p);
      }
  }
};

TEST_F(LampsOnAPlane, AddUpInEveryBand) {
  const Lamp one{.position_mm = {-300, 120, 400},
                 .target_mm = {20, -10, 0},
                 .beam_deg = 150,
                 .colour = {1.0, 0.5, 0.25}};
  const Lamp two{.position_mm = {200, -80, 300},
                 .target_mm = {0, 0, 0},
                 .beam_deg = 150,
                 .colour = {0.1, 0.2, 0.9}};
  const Image both = picture({{one, two}, {}, {}});
  ASSERT_EQ(both.bands.size(), 3U);
  each([&](std::ptrdiff_t r, std::ptrdiff_t c, Vec3 p) {
    for (std::size_t b = 0; b < 3; ++b) {
      double expected = 0.0;
      for (const Lamp& lamp : {one, two}) {
        const Vec3 l = lamp.position_mm - p, axis = lamp.target_mm - lamp.position_mm;
        expected += 0.4 * lamp.colour[b] * l.z / norm(l) * dot(axis, axis) / dot(l, l);
      }
      EXPECT_NEAR(both.bands[b](r, c) / expected, 1.0, 1e-6);  // float; 0.1 % is promised
    }
  });
}

TEST_F(LampsOnAPlane, FollowTheirIntensityTable) {
  // I(angle) = 1000 - 10 angle: linear, so exact between the nodes.
  const auto table =
      read_intensity(written("linear.csv", "angle_deg,intensity\n0,1000\n40,600\n90,100\n"));
  ASSERT_THAT(table, Succeeds());
  const Lamp lamp{.position_mm = {-100, 120, 400},
                  .target_mm = {0, 0, 0},
                  .beam_deg = 180,
                  .intensity = std::make_shared<IntensityTable>(*table)};
  const Image image = picture({{lamp}, {}, {}});
  const Vec3 axis = lamp.target_mm - lamp.position_mm;
  each([&](std::ptrdiff_t r, std::ptrdiff_t c, Vec3 p) {
    const Vec3 l = lamp.position_mm - p;
    const double angle = std::acos(-dot(l, axis) / norm(l) / norm(axis)) / kRad;
    const double expected =
        0.4 * l.z / norm(l) * dot(axis, axis) / dot(l, l) * (1000 - 10 * angle) / 1000;
    EXPECT_NEAR(image.bands[0](r, c) / expected, 1.0, 1e-6);
  });
}

TEST_F(LampsOnAPlane, ASunIsEven) {
  const Lamp sun{.position_mm = {-300, 0, 400}, .target_mm = {0, 0, 0}, .sun_diameter_deg = 0.533};
  const Image image = picture({{sun}, {}, {}}, {1, 16});
  // The disc's mean direction is the sun's, its cosine less by a quarter of its radius squared.
  each([&](std::ptrdiff_t r, std::ptrdiff_t c, Vec3) {
    EXPECT_NEAR(image.bands[0](r, c), 0.4 * 0.8, 0.4 * 0.8 * 1e-3);
  });
}

TEST(Sun, HasThePenumbraOfItsAngle) {
  // An edge 100 mm above the ground under a sun of 6 degrees: the penumbra is
  // 100 mm 2 tan(3 deg) = 10.48 mm wide. Where a share f of the disc is seen, its chord lies at
  // cut = x / (half width): the circle's segment.
  const TriMesh slab = box_solid({-500, -500, -10}, {500, 500, 0});
  const TriMesh screen = box_solid({-400, -400, 100}, {0, 400, 100.001});
  const Lamp sun{.position_mm = {0, 0, 1000}, .target_mm = {0, 0, 0}, .sun_diameter_deg = 6.0};
  const CameraModel camera{128, 4, 100.0, 400.0};
  const auto pose = look_at({300, 0, 60}, {0, 0, 0}, {0, 1, 0});
  const auto scene = PreparedScene::build({{&slab, lambert(1)}, {&screen, lambert(1)}});
  const auto image = scene->render(camera, pose, {{sun}, {}, {}}, {1, 1024, 1.0, 3});
  ASSERT_THAT(image, Succeeds());
  // The width by a straight line through the shares between 0.2 and 0.8: slope dx/df.
  double n = 0, sx = 0, sf = 0, sxf = 0, sff = 0;
  const auto share = [](double cut) {
    return 0.5 + (std::asin(cut) + cut * std::sqrt(1 - cut * cut)) / kPi;
  };
  // Where the segment's share is 0.2 and 0.8 the chord lies at -+0.492 of the radius.
  for (std::ptrdiff_t r = 0; r < 4; ++r)
    for (std::ptrdiff_t c = 0; c < 128; ++c) {
      const Vec3 way =
          pose.direction(normalized(Vec3{(static_cast<double>(c) + 0.5 - 64) * 0.1,
                                         (2 - static_cast<double>(r) - 0.5) * 0.1, -400}));
      const double x = 300 - 60 / way.z * way.x;
      const double f = static_cast<double>(image->bands[0](r, c));
      EXPECT_NEAR(f, share(std::clamp(x / (100 * std::tan(3 * kRad)), -1.0, 1.0)), 0.017) << x;
      if (f < 0.2 || f > 0.8) continue;
      // chord of this share by Newton's iteration
      double cut = 0;
      for (int i = 0; i < 20; ++i) cut -= (share(cut) - f) / (2 * std::sqrt(1 - cut * cut) / kPi);
      n += 1, sx += x, sf += cut, sxf += x * cut, sff += cut * cut;
    }
  ASSERT_GT(n, 50);
  const double half_width = (sxf - sx * sf / n) / (sff - sf * sf / n);
  EXPECT_NEAR(half_width / (100 * std::tan(3 * kRad)), 1.0, 0.02);
}

// ---- tables -----------------------------------------------------------------

std::string ies(const std::string& horizontal, const std::string& candela) {
  return "IESNA:LM-63-2002\r\n[TEST] none\r\nTILT=NONE\r\n1 1000 2.0 3 " +
         std::to_string(1 + std::count(horizontal.begin(), horizontal.end(), ' ')) +
         " 1 2 0 0 0\r\n1.0 1.0 575\r\n0 45 90\r\n" + horizontal + "\r\n" + candela + "\r\n";
}

TEST(Intensity, OfLm63IsScaledAndMirrored) {
  const auto round = read_intensity(written("round.ies", ies("0", "100 50 0")));
  ASSERT_THAT(round, Succeeds());
  EXPECT_DOUBLE_EQ(round->at(0, 123), 200.0);  // times the multiplier of 2
  EXPECT_DOUBLE_EQ(round->at(22.5, -77), 150.0);
  EXPECT_DOUBLE_EQ(round->at(91, 0), 0.0);
  const auto quarter = read_intensity(written("quarter.ies", ies("0 90", "100 50 0\n100 70 10")));
  ASSERT_THAT(quarter, Succeeds());
  for (const double azimuth : {30.0, 150.0, 210.0, 330.0, -30.0, 390.0})
    EXPECT_NEAR(quarter->at(45, azimuth), 2 * (50 + 20 * 30 / 90.0), 1e-12) << azimuth;
  const auto half =
      read_intensity(written("half.ies", ies("0 90 180", "100 50 0 100 70 10 100 90 20")));
  ASSERT_THAT(half, Succeeds());
  EXPECT_NEAR(half->at(45, 135), 160, 1e-12);
  EXPECT_NEAR(half->at(45, 225), 160, 1e-12);
  const auto full = read_intensity(
      written("full.ies", ies("0 90 180 270 360", "100 50 0 100 60 0 100 70 0 100 80 0 100 50 0")));
  ASSERT_THAT(full, Succeeds());
  EXPECT_NEAR(full->at(45, 315), 130, 1e-12);
}

TEST(Intensity, SaysHowMuchLightALampGives) {
  // An even cone, a Lambert source (pi), and one that is brighter to two sides.
  const double half = 28.0 * kRad;
  EXPECT_NEAR(solid_angle_sr({{0, 10, 28}, {0}, {7, 7, 7}}), 2 * kPi * (1 - std::cos(half)), 1e-12);
  IntensityTable lambert{{}, {0}, {}};
  for (int i = 0; i <= 90; ++i) {
    lambert.angle_deg.push_back(i);
    lambert.intensity.push_back(5 * std::cos(kRad * i));
  }
  // Lines under an arc of a degree: 1/12 degree^2, 2.5e-5.
  EXPECT_NEAR(solid_angle_sr(lambert), kPi, 1e-4);
  const IntensityTable uneven{{0, 60}, {0, 90}, {1, 1, 1, 3}};
  const double round = 2 * kPi * 0.5;
  // Beside the even part: twice the share of the azimuth, 1/2 in the mean, times that of the angle.
  const double end = 60 * kRad, ramp = (std::sin(end) - end * std::cos(end)) / end;
  EXPECT_NEAR(solid_angle_sr(uneven), round + 2 * kPi * ramp, 1e-3);
}

TEST(Intensity, MayHaveRemarks) {
  const auto table = read_intensity(
      written("remarks.csv", "angle_deg,intensity\n# assumed\n0,4\n\n # and more\n10,2\n# end\n"));
  ASSERT_THAT(table, Succeeds());
  EXPECT_DOUBLE_EQ(table->at(5, 0), 3.0);
}

TEST(Intensity, IsRefusedWithItsLine) {
  const auto says = [](const std::string& name, const std::string& text, const std::string& what) {
    const auto table = read_intensity(written(name, text));
    ASSERT_THAT(table, FailsWith(kIntensityFile));
    EXPECT_NE(table.error().message.find(what), std::string::npos) << table.error().message;
  };
  says("a.ies", "nothing\n", "TILT");
  says("b.ies", "TILT=other.tlt\n", "line 1");
  says("c.ies", "TILT=NONE\n1 1000 1 3 1 2 2 0 0 0\n1 1 575\n", "type C");
  says("d.ies", ies("0", "100 50"), "number 3 of 3 intensities");
  says("e.ies", ies("0", "100 -50 0"), "negative");
  says("f.ies", ies("0 77", "1 1 1 1 1 1"), "horizontal");
  says("g.csv", "angle,intensity\n", "line 1");
  says("h.csv", "angle_deg,intensity\n10,5\n", "begin with 0");
  says("r.csv", "angle_deg,intensity\n# one\n# two\n0,5\nx,y\n", "line 5");
  says("i.csv", "angle_deg,intensity\n0,5\n10\n", "number 2 of 2");
  says("j.csv", "angle_deg,intensity\n", "no row");
}

// ---- surroundings -----------------------------------------------------------

TEST_F(LampsOnAPlane, EvenSurroundingsGiveTheAlbedo) {
  RenderOptions options{1};
  options.gather_samples = 7;
  const Image image = picture({{}, {0.5, 0.5, 0.5}, {}}, options);
  // Cosine-spread rays have no noise here.
  each([&](std::ptrdiff_t r, std::ptrdiff_t c, Vec3) {
    EXPECT_NEAR(image.bands[0](r, c), 0.4 * 0.5, 1e-6);
  });
}

TEST_F(LampsOnAPlane, APanelGivesItsFormFactor) {
  // A square of side 2a at height h above the point (0, 0), parallel: four quarters of
  // F = 1/(2 pi) [X/sqrt(1+X^2) atan(Y/sqrt(1+X^2)) + Y/sqrt(1+Y^2) atan(X/sqrt(1+Y^2))], X = Y =
  // a/h (Siegel and Howell, configuration C-... of a corner).
  const double a = 200, h = 300, x = a / h, s = std::sqrt(1 + x * x);
  const double factor = 4 / (2 * kPi) * (2 * x / s * std::atan(x / s));
  RenderOptions options{1};
  options.gather_samples = 4096;
  pose = look_at({0, -1, 100}, {0, 0, 0});
  camera = {4, 4, 1.0, 10.0};  // sees the point alone
  const auto scene = PreparedScene::build({{&slab, lambert(0.4)}});
  const auto image = scene->render(
      camera, pose, {{}, {}, {{{-a, -a, h}, {2 * a, 0, 0}, {0, 2 * a, 0}, {2, 2, 2}}}}, options);
  ASSERT_THAT(image, Succeeds());
  // 4096 stratified rays: about 64 cells of the rim are uncertain, sigma 4/4096; mean of 16 pixels.
  double mean = 0;
  for (const float v : image->bands[0].cells()) mean += static_cast<double>(v) / 16;
  EXPECT_NEAR(mean, 0.4 * 2 * factor, 0.4 * 2 * 0.003);
}

TEST(Bounce, InsideASphereAddsRhoTimesTheDirectLight) {
  TriMesh ball = sphere_solid({0, 0, 0}, 100, 200);
  for (auto& t : ball.triangles) std::swap(t[1], t[2]);  // seen from within
  const Lamp lamp{.position_mm = {0, 0, 0}, .target_mm = {100, 0, 0}, .beam_deg = 360};
  RenderOptions options{16};
  options.gather_samples = 16;
  options.bounce = true;
  const auto image = render({{&ball, lambert(0.5)}}, {16, 16, 100.0, 2.0},
                            look_at({10, -20, 5}, {50, 60, 20}), lamp, options);
  ASSERT_THAT(image, Succeeds());
  // Every facet faces the lamp to within 1/100 of a radian; every ray meets the same radiance: no
  // noise but that of facets, 1e-3.
  for (const float v : image->bands[0].cells()) EXPECT_NEAR(v, 0.5 * (1 + 0.5), 2e-3);
}

TEST_F(LampsOnAPlane, FoilUnderAnEvenSkyGivesItsDirectionalAlbedo) {
  const Ggx foil{{1.35, 0.97, 0.62}, {7.47, 6.40, 5.30}, {1.0, 0.8, 0.5}, 0.15};
  RenderOptions options{1};
  options.gather_samples = 256;
  const auto scene = PreparedScene::build({{&slab, {"foil", foil}}});
  const auto image = scene->render(camera, pose, {{}, {1, 1, 1}, {}}, options);
  ASSERT_THAT(image, Succeeds());
  ASSERT_EQ(image->bands.size(), 3U);
  for (std::size_t b = 0; b < 3; ++b) {
    double mean = 0, expected = 0, n = 0;
    each([&](std::ptrdiff_t r, std::ptrdiff_t c, Vec3 p) {
      const Vec3 view = normalized(pose.translation_mm - p);
      expected += directional_albedo(foil, view.z)[b];
      mean += static_cast<double>(image->bands[b](r, c));
      n += 1;
    });
    EXPECT_NEAR(mean / expected, 1.0, 5e-3) << b;
  }
}

TEST(Adaptive, SpendsItsSamplesWhereItIsNoisy) {
  const TriMesh slab = box_solid({-500, -500, -10}, {500, 500, 0});
  const TriMesh screen = box_solid({-400, -400, 100}, {0, 400, 101});
  const Lamp lamp{{0, 0, 1000}, {0, 0, 0}, 80, 90};
  const CameraModel camera{32, 32, 200.0, 60.0};
  const auto pose = look_at({150, 0, 80}, {0, 0, 0}, {0, 1, 0});
  RenderOptions options{4};
  const std::vector<SceneObject> objects{{&slab, lambert(1)}, {&screen, lambert(1)}};
  const auto few = render(objects, camera, pose, lamp, options);
  options.noise_target = 0.02;
  options.max_samples = 1024;
  const auto adaptive = render(objects, camera, pose, lamp, options);
  options.noise_target = 0;
  options.samples_per_pixel = 1024;
  const auto truth = render(objects, camera, pose, lamp, options);
  ASSERT_THAT(few, Succeeds());
  ASSERT_THAT(adaptive, Succeeds());
  ASSERT_THAT(truth, Succeeds());
  EXPECT_EQ(few->mean_samples, 4.0);
  EXPECT_GT(adaptive->mean_samples, 6.0);
  EXPECT_LT(adaptive->mean_samples, 500.0);
  double coarse = 0, fine = 0, n = 0;
  for (std::size_t i = 0; i < truth->bands[0].cells().size(); ++i) {
    const auto t = static_cast<double>(truth->bands[0].cells()[i]);
    if (t <= 0.05) continue;
    coarse += std::pow(static_cast<double>(few->bands[0].cells()[i]) / t - 1, 2);
    fine += std::pow(static_cast<double>(adaptive->bands[0].cells()[i]) / t - 1, 2);
    n += 1;
  }
  // The target, and as much again of the truth's own noise where a twentieth of the lens is seen.
  EXPECT_LT(std::sqrt(fine / n), 0.035);
  EXPECT_GT(std::sqrt(coarse / n), 0.04);
}

// ---- spectra ----------------------------------------------------------------

TEST(Spectrum, OfABlackBodyObeysStefanAndWien) {
  double sum = 0, peak = 0, at = 0;
  for (double nm = 50; nm < 100000; nm += 5) {
    const double v = planck(nm, 5772.0);
    sum += 5 * v;
    if (v > peak) peak = v, at = nm;
  }
  EXPECT_NEAR(sum * kPi / (5.670374419e-8 * std::pow(5772.0, 4)), 1.0, 1e-3);
  EXPECT_NEAR(at, 2.897771955e6 / 5772.0, 5.0);
}

TEST(Spectrum, BandsOfAWhiteOneAreAsWideAsTheirFilters) {
  const SpectralCurve flat{{300, 1100}, {2, 2}};
  const Bands light = band_light(flat, box_bands());
  EXPECT_NEAR(light[0], 2 * 100, 2.1);  // one step of 1 nm at the ends
  EXPECT_NEAR(light[1], 2 * 90, 2.1);
  EXPECT_NEAR(light[2], 2 * 90, 2.1);
}

/// Planck's radiance up to a wavelength, W m^-2 sr^-1, by the series of exponentials (Widger and
/// Woodall 1976, doi:10.1175/1520-0477(1976)057<1217:IOTPBR>2.0.CO;2), to 1e-12.
double planck_up_to(double nm, double kelvin) {
  constexpr double h = 6.62607015e-34, c = 299792458.0, k = 1.380649e-23;
  const double x = h * c / (1e-9 * nm * k * kelvin);
  double sum = 0;
  for (int n = 1; n < 60; ++n)
    sum += std::exp(-n * x) *
           (x * x * x / n + 3 * x * x / n / n + 6 * x / n / n / n + 6.0 / n / n / n / n);
  return 2 * std::pow(k * kelvin, 4) / (h * h * h * c * c) * sum;
}

TEST(Spectrum, OfABlackBodyHasPlancksIntegralsInTheBands) {
  for (const double kelvin : {2856.0, 5772.0, 6000.0, 9000.0}) {
    const Bands light = band_light(black_body(kelvin), box_bands());
    const std::array<std::array<double, 2>, 3> ends{{{580, 680}, {490, 580}, {400, 490}}};
    Bands exact{};
    for (std::size_t b = 0; b < 3; ++b) {
      exact[b] = planck_up_to(ends[b][1], kelvin) - planck_up_to(ends[b][0], kelvin);
      // Lines of 2 nm and trapezia of 1 nm: h^2/12 of the second derivative, 5e-5 at worst here.
      EXPECT_NEAR(light[b] / exact[b], 1.0, 1e-4) << kelvin << ' ' << b;
    }
    const auto colour = colour_of(black_body(kelvin), box_bands());
    ASSERT_TRUE(colour.has_value());
    EXPECT_EQ((*colour)[1], 1.0);
    EXPECT_NEAR((*colour)[0], exact[0] / 100 / (exact[1] / 90), 1e-4);
    EXPECT_NEAR((*colour)[2], exact[2] / 90 / (exact[1] / 90), 1e-4);
  }
}

TEST(Spectrum, GoesThroughFiltersOfAFile) {
  // Triangles and a trapezium, ends off the grid of 1 nm.
  const auto filters =
      read_filters(written("filters.csv",
                           "wavelength_nm,r,g,b\n# of no camera\n420.5,0,0,0\n500.5,0,1,1\n"
                           "580.5,1,0,1\n660.5,0,0,0\n"));
  ASSERT_THAT(filters, Succeeds());
  const Bands area = band_light({{300, 1100}, {1, 1}}, *filters);
  // Trapezia of 1 nm on straight lines with a kink inside a step: at most 1/8 nm of slope 1/80
  // each.
  EXPECT_NEAR(area[0], 80.0, 5e-3);
  EXPECT_NEAR(area[1], 80.0, 5e-3);
  EXPECT_NEAR(area[2], 160.0, 5e-3);
  // A spectrum that rises as a straight line is in a symmetric filter what it is in its middle.
  const auto colour = colour_of({{300, 1100}, {0.0, 800.0}}, *filters);
  ASSERT_TRUE(colour.has_value());
  EXPECT_NEAR((*colour)[0], 280.5 / 200.5, 1e-4);
  EXPECT_NEAR((*colour)[2], 240.5 / 200.5, 1e-4);
  EXPECT_FALSE(colour_of({{600, 700}, {1.0, 1.0}}, *filters).has_value()) << "no light in G";
  for (const char* bad :
       {"wavelength_nm,value\n400,1\n500,1\n", "wavelength_nm,r,g,b\n400,1,1\n500,1,1,1\n",
        "wavelength_nm,r,g,b\n400,1,1,1,1\n500,1,1,1\n", "wavelength_nm,r,g,b\n400,1,1,1\n",
        "wavelength_nm,r,g,b\n400,1,-1,1\n500,1,1,1\n",
        "wavelength_nm,r,g,b\n400,1,1,0\n500,1,1,0\n"})
    EXPECT_THAT(read_filters(written("bad.csv", bad)), FailsWith(kSpectrumFile)) << bad;
}

TEST(Spectrum, TheSunsIlluminanceComesBack) {
  // The Sun at 1 au: 1361 W/m2 of 5772 K give 133 to 135 klx outside the air (a black body 127 klx
  // to 137 klx by the choice of V); the luminous efficacy of a black body at 5772 K is 93 lm/W.
  const SpectralCurve sun = black_body(5772.0);
  const SpectralCurve all{{300, 1100}, {1, 1}};
  const Bands light = white_radiance(sun, 93.0, {all, all, all});
  // pi L in 300 to 1100 nm: 0.739 of all of a black body's power.
  EXPECT_NEAR(kPi * light[0], 0.739, 0.02);
  const Bands warm = band_light(black_body(3000), box_bands());
  const Bands cold = band_light(black_body(9000), box_bands());
  EXPECT_GT(warm[0] / warm[2], 2.0);
  EXPECT_LT(cold[0] / cold[2], 1.0);
}

TEST(Spectrum, FilesAreReadAndRefused) {
  const auto good =
      read_spectrum(written("s.csv", "wavelength_nm,value\n400,0\n# note\n500,1\n700,0.5\n"));
  ASSERT_THAT(good, Succeeds());
  EXPECT_DOUBLE_EQ(good->at(450), 0.5);
  EXPECT_DOUBLE_EQ(good->at(700), 0.5);
  EXPECT_DOUBLE_EQ(good->at(399), 0.0);
  for (const char* bad : {"nm,v\n", "wavelength_nm,value\n400\n", "wavelength_nm,value\n400,1\n",
                          "wavelength_nm,value\n400,1\n400,2\n",
                          "wavelength_nm,value\n400,-1\n500,1\n", "wavelength_nm,value\n400,x\n"})
    EXPECT_THAT(read_spectrum(written("bad.csv", bad)), FailsWith(kSpectrumFile)) << bad;
}

TEST(Light, ArrivesAtManyPlacesAsAtOne) {
  Lamp even, wide, table, sun;
  even.position_mm = wide.position_mm = table.position_mm = {40.0, -30.0, 90.0};
  wide.lens_diameter_mm = 12.0;
  table.intensity =
      std::make_shared<IntensityTable>(IntensityTable{{0.0, 20.0, 60.0}, {0.0}, {3.0, 2.0, 0.5}});
  sun.sun_diameter_deg = 0.5;
  int dark = 0, lit = 0;
  for (const Lamp& lamp : {even, wide, table, sun}) {
    const Light light(lamp);
    for (const std::size_t count : {0U, 1U, 16U, 17U, 40U}) {
      std::vector<Vec3> places(count);
      std::vector<DiscPoint> points(count);
      for (std::size_t i = 0; i < count; ++i) {
        const auto u = [&](std::uint64_t k) { return 2.0 * random_uniform(5, 5 * i + k) - 1.0; };
        places[i] = {120.0 * u(0), 120.0 * u(1), 20.0 * u(2)};
        points[i] = {u(3), u(4)};
      }
      std::vector<Light::Arrival> many(count);
      light.arrive(places, points, many);
      for (std::size_t i = 0; i < count; ++i) {
        const Light::Arrival one = light.arrive(places[i], points[i]);
        ASSERT_EQ(one.direction, many[i].direction);
        ASSERT_EQ(one.distance_mm, many[i].distance_mm);
        ASSERT_EQ(one.strength, many[i].strength);
        ++(one.strength > 0.0 ? lit : dark);
      }
    }
  }
  EXPECT_GT(dark, 50);
  EXPECT_GT(lit, 50);
}

TEST(Lamp, IsRefusedWhenItMakesNoSense) {
  const Lamp good{{0, 0, 10}, {0, 0, 0}};
  EXPECT_THAT(check_lamp(good), Succeeds());
  Lamp bad = good;
  bad.colour[1] = -1;
  EXPECT_THAT(check_lamp(bad), FailsWith(kCameraOutOfRange));
  bad = good;
  bad.sun_diameter_deg = 90;
  EXPECT_THAT(check_lamp(bad), FailsWith(kCameraOutOfRange));
  bad = good;
  bad.intensity = std::make_shared<IntensityTable>(IntensityTable{{0, 10}, {0}, {0, 5}});
  EXPECT_THAT(check_lamp(bad), FailsWith(kCameraOutOfRange));
  const TriMesh slab = box_solid({-5, -5, -10}, {5, 5, 0});
  const auto scene = PreparedScene::build({{&slab, lambert(1)}});
  const auto refused = [&](const Lighting& lighting) {
    return scene->render({4, 4, 10.0, 10.0}, look_at({0, -1, 5}, {0, 0, 0}), lighting);
  };
  EXPECT_THAT(refused({{good}, {NAN, 0, 0}, {}}), FailsWith(kCameraOutOfRange));
  EXPECT_THAT(refused({{good}, {}, {{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {1, 1, 1}}}}),
              FailsWith(kCameraOutOfRange));
}

}  // namespace
}  // namespace maquette::camera
