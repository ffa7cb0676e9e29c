// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file check.hpp
/// MAQUETTE_CHECK(condition, "format {}", value): on in every build. A failure
/// is a bug of ours: it throws CheckFailed, which the program turns into exit
/// code 4 with the values printed, so that no half-written file is left.

#include <stdexcept>
#include <string>

#include <fmt/core.h>

namespace maquette {

class CheckFailed : public std::logic_error {
 public:
  using std::logic_error::logic_error;
};

[[noreturn]] void check_failed(const char* file, int line, const char* condition,
                               const std::string& detail);

}  // namespace maquette

#define MAQUETTE_CHECK(condition, ...)                                                      \
  do {                                                                                      \
    if (!(condition))                                                                       \
      ::maquette::check_failed(__FILE__, __LINE__, #condition, ::fmt::format(__VA_ARGS__)); \
  } while (false)
