// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/dsnu.hpp"

#include "camera/effects/noise.hpp"

namespace maquette::camera {

Result<void> check(const Dsnu& e, const Shot&) {
  return in_range("dsnu", "sigma_e", e.sigma_e, 0.0, 1e6);
}

RowFunction rows(const Dsnu& e, const Shot& shot, const Frame&) {
  return added_normal(fixed_pattern(shot, Dsnu::kInfo.name), e.sigma_e);
}

}  // namespace maquette::camera
