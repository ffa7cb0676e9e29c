// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/step.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <APIHeaderSection_MakeHeader.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeSolid.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepCheck_Analyzer.hxx>
#include <BRepGProp.hxx>
#include <BRepLib.hxx>
#include <BRep_Tool.hxx>
#include <GProp_GProps.hxx>
#include <Geom_BSplineSurface.hxx>
#include <Interface_Static.hxx>
#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <Precision.hxx>
#include <STEPControl_Controller.hxx>
#include <STEPControl_Reader.hxx>
#include <STEPControl_Writer.hxx>
#include <ShapeAnalysis_ShapeTolerance.hxx>
#include <Standard_Failure.hxx>
#include <StepBasic_Product.hxx>
#include <StepData_StepModel.hxx>
#include <TColStd_Array1OfInteger.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array2OfPnt.hxx>
#include <TCollection_HAsciiString.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Edge.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Shell.hxx>
#include <TopoDS_Solid.hxx>
#include <TopoDS_Wire.hxx>
#include <gp_Pln.hxx>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "meshing/height_spline.hpp"
#include "meshing/solid.hpp"

namespace maquette::exporting {
namespace {

using heightmap::ModelField;
using meshing::HeightSpline;

/// Borders of patches are computed from both sides; they differ by rounding.
constexpr double kSewing_mm = 1e-5;
/// A patch has so many intervals of knots along a side: small enough for viewers, few enough faces.
constexpr std::size_t kPatchIntervals = 48;

/// What OpenCASCADE has at its peak, measured; see docs/step.md.
constexpr double kBytesPerPole = 750.0;

/// OpenCASCADE's parameters are global.
std::mutex& library() {
  static std::mutex one;
  return one;
}

// ---- the solid -----------------------------------------------------------------

/// One patch: knots first .. last of both directions.
struct Range {
  std::size_t first = 0, last = 0;
};

std::vector<Range> ranges_of(std::size_t knots) {
  std::vector<Range> all;
  const std::size_t intervals = knots - 1;
  const std::size_t count = (intervals + kPatchIntervals - 1) / kPatchIntervals;
  for (std::size_t i = 0; i < count; ++i)
    all.push_back({i * intervals / count, (i + 1) * intervals / count});
  return all;
}

/// Knots, their multiplicities and the poles that a range of intervals needs: with three knots more
/// on each side where the function goes on.
struct Direction {
  std::vector<double> knots;
  std::vector<int> multiplicities;
  std::size_t first_pole = 0, poles = 0;
};

Direction direction_of(const std::vector<double>& knots, Range range) {
  Direction d;
  // The first pole that is not null in the range's first interval has that interval's number.
  d.first_pole = range.first;
  d.poles = range.last - range.first + 3;
  // Knots repeat four times at the border of the whole; in between as often as are needed.
  std::vector<double> flat;
  for (int i = 0; i < 3; ++i) flat.push_back(knots.front());
  flat.insert(flat.end(), knots.begin(), knots.end());
  for (int i = 0; i < 3; ++i) flat.push_back(knots.back());
  for (std::size_t i = d.first_pole; i < d.first_pole + d.poles + 4; ++i) {
    if (d.knots.empty() || flat[i] != d.knots.back()) {
      d.knots.push_back(flat[i]);
      d.multiplicities.push_back(0);
    }
    ++d.multiplicities.back();
  }
  return d;
}

class SolidMaker {
 public:
  SolidMaker(const HeightSpline& spline, double base_z)
      : spline_(spline),
        base_z_(base_z),
        places_x_(meshing::greville_places(spline.knots_x_mm)),
        places_y_(meshing::greville_places(spline.knots_y_mm)),
        columns_(ranges_of(spline.knots_x_mm.size())),
        rows_(ranges_of(spline.knots_y_mm.size())),
        sewing_(kSewing_mm) {}

  [[nodiscard]] std::uint64_t patches() const { return columns_.size() * rows_.size(); }

