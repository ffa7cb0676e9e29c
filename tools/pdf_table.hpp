// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pdf_table.hpp
/// Tables on a page: as wide as their widest cells; where that is too much smaller letters, then
/// broken lines, then several tables that begin with the same column. A head stays with its first
/// rows and is printed again on the next page.

#include "tools/document.hpp"
#include "tools/pdf_page.hpp"

namespace maquette::tools {

void print_table(PdfPage& page, const Table& table);
/// Points that its head and first two rows take: what leads to it stays with these.
[[nodiscard]] double high_of_start(PdfPage& page, const Table& table);

}  // namespace maquette::tools
