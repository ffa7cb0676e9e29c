// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/run_part.hpp"
#include "export/cad.hpp"
#include "export/gltf.hpp"
#include "export/step.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "meshing/decimate.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/solid.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_shaped.hpp"
#include "tools/set_aside.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

JobResult solid_result(const meshing::MeshCertificate& certificate, const std::string& text,
                       const fs::path& out) {
  JobResult result;
  result.outputs = {out, certificate_path(out)};
  result.figures_json = text;
  result.note = fmt::format("{} triangles, closed, manifold", certificate.triangles);
  return result;
}

/// Terrain alone, over the window, is proven and written without a mesh in memory.
Result<JobResult> stream_terrain(const heightmap::ModelField& design,
                                 const meshing::NodeWindow& window,
                                 const meshing::SolidOptions& options, const fs::path& out,
                                 const RunContext& run) {
  MAQUETTE_TRY(const auto solid, meshing::GridSolidStream::create(design, window, options));
  MAQUETTE_TRY(const auto certificate,
               solid.certify(meshing::CoordinateRounding::none, part(run, 0.0, 0.3)));
  MAQUETTE_TRY_VOID(meshing::write_ply(solid, out, part(run, 0.3, 1.0)));
  const std::string text = meshing::to_json(certificate);
  MAQUETTE_TRY_VOID(write_file(certificate_path(out), text));
  return solid_result(certificate, text, out);
}

}  // namespace

Result<JobResult> mesh_job(const fs::path& design_path, const std::optional<fs::path>& stones_path,
                           Millimetres base_thickness, const fs::path& out, const RunContext& run) {
  if (stones_path) {
    MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(*stones_path));
    if (!plan.empty())
      return shaped_job(
          {.design = design_path, .stones = stones_path, .base_thickness = base_thickness}, out,
          run);
  }
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  auto result = stream_terrain(design, meshing::all_nodes(design),
                               solid_options(design, base_thickness), out, run);
  if (!result) return tl::unexpected(std::move(result.error()).within(design_path.string()));
  return result;
}

Result<JobResult> band_job(const fs::path& design_path, const meshing::BandSplit& split,
                           std::size_t band, Millimetres base_thickness, const fs::path& out,
                           const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  // The base is that of the whole, so that bands stand level beside each other.
  const auto options = solid_options(design, base_thickness);
  MAQUETTE_TRY(const auto bands, meshing::split_into_bands(design, split));
  MAQUETTE_CHECK(band < bands.size(), "band {} of {}", band, bands.size());
  auto result =
      stream_terrain(design, meshing::band_window(design, bands[band]), options, out, run);
  if (!result) return tl::unexpected(std::move(result.error()).within(design_path.string()));
  return result;
}

bool is_field(const fs::path& surface) {
  return surface.extension() == ".tif" || surface.extension() == ".tiff";
}

Result<TriMesh> load_solid(const fs::path& surface, const RunContext& run) {
  if (!is_field(surface)) return meshing::read_mesh(surface, run);
  MAQUETTE_TRY(const auto field, heightmap::read_model_field(surface));
  return meshing::grid_solid(field, solid_options(field, Millimetres{10.0}), run);
}

Result<Box3> surface_bounds(const fs::path& surface) {
  if (!is_field(surface)) {
    MAQUETTE_TRY(const TriMesh mesh, meshing::read_mesh(surface));
    return mesh.bounds();
  }
  MAQUETTE_TRY(const auto field, heightmap::read_model_field(surface));
  const auto range = heightmap::height_range(field.z_mm);
  Box3 box;
  box.add({field.x_mm(0), field.y_mm(0), static_cast<double>(range.min)});
  box.add({field.x_mm(field.z_mm.cols() - 1), field.y_mm(field.z_mm.rows() - 1),
           static_cast<double>(range.max)});
  return box;
}

