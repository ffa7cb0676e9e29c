// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file matchers.hpp
/// The vocabulary of the tests.

#include <filesystem>
#include <string>

#include <gmock/gmock.h>

#include "core/files.hpp"
#include "core/result.hpp"

namespace maquette::testing_support {

/// EXPECT_THAT(mill(...), FailsWith(kToolNotPositive));
MATCHER_P(FailsWith, code, std::string("fails with ") + std::string(code.name)) {
  if (arg.has_value()) {
    *result_listener << "but it succeeded";
    return false;
  }
  *result_listener << "got " << arg.error().code.name << ": " << arg.error().message;
  return arg.error().code == code;
}

/// EXPECT_THAT(read_mesh(path), FailsSaying(kMeshFormat, "line 2: "));
MATCHER_P2(FailsSaying, code, text,
           std::string("fails with ") + std::string(code.name) + ": ..." + text) {
  if (arg.has_value()) {
    *result_listener << "but it succeeded";
    return false;
  }
  *result_listener << "got " << arg.error().code.name << ": " << arg.error().message;
  return arg.error().code == code && arg.error().message.find(text) != std::string::npos;
}

/// EXPECT_THAT(read_model_field(path), Succeeds());
MATCHER(Succeeds, "succeeds") {
  if (!arg.has_value())
    *result_listener << "got " << arg.error().code.name << ": " << arg.error().message;
  return arg.has_value();
}

/// A folder that is empty at the start of the test and gone at its end.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "maquette-test-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] std::filesystem::path operator/(std::string_view name) const {
    return path_ / name;
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace maquette::testing_support
