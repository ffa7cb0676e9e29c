// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file browser.hpp
/// Pages looked at by a real browser, without a window.

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"

namespace maquette::testing_support {

/// Its command; nothing where none is installed.
inline std::optional<std::string> browser() {
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
    if (std::system(fmt::format("command -v {} >/dev/null 2>&1", name).c_str()) == 0) return name;
  return std::nullopt;
}

/// What a script of the page has put into an element with id "told"; expects that nothing is said
/// on the console but that the test reads the canvas.
/// @param size    of the window, "1200,900"
/// @param folder  for the browser's own files
inline std::string told_by(const std::filesystem::path& page, const std::string& size,
                           const std::filesystem::path& folder) {
  const auto dom = folder / "dom.html", said = folder / "said.txt";
  const int status = std::system(
      fmt::format("timeout 100 {} --headless --no-sandbox --use-gl=angle --use-angle=swiftshader "
                  "--enable-unsafe-swiftshader --window-size={} --user-data-dir='{}' "
                  "--virtual-time-budget=8000 --enable-logging=stderr --dump-dom 'file://{}' "
                  ">'{}' 2>'{}'",
                  *browser(), size, (folder / "profile").string(), page.string(), dom.string(),
                  said.string())
          .c_str());
  EXPECT_EQ(status, 0) << *read_file(said);
  std::istringstream lines(*read_file(said));
  for (std::string line; std::getline(lines, line);) {
    if (line.find("CONSOLE") == std::string::npos) continue;
    EXPECT_THAT(line, testing::HasSubstr("GPU stall due to ReadPixels"));
  }
  const std::string text = *read_file(dom), mark = "id=\"told\">";
  const std::size_t at = text.find(mark);
  EXPECT_NE(at, std::string::npos) << "the page's script did not come to its end";
  if (at == std::string::npos) return {};
  return text.substr(at + mark.size(), text.find("</pre>", at) - at - mark.size());
}

}  // namespace maquette::testing_support
