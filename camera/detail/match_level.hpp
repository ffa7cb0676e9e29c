// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file match_level.hpp
/// Photographs in one size beside their renderings: residuals, weights, derivatives.

#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "camera/detail/match_unknowns.hpp"

namespace maquette::camera::detail {

/// Residuals over their scatter, and what they say.
struct NormalEquations {
  Eigen::MatrixXd normal, bread;  ///< weighted squares of derivatives; of residuals inside the loss
  Eigen::VectorXd gradient;       ///< what a step should be, times `normal`
  double cost = 0.0;
  std::size_t values = 0;  ///< that count
  /// How much a step would change pictures, root mean square over what is left of a value.
  [[nodiscard]] double change_by(const Eigen::VectorXd& step) const {
    return std::sqrt(step.dot(normal * step) / static_cast<double>(values));
  }
};
/// Sums of scores squared: with neighbouring cells, and of single values.
struct ScoreSums {
  Eigen::MatrixXd of_cells, of_values;
  std::size_t values = 0;
  std::size_t cells = 0;
};

class MatchLevel {
 public:
  /// @param factor  pixels of a photograph across one of this size
  MatchLevel(const PreparedScene& scene, const std::vector<MatchPhoto>& photos,
             const Unknowns& unknowns, RenderOptions render, int factor);

  /// Renders the state with what derivatives need, and weighs pixels by what is left.
  /// @return what render() returns; CAMERA_MATCH_PHOTOGRAPH: too little to see
  [[nodiscard]] Result<void> stand_at(const MatchState& state, const RunContext& run);
  /// At the state stood at.
  [[nodiscard]] NormalEquations equations() const;
  [[nodiscard]] ScoreSums scores() const;
  /// Of another state, weighed as at the one stood at.
  [[nodiscard]] Result<double> cost(const MatchState& state, const RunContext& run) const;
  /// 1.4826 medians of what is left; by photograph how alike it is to its rendering (Pearson).
  [[nodiscard]] double scatter() const;
  [[nodiscard]] std::vector<double> likeness() const;

 private:
  struct Shown {
    std::vector<Grid<float>> light;
    Grid<std::uint8_t> usable;
    CameraModel camera;
    // Of the state stood at.
    Image image, brighter;
    std::array<Image, 3> lamp_minus, lamp_plus;
    Grid<float> weight;              ///< 0: left out
    std::vector<Grid<float>> sigma;  ///< by band
  };
  [[nodiscard]] Result<Image> picture(std::size_t photo, const MatchState& state,
                                      const RenderOptions& render, const RunContext& run) const;
  [[nodiscard]] double rendered(const Shown& s, const Image& image, std::size_t band,
                                std::size_t i) const;
  [[nodiscard]] double factor(std::size_t photo, std::size_t band, const MatchState& state) const;
  [[nodiscard]] Result<void> mask(std::size_t photo);
  void weigh();
  /// Of one value by what the photograph depends on.
  [[nodiscard]] Eigen::Matrix<double, kOwn, 1> derivative(std::size_t photo, std::size_t band,
                                                          std::ptrdiff_t r, std::ptrdiff_t c) const;
  /// each(photo, row, column, band, residual) of all that counts.
  template <class Each>
  void over_values(const Each& each) const;

  const PreparedScene& scene_;
  const std::vector<MatchPhoto>& photos_;
  const Unknowns& unknowns_;
  RenderOptions render_, differing_;  ///< of pictures whose differences are derivatives
  double lamp_step_mm_ = 1.0;
  MatchState state_;
  std::vector<Shown> shown_;
};

/// Of a photograph's width, so that what is left is no wider than wanted.
[[nodiscard]] int factor_for(int width_px, int wanted_px);

}  // namespace maquette::camera::detail
