// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What members of a model of photographs move and earn, and whether that holds elsewhere.

#include <string>
#include <vector>

#include <Eigen/Dense>

#include "diagnosis/detail/photo_fit.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// What moves the picture less, rms of full scale over its mean, is not told from what the
/// rendering itself may be wrong by.
inline constexpr double kPhotoFloor = 1e-3;

/// Of places on the part: a form with many parameters, all of them factors on its light.
[[nodiscard]] bool is_map(const PhotoForm& form);
[[nodiscard]] std::vector<const PhotoParameter*> parameters_of(const PhotoMembers& members);
/// Columns of all members but one. @param but  SIZE_MAX: of all
[[nodiscard]] std::vector<int> columns_of(const PhotoLinear& linear, const PhotoMembers& members,
                                          std::size_t but = SIZE_MAX);
[[nodiscard]] PhotoMembers without(PhotoMembers members, std::size_t k);
/// rms of what a member moves, of full scale.
[[nodiscard]] double moved_by(const PhotoLinear& linear, const PhotoMember& member);
/// Share of what a member moves (its rms) that the others could not move in its place.
[[nodiscard]] double own_share(const PhotoLinear& linear, const PhotoMembers& members,
                               std::size_t k);
/// Whether it is large enough to be told from what a rendering may be wrong by (PhotoForm::least).
/// A blur by distance is none where the lens is in focus: it counts where it is widest.
/// @param share  of what is needed
[[nodiscard]] bool is_large_enough(const PhotoFit& fit, const PhotoMember& member, double share);
/// By how much what the others move, rms, may be wrong in a way that could be taken for a member.
[[nodiscard]] double others_wrong(const PhotoFit& fit, const PhotoLinear& linear,
                                  const PhotoMembers& members, std::size_t but);
/// What the k-th earns where `g` was summed, with all others refitted there.
/// @param held  its values, of elsewhere; null: the best there
[[nodiscard]] double worth_of(const PhotoFit& fit, const Eigen::MatrixXd& g,
                              const PhotoLinear& linear, const PhotoMembers& members, std::size_t k,
                              const Eigen::VectorXd* held = nullptr);
/// Values of the k-th's parameters and their standard errors beside all others.
[[nodiscard]] std::vector<Estimate> sizes_of(const PhotoLinear& linear, const PhotoFit& fit,
                                             const PhotoMembers& members, std::size_t k);
/// Those that hold on other blocks and are large enough. What holds and is no more than a rendering
/// may be wrong by gets no name, but stays in the model (fit.known): the others, and what is left,
/// are judged beside it.
/// @param light  mean value of the pictures
/// @param p_values  of those that stay
[[nodiscard]] PhotoMembers confirmed(PhotoMembers members, PhotoFit& fit, double light,
                                     std::vector<double>& p_values,
                                     std::vector<Rejected>& rejected);

}  // namespace maquette::diagnosis::detail