  TopoDS_Solid make(const RunContext& run) {
    for (std::size_t j = 0; j < rows_.size(); ++j) {
      for (std::size_t i = 0; i < columns_.size(); ++i) add_patch(i, j);
      run.progress(0.1 + 0.2 * static_cast<double>(j + 1) / static_cast<double>(rows_.size()));
    }
    add_base();
    sewing_.Perform();
    const TopoDS_Shape sewn = sewing_.SewedShape();
    TopExp_Explorer shells(sewn, TopAbs_SHELL);
    if (!shells.More()) throw Standard_Failure("the patches do not form a shell");
    TopoDS_Solid solid = BRepBuilderAPI_MakeSolid(TopoDS::Shell(shells.Current())).Solid();
    shells.Next();
    if (shells.More() || sewing_.NbFreeEdges() > 0)
      throw Standard_Failure("the patches do not close");
    BRepLib::OrientClosedSolid(solid);
    return solid;
  }

 private:
  Handle(Geom_BSplineSurface) patch(Range column, Range row) const {
    const Direction u = direction_of(spline_.knots_x_mm, column);
    const Direction v = direction_of(spline_.knots_y_mm, row);
    const auto reals = [](const std::vector<double>& x) {
      TColStd_Array1OfReal a(1, static_cast<int>(x.size()));
      for (std::size_t i = 0; i < x.size(); ++i) a.SetValue(static_cast<int>(i) + 1, x[i]);
      return a;
    };
    const auto integers = [](const std::vector<int>& x) {
      TColStd_Array1OfInteger a(1, static_cast<int>(x.size()));
      for (std::size_t i = 0; i < x.size(); ++i) a.SetValue(static_cast<int>(i) + 1, x[i]);
      return a;
    };
    TColgp_Array2OfPnt poles(1, static_cast<int>(u.poles), 1, static_cast<int>(v.poles));
    for (std::size_t i = 0; i < u.poles; ++i)
      for (std::size_t j = 0; j < v.poles; ++j)
        poles.SetValue(static_cast<int>(i) + 1, static_cast<int>(j) + 1,
                       gp_Pnt(places_x_[u.first_pole + i], places_y_[v.first_pole + j],
                              spline_.poles_mm(static_cast<std::ptrdiff_t>(v.first_pole + j),
                                               static_cast<std::ptrdiff_t>(u.first_pole + i))));
    Handle(Geom_BSplineSurface) surface =
        new Geom_BSplineSurface(poles, reals(u.knots), reals(v.knots), integers(u.multiplicities),
                                integers(v.multiplicities), 3, 3);
    // Where the function goes on the knots are simple: inserted until the range stands alone.
    surface->Segment(spline_.knots_x_mm[column.first], spline_.knots_x_mm[column.last],
                     spline_.knots_y_mm[row.first], spline_.knots_y_mm[row.last]);
    return surface;
  }

  void add_patch(std::size_t i, std::size_t j) {
    const Handle(Geom_BSplineSurface) top = patch(columns_[i], rows_[j]);
    sewing_.Add(BRepBuilderAPI_MakeFace(top, Precision::Confusion()).Face());
    const double x0 = spline_.knots_x_mm[columns_[i].first];
    const double x1 = spline_.knots_x_mm[columns_[i].last];
    const double y0 = spline_.knots_y_mm[rows_[j].first];
    const double y1 = spline_.knots_y_mm[rows_[j].last];
    if (j == 0) add_wall(top->VIso(y0), {0, -1, 0});
    if (j + 1 == rows_.size()) add_wall(top->VIso(y1), {0, 1, 0});
    if (i == 0) add_wall(top->UIso(x0), {-1, 0, 0});
    if (i + 1 == columns_.size()) add_wall(top->UIso(x1), {1, 0, 0});
  }

