// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file reflectance.hpp
/// How bright a surface is from the directions of light and view. Each law has a file of its own
/// in reflectance/ with its physics, parameters and source; all give the radiance factor pi f mu0
/// (reflectance/angles.hpp).
///
/// Holds   Reciprocal to 1e-12. Directional albedo by quadrature against closed forms to 1e-3.
///         Nothing comes from behind: 0 where one of the cosines is not positive.
/// Not     Lommel-Seeliger and lunar-Lambert are laws for dark surfaces: with an albedo above 0.25
///         they give back more light than arrives at grazing incidence. largest_albedo() says so.

#include <memory>
#include <string>
#include <variant>

#include "camera/reflectance/brdf_table.hpp"
#include "camera/reflectance/ggx.hpp"
#include "camera/reflectance/hapke.hpp"
#include "camera/reflectance/lambert.hpp"
#include "camera/reflectance/lommel_seeliger.hpp"
#include "camera/reflectance/lunar_lambert.hpp"
#include "camera/reflectance/oren_nayar.hpp"
#include "core/grid.hpp"
#include "core/result.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kMaterialOutOfRange{"CAMERA_MATERIAL_OUT_OF_RANGE"};

using Law = std::variant<Lambert, LommelSeeliger, LunarLambert, Hapke, OrenNayar, Ggx, BrdfTable>;

/// Factors on a rectangle of the model frame, seen from above; row 0 is the southernmost.
/// Between the pixels' centres linear, outside as at the edge.
struct AlbedoMap {
  std::array<Grid<float>, 3> factor;  ///< of one size; 1 changes nothing
  double min_x_mm = 0.0, min_y_mm = 0.0, max_x_mm = 1.0, max_y_mm = 1.0;

  [[nodiscard]] Bands at(double x_mm, double y_mm) const;
};

/// Of the bands of a map or picture: none is empty, and all are as large.
[[nodiscard]] bool of_one_size(const std::array<Grid<float>, 3>& factor);

struct Material {
  std::string name = "material";
  Law law = Lambert{};
  std::shared_ptr<const AlbedoMap> map{};  ///< in front of the law; may be null
};

[[nodiscard]] Bands radiance_factor(const Law& law, const Angles& angles);

/// Share of the light that comes from `mu0` and goes back into the half space, per band.
/// Quadrature of 64 x 64 directions; a lobe narrower than 3 degrees needs more.
[[nodiscard]] Bands directional_albedo(const Law& law, double mu0);

/// The largest directional albedo over incidences of 0 to 89 degrees and the bands: above 1 the
/// law makes light.
[[nodiscard]] double largest_albedo(const Law& law);

/// CAMERA_MATERIAL_OUT_OF_RANGE: a parameter that its law does not know, with its range.
[[nodiscard]] Result<void> check_material(const Material& material);

}  // namespace maquette::camera
