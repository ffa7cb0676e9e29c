// SPDX-License-Identifier: GPL-3.0-or-later

// What deviate() found, as files for programs and viewers.

#include <nlohmann/json.hpp>

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

}  // namespace maquette::scan
