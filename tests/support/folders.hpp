// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Where things are on this machine. Known to folders.cpp alone: whatever else had these paths in
// it would be compiled anew in every checkout.

#include <filesystem>

namespace maquette::testing_support {

/// The checkout.
[[nodiscard]] std::filesystem::path source_folder();
/// The program under test.
[[nodiscard]] std::filesystem::path maquette_program();
/// Real data, no part of the project: MAQUETTE_DATA, else shared/data beside the checkout. It may
/// not be there.
[[nodiscard]] std::filesystem::path data_folder();

}  // namespace maquette::testing_support
