// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_stones.hpp"

#include <oneapi/tbb/parallel_for.h>

#include "core/mask.hpp"
#include "diagnosis/case_input.hpp"
#include "heightmap/field_tracer.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kOff_mm = 1e-3;  // where a ray to the lamp starts above the surface

}  // namespace

std::vector<Grid<std::uint8_t>> pixels_of_stones(const PhotoScene& scene,
                                                 const heightmap::ModelField& design,
                                                 const heightmap::ModelField& ground,
                                                 std::ptrdiff_t margin_px) {
  const heightmap::FieldTracer with(design), without(ground);
  std::vector<Grid<std::uint8_t>> all;
  for (const PhotoInput& photo : scene.photos) {
    const double f = photo.focal_length_mm * 1000.0 / photo.pixel_pitch_um;
    Grid<std::uint8_t>& of = all.emplace_back(photo.height_px, photo.width_px, std::uint8_t{0});
    oneapi::tbb::parallel_for(0, photo.height_px, [&](int r) {
      for (int c = 0; c < photo.width_px; ++c) {
        const Vec3 direction = rotate(
            photo.model_from_camera,
            normalized(Vec3{c + 0.5 - photo.principal_u_px, photo.principal_v_px - r - 0.5, -f}));
        const auto hit = with.trace(photo.camera_position_mm, direction);
        if (!hit) continue;
        const Vec3 at = hit->point_mm, from = at + Vec3{0.0, 0.0, kOff_mm},
                   to = photo.lamp_position_mm - from;
        const double way = norm(to);
        const Vec3 along = (1.0 / way) * to;
        if (at.z - heightmap::height_at(ground, at.x, at.y) > kStone_mm ||
            (with.blocked(from, along, way) && !without.blocked(from, along, way)))
          of(r, c) = 1;
      }
    });
    widen(of, margin_px);
  }
  return all;
}

}  // namespace maquette::diagnosis::detail
