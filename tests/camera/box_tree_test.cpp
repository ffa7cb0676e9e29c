// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in camera/detail/box_tree.hpp, against each ray and each box one by one:
//
//   "no" is certain ................. no ray of a bundle that is said to meet nothing meets a box,
//                                     for 0 to 700 boxes, close and wide bundles, rays along the
//                                     axes, rays that end, rays that begin inside
//   "yes" is worth asking for ....... close bundles that meet nothing are mostly told so

#include "camera/detail/box_tree.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette::camera::detail {
namespace {

struct Draws {
  std::uint64_t seed, count = 0;
  double uniform(double lo, double hi) { return lo + (hi - lo) * random_uniform(seed, count++); }
  Vec3 vector(double size) {
    return {uniform(-size, size), uniform(-size, size), uniform(-size, size)};
  }
};

struct Ray {
  Vec3 origin, direction;
  double length;
};

bool meets(const Ray& r, const Box3& box) {
  double enter = 0.0, leave = r.length;
  const auto slab = [&](double o, double d, double lo, double hi) {
    if (d == 0.0) {
      if (o < lo || o > hi) leave = -1.0;
      return;
    }
    enter = std::max(enter, std::min((lo - o) / d, (hi - o) / d));
    leave = std::min(leave, std::max((lo - o) / d, (hi - o) / d));
  };
  slab(r.origin.x, r.direction.x, box.min.x, box.max.x);
  slab(r.origin.y, r.direction.y, box.min.y, box.max.y);
  slab(r.origin.z, r.direction.z, box.min.z, box.max.z);
  // Rays that touch an edge may be rounded away.
  return leave - enter > 1e-9;
}

TEST(BoxTree, NoIsCertainAndMostlySaid) {
  Draws draw{11};
  int met = 0, told = 0, empty = 0;
  for (const std::size_t count : {0U, 1U, 7U, 8U, 9U, 64U, 65U, 700U}) {
    std::vector<Box3> boxes(count);
    for (Box3& box : boxes) {
      const Vec3 at{draw.uniform(-50.0, 50.0), draw.uniform(-50.0, 50.0), draw.uniform(-5.0, 5.0)};
      const double size = draw.uniform(0.0, 2.0);
      box.add(at);
      box.add(at + Vec3{size, draw.uniform(0.0, 2.0), size});
    }
    const BoxTree tree(boxes);
    for (int i = 0; i < 3000; ++i) {
      const Vec3 eye = draw.vector(60.0), aim = draw.vector(i % 3 == 0 ? 5.0 : 60.0);
      Vec3 way = normalized(aim - eye);
      if (i % 7 == 0) way = {0.0, i % 2 == 0 ? 1.0 : -1.0, 0.0};
      if (i % 11 == 0) way = {0.0, 0.0, i % 2 == 0 ? 1.0 : -1.0};
      const double spread = i % 5 == 0 ? 0.5 : 0.003, apart = i % 4 == 0 ? 1.0 : 0.0;
      std::vector<Ray> rays;
      BoxTree::Bundle bundle;
      EXPECT_TRUE(bundle.empty());
      for (int k = 0; k < 16; ++k) {
        const Vec3 turned = i % 2 == 0 ? way + draw.vector(spread) : way;
        rays.push_back(
            {eye + draw.vector(apart), turned, i % 6 == 0 ? INFINITY : draw.uniform(0.0, 150.0)});
        bundle.add(rays.back().origin, rays.back().direction, rays.back().length);
      }
      bool any = false;
      for (const Ray& ray : rays)
        for (const Box3& box : boxes) any = any || meets(ray, box);
      const bool said = tree.may_meet(bundle);
      RayLanes lanes;
      for (std::size_t k = 0; k < rays.size(); ++k)
        lanes.put(k, rays[k].origin, rays[k].direction, rays[k].length);
      ASSERT_EQ(tree.may_meet(BoxTree::Bundle(lanes)), said);
      ASSERT_TRUE(said || !any) << count << " boxes, bundle " << i;
      met += any ? 1 : 0;
      const bool close = spread < 0.1 && apart == 0.0;
      empty += close && !any ? 1 : 0;
      told += close && !any && !said ? 1 : 0;
    }
  }
  EXPECT_GT(met, 700);
  EXPECT_GT(empty, 5000);
  EXPECT_GT(told, empty * 9 / 10);
}

}  // namespace
}  // namespace maquette::camera::detail
