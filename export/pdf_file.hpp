// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pdf_file.hpp
/// A PDF file drawn by Cairo (1.16); it puts subsets of the fonts into the file.

#include <filesystem>
#include <functional>
#include <string>

#include "core/result.hpp"

extern "C" {
typedef struct _cairo cairo_t;
}

namespace maquette::exporting {

/// A point of PDF, 1/72 inch.
inline constexpr double kPointsPerMm = 72.0 / 25.4;

/// The same bytes each time (no date), whole or not at all.
/// @param draw  gets a page of that size, y downwards in points; cairo_show_page ends each page
/// @return CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL
[[nodiscard]] Result<void> write_pdf_file(const std::filesystem::path& out,
                                          const std::string& title, double width_pt,
                                          double height_pt,
                                          const std::function<void(cairo_t*)>& draw);

}  // namespace maquette::exporting