const std::vector<std::string>& export_formats() {
  static const std::vector<std::string> formats{"stl",  "ply", "obj", "3mf",
                                                "step", "dxf", "glb", "usda"};
  return formats;
}

namespace {

/// Empty where a format has a rounding of its own kind (glb) or no mesh.
std::optional<meshing::CoordinateRounding> rounding_of(const std::string& format) {
  using meshing::CoordinateRounding;
  if (format == "ply") return CoordinateRounding::none;
  if (format == "stl" || format == "usda") return CoordinateRounding::float32;
  if (format == "obj") return CoordinateRounding::micro;
  if (format == "3mf") return CoordinateRounding::lib3mf;
  return {};
}

Result<void> write_certificate(const meshing::MeshCertificate& certificate, const fs::path& out,
                               json& figures, JobResult& result) {
  const fs::path proof = out.string() + ".certificate.json";
  MAQUETTE_TRY_VOID(write_file(proof, meshing::to_json(certificate)));
  result.outputs = {out, proof};
  figures["triangles"] = certificate.triangles;
  figures["rounding_mm"] = certificate.rounding_mm;
  return {};
}

/// Plain terrain to a format with vertices: proven as that file will have it, then written.
/// @return false if surface or format are of another kind; then nothing was done
Result<bool> export_terrain(const std::string& format, const fs::path& surface, const fs::path& out,
                            json& figures, JobResult& result, const RunContext& run) {
  const auto rounding = rounding_of(format);
  if (!is_field(surface) || !rounding) return false;
  MAQUETTE_TRY(const auto field, heightmap::read_model_field(surface));
  const auto options = solid_options(field, Millimetres{10.0});
  MAQUETTE_TRY(const auto solid, meshing::GridSolidStream::create(field, options));
  const auto certificate = solid.certify(*rounding, part(run, 0.0, 0.3));
  if (!certificate) return tl::unexpected(Error(certificate.error()).within(surface.string()));
  const RunContext writing = part(run, 0.3, 1.0);
  if (format == "stl") {
    MAQUETTE_TRY_VOID(exporting::write_stl(solid, out, writing));
  } else if (format == "obj") {
    MAQUETTE_TRY_VOID(exporting::write_obj(solid, out, writing));
  } else if (format == "usda") {
    MAQUETTE_TRY_VOID(exporting::write_usda(solid, surface.stem().string(), out, writing));
  } else if (format == "3mf") {  // lib3mf takes no stream
    const std::string name = surface.stem().string();
    MAQUETTE_TRY(const TriMesh mesh, meshing::grid_solid(field, options, part(run, 0.3, 0.4)));
    MAQUETTE_TRY_VOID(exporting::write_3mf({{name, name, &mesh}}, out, part(run, 0.4, 1.0)));
  } else {
    MAQUETTE_TRY_VOID(meshing::write_ply(solid, out, writing));
  }
  MAQUETTE_TRY_VOID(write_certificate(*certificate, out, figures, result));
  figures["hausdorff_bound_mm"] = certificate->hausdorff_bound_mm;
  return true;
}

/// A mesh of which a file will have rounded coordinates, checked with these. What fails only
/// because of them is unmet: the file gets another name.
Result<meshing::MeshCertificate> check_rounded(const TriMesh& mesh, const std::string& format,
                                               const heightmap::ModelField* design,
                                               const fs::path& surface, fs::path& out,
                                               JobResult& result, const RunContext& run) {
  const auto rounding = *rounding_of(format);
  TriMesh in_file = mesh;
  for (Vec3& v : in_file.vertices_mm)
    v = {meshing::rounded(v.x, rounding), meshing::rounded(v.y, rounding),
         meshing::rounded(v.z, rounding)};
  MAQUETTE_TRY(auto certificate,
               meshing::check_mesh(in_file, design, {.rounding = rounding}, part(run, 0.0, 0.8)));
  certificate.rounding_mm = meshing::rounding_displacement_mm(TriMeshStream(mesh), rounding);
  if (certificate.passed()) return certificate;
  MAQUETTE_TRY(const auto before, meshing::check_mesh(mesh, design, {}, part(run, 0.8, 1.0)));
  if (!before.passed())
    return fail(meshing::kNotASolid, fmt::format("{}: the mesh is no solid: {}; repair it first",
                                                 surface.string(), meshing::shortcomings(before)));
  out.replace_extension("refused." + format);
  result.unmet = fmt::format(
      "{}: coordinates as {} has them, up to {:.2g} mm beside the mesh's, "
      "spoil it: {}; it is written as {}. Write PLY or OBJ, or move the "
      "origin nearer",
      surface.string(), format, certificate.rounding_mm, meshing::shortcomings(certificate),
      out.filename().string());
  return certificate;
}

/// Terrain alone: stones are parts of their own. One file, or one a band: NAME_band_01.step ...
Result<void> export_step(const heightmap::ModelField& field, const ExportOptions& options,
                         const fs::path& out, json& figures, JobResult& result,
                         const RunContext& run) {
  exporting::StepOptions step;
  step.tolerance = options.step_tolerance;
  // Of the whole, so that bands stand level beside each other.
  step.base_z = solid_options(field, Millimetres{10.0}).base_z;
  if (options.step_schema == "ap214") step.schema = exporting::StepSchema::ap214;
  const double width = options.step_band_mm > 0.0
                           ? options.step_band_mm
                           : field.spacing.value() * static_cast<double>(field.z_mm.rows());
  MAQUETTE_TRY(
      const auto bands,
      meshing::split_into_bands(
          field, options.step_bands.value_or(meshing::BandSplit{.max_width = Millimetres{width}})));
  MAQUETTE_TRY_VOID(set_aside_beyond(out.parent_path(), out.stem().string() + "_band_",
                                     bands.size() > 1 ? bands.size() : 0, run));
  figures["files"] = json::array();
  for (std::size_t b = 0; b < bands.size(); ++b) {
    const double parts = static_cast<double>(bands.size()), done = static_cast<double>(b);
    step.name = out.stem().string();
    if (bands.size() > 1) step.name += fmt::format("_band_{:02}", bands[b].number);
    const fs::path file = out.parent_path() / (step.name + ".step");
    MAQUETTE_TRY(const auto report,
                 exporting::write_step(meshing::band_field(field, bands[b]), step, file,
                                       part(run, done / parts, (done + 1.0) / parts)));
    const fs::path proof = file.string() + ".certificate.json";
    MAQUETTE_TRY_VOID(write_file(proof, exporting::to_json(report)));
    result.outputs.push_back(file);
    result.outputs.push_back(proof);
    figures["files"].push_back({{"file", file.filename().string()},
                                {"patches", report.patches},
                                {"poles", report.poles},
                                {"max_error_mm", report.max_error_mm},
                                {"rms_error_mm", report.rms_error_mm},
                                {"max_between_nodes_mm", report.max_between_mm},
                                {"volume_mm3", report.volume_mm3}});
  }
  return {};
}

JobResult sized(JobResult result, json figures) {
  std::error_code ec;
  std::uint64_t bytes = 0;
  for (const fs::path& f : result.outputs) bytes += fs::file_size(f, ec);
  figures["bytes"] = bytes;
  result.figures_json = figures.dump();
  result.note = human_bytes(static_cast<double>(bytes));
  return result;
}

}  // namespace

