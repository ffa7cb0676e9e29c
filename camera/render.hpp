// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file render.hpp
/// What a pinhole or a thin lens sees of terrain, stones and spacecraft under lamps: linear
/// radiance.
///
/// Room    camera:  scene (own terrain tracer, Embree for meshes) -> [render] -> effects ->
/// image_io Takes   height fields and closed meshes in the model frame, lamps, surroundings,
/// camera, pose Gives   radiance in one or three bands relative to a white Lambert surface under
/// irradiance 1
///         (camera/lamp.hpp), and what a pixel's centre sees: depth, normal, angles, part
///
/// Camera: looks along -z of its own frame, y up; pixel (0, 0) is the upper left,
/// centres at half integers, principal point in the middle unless given. No distortion: `expose`
/// bends. With a lens' opening each sample goes through a point of its own of it, stratified like
/// the lamps' (detail/thin_lens.hpp); depth, lit and geometry stay those of the middle's ray.
/// Light: direct light of each lamp; soft shadows by stratified samples of the lens (Shirley and
/// Chiu 1997, doi:10.1080/10867651.1997.10487479). Light of the surroundings (a room, panels) and,
/// if asked for, one diffuse bounce by rays spread with the cosine; mirror-like foil sends them
/// where its facets reflect. Shading is in double on the triangles' own normals; a face seen from
/// its back is black.
///
/// The same bits for any number of threads: every random number is a function of
/// (seed, pixel, sample).

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "camera/lamp.hpp"
#include "camera/mesh_cover.hpp"
#include "camera/reflectance.hpp"
#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/units.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kPoseNotFinite{"CAMERA_POSE_NOT_FINITE"};
inline constexpr ErrorCode kUnderGround{"CAMERA_UNDER_GROUND"};
inline constexpr ErrorCode kLampInSurface{"CAMERA_LAMP_IN_SURFACE"};
inline constexpr ErrorCode kCameraOutOfRange{"CAMERA_OPTION_OUT_OF_RANGE"};
inline constexpr ErrorCode kEmptyScene{"CAMERA_EMPTY_SCENE"};

/// Rays go through points of the lens' opening: what is out of focus is blurred, and what a blurred
/// edge hides is seen past it, without the approximations of effects/depth_of_field.hpp.
struct LensOpening {
  double f_number = 0.0;  ///< 0: a pinhole, all is sharp
  /// As of DepthOfField: along the axis; infinite allowed; 0: what the picture's middle sees.
  double focus_mm = 0.0;
  int blades = 0;  ///< 0: round; else 3 to 30: a regular polygon of the same area
  double rotation_deg = 0.0;
};

struct CameraModel {
  int width_px = 1024, height_px = 768;
  double pixel_pitch_um = 8.45;
  double focal_length_mm = 35.0;
  /// From the upper left corner; NaN: the middle.
  double principal_x_px = NAN, principal_y_px = NAN;
  double aspect = 1.0;   ///< fy / fx
  double skew_px = 0.0;  ///< entry (0, 1) of K
  LensOpening lens{};
};

/// A mesh or a terrain with its material. A mesh that several objects have is kept once. What is
/// pointed at must outlive the scene.
struct SceneObject {
  const TriMesh* mesh = nullptr;
  Material material;
  RigidTransform model_from_mesh{};
  const heightmap::ModelField* field = nullptr;  ///< instead of a mesh
  /// Where the terrain's walls end, mm; NaN: a sheet without walls.
  double base_mm = std::numeric_limits<double>::quiet_NaN();
  double scale = 1.0;                        ///< of a mesh, before it is moved; positive
  std::shared_ptr<const MeshCover> cover{};  ///< of a mesh, in place of `material`; may be null
};

/// An evenly bright rectangle of the room: corner and two sides. Seen and shining from both faces;
/// hides nothing and casts no shadow, so it belongs beyond everything else.
struct Panel {
  Vec3 corner_mm, side_a_mm, side_b_mm;
  Bands radiance{1.0, 1.0, 1.0};
};

