// SPDX-License-Identifier: GPL-3.0-or-later

// export/cad.hpp, write_3mf; export/zip_times.hpp:
//   another reader finds the parts ... lib3mf's reader, strict: unit, names, numbers,
//                                      vertices to 1e-6, triangles, manifold
//   rounding far from the origin ..... every number of the archive's text against what
//                                      meshing::rounded says, at 10 um, 2 m and 50 m
//   one mesh built several times ..... read back, and the archive's text as GDAL unpacks it: each
//                                      mesh once, a transform an item
//   same bytes ....................... no clock, no random UUID: two files, and the
//                                      time fields of every archive entry
//   each error code .................. too many (a mesh named many times), none, a
//                                      mesh that lib3mf refuses, folder, stopped

#include <cmath>
#include <cstdlib>
#include <tuple>

#include <Model/COM/NMR_DLLInterfaces.h>
#include <cpl_vsi.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/mesh_stream.hpp"
#include "core/random.hpp"
#include "export/cad.hpp"
#include "export/limits.hpp"
#include "export/zip_times.hpp"
#include "meshing/grid_stream.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::exporting {
namespace {

using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::Hills;
using testing_support::ScratchFolder;
using testing_support::sphere_solid;
using testing_support::Succeeds;
using testing_support::terrain_solid;
using testing_support::volume_mm3;

struct ReadPart {
  TriMesh mesh;
  std::string part_number;
  bool manifold = false;
};
struct ReadModel {
  DWORD unit = 99, warnings = 99;
  std::vector<ReadPart> parts;
};

ReadModel read_3mf(const std::filesystem::path& path) {
  ReadModel result;
  NMR::PLib3MFModel* model = nullptr;
  NMR::PLib3MFModelReader* reader = nullptr;
  EXPECT_EQ(NMR::lib3mf_createmodel(&model), 0);
  EXPECT_EQ(NMR::lib3mf_model_queryreader(model, "3mf", &reader), 0);
  EXPECT_EQ(NMR::lib3mf_reader_setstrictmodeactive(reader, 1), 0);
  EXPECT_EQ(NMR::lib3mf_reader_readfromfileutf8(reader, path.c_str()), 0);
  NMR::lib3mf_reader_getwarningcount(reader, &result.warnings);
  NMR::lib3mf_model_getunit(model, &result.unit);
  NMR::PLib3MFModelBuildItemIterator* items = nullptr;
  NMR::lib3mf_model_getbuilditems(model, &items);
  for (;;) {
    BOOL more = 0;
    NMR::lib3mf_builditemiterator_movenext(items, &more);
    if (more == 0) break;
    NMR::PLib3MFModelBuildItem* item = nullptr;
    NMR::PLib3MFModelObjectResource* object = nullptr;
    NMR::lib3mf_builditemiterator_getcurrent(items, &item);
    NMR::lib3mf_builditem_getobjectresource(item, &object);
    ReadPart part;
    std::array<char, 256> text{};
    ULONG needed = 0;
    NMR::lib3mf_builditem_getpartnumberutf8(item, text.data(), text.size(), &needed);
    part.part_number = text.data();
    DWORD count = 0;
    NMR::lib3mf_meshobject_getvertexcount(object, &count);
    for (DWORD i = 0; i < count; ++i) {
      NMR::MODELMESHVERTEX v{};
      NMR::lib3mf_meshobject_getvertex(object, i, &v);
      part.mesh.vertices_mm.push_back({static_cast<double>(v.m_fPosition[0]),
                                       static_cast<double>(v.m_fPosition[1]),
                                       static_cast<double>(v.m_fPosition[2])});
    }
    NMR::lib3mf_meshobject_gettrianglecount(object, &count);
    for (DWORD i = 0; i < count; ++i) {
      NMR::MODELMESHTRIANGLE t{};
      NMR::lib3mf_meshobject_gettriangle(object, i, &t);
      part.mesh.triangles.push_back({t.m_nIndices[0], t.m_nIndices[1], t.m_nIndices[2]});
    }
    BOOL manifold = 0;
    NMR::lib3mf_meshobject_ismanifoldandoriented(object, &manifold);
    part.manifold = manifold != 0;
    result.parts.push_back(std::move(part));
    NMR::lib3mf_release(object);
    NMR::lib3mf_release(item);
  }
  NMR::lib3mf_release(items);
  NMR::lib3mf_release(reader);
  NMR::lib3mf_release(model);
  return result;
}

TEST(Write3mf, IsReadBackPartByPart) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(60, 0.5, -8, Hills(3, 30, 2));
  const TriMesh stone = sphere_solid({10, 12, 5}, 1.25, 12);
  ASSERT_THAT(write_3mf({{"surface", "M-001", &ground}, {"stone 7 <&>", "S-007", &stone}},
                        folder / "a.3mf"),
              Succeeds());
  const ReadModel model = read_3mf(folder / "a.3mf");
  EXPECT_EQ(model.unit, static_cast<DWORD>(NMR::MODELUNIT_MILLIMETER));
  EXPECT_EQ(model.warnings, 0U);
  ASSERT_EQ(model.parts.size(), 2U);
  EXPECT_EQ(model.parts[0].part_number, "M-001");
  EXPECT_EQ(model.parts[1].part_number, "S-007");
  const std::array<const TriMesh*, 2> written{&ground, &stone};
  for (std::size_t k = 0; k < 2; ++k) {
    const TriMesh& back = model.parts[k].mesh;
    EXPECT_TRUE(model.parts[k].manifold);
    EXPECT_EQ(back.triangles, written[k]->triangles);
    ASSERT_EQ(back.vertices_mm.size(), written[k]->vertices_mm.size());
    for (std::size_t i = 0; i < back.vertices_mm.size(); ++i)
      // float at 30 mm: 1e-6 on each axis; six decimals: half of that again
      ASSERT_LT(norm(back.vertices_mm[i] - written[k]->vertices_mm[i]), 3e-6);
    EXPECT_NEAR(volume_mm3(back) / volume_mm3(*written[k]), 1.0, 1e-6);
  }
}