  /// Plane under a patch's border, down to the base.
  void add_wall(const Handle(Geom_Curve) & rim, const gp_Dir& outward) {
    const gp_Pnt a = rim->Value(rim->FirstParameter()), b = rim->Value(rim->LastParameter());
    const gp_Pnt below_a(a.X(), a.Y(), base_z_), below_b(b.X(), b.Y(), base_z_);
    const TopoDS_Edge top = BRepBuilderAPI_MakeEdge(rim).Edge();
    BRepBuilderAPI_MakeWire wire(top);
    wire.Add(BRepBuilderAPI_MakeEdge(b, below_b).Edge());
    wire.Add(BRepBuilderAPI_MakeEdge(below_b, below_a).Edge());
    wire.Add(BRepBuilderAPI_MakeEdge(below_a, a).Edge());
    sewing_.Add(BRepBuilderAPI_MakeFace(gp_Pln(a, outward), wire.Wire(), Standard_True).Face());
  }

  /// With a corner wherever a wall has one.
  void add_base() {
    std::vector<gp_Pnt> ring;
    const auto& kx = spline_.knots_x_mm;
    const auto& ky = spline_.knots_y_mm;
    for (const Range& r : columns_) ring.emplace_back(kx[r.first], ky.front(), base_z_);
    for (const Range& r : rows_) ring.emplace_back(kx.back(), ky[r.first], base_z_);
    for (auto r = columns_.rbegin(); r != columns_.rend(); ++r)
      ring.emplace_back(kx[r->last], ky.back(), base_z_);
    for (auto r = rows_.rbegin(); r != rows_.rend(); ++r)
      ring.emplace_back(kx.front(), ky[r->last], base_z_);
    BRepBuilderAPI_MakeWire wire;
    for (std::size_t i = 0; i < ring.size(); ++i)
      wire.Add(BRepBuilderAPI_MakeEdge(ring[i], ring[(i + 1) % ring.size()]).Edge());
    sewing_.Add(
        BRepBuilderAPI_MakeFace(gp_Pln(ring[0], gp_Dir(0, 0, -1)), wire.Wire(), Standard_True)
            .Face());
  }

  const HeightSpline& spline_;
  double base_z_;
  std::vector<double> places_x_, places_y_;
  std::vector<Range> columns_, rows_;
  BRepBuilderAPI_Sewing sewing_;
};

// ---- the file ------------------------------------------------------------------

Handle(TCollection_HAsciiString) text(const std::string& s) {
  return new TCollection_HAsciiString(s.c_str());
}

void write_file_of(const TopoDS_Solid& solid, const StepOptions& options,
                   const std::filesystem::path& path) {
  STEPControl_Controller::Init();  // or the parameters are not there yet
  Interface_Static::SetCVal("write.step.schema",
                            options.schema == StepSchema::ap214 ? "AP214IS" : "AP242DIS");
  Interface_Static::SetCVal("write.step.unit", "MM");
  Interface_Static::SetIVal("write.surfacecurve.mode", 0);  // curves in space say it all
  STEPControl_Writer writer;
  if (writer.Transfer(solid, STEPControl_ManifoldSolidBrep) != IFSelect_RetDone)
    throw Standard_Failure("the solid could not be translated");
  // OpenCASCADE counts the solids of its life and adds the number to the name.
  for (int i = 1; i <= writer.Model()->NbEntities(); ++i)
    if (const auto product = Handle(StepBasic_Product)::DownCast(writer.Model()->Value(i));
        !product.IsNull()) {
      product->SetId(text(options.name));
      product->SetName(text(options.name));
    }
  APIHeaderSection_MakeHeader header(writer.Model());
  header.SetName(text(options.name));
  header.SetTimeStamp(text("2000-01-01T00:00:00"));
  header.SetOriginatingSystem(text("maquette"));
  header.SetAuthorValue(1, text(""));
  header.SetOrganizationValue(1, text(""));
  header.SetDescriptionValue(1, text("model frame: x east, y north, z up, millimetres"));
  if (writer.Write(path.c_str()) != IFSelect_RetDone)
    throw Standard_Failure("the file could not be written");
}

/// Heights of the patches that a file has, at every node.
class Comparison {
 public:
  explicit Comparison(const ModelField& field) : field_(field), seen_(field.z_mm.cells().size()) {}

