// SPDX-License-Identifier: GPL-3.0-or-later
#include "support/folders.hpp"

#include <cstdlib>

namespace maquette::testing_support {

std::filesystem::path source_folder() {
  return MAQUETTE_SOURCE;
}

std::filesystem::path maquette_program() {
  return MAQUETTE_PROGRAM;
}

std::filesystem::path data_folder() {
  if (const char* folder = std::getenv("MAQUETTE_DATA")) return folder;
  return source_folder().parent_path() / "shared" / "data";
}

}  // namespace maquette::testing_support
