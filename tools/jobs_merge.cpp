// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_merge.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "scan/clean.hpp"
#include "scan/mesh_cloud.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

/// A cloud for each station.
std::vector<scan::Cloud> split(scan::Cloud all) {
  std::vector<scan::Cloud> scans;
  if (all.stations.size() < 2) {
    scans.push_back(std::move(all));
    return scans;
  }
  std::size_t from = 0;
  for (const scan::ScanStation& s : all.stations) {
    const auto n = static_cast<std::size_t>(s.points);
    if (n == 0) continue;
    scan::Cloud& c = scans.emplace_back();
    const auto part = [&](const auto& whole, auto& some) {
      if (!whole.empty())
        some.assign(whole.begin() + static_cast<std::ptrdiff_t>(from),
                    whole.begin() + static_cast<std::ptrdiff_t>(from + n));
    };
    part(all.points_mm, c.points_mm);
    part(all.intensity, c.intensity);
    part(all.normals, c.normals);
    part(all.colours, c.colours);
    part(all.grid, c.grid);
    c.stations = {s};
    c.station_mm = s.position_mm;
    from += n;
  }
  return scans;
}

json place_json(Vec3 p) {
  return {p.x, p.y, p.z};
}

}  // namespace

Result<JobResult> merge_job(const MergeJob& job, const fs::path& out, const RunContext& run) {
  std::vector<scan::Cloud> scans;
  std::vector<std::string> names;
  for (const fs::path& path : job.clouds) {
    MAQUETTE_TRY(auto cloud, scan::read_cloud(path, run));
    auto parts = split(std::move(cloud));
    for (std::size_t i = 0; i < parts.size(); ++i) {
      names.push_back(parts.size() == 1 ? path.filename().string()
                                        : fmt::format("{}:{}", path.filename().string(),
                                                      parts[i].stations.front().name.empty()
                                                          ? fmt::format("{}", i + 1)
                                                          : parts[i].stations.front().name));
      scans.push_back(std::move(parts[i]));
    }
  }
  MAQUETTE_TRY(const scan::Merge merge, scan::merge_scans(scans, job.options, run));
  json figures{{"voxel_mm", merge.voxel_mm}, {"iterations", merge.iterations}};
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const scan::MergedPose& p = merge.scans[i];
    const Quaternion& q = p.correction.rotation;
    json sigma = json::array();
    for (std::size_t k = 0; k < 6; ++k) sigma.push_back(std::sqrt(p.covariance[7 * k]));
    figures["scans"].push_back({{"name", names[i]},
                                {"points", scans[i].points_mm.size()},
                                {"rotation_wxyz", {q.w, q.x, q.y, q.z}},
                                {"translation_mm", place_json(p.correction.translation_mm)},
                                {"centre_mm", place_json(p.centre_mm)},
                                {"moved_mm", norm(p.correction.point(p.centre_mm) - p.centre_mm)},
                                {"sigma_mm_rad", sigma},
                                {"covariance", p.covariance},
                                {"colour_gain", p.gain},
                                {"overlap", p.overlap}});
    scan::apply(p, scans[i]);
  }
  double noise = 0.0;
  for (const scan::MergePair& p : merge.pairs) {
    noise = std::max(noise, p.noise_mm);
    figures["pairs"].push_back({{"first", names[p.first]},
                                {"second", names[p.second]},
                                {"pieces", p.pieces},
                                {"overlap", p.overlap},
                                {"noise_mm", p.noise_mm},
                                {"misfit_mm", p.misfit_mm},
                                {"misfit_rad", p.misfit_rad},
                                {"chi_squared", p.chi_squared}});
  }
  const std::size_t count = scans.size();
  scan::Cloud all = scan::join(std::move(scans));
  JobResult result;
  result.outputs = {out};
  figures["points"] = all.points_mm.size();
  result.note = fmt::format("{} scans, {} points, {:.3g} mm between scans", count,
                            all.points_mm.size(), noise);
  if (job.mesh) {
    scan::MeshCloudOptions options;
    options.voxel_mm = job.mesh_voxel_mm;
    options.closed = job.closed;
    MAQUETTE_TRY(const scan::CloudMesh mesh, scan::mesh_cloud(all, options, run));
    MAQUETTE_TRY_VOID(scan::write_mesh_ply(mesh, *job.mesh));
    result.outputs.push_back(*job.mesh);
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
    figures["mesh"] = {{"vertices", mesh.mesh.vertices_mm.size()},
                       {"triangles", mesh.mesh.triangles.size()},
                       {"voxel_mm", mesh.voxel_mm},
                       {"closed", job.closed},
                       {"border_loops", mesh.holes.size()},
                       {"border_loops_area_mm2", area},
                       {"loops", holes}};
    result.note += fmt::format(", {} triangles, {} border loops", mesh.mesh.triangles.size(),
                               mesh.holes.size());
  }
  if (job.thin_mm > 0.0) {
    scan::CleanOptions thin;
    thin.mixed = false;
    thin.least_neighbours = 0;
    thin.voxel_mm = thin.thin_mm = job.thin_mm;
    MAQUETTE_TRY(const scan::CleanFigures thinned, scan::clean_cloud(all, thin, run));
    figures["thinned"] = {{"voxel_mm", job.thin_mm},
                          {"points", thinned.written},
                          {"points_per_voxel", static_cast<double>(thinned.kept) /
                                                   static_cast<double>(thinned.written)}};
  }
  MAQUETTE_TRY_VOID(scan::write_cloud(all, out));
  fs::path statement = out;
  statement += ".merge.json";
  MAQUETTE_TRY_VOID(write_file(statement, figures.dump(1)));
  result.outputs.push_back(statement);
  result.figures_json = figures.dump();
  return result;
}

}  // namespace maquette::tools
