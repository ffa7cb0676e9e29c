// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file surface.hpp
/// The part as the simulation has it: what the program cut, or the design where there is no
/// program.

#include <array>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "diagnosis/observation.hpp"
#include "diagnosis/path_contact.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis {

/// What all observations of a part have in common, as far as design and program say.
[[nodiscard]] Scene scene_of(const heightmap::ModelField& design, const CutPath* path,
                             double ball_radius_mm);

class SimulatedSurface {
 public:
  /// Keeps references to both; `path` may be null.
  SimulatedSurface(const heightmap::ModelField& design, const CutPath* path, const RunContext& run);

  struct Place {
    double height_mm;
    Vec3 normal;
    std::optional<Contact> contact;
    double design_mm;
  };
  /// none: beside the design, over a void, or not reached by the program.
  /// @param rivals  as of CutPath::at
  [[nodiscard]] std::optional<Place> at(double x_mm, double y_mm,
                                        std::vector<Rival>* rivals = nullptr) const;
  /// The place as causes see it: what cut it, other passes beside, curvature; residual 0 along the
  /// normal. none: as above.
  [[nodiscard]] std::optional<Observation> observe(double x_mm, double y_mm) const;
  /// Second derivatives of the surface smoothed at each of kCurvatureScales_mm.
  [[nodiscard]] std::array<Curvature, kCurvatureScales_mm.size()> curvature(double x_mm,
                                                                            double y_mm) const;
  /// NMAD of cut minus design over a sample of nodes, and the share of nodes that were cut.
  [[nodiscard]] double program_misfit_mm() const { return misfit_; }
  [[nodiscard]] double cut_share() const { return cut_share_; }

 private:
  const heightmap::ModelField& design_;
  const CutPath* path_;
  std::array<heightmap::ModelField, kCurvatureScales_mm.size()> smooth_;
  double misfit_ = 0.0, cut_share_ = 1.0;
};

}  // namespace maquette::diagnosis
