// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/effect.hpp"
#include "diagnosis/path_contact.hpp"
#include "support/matchers.hpp"

namespace maquette::diagnosis {
namespace {

using testing_support::ScratchFolder;

// Rows half a millimetre apart are ridges of 10 um. A screw that is 0.15 % short puts them 0.12 mm
// elsewhere at the rim, a quarter of a row: there a point's own slope, ridge included, says
// nothing of how far, and sizes read off it come out too small. The slope without ridges does.
TEST(LevelAlong, SizesDoNotHangOnRidges) {
  const ScratchFolder scratch;
  constexpr double kSide_mm = 160.0, kRadius_mm = 3.0, kShare = -0.0015, kSlope = 0.08;
  std::string text = "G21 F1000\nG0 X0 Y60 Z20\n";
  for (int i = 0; i <= 320; ++i) {
    const double x = 0.5 * i, z = kSlope * x;
    text += fmt::format("G1 X{:.3f} Y{} Z{:.4f}\nG1 Y{}\n", x, i % 2 == 0 ? 60 : 100, z,
                        i % 2 == 0 ? 100 : 60);
  }
  const std::vector<std::filesystem::path> files{scratch / "part.ngc"};
  std::ofstream(files[0]) << text << "M30\n";
  const auto read = CutPath::read(files, kRadius_mm, {});
  ASSERT_TRUE(read.has_value());
  const CutPath& path = *read;
  Measurements m;
  m.scene.box.add({0, 0, 0});
  m.scene.box.add({kSide_mm, kSide_mm, 32});
  m.scene.ball_radius_mm = kRadius_mm;
  m.scene.has_path = false;
  m.set_ups.push_back({});
  m.set_ups[0].centre_mm = m.scene.centre();
  for (std::uint64_t i = 0; i < 4000; ++i) {
    const double x = 4.0 + 152.0 * random_uniform(3, 2 * i),
                 y = 64.0 + 32.0 * random_uniform(3, 2 * i + 1);
    auto rivals = std::make_shared<std::vector<Rival>>();
    const auto contact = path.at(x, y, rivals.get());
    ASSERT_TRUE(contact);
    Observation o;
    static_cast<CutState&>(o) = *contact;
    o.place = {x, y, contact->height_mm};
    o.normal = o.along = contact->normal;
    o.slope_normal = normalized(Vec3{-kSlope, 0.0, 1.0});
    o.rivals = std::move(rivals);
    m.observations.push_back(o);
  }
  const Column column = find_effect("machine.scale_x")->forms(m.scene).at(0).columns.at(0);
  double level = 0.0, level2 = 0.0, ridged = 0.0, ridged2 = 0.0;
  for (Observation& o : m.observations) {
    const auto before =
        path.height(o.place.x - kShare * (o.place.x - m.scene.centre().x), o.place.y);
    ASSERT_TRUE(before);
    const double is = (*before - o.place.z) * o.normal.z;
    const double said = column.value(o);
    o.slope_normal = o.normal;
    const double with_ridges = column.value(o);
    level += said * is;
    level2 += said * said;
    ridged += with_ridges * is;
    ridged2 += with_ridges * with_ridges;
  }
  const double truth = kShare * m.scene.half_mm();
  // 4000 points, a ridge's 3 um over a signal of 6: a hundredth.
  EXPECT_NEAR(level / level2 / truth, 1.0, 0.03);
  EXPECT_LT(ridged / ridged2 / truth, 0.9) << "there is something to mend";
}

}  // namespace
}  // namespace maquette::diagnosis
