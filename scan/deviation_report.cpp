// SPDX-License-Identifier: GPL-3.0-or-later

// What deviate() found, as files for programs and viewers.

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "scan/detail/cloud_parts.hpp"
#include "scan/deviate.hpp"

namespace maquette::scan {

std::string to_json(const DeviationStatistics& s, const Registration* registration) {
  nlohmann::ordered_json j = {
      {"mean_mm", s.mean_mm},     {"rms_mm", s.rms_mm},         {"sigma_mm", s.sigma_mm},
      {"median_mm", s.median_mm}, {"nmad_mm", s.nmad_mm},       {"p05_mm", s.p05_mm},
      {"p95_mm", s.p95_mm},       {"abs_p95_mm", s.abs_p95_mm}, {"min_mm", s.min_mm},
      {"max_mm", s.max_mm},       {"points", s.points},         {"off_part", s.off_part},
      {"coverage", s.coverage}};
  if (registration != nullptr) {
    const Registration& a = *registration;
    const Quaternion& q = a.model_from_scan.rotation;
    const Vec3& t = a.model_from_scan.translation_mm;
    j["registration"] = {
        {"converged", true},
        {"iterations", a.iterations},
        {"rms_before_mm", a.rms_before_mm},
        {"rms_after_mm", a.rms_after_mm},
        {"noise_mm", a.noise_mm},
        {"overlap", a.overlap},
        {"likeness", a.likeness},
        {"found_anywhere", a.found_anywhere},
        {"effective_points", a.effective_points},
        {"scale", a.scale},
        {"sigma_scale", a.sigma_scale},
        {"model_from_scan",
         {{"rotation_wxyz", {q.w, q.x, q.y, q.z}}, {"translation_mm", {t.x, t.y, t.z}}}},
        {"sigma_translation_mm", a.sigma_translation_mm},
        {"sigma_rotation_rad", a.sigma_rotation_rad},
        {"centre_mm", {a.centre_mm.x, a.centre_mm.y, a.centre_mm.z}},
        {"covariance", a.covariance},
        {"free_directions", a.free_directions},
        {"note",
         "a best-fit registration absorbs constant offsets (coating thickness, tool length) and "
         "tilts of the whole surface: they are in the pose, not in the deviation"}};
  }
  return j.dump(2) + "\n";
}

Result<void> write_deviation_ply(const Cloud& cloud, const RigidTransform& model_from_scan,
                                 const Deviation& deviation, const std::filesystem::path& path) {
  const detail::ExtraScalar extra{"deviation_mm", &deviation.per_point_mm};
  MAQUETTE_TRY(const auto writer, detail::create_ply(path, {}, &extra));
  return detail::write_all(cloud, &model_from_scan, *writer);
}

Result<void> write_deviation_mesh(const TriMesh& mesh, const MeshDeviation& deviation,
                                  const std::filesystem::path& path) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment maquette deviation, unit mm\n"
      "element vertex {}\nproperty double x\nproperty double y\nproperty double z\n"
      "property float deviation_mm\nelement face {}\n"
      "property list uchar uint vertex_indices\nend_header\n",
      mesh.vertices_mm.size(), mesh.triangles.size());
  bytes.reserve(bytes.size() + 28 * mesh.vertices_mm.size() + 13 * mesh.triangles.size());
  const auto put = [&](const auto& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    put(mesh.vertices_mm[i].x), put(mesh.vertices_mm[i].y), put(mesh.vertices_mm[i].z);
    put(deviation.per_vertex_mm[i]);
  }
  for (const auto& t : mesh.triangles) {
    bytes.push_back(3);
    put(t[0]), put(t[1]), put(t[2]);
  }
  return write_file(path, bytes);
}

}  // namespace maquette::scan
