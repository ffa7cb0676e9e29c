// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file set_aside.hpp
/// Parts of an earlier run that this one does not make: nobody takes them for its own, and nobody
/// loses them.

#include <cstddef>
#include <filesystem>
#include <string>

#include "core/result.hpp"
#include "core/run_context.hpp"

namespace maquette::tools {

/// Files PREFIX05*, PREFIX06* ... with numbers beyond `parts` go to FOLDER/earlier_1, or the next
/// number that is free; run.warn says which. Nothing where there are none.
/// CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL
[[nodiscard]] Result<void> set_aside_beyond(const std::filesystem::path& folder,
                                            const std::string& prefix, std::size_t parts,
                                            const RunContext& run);

}  // namespace maquette::tools