  void add(const Handle(Geom_BSplineSurface) & patch) {
    double x0 = 0.0, x1 = 0.0, y0 = 0.0, y1 = 0.0;
    patch->Bounds(x0, x1, y0, y1);
    const double d = field_.spacing.value();
    constexpr double kSlack = 1e-6;
    const auto first = [&](double from, double origin) {
      return static_cast<std::ptrdiff_t>(std::ceil((from - origin) / d - kSlack));
    };
    const auto last = [&](double to, double origin) {
      return static_cast<std::ptrdiff_t>(std::floor((to - origin) / d + kSlack));
    };
    const std::ptrdiff_t r1 = last(y1, field_.y0.value()), c1 = last(x1, field_.x0.value());
    for (std::ptrdiff_t r = first(y0, field_.y0.value()); r <= r1; ++r)
      for (std::ptrdiff_t c = first(x0, field_.x0.value()); c <= c1; ++c) {
        const double x = field_.x_mm(c), y = field_.y_mm(r);
        const gp_Pnt p = patch->Value(std::clamp(x, x0, x1), std::clamp(y, y0, y1));
        aside_mm = std::fmax(aside_mm, std::hypot(p.X() - x, p.Y() - y));
        const double e = p.Z() - static_cast<double>(field_.z_mm(r, c));
        max_mm = std::fmax(max_mm, std::abs(e));
        const auto node = static_cast<std::size_t>(r * field_.z_mm.cols() + c);
        if (seen_[node]) continue;  // borders belong to both patches
        seen_[node] = true;
        ++nodes;
        squares_mm2 += e * e;
      }
  }

  double max_mm = 0.0, aside_mm = 0.0, squares_mm2 = 0.0;
  std::uint64_t nodes = 0;