Result<JobResult> export_job(const std::string& format, const fs::path& surface,
                             const std::optional<fs::path>& design, const ExportOptions& options,
                             const fs::path& folder, const RunContext& run) {
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  const std::string stem = surface.stem().string();
  fs::path out = folder / (stem + "." + format);
  JobResult result;
  json figures{{"format", format}};

  if (format == "dxf" || format == "step") {
    if (!is_field(surface) && !design)
      return fail(
          kUnknownFormat,
          fmt::format("{}: {} from a height field; give the .tif as SURFACE or with "
                      "--design",
                      surface.string(),
                      format == "dxf" ? "contours (dxf) are drawn" : "patches (step) are fitted"));
    MAQUETTE_TRY(const auto field,
                 heightmap::read_model_field(is_field(surface) ? surface : *design));
    if (format == "step") {
      MAQUETTE_TRY_VOID(export_step(field, options, out, figures, result, run));
      return sized(std::move(result), std::move(figures));
    }
    MAQUETTE_TRY_VOID(exporting::write_dxf_contours(field, options.contour_interval, out, run));
    result.outputs = {out};
  } else {
    MAQUETTE_TRY(const bool streamed, export_terrain(format, surface, out, figures, result, run));
    if (streamed) return sized(std::move(result), std::move(figures));
    MAQUETTE_TRY(const TriMesh mesh, load_solid(surface, part(run, 0.0, 0.1)));
    std::optional<meshing::MeshCertificate> certificate;
    if (rounding_of(format)) {
      heightmap::ModelField field;
      if (design) {
        MAQUETTE_TRY(field, heightmap::read_model_field(*design));
      }
      MAQUETTE_TRY(certificate, check_rounded(mesh, format, design ? &field : nullptr, surface, out,
                                              result, part(run, 0.1, 0.5)));
    }
    const RunContext writing = part(run, 0.5, 1.0);
    figures["triangles"] = mesh.triangles.size();
    result.outputs = {out};
    if (format == "stl") {
      MAQUETTE_TRY_VOID(exporting::write_stl(mesh, out, writing));
    } else if (format == "ply") {
      MAQUETTE_TRY_VOID(meshing::write_ply(mesh, out, writing));
    } else if (format == "obj") {
      MAQUETTE_TRY_VOID(exporting::write_obj(mesh, out, writing));
    } else if (format == "usda") {
      MAQUETTE_TRY_VOID(exporting::write_usda(mesh, stem, out, writing));
    } else if (format == "3mf") {
      MAQUETTE_TRY_VOID(exporting::write_3mf({{stem, stem, &mesh}}, out, writing));
    } else if (format == "glb") {
      exporting::GltfOptions gltf;
      gltf.name = stem;
      gltf.position_bits = options.position_bits;
      gltf.scale_denominator = options.scale_denominator;
      MAQUETTE_TRY(const auto report, exporting::write_glb(mesh, gltf, out, writing));
      figures["max_quantisation_error_mm"] = report.max_quantisation_error_mm;
      figures["flat_triangles"] = report.flat_triangles;
      figures["turned_triangles"] = report.turned_triangles;
      if (design) {
        MAQUETTE_TRY(const auto field, heightmap::read_model_field(*design));
        MAQUETTE_TRY(
            const auto level,
            meshing::decimate_surface(
                field, {.most_triangles = static_cast<std::uint64_t>(options.lod_triangles)}, run));
        const fs::path lod = folder / (stem + "_lod1.glb");
        gltf.name = stem + "_lod1";
        MAQUETTE_TRY_VOID(exporting::write_glb(level.mesh, gltf, lod, run));
        result.outputs.push_back(lod);
        figures["lod1_triangles"] = level.mesh.triangles.size();
        figures["lod1_max_vertical_error_mm"] = level.max_vertical_error_mm;
        figures["lod1_rms_vertical_error_mm"] = level.rms_vertical_error_mm;
      }
    } else {
      return fail(kUnknownFormat, fmt::format("--format {}: known formats are {}", format,
                                              fmt::join(export_formats(), ", ")));
    }
    if (certificate) MAQUETTE_TRY_VOID(write_certificate(*certificate, out, figures, result));
  }
  return sized(std::move(result), std::move(figures));
}

}  // namespace maquette::tools
