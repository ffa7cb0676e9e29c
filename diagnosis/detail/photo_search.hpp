// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Search over the library for the causes in photographs.

#include <string>
#include <vector>

#include "core/run_context.hpp"
#include "diagnosis/detail/photo_fit.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

struct PhotoCandidate {
  const Effect* effect;
  std::vector<PhotoForm> forms;
};

class PhotoSearch {
 public:
  /// @param light  mean value of the pictures
  PhotoSearch(PhotoFit& fit, const std::vector<PhotoCandidate>& candidates, double light);

  /// Adds, prunes and exchanges causes until none is worth its price; the model, fitted.
  /// @param ranking  of the first round
  [[nodiscard]] PhotoMembers choose(std::vector<Ranked>& ranking, const RunContext& run);
  /// Other causes that do as well in the place of the k-th. @param gain  what it gains there
  [[nodiscard]] std::vector<std::string> equivalents(const PhotoMembers& members, std::size_t k,
                                                     double& gain,
                                                     std::vector<Rejected>& ruled_out);

 private:
  /// A form beside a model, to first order.
  struct Trial {
    std::size_t candidate, form;
    double score;  ///< in -2 log likelihood less the price
    double gain;
    std::vector<double> values;
  };
  /// What each form would gain beside a model, best first; of a cause that the model has, what a
  /// form with more parameters would gain in its place.
  [[nodiscard]] std::vector<Trial> trials(const PhotoLinear& linear, const PhotoMembers& members,
                                          const std::vector<int>& sets) const;
  /// The model with a trial's form, fitted.
  [[nodiscard]] PhotoMembers with(const PhotoMembers& members, const Trial& t);
  /// Likelihood and price of a fitted model on the choosing blocks; less is better.
  [[nodiscard]] double score(const PhotoMembers& members);
  /// The same with its pictures rendered anew as a whole, edges and all.
  [[nodiscard]] double whole_score(const PhotoMembers& members);
  /// To first order: what would not be confirmed is not worth a rendering.
  [[nodiscard]] bool too_small(const PhotoLinear& linear, PhotoMembers members,
                               PhotoMember added) const;
  /// Beside other causes, a blur that none of them is and that slopes smooth between nodes make up
  /// for: with slopes of each kind, which become those of the pictures. Empty: none is much better
  /// than `now`.
  PhotoMembers blurred(const PhotoMembers& members, double now, const RunContext& run);
  /// The closest candidates rendered; empty: none does better than `now`.
  PhotoMembers best_of(const std::vector<Trial>& all, const PhotoLinear& linear,
                       const PhotoMembers& members, double now);
  /// Members that are not worth their price to the others go.
  PhotoMembers pruned(PhotoMembers members);
  /// Each in turn makes way for another cause that leaves less in its place.
  PhotoMembers exchanged(PhotoMembers members, const RunContext& run);

  PhotoFit& fit_;
  const std::vector<PhotoCandidate>& candidates_;
  std::vector<const PhotoParameter*> parameters_;
  double light_;
};

}  // namespace maquette::diagnosis::detail
