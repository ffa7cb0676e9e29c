// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file figures_of_a_process.hpp
/// Figures that a case of a benchmark has found in a process of its own.

#include <sys/mman.h>

#include <array>
#include <functional>
#include <new>

#include "support/bench_times.hpp"

namespace maquette::testing_support {

/// NaN for all of them if the case failed. As in_its_own_process: before any thread is started.
template <std::size_t kCount>
std::array<double, kCount> figures_of_its_own_process(
    const std::function<std::array<double, kCount>()>& work) {
  using Figures = std::array<double, kCount>;
  void* const page =
      ::mmap(nullptr, sizeof(Figures), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  Figures out;
  out.fill(__builtin_nan(""));
  if (page == MAP_FAILED) return out;
  auto* const shared = new (page) Figures(out);
  in_its_own_process([&] { *shared = work(); });
  out = *shared;
  ::munmap(page, sizeof(Figures));
  return out;
}

}  // namespace maquette::testing_support