struct Lighting {
  std::vector<Lamp> lamps;
  Bands ambient{};  ///< radiance of the surroundings where no panel is: the room's walls
  std::vector<Panel> panels;

  [[nodiscard]] bool surroundings() const {
    return !panels.empty() || ambient[0] > 0.0 || ambient[1] > 0.0 || ambient[2] > 0.0;
  }
};

struct RenderOptions {
  int samples_per_pixel = 4;  ///< stratified n x n; a square number; 1: the pixel's centre
  int lamp_samples = 1;       ///< per sample and lamp, used when the lamp has a size
  double exposure_scale = 1.0;
  std::uint64_t seed = 1;
  int gather_samples = 4;  ///< rays per sample for surroundings and bounce, when there is either
  bool bounce = false;     ///< light that comes from one more surface
  /// Adaptive: samples_per_pixel more at a time until the standard error of a pixel is below
  /// this share of its value (of 2 % of white, if it is darker); 0: off.
  double noise_target = 0.0;
  int max_samples = 256;               ///< per pixel, when adaptive
  bool geometry = false;               ///< normals, positions, angles and parts, too
  Bands white_balance{1.0, 1.0, 1.0};  ///< beside exposure_scale; unequal ones make three bands
};

struct Image {
  std::vector<Grid<float>> bands;  ///< radiance; 1: grey, 3: R, G, B; row 0 is the UPPER row
  Grid<float> depth_mm;            ///< along the ray through the pixel's centre; inf: background
  /// Bit k (1, 2, 4, ...) where light of lamp k's centre, of the first eight, arrives at what the
  /// pixel's centre sees: facing it, in the beam, not in shadow. Edges of shadows are where it
  /// changes.
  Grid<std::uint8_t> lit;
  // Of what the pixel's centre sees, if RenderOptions::geometry; NaN: background.
  std::array<Grid<float>, 3> normal, position_mm;      ///< model frame
  Grid<float> phase_deg, incidence_deg, emission_deg;  ///< at the first lamp's centre
  Grid<float> part;                                    ///< number of the object from 1; 0: none
  double mean_samples = 0.0;                           ///< per pixel
};

/// Scene and materials, ready for any number of pictures.
class PreparedScene {
 public:
  /// CAMERA_EMPTY_SCENE, CAMERA_MATERIAL_OUT_OF_RANGE, CORE_CANCELLED. Warns of materials that
  /// give back more light than they get.
  [[nodiscard]] static Result<PreparedScene> build(const std::vector<SceneObject>& objects,
                                                   const RunContext& run = {});
  PreparedScene(PreparedScene&&) noexcept;
  PreparedScene& operator=(PreparedScene&&) noexcept;
  ~PreparedScene();

  /// @return the image or one of the codes above (CAMERA_UNDER_GROUND: camera or the rim of
  ///         its lens inside the solid, on its surface, or below its underside;
  ///         CAMERA_LAMP_IN_SURFACE: the lens' centre or rim is inside; CAMERA_INTRINSICS: a field
  ///         of view, skew or principal point that no camera has: effects/frame.hpp;
  ///         CAMERA_OPTION_OUT_OF_RANGE: with it a lens that is focused nearer than its focal
  ///         length); CORE_CANCELLED
  [[nodiscard]] Result<Image> render(const CameraModel& camera,
                                     const RigidTransform& model_from_camera,
                                     const Lighting& lighting, const RenderOptions& options = {},
                                     const RunContext& run = {}) const;

 private:
  struct State;
  explicit PreparedScene(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// One picture under one lamp.
[[nodiscard]] Result<Image> render(const std::vector<SceneObject>& objects,
                                   const CameraModel& camera,
                                   const RigidTransform& model_from_camera, const Lamp& lamp,
                                   const RenderOptions& options = {}, const RunContext& run = {});

/// Pose of a camera at `position` that looks at `target` with `up` upward; north is
/// up in the picture when it looks along `up`. Not finite if the two points coincide.
[[nodiscard]] RigidTransform look_at(Vec3 position_mm, Vec3 target_mm, Vec3 up = {0, 0, 1});

}  // namespace maquette::camera
