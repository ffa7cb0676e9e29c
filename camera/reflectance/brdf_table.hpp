// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file brdf_table.hpp
/// A measured BRDF of an isotropic surface as a table over incidence, emission and azimuth.
///
/// CSV with a head line, in any order of rows, a full grid of angles:
///   incidence_deg,emission_deg,azimuth_deg,brdf                    1/sr, all bands
///   incidence_deg,emission_deg,azimuth_deg,brdf_r,brdf_g,brdf_b    1/sr
/// Azimuth 0: light and view on the same side (opposition), 180: the mirror's side; 0 to 180.
/// Between angles linear, beyond the table's angles as at its edge. What is used is the mean of
/// f(i, e) and f(e, i): reciprocal to rounding, although no measurement is.

#include <filesystem>
#include <memory>
#include <vector>

#include "camera/reflectance/angles.hpp"
#include "core/result.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kBrdfFile{"CAMERA_BRDF_FILE"};

struct BrdfTable {
  struct Grid3 {
    std::vector<double> incidence_deg, emission_deg, azimuth_deg;  ///< ascending
    std::vector<Bands> brdf;  ///< 1/sr; azimuth runs fastest, then emission
  };
  std::shared_ptr<const Grid3> grid;  ///< not null
  double scale = 1.0;                 ///< in front of the table

  [[nodiscard]] Bands radiance_factor(const Angles& a) const;
};

/// CORE_FILE_*; CAMERA_BRDF_FILE: columns, numbers or angles that are missing, with the line.
[[nodiscard]] Result<BrdfTable> read_brdf_table(const std::filesystem::path& path);

}  // namespace maquette::camera
