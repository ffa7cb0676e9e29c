// SPDX-License-Identifier: GPL-3.0-or-later

// export/step.hpp, read back by OpenCASCADE and looked at apart from the writer:
//   one valid closed solid .............. BRepCheck; every edge has two faces
//   unit is the millimetre, frame kept .. bounding box of the shape; the file's text
//   its top is the heightmap ............ lines straight down through the solid at places between
//                                         and at nodes, against height_at; one patch and many
//   its volume is the solid's ........... plane: exact; terrain: the grid mesher's solid
//   patches meet smoothly ............... normals on both sides of a border
//   AP214 and AP242 ..................... the file's FILE_SCHEMA
//   same bytes .......................... twice
//   report says what is so .............. counts against what is read
//   each error code ..................... nodes, tolerance, base, voids, too many, folder, stopped

#include "export/step.hpp"

#include <BRepBndLib.hxx>
#include <BRepCheck_Analyzer.hxx>
#include <BRepClass3d_SolidClassifier.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <GeomLProp_SLProps.hxx>
#include <Geom_BSplineSurface.hxx>
#include <IntCurvesFace_ShapeIntersector.hxx>
#include <Precision.hxx>
#include <STEPControl_Reader.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedDataMapOfShapeListOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Shape.hxx>
#include <TopoDS_Solid.hxx>
#include <gp_Lin.hxx>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/solid.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::exporting {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::random_terrain;
using testing_support::ScratchFolder;

TopoDS_Shape read_step(const std::filesystem::path& path) {
  STEPControl_Reader reader;
  EXPECT_EQ(reader.ReadFile(path.c_str()), IFSelect_RetDone);
  EXPECT_EQ(reader.TransferRoots(), 1);
  return reader.OneShape();
}

/// Smooth hills, x0 and y0 not null.
ModelField hills(std::ptrdiff_t rows, std::ptrdiff_t cols) {
  ModelField f{Grid<float>(rows, cols), Millimetres{0.5}, Millimetres{12.0}, Millimetres{-30.0}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) = static_cast<float>(
          4.0 * std::sin(0.13 * f.x_mm(c)) * std::cos(0.17 * f.y_mm(r)) + 0.05 * f.x_mm(c));
  return f;
}

void expect_closed_solid(const TopoDS_Shape& shape, std::uint64_t faces) {
  EXPECT_TRUE(BRepCheck_Analyzer(shape).IsValid());
  std::uint64_t solids = 0, seen = 0;
  for (TopExp_Explorer e(shape, TopAbs_SOLID); e.More(); e.Next()) ++solids;
  for (TopExp_Explorer e(shape, TopAbs_FACE); e.More(); e.Next()) ++seen;
  EXPECT_EQ(solids, 1U);
  EXPECT_EQ(seen, faces);
  TopTools_IndexedDataMapOfShapeListOfShape faces_of;
  TopExp::MapShapesAndAncestors(shape, TopAbs_EDGE, TopAbs_FACE, faces_of);
  for (int i = 1; i <= faces_of.Extent(); ++i) EXPECT_EQ(faces_of(i).Extent(), 2);
}

/// Heights of the solid's top by lines straight down, nothing of the patches' parameters.
double top_at(IntCurvesFace_ShapeIntersector& solid, double x, double y) {
  solid.PerformNearest(gp_Lin(gp_Pnt(x, y, 500.0), gp_Dir(0, 0, -1)), 0.0, 1000.0);
  return solid.NbPnt() > 0 ? solid.Pnt(1).Z() : NAN;
}

