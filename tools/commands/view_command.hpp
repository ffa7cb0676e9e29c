// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "tools/commands/commands.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kViewPage{"TOOLS_VIEW_PAGE_MISSING", ErrorKind::environment};

Command add_view(CLI::App& root, const CommonOptions& common);

}  // namespace maquette::tools
