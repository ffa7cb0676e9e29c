// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/residuals.hpp"

#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/detail/sums.hpp"
#include "diagnosis/path_contact.hpp"
#include "support/matchers.hpp"

namespace maquette::diagnosis {
namespace {

using testing_support::ScratchFolder;

// Rows half a millimetre apart are ridges of 10 um. A part that has shrunk by 0.15 % has them 0.12
// mm elsewhere at its rim, where a point's own slope (ridges included) says nothing of how far.
TEST(BeyondLinear, RowsMoveWithThePart) {
  const ScratchFolder scratch;
  constexpr double kSide_mm = 160.0, kRadius_mm = 3.0, kShare = -0.0015;
  std::string text = "G21 F1000\nG0 X0 Y60 Z20\n";
  for (int i = 0; i <= 320; ++i) {
    const double x = 0.5 * i, z = 0.2 * x;
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
    o.normal = o.along = o.slope_normal = contact->normal;
    o.rivals = std::move(rivals);
    m.observations.push_back(o);
  }
  const Effect& swelling = *find_effect("stock.swelling");
  const Form form = swelling.forms(m.scene).at(0);
  const auto layout = detail::lay_out(m.scene.box, 1);
  const auto bank = detail::sum_up(m.observations, detail::nuisances_of(m), form.columns, layout);
  Eigen::VectorXd coefficients = Eigen::VectorXd::Zero(bank.nuisances + 1);
  coefficients(bank.nuisances) = kShare * m.scene.half_mm();
  detail::Signatures signatures;
  detail::LagAndSlack none(m.scene);
  const auto beyond = detail::beyond_linear(m.observations, {{&swelling, form}}, bank, coefficients,
                                            kRadius_mm, signatures, none, true);
  EXPECT_TRUE(beyond.rows_moved);
  double linear = 0.0, whole = 0.0;
  for (std::size_t i = 0; i < m.observations.size(); ++i) {
    const Observation& o = m.observations[i];
    const Vec3 d = kShare * (o.place - m.scene.centre());
    const auto before = path.height(o.place.x - d.x, o.place.y - d.y);
    ASSERT_TRUE(before);
    const double is = (*before + d.z - o.place.z) * o.normal.z, said = dot(o.along, d);
    linear += std::pow(said - is, 2) / 4000.0;
    whole += std::pow(said + beyond.mm[i] - is, 2) / 4000.0;
  }
  // The ball of a moved row is the same ball: exact for rows along the displacement's normal.
  EXPECT_LT(std::sqrt(whole), 0.0002) << "mm rms";
  EXPECT_GT(std::sqrt(linear), 0.002) << "mm rms: there is something to mend";
}

}  // namespace
}  // namespace maquette::diagnosis