TEST(WriteStep, IsTheHeightmap) {
  const ScratchFolder folder;
  const ModelField f = hills(90, 121);
  StepOptions options;
  options.tolerance = Millimetres{0.01};
  const StepReport report = write_step(f, options, folder / "a.step").value();
  const TopoDS_Shape shape = read_step(folder / "a.step");
  EXPECT_EQ(report.patches, 1U);
  expect_closed_solid(shape, 6);
  EXPECT_TRUE(report.valid);
  EXPECT_EQ(report.faces, 6U);
  EXPECT_EQ(report.nodes_compared, 90U * 121U);
  EXPECT_LT(report.poles, 90U * 121U / 4) << "smooth ground takes few poles";
  Bnd_Box box;
  BRepBndLib::AddOptimal(shape, box, Standard_False, Standard_False);
  double x0 = 0, y0 = 0, z0 = 0, x1 = 0, y1 = 0, z1 = 0;
  box.Get(x0, y0, z0, x1, y1, z1);
  EXPECT_NEAR(x0, 12.0, 1e-4);
  EXPECT_NEAR(x1, 72.0, 1e-4);
  EXPECT_NEAR(y0, -30.0, 1e-4);
  EXPECT_NEAR(y1, 14.5, 1e-4);
  EXPECT_NEAR(z0, -10.0, 1e-4);

  IntCurvesFace_ShapeIntersector solid;
  solid.Load(shape, 1e-7);
  double most = 0.0;
  for (std::ptrdiff_t r = 1; r < 89; r += 7)
    for (std::ptrdiff_t c = 1; c < 120; c += 7)
      most = std::fmax(
          most, std::abs(top_at(solid, f.x_mm(c), f.y_mm(r)) - static_cast<double>(f.z_mm(r, c))));
  EXPECT_LE(most, 0.01);
  EXPECT_LE(most, report.max_error_mm + 1e-6);
  EXPECT_LE(report.max_error_mm, 0.01);
  EXPECT_LE(report.rms_error_mm, report.max_error_mm);
  // Between nodes the function itself is the better truth: the facets are chords of it.
  for (double x = 12.3; x < 72; x += 5.1)
    for (double y = -29.7; y < 14; y += 4.3)
      EXPECT_NEAR(top_at(solid, x, y), 4.0 * std::sin(0.13 * x) * std::cos(0.17 * y) + 0.05 * x,
                  0.01);
}

TEST(WriteStep, SewsManyPatches) {
  const ScratchFolder folder;
  const ModelField f = random_terrain(5, 160, 121, 0.5, 0.3, 0.05);
  StepOptions options;
  options.tolerance = Millimetres{0.001};  // noise: a pole a node
  const StepReport report = write_step(f, options, folder / "a.step").value();
  EXPECT_EQ(report.patches, 4U * 3U);
  EXPECT_LE(report.max_error_mm, 1e-6) << "interpolated";
  EXPECT_LT(report.sewing_tolerance_mm, 1e-4);
  const TopoDS_Shape shape = read_step(folder / "a.step");
  expect_closed_solid(shape, 12 + 2 * (4 + 3) + 1);

  // The volume under a bicubic that meets all nodes against that under the facets: both integrate
  // the same nodes, they differ by the second derivatives' part, here noise with both signs.
  const auto grid = meshing::GridSolidStream::create(f, {.base_z = Millimetres{-10.0}}).value();
  const double known = grid.certify(meshing::CoordinateRounding::none).value().volume_mm3;
  EXPECT_NEAR(report.volume_mm3, known, 1e-4 * known);

  // C2 across borders: normals of neighbouring patches agree where they meet.
  std::vector<Handle(Geom_BSplineSurface)> patches;
  for (TopExp_Explorer e(shape, TopAbs_FACE); e.More(); e.Next()) {
    const auto s =
        Handle(Geom_BSplineSurface)::DownCast(BRep_Tool::Surface(TopoDS::Face(e.Current())));
    if (!s.IsNull()) patches.push_back(s);
  }
  int met = 0;
  for (const auto& a : patches)
    for (const auto& b : patches) {
      double ax0, ax1, ay0, ay1, bx0, bx1, by0, by1;
      a->Bounds(ax0, ax1, ay0, ay1);
      b->Bounds(bx0, bx1, by0, by1);
      if (std::abs(ax1 - bx0) > 1e-9 || std::abs(ay0 - by0) > 1e-9) continue;
      for (const double t : {0.0, 0.31, 0.77, 1.0}) {
        const double y = ay0 + t * (ay1 - ay0);
        const GeomLProp_SLProps pa(a, ax1, y, 1, 1e-9), pb(b, bx0, y, 1, 1e-9);
        EXPECT_LT(pa.Value().Distance(pb.Value()), 1e-9);
        EXPECT_LT(GeomLProp_SLProps(a, ax1, y, 1, 1e-9)
                      .Normal()
                      .Angle(GeomLProp_SLProps(b, bx0, y, 1, 1e-9).Normal()),
                  1e-8);
        ++met;
      }
    }
  EXPECT_EQ(met, 4 * 4 * 2);
}

