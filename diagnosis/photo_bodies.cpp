// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_bodies.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <deque>
#include <map>
#include <numbers>
#include <optional>

#include <oneapi/tbb/parallel_for.h>

#include "camera/ray_scene.hpp"
#include "core/mask.hpp"
#include "heightmap/field_tracer.hpp"
#include "meshing/mesh_io.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kOff_mm = 1e-3;  // where a ray to the lamp starts above the surface
constexpr int kAtRim = 8;         // places on a lamp's rim that shadows are traced to

struct Lamp {
  std::vector<Vec3> places;  ///< on its disc; the first is the middle
  double radius_mm;

  explicit Lamp(const PhotoInput& photo) : radius_mm(0.5 * photo.lamp_diameter_mm) {
    const auto axes = across(normalized(photo.lamp_position_mm - photo.lamp_target_mm));
    places.push_back(photo.lamp_position_mm);
    for (int k = 0; k < kAtRim && radius_mm > 0.0; ++k) {
      const double a = 2.0 * std::numbers::pi * k / kAtRim;
      places.push_back(photo.lamp_position_mm +
                       radius_mm * (std::cos(a) * axes[0] + std::sin(a) * axes[1]));
    }
  }
};

struct Ball {
  Vec3 centre_mm;
  double radius_mm;
};
/// About a mesh as it stands.
Ball ball_about(const TriMesh& mesh, const Body& body) {
  const Box3 box = mesh.bounds();
  const Vec3 middle = 0.5 * (box.min + box.max);
  double far2 = 0.0;
  for (const Vec3& v : mesh.vertices_mm) far2 = std::fmax(far2, dot(v - middle, v - middle));
  return {body.model_from_mesh.point(body.scale * middle), body.scale * std::sqrt(far2)};
}

/// Bodies that rays meet.
class Bodies {
 public:
  static Result<Bodies> read(const std::vector<Body>& bodies, const RunContext& run) {
    Bodies b;
    std::map<std::filesystem::path, const TriMesh*> known;  // one that stands in several places
    std::vector<camera::RayObject> objects;
    for (const Body& body : bodies) {
      const TriMesh*& mesh = known[body.mesh];
      if (mesh == nullptr) {
        MAQUETTE_TRY(TriMesh fresh, meshing::read_mesh(body.mesh, run));
        mesh = &b.meshes_.emplace_back(std::move(fresh));
      }
      camera::RayObject& o = objects.emplace_back();
      o.mesh = mesh;
      o.model_from_mesh = body.model_from_mesh;
      o.scale = body.scale;
      b.balls_.push_back(ball_about(*mesh, body));
    }
    if (objects.empty()) return b;
    MAQUETTE_TRY(b.rays_, camera::RayScene::build(objects, run));
    return b;
  }
  [[nodiscard]] std::optional<camera::RayHit> first_hit(Vec3 from, Vec3 direction) const {
    return rays_ ? rays_->first_hit(from, direction) : std::nullopt;
  }
  /// Do they hide a place on the lamp from one on the surface?
  [[nodiscard]] bool shade(Vec3 at, Vec3 normal, const Lamp& lamp) const {
    const Vec3 to = lamp.places.front() - at;
    const bool near = std::any_of(balls_.begin(), balls_.end(), [&](const Ball& ball) {
      const Vec3 way = ball.centre_mm - at;
      const double along = std::clamp(dot(way, to) / dot(to, to), 0.0, 1.0),
                   widest = along + ball.radius_mm / norm(to);  // of the cone to the lamp
      return norm(way - along * to) <= ball.radius_mm + widest * lamp.radius_mm;
    });
    return near && std::any_of(lamp.places.begin(), lamp.places.end(), [&](Vec3 place) {
             return rays_->blocked({at, normal, place});
           });
  }

 private:
  std::deque<TriMesh> meshes_;
  std::vector<Ball> balls_;
  std::optional<camera::RayScene> rays_;
};

/// Stones that stand on the ground.
struct Stones {
  const heightmap::ModelField& ground;
  heightmap::FieldTracer without;

  [[nodiscard]] bool at(Vec3 place) const {
    return place.z - heightmap::height_at(ground, place.x, place.y) > kStone_mm;
  }
  [[nodiscard]] bool shade(const heightmap::FieldTracer& with, Vec3 place, Vec3 lamp) const {
    const Vec3 from = place + Vec3{0.0, 0.0, kOff_mm}, to = lamp - from;
    const double way = norm(to);
    const Vec3 along = (1.0 / way) * to;
    return with.blocked(from, along, way) && !without.blocked(from, along, way);
  }
};

}  // namespace

Result<BodyPixels> pixels_of_bodies(const PhotoScene& scene, const heightmap::ModelField& design,
                                    const heightmap::ModelField* ground,
                                    const std::vector<Body>& bodies, std::ptrdiff_t margin_px,
                                    const RunContext& run) {
  MAQUETTE_TRY(const Bodies stand, Bodies::read(bodies, run));
  const heightmap::FieldTracer with(design);
  std::optional<Stones> stones;
  if (ground != nullptr) stones.emplace(Stones{*ground, heightmap::FieldTracer(*ground)});
  BodyPixels all;
  std::vector<std::atomic<std::size_t>> pixels(bodies.size());
  for (const PhotoInput& photo : scene.photos) {
    const double f = photo.focal_length_mm * 1000.0 / photo.pixel_pitch_um;
    const Lamp lamp(photo);
    Grid<std::uint8_t>& of =
        all.left_out.emplace_back(photo.height_px, photo.width_px, std::uint8_t{0});
    oneapi::tbb::parallel_for(0, photo.height_px, [&](int r) {
      for (int c = 0; c < photo.width_px; ++c) {
        const Vec3 direction = rotate(
            photo.model_from_camera,
            normalized(Vec3{c + 0.5 - photo.principal_u_px, photo.principal_v_px - r - 0.5, -f}));
        const auto hit = with.trace(photo.camera_position_mm, direction);
        const auto body = stand.first_hit(photo.camera_position_mm, direction);
        if (body && (!hit || body->distance_mm < hit->distance_mm)) {
          of(r, c) = 1;
          ++pixels[body->object];
        } else if (hit &&
                   (stand.shade(hit->point_mm, hit->normal, lamp) ||
                    (stones && (stones->at(hit->point_mm) ||
                                stones->shade(with, hit->point_mm, photo.lamp_position_mm))))) {
          of(r, c) = 1;
        }
      }
    });
    if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
    widen(of, margin_px);
  }
  all.pixels.assign(pixels.begin(), pixels.end());
  return all;
}

}  // namespace maquette::diagnosis::detail
