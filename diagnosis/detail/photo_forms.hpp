// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What the files of diagnosis/effects that act on photographs share.

#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "diagnosis/detail/forms.hpp"
#include "diagnosis/photo_chain.hpp"

namespace maquette::diagnosis::detail {

/// A plain number of the state, its derivative between -step and step.
[[nodiscard]] inline PhotoParameter number(std::string key, std::string name, double step,
                                           double PhotoState::*member) {
  return {std::move(key), std::move(name),
          [step](const PhotoState&, const PhotoScene&) {
            return std::pair{-step, step};
          },
          [member](PhotoState& s, double v) { s.*member += v; }};
}
[[nodiscard]] inline double root(double variance) {
  return std::sqrt(std::fmax(0.0, variance));
}

}  // namespace maquette::diagnosis::detail
