// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file single_page.hpp
/// The page of `maquette view` as one file that needs no server.

#include <span>
#include <string>
#include <string_view>

#include "tools/view/view_page.hpp"

namespace maquette::tools {

/// The page with style, program and licences in it. Anything that the page's text asks of a server
/// is taken out; a policy lets it load nothing.
/// @param carried  what stands before the page's end
[[nodiscard]] std::string single_page(std::span<const PageFile> page, std::string_view carried);

}  // namespace maquette::tools