/// The model part of the archive, as GDAL unpacks it.
std::string model_text(const std::filesystem::path& path) {
  VSILFILE* in = VSIFOpenL(("/vsizip/{" + path.string() + "}/3D/3dmodel.model").c_str(), "rb");
  if (in == nullptr) return {};
  std::string text(1 << 22, '\0');
  text.resize(VSIFReadL(text.data(), 1, text.size(), in));
  VSIFCloseL(in);
  return text;
}

TEST(Write3mf, RoundsAsIsSaid) {
  const ScratchFolder folder;
  using meshing::CoordinateRounding;
  for (const double size_mm : {0.01, 8.0, 2000.0, 50000.0}) {
    SCOPED_TRACE(size_mm);
    TriMesh mesh;
    for (std::uint32_t i = 0; i < 3000; ++i) {
      const auto draw = [&](std::uint64_t k) {
        return size_mm * (2.0 * random_uniform(9, 3 * i + k) - 1.0);
      };
      mesh.vertices_mm.push_back({draw(0), draw(1), draw(2)});
    }
    for (std::uint32_t i = 0; i < 3000; i += 3) mesh.triangles.push_back({i, i + 1, i + 2});
    ASSERT_THAT(write_3mf({{"a", "1", &mesh}}, folder / "a.3mf"), Succeeds());
    const std::string text = model_text(folder / "a.3mf");
    double moved = 0.0;
    std::size_t at = 0;
    for (const Vec3& v : mesh.vertices_mm) {
      at = text.find("<vertex ", at);
      ASSERT_NE(at, std::string::npos);
      Vec3 p;
      for (const auto& [name, value, written] :
           {std::tuple("x=\"", &p.x, v.x), std::tuple("y=\"", &p.y, v.y),
            std::tuple("z=\"", &p.z, v.z)}) {
        at = text.find(name, at) + 3;
        *value = std::strtod(text.c_str() + at, nullptr);
        ASSERT_EQ(*value, meshing::rounded(written, CoordinateRounding::lib3mf)) << written;
      }
      moved = std::fmax(moved, norm(p - v));
    }
    EXPECT_EQ(meshing::rounding_displacement_mm(TriMeshStream(mesh), CoordinateRounding::lib3mf),
              moved);
    // Half a step of float32 twice (below 1 ulp of the coordinate, three axes) and the cut.
    EXPECT_LT(moved, std::sqrt(3.0) * (std::ldexp(size_mm, -23) + 1e-6));
    if (size_mm >= 2000.0) {
      EXPECT_GT(moved, std::ldexp(size_mm, -25));  // 6e-5 at 2 m, not 1e-6
    }
  }
}

TEST(Write3mf, HasNeitherClockNorChanceInIt) {
  const ScratchFolder folder;
  const TriMesh stone = sphere_solid({10, 12, 5}, 1.25, 12);
  for (const char* name : {"a.3mf", "b.3mf"})
    ASSERT_THAT(write_3mf({{"stone", "S", &stone}}, folder / name), Succeeds());
  const std::string a = read_file(folder / "a.3mf").value();
  EXPECT_EQ(a, read_file(folder / "b.3mf").value());
  // Two files written within two seconds could agree by luck: look at the times.
  const std::string time("\0\0\x21\0", 4);
  int entries = 0;
  for (std::size_t at = 0; (at = a.find(std::string("PK\1\2", 4), at)) != std::string::npos;
       ++at, ++entries)
    EXPECT_EQ(a.substr(at + 12, 4), time);
  EXPECT_EQ(entries, 3);
  EXPECT_EQ(a.substr(0, 4), std::string("PK\3\4", 4));
  EXPECT_EQ(a.substr(10, 4), time);
}

