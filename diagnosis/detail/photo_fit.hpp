// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Models of photographs fitted to pixels.

#include <array>
#include <map>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "diagnosis/detail/photo_views.hpp"
#include "diagnosis/detail/sums.hpp"
#include "diagnosis/effect.hpp"

namespace maquette::diagnosis::detail {

struct PhotoMember {
  const Effect* effect = nullptr;
  PhotoForm form;
  std::vector<double> values;  ///< of the form's parameters
};
using PhotoMembers = std::vector<PhotoMember>;

/// Noise of values, beside what is declared.
struct PhotoNoise {
  double factor = 1.0;  ///< of variance
  double over = 1.0;    ///< by which sums over pixels vary more than independent ones
};

/// Pixels about a rendered model, over their noise as declared.
struct PhotoLinear {
  std::map<std::string, Eigen::Index> index;  ///< of a parameter's key
  Eigen::MatrixXf columns;                    ///< pixels x parameters
  Eigen::VectorXf residual;                   ///< measured less rendered
  Eigen::VectorXf sigma;                      ///< what both were divided by
  std::vector<int> set;                       ///< kChoose .. kReport; -1: none
  std::vector<std::uint32_t> cell;
  std::array<Eigen::MatrixXd, kSets> gram;  ///< of parameters and, last, residual; Huber's weights
  [[nodiscard]] std::vector<int> of(const PhotoForm& form) const;
  [[nodiscard]] Eigen::MatrixXd sum(const std::vector<int>& sets) const;
};

class PhotoFit {
 public:
  PhotoFit(PhotoViews& views, const Layout& layout) : views_(views), layout_(layout) {}
  Normals normals = Normals::smooth;
  PhotoNoise noise;
  PhotoMembers known;  ///< in every model, not fitted

  /// Renders from now on those sets alone, which is a third of the work for one; empty: all.
  /// @pre a model was rendered
  void look_at(const std::vector<int>& sets);
  /// Renders a model and takes derivatives by `parameters`.
  /// @param whole  false: as PhotoViews::render without derivatives
  [[nodiscard]] PhotoLinear about(const PhotoMembers& model,
                                  const std::vector<const PhotoParameter*>& parameters,
                                  bool whole = true);
  /// Gauss and Newton on all sets. @return the values
  [[nodiscard]] PhotoMembers fitted(PhotoMembers model, int rounds = 6);
  /// Facets, patches or smooth slopes: what no cause makes, differences of neighbouring pixels
  /// beside a model fitted to each, decides.
  /// @param of_its_kind  smooth slopes stay smooth, patches and facets what they are: blurred, the
  ///   ones look like the others
  /// @return the model as fitted to those
  PhotoMembers settle_normals(const PhotoMembers& model, bool of_its_kind = false);
  /// -2 log likelihood (Huber's loss) of what a rendered model leaves.
  [[nodiscard]] double objective(const PhotoLinear& linear, const std::vector<int>& sets) const;
  /// The same of a model, rendered.
  [[nodiscard]] double objective(const PhotoMembers& model, const std::vector<int>& sets);
  /// Noise from what all of `linear`'s columns together leave.
  [[nodiscard]] PhotoNoise noise_of(const PhotoLinear& linear) const;
  [[nodiscard]] double over_of(const PhotoLinear& linear, const Eigen::VectorXf& residual,
                               Eigen::Index column) const;
  [[nodiscard]] const PhotoViews& views() const { return views_; }
  /// What is declared with the known and these causes.
  [[nodiscard]] PhotoState state_of(const PhotoMembers& members) const;

 private:
  PhotoViews& views_;
  const Layout& layout_;
};

/// What a form's columns gain beside a model's, in units of the declared noise.
/// @param allowed  false: its first parameter would have the wrong sign
[[nodiscard]] double gain_of(const Eigen::MatrixXd& gram, const std::vector<int>& model,
                             const std::vector<int>& form, int sign, Eigen::VectorXd* values);

/// Differences between neighbouring pixels against what full well and read noise say.
struct PhotoScatter {
  double factor = 1.0, sigma = 1.0;  ///< of the noise (not its variance), its standard error
  /// Of the third of the pixels that scatter least as declared, and of those that do most: read
  /// noise tells in the dark, shot noise in the light.
  double dark = 1.0, light = 1.0, sigma_of_third = 1.0;
  /// What one pixel has beside the model, where its neighbours differ by `factor`.
  double own = 1.0;
  /// How far the farthest of the three is from 1, less four of its standard errors.
  [[nodiscard]] double off() const;
};
[[nodiscard]] PhotoScatter scatter_of(const PhotoViews& views);

}  // namespace maquette::diagnosis::detail
