// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_merge.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "scan/clean.hpp"
#include "scan/merge_files.hpp"
#include "scan/mesh_cloud.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

json place_json(Vec3 p) {
  return {p.x, p.y, p.z};
}

json figures_of(const scan::MergedFiles& merged) {
  const scan::Merge& merge = merged.merge;
  json figures{{"voxel_mm", merge.voxel_mm}, {"iterations", merge.iterations}};
  std::uint64_t points = 0;
  for (std::size_t i = 0; i < merged.scans.size(); ++i) {
    const scan::MergedPose& p = merge.scans[i];
    const Quaternion& q = p.correction.rotation;
    points += merged.scans[i].points;
    json sigma = json::array();
    for (std::size_t k = 0; k < 6; ++k) sigma.push_back(std::sqrt(p.covariance[7 * k]));
    figures["scans"].push_back({{"name", merged.scans[i].name},
                                {"points", merged.scans[i].points},
                                {"points_for_pose", merged.scans[i].used},
                                {"rotation_wxyz", {q.w, q.x, q.y, q.z}},
                                {"translation_mm", place_json(p.correction.translation_mm)},
                                {"centre_mm", place_json(p.centre_mm)},
                                {"moved_mm", norm(p.correction.point(p.centre_mm) - p.centre_mm)},
                                {"sigma_mm_rad", sigma},
                                {"covariance", p.covariance},
                                {"colour_gain", p.gain},
                                {"overlap", p.overlap}});
  }
  figures["points"] = points;
  for (const scan::MergePair& p : merge.pairs)
    figures["pairs"].push_back({{"first", merged.scans[p.first].name},
                                {"second", merged.scans[p.second].name},
                                {"pieces", p.pieces},
                                {"overlap", p.overlap},
                                {"noise_mm", p.noise_mm},
                                {"misfit_mm", p.misfit_mm},
                                {"misfit_rad", p.misfit_rad},
                                {"chi_squared", p.chi_squared}});
  return figures;
}

json mesh_json(const scan::CloudMesh& mesh, bool closed) {
  json holes = json::array();
  double area = 0.0;
  for (const scan::MeshHole& h : mesh.holes) {
    area += h.area_mm2;
    if (holes.size() < 200)
      holes.push_back({{"edges", h.edges},
                       {"length_mm", h.length_mm},
                       {"area_mm2", h.area_mm2},
                       {"middle_mm", place_json(h.middle_mm)}});
  }
  return {{"vertices", mesh.mesh.vertices_mm.size()},
          {"triangles", mesh.mesh.triangles.size()},
          {"voxel_mm", mesh.voxel_mm},
          {"closed", closed},
          {"border_loops", mesh.holes.size()},
          {"pinholes_closed", mesh.pinholes},
          {"border_loops_area_mm2", area},
          {"loops", holes}};
}

}  // namespace

Result<JobResult> merge_job(const MergeJob& job, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(const scan::MergedFiles merged, scan::merge_files(job.clouds, job.options, run));
  const scan::OpenCloud open = [&] { return scan::open_merged(merged); };
  json figures = figures_of(merged);
  double noise = 0.0;
  for (const scan::MergePair& p : merged.merge.pairs) noise = std::max(noise, p.noise_mm);
  JobResult result;
  result.outputs = {out};
  result.note = fmt::format("{} scans, {} points, {:.3g} mm between scans", merged.scans.size(),
                            figures["points"].get<std::uint64_t>(), noise);
  if (job.mesh) {
    scan::MeshCloudOptions options;
    options.voxel_mm = job.mesh_voxel_mm;
    options.closed = job.closed;
    MAQUETTE_TRY(const scan::CloudMesh mesh, scan::mesh_cloud(open, options, run));
    MAQUETTE_TRY_VOID(scan::write_mesh_ply(mesh, *job.mesh));
    result.outputs.push_back(*job.mesh);
    figures["mesh"] = mesh_json(mesh, job.closed);
    result.note += fmt::format(", {} triangles, {} border loops", mesh.mesh.triangles.size(),
                               mesh.holes.size());
  }
  if (job.thin_mm > 0.0) {
    scan::CleanOptions thin;
    thin.mixed = false;
    thin.least_neighbours = 0;
    thin.voxel_mm = thin.thin_mm = job.thin_mm;
    MAQUETTE_TRY(const scan::CleanFigures thinned, scan::clean_cloud(open, out, thin, run));
    figures["thinned"] = {{"voxel_mm", job.thin_mm},
                          {"points", thinned.written},
                          {"points_per_voxel", static_cast<double>(thinned.kept) /
                                                   static_cast<double>(thinned.written)}};
  } else {
    MAQUETTE_TRY_VOID(scan::copy_cloud(open, out, run));
  }
  fs::path statement = out;
  statement += ".merge.json";
  MAQUETTE_TRY_VOID(write_file(statement, figures.dump(1)));
  result.outputs.push_back(statement);
  result.figures_json = figures.dump();
  return result;
}

}  // namespace maquette::tools
