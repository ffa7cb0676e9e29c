// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file zip_times.hpp
/// Takes the clock out of a ZIP archive, so that the same model gives the same bytes.

#include <filesystem>

#include "core/result.hpp"

namespace maquette::exporting {

/// Sets the time of every entry (central directory and local header) to 1980-01-01,
/// the zero of the format (APPNOTE 6.3, sections 4.3.7, 4.3.12, 4.3.16; ZIP64
/// archives too). EXPORT_LIBRARY_FAILED if the file has no central directory.
[[nodiscard]] Result<void> set_zip_times(const std::filesystem::path& path);

}  // namespace maquette::exporting
