// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file run_context.hpp
/// Everything a long function may say while it works, and how it is told to
/// stop. The default is silent and never stops, so tests pass nothing.

#include <functional>
#include <stop_token>
#include <string>

namespace maquette {

struct RunContext {
  std::stop_token stop;  ///< polled at least every second by long work; then kCancelled

  /// Share of the current piece of work that is done, 0 to 1. May be called from
  /// any thread; the receiver is thread-safe and cheap.
  std::function<void(double)> progress = [](double) {};

  /// Something a person should know although the work goes on.
  std::function<void(const std::string&)> warn = [](const std::string&) {};

  [[nodiscard]] bool stopped() const { return stop.stop_requested(); }
};

}  // namespace maquette
