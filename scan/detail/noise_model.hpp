// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file noise_model.hpp
/// Which points of a scan are worth more: how their noise goes with range and angle of incidence.
///
/// A scanner's noise is along its line of sight and grows with range and as the surface turns away,
/// each instrument in its own way; so the law is taken from the residuals themselves: their robust
/// spread in 4 x 4 bins of equal counts of range and of incidence, over that of all. Each residual
/// counts by its own standard deviation then (generalised least squares: Aitken 1936; for
/// registration Segal, Haehnel and Thrun 2009, doi:10.15607/RSS.2009.V.021, whose covariance of
/// each point is reduced to what counts here, that along the normal).

#include <array>
#include <vector>

#include "scan/detail/normal_equations.hpp"

namespace maquette::scan::detail {

class NoiseModel {
 public:
  /// @param met         a sample at a pose that is nearly right
  /// @param station_mm  the scanner, model frame
  NoiseModel(const Met& met, Vec3 station_mm);
  /// Standard deviation of a residual over the typical one.
  [[nodiscard]] double relative(Vec3 point_mm, Vec3 normal) const;
  /// Largest over smallest.
  [[nodiscard]] double spread() const;

 private:
  static constexpr std::size_t kBins = 4;
  Vec3 station_;
  std::array<double, kBins - 1> range_limits_{};
  std::array<std::array<double, kBins - 1>, kBins> cosine_limits_{};  // within each bin of range
  std::array<std::array<double, kBins>, kBins> relative_{};
};

/// A surface whose residuals have the standard deviations of a noise model.
class WeightedSurface : public Surface {
 public:
  WeightedSurface(const Surface& surface, const NoiseModel& noise)
      : surface_(&surface), noise_(&noise) {}
  void feet(std::span<const Vec3> points_mm, std::span<Foot> feet) const override {
    surface_->feet(points_mm, feet);
    for (std::size_t i = 0; i < feet.size(); ++i)
      if (!std::isnan(feet[i].e_mm)) feet[i].sigma = noise_->relative(points_mm[i], feet[i].normal);
  }

 private:
  const Surface* surface_;
  const NoiseModel* noise_;
};

}  // namespace maquette::scan::detail
