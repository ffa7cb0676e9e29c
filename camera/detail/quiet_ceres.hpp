// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file quiet_ceres.hpp
/// Ceres writes its warnings to standard error; what went wrong comes back in its summary, and
/// rooms neither print nor log.

#include <glog/logging.h>

namespace maquette::camera::detail {

inline void quiet_ceres() {
  FLAGS_minloglevel = google::GLOG_FATAL;
}

}  // namespace maquette::camera::detail
