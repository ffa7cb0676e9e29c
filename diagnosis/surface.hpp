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
#include "diagnosis/spot_view.hpp"
#include "heightmap/field_tracer.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis {

/// What all observations of a part have in common, as far as design and program say.
[[nodiscard]] Scene scene_of(const heightmap::ModelField& design, const CutPath* path,
                             double ball_radius_mm);

class SimulatedSurface {
 public:
  /// Keeps references to both; `path` may be null.
  SimulatedSurface(const heightmap::ModelField& design, const CutPath* path, const RunContext& run);
  SimulatedSurface(const SimulatedSurface&) = delete;  // the tracer refers to the cut
  SimulatedSurface& operator=(const SimulatedSurface&) = delete;

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
  /// The place as causes see it: what cut it, other passes beside, slope, films; residual 0 along
  /// the normal. none: as above.
  [[nodiscard]] std::optional<Observation> observe(double x_mm, double y_mm) const;
  /// NMAD of cut minus design over a sample of nodes, and the share of nodes that were cut.
  [[nodiscard]] double program_misfit_mm() const { return misfit_; }
  [[nodiscard]] double cut_share() const { return cut_share_; }

  /// Normal of the surface levelled over the shortest of kFilmLengths_mm, by central differences;
  /// none: at a border or void.
  [[nodiscard]] std::optional<Vec3> slope_normal(double x_mm, double y_mm) const;
  /// Second derivatives of that surface along xx, xy, yy, 1 / mm; 0 where there are none.
  [[nodiscard]] std::array<float, 3> curvature_per_mm(double x_mm, double y_mm) const;
  /// The surface levelled over each of kFilmLengths_mm less `height_mm`, which it has there;
  /// upwards, mm.
  [[nodiscard]] std::array<float, kFilmLengths_mm.size()> levelled(double x_mm, double y_mm,
                                                                   double height_mm) const;
  /// What a wide spot reads of it from there.
  [[nodiscard]] SpotView spots(Vec3 station_mm) const;
  /// How far a beam goes until it meets the surface, to a few micrometres (straight between nodes
  /// of half the design's spacing); none: it does not.
  [[nodiscard]] std::optional<double> range_mm(Vec3 station_mm, Vec3 beam) const;
  /// The surface at nodes of half the design's spacing.
  [[nodiscard]] const heightmap::ModelField& field() const { return cut_; }

 private:
  const heightmap::ModelField& design_;
  const CutPath* path_;
  std::shared_ptr<const Pass> pass_;
  heightmap::ModelField cut_;
  std::optional<heightmap::FieldTracer> tracer_;  ///< of cut_
  std::array<heightmap::ModelField, kFilmLengths_mm.size()> smooth_;
  double misfit_ = 0.0, cut_share_ = 1.0;
};

}  // namespace maquette::diagnosis
