// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/stone_body.hpp:
//   right files: nothing is touched ........... a box in STL (binary, ascii), PLY, OBJ, glTF:
//                                               volume, size, centre by closed form
//   units ..................................... metres, inches, a glTF's own
//   repaired: volume by closed form ........... points apart, repeated, turned, inside out,
//                                               without area, a hole, a cavity, dust
//   whatever is damaged in a rock, it comes
//   back ...................................... random rocks as loose triangles, shaken and turned
//   what comes out is a solid ................. mesh_checks' certificate, edges counted by hand
//   refused with file and place ............... open, two sheets at an edge, cuts itself, pieces,
//                                               flat, empty, too many triangles
//   in a plan ................................. stones.json and bodies to the bit; a changed body;
//                                               told places; numbers behind the drawn ones

#include "meshing/stone_body.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "core/random.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stone_parts.hpp"
#include "meshing/stones.hpp"
#include "support/gltf_text.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/shapes.hpp"
#include "support/simple_solids.hpp"

namespace maquette::meshing {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::terrain_solid;
using testing_support::volume_mm3;

void put(const fs::path& path, std::string_view content) {
  std::ofstream(path, std::ios::binary) << content;
}

std::string binary_stl(const TriMesh& m) {
  std::string text(80, ' ');
  const auto add = [&](auto value) {
    text.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  add(static_cast<std::uint32_t>(m.triangles.size()));
  for (const auto& t : m.triangles) {
    for (int k = 0; k < 3; ++k) add(0.0F);
    for (const std::uint32_t i : t)
      for (const double x : {m.vertices_mm[i].x, m.vertices_mm[i].y, m.vertices_mm[i].z})
        add(static_cast<float>(x));
    add(std::uint16_t{0});
  }
  return text;
}

std::string ascii_stl(const TriMesh& m) {
  std::string text = "solid stone\n";
  for (const auto& t : m.triangles) {
    text += "facet normal 0 0 0\nouter loop\n";
    for (const std::uint32_t i : t)
      text += fmt::format("vertex {} {} {}\n", m.vertices_mm[i].x, m.vertices_mm[i].y,
                          m.vertices_mm[i].z);
    text += "endloop\nendfacet\n";
  }
  return text + "endsolid stone\n";
}

std::string obj(const TriMesh& m) {
  std::string text;
  for (const Vec3& v : m.vertices_mm) text += fmt::format("v {} {} {}\n", v.x, v.y, v.z);
  for (const auto& t : m.triangles)
    text += fmt::format("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  return text;
}

TriMesh joined(TriMesh a, const TriMesh& b) {
  append(a, b);
  return a;
}

TriMesh inside_out(TriMesh m) {
  for (auto& t : m.triangles) std::swap(t[1], t[2]);
  return m;
}

/// A box 4 x 3 x 2 away from the origin.
TriMesh box() {
  return box_solid({10, 20, 30}, {14, 23, 32});
}

/// Box of 16 x 16 x 8 with 1 x 1 cells on top.
TriMesh cells() {
  return terrain_solid(17, 1.0, -8.0, [](double, double) { return 0.0; });
}

TriMesh repaired(const TriMesh& mesh, MeshRepairs& repairs) {
  const auto out = repair_stone(mesh, repairs);
  EXPECT_THAT(out, Succeeds());
  if (!out) return {};
  EXPECT_THAT(*out, testing_support::IsClosedAndOriented());
  const auto certificate = check_mesh(*out);
  EXPECT_TRUE(certificate && certificate->passed()) << to_json(certificate.value());
  return *out;
}

// ---- files ---------------------------------------------------------------------------------

class RightFile : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Formats, RightFile,
                         ::testing::Values("binary.stl", "ascii.stl", "box.ply", "box.obj",
                                           "box.glb"),
                         [](const auto& file) {
                           std::string name = file.param;
                           name[name.find('.')] = '_';
                           return name;
                         });

TEST_P(RightFile, IsTakenAsItIs) {
  const ScratchFolder folder;
  const fs::path path = folder / GetParam();
  TriMesh m = box();
  if (path.extension() == ".stl") {
    put(path, path.stem() == "ascii" ? ascii_stl(m) : binary_stl(m));
  } else if (path.extension() == ".ply") {
    ASSERT_THAT(write_ply(m, path), Succeeds());
  } else if (path.extension() == ".obj") {
    put(path, obj(m));
  } else {  // metres, y up: x, z, -y
    for (Vec3& v : m.vertices_mm) v = 0.001 * Vec3{v.x, v.z, -v.y};
    put(path,
        testing_support::glb_file(testing_support::gltf_json(m), testing_support::gltf_buffer(m)));
  }
  const auto body = read_stone_body(path);
  ASSERT_THAT(body, Succeeds());
  EXPECT_EQ(body->repairs, "none");
  EXPECT_EQ(body->source, GetParam());
  EXPECT_EQ(body->name, path.stem());
  EXPECT_EQ(body->source_sha256, sha256_file(path).value());
  EXPECT_EQ(body->mm_per_unit, path.extension() == ".glb" ? 1000.0 : 1.0);
  // Floats of 32 mm, or of 0.032 m, are within 2e-6 mm: 1e-6 of the volume's 24 mm^3, and more.
  EXPECT_NEAR(body->volume_mm3, 24.0, 1e-4);
  const double diameter =
      std::sqrt(4.0 * 12.0 / std::numbers::pi);  // of a circle as large as 4 x 3
  EXPECT_NEAR(body->diameter_mm, diameter, 1e-5);
  EXPECT_EQ(body->mesh.triangles.size(), 12U);
  const Box3 bounds = body->mesh.bounds();  // round the centre of mass
  EXPECT_LT(norm(bounds.max - (1.0 / diameter) * Vec3{2, 1.5, 1}), 1e-6);
  EXPECT_LT(norm(bounds.min + (1.0 / diameter) * Vec3{2, 1.5, 1}), 1e-6);
}

TEST(StoneBody, UnitsAreTheFilesOrStated) {
  const ScratchFolder folder;
  const auto volume = [&](const char* name, std::optional<double> mm) {
    const auto body = read_stone_body(folder / name, mm);
    EXPECT_THAT(body, Succeeds());
    return body->volume_mm3;
  };
  put(folder / "a.obj", obj(box()));
  EXPECT_NEAR(volume("a.obj", {}), 24.0, 1e-12);
  EXPECT_NEAR(volume("a.obj", 1000.0), 24e9, 1.0);
  EXPECT_NEAR(volume("a.obj", 25.4), 24.0 * std::pow(25.4, 3), 1e-6);
  // A glTF that somebody wrote in millimetres.
  put(folder / "a.glb", testing_support::glb_file(testing_support::gltf_json(box()),
                                                  testing_support::gltf_buffer(box())));
  EXPECT_NEAR(volume("a.glb", {}), 24e9, 10.0);
  EXPECT_NEAR(volume("a.glb", 1.0), 24.0, 1e-8);
}

TEST(StoneBody, MessagesNameTheFile) {
  const ScratchFolder folder;
  EXPECT_THAT(read_stone_body(folder / "none.stl"), FailsWith(kFileNotFound));
  TriMesh open = box();
  open.triangles.pop_back();
  put(folder / "open.obj", obj(open));
  const auto refused = read_stone_body(folder / "open.obj");
  ASSERT_THAT(refused, FailsWith(kStoneNotClosed));
  EXPECT_THAT(refused.error().message, HasSubstr("open.obj: is not closed: 1 hole"));
  put(folder / "empty.obj", "v 0 0 0\n");
  EXPECT_THAT(read_stone_body(folder / "empty.obj"), FailsWith(kMeshEmpty));
}

// ---- repairs -------------------------------------------------------------------------------

TEST(RepairStone, LeavesWhatIsRight) {
  MeshRepairs repairs;
  const TriMesh m = repaired(cells(), repairs);
  EXPECT_EQ(repairs, MeshRepairs{});
  EXPECT_EQ(to_text(repairs), "none");
  EXPECT_EQ(m.vertices_mm, cells().vertices_mm);
  EXPECT_EQ(m.triangles.size(), cells().triangles.size());
}

TEST(RepairStone, FillsASmallHole) {
  TriMesh m = cells();
  m.triangles.erase(m.triangles.begin() + 100,
                    m.triangles.begin() + 102);  // one cell, in the plane
  MeshRepairs repairs;
  EXPECT_NEAR(volume_mm3(repaired(m, repairs)), 16 * 16 * 8, 1e-9);
  EXPECT_EQ(repairs, (MeshRepairs{.filled_holes = 1}));
  EXPECT_EQ(to_text(repairs), "1 hole filled");
}

TEST(RepairStone, MergesPointsAndDropsWhatIsThereTwice) {
  TriMesh loose;
  for (const auto& t : cells().triangles) {
    for (const std::uint32_t i : t)  // a tenth of what is taken for one point
      loose.vertices_mm.push_back(cells().vertices_mm[i] +
                                  2e-6 * Vec3{random_normal(1, loose.vertices_mm.size()), 0, 0});
    const auto n = static_cast<std::uint32_t>(loose.vertices_mm.size());
    loose.triangles.push_back({n - 3, n - 2, n - 1});
  }
  loose.triangles.push_back(loose.triangles[5]);
  loose.triangles.push_back({loose.triangles[9][0], loose.triangles[9][2], loose.triangles[9][1]});
  loose.triangles.push_back({3, 3, 4});
  MeshRepairs repairs;
  // The shaking moves a wall of 128 mm^2 by 2e-6 mm / sqrt(points) and less.
  EXPECT_NEAR(volume_mm3(repaired(loose, repairs)), 16 * 16 * 8, 1e-3);
  EXPECT_EQ(repairs.merged_points, loose.vertices_mm.size() - cells().vertices_mm.size());
  EXPECT_EQ(repairs.repeated_faces, 2U);
  EXPECT_EQ(repairs.degenerate_faces, 1U);
  EXPECT_EQ(repairs.filled_holes, 0U);
}

TEST(RepairStone, TurnsWhatIsInsideOut) {
  MeshRepairs repairs;
  EXPECT_NEAR(volume_mm3(repaired(inside_out(box()), repairs)), 24.0, 1e-12);
  EXPECT_EQ(repairs, (MeshRepairs{.turned_faces = 12}));
  TriMesh some = cells();
  for (const std::size_t i : {3U, 70U, 71U, 200U})
    std::swap(some.triangles[i][0], some.triangles[i][1]);
  repairs = {};
  EXPECT_NEAR(volume_mm3(repaired(some, repairs)), 16 * 16 * 8, 1e-9);
  EXPECT_GE(repairs.turned_faces, 4U);
}

TEST(RepairStone, RemovesTrianglesWithoutArea) {
  // A vertex in the middle of an edge: one neighbour is split there, the other one is sewn to it by
  // a triangle whose corners lie in one line.
  TriMesh m = box();
  const auto [a, b, c] = m.triangles[0];
  const auto middle = static_cast<std::uint32_t>(m.vertices_mm.size());
  m.vertices_mm.push_back(0.5 * (m.vertices_mm[a] + m.vertices_mm[b]));
  m.triangles[0] = {a, middle, c};
  m.triangles.push_back({middle, b, c});
  m.triangles.push_back({a, b, middle});
  MeshRepairs repairs;
  EXPECT_NEAR(volume_mm3(repaired(m, repairs)), 24.0, 1e-12);
  EXPECT_EQ(repairs.degenerate_faces, 1U);
}

TEST(RepairStone, FillsCavitiesAndDropsDust) {
  MeshRepairs repairs;
  const TriMesh hollow = joined(cells(), inside_out(box_solid({5, 5, -5}, {9, 9, -3})));
  EXPECT_NEAR(volume_mm3(repaired(hollow, repairs)), 16 * 16 * 8, 1e-9);
  EXPECT_EQ(repairs.filled_cavities, 1U);
  EXPECT_EQ(repairs.dropped_pieces, 0U);
  repairs = {};
  const TriMesh dusty =
      joined(joined(cells(), box_solid({20, 0, 0}, {21, 1, 1})), box_solid({-3, 0, 0}, {-2, 1, 1}));
  EXPECT_NEAR(volume_mm3(repaired(dusty, repairs)), 16 * 16 * 8, 1e-9);
  EXPECT_EQ(repairs.dropped_pieces, 2U);
}

class DamagedRock : public ::testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, DamagedRock, ::testing::Range<std::uint64_t>(1, 9));

TEST_P(DamagedRock, ComesBack) {
  const std::uint64_t seed = GetParam();
  const TriMesh rock = testing_support::random_rock(seed, {100, -50, 20}, 8.0, 3);
  TriMesh loose;
  std::size_t lost = 0;
  double lost_mm2 = 0.0;
  for (std::size_t i = 0; i < rock.triangles.size(); ++i) {
    std::array<std::uint32_t, 3> t{};
    for (std::size_t k = 0; k < 3; ++k) {
      t[k] = static_cast<std::uint32_t>(loose.vertices_mm.size());
      const std::uint64_t n = 9 * i + 3 * k;
      loose.vertices_mm.push_back(rock.vertices_mm[rock.triangles[i][k]] +
                                  1e-6 * Vec3{random_normal(seed, n), random_normal(seed, n + 1),
                                              random_normal(seed, n + 2)});
    }
    if (random_uniform(seed + 50, i) < 0.3) std::swap(t[0], t[2]);
    if (i % 400 == 7) {  // far apart: holes of one triangle, filled by that
      ++lost;
      const Vec3 a = loose.vertices_mm[t[0]], b = loose.vertices_mm[t[1]],
                 c = loose.vertices_mm[t[2]];
      lost_mm2 += 0.5 * norm(cross(b - a, c - a));
      continue;
    }
    loose.triangles.push_back(t);
  }
  ASSERT_GT(lost_mm2, 0.1);
  MeshRepairs repairs;
  const TriMesh back = repaired(loose, repairs);
  // 1e-6 mm of noise on a body of 800 mm^2.
  EXPECT_NEAR(volume_mm3(back), volume_mm3(rock), 1e-2);
  EXPECT_EQ(back.triangles.size(), rock.triangles.size());
  EXPECT_EQ(repairs.filled_holes, lost);
  EXPECT_GT(repairs.turned_faces, rock.triangles.size() / 10);
}

// ---- refusals ------------------------------------------------------------------------------

struct Refused {
  const char* name;
  TriMesh mesh;
  ErrorCode code;
  const char* message;
};

std::vector<Refused> refusals() {
  TriMesh open = box(), fin = box(), flat = box_solid({0, 0, 0}, {1, 1, 2e-6});
  open.triangles.erase(open.triangles.begin() + 2, open.triangles.begin() + 4);  // the top
  fin.vertices_mm.push_back({20, 21, 31});
  fin.triangles.push_back({0, 1, 8});
  return {
      {"open", open, kStoneNotClosed, "the widest has 4 edges, is 5 across (at most 0.5385"},
      {"fin", fin, kStoneNotClosed, "not closed"},
      {"cuts", joined(box(), box_solid({12, 21, 31}, {16, 22, 33})), kStoneCutsItself,
       "triangles go through each other, the first at x "},
      {"pieces", joined(box(), box_solid({20, 20, 30}, {22, 22, 32})), kStoneInPieces,
       "is of 2 pieces: beside the largest one of 33.3 % of its volume at x 2"},
      {"flat", flat, kStoneFlat, "which is nothing for a size of 1.414"},
      {"points",
       {.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, .triangles = {{0, 1, 1}, {2, 2, 0}}},
       kMeshEmpty,
       "no triangle has an area"},
  };
}

class RefusedStone : public ::testing::TestWithParam<Refused> {};
INSTANTIATE_TEST_SUITE_P(Kinds, RefusedStone, ::testing::ValuesIn(refusals()),
                         [](const auto& kind) { return std::string(kind.param.name); });

TEST_P(RefusedStone, IsSaidWithItsPlace) {
  MeshRepairs repairs;
  const auto out = repair_stone(GetParam().mesh, repairs);
  ASSERT_THAT(out, FailsWith(GetParam().code));
  EXPECT_THAT(out.error().message, HasSubstr(GetParam().message));
}

TEST(RefusedStone, HasTooManyTriangles) {
  TriMesh large;
  large.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  large.triangles.assign(kMostStoneTriangles + 1, {0, 1, 2});
  MeshRepairs repairs;
  const auto out = repair_stone(large, repairs);
  ASSERT_THAT(out, FailsWith(kStoneTooLarge));
  EXPECT_THAT(out.error().message, HasSubstr("has 1000001 triangles"));
}

// ---- in a plan -----------------------------------------------------------------------------

StoneBodyPtr box_body(const ScratchFolder& folder, const char* name = "box.obj") {
  put(folder / name, obj(box()));
  return std::make_shared<const StoneBody>(read_stone_body(folder / name).value());
}

TEST(OwnStones, GoThroughStonesJsonToTheBit) {
  const ScratchFolder folder;
  const StoneBodyPtr body = box_body(folder);
  std::vector<PlacedStone> stones(3);
  for (int i = 0; i < 3; ++i) {
    stones[static_cast<std::size_t>(i)].number = i + 1;
    stones[static_cast<std::size_t>(i)].scale_mm = 2.0 + i;
  }
  stones[1].body = stones[2].body = body;
  const fs::path plan = folder / "stones.json";
  ASSERT_THAT(write_stone_plan(stones, plan), Succeeds());
  EXPECT_EQ(stone_body_files(stones, plan),
            std::vector<fs::path>{folder / "stone_bodies" / "box.ply"});
  const auto back = read_stone_plan(plan);
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(*back, stones);
  EXPECT_EQ((*back)[1].body, (*back)[2].body) << "one body, not two";
  EXPECT_THAT(read_file(plan).value(),
              AllOf(HasSubstr(body->source_sha256), HasSubstr(R"("source": "box.obj")"),
                    HasSubstr(R"("repairs": "none")"), HasSubstr(R"("mm_per_unit": 1.0)")));
  EXPECT_EQ(stone_mesh((*back)[1]).triangles.size(), 12U);
  // Another body under the same name.
  ASSERT_THAT(write_ply(cells(), folder / "stone_bodies/box.ply"), Succeeds());
  const auto changed = read_stone_plan(plan);
  ASSERT_THAT(changed, FailsWith(kStonePlanFormat));
  EXPECT_THAT(changed.error().message, AllOf(HasSubstr("/bodies/0/sha256"), HasSubstr("box.ply")));
  std::string text = read_file(plan).value();
  text.replace(text.find(R"("name": "box")"), 13, R"("name": "../x")");
  put(plan, text);
  EXPECT_THAT(read_stone_plan(plan), FailsWith(kStonePlanFormat));
}

TEST(OwnStones, LieWhereTheyAreToldAndElsewhereApart) {
  const ScratchFolder folder;
  SitePlanRequest request{.count = 10, .half_width = Metres{100}, .inner_half_width = Metres{25}};
  const auto drawn = plan_stones(request).value();
  request.own = {{.body = box_body(folder),
                  .diameter = Metres{4},
                  .count = 3,
                  .places = {{10.0, -20.0}, {60.0, 60.0}},
                  .heading_rad = 0.5}};
  const auto stones = plan_stones(request);
  ASSERT_THAT(stones, Succeeds());
  ASSERT_EQ(stones->size(), 15U);
  for (std::size_t i = 0; i < 10; ++i) {
    EXPECT_EQ((*stones)[i].shape, drawn[i].shape);
    EXPECT_EQ((*stones)[i].diameter, drawn[i].diameter);
    EXPECT_EQ((*stones)[i].body, nullptr);
  }
  EXPECT_EQ((*stones)[10].east_m, 10.0);
  EXPECT_EQ((*stones)[10].north_m, -20.0);
  EXPECT_EQ((*stones)[11].east_m, 60.0);
  EXPECT_EQ((*stones)[10].heading.value(), 0.5);
  int inside = 0;
  for (std::size_t i = 0; i < 15; ++i) {
    const SiteStone& a = (*stones)[i];
    EXPECT_EQ(a.number, static_cast<int>(i) + 1);
    if (i >= 12) inside += std::fmax(std::abs(a.east_m), std::abs(a.north_m)) < 25.0;
    for (std::size_t j = 0; j < i; ++j) {
      const SiteStone& b = (*stones)[j];
      double reach = 0.0;
      for (const SiteStone* s : {&a, &b}) {
        double r = 0.0;
        for (const Vec3& v : unit_stone(s->shape, s->body).vertices_mm) r = std::fmax(r, norm(v));
        reach += r * s->diameter.value();
      }
      EXPECT_GT(std::hypot(a.east_m - b.east_m, a.north_m - b.north_m), reach);
    }
  }
  EXPECT_EQ(inside, 2);  // half of three, rounded up
}

TEST(OwnStones, SayWhereTheyCannotLie) {
  const ScratchFolder folder;
  SitePlanRequest request{.count = 0, .half_width = Metres{100}};
  request.own = {{.body = box_body(folder), .diameter = Metres{4}, .places = {{99.0, 0.0}}}};
  const auto beyond = plan_stones(request);
  ASSERT_THAT(beyond, FailsWith(kStoneLargerThanSite));
  EXPECT_THAT(beyond.error().message, HasSubstr("stone 1 (box.obj) with a radius of 2.755 m at "
                                                "east 99 m north 0 m reaches beyond"));
  request.own[0].places = {{10.0, 0.0}, {11.0, 0.0}};
  const auto overlap = plan_stones(request);
  ASSERT_THAT(overlap, FailsWith(kStonesDoNotFit));
  EXPECT_THAT(overlap.error().message, HasSubstr("overlap"));
}

TEST(OwnStones, StandOnTheGroundAndInTheCatalogue) {
  const ScratchFolder folder;
  heightmap::ModelField flat{.z_mm = Grid<float>(81, 81, 2.0F), .spacing = Millimetres{0.5}};
  SiteStone stone{.number = 1,
                  .shape = {},
                  .body = box_body(folder),
                  .diameter = Metres{4},
                  .east_m = 20,
                  .north_m = 20};
  SiteStone other = stone;
  other.body = box_body(folder, "other.obj");
  other.number = 2;
  other.east_m = 30;
  const auto laid = lay_stones(std::vector{stone, other}, flat, ModelScale(1000), 0, 0, 0.25);
  ASSERT_EQ(laid.size(), 2U);
  const Box3 bounds = stone_mesh(laid[0]).bounds();
  const double height = 2.0 * 4.0 / std::sqrt(48.0 / std::numbers::pi);  // 4 x 3 x 2 of diameter 4
  EXPECT_NEAR(bounds.max.z - bounds.min.z, height, 1e-12);
  EXPECT_NEAR(bounds.min.z, 2.0 - 0.25 * height, 1e-12);
  const auto parts = stone_catalogue(laid);
  ASSERT_EQ(parts.size(), 2U);
  EXPECT_EQ(parts[0].body->name, "box");
  EXPECT_EQ(parts[1].body->name, "other");
}

TEST(OwnStones, ThatFoldHaveNoClearance) {
  // A box with a block on one corner: from its middle the block's inner walls do not show.
  const TriMesh hook = [] {
    TriMesh m =
        terrain_solid(9, 1.0, -2.0, [](double x, double y) { return x > 5 && y > 5 ? 6.0 : 0.0; });
    for (Vec3& v : m.vertices_mm) v = v - Vec3{2, 2, -1};
    return m;
  }();
  EXPECT_THAT(shrink_stone(hook, Millimetres{0.1}), FailsWith(kStoneFolds));
  EXPECT_TRUE(shrink_stone(hook, Millimetres{0.0}).has_value());
  EXPECT_TRUE(std::isnan(thinner_than_wall_mm(hook, Millimetres{1.0})));
  EXPECT_TRUE(shrink_stone(box_solid({-2, -2, -1}, {2, 2, 1}), Millimetres{0.1}).has_value());
}

}  // namespace
}  // namespace maquette::meshing
