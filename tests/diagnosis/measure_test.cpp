// SPDX-License-Identifier: GPL-3.0-or-later

// From files to observations, and what is refused.

#include <algorithm>
#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/case_input.hpp"
#include "diagnosis/probe_table.hpp"
#include "heightmap/field_io.hpp"
#include "scan/cloud.hpp"
#include "scan/register.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::diagnosis {
namespace {

using testing_support::FailsWith;
using testing_support::points_on;
using testing_support::rough_part;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

struct Files {
  ScratchFolder folder;
  heightmap::ModelField design = rough_part(1, 121, 121, 0.5);
  CaseInput input;
  Files() {
    input.design = folder / "design.tif";
    EXPECT_THAT(heightmap::write_model_field(design, input.design), Succeeds());
  }
  void scan(scan::Cloud cloud, std::optional<Vec3> station = Vec3{30, -500, 500}) {
    const auto file = folder / fmt::format("scan{}.ply", input.scans.size());
    EXPECT_THAT(scan::write_cloud(cloud, file), Succeeds());
    input.scans.push_back({file, station, 0.05});
  }
  std::filesystem::path text(const char* name, const std::string& content) const {
    std::ofstream(folder / name) << content;
    return folder / name;
  }
};

enum class Probed { mark, touched, from_above };
/// At 15 x 15 places with noise; a part that leans by 1 mrad. Marks lean with it, touched points
/// are found where the surface is along their normals.
/// @param coat_mm  outwards; nominal heights are the bare surface's
std::string probed(const heightmap::ModelField& design, Probed kind, double along, double sideways,
                   double coat_mm = 0.0) {
  std::string text = "x_nominal_mm,y_nominal_mm,z_nominal_mm,x_mm,y_mm,z_mm,sigma_mm\n";
  for (std::uint64_t i = 0; i < 225; ++i) {
    const double x = 3.0 + 3.8 * static_cast<double>(i % 15),
                 y = 3.0 + 3.8 * static_cast<double>(i / 15),
                 z = heightmap::height_at(design, x, y);
    const auto at = [&](double dx, double dy) {
      return heightmap::height_at(design, x + dx, y + dy);
    };
    const Vec3 n =
        normalized(Vec3{at(-0.1, 0.0) - at(0.1, 0.0), at(0.0, -0.1) - at(0.0, 0.1), 0.2});
    const Vec3 lean{1e-3 * y, 0.0, 0.0};
    const Vec3 off = kind == Probed::mark ? lean : (dot(lean, n) + coat_mm) * n;
    const Vec3 p = kind == Probed::from_above
                       ? Vec3{x, y, z + (dot(lean, n) + along * random_normal(11, i)) / n.z}
                       : Vec3{x, y, z} + off + along * random_normal(11, i) * n +
                             sideways * Vec3{random_normal(12, i), random_normal(13, i), 0.0};
    text += fmt::format("{},{},{},{},{},{},0.003\n", x, y, z, p.x, p.y, p.z);
  }
  return text;
}

// Marks measured in space say where they are along the surface, too; points that were touched, or
// approached only to a tenth of a millimetre, do not, even where their noise is that of marks:
// taken for marks that had stayed where they were, a tool that was too long was an uneven coat.
// Those touched from above at their nominal places scatter along slopes by what they scatter in z:
// taken for marks that had not moved they ruled out that a block had shrunk.
TEST(Measure, MarksInSpaceCountAlongTheSurface) {
  struct Kind {
    const char* name;
    Probed probed;
    double along, sideways;
    std::size_t a_row;
  };
  for (const Kind& kind : {Kind{"marks", Probed::mark, 0.003, 0.003, 3},
                           Kind{"touched", Probed::touched, 0.003, 0.0, 1},
                           Kind{"touched, told in space", Probed::touched, 0.003, 0.003, 1},
                           Kind{"approached", Probed::mark, 0.003, 0.1, 1},
                           Kind{"from above", Probed::from_above, 0.008, 0.0, 1}}) {
    Files f;
    f.input.probes.push_back(
        f.text("cmm.csv", probed(f.design, kind.probed, kind.along, kind.sideways)));
    const auto m = measure(f.input);
    ASSERT_THAT(m, Succeeds()) << kind.name;
    EXPECT_EQ(m->observations.size(), 225 * kind.a_row) << kind.name;
  }
}

// Who measures a coated part by the design's heights finds the coat that is declared.
TEST(Measure, NominalHeightsMayBeOfTheBarePart) {
  Files f;
  f.input.coat_mm = 0.1;
  f.input.probes.push_back(
      f.text("cmm.csv", probed(f.design, Probed::touched, 0.003, 0.0, f.input.coat_mm)));
  const auto m = measure(f.input);
  ASSERT_THAT(m, Succeeds());
  double sum = 0.0, lean = 0.0;
  for (const Observation& o : m->observations) {
    sum += o.residual_mm;
    lean += 1e-3 * o.place.y * o.normal.x;
  }
  // The mean of 225 scatters by 0.0002; patches between nodes are off their central differences.
  EXPECT_NEAR((sum - lean) / static_cast<double>(m->observations.size()), 0.0, 0.001);
}

// Oblique beams read long by a (1 / cos i - 1): what that is along the normal registration takes,
// and the scan lies aside by the rest. Beside the law it lies where it was.
TEST(Measure, BeamsThatReadLongPushAScanAside) {
  constexpr Vec3 kStation{30.0, -500.0, 330.0};
  for (const double long_mm : {0.0, 1.2}) {
    Files f;
    // What is flat says nothing of obliqueness, and short waves have no slope that all agree on.
    f.design = rough_part(1, 121, 121, 0.5, 4.0, 2.0);
    ASSERT_THAT(heightmap::write_model_field(f.design, f.input.design), Succeeds());
    auto cloud = points_on(f.design, 20'000, 3);
    for (Vec3& p : cloud.points_mm) {
      const auto at = [&](double dx, double dy) {
        return heightmap::height_at(f.design, p.x + dx, p.y + dy);
      };
      const Vec3 beam = normalized(p - kStation);
      const double dx = std::clamp(p.x, 0.5, 59.5) - p.x, dy = std::clamp(p.y, 0.5, 59.5) - p.y;
      const Vec3 n = normalized(
          Vec3{at(dx - 0.5, dy) - at(dx + 0.5, dy), at(dx, dy - 0.5) - at(dx, dy + 0.5), 1.0});
      const auto i = static_cast<std::uint64_t>(&p - cloud.points_mm.data());
      p = p +
          (long_mm * (1.0 / std::fmax(0.25, -dot(beam, n)) - 1.0) + 0.02 * random_normal(5, i)) *
              beam;
    }
    f.scan(cloud, kStation);
    const auto aside_mm = [](const Measurements& m) {
      const auto& scan = m.set_ups[0];
      return norm(scan.model_from_file.point(scan.centre_mm) - scan.centre_mm);
    };
    const auto m = measure(f.input);
    ASSERT_THAT(m, Succeeds());
    ASSERT_TRUE(m->settled_anew);
    const auto anew = m->settled_anew({});
    ASSERT_THAT(anew, Succeeds());
    EXPECT_EQ(anew->beside_long_beams, long_mm > 0.0);
    if (long_mm > 0.0) {
      EXPECT_GT(aside_mm(*m), 0.4);
      // Slopes between nodes are not those of the levelled surface; a tenth of the way is left.
      EXPECT_LT(aside_mm(*anew), 0.1 * aside_mm(*m));
    }
  }
}

TEST(Measure, GivesResidualsAlongTheNormal) {
  Files f;
  auto cloud = points_on(f.design, 20'000, 1);
  for (Vec3& p : cloud.points_mm)
    p.z += 0.02 * random_normal(5, static_cast<std::uint64_t>(&p - cloud.points_mm.data()));
  f.scan(cloud);
  const auto m = measure(f.input);
  ASSERT_THAT(m, Succeeds());
  EXPECT_GT(m->observations.size(), 16'000U) << "1.5 mm of the rim, and what is beside shadows";
  double squares = 0.0;
  for (const Observation& o : m->observations) {
    squares += o.residual_mm * o.residual_mm / (o.normal.z * o.normal.z);
    EXPECT_NEAR(norm(o.normal), 1.0, 1e-9);
    EXPECT_TRUE(o.has_station);
  }
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(m->observations.size())), 0.02, 0.001);
  ASSERT_EQ(m->notes.size(), 2U) << "no program, and the rim: said";
}

// An eighth of the points of one place: dust and mixed pixels stray everywhere, and less.
TEST(Measure, SaysWhereStraysGather) {
  for (const bool gathered : {false, true}) {
    Files f;
    auto cloud = points_on(f.design, 60'000, 1, 0.03);
    for (std::size_t i = 0; i < cloud.points_mm.size(); ++i) {
      Vec3& q = cloud.points_mm[i];
      const bool there = std::hypot(q.x - 35.0, q.y - 22.0) < 9.0;
      const double share = gathered ? (there ? 0.125 : 0.002) : 0.01;
      if (random_uniform(77, i) < share) q.z += 0.5 + random_uniform(78, i);
    }
    f.scan(std::move(cloud));
    const auto m = measure(f.input);
    ASSERT_THAT(m, Succeeds());
    EXPECT_EQ(m->strays_gather, gathered);
    EXPECT_EQ(std::count_if(m->notes.begin(), m->notes.end(),
                            [](const std::string& note) {
                              return note.find("stray from the rest there") != std::string::npos;
                            }),
              gathered ? 1 : 0);
  }
}

TEST(Measure, SaysWhatAScanWithoutStationCannotTell) {
  Files f;
  f.scan(points_on(f.design, 20'000, 1), std::nullopt);
  const auto m = measure(f.input);
  ASSERT_THAT(m, Succeeds());
  bool said = false;
  for (const auto& n : m->notes) said |= n.find("no scanner position") != std::string::npos;
  EXPECT_TRUE(said);
  EXPECT_FALSE(m->observations[0].has_station);
}

TEST(Measure, RefusesAnotherPart) {
  Files f;
  f.scan(points_on(rough_part(77, 121, 121, 0.5), 20'000, 1));
  EXPECT_THAT(measure(f.input), FailsWith(kOtherPart));
}

TEST(Measure, LeavesOutStones) {
  Files f;
  const auto ground = f.design;
  f.input.ground = f.folder / "ground.tif";
  ASSERT_THAT(heightmap::write_model_field(ground, f.input.ground), Succeeds());
  for (std::ptrdiff_t r = 50; r <= 54; ++r)
    for (std::ptrdiff_t c = 60; c <= 66; ++c) f.design.z_mm(r, c) += 1.5F;
  ASSERT_THAT(heightmap::write_model_field(f.design, f.input.design), Succeeds());
  f.scan(points_on(f.design, 20'000, 1));
  const auto m = measure(f.input);
  ASSERT_THAT(m, Succeeds());
  for (const Observation& o : m->observations) {
    EXPECT_NEAR(o.residual_mm, 0.0, 1e-3);  // beside stones design and ground are the same
    const bool on = o.place.x > f.design.x_mm(59) && o.place.x < f.design.x_mm(67) &&
                    o.place.y > f.design.y_mm(49) && o.place.y < f.design.y_mm(55);
    EXPECT_FALSE(on);
  }
  EXPECT_GT(m->observations.size(), 15'000U);
  const auto other = rough_part(1, 61, 61, 0.5);
  ASSERT_THAT(heightmap::write_model_field(other, f.input.ground), Succeeds());
  EXPECT_THAT(measure(f.input), FailsWith(kOtherPart));
}

TEST(Measure, RefusesAUnitSlip) {
  Files f;
  auto cloud = points_on(f.design, 20'000, 1);
  for (Vec3& p : cloud.points_mm) p = 0.001 * p;
  f.scan(cloud);
  EXPECT_THAT(measure(f.input), FailsWith(scan::kUnitSlip));
}

TEST(Measure, RefusesAProgramOfAnotherPart) {
  Files f;
  f.scan(points_on(f.design, 20'000, 1));
  std::string program = "G21 G90 F1000\nG0 X0 Y0 Z30\n";
  for (int i = 0; i <= 120; ++i)
    program += fmt::format("G1 X{} Y{}\n", i % 2 == 0 ? 60 : 0, 0.5 * i);
  f.input.programs = {f.text("part.ngc", program + "M30\n")};
  EXPECT_THAT(measure(f.input), FailsWith(kOtherProgram));
}

/// Waves that a ball of 6 mm follows everywhere.
double wavy(double x, double y) {
  return std::cos(x / 9.0) + 0.7 * std::cos(y / 7.0);
}

/// Lines along x (or y) of a ball that touches the waves, 0.5 mm apart.
std::string raster(bool along_x) {
  std::string program = "G21 G90 F2000\nG0 X-2 Y-2 Z30\n";
  constexpr int kLines = 121, kStops = 121;
  for (int i = 0; i < kLines; ++i)
    for (int j = 0; j < kStops; ++j) {
      const double across = 0.5 * i, along = 0.5 * (i % 2 == 0 ? j : kStops - 1 - j);
      const double x = along_x ? along : across, y = along_x ? across : along;
      const Vec3 n = normalized(Vec3{std::sin(x / 9.0) / 9.0, 0.7 * std::sin(y / 7.0) / 7.0, 1.0});
      const Vec3 tip = Vec3{x, y, wavy(x, y)} + 3.0 * n - Vec3{0.0, 0.0, 3.0};
      program += fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f}\n", tip.x, tip.y, tip.z);
    }
  return program + "G0 Z30\nM30\n";
}

// Of two rasters over the same ground either may be what is left: up or down then is no mere sign.
// Neighbouring lines of one raster are close in height, too, but made at nearly the same time.
TEST(Measure, SeesThatRastersCross) {
  for (const bool crossing : {false, true}) {
    Files f;
    for (std::ptrdiff_t r = 0; r < f.design.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < f.design.z_mm.cols(); ++c)
        f.design.z_mm(r, c) = static_cast<float>(wavy(f.design.x_mm(c), f.design.y_mm(r)));
    ASSERT_THAT(heightmap::write_model_field(f.design, f.input.design), Succeeds());
    f.scan(points_on(f.design, 20'000, 1));
    f.input.programs = {f.text("x.ngc", raster(true))};
    if (crossing) f.input.programs.push_back(f.text("y.ngc", raster(false)));
    const auto m = measure(f.input);
    ASSERT_THAT(m, Succeeds());
    EXPECT_EQ(m->scene.passes_cross, crossing);
  }
}

TEST(Measure, RefusesTooFewAndTooNarrow) {
  Files few;
  few.scan(points_on(few.design, 40, 1));
  EXPECT_THAT(measure(few.input), FailsWith(kTooFewMeasurements));
  Files narrow;
  auto cloud = points_on(narrow.design, 40'000, 1);
  std::erase_if(cloud.points_mm, [](Vec3 p) { return p.x > 9.0 || p.y > 9.0; });
  const auto file = narrow.folder / "probe.csv";
  std::string rows = "x_nominal_mm,y_nominal_mm,x_mm,y_mm,z_mm\n";
  for (std::size_t i = 0; i < 200; ++i)
    rows += fmt::format("{0},{1},{0},{1},{2}\n", cloud.points_mm[i].x, cloud.points_mm[i].y,
                        cloud.points_mm[i].z);
  narrow.input.probes = {narrow.text("probe.csv", rows)};
  EXPECT_THAT(measure(narrow.input), FailsWith(kTooFewMeasurements));
}

TEST(Probes, AreReadByTheNamesOfTheirColumns) {
  Files f;
  const auto rows = read_probe_table(f.text(
      "cmm.csv",
      "# by hand\nsigma_mm; "
      "Y_nominal_mm;X_nominal_mm;x_mm;y_mm;remark\n0,004;20;10;10,01;20,02;a\n;30;11;11;30;b\n"));
  ASSERT_THAT(rows, Succeeds());
  ASSERT_EQ(rows->size(), 2U);
  EXPECT_DOUBLE_EQ((*rows)[0].x_nominal_mm, 10.0);
  EXPECT_DOUBLE_EQ((*rows)[0].y_mm, 20.02);
  EXPECT_DOUBLE_EQ((*rows)[0].sigma_mm.value(), 0.004);
  EXPECT_FALSE((*rows)[0].z_mm.has_value());
  EXPECT_FALSE((*rows)[1].sigma_mm.has_value());
}

TEST(Probes, SayWhereATableIsWrong) {
  Files f;
  const auto missing = read_probe_table(f.text("a.csv", "x_nominal_mm,x_mm,y_mm\n1,2,3\n"));
  ASSERT_THAT(missing, FailsWith(kProbeTable));
  EXPECT_NE(missing.error().message.find("y_nominal_mm"), std::string::npos);
  const auto word = read_probe_table(
      f.text("b.csv", "x_nominal_mm,y_nominal_mm,x_mm,y_mm\n1,2,3,4\n1,2,three,4\n"));
  ASSERT_THAT(word, FailsWith(kProbeTable));
  EXPECT_NE(word.error().message.find(":3:"), std::string::npos);
  EXPECT_THAT(read_probe_table(f.text("c.csv", "x_nominal_mm,y_nominal_mm,x_mm,y_mm\n")),
              FailsWith(kProbeTable));
}

TEST(Probes, MarksInPlanMeasureBothWays) {
  Files f;
  std::string rows = "x_nominal_mm,y_nominal_mm,x_mm,y_mm\n";
  for (int i = 0; i < 100; ++i) {
    const double x = 3.0 + 54.0 * random_uniform(3, static_cast<std::uint64_t>(2 * i)),
                 y = 3.0 + 54.0 * random_uniform(3, static_cast<std::uint64_t>(2 * i + 1));
    rows += fmt::format("{},{},{},{}\n", x, y, x + 0.01, y - 0.02);
  }
  f.input.probes = {f.text("cmm.csv", rows)};
  const auto m = measure(f.input);
  ASSERT_THAT(m, Succeeds());
  ASSERT_EQ(m->observations.size(), 200U);
  EXPECT_NEAR(m->observations[0].residual_mm, 0.01, 1e-9);
  EXPECT_NEAR(m->observations[1].residual_mm, -0.02, 1e-9);
  EXPECT_FALSE(m->observations[0].on_surface);
}

}  // namespace
}  // namespace maquette::diagnosis
