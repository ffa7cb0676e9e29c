// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file view_files.hpp
/// Which file of a folder a request may have, and what a browser is told about it.

#include <filesystem>
#include <optional>
#include <string_view>

namespace maquette::tools {

/// The regular file that a request's path names, below `root` and nowhere else.
/// @param root  canonical (std::filesystem::canonical)
/// @param path  as a URL has it after its escapes were undone once, without the leading slash
/// @return nothing for what is not there, is no regular file, begins with a dot anywhere (also
///         "..") or lies outside of root once symbolic links are followed
[[nodiscard]] std::optional<std::filesystem::path> file_below(const std::filesystem::path& root,
                                                              std::string_view path);

/// By extension; application/octet-stream for what is not known.
[[nodiscard]] const char* mime_type(const std::filesystem::path& file);

}  // namespace maquette::tools