 private:
  const ModelField& field_;
  std::vector<bool> seen_;
};

void read_back(const std::filesystem::path& path, const ModelField& field, StepReport& report) {
  STEPControl_Reader reader;
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  if (reader.ReadFile(path.c_str()) != IFSelect_RetDone)
    throw Standard_Failure("what was written cannot be read");
  reader.TransferRoots();
  const TopoDS_Shape shape = reader.OneShape();
  report.valid = BRepCheck_Analyzer(shape).IsValid() == Standard_True;
  for (TopExp_Explorer e(shape, TopAbs_SOLID); e.More(); e.Next()) ++report.solids;
  Comparison comparison(field);
  for (TopExp_Explorer e(shape, TopAbs_FACE); e.More(); e.Next()) {
    ++report.faces;
    const Handle(Geom_BSplineSurface) patch =
        Handle(Geom_BSplineSurface)::DownCast(BRep_Tool::Surface(TopoDS::Face(e.Current())));
    if (patch.IsNull()) continue;
    ++report.patches;
    report.poles += static_cast<std::uint64_t>(patch->NbUPoles() * patch->NbVPoles());
    comparison.add(patch);
  }
  if (comparison.aside_mm > 1e-6) throw Standard_Failure("patches lie beside their places");
  report.max_error_mm = comparison.max_mm;
  report.nodes_compared = comparison.nodes;
  report.rms_error_mm = std::sqrt(
      comparison.squares_mm2 / static_cast<double>(std::max<std::uint64_t>(1, comparison.nodes)));
  report.sewing_tolerance_mm = ShapeAnalysis_ShapeTolerance().Tolerance(shape, 1);
  GProp_GProps properties;
  BRepGProp::VolumeProperties(shape, properties);
  report.volume_mm3 = properties.Mass();
}

Result<void> check_input(const ModelField& surface, const StepOptions& options,
                         const std::filesystem::path& path) {
  if (surface.z_mm.rows() < 4 || surface.z_mm.cols() < 4)
    return fail(kEmptyMesh,
                fmt::format("{}: a field of {} x {} nodes; patches (step) take 4 x 4 or more",
                            path.string(), surface.z_mm.cols(), surface.z_mm.rows()));
  const double tolerance = options.tolerance.value();
  if (!(tolerance >= 1e-6 && tolerance <= 1e3))
    return fail(kOptionOutOfRange,
                fmt::format("{}: tolerance of the patches {} mm: 1e-6 to 1000 expected",
                            path.string(), tolerance));
  const auto range = heightmap::height_range(surface.z_mm);
  if (static_cast<double>(range.min) - options.base_z.value() < 1.0)
    return fail(
        kOptionOutOfRange,
        fmt::format("{}: base at {} mm; 1 mm or more below the lowest node ({} mm) expected",
                    path.string(), options.base_z.value(), range.min));
  return {};
}

Result<void> check_size(const HeightSpline& spline, const StepOptions& options,
                        const std::filesystem::path& path) {
  const std::uint64_t poles = spline.poles_mm.cells().size();
  if (poles <= options.most_poles) return {};
  return fail(
      kTooManyPatchPoles,
      fmt::format("{}: patches that keep {} mm take {} poles, about {:.0f} GiB in "
                  "OpenCASCADE, more than {} that are allowed; choose a larger tolerance or "
                  "export it band by band",
                  path.string(), options.tolerance.value(), poles,
                  static_cast<double>(poles) * kBytesPerPole / 1073741824.0, options.most_poles));
}

}  // namespace

Result<StepReport> write_step(const ModelField& surface, const StepOptions& options,
                              const std::filesystem::path& path, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_input(surface, options, path));
  RunContext fitting = run;
  fitting.progress = [&](double share) { run.progress(0.1 * share); };
  auto spline = meshing::fit_height_spline(surface, options.tolerance, fitting);
  if (!spline) return tl::unexpected(std::move(spline.error()).within(path.string()));
  MAQUETTE_TRY_VOID(check_size(*spline, options, path));
  AtomicPath partial(path);
  MAQUETTE_TRY_VOID(partial.prepare());
  const std::scoped_lock one_at_a_time(library());
  Message::DefaultMessenger()->RemovePrinters(STANDARD_TYPE(Message_Printer));
  StepReport report;
  const auto stopped = [&] {
    return fail(kCancelled, fmt::format("{}: stopped while it was written", path.string()));
  };
  try {
    SolidMaker maker(*spline, options.base_z.value());
    const TopoDS_Solid solid = maker.make(run);
    if (run.stopped()) return stopped();
    run.progress(0.5);
    if (!BRepCheck_Analyzer(solid).IsValid()) throw Standard_Failure("the solid is not valid");
    if (run.stopped()) return stopped();
    run.progress(0.6);
    write_file_of(solid, options, partial.path());
    if (run.stopped()) return stopped();
    run.progress(0.8);
    read_back(partial.path(), surface, report);
    if (run.stopped()) return stopped();
    if (!report.valid || report.solids != 1 || report.patches != maker.patches() ||
        report.nodes_compared != surface.z_mm.cells().size() ||
        report.max_error_mm > std::fmax(spline->max_error_mm + 1e-6, options.tolerance.value()))
      throw Standard_Failure(
          ("what was read back is not what was meant: " + to_json(report)).c_str());
  } catch (const Standard_Failure& e) {
    return fail(kLibraryFailed,
                fmt::format("{}: OpenCASCADE: {}", path.string(), e.GetMessageString()));
  }
  report.max_between_mm = spline->max_between_mm;
  report.knot_spacing_mm = (spline->knots_x_mm.back() - spline->knots_x_mm.front()) /
                           static_cast<double>(spline->knots_x_mm.size() - 1);
  run.progress(1.0);
  MAQUETTE_TRY_VOID(partial.commit());
  return report;
}

std::string to_json(const StepReport& r) {
  return nlohmann::ordered_json{
             {"proof", "OpenCASCADE: BRepCheck, heights read back from the file"},
             {"valid", r.valid},
             {"solids", r.solids},
             {"faces", r.faces},
             {"patches", r.patches},
             {"poles", r.poles},
             {"knot_spacing_mm", r.knot_spacing_mm},
             {"volume_mm3", r.volume_mm3},
             {"nodes_compared", r.nodes_compared},
             {"max_error_mm", r.max_error_mm},
             {"rms_error_mm", r.rms_error_mm},
             {"max_between_nodes_mm", r.max_between_mm},
             {"sewing_tolerance_mm", r.sewing_tolerance_mm}}
             .dump(2) +
         "\n";
}

}  // namespace maquette::exporting
