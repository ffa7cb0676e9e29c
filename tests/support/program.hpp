// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file program.hpp
/// Runs the program as a user would.

#include <array>
#include <cstdio>
#include <filesystem>
#include <string>

#include <fmt/format.h>
#include <sys/wait.h>

#include "support/folders.hpp"

namespace maquette::testing_support {

struct Outcome {
  int exit_code = -1;
  std::string out, err;
};

inline std::string slurp(const std::filesystem::path& path) {
  std::string text;
  if (std::FILE* f = std::fopen(path.c_str(), "rb")) {
    std::array<char, 65536> buffer{};
    for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), f)) > 0;)
      text.append(buffer.data(), n);
    std::fclose(f);
  }
  return text;
}

/// @param arguments  as typed in a shell
/// @param before     shell text in front of the program, e.g. "VAR=x" or "cd /tmp &&"
inline Outcome run_program(const std::filesystem::path& scratch, const std::string& arguments,
                           const std::string& before = "") {
  const auto out = scratch / ".stdout", err = scratch / ".stderr";
  const int status =
      std::system(fmt::format("{} '{}' {} >'{}' 2>'{}' </dev/null", before,
                              maquette_program().string(), arguments, out.string(), err.string())
                      .c_str());
  Outcome outcome{WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), slurp(out),
                  slurp(err)};
  std::filesystem::remove(out);
  std::filesystem::remove(err);
  return outcome;
}

}  // namespace maquette::testing_support