TEST(WriteStep, OfAPlaneHasItsVolume) {
  const ScratchFolder folder;
  ModelField f = hills(41, 61);
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c)
      f.z_mm(r, c) =
          static_cast<float>(0.25 * static_cast<double>(c) - 0.125 * static_cast<double>(r));
  const StepReport report =
      write_step(f, {.base_z = Millimetres{-16.0}}, folder / "a.step").value();
  const double known = 30.0 * 20.0 * (16.0 + 0.25 * 30 - 0.125 * 20);
  EXPECT_NEAR(report.volume_mm3, known, 1e-9 * known);
  EXPECT_LT(report.max_error_mm, 1e-9);
}

TEST(WriteStep, NamesSchemaUnitAndNoClock) {
  const ScratchFolder folder;
  const ModelField f = hills(30, 30);
  StepOptions options;
  options.name = "crater north";
  for (const char* name : {"a.step", "b.step"})
    ASSERT_TRUE(write_step(f, options, folder / name).has_value());
  const std::string a = read_file(folder / "a.step").value();
  EXPECT_TRUE(a == read_file(folder / "b.step").value());
  EXPECT_NE(a.find("AP242"), std::string::npos);
  EXPECT_NE(a.find("SI_UNIT(.MILLI.,.METRE.)"), std::string::npos);
  EXPECT_NE(a.find("PRODUCT('crater north','crater north'"), std::string::npos);
  EXPECT_NE(a.find("B_SPLINE_SURFACE"), std::string::npos);
  options.schema = StepSchema::ap214;
  ASSERT_TRUE(write_step(f, options, folder / "c.step").has_value());
  EXPECT_NE(read_file(folder / "c.step").value().find("AUTOMOTIVE_DESIGN"), std::string::npos);
}

TEST(WriteStep, SaysWhyItCannot) {
  const ScratchFolder folder;
  const auto path = folder / "a.step";
  const ModelField f = hills(60, 60);
  EXPECT_THAT(write_step(hills(3, 60), {}, path), FailsWith(kEmptyMesh));
  for (const double bad : {0.0, -1.0, static_cast<double>(NAN)})
    EXPECT_THAT(write_step(f, {.tolerance = Millimetres{bad}}, path), FailsWith(kOptionOutOfRange));
  EXPECT_THAT(write_step(f, {.base_z = Millimetres{0.0}}, path), FailsWith(kOptionOutOfRange));
  ModelField hole = f;
  hole.z_mm(7, 8) = NAN;
  EXPECT_THAT(write_step(hole, {}, path), FailsWith(meshing::kSurfaceHasVoids));
  const auto many =
      write_step(random_terrain(1, 60, 60, 0.5, 0.1, 0.1), {.most_poles = 1000}, path);
  ASSERT_THAT(many, FailsWith(kTooManyPatchPoles));
  EXPECT_THAT(many.error().message, testing::AllOf(HasSubstr("3600"), HasSubstr("tolerance")));
  EXPECT_THAT(write_step(f, {}, folder / "no/a.step"), FailsWith(kFileNotWritable));
  std::stop_source stop;
  RunContext run;
  run.stop = stop.get_token();
  for (const double when : {0.0, 0.55, 0.75}) {
    run.progress = [&](double share) {
      if (share >= when) stop.request_stop();
    };
    EXPECT_THAT(write_step(f, {}, path, run), FailsWith(kCancelled));
    stop = std::stop_source();
    run.stop = stop.get_token();
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace maquette::exporting
