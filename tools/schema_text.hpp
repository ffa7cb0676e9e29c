// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file schema_text.hpp
/// A TOML text that is not in a file (presets that travel inside the program), read as
/// Schema::read() reads files.

#include "tools/schema.hpp"

namespace maquette::tools {

/// @param place   what messages call it
/// @param folder  of relative paths
/// @return as Schema::read()
[[nodiscard]] Result<void> read_schema_text(Schema& schema, const std::string& text,
                                            const std::string& place,
                                            const std::filesystem::path& folder,
                                            const std::vector<std::string>& overrides = {});

}  // namespace maquette::tools
