// SPDX-License-Identifier: GPL-3.0-or-later

// export/pack_builds.hpp:
//   inside, and the spacing kept ......... every pair of random boxes, several seeds
//   equal boxes stand in a lattice ....... counted: 4 x 3 x 2 a volume, never one more
//   not much room is wasted .............. share of the volumes that is filled, random stones
//   EXPORT_PART_TOO_LARGE ................ names place and sizes

#include "export/pack_builds.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::exporting {
namespace {

using testing_support::FailsWith;

std::vector<Vec3> random_boxes(std::uint64_t seed, std::size_t count) {
  std::vector<Vec3> sizes;
  for (std::uint64_t i = 0; i < count; ++i) {
    const double d = 2.0 + 18.0 * std::pow(random_uniform(seed, 4 * i), 3.0);
    sizes.push_back({d * (0.8 + 0.4 * random_uniform(seed, 4 * i + 1)),
                     d * (0.8 + 0.4 * random_uniform(seed, 4 * i + 2)),
                     d * (0.5 + 0.4 * random_uniform(seed, 4 * i + 3))});
  }
  return sizes;
}

class Packing : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Packing, testing::Values(1, 2, 3));

TEST_P(Packing, KeepsBoxesApartAndInside) {
  const auto sizes = random_boxes(GetParam(), 700);
  const BuildVolume room{{60, 50, 40}, 1.5};
  const auto placed = pack_builds(sizes, room).value();
  ASSERT_EQ(placed.size(), sizes.size());
  std::size_t volumes = 0;
  double filled = 0.0;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const Vec3 lo = placed[i].at_mm, hi = lo + sizes[i];
    volumes = std::max(volumes, placed[i].volume + 1);
    filled += sizes[i].x * sizes[i].y * sizes[i].z;
    EXPECT_GE(std::min({lo.x, lo.y, lo.z}), 0.0);
    EXPECT_LE(hi.x, 60 + 1e-6);
    EXPECT_LE(hi.y, 50 + 1e-6);
    EXPECT_LE(hi.z, 40 + 1e-6);
    for (std::size_t j = 0; j < i; ++j) {
      if (placed[j].volume != placed[i].volume) continue;
      const Vec3 a = placed[j].at_mm, b = a + sizes[j];
      const double apart =
          std::max({a.x - hi.x, lo.x - b.x, a.y - hi.y, lo.y - b.y, a.z - hi.z, lo.z - b.z});
      EXPECT_GE(apart, 1.5 - 1e-6) << i << " and " << j;
    }
  }
  // Shelves of mixed stones fill a third and more; a slip that opens a volume for each row does
  // not.
  EXPECT_GT(filled / (static_cast<double>(volumes) * 60 * 50 * 40), 0.3) << volumes;
}

TEST(PackBuilds, StandsEqualBoxesInALattice) {
  const BuildVolume room{{4.0, 3.0, 2.0}, 0.1};
  const Vec3 box{(4.0 - 0.3) / 4, (3.0 - 0.2) / 3, (2.0 - 0.1) / 2};
  for (const std::size_t count : {24U, 25U}) {
    const auto placed = pack_builds(std::vector<Vec3>(count, box), room).value();
    std::vector<int> in_volume(3, 0);
    for (const PackedBox& p : placed) ++in_volume.at(p.volume);
    EXPECT_EQ(in_volume[0], 24);
    EXPECT_EQ(in_volume[1], count == 24U ? 0 : 1);
  }
  EXPECT_TRUE(pack_builds({}, room).value().empty());
}

TEST(PackBuilds, NamesWhatDoesNotFit) {
  const std::vector<Vec3> sizes{{5, 5, 5}, {5, 5, 61}};
  const auto placed = pack_builds(sizes, {{60, 60, 60}, 1.0});
  ASSERT_THAT(placed, FailsWith(kPartTooLarge));
  EXPECT_THAT(placed.error().message,
              testing::AllOf(testing::HasSubstr("part 2"), testing::HasSubstr("5.0 x 5.0 x 61.0"),
                             testing::HasSubstr("60 x 60 x 60")));
}

}  // namespace
}  // namespace maquette::exporting
