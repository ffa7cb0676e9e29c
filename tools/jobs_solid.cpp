// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/gltf.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "meshing/decimate.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/solid.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

meshing::SolidOptions solid_options(const heightmap::ModelField& design,
                                    Millimetres base_thickness) {
  const auto lowest = static_cast<double>(heightmap::height_range(design.z_mm).min);
  return {.base_z = Millimetres{lowest} - base_thickness};
}

fs::path certificate_path(const fs::path& mesh) {
  return mesh.parent_path() / (mesh.stem().string() + ".certificate.json");
}

/// Progress of one part of a job, as a share of the whole.
RunContext part(const RunContext& run, double from, double to) {
  RunContext sub = run;
  sub.progress = [&run, from, to](double share) { run.progress(from + share * (to - from)); };
  return sub;
}

/// Checks, then writes: the mesh has its final name only if it passed.
Result<JobResult> check_and_write(const TriMesh& mesh, const heightmap::ModelField& design,
                                  const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto certificate, meshing::check_mesh(mesh, &design, {}, part(run, 0.5, 0.9)));
  const std::string text = meshing::to_json(certificate);
  if (!certificate.passed()) {
    const fs::path refused = out.parent_path() / (out.stem().string() + ".refused.json");
    MAQUETTE_TRY_VOID(write_file(refused, text));
    return fail(kMeshFailed, fmt::format("{}: the mesh is not a valid solid and was not written; "
                                         "see {} for what is wrong with it",
                                         out.string(), refused.string()));
  }
  MAQUETTE_TRY_VOID(meshing::write_ply(mesh, out, part(run, 0.9, 1.0)));
  MAQUETTE_TRY_VOID(write_file(certificate_path(out), text));
  JobResult result;
  result.outputs = {out, certificate_path(out)};
  result.figures_json = text;
  result.note = fmt::format("{} triangles, closed, manifold", certificate.triangles);
  return result;
}

}  // namespace

Result<JobResult> mesh_job(const fs::path& design_path, const std::optional<fs::path>& stones_path,
                           Millimetres base_thickness, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  std::vector<TriMesh> stones;
  if (stones_path) {
    MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(*stones_path));
    for (const auto& s : plan) stones.push_back(meshing::stone_mesh(s));
  }
  const auto options = solid_options(design, base_thickness);
  auto mesh = stones.empty() ? meshing::grid_solid(design, options, part(run, 0.0, 0.5))
                             : meshing::volume_solid(design, stones, options, part(run, 0.0, 0.5));
  if (!mesh) return tl::unexpected(std::move(mesh.error()).within(design_path.string()));
  return check_and_write(*mesh, design, out, run);
}

Result<JobResult> band_job(const fs::path& design_path, Millimetres max_width, std::size_t band,
                           Millimetres base_thickness, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  // The base is that of the whole, so that bands stand level beside each other.
  const auto options = solid_options(design, base_thickness);
  MAQUETTE_TRY(const auto bands,
               meshing::split_into_bands(design, meshing::BandAxis::y, max_width));
  MAQUETTE_CHECK(band < bands.size(), "band {} of {}", band, bands.size());
  const auto strip = meshing::band_field(design, bands[band]);
  MAQUETTE_TRY(const auto mesh, meshing::grid_solid(strip, options, part(run, 0.0, 0.5)));
  return check_and_write(mesh, strip, out, run);
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
  static const std::vector<std::string> formats{"stl", "ply", "obj", "3mf", "dxf", "glb"};
  return formats;
}

Result<JobResult> export_job(const std::string& format, const fs::path& surface,
                             const std::optional<fs::path>& design, const ExportOptions& options,
                             const fs::path& folder, const RunContext& run) {
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  const std::string stem = surface.stem().string();
  const fs::path out = folder / (stem + "." + format);
  JobResult result;
  json figures{{"format", format}};

  if (format == "dxf") {
    if (!is_field(surface) && !design)
      return fail(kUnknownFormat,
                  fmt::format("{}: contours (dxf) are drawn from a height field; give the .tif as "
                              "SURFACE or with --design",
                              surface.string()));
    MAQUETTE_TRY(const auto field,
                 heightmap::read_model_field(is_field(surface) ? surface : *design));
    MAQUETTE_TRY_VOID(exporting::write_dxf_contours(field, options.contour_interval, out, run));
    result.outputs = {out};
  } else {
    MAQUETTE_TRY(const TriMesh mesh, load_solid(surface, part(run, 0.0, 0.3)));
    const RunContext writing = part(run, 0.3, 1.0);
    figures["triangles"] = mesh.triangles.size();
    result.outputs = {out};
    if (format == "stl") {
      MAQUETTE_TRY_VOID(exporting::write_stl(mesh, out, writing));
    } else if (format == "ply") {
      MAQUETTE_TRY_VOID(meshing::write_ply(mesh, out, writing));
    } else if (format == "obj") {
      MAQUETTE_TRY_VOID(exporting::write_obj(mesh, out, writing));
    } else if (format == "3mf") {
      MAQUETTE_TRY_VOID(exporting::write_3mf({{stem, stem, &mesh}}, out, writing));
    } else if (format == "glb") {
      exporting::GltfOptions gltf;
      gltf.name = stem;
      gltf.position_bits = options.position_bits;
      gltf.scale_denominator = options.scale_denominator;
      MAQUETTE_TRY(const auto report, exporting::write_glb(mesh, gltf, out, writing));
      figures["max_quantisation_error_mm"] = report.max_quantisation_error_mm;
      if (design) {
        MAQUETTE_TRY(const auto field, heightmap::read_model_field(*design));
        MAQUETTE_TRY(const auto level,
                     meshing::decimate_surface(
                         field, static_cast<std::uint64_t>(options.lod_triangles), run));
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
  }
  std::uint64_t bytes = 0;
  for (const fs::path& f : result.outputs) bytes += fs::file_size(f, ec);
  figures["bytes"] = bytes;
  result.figures_json = figures.dump();
  result.note = human_bytes(static_cast<double>(bytes));
  return result;
}

}  // namespace maquette::tools
