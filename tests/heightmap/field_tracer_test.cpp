// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in heightmap/field_tracer.hpp, and how each claim is attacked:
//
//   first hit, distance, normal ...... closed forms: level and tilted planes, a step
//   nothing slips through ............ 1e6 rays that must cross the surface, aimed at
//                                      nodes and edge points, over rough ground
//   the pyramid misses nothing ....... the same triangles without a pyramid, small
//                                      fields of awkward sizes, bit for bit
//   the triangle test is right ....... height_at at the hit; a second formula (Moeller
//                                      and Trumbore in long double) on random rays
//   distance > from_mm, both sides ... walk along a ray through all its crossings
//   rays together = rays alone ....... packets of pictures, lamps, parallel and unrelated rays, on
//                                      grid lines, from inside, grazing; both instruction sets
//   not finite: nothing .............. each component of origin and direction
//   voids are holes .................. rays through and beside a missing node
//   0.55 byte per cell ............... counted
//
// No data files: terrains come from a seed in the test's name.

#include "heightmap/field_tracer.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette::heightmap {
namespace {

/// Rough ground: waves of three lengths and white noise, so that rays cross often.
ModelField rough_ground(std::uint64_t seed, std::ptrdiff_t rows, std::ptrdiff_t cols,
                        double spacing_mm, double x0_mm = 0.0, double y0_mm = 0.0) {
  ModelField f{Grid<float>(rows, cols), Millimetres{spacing_mm}, Millimetres{x0_mm},
               Millimetres{y0_mm}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const auto u = static_cast<double>(c), v = static_cast<double>(r);
      const double noise = random_normal(seed, static_cast<std::uint64_t>(r * cols + c));
      f.z_mm(r, c) =
          static_cast<float>(spacing_mm * (6.0 * std::sin(u / 17.0 + v / 29.0) +
                                           2.0 * std::cos(u / 5.0 - v / 3.0) + 0.5 * noise));
    }
  return f;
}

/// Numbered random draws of one test.
struct Draws {
  std::uint64_t seed, count = 0;
  double uniform(double lo, double hi) { return lo + (hi - lo) * random_uniform(seed, count++); }
  std::ptrdiff_t index(std::ptrdiff_t n) {
    return static_cast<std::ptrdiff_t>(uniform(0.0, static_cast<double>(n)));
  }
  Vec3 direction() {
    const double z = uniform(-1.0, 1.0), phi = uniform(0.0, 2.0 * std::numbers::pi);
    const double r = std::sqrt(1.0 - z * z);
    return normalized(Vec3{r * std::cos(phi), r * std::sin(phi), z});
  }
};

Vec3 node(const ModelField& f, std::ptrdiff_t r, std::ptrdiff_t c) {
  return {f.x_mm(c), f.y_mm(r), static_cast<double>(f.z_mm(r, c))};
}

template <class Visit>
void for_each_triangle(const ModelField& f, const Visit& visit) {
  for (std::ptrdiff_t r = 0; r + 1 < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c + 1 < f.z_mm.cols(); ++c) {
      visit(node(f, r, c), node(f, r, c + 1), node(f, r + 1, c + 1));
      visit(node(f, r, c), node(f, r + 1, c + 1), node(f, r + 1, c));
    }
}

/// All triangles, one after the other, with the sheared edge test written out for
/// one axis order. Same arithmetic as the tracer is supposed to use, so distances
/// can be compared for equality; what it lacks is everything that could skip a cell.
double without_pyramid(const ModelField& f, Vec3 o, Vec3 d, double from) {
  const auto component = [](Vec3 v, int i) { return i == 0 ? v.x : i == 1 ? v.y : v.z; };
  int k = 0;
  if (std::abs(d.y) > std::abs(component(d, k))) k = 1;
  if (std::abs(d.z) > std::abs(component(d, k))) k = 2;
  const int i = (k + 1) % 3, j = (k + 2) % 3;
  const double sx = component(d, i) / component(d, k), sy = component(d, j) / component(d, k);
  const double sz = 1.0 / component(d, k);
  const auto shear = [&](Vec3 p) {
    const Vec3 q = p - o;
    return Vec3{component(q, i) - sx * component(q, k), component(q, j) - sy * component(q, k),
                sz * component(q, k)};
  };
  double best = INFINITY;
  for_each_triangle(f, [&](Vec3 p, Vec3 q, Vec3 s) {
    const Vec3 a = shear(p), b = shear(q), c = shear(s);
    const double u = c.x * b.y - c.y * b.x, v = a.x * c.y - a.y * c.x, w = b.x * a.y - b.y * a.x;
    const bool inside = (u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0);
    const double det = u + v + w;
    if (!inside || det == 0.0) return;
    const double t = (u * a.z + v * b.z + w * c.z) / det;
    if (t > from && t < best) best = t;
  });
  return best;
}

/// A different formula in higher precision; the margin widens each triangle, so a
/// positive one finds what any correct tracer may hit and a negative one what it must.
double moeller_trumbore(const ModelField& f, Vec3 o, Vec3 d, double margin) {
  using Real = long double;
  struct V {
    Real x, y, z;
  };
  const auto make = [](Vec3 p, Vec3 q) {
    return V{static_cast<Real>(p.x) - static_cast<Real>(q.x),
             static_cast<Real>(p.y) - static_cast<Real>(q.y),
             static_cast<Real>(p.z) - static_cast<Real>(q.z)};
  };
  const auto cross3 = [](V a, V b) {
    return V{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  };
  const auto dot3 = [](V a, V b) { return a.x * b.x + a.y * b.y + a.z * b.z; };
  const V dir{static_cast<Real>(d.x), static_cast<Real>(d.y), static_cast<Real>(d.z)};
  Real best = INFINITY;
  for_each_triangle(f, [&](Vec3 p, Vec3 q, Vec3 s) {
    const V e1 = make(q, p), e2 = make(s, p), to = make(o, p);
    const V h = cross3(dir, e2);
    const Real det = dot3(e1, h);
    if (std::abs(det) < Real{1e-9}) return;
    const Real u = dot3(to, h) / det;
    const V g = cross3(to, e1);
    const Real v = dot3(dir, g) / det;
    const auto m = static_cast<Real>(margin);
    if (u < -m || v < -m || u + v > 1 + m) return;
    const Real t = dot3(e2, g) / det;
    if (t > 0 && t < best) best = t;
  });
  return static_cast<double>(best);
}

// ---- closed forms ----------------------------------------------------------

TEST(FieldTracer, MeetsALevelPlane) {
  const ModelField f{Grid<float>(100, 50, 2.0F), Millimetres{0.5}, Millimetres{-3.0},
                     Millimetres{7.0}};
  const FieldTracer tracer(f);
  const auto down = tracer.trace({1.1, 20.3, 10.0}, {0.0, 0.0, -1.0});
  ASSERT_TRUE(down.has_value());
  EXPECT_EQ(down->distance_mm, 8.0);
  EXPECT_EQ(down->point_mm, (Vec3{1.1, 20.3, 2.0}));
  EXPECT_EQ(down->normal, (Vec3{0.0, 0.0, 1.0}));
  const auto up = tracer.trace({1.1, 20.3, -10.0}, {0.0, 0.0, 1.0});
  ASSERT_TRUE(up.has_value()) << "the underside counts as well";
  EXPECT_EQ(up->distance_mm, 12.0);
  EXPECT_EQ(up->normal.z, 1.0) << "the normal is upward from either side";
  EXPECT_FALSE(tracer.trace({1.1, 20.3, 10.0}, {0.0, 0.0, 1.0}).has_value());
  EXPECT_FALSE(tracer.trace({-3.001, 20.0, 10.0}, {0.0, 0.0, -1.0}).has_value());
  EXPECT_FALSE(tracer.trace({0.0, 20.0, 2.5}, {1.0, 0.0, 0.0}).has_value());
}

TEST(FieldTracer, TheOutlineBelongsToTheField) {
  // 0.25 is exact, so the outline is where it is said to be, bit for bit.
  const ModelField f{Grid<float>(33, 17, 1.0F), Millimetres{0.25}};
  const FieldTracer tracer(f);
  for (const auto& [x, y] : std::vector<std::pair<double, double>>{
           {0.0, 0.0}, {4.0, 0.0}, {0.0, 8.0}, {4.0, 8.0}, {2.0, 0.0}, {4.0, 3.1}})
    EXPECT_TRUE(tracer.trace({x, y, 5.0}, {0.0, 0.0, -1.0}).has_value()) << x << ", " << y;
}

TEST(FieldTracer, MeetsATiltedPlaneFromFarAway) {
  ModelField f{Grid<float>(65, 65), Millimetres{2.0}};
  for (std::ptrdiff_t r = 0; r < 65; ++r)
    for (std::ptrdiff_t c = 0; c < 65; ++c)  // dyadic slopes: the plane is exact in float
      f.z_mm(r, c) = static_cast<float>(0.25 * f.x_mm(c) - 0.5 * f.y_mm(r));
  const FieldTracer tracer(f);
  const Vec3 n = normalized(Vec3{-0.25, 0.5, 1.0});
  Draws draw{11};
  for (int i = 0; i < 1000; ++i) {
    const double x = draw.uniform(1.0, 127.0), y = draw.uniform(1.0, 127.0);
    const Vec3 target{x, y, 0.25 * x - 0.5 * y};
    const Vec3 station{-800.0, -1500.0, 2500.0};
    const auto hit = tracer.trace(station, normalized(target - station));
    ASSERT_TRUE(hit.has_value());
    // 3000 mm away, double steps are 4.5e-13 mm; a handful of roundings.
    EXPECT_NEAR(norm(hit->point_mm - target), 0.0, 1e-11);
    EXPECT_NEAR(hit->distance_mm, norm(target - station), 1e-11);
    EXPECT_NEAR(norm(hit->normal - n), 0.0, 1e-15);
  }
}

TEST(FieldTracer, AStepHidesWhatIsBehindIt) {
  ModelField f{Grid<float>(40, 40, 0.0F), Millimetres{1.0}};
  for (std::ptrdiff_t r = 0; r < 40; ++r)
    for (std::ptrdiff_t c = 20; c < 40; ++c) f.z_mm(r, c) = 10.0F;
  const FieldTracer tracer(f);
  // From the left at 45 degrees downward: the ramp between x = 19 and 20 is z = 10 (x - 19).
  const Vec3 d = normalized(Vec3{1.0, 0.0, -1.0});
  const auto hit = tracer.trace({10.0, 7.7, 14.0}, d);  // z = 24 - x meets it where 11 x = 214
  ASSERT_TRUE(hit.has_value());
  EXPECT_NEAR(hit->point_mm.x, 214.0 / 11.0, 1e-12);
  EXPECT_NEAR(hit->normal.x, -10.0 / std::sqrt(101.0), 1e-12);
}

// ---- watertightness --------------------------------------------------------

class FieldTracerSeeded : public testing::TestWithParam<int> {
 protected:
  [[nodiscard]] std::uint64_t seed() const { return static_cast<std::uint64_t>(GetParam()); }
};
INSTANTIATE_TEST_SUITE_P(Seed, FieldTracerSeeded, testing::Range(1, 5));

TEST_P(FieldTracerSeeded, NoRaySlipsThroughAnEdgeOrANode) {
  // A ray that starts above all heights, ends below all of them and stays over the
  // field in between must cross a continuous surface. 250 000 a seed.
  const ModelField f = rough_ground(seed(), 131, 97, 0.1 * std::numbers::pi, -11.3, 4.77);
  const FieldTracer tracer(f);
  const HeightRange range = height_range(f.z_mm);
  Draws draw{seed() + 100};
  int tried = 0, slipped = 0;
  double worst = 0.0;
  while (tried < 250'000) {
    const std::ptrdiff_t r = 30 + draw.index(70), c = 30 + draw.index(36);
    Vec3 target = node(f, r, c);
    const double s = draw.uniform(0.0, 1.0);
    switch (tried % 4) {  // the node, and a point of each kind of edge
      case 1:
        target = target + s * (node(f, r, c + 1) - target);
        break;
      case 2:
        target = target + s * (node(f, r + 1, c) - target);
        break;
      case 3:
        target = target + s * (node(f, r + 1, c + 1) - target);
        break;
      default:
        break;
    }
    Vec3 d = draw.direction();
    if (tried % 8 >= 4) d = normalized(d - 4.0 * Vec3{0, 0, std::abs(d.z)});
    // Straight down, along the grid and along the diagonals as well.
    if (tried % 64 == 0) d = {0.0, 0.0, -1.0};
    if (tried % 64 == 1) d = normalized(Vec3{0.0, d.y, d.z});
    if (tried % 64 == 2) d = normalized(Vec3{d.x, 0.0, d.z});
    if (tried % 64 == 3) d = normalized(Vec3{d.x, d.x, d.z});
    if (d.z > 0.0) d = -d;
    if (d.z > -0.35) continue;
    const double up = (static_cast<double>(range.max) + 0.5 - target.z) / -d.z;
    const double down = (target.z - static_cast<double>(range.min) + 0.5) / -d.z;
    const Vec3 start = target - up * d, end = target + down * d;
    if (std::isnan(height_at(f, start.x, start.y)) || std::isnan(height_at(f, end.x, end.y)))
      continue;
    ++tried;
    const auto hit = tracer.trace(start, d);
    // Beyond the aim is allowed: a crest is only touched, and rounding decides.
    if (!hit || hit->distance_mm > up + down) {
      ++slipped;
      continue;
    }
    worst =
        std::max(worst, std::abs(hit->point_mm.z - height_at(f, hit->point_mm.x, hit->point_mm.y)));
  }
  EXPECT_EQ(slipped, 0) << "of " << tried;
  EXPECT_LT(worst, 1e-11) << "a hit must lie on the surface";
}

// ---- against all triangles -------------------------------------------------

TEST_P(FieldTracerSeeded, EqualsAllTrianglesWithoutPyramid) {
  // Sizes around the leaf (4 cells) and the blocks (16 and 64 cells).
  for (const auto& [rows, cols] :
       std::vector<std::pair<int, int>>{{2, 2}, {2, 40}, {9, 9}, {10, 8}, {33, 34}, {17, 66}}) {
    ModelField f = rough_ground(seed(), rows, cols, 0.7, -5.0, 300.0);
    Draws draw{seed() + 200};
    if (seed() % 2 == 0)
      for (int i = 0; i < rows * cols / 50; ++i) f.z_mm(draw.index(rows), draw.index(cols)) = NAN;
    const FieldTracer tracer(f), common(f, FieldTracer::Instructions::common);
    const double wide = f.x_mm(cols - 1) - f.x0.value(), deep = f.y_mm(rows - 1) - f.y0.value();
    for (int i = 0; i < 1500; ++i) {
      const double x = f.x0.value() + wide * draw.uniform(-0.1, 1.1);
      const double y = f.y0.value() + deep * draw.uniform(-0.1, 1.1);
      const Vec3 target{x, y, draw.uniform(-6.0, 6.0)};
      Vec3 d = draw.direction();
      if (i % 3 == 0)
        d = normalized(Vec3{d.x, d.y, 0.05 * d.z});  // grazing: long way over the ground
      if (i % 16 == 1) d = {0.0, 0.0, i % 32 == 1 ? -1.0 : 1.0};
      if (i % 16 == 2) d = {i % 32 == 2 ? -1.0 : 1.0, 0.0, 0.0};
      if (i % 16 == 3) d = normalized(Vec3{0.0, d.y, 0.1 * d.z});
      if (i % 16 == 4) d = normalized(Vec3{1e-15, d.y, 0.1 * d.z});
      const Vec3 origin = i % 5 == 0 ? target : target - draw.uniform(0.0, 3000.0) * d;
      const auto hit = tracer.trace(origin, d);
      const double expected = without_pyramid(f, origin, d, 0.0);
      ASSERT_EQ(hit ? hit->distance_mm : INFINITY, expected)
          << rows << " x " << cols << ", ray " << i;
      const auto other = common.trace(origin, d);
      ASSERT_EQ(other ? other->distance_mm : INFINITY, expected);
      if (hit) {
        ASSERT_EQ(hit->normal, other->normal);
      }
      // Everything before the hit is open, everything behind it is not.
      const double to = std::isinf(expected) ? 1e5 : expected;
      ASSERT_FALSE(tracer.blocked(origin, d, to));
      ASSERT_FALSE(common.blocked(origin, d, to));
      if (std::isinf(expected)) continue;
      ASSERT_TRUE(tracer.blocked(origin, d, std::nextafter(to, INFINITY)));
      ASSERT_TRUE(common.blocked(origin, d, std::nextafter(to, INFINITY)));
      ASSERT_TRUE(tracer.blocked(origin, d, to + 50.0));
    }
  }
}

TEST_P(FieldTracerSeeded, ABeamHitsWhatItsRaysHit) {
  // Beams of all widths from a node to a leaf, also along the outline, grazing and straight down.
  ModelField f = rough_ground(seed(), 75, 90, 0.7, -5.0, 300.0);
  Draws draw{seed() + 250};
  if (seed() % 2 == 0)
    for (int i = 0; i < 100; ++i) f.z_mm(draw.index(75), draw.index(90)) = NAN;
  const FieldTracer tracer(f);
  const double wide = f.x_mm(89) - f.x0.value(), deep = f.y_mm(74) - f.y0.value();
  int hits = 0;
  for (int i = 0; i < 3000; ++i) {
    const Vec3 target{f.x0.value() + wide * draw.uniform(-0.05, 1.05),
                      f.y0.value() + deep * draw.uniform(-0.05, 1.05), draw.uniform(-6.0, 6.0)};
    Vec3 d = draw.direction();
    if (i % 3 == 0) d = normalized(Vec3{d.x, d.y, 0.05 * d.z});
    if (i % 16 == 1) d = {0.0, 0.0, -1.0};
    const double far = draw.uniform(10.0, 3000.0);
    const FieldTracer::Ray axis{target - far * d, d};
    const double radius = std::pow(10.0, draw.uniform(-2.0, 0.8));
    // Within the radius from the start to beyond the field.
    const double reach = far + 2.0 * (wide + deep);
    std::vector<FieldTracer::Ray> rays{axis};
    for (int k = 0; k < 6; ++k) {
      const Vec3 off = draw.direction();
      const Vec3 aside = off - dot(off, d) * d;
      const Vec3 tilt = draw.direction();
      rays.push_back({axis.origin_mm + 0.6 * radius * aside,
                      normalized(d + 0.4 * radius / reach * (tilt - dot(tilt, d) * d))});
    }
    std::vector<std::optional<FieldHit>> bundle(rays.size());
    tracer.trace_many(rays, bundle);
    for (std::size_t k = 0; k < rays.size(); ++k) {
      const auto one = tracer.trace(rays[k].origin_mm, rays[k].direction);
      ASSERT_EQ(one.has_value(), bundle[k].has_value()) << "beam " << i << ", ray " << k;
      if (!one) continue;
      ++hits;
      ASSERT_EQ(one->distance_mm, bundle[k]->distance_mm) << "beam " << i << ", ray " << k;
    }
  }
  EXPECT_GT(hits, 5000);
}

/// Every kind of rays that somebody may hand over together.
std::vector<FieldTracer::Ray> packet_of_rays(const ModelField& f, Draws& draw, int kind) {
  const HeightRange range = height_range(f.z_mm);
  const double wide = f.x_mm(f.z_mm.cols() - 1) - f.x0.value(),
               deep = f.y_mm(f.z_mm.rows() - 1) - f.y0.value(), step = f.spacing.value();
  const auto place = [&] {
    return Vec3{f.x0.value() + draw.uniform(-0.1, 1.1) * wide,
                f.y0.value() + draw.uniform(-0.1, 1.1) * deep,
                draw.uniform(static_cast<double>(range.min), static_cast<double>(range.max))};
  };
  const auto on_a_node = [&] {
    return node(f, draw.index(f.z_mm.rows() - 1), draw.index(f.z_mm.cols() - 1));
  };
  const Vec3 at = kind % 2 == 0 ? place() : on_a_node();
  Vec3 way = draw.direction();
  if (kind % 5 == 1) way = {0.0, 0.0, -1.0};  // through nodes, downwards
  if (kind % 5 == 2) way = {kind % 3 == 0 ? 1.0 : 0.0, kind % 3 == 0 ? 0.0 : -1.0, 0.0};  // a line
  if (kind % 5 == 3) way = normalized(Vec3{way.x, way.y, 0.02 * way.z});                  // grazing
  const double back = draw.uniform(0.0, 1.0) < 0.3 ? 0.0 : draw.uniform(0.0, 3.0 * (wide + deep));
  const Vec3 eye = at - back * way;
  const double spread = std::pow(10.0, draw.uniform(-4.0, 0.0));
  std::vector<FieldTracer::Ray> rays;
  for (std::ptrdiff_t k = 0; k < 1 + draw.index(40); ++k) {
    const Vec3 aside{step * static_cast<double>(k % 4), step * static_cast<double>(k / 4 % 4), 0.0};
    switch (kind % 7) {
      case 0:  // a picture
        rays.push_back({eye, normalized(way + spread * draw.direction())});
        break;
      case 1:  // a sun
      case 2:
        rays.push_back({eye + aside, way});
        break;
      case 3:  // towards a lamp
        rays.push_back({at + aside, normalized(eye + 10.0 * step * draw.direction() - at - aside)});
        break;
      case 4:  // from one node to others
        rays.push_back({eye, normalized(at + aside - eye + Vec3{0.0, 0.0, 1e-9})});
        break;
      case 5:  // unrelated
        rays.push_back({place(), draw.direction()});
        break;
      default:  // the same
        rays.push_back({eye, way});
    }
  }
  return rays;
}

TEST_P(FieldTracerSeeded, RaysTogetherHitWhatTheyHitAlone) {
  Draws draw{seed() + 500};
  int hits = 0, blocks = 0;
  for (const auto& [rows, cols, step] :
       {std::tuple{2L, 2L, 1.0}, {5L, 9L, 0.3}, {83L, 61L, 0.5}, {700L, 431L, 0.1}}) {
    ModelField f = rough_ground(seed(), rows, cols, step, -3.1, 200.7);
    if (rows > 50) f.z_mm(rows / 2, cols / 2) = NAN;
    const FieldTracer tracer(f), common(f, FieldTracer::Instructions::common);
    for (int i = 0; i < 1500; ++i) {
      const auto rays = packet_of_rays(f, draw, i);
      std::vector<std::optional<FieldHit>> many(rays.size()), many_common(rays.size());
      tracer.trace_many(rays, many);
      common.trace_many(rays, many_common);
      std::vector<FieldTracer::Segment> segments;
      for (const FieldTracer::Ray& ray : rays) {
        const auto one = tracer.trace(ray.origin_mm, ray.direction);
        const double far = one && i % 2 == 0 ? one->distance_mm : draw.uniform(0.0, 300.0);
        segments.push_back({ray.origin_mm, ray.direction, far});
      }
      std::array<bool, 64> stopped{}, stopped_common{};
      tracer.blocked_many(segments, {stopped.data(), rays.size()});
      common.blocked_many(segments, {stopped_common.data(), rays.size()});
      for (std::size_t k = 0; k < rays.size(); ++k) {
        const auto one = tracer.trace(rays[k].origin_mm, rays[k].direction);
        for (const auto& other : {many[k], many_common[k]}) {
          ASSERT_EQ(one.has_value(), other.has_value()) << "packet " << i << ", ray " << k;
          if (!one) continue;
          ++hits;
          ASSERT_EQ(one->distance_mm, other->distance_mm) << "packet " << i << ", ray " << k;
          ASSERT_EQ(one->normal, other->normal) << "packet " << i << ", ray " << k;
        }
        const bool blocked =
            tracer.blocked(rays[k].origin_mm, rays[k].direction, segments[k].to_mm);
        ASSERT_EQ(blocked, one && one->distance_mm < segments[k].to_mm);
        ASSERT_EQ(blocked, stopped[k]) << "packet " << i << ", ray " << k;
        ASSERT_EQ(blocked, stopped_common[k]) << "packet " << i << ", ray " << k;
        blocks += blocked ? 1 : 0;
      }
    }
  }
  EXPECT_GT(hits, 30'000);
  EXPECT_GT(blocks, 7'000);
}

TEST_P(FieldTracerSeeded, RaysFromJustOffTheSurfaceMeetWhatAllTrianglesSay) {
  // Shadows: the ray's line meets, backwards, the triangle that it begins beside.
  const ModelField f = rough_ground(seed(), 47, 38, 0.25, 900.0, -40.0);
  const FieldTracer tracer(f), common(f, FieldTracer::Instructions::common);
  Draws draw{seed() + 600};
  int hits = 0;
  for (int i = 0; i < 3000; ++i) {
    const Vec3 n = node(f, draw.index(46), draw.index(37));
    const Vec3 high{n.x + draw.uniform(0.0, 0.25), n.y + draw.uniform(0.0, 0.25), 50.0};
    const auto ground = tracer.trace(high, {0.0, 0.0, -1.0});
    ASSERT_TRUE(ground.has_value());
    const Vec3 start = ground->point_mm + std::pow(10.0, draw.uniform(-12.0, -1.0)) *
                                              (i % 3 == 0 ? -1.0 : 1.0) * ground->normal;
    Vec3 way = draw.direction();
    if (i % 4 == 0)
      way = normalized(way - (1.0 - 1e-7) * dot(way, ground->normal) * ground->normal);
    const double expected = without_pyramid(f, start, way, 0.0);
    for (const FieldTracer* t : {&tracer, &common}) {
      const auto hit = t->trace(start, way);
      ASSERT_EQ(hit ? hit->distance_mm : INFINITY, expected) << "ray " << i;
    }
    hits += std::isfinite(expected) ? 1 : 0;
  }
  EXPECT_GT(hits, 800);
}

TEST(FieldTracer, WhatIsNotFiniteMeetsNothing) {
  const ModelField f = rough_ground(3, 40, 40, 1.0);
  const FieldTracer tracer(f);
  for (const double odd : {static_cast<double>(NAN), static_cast<double>(INFINITY)})
    for (int k = 0; k < 6; ++k) {
      FieldTracer::Ray ray{{20.0, 10.0, 20.0}, {0.0, 0.6, -0.8}};
      (k == 0   ? ray.origin_mm.x
       : k == 1 ? ray.origin_mm.y
       : k == 2 ? ray.origin_mm.z
       : k == 3 ? ray.direction.x
       : k == 4 ? ray.direction.y
                : ray.direction.z) = odd;
      EXPECT_FALSE(tracer.trace(ray.origin_mm, ray.direction).has_value()) << k;
      EXPECT_FALSE(tracer.blocked(ray.origin_mm, ray.direction, 100.0)) << k;
      const std::vector<FieldTracer::Ray> rays{{{20.0, 10.0, 20.0}, {0.0, 0.6, -0.8}}, ray};
      std::vector<std::optional<FieldHit>> hits(2);
      tracer.trace_many(rays, hits);
      EXPECT_TRUE(hits[0].has_value()) << k;
      EXPECT_FALSE(hits[1].has_value()) << k;
    }
}

TEST_P(FieldTracerSeeded, AgreesWithASecondFormula) {
  const ModelField f = rough_ground(seed(), 30, 41, 1.0);
  const FieldTracer tracer(f);
  Draws draw{seed() + 300};
  for (int i = 0; i < 3000; ++i) {
    const Vec3 target{draw.uniform(0.0, 40.0), draw.uniform(0.0, 29.0), draw.uniform(-8.0, 8.0)};
    const Vec3 d = draw.direction();
    const Vec3 origin = target - 100.0 * d;
    const auto hit = tracer.trace(origin, d);
    const double t = hit ? hit->distance_mm : INFINITY;
    const double may = moeller_trumbore(f, origin, d, 1e-10);
    const double must = moeller_trumbore(f, origin, d, -1e-10);
    ASSERT_GE(t, may - 1e-9) << "ray " << i;
    ASSERT_LE(t, must + 1e-9) << "ray " << i;
  }
}

TEST_P(FieldTracerSeeded, WalksThroughAllCrossings) {
  const ModelField f = rough_ground(seed(), 40, 60, 1.0);
  const FieldTracer tracer(f);
  Draws draw{seed() + 400};
  int crossings = 0;
  for (int i = 0; i < 200; ++i) {
    const Vec3 origin{-5.0, draw.uniform(3.0, 36.0), draw.uniform(-3.0, 3.0)};
    const Vec3 d = normalized(Vec3{1.0, draw.uniform(-0.3, 0.3), draw.uniform(-0.02, 0.02)});
    double from = 0.0;
    for (int k = 0; k < 200; ++k) {
      const auto hit = tracer.trace(origin, d, from);
      const double expected = without_pyramid(f, origin, d, from);
      ASSERT_EQ(hit ? hit->distance_mm : INFINITY, expected);
      if (!hit) break;
      ASSERT_GT(hit->distance_mm, from);
      from = hit->distance_mm;
      ++crossings;
    }
  }
  EXPECT_GT(crossings, 300) << "the ground must be rough enough for this test to mean anything";
}

// ---- voids -----------------------------------------------------------------

TEST(FieldTracer, AVoidIsAHole) {
  ModelField f{Grid<float>(20, 20, 1.0F), Millimetres{1.0}};
  f.z_mm(10, 10) = NAN;
  f.z_mm(4, 4) = INFINITY;
  const FieldTracer tracer(f);
  const Vec3 down{0.0, 0.0, -1.0};
  // Six triangles meet in a node; all are gone, and no other.
  EXPECT_FALSE(tracer.trace({10.2, 10.1, 5.0}, down).has_value());
  EXPECT_FALSE(tracer.trace({9.9, 9.2, 5.0}, down).has_value());
  EXPECT_FALSE(tracer.trace({4.1, 4.1, 5.0}, down).has_value());
  EXPECT_TRUE(tracer.trace({10.9, 9.5, 5.0}, down).has_value()) << "lower right of its cell";
  EXPECT_TRUE(tracer.trace({9.1, 10.9, 5.0}, down).has_value()) << "upper left of its cell";
  for (std::ptrdiff_t i = 0; i < 4000; ++i) {
    const double x = 8.0 + 0.0137 * static_cast<double>(i % 300),

                 y = 8.0003 + 0.001 * static_cast<double>(i);
    EXPECT_EQ(tracer.trace({x, y, 5.0}, down).has_value(), !std::isnan(height_at(f, x, y)))
        << x << ", " << y;
  }
}

TEST(FieldTracer, NothingButVoidsIsNothing) {
  const ModelField f{Grid<float>(20, 20, NAN), Millimetres{1.0}};
  EXPECT_FALSE(FieldTracer(f).trace({5.0, 5.0, 5.0}, {0.0, 0.0, -1.0}).has_value());
}

TEST(FieldTracer, TakesLittleMemory) {
  const ModelField f{Grid<float>(1001, 1001, 0.0F), Millimetres{1.0}};
  EXPECT_LT(static_cast<double>(FieldTracer(f).memory_bytes()), 0.55 * 1000.0 * 1000.0);
}

TEST(FieldTracer, RefusesAFieldWithoutTriangles) {
  const ModelField line{Grid<float>(1, 20, 0.0F), Millimetres{1.0}};
  EXPECT_THROW(FieldTracer{line}, CheckFailed);
}

}  // namespace
}  // namespace maquette::heightmap
