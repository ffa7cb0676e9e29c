// SPDX-License-Identifier: GPL-3.0-or-later

// docs/errors.md lists every code that a header declares, with its exit code, and no
// other; and a test somewhere names each code's constant or its text.

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/folders.hpp"

namespace {

namespace fs = std::filesystem;

std::string slurp(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

std::string all_of(const std::set<std::string>& folders, const std::set<std::string>& extensions) {
  std::string text;
  for (const std::string& folder : folders)
    for (const auto& e :
         fs::recursive_directory_iterator(maquette::testing_support::source_folder() / folder))
      if (extensions.contains(e.path().extension().string())) text += slurp(e.path());
  return text;
}

struct Declared {
  std::string constant;
  int exit_code = 2;
};

std::map<std::string, Declared> declared() {
  const std::string text = all_of({"core", "heightmap", "assets", "meshing", "cnc", "export",
                                   "camera", "scan", "diagnosis", "tools"},
                                  {".hpp", ".cpp"});
  const std::regex pattern(
      R"re(ErrorCode\s+(k\w+)\s*\{\s*"([A-Z0-9_]+)"\s*(?:,\s*ErrorKind::(\w+)\s*)?\})re");
  const std::map<std::string, int> exit_codes{
      {"", 2}, {"tolerance", 1}, {"bad_input", 2}, {"environment", 3}, {"internal", 4}};
  std::map<std::string, Declared> codes;
  for (std::sregex_iterator m(text.begin(), text.end(), pattern), end; m != end; ++m)
    codes[(*m)[2]] = {(*m)[1], exit_codes.at((*m)[3])};
  return codes;
}

TEST(ErrorCodes, AreAllDocumentedWithTheirExitCode) {
  const std::string doc = slurp(maquette::testing_support::source_folder() / "docs" / "errors.md");
  std::map<std::string, int> documented;
  const std::regex row(R"re(\n\| ([A-Z][A-Z0-9_]+) \| (\d) \|)re");
  for (std::sregex_iterator m(doc.begin(), doc.end(), row), end; m != end; ++m)
    documented[(*m)[1]] = std::stoi((*m)[2]);
  std::map<std::string, int> expected;
  for (const auto& [name, code] : declared()) expected[name] = code.exit_code;
  EXPECT_EQ(documented, expected);
  EXPECT_GT(expected.size(), 50U) << "the declarations were not found";
}

TEST(ErrorCodes, AreEachNamedByATest) {
  const std::string tests = all_of({"tests"}, {".cpp"});
  std::set<std::string> words;
  const std::regex word(R"re(\w+)re");
  for (std::sregex_iterator m(tests.begin(), tests.end(), word), end; m != end; ++m)
    words.insert(m->str());
  // Our own bug, and a library that does not start, have no input that reaches them.
  const std::set<std::string> unreachable{"TOOLS_MESH_CHECK_FAILED", "SCAN_EMBREE_FAILED"};
  for (const auto& [name, code] : declared()) {
    const bool named = words.contains(name) || words.contains(code.constant);
    EXPECT_TRUE(named || unreachable.contains(name)) << name << " (" << code.constant << ")";
  }
}

}  // namespace
