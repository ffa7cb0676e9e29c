// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file normal_equations.hpp
/// Residuals of points against a surface and the normal equations of their pose.

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::scan::detail {

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

/// Signed distance of a point from the surface's plane near it.
struct Foot {
  double e_mm = NAN;  ///< positive on the side of the normal; NaN: nothing to compare with
  Vec3 normal;
  /// Factor on the limit of the loss. On a triangle steeper than 4:1 that is met vertically a
  /// point millimetres off in height has hardly a distance: a stone that is missing would hold
  /// the scan by sides that are not there.
  double reach = 1.0;
  double sigma = 1.0;  ///< standard deviation of e_mm over the typical one (noise_model.hpp)
};

class Surface {
 public:
  virtual ~Surface() = default;
  /// @pre as many feet as points
  virtual void feet(std::span<const Vec3> points_mm, std::span<Foot> feet) const = 0;
};

/// The plane of the triangle straight above or below.
class FieldSurface : public Surface {
 public:
  explicit FieldSurface(const heightmap::ModelField& field) : field_(&field) {}
  void feet(std::span<const Vec3> points_mm, std::span<Foot> feet) const override;

 private:
  const heightmap::ModelField* field_;
};

/// The same distances with the normals of the smooth surface through the nodes: differences of
/// second order, bilinear between nodes; at steps those of the facets.
class SmoothFieldSurface : public Surface {
 public:
  explicit SmoothFieldSurface(const heightmap::ModelField& field) : field_(&field) {}
  void feet(std::span<const Vec3> points_mm, std::span<Foot> feet) const override;

 private:
  const heightmap::ModelField* field_;
};

/// p = R (scale q) + t.
struct Pose {
  RigidTransform rigid;
  double scale = 1.0;
  [[nodiscard]] Vec3 point(Vec3 q) const { return rigid.point(scale * q); }
};

/// The unknowns are all in mm: translation; rotation and scale times `arm_mm`, about
/// `centre`, so that eigenvalues of the normal matrix compare with each other.
struct Frame {
  Vec3 centre_mm;
  double arm_mm = 1.0;
};
[[nodiscard]] Pose moved(const Pose& pose, const Frame& frame, const Vector7& step);

/// Points brought to the model and what they meet there.
struct Met {
  std::vector<Vec3> points_mm;
  std::vector<Foot> feet;
};
[[nodiscard]] Met meet(std::span<const Vec3> cloud, const Pose& pose, const Surface& surface);

/// Mean and root mean square arm of the points that met the surface, and how many did.
struct Spread {
  Frame frame;
  std::size_t count = 0;
};
[[nodiscard]] Spread spread_of(const Met& met);

/// 1.4826 median |e| / sigma of the points that met the surface; NaN if none did.
[[nodiscard]] double robust_scale(const Met& met);

/// Tukey's biweight, zero beyond `limit_mm`; or Huber's, linear beyond it.
struct Loss {
  enum class Kind { huber, tukey } kind = Kind::tukey;
  double limit_mm = INFINITY;
};

/// psi(e) / e, psi(e) and psi'(e), e in standard deviations of its own.
struct Influence {
  double w, psi, slope;
};
[[nodiscard]] Influence influence(const Loss& loss, const Foot& foot);

struct Sums {
  Matrix7 weighted = Matrix7::Zero();  ///< sum of w J J', w = psi(e) / e
  Matrix7 bread = Matrix7::Zero();     ///< sum of psi'(e) J J'
  Matrix7 meat = Matrix7::Zero();      ///< sum of psi(e)^2 J J'
  Vector7 gradient = Vector7::Zero();  ///< sum of psi(e) J
  double weight = 0.0;                 ///< sum of w
  double square = 0.0;                 ///< sum of e^2
  std::size_t count = 0;               ///< points that met the surface
};
[[nodiscard]] Sums accumulate(const Met& met, const Frame& frame, const Loss& loss);
/// The same over any number of points, in chunks of fixed size joined in order.
[[nodiscard]] Sums accumulate(std::span<const Vec3> cloud, const Pose& pose, const Surface& surface,
                              const Frame& frame, const Loss& loss);

/// Scores psi(e) J summed over square blocks of x and y before they are squared; the bread goes
/// with it. `levels[k]`: 2^-k of `finest` blocks a side.
struct BlockMeat {
  std::vector<Matrix7> levels;
  std::vector<std::size_t> occupied;
};
[[nodiscard]] BlockMeat block_meat(std::span<const Vec3> cloud, const Pose& pose,
                                   const Surface& surface, const Frame& frame, const Loss& loss,
                                   const Box3& box, std::ptrdiff_t finest, int levels);

/// One point out of each of m equal stretches of the cloud, at a random place in it: a
/// fixed stride would fall into step with the scan lines.
[[nodiscard]] std::vector<Vec3> sample(std::span<const Vec3> points, std::size_t m);
/// The same of n things, by their numbers.
[[nodiscard]] std::vector<std::size_t> sample_indices(std::size_t n, std::size_t m);

/// Every 2nd node, each the [1 2 1] x [1 2 1] mean of the field below; voids are left out of
/// the mean. Node (0, 0) stays where it is.
[[nodiscard]] heightmap::ModelField coarser(const heightmap::ModelField& field);

/// Names of a null space: columns of `basis` (unknowns of `frame`, 6 or 7 rows): "translation
/// x", "rotation z", "rotation about x through (0, 10, -20)", "scale", ...
[[nodiscard]] std::vector<std::string> name_directions(const Eigen::MatrixXd& basis,
                                                       const Frame& frame);

}  // namespace maquette::scan::detail
