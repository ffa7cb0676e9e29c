// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/read_noise.hpp"

#include "camera/effects/noise.hpp"

namespace maquette::camera {

Result<void> check(const ReadNoise& e, const Shot&) {
  return in_range("read_noise", "sigma_e", e.sigma_e, 0.0, 1e6);
}

RowFunction rows(const ReadNoise& e, const Shot& shot, const Frame&) {
  return added_normal(temporal_noise(shot, ReadNoise::kInfo.name), e.sigma_e);
}

}  // namespace maquette::camera
