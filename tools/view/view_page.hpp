// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file view_page.hpp
/// The page of `maquette view` as Vite has built it from view/, inside the program.

#include <span>
#include <string_view>

namespace maquette::tools {

struct PageFile {
  std::string_view name;  ///< "index.html", "assets/index-....js"
  std::string_view bytes;
};
/// Empty where the program was built without node or its packages (tools/setup --web).
[[nodiscard]] std::span<const PageFile> view_page();

}  // namespace maquette::tools
