// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file extended_model.hpp
/// The simulation with named causes in it: what a diagnosis has found (extended.toml) acts on a
/// simulated surface and on simulated points.
///
/// Takes   a case (design, programs, declared coat, [[cause]] tables)
/// Gives   the part as built: heights raised by coat and causes; points as the scanner sees them
///
/// The causes are those of the library (effect.hpp), the same functions that diagnose fits: each
/// node of a surface is an observation with its contact, feed, time and play. A cause that moves
/// the surface by m along its normal raises the height over (x, y) by m / n_z, to first order, as
/// residuals have it; so a surface built here and diagnosed gives the cause back (the tests).
/// Causes of the scanner move points instead.
/// Cost: 3 us a node where there is a program; memory as path_contact.hpp.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/case_input.hpp"
#include "diagnosis/effect.hpp"

namespace maquette::diagnosis {

/// One column of a known cause with its coefficient.
struct KnownTerm {
  double coefficient = 0.0;
  std::function<double(const Observation&)> value;
  bool scanner = false;  ///< moves points, not the part
  /// Of causes that act through the cut, as of Column.
  std::function<CutChange(const Observation&, const CutState&, Vec3 normal)> cut{};
  std::optional<Levels> levels{};  ///< as of Column
};
/// By how much an observation moves by all of them, those that act through the cut cut together.
[[nodiscard]] double moved_mm(const Observation& o, const std::vector<KnownTerm>& terms,
                              double ball_radius_mm);
/// The same of all observations of a case, and what those of them that level (a film, a spot) make
/// of what the others move.
[[nodiscard]] std::vector<double> moved_mm(const std::vector<Observation>& all,
                                           const std::vector<KnownTerm>& terms,
                                           double ball_radius_mm);
/// Causes as functions of an observation.
/// @param centres  of each set-up's points, about which scanner.registration turns
/// @return DIAGNOSIS_UNKNOWN_CAUSE for a name, law or scan that is not there
[[nodiscard]] Result<std::vector<KnownTerm>> restore(const std::vector<KnownCause>& causes,
                                                     const Scene& scene,
                                                     const std::vector<Vec3>& centres);

class ExtendedModel {
 public:
  /// Of a case: ground (or design), programs, coat, causes; the measurements are not looked at but
  /// for the stations of the scans.
  /// @return errors of the readers, DIAGNOSIS_UNKNOWN_CAUSE
  [[nodiscard]] static Result<ExtendedModel> make(const CaseInput& input,
                                                  const RunContext& run = {});
  ExtendedModel(ExtendedModel&&) noexcept;
  ~ExtendedModel();

  /// What the programs cut (the ground where there are none), at nodes of half the design's
  /// spacing.
  [[nodiscard]] const heightmap::ModelField& cut() const;
  /// By how much the part as built stands above what the programs cut at (x, y): declared coat and
  /// causes. none: beside the design, over a void, or not reached by the program.
  [[nodiscard]] std::optional<double> raised_mm(double x_mm, double y_mm) const;
  /// Height of the part as built; none: as above.
  [[nodiscard]] std::optional<double> height_mm(double x_mm, double y_mm) const;
  /// The place on the cut surface, as causes see it; the residual is what coat and causes move.
  [[nodiscard]] std::optional<Observation> place(double x_mm, double y_mm) const;
  /// Raises the nodes of a surface that the programs cut (the design, an as-milled field), where
  /// it is known by how much.
  void build(heightmap::ModelField& surface) const;
  /// Where the scanner says that a point of the part is.
  /// @param scan  from 0, as in the case: some causes are of one scan
  [[nodiscard]] Vec3 seen(Vec3 point_mm, Vec3 station_mm, std::size_t scan) const;
  [[nodiscard]] bool moves_points() const;  ///< is any cause the scanner's?
  [[nodiscard]] const Scene& scene() const;
  /// Names of the causes, in order.
  [[nodiscard]] const std::vector<std::string>& names() const;

 private:
  struct Parts;
  explicit ExtendedModel(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

}  // namespace maquette::diagnosis
