// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file registration_steps.hpp
/// The pieces of register_scan().

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "scan/detail/normal_equations.hpp"
#include "scan/register.hpp"

namespace maquette::scan::detail {

inline constexpr std::size_t kLeastPoints = 30;
/// Tukey's 95 % efficiency at the normal distribution, in standard deviations.
inline constexpr double kTukey = 4.685;
/// Huber's.
inline constexpr double kHuber = 1.345;
/// Below any height step of a float field; keeps the limits above zero when cloud and design
/// agree exactly.
inline constexpr double kLeastScaleMm = 1e-5;

struct Solution {
  Vector7 step = Vector7::Zero();        ///< full update, unknowns of Frame
  Eigen::MatrixXd kept, free;            ///< columns: directions that are determined, and held
  Matrix7 covariance = Matrix7::Zero();  ///< of the unknowns, residuals taken as independent
  double step_sigmas = INFINITY;         ///< length of the step in that covariance
};
/// What decides whether a direction is determined.
struct Certainty {
  double noise_mm = 0.0;
  double flat = 1e-8;           ///< eigenvalues of the mean J J' below this are no shape
  double least_certain_mm = 1;  ///< a direction with a larger standard deviation is held
  double independent = 0.0;     ///< residuals that count as independent
  bool scale = false;           ///< is scale unknown?
  /// Mean J J' with the normals of the smooth surface that the triangles stand for. The facets of
  /// a cylinder or a sphere would tell where it is turned to; the shape does not. Null: the
  /// triangles' own.
  const Matrix7* shape = nullptr;
};
[[nodiscard]] Solution solve(const Sums& sums, const Certainty& certainty);
/// Within the directions kept: A^-1 B A^-1.
[[nodiscard]] Matrix7 sandwich(const Eigen::MatrixXd& kept, const Matrix7& bread,
                               const Matrix7& meat);

/// One level of detail of the design.
struct Level {
  const Surface* surface = nullptr;
  double spacing_mm = 1.0;
  double cells = 1.0;
  double flat = 1e-8;
  const Surface* quick = nullptr;  ///< the same distances, for the way to the rest; null: `surface`
};
/// Gauss-Newton with Huber's weights until steps are small against the spacing.
[[nodiscard]] Pose settle(std::span<const Vec3> points, Pose pose, const Level& level);

/// The design and what is left of it when it is looked at from ever farther away.
struct Pyramid {
  explicit Pyramid(const heightmap::ModelField& design);
  std::vector<heightmap::ModelField> coarse;  ///< spacing doubled, and doubled again, ...
  std::vector<FieldSurface> surfaces;         ///< design first
  std::vector<Level> levels;                  ///< design first
};
[[nodiscard]] Pose descend(std::span<const Vec3> points, Pose pose, const Pyramid& pyramid,
                           std::size_t from_level);

/// How well points fit where they are.
struct Fit {
  double noise_mm = INFINITY;  ///< NMAD of the residuals
  double over = 0.0;           ///< share of the points that have the design above or below
  double overlap = 0.0;        ///< share of the points within 5 noise_mm
  /// Slope of the regression of the cloud's heights on the design's, both without their mean
  /// plane. At the right place 1 whatever the noise (all noise is in the cloud); at a false
  /// minimum two grounds of one kind lie on each other that have little in common.
  double likeness = 0.0, likeness_sigma = 0.0;
  /// Share of the variance of the design's relief, in means over some 400 blocks, that is not
  /// in the residuals: noise averages out of it, a wrong place does not.
  double explained = 0.0, explained_sigma = 0.0;
  double relief_mm = 0.0;  ///< standard deviation of the design without its mean plane there
  Frame frame;
  [[nodiscard]] bool good(double least_overlap) const;
  [[nodiscard]] bool beyond_doubt() const;
};
[[nodiscard]] Fit fit_of(std::span<const Vec3> points, const Pose& pose, const Surface& field);

/// SCAN_TOO_FEW_POINTS
[[nodiscard]] tl::unexpected<Error> too_few(std::size_t count);

/// Where all points came to rest.
struct Rest {
  Pose pose;
  Sums sums;
  Solution solution;
  Loss loss;
  int iterations = 0;
};
/// Iterates with Tukey's weights. SCAN_TOO_FEW_POINTS, SCAN_UNDER_DETERMINED,
/// SCAN_NOT_CONVERGED, CORE_CANCELLED
/// @param some    a sample of the points: for the noise, and for what the shape determines
/// @param smooth  the surface with smooth normals
[[nodiscard]] Result<Rest> come_to_rest(std::span<const Vec3> points, const std::vector<Vec3>& some,
                                        const Pose& start, const Level& level,
                                        const Surface& smooth, const Frame& frame,
                                        const RegisterOptions& options, const RunContext& run);
/// Fills in pose, covariance, free directions and what else the rest says.
void state(Registration& result, std::span<const Vec3> points, std::span<const Vec3> some,
           const Rest& rest, const Surface& surface, const Frame& frame);

/// Poses from which the pyramid leads to the part, whatever the cloud's frame; best first, at
/// most `most`.
/// @param station  the scanner, in the cloud's frame: says which side is up
[[nodiscard]] std::vector<Pose> places_anywhere(std::span<const Vec3> points,
                                                const heightmap::ModelField& design,
                                                std::optional<Vec3> station, std::size_t most);

}  // namespace maquette::scan::detail
