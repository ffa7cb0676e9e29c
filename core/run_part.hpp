// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/run_context.hpp"

namespace maquette {

/// A piece of `run`'s work, whose progress is that from `from` to `to`. `run` must outlive it.
[[nodiscard]] inline RunContext part(const RunContext& run, double from, double to) {
  RunContext some = run;
  some.progress = [&run, from, to](double share) { run.progress(from + share * (to - from)); };
  return some;
}

}  // namespace maquette
