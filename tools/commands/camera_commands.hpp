// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file camera_commands.hpp
/// Verbs of lens and sensor (commands.hpp has the others).

#include "tools/commands/commands.hpp"

namespace maquette::tools {

Command add_expose(CLI::App& root, const CommonOptions& common);
Command add_calibrate(CLI::App& root, const CommonOptions& common);
Command add_match(CLI::App& root, const CommonOptions& common);
Command add_sheet(CLI::App& root, const CommonOptions& common);
Command add_stack(CLI::App& root, const CommonOptions& common);

}  // namespace maquette::tools
