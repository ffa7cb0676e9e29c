// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/set_aside.hpp"

#include <algorithm>
#include <charconv>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "core/files.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;

/// The number after the prefix; 0 if there is none.
std::size_t number_of(const std::string& name, const std::string& prefix) {
  std::size_t number = 0;
  if (name.starts_with(prefix))
    std::from_chars(name.data() + prefix.size(), name.data() + name.size(), number);
  return number;
}

}  // namespace

Result<void> set_aside_beyond(const fs::path& folder, const std::string& prefix, std::size_t parts,
                              const RunContext& run) {
  std::error_code ec;
  std::vector<fs::path> names;
  for (fs::directory_iterator entry(folder, ec), end; !ec && entry != end; entry.increment(ec))
    if (entry->is_regular_file(ec) && number_of(entry->path().filename().string(), prefix) > parts)
      names.push_back(entry->path().filename());
  if (names.empty()) return {};
  std::sort(names.begin(), names.end());
  fs::path aside;
  for (int k = 1; aside.empty() || fs::exists(aside, ec); ++k)
    aside = folder / fmt::format("earlier_{}", k);
  fs::create_directory(aside, ec);
  if (ec) return tl::unexpected(write_error(aside, ec.value()));
  for (const fs::path& name : names) {
    fs::rename(folder / name, aside / name, ec);
    if (ec) return tl::unexpected(write_error(aside / name, ec.value()));
  }
  run.warn(
      fmt::format("{} has now {} part{}; {} file{} of an earlier run with more, from {} to {}, "
                  "{} now in {}",
                  folder.string(), parts, parts == 1 ? "" : "s", names.size(),
                  names.size() == 1 ? "" : "s", names.front().string(), names.back().string(),
                  names.size() == 1 ? "is" : "are", aside.string()));
  return {};
}

}  // namespace maquette::tools
