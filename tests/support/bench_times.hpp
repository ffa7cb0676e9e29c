// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file bench_times.hpp
/// What a benchmark has used so far: seconds by the clock and of all threads' processors (user and
/// system; the machine may have other work), and the most memory.

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>

namespace maquette::testing_support {

/// @param whose  RUSAGE_CHILDREN: of programs that have ended
inline rusage used_so_far(int whose = RUSAGE_SELF) {
  rusage u{};
  ::getrusage(whose, &u);
  return u;
}

inline double cpu_seconds(int whose = RUSAGE_SELF) {
  const rusage u = used_so_far(whose);
  return static_cast<double>(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

struct Times {
  double wall = 0.0, cpu = 0.0;  ///< seconds
};
inline Times now() {
  const auto wall = std::chrono::steady_clock::now().time_since_epoch();
  return {std::chrono::duration<double>(wall).count(), cpu_seconds()};
}

/// What a program took, and how it ended: as std::system says.
struct Outside {
  Times times;
  int status = 0;
};
inline Outside run_outside(const std::string& command) {
  const double cpu = cpu_seconds(RUSAGE_CHILDREN), wall = now().wall;
  const int status = std::system(command.c_str());
  return {{now().wall - wall, cpu_seconds(RUSAGE_CHILDREN) - cpu}, status};
}

/// The most that the process has held.
inline double peak_mib() {
  return static_cast<double>(used_so_far().ru_maxrss) / 1024.0;
}

/// Runs a case in a process of its own, so that its peak of memory is its own, too. Before any
/// thread is started.
inline void in_its_own_process(const std::function<void()>& work) {
  std::fflush(stdout);
  const pid_t child = ::fork();
  if (child == 0) {
    work();
    std::fflush(stdout);
    ::_exit(0);
  }
  int status = 0;
  if (child < 0 || ::waitpid(child, &status, 0) != child || status != 0)
    std::puts("  (this case failed)");
}

}  // namespace maquette::testing_support