TEST(Write3mf, BuildsOneMeshSeveralTimes) {
  const ScratchFolder folder;
  const TriMesh ball = sphere_solid({0, 0, 2}, 2, 6), box = box_solid({0, 0, 0}, {1, 2, 3});
  const std::vector<BuildItem> items{
      {0, {2.5, 3.25, 0}, "A/1"}, {1, {}, "B/2"}, {0, {12.5, 3.25, 7.125}, "A/3"}};
  const auto path = folder / "a.3mf";
  ASSERT_THAT(write_3mf({{"ball", "A", &ball}, {"box", "B", &box}}, items, path), Succeeds());
  const ReadModel model = read_3mf(path);
  EXPECT_EQ(model.warnings, 0U);
  ASSERT_EQ(model.parts.size(), 3U);
  EXPECT_EQ(model.parts[0].part_number, "A/1");
  EXPECT_EQ(model.parts[2].part_number, "A/3");
  EXPECT_EQ(model.parts[2].mesh.triangles.size(), ball.triangles.size());
  EXPECT_EQ(model.parts[1].mesh.triangles.size(), box.triangles.size());

  const std::string text = model_text(path);
  std::vector<std::string> transforms;
  for (std::size_t at = 0; (at = text.find("transform=\"", at)) != std::string::npos; ++at)
    transforms.push_back(text.substr(at + 11, text.find('"', at + 11) - at - 11));
  // The core specification's order: three rows of the rotation, then the shift.
  EXPECT_EQ(transforms, (std::vector<std::string>{"1 0 0 0 1 0 0 0 1 2.5 3.25 0",
                                                  "1 0 0 0 1 0 0 0 1 12.5 3.25 7.125"}));
  std::size_t objects = 0;
  for (std::size_t at = 0; (at = text.find("<object ", at)) != std::string::npos; ++at) ++objects;
  EXPECT_EQ(objects, 2U);
}

TEST(SetZipTimes, RefusesWhatIsNoArchive) {
  const ScratchFolder folder;
  ASSERT_TRUE(write_file(folder / "a.zip", std::string(500, 'x')));
  EXPECT_THAT(set_zip_times(folder / "a.zip"), FailsWith(kLibraryFailed));
  ASSERT_TRUE(write_file(folder / "b.zip", "short"));
  EXPECT_THAT(set_zip_times(folder / "b.zip"), FailsWith(kLibraryFailed));
  EXPECT_THAT(set_zip_times(folder / "none.zip"), FailsWith(kLibraryFailed));
}

TEST(Write3mf, SaysWhyItCannot) {
  const ScratchFolder folder;
  const TriMesh box = box_solid({0, 0, 0}, {1, 1, 1}), nothing;
  const auto path = folder / "a.3mf";
  EXPECT_THAT(write_3mf({}, path), FailsWith(kEmptyMesh));
  EXPECT_THAT(write_3mf({{"a", "1", nullptr}}, path), FailsWith(kEmptyMesh));
  EXPECT_THAT(write_3mf({{"a", "1", &box}, {"b", "2", &nothing}}, path), FailsWith(kEmptyMesh));
  EXPECT_THAT(write_3mf({{"a", "1", &box}}, folder / "no/a.3mf"), FailsWith(kFileNotWritable));

  TriMesh folded = box;
  folded.triangles[0] = {0, 0, 1};
  const auto refused = write_3mf({{"a", "1", &folded}}, path);
  ASSERT_THAT(refused, FailsWith(kLibraryFailed));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("a.3mf"));
  const TriMesh huge = box_solid({0, 0, 0}, {1, 1, 1e10});
  EXPECT_THAT(write_3mf({{"a", "1", &huge}}, path), FailsWith(kLibraryFailed));

  const TriMesh fine = terrain_solid(501, 1, -5, [](double, double) { return 0.0; });
  const std::vector<NamedMesh> many(k3mfTriangleLimit / fine.triangles.size() + 1,
                                    {"a", "1", &fine});
  EXPECT_THAT(write_3mf(many, path), FailsWith(kTooManyTriangles));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Write3mf, StopsBeforeAndWhileItWrites) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(301, 1, -5, [](double, double) { return 0.0; });
  for (const double when : {-1.0, 0.25}) {
    std::stop_source stop;
    RunContext run;
    run.stop = stop.get_token();
    double last = 0.0;
    run.progress = [&](double share) {
      last = share;
      if (share > when) stop.request_stop();
    };
    if (when < 0) stop.request_stop();
    EXPECT_THAT(write_3mf({{"a", "1", &ground}}, folder / "a.3mf", run), FailsWith(kCancelled));
    EXPECT_LT(last, 1.0);
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace maquette::exporting
