// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file povray.hpp
/// POV-Ray as a second renderer of the same scene: triangles with their own flat normals, Lambert's
/// law, one point lamp whose light falls with the square of the distance, a pinhole. Linear light
/// in and out; it shares no code with the camera room.

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/os.h>

#include "camera/image_io.hpp"
#include "camera/render.hpp"
#include "core/tri_mesh.hpp"
#include "support/peers.hpp"

namespace maquette::testing_support {

/// The command that starts it: unpacked by tools/setup --peers, or the system's.
inline std::optional<std::string> povray() {
  const std::filesystem::path root = peers_folder() / "povray/usr";
  if (std::filesystem::exists(root / "bin/povray"))
    return fmt::format(
        "LD_LIBRARY_PATH='{0}/lib/x86_64-linux-gnu:{0}/lib/aarch64-linux-gnu' '{0}/bin/povray'",
        root.string());
  if (std::system("command -v povray > /dev/null") == 0) return "povray";
  return std::nullopt;
}

struct PovrayObject {
  const TriMesh* mesh;
  double albedo;
};
struct PovrayScene {
  std::vector<PovrayObject> objects;
  camera::CameraModel camera;  ///< without skew; principal point in the middle
  RigidTransform model_from_camera;
  Vec3 lamp_mm, target_mm;
  double exposure_scale = 1.0;  ///< value of white that faces the lamp at the target
};

namespace povray_detail {

/// POV-Ray's axes are left-handed for the eye alone: with right, up and direction given, numbers
/// are what they are.
inline std::string vector(Vec3 v) {
  return fmt::format("<{:.9g},{:.9g},{:.9g}>", v.x, v.y, v.z);
}

inline void write(const PovrayScene& s, const std::filesystem::path& path) {
  auto out = fmt::output_file(path.string());
  out.print("#version 3.7;\nglobal_settings {{ assumed_gamma 1.0 }}\nbackground {{ rgb 0 }}\n");
  const auto& c = s.camera;
  const auto side = [&](Vec3 v) { return vector(s.model_from_camera.direction(v)); };
  out.print("camera {{ perspective location {} direction {} right {} up {} }}\n",
            vector(s.model_from_camera.translation_mm), side({0, 0, -c.focal_length_mm}),
            side({1e-3 * c.pixel_pitch_um * c.width_px, 0, 0}),
            side({0, 1e-3 * c.pixel_pitch_um * c.height_px, 0}));
  // It fades light as 2 / (1 + (d / fade_distance)^2): at a distance of a thousand of those the
  // square law to 1e-6.
  constexpr double kFar = 1000.0;
  out.print("light_source {{ {} color rgb {:.9g} fade_distance {:.12g} fade_power 2 }}\n",
            vector(s.lamp_mm), 0.5 * (1.0 + kFar * kFar) * s.exposure_scale,
            norm(s.target_mm - s.lamp_mm) / kFar);
  for (const PovrayObject& o : s.objects) {
    out.print("mesh2 {{\nvertex_vectors {{ {}", o.mesh->vertices_mm.size());
    for (const Vec3& v : o.mesh->vertices_mm) out.print(",\n{}", vector(v));
    out.print(" }}\nface_indices {{ {}", o.mesh->triangles.size());
    for (const auto& t : o.mesh->triangles) out.print(",\n<{},{},{}>", t[0], t[1], t[2]);
    out.print(" }}\npigment {{ rgb 1 }} finish {{ ambient 0 diffuse {:.9g} }} }}\n", o.albedo);
  }
}

}  // namespace povray_detail

/// Radiance as `maquette render` states it, each pixel the mean of finer x finer places on a
/// regular grid.
/// @param scratch  a folder for its files
/// @return nothing: it failed; said.txt in the folder says why
inline std::optional<Grid<float>> render_with_povray(const std::string& command,
                                                     const PovrayScene& scene, int finer,
                                                     const std::filesystem::path& scratch) {
  povray_detail::write(scene, scratch / "scene.pov");
  const int width = scene.camera.width_px, height = scene.camera.height_px;
  const int status = std::system(
      fmt::format("cd '{}' && HOME='{}' {} +Iscene.pov +Oscene.png +FN16 File_Gamma=1.0 +W{} +H{} "
                  "-D -A -GA >said.txt 2>&1 </dev/null",
                  scratch.string(), scratch.string(), command, finer * width, finer * height)
          .c_str());
  if (status != 0) return std::nullopt;
  const auto fine = camera::read_image(scratch / "scene.png");
  if (!fine) return std::nullopt;
  Grid<float> out(height, width);
  for (std::ptrdiff_t r = 0; r < height; ++r)
    for (std::ptrdiff_t c = 0; c < width; ++c) {
      double sum = 0.0;
      for (std::ptrdiff_t i = 0; i < finer; ++i)
        for (std::ptrdiff_t j = 0; j < finer; ++j)
          sum += static_cast<double>(fine->channels[0](finer * r + i, finer * c + j));
      out(r, c) = static_cast<float>(sum / (finer * finer));
    }
  return out;
}

}  // namespace maquette::testing_support
