// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/scanner_sim.hpp of the beam, the angles and the files (the rest is in
// scanner_sim_test.cpp), and how each claim is attacked:
//
//   a Gaussian beam ........ moments of its rays at any range; the degree of the seven
//   planes, spheres ........ a beam as wide as it is leaves a plane where it is and moves a ball's
//                            top by w^2 / (4 R)
//   edges .................. seven rays and 61 where they disagree against 1500 everywhere; smooth
//                            places keep their bits
//   mixed pixels ........... over an edge the range follows the phase sum of a Gaussian beam cut by
//                            a line
//   signal ................. reflectance, incidence, range; too weak is lost
//   errors of angle ........ each alone, on a plane, from the formula written out again; two
//                            faces take collimation, trunnion and index away
//   errors of range ........ each alone, on a plane
//   turned stations ........ points stay on the part; directions are those of the station's grid
//   taken out again ........ (scan/beam_shift.hpp) waves of two beams' width, then less than a
//   tenth is
//                            left; planes are not touched; what lies beside a step is given up
//   files .................. the streamed points are those of the cloud, with time and colour,
//                            several stations in one E57

#include <cmath>
#include <map>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "meshing/stones.hpp"
#include "scan/beam_shift.hpp"
#include "scan/detail/beam.hpp"
#include "scan/detail/scan_scene.hpp"
#include "scan/detail/sight.hpp"
#include "scan/scanner_sim.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"
#include "support/shapes.hpp"
#include "support/streamed_cloud.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::stream_in;
using testing_support::Succeeds;

constexpr double kPi = std::numbers::pi;

ScanOptions wide_beam(double lines_per_turn, Vec3 station, int rays = 7) {
  ScanOptions o;
  o.scanner.name = "test";
  o.scanner.lines_per_turn = lines_per_turn;
  o.scanner.beam_diameter_mm = 3.0;
  o.scanner.beam_divergence_mrad = 0.22;
  o.station_mm = station;
  o.footprint_rays = rays;
  return o;
}

TriMesh ball_mesh(Vec3 centre, double radius, int subdivisions) {
  TriMesh m = testing_support::unit_sphere(subdivisions);
  for (Vec3& v : m.vertices_mm) v = centre + radius * v;
  return m;
}

TriMesh box_mesh(Vec3 a, Vec3 b) {
  TriMesh m;
  for (int i = 0; i < 8; ++i)
    m.vertices_mm.push_back({i & 1 ? b.x : a.x, i & 2 ? b.y : a.y, i & 4 ? b.z : a.z});
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

// ---- the beam --------------------------------------------------------------

TEST(Beam, HasTheMomentsOfAGaussian) {
  for (const int count : {1, 2, 7, 19, 50, 400}) {
    double sum = 0, mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
    for (const detail::BeamSample& s : detail::beam_samples(count)) {
      sum += s.weight;
      mx += s.weight * s.x;
      my += s.weight * s.y;
      xx += s.weight * s.x * s.x;
      xy += s.weight * s.x * s.y;
      yy += s.weight * s.y * s.y;
    }
    EXPECT_NEAR(sum, 1.0, 1e-12);
    EXPECT_NEAR(mx, 0.0, 1e-12);
    EXPECT_NEAR(my, 0.0, 1e-12);
    if (count < 7) continue;
    EXPECT_NEAR(xx, 0.25, 1e-12) << count;
    EXPECT_NEAR(yy, 0.25, 1e-12) << count;
    EXPECT_NEAR(xy, 0.0, 0.25 * 3.0 / count) << count;
  }
  // Degree 4 of exp(-2 r^2): x^4 is 3/16, x^2 y^2 is 1/16.
  double xxxx = 0, xxyy = 0;
  for (const detail::BeamSample& s : detail::beam_samples(7)) {
    xxxx += s.weight * std::pow(s.x, 4);
    xxyy += s.weight * s.x * s.x * s.y * s.y;
  }
  EXPECT_NEAR(xxxx, 3.0 / 16, 1e-12);
  EXPECT_NEAR(xxyy, 1.0 / 16, 1e-12);
}

TEST(Beam, GrowsAsItsHyperbola) {
  const Vec3 axis = normalized(Vec3{1.0, -2.0, -1.5}), origin{100, 200, 300};
  for (const double range : {1.0, 1000.0, 20'000.0, 1e6}) {
    const double w = detail::beam_radius_mm(1.5, 0.22e-3, range);
    EXPECT_NEAR(w, std::sqrt(1.5 * 1.5 + std::pow(0.11e-3 * range, 2)), 1e-9);
    double square = 0.0;
    for (const detail::BeamSample& s : detail::beam_samples(7)) {
      const detail::Ray r = detail::skew_ray(origin, axis, 1.5, 0.22e-3, s, 0.8, 0.6);
      EXPECT_NEAR(norm(r.direction), 1.0, 1e-12);
      const double t = range / dot(r.direction, axis);
      const Vec3 p = r.origin_mm + t * r.direction - origin;
      square += s.weight * dot(p - range * axis, p - range * axis);
    }
    EXPECT_NEAR(square, 0.5 * w * w, 1e-9 * w * w) << "two second moments of w^2 / 4";
  }
}

TEST(Beam, LeavesAPlaneWhereItIs) {
  const ModelField flat{Grid<float>(101, 101, 5.0F), Millimetres{2.0}};
  const ScanOptions o = wide_beam(5000, {100.0, -800.0, 900.0});
  const auto cloud = simulate_scan(flat, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  double worst = 0.0;
  std::size_t inside = 0;
  for (const Vec3& p : cloud->points_mm) {
    // At the outline the beam is cut.
    if (p.x < 6 || p.x > 194 || p.y < 6 || p.y > 194) continue;
    ++inside;
    worst = std::max(worst, std::abs(p.z - 5.0));
  }
  EXPECT_GT(inside, 10'000U);
  // Second order: w^2 / (4 r), amplified by the tangent of 55 degrees at most and by
  // the amplitude's slope along the spot.
  EXPECT_LT(worst, 6.0 * 1.51 * 1.51 / (4.0 * 1100.0));
  EXPECT_GT(worst, 0.0);
}

TEST(Beam, MovesABallsTopByItsCurvature) {
  const ModelField flat{Grid<float>(3, 3, -60.0F), Millimetres{5.0}};
  const Vec3 centre{5.0, 5.0, 0.0}, station{5.0, -600.0, 1880.0};
  const Vec3 towards = normalized(station - centre);
  const TriMesh ball = ball_mesh(centre, 20.0, 6);
  for (const int rays : {1, 7, 60}) {
    const auto cloud = simulate_scan(flat, std::span(&ball, 1), wide_beam(20'000, station, rays));
    ASSERT_THAT(cloud, Succeeds());
    double sum = 0.0;
    int n = 0;
    for (const Vec3& p : cloud->points_mm) {
      if (norm(p - centre) < 15.0 || norm(cross(p - centre, towards)) > 3.0) continue;
      sum += norm(p - centre) - 20.0;
      ++n;
    }
    ASSERT_GT(n, 30);
    const double w2 = 1.5 * 1.5 + 0.22 * 0.22;  // at 1950 mm
    const double expected = rays == 1 ? 0.0 : -w2 / (4.0 * 20.0);
    // Facets stand back by less than 0.002; weighting by the cosine takes some percent.
    EXPECT_NEAR(sum / n, expected, 0.003) << rays;
  }
}

TEST(Beam, MixesTheTwoSidesOfAnEdge) {
  // A plate 300 mm above the ground, seen from above; its edge along y at x = 200, the station
  // over the plate, so that the plate's side is not seen.
  const ModelField ground{Grid<float>(41, 41, 0.0F), Millimetres{2.0}, Millimetres{160.0},
                          Millimetres{460.0}};
  const TriMesh plate = box_mesh({200, 400, 290}, {260, 600, 300});
  const Vec3 station{215.0, 300.0, 3000.0};
  ScanOptions o = wide_beam(5'000, station, 150);
  o.scanner.unambiguous_mm = {79'000.0, 9'875.0, 1'234.375};
  o.scanner.beam_diameter_mm = 12.0;
  const auto cloud = simulate_scan(ground, std::span(&plate, 1), o);
  ASSERT_THAT(cloud, Succeeds());
  const double w = detail::beam_radius_mm(6.0, 0.22e-3, 2700.0);
  int mixed = 0;
  for (const Vec3& p : cloud->points_mm) {
    const Vec3 d = normalized(p - station);
    // Where the beam's middle passes the edge's height.
    const Vec3 at_edge = station + (2700.0 / -d.z) * d;
    const double beside = at_edge.x - 200.0;  // > 0: on the plate
    if (std::abs(beside) > 1.5 * w || std::abs(at_edge.y - 480.0) > 20.0) continue;
    const double on_plate = 0.5 * std::erfc(-std::numbers::sqrt2 * beside / w);
    const double near_mm = 2700.0 / -d.z, far_mm = 3000.0 / -d.z;
    const double a_near = on_plate / (near_mm * near_mm),
                 a_far = (1.0 - on_plate) / (far_mm * far_mm);
    const double turn = 2.0 * kPi * (far_mm - near_mm) / 1'234.375;
    const double expected =
        near_mm +
        1'234.375 * std::atan2(a_far * std::sin(turn), a_near + a_far * std::cos(turn)) / (2 * kPi);
    // 150 rays, turned at random, know their share to some 0.01.
    EXPECT_NEAR(norm(p - station), expected, 300.0 * 0.04) << beside;
    if (expected > near_mm + 30.0 && expected < far_mm - 30.0) ++mixed;
  }
  EXPECT_GT(mixed, 30);
}

TEST(BeamShift, TakesOutWhatTheBeamDoes) {
  // Waves of 12 mm under a beam of 6 mm; then a plane; then a step of 8 mm.
  const Vec3 station{60.0, -500.0, 900.0};
  ScanOptions o = wide_beam(4'000, station, 100);
  o.scanner.beam_diameter_mm = 6.0;
  o.scanner.beam_divergence_mrad = 0.0;
  ModelField waves{Grid<float>(481, 481), Millimetres{0.25}}, plane = waves, step = waves;
  for (std::ptrdiff_t r = 0; r < 481; ++r)
    for (std::ptrdiff_t c = 0; c < 481; ++c) {
      const double x = waves.x_mm(c), y = waves.y_mm(r);
      waves.z_mm(r, c) =
          static_cast<float>(0.3 * std::sin(2.0 * kPi * x / 12.0) * std::cos(2.0 * kPi * y / 12.0));
      plane.z_mm(r, c) = static_cast<float>(0.5 * x - 0.2 * y);
      step.z_mm(r, c) = x > 60.0 ? 8.0F : 0.0F;
    }
  struct Left {
    double before = 0.0, after = 0.0;
    int given_up = 0, far_given_up = 0, all = 0;
  };
  const auto left_on = [&](const ModelField& f) {
    const auto cloud = simulate_scan(f, {}, o);
    EXPECT_THAT(cloud, Succeeds());
    const Viewpoint view{station, 6.0, cloud->points_mm.size()};
    const auto shifts = beam_shifts_mm(cloud->points_mm, std::span(&view, 1), f, {}, 0.1);
    EXPECT_THAT(shifts, Succeeds());
    Left l;
    for (std::size_t i = 0; i < shifts->size(); ++i) {
      const Vec3 p = cloud->points_mm[i];
      if (p.x < 10 || p.x > 110 || p.y < 10 || p.y > 110) continue;  // the whole beam meets it
      ++l.all;
      const float shift = (*shifts)[i];
      if (std::isnan(shift)) {
        ++l.given_up;
        l.far_given_up += std::abs(p.x - 60.0) > 8.0 ? 1 : 0;
        continue;
      }
      const Vec3 as_ray = p - static_cast<double>(shift) * normalized(p - station);
      l.before += std::pow(p.z - heightmap::height_at(f, p.x, p.y), 2);
      l.after += std::pow(as_ray.z - heightmap::height_at(f, as_ray.x, as_ray.y), 2);
    }
    l.before = std::sqrt(l.before / l.all);
    l.after = std::sqrt(l.after / l.all);
    return l;
  };
  const Left on_waves = left_on(waves);
  EXPECT_GT(on_waves.before, 0.03);
  EXPECT_LT(on_waves.after, 0.1 * on_waves.before);
  EXPECT_EQ(on_waves.given_up, 0);
  const Left on_plane = left_on(plane);
  EXPECT_LT(on_plane.after, 5e-4);
  EXPECT_EQ(on_plane.given_up, 0);
  const Left on_step = left_on(step);
  EXPECT_GT(on_step.given_up, 50);
  EXPECT_EQ(on_step.far_given_up, 0);
  EXPECT_LT(on_step.after, 0.05);
}

constexpr double kStonesBeamMm = 3.0;

/// Six stones of 8 mm on rough ground, and a scan of them.
struct StonesScan {
  ModelField ground;
  std::vector<TriMesh> stones;
  ScanOptions options;
};

StonesScan stones_scan(std::uint64_t seed, int footprint_rays, int edge_rays) {
  StonesScan s{testing_support::rough_part(seed, 101, 141, 0.5, 0.5), {}, {}};
  for (std::uint64_t k = 0; k < 6; ++k) {
    meshing::PlacedStone stone;
    stone.shape.seed = 100 * seed + k;
    stone.scale_mm = 8.0;
    const double x = 12.0 + 23.0 * static_cast<double>(k % 3),
                 y = 13.0 + 24.0 * static_cast<double>(k / 3);
    stone.model_from_stone.translation_mm = {x, y, heightmap::height_at(s.ground, x, y) + 1.5};
    s.stones.push_back(meshing::stone_mesh(stone));
  }
  ScanOptions& o = s.options;
  o.scanner.range_sigma_mm = 0.05;
  o.scanner.noise_exponent = 0.0;
  o.scanner.range_resolution_mm = 0.0;
  o.scanner.lines_per_turn = 20'000;
  o.scanner.beam_diameter_mm = kStonesBeamMm;
  o.scanner.beam_divergence_mrad = 0.0;
  o.footprint_rays = footprint_rays;
  o.edge_rays = edge_rays;
  o.station_mm = {35.0, -900.0, 1'300.0};
  o.seed = seed;
  return s;
}

/// Mean of what is left along the line of sight where a beam moves ranges by more than 0.06 mm,
/// beside the edges of six stones.
double left_beside_stones_mm(int footprint_rays, int edge_rays) {
  constexpr double kJudgedNoise = 0.19;
  double sum = 0.0, n = 0.0;
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const auto [ground, stones, o] = stones_scan(seed, footprint_rays, edge_rays);
    const auto cloud = simulate_scan(ground, stones, o);
    EXPECT_THAT(cloud, Succeeds());
    const std::vector<Viewpoint> views{{o.station_mm, kStonesBeamMm, cloud->points_mm.size()}};
    const auto shifts = beam_shifts_mm(cloud->points_mm, views, ground, stones, kJudgedNoise);
    EXPECT_THAT(shifts, Succeeds());
    const auto scene = detail::ScanScene::build(ground, stones);
    EXPECT_THAT(scene, Succeeds());
    for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
      const auto shift = static_cast<double>(shifts->at(i));
      if (!(std::abs(shift) > 0.06)) continue;  // given up, too
      const detail::Sight sight = detail::sight_of(views[0], cloud->points_mm[i]);
      const auto middle = scene->look(sight.from_mm, sight.direction);
      if (!middle) continue;
      sum += sight.range_mm - shift - middle->range_mm;
      n += 1.0;
    }
  }
  return sum / n;
}

// Seven rays are no Gaussian beam where an edge cuts it: six of them lie at its 1/e^2 radius, none
// beyond. What such a scan has beside stones lies too near, by a fifteenth of the noise, and dense
// scans show it.
TEST(BeamShift, BesideStonesAsManyRaysLeaveNothing) {
  const double many = left_beside_stones_mm(61, 61), seven = left_beside_stones_mm(7, 0),
               seven_and_many = left_beside_stones_mm(7, 61);
  RecordProperty("left", fmt::format("{:+.4f} mm of 61 rays, {:+.4f} of seven and 61, {:+.4f} of "
                                     "seven",
                                     many, seven_and_many, seven));
  EXPECT_LT(std::abs(many), 0.005);
  EXPECT_LT(std::abs(seven_and_many), 0.005);
  EXPECT_LT(seven, -0.005);
}

/// Ranges by grid place.
std::map<std::pair<std::uint32_t, std::uint32_t>, double> ranges_by_place(const Cloud& cloud,
                                                                          Vec3 station) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> ranges;
  for (std::size_t i = 0; i < cloud.points_mm.size(); ++i)
    ranges[{cloud.grid[i].row, cloud.grid[i].column}] = norm(cloud.points_mm[i] - station);
  return ranges;
}

// The same scan with seven rays and 61 at edges, with seven, and with 1500, without noise. The
// depth in a beam is found by 400 parallel rays of the test's own. 61 rays know what part of a beam
// lies beside a line to a fiftieth; a step of 1 has 0.3 to 0.4 rms beyond a plane. With noise, what
// is much less than it leaves seven rays as they are.
TEST(Beam, AtEdgesIsThatOfVeryManyRays) {
  constexpr double kDeepMm = 0.2;
  auto [ground, stones, o] = stones_scan(3, 7, 61);
  const auto scan = [&](int rays, int edge_rays, double noise_mm) {
    ScanOptions with = o;
    with.scanner.range_sigma_mm = noise_mm;
    with.footprint_rays = rays;
    with.edge_rays = edge_rays;
    const auto cloud = simulate_scan(ground, stones, with);
    EXPECT_THAT(cloud, Succeeds());
    return *cloud;
  };
  const double noise = o.scanner.range_sigma_mm;
  const Cloud adaptive = scan(7, 61, 0.0);
  const auto seven = ranges_by_place(scan(7, 0, 0.0), o.station_mm);
  const auto noisy = ranges_by_place(scan(7, 61, noise), o.station_mm);
  const auto noisy_seven = ranges_by_place(scan(7, 0, noise), o.station_mm);
  // Its window is wider by the outermost rays: rows and columns are those of the directions.
  const Cloud dense = scan(1500, 0, 0.0);
  const double step = 2.0 * kPi / o.scanner.lines_per_turn;
  const auto direction_of = [&](Vec3 p) {
    const Vec3 way = p - o.station_mm;
    return std::pair{std::lround(std::atan2(way.y, way.x) / step),
                     std::lround(std::acos(way.z / norm(way)) / step)};
  };
  std::map<std::pair<long, long>, double> truth;
  for (const Vec3& p : dense.points_mm) truth[direction_of(p)] = norm(p - o.station_mm);
  const auto scene = detail::ScanScene::build(ground, stones);
  ASSERT_THAT(scene, Succeeds());
  const Viewpoint view{o.station_mm, kStonesBeamMm, adaptive.points_mm.size()};
  const auto samples = detail::beam_samples(400);
  std::vector<detail::Ray> rays(samples.size());
  double edges = 0.0, sum = 0.0, square = 0.0, seven_square = 0.0;
  int smooth = 0, changed = 0;
  for (std::size_t i = 0; i < adaptive.points_mm.size(); ++i) {
    const Vec3 p = adaptive.points_mm[i];
    detail::spread(detail::sight_of(view, p), view, samples, i, rays);
    const double range = norm(p - o.station_mm);
    detail::BeamDepth depth;
    bool whole = true;
    for (std::size_t k = 0; k < rays.size(); ++k) {
      const auto hit = scene->look(rays[k].origin_mm, rays[k].direction);
      if (hit) depth.add(hit->range_mm - range, samples[k].x, samples[k].y);
      whole = whole && hit.has_value();
    }
    if (!whole || !truth.contains(direction_of(p))) continue;  // the rim
    const std::pair place{adaptive.grid[i].row, adaptive.grid[i].column};
    const double deep = depth.beyond_plane_mm();
    if (deep < 0.3 * noise) {
      ++smooth;
      changed += noisy.at(place) != noisy_seven.at(place) ? 1 : 0;
    }
    if (deep < kDeepMm) continue;
    edges += 1.0;
    const double error = (range - truth[direction_of(p)]) / deep;
    sum += error;
    square += error * error;
    seven_square += std::pow((seven.at(place) - truth[direction_of(p)]) / deep, 2);
  }
  const double rms = std::sqrt(square / edges), seven_rms = std::sqrt(seven_square / edges);
  RecordProperty("errors",
                 fmt::format("{:.4f} of the depth, mean {:+.5f}; of seven rays {:.4f}; {} "
                             "edges, {} smooth places",
                             rms, sum / edges, seven_rms, edges, smooth));
  EXPECT_GT(edges, 3000.0);
  EXPECT_GT(smooth, 300);
  EXPECT_EQ(changed, 0);
  EXPECT_LT(rms, 1.0 / 50.0 / 0.3);
  EXPECT_LT(std::abs(sum / edges), 1.0 / 300.0);
  EXPECT_GT(seven_rms, 3.0 * rms);
}

// Seen from low down, beams pass over the far rim with their middle and meet the part with the
// rest. What they measured lies above the rim; nothing is expected there that it could be moved to.
TEST(BeamShift, GivesUpWhatPassesOverTheRim) {
  const ModelField flat{Grid<float>(121, 121, 5.0F), Millimetres{0.5}};
  ScanOptions o = wide_beam(20'000, {30.0, -900.0, 400.0}, 61);
  o.scanner.beam_divergence_mrad = 0.0;
  const auto cloud = simulate_scan(flat, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  const Viewpoint view{o.station_mm, 3.0, cloud->points_mm.size()};
  const auto shifts = beam_shifts_mm(cloud->points_mm, std::span(&view, 1), flat, {}, 0.2);
  ASSERT_THAT(shifts, Succeeds());
  const auto scene = detail::ScanScene::build(flat, {});
  ASSERT_THAT(scene, Succeeds());
  int past = 0;
  for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
    const detail::Sight sight = detail::sight_of(view, cloud->points_mm[i]);
    const Vec3 p = cloud->points_mm[i];
    if (p.x < 0.0 || p.x > 60.0 || p.y < 0.0 || p.y > 60.0) continue;  // compared with nothing
    if (scene->look(sight.from_mm, sight.direction)) continue;
    ++past;
    ASSERT_TRUE(std::isnan(shifts->at(i))) << p.x << ' ' << p.y << ' ' << p.z;
  }
  EXPECT_GT(past, 30);
}

// A ball that overhangs its foot by 1.6 mm under a beam of 3 mm. Part of the beam beside its foot
// goes on under the overhang, where the upper envelope has a wall: with the envelope the ground
// there comes out low, with ground and mesh it does not.
TEST(BeamShift, GoesOnUnderOverhangs) {
  const Vec3 station{30.0, -900.0, 700.0}, middle{30.0, 30.0, 6.0};
  const double radius = 12.0;
  ScanOptions o = wide_beam(20'000, station, 100);
  o.scanner.beam_diameter_mm = 3.0;
  o.scanner.beam_divergence_mrad = 0.0;
  const ModelField ground{Grid<float>(241, 241, 0.0F), Millimetres{0.25}};
  ModelField envelope = ground;
  for (std::ptrdiff_t r = 0; r < 241; ++r)
    for (std::ptrdiff_t c = 0; c < 241; ++c) {
      const double out = std::hypot(ground.x_mm(c) - middle.x, ground.y_mm(r) - middle.y);
      if (out < radius)
        envelope.z_mm(r, c) = static_cast<float>(middle.z + std::sqrt(radius * radius - out * out));
    }
  TriMesh ball = testing_support::unit_sphere(5);
  for (Vec3& v : ball.vertices_mm) v = middle + radius * v;
  const auto cloud = simulate_scan(ground, std::span(&ball, 1), o);
  ASSERT_THAT(cloud, Succeeds());
  const Viewpoint view{station, 3.0, cloud->points_mm.size()};
  // Mean height of the ground within a beam of the widest place, seen from in front.
  const auto at_the_foot = [&](const ModelField& surface, std::span<const TriMesh> stones) {
    const auto shifts = beam_shifts_mm(cloud->points_mm, std::span(&view, 1), surface, stones, 0.2);
    EXPECT_THAT(shifts, Succeeds());
    double sum = 0.0, n = 0.0;
    for (std::size_t i = 0; i < shifts->size(); ++i) {
      const float shift = (*shifts)[i];
      if (std::isnan(shift)) continue;
      const Vec3 raw = cloud->points_mm[i];
      const Vec3 p = raw - static_cast<double>(shift) * normalized(raw - station);
      const double out = std::hypot(p.x - middle.x, p.y - middle.y);
      if (out < radius || out > radius + 3.0 || p.y > middle.y - 8.0 || p.z > 1.0) continue;
      sum += p.z;
      n += 1.0;
    }
    EXPECT_GT(n, 100.0);
    return sum / n;
  };
  const double by_envelope = at_the_foot(envelope, {});
  const double by_meshes = at_the_foot(ground, std::span(&ball, 1));
  RecordProperty("low_mm", std::to_string(by_envelope) + " " + std::to_string(by_meshes));
  // 19 rays for a beam: a tenth of what the beam does is what is claimed.
  EXPECT_LT(by_envelope, -0.02);
  EXPECT_LT(std::abs(by_meshes), 0.25 * std::abs(by_envelope));
}

TEST(BeamShift, LeavesRaysAlone) {
  const ModelField part = testing_support::rough_part(5, 61, 61, 2.0);
  const std::vector<Vec3> points{{50.0, 50.0, 10.0}, {60.0, 40.0, 12.0}};
  const Viewpoint view{Vec3{0.0, 0.0, 500.0}, 0.0, 2};
  const auto shifts = beam_shifts_mm(points, std::span(&view, 1), part, {}, 0.1);
  ASSERT_THAT(shifts, Succeeds());
  EXPECT_THAT(*shifts, testing::ElementsAre(0.0F, 0.0F));
}

// ---- signal ----------------------------------------------------------------

TEST(Signal, IsReflectanceTimesCosineByTheSquareOfTheRange) {
  const ModelField flat{Grid<float>(51, 51, 0.0F), Millimetres{4.0}};
  ScanOptions o = wide_beam(3000, {100.0, -300.0, 900.0});
  o.colour = true;
  o.paint = [](Vec3 p, bool) {
    return SurfaceLook{p.x < 100.0 ? 0.1 : 0.8,
                       Colour{static_cast<std::uint16_t>(p.x < 100.0), 7, 9}};
  };
  const auto cloud = simulate_scan(flat, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  ASSERT_EQ(cloud->colours.size(), cloud->points_mm.size());
  for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
    const Vec3 p = cloud->points_mm[i], ray = p - o.station_mm;
    if (std::abs(p.x - 100.0) < 4 || p.x < 4 || p.x > 196 || p.y < 4 || p.y > 196) continue;
    const double expected = (p.x < 100.0 ? 0.1 : 0.8) * 900.0 / norm(ray) * 9e6 / dot(ray, ray);
    ASSERT_NEAR(cloud->intensity[i], expected, 2e-5 * expected);
    ASSERT_EQ(cloud->colours[i], (Colour{static_cast<std::uint16_t>(p.x < 100.0), 7, 9}));
  }
  // Some dark points are lost at this level, none of the bright ones.
  o.scanner.least_signal = 0.9;
  const auto strong = simulate_scan(flat, {}, o);
  ASSERT_THAT(strong, Succeeds());
  for (std::size_t i = 0; i < strong->points_mm.size(); ++i) ASSERT_GE(strong->intensity[i], 0.9F);
  EXPECT_LT(strong->points_mm.size(), cloud->points_mm.size());
  o.scanner.least_signal = 100.0;
  EXPECT_THAT(simulate_scan(flat, {}, o), FailsWith(kNothingHit));
}

TEST(Signal, NoiseIsItsPower) {
  const ModelField flat{Grid<float>(26, 26, 0.0F), Millimetres{8.0}};
  for (const double exponent : {0.0, 0.5, 1.0}) {
    ScanOptions o = wide_beam(20'000, {100.0, -400.0, 1400.0}, 1);
    o.scanner.range_sigma_mm = 0.3;
    o.scanner.noise_exponent = exponent;
    o.paint = [](Vec3, bool) { return SurfaceLook{0.1, {}}; };
    const auto cloud = simulate_scan(flat, {}, o);
    ASSERT_THAT(cloud, Succeeds());
    double square = 0.0;
    for (const Vec3& p : cloud->points_mm) {
      const Vec3 d = normalized(p - o.station_mm);
      const double range = -1400.0 / d.z;
      const double signal = 0.1 * -d.z * 9e6 / (range * range);
      square +=
          std::pow((norm(p - o.station_mm) - range) / 0.3 * std::pow(signal / 0.5, exponent), 2);
    }
    const auto n = static_cast<double>(cloud->points_mm.size());
    ASSERT_GT(n, 10'000);
    EXPECT_NEAR(square / n, 1.0, 4.0 * std::sqrt(2.0 / n)) << exponent;
  }
}

// ---- systematic errors -----------------------------------------------------

/// On the plane z = 0, what the beam saw is on it; so range and shown angles must fit the
/// formula of the header.
double worst_misfit(const ScanOptions& o, const AngularErrors& e) {
  const ModelField flat{Grid<float>(201, 201, 0.0F), Millimetres{10.0}, Millimetres{-1000.0},
                        Millimetres{-1000.0}};
  const auto cloud = simulate_scan(flat, {}, o);
  EXPECT_THAT(cloud, Succeeds());
  double worst = 0.0;
  for (const Vec3& p : cloud->points_mm) {
    const Vec3 ray = p - o.station_mm;
    double v = std::acos(ray.z / norm(ray)), h = std::atan2(ray.y, ray.x);
    if (v > kPi - 0.05) continue;  // at the nadir azimuth means little
    const double sign = o.second_face ? -1.0 : 1.0;
    const double vf = sign * v, hf = o.second_face ? h + kPi : h;
    h += e.collimation_rad / std::sin(vf) + e.trunnion_rad / std::tan(vf) +
         e.eccentricity_h_rad * std::cos(hf - e.eccentricity_h_phase_rad);
    v += sign *
         (e.vertical_index_rad + e.eccentricity_v_rad * std::cos(vf - e.eccentricity_v_phase_rad));
    worst = std::max(worst, std::abs(o.station_mm.z + norm(ray) * std::cos(v)));
    // The azimuth matters on the outline only: there the true place is on the part.
    worst =
        std::max({worst, std::abs(o.station_mm.x + norm(ray) * std::sin(v) * std::cos(h)) - 1000.0,
                  std::abs(o.station_mm.y + norm(ray) * std::sin(v) * std::sin(h)) - 1000.0});
  }
  return worst;
}

TEST(AngularError, FollowsItsFormulaInBothFaces) {
  std::vector<AngularErrors> errors(6);
  errors[0].vertical_index_rad = 2e-3;
  errors[1].collimation_rad = -3e-3;
  errors[2].trunnion_rad = 2e-3;
  errors[3].eccentricity_h_rad = 3e-3;
  errors[3].eccentricity_h_phase_rad = 0.7;
  errors[4].eccentricity_v_rad = 2e-3;
  errors[4].eccentricity_v_phase_rad = 1.2;
  errors[5] = errors[0];
  errors[5].collimation_rad = 1e-3;
  for (const AngularErrors& e : errors)
    for (const bool face : {false, true}) {
      ScanOptions o = wide_beam(720, {50.0, 20.0, 800.0}, 1);
      o.angular = e;
      o.second_face = face;
      EXPECT_LT(worst_misfit(o, e), 1e-9);
      EXPECT_TRUE(worst_misfit(o, {}) > 0.1 || e.vertical_index_rad + e.eccentricity_v_rad == 0.0)
          << "without the formula it does not fit";
    }
}

TEST(AngularError, TwoFacesTakeItAway) {
  AngularErrors e;
  e.vertical_index_rad = 1e-3;
  e.collimation_rad = 2e-3;
  e.trunnion_rad = 1e-3;
  for (const double v : {0.5, 1.2, 2.5})
    for (const double h : {0.0, 1.0, 4.0}) {
      const detail::Angles one = detail::true_angles(e, false, h, v),
                           two = detail::true_angles(e, true, h, v);
      EXPECT_NEAR(0.5 * (one.zenith + two.zenith), v, 1e-15);
      EXPECT_NEAR(0.5 * (one.azimuth + two.azimuth) - h, 0.0, 1e-15);
      EXPECT_GT(std::abs(one.azimuth - two.azimuth), 1e-3);
    }
}

TEST(AngularError, EncoderNoiseHasItsSize) {
  const ModelField flat{Grid<float>(201, 201, 0.0F), Millimetres{10.0}, Millimetres{-1000.0},
                        Millimetres{-1000.0}};
  ScanOptions o = wide_beam(2000, {0.0, 0.0, 800.0}, 1);
  o.angular.encoder_noise_rad = 1e-4;
  const auto cloud = simulate_scan(flat, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  double square = 0.0;
  int n = 0;
  for (const Vec3& p : cloud->points_mm) {
    const Vec3 ray = p - o.station_mm;
    const double r = norm(ray), shown = std::acos(ray.z / r), looked = std::acos(-800.0 / r);
    if (shown > kPi - 0.1 || std::abs(p.x) > 980 || std::abs(p.y) > 980) continue;
    square += std::pow((looked - shown) / 1e-4, 2);
    ++n;
  }
  ASSERT_GT(n, 10'000);
  EXPECT_NEAR(square / n, 1.0, 4.0 * std::sqrt(2.0 / n) + 0.01);
}

TEST(RangeError, FollowsItsFormula) {
  const ModelField flat{Grid<float>(51, 51, 0.0F), Millimetres{20.0}};
  std::vector<RangeErrors> errors(4);
  errors[0].offset_mm = 0.7;
  errors[1].scale_ppm = 200.0;
  errors[2].cyclic_mm = 0.5;
  errors[2].cyclic_phase_rad = 0.3;
  errors[3].incidence_mm = 0.2;
  for (const RangeErrors& e : errors) {
    ScanOptions o = wide_beam(3000, {500.0, -200.0, 700.0}, 1);
    o.range = e;
    const auto cloud = simulate_scan(flat, {}, o);
    ASSERT_THAT(cloud, Succeeds());
    for (const Vec3& p : cloud->points_mm) {
      const Vec3 d = normalized(p - o.station_mm);
      const double r = -700.0 / d.z;
      const double expected = r + e.offset_mm + 1e-6 * e.scale_ppm * r +
                              e.cyclic_mm * std::sin(2 * kPi * r / 1'234.375 + e.cyclic_phase_rad) +
                              e.incidence_mm * std::pow(std::tan(std::acos(-d.z)), 2);
      ASSERT_NEAR(norm(p - o.station_mm), expected, 1e-8);
    }
  }
}

// ---- stations and files ----------------------------------------------------

TEST(Station, MayBeTurned) {
  const ModelField flat{Grid<float>(51, 51, 3.0F), Millimetres{4.0}};
  ScanOptions o = wide_beam(2000, {100.0, -300.0, 500.0}, 1);
  o.station_rotation = rotation_about(normalized(Vec3{1.0, 0.4, -0.7}), 0.6);
  const auto cloud = simulate_scan(flat, {}, o);
  ASSERT_THAT(cloud, Succeeds());
  ASSERT_EQ(cloud->stations.size(), 1U);
  const RigidTransform station_from_model = cloud->stations[0].model_from_station.inverse();
  EXPECT_EQ(cloud->stations[0].points, cloud->points_mm.size());
  EXPECT_EQ(cloud->stations[0].position_mm, o.station_mm);
  const double step = 2 * kPi / 2000;
  for (std::size_t i = 0; i < cloud->points_mm.size(); ++i) {
    ASSERT_NEAR(cloud->points_mm[i].z, 3.0, 1e-10);
    const Vec3 q = station_from_model.point(cloud->points_mm[i]);
    const double row = std::acos(q.z / norm(q)) / step, column = std::atan2(q.y, q.x) / step;
    ASSERT_NEAR(row, std::round(row), 1e-7);
    ASSERT_NEAR(column, std::round(column), 1e-7);
    ASSERT_LT(cloud->grid[i].row, cloud->stations[0].rows);
    ASSERT_LT(cloud->grid[i].column, cloud->stations[0].columns);
    if (i == 0) continue;
    // One step of the grid is one step of the angle.
    const Vec3 before = station_from_model.point(cloud->points_mm[i - 1]);
    if (cloud->grid[i].column == cloud->grid[i - 1].column) {
      ASSERT_NEAR(
          row - std::acos(before.z / norm(before)) / step,
          static_cast<double>(cloud->grid[i].row) - static_cast<double>(cloud->grid[i - 1].row),
          1e-6);
    }
  }
  // Whatever the tilt, the whole part is seen.
  Box3 seen;
  for (const Vec3& p : cloud->points_mm) seen.add(p);
  EXPECT_LT(std::max(seen.min.x, seen.min.y), 4.0);
  EXPECT_GT(std::min(seen.max.x, seen.max.y), 196.0);
}

TEST(Station, SeveralGoIntoOneFileWithAllTheyHave) {
  const ScratchFolder folder;
  const ModelField part = testing_support::rough_part(5, 61, 61, 2.0);
  std::vector<Cloud> clouds;
  {
    const auto writer = create_cloud(folder / "two.e57");
    ASSERT_THAT(writer, Succeeds());
    for (const double side : {-1.0, 1.0}) {
      ScanOptions o = wide_beam(3000, {60.0, 60.0 + side * 250.0, 220.0});
      o.station_rotation = rotation_about({0, 0, 1}, side);
      o.scanner.range_sigma_mm = 0.2;
      o.scanner.range_resolution_mm = 0.1;
      o.name = side < 0 ? "south" : "north";
      o.colour = true;
      o.paint = [](Vec3 p, bool) {
        return SurfaceLook{0.5,
                           {static_cast<std::uint16_t>(257 * (static_cast<int>(p.x) % 200)), 0, 0}};
      };
      const auto figures = simulate_scan(part, {}, o, **writer);
      ASSERT_THAT(figures, Succeeds());
      auto cloud = simulate_scan(part, {}, o);
      ASSERT_THAT(cloud, Succeeds());
      EXPECT_EQ(figures->points, cloud->points_mm.size());
      clouds.push_back(std::move(*cloud));
    }
    ASSERT_THAT((*writer)->finish(), Succeeds());
  }
  const auto back = stream_in(folder / "two.e57");
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(back->stations.size(), 2U);
  EXPECT_EQ(back->stations[0].name, "south");
  for (std::size_t s = 0; s < 2; ++s) {
    const PointBatch& points = back->points[s];
    ASSERT_EQ(points.size(), clouds[s].points_mm.size());
    EXPECT_EQ(points.grid, clouds[s].grid);
    EXPECT_EQ(points.colours, clouds[s].colours);
    ASSERT_EQ(points.time_s.size(), points.size());
    const RigidTransform& pose = back->stations[s].model_from_station;
    for (std::size_t i = 0; i < points.size(); ++i) {
      ASSERT_LT(norm(pose.point(points.points_mm[i]) - clouds[s].points_mm[i]), 1e-9);
      ASSERT_TRUE(i == 0 || points.time_s[i] > points.time_s[i - 1]) << "the order of the scan";
    }
  }
}

TEST(StationRefuses, WhatMakesNoSense) {
  const ModelField flat{Grid<float>(51, 51, 3.0F), Millimetres{4.0}};
  const ScanOptions good = wide_beam(200, {100.0, -300.0, 500.0});
  std::vector<ScanOptions> bad(9, good);
  bad[0].footprint_rays = 0;
  bad[1].scanner.unambiguous_mm = {};
  bad[2].scanner.unambiguous_mm = {10.0, 20.0};
  bad[3].scanner.beam_diameter_mm = -1.0;
  bad[4].angular.trunnion_rad = NAN;
  bad[5].range.scale_ppm = INFINITY;
  bad[6].station_rotation = {2.0, 0.0, 0.0, 0.0};
  bad[7].scanner.noise_exponent = -1.0;
  bad[8].scanner.turns_per_s = 0.0;
  for (const ScanOptions& o : bad) EXPECT_THAT(simulate_scan(flat, {}, o), FailsWith(kScanOptions));
  EXPECT_THAT(simulate_scan(flat, {}, good), Succeeds());
}

}  // namespace
}  // namespace maquette::scan
