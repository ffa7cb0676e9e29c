// SPDX-License-Identifier: GPL-3.0-or-later

// core/files.hpp:
//   sha256 is SHA-256 ................ published vectors (FIPS 180-4 examples)
//   a file appears whole or not ...... dropped writer, folder missing, full device
//   the old file survives a failure .. content compared

#include "core/files.hpp"

#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "support/matchers.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(Sha256, MatchesPublishedVectors) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Sha256, OfAFileIsThatOfItsContent) {
  const ScratchFolder folder;
  const std::string text(3'000'000, 'a');
  ASSERT_TRUE(write_file(folder / "a.txt", text));
  EXPECT_EQ(sha256_file(folder / "a.txt").value(), sha256(text));
  EXPECT_THAT(sha256_file(folder / "none"), FailsWith(kFileNotFound));
}

TEST(AtomicFile, RewritesWhatItHasWritten) {
  const ScratchFolder folder;
  auto file = AtomicFile::create(folder / "a");
  ASSERT_TRUE(file);
  file->write("count=???? ");
  file->write(std::string(3'000'000, 'x'));  // beyond any buffer
  file->rewrite(6, "1234");
  file->write("end");
  ASSERT_THAT(file->commit(), Succeeds());
  EXPECT_EQ(content(folder / "a"), "count=1234 " + std::string(3'000'000, 'x') + "end");
}

TEST(AtomicFile, ThatIsDroppedLeavesNothing) {
  const ScratchFolder folder;
  {
    auto file = AtomicFile::create(folder / "a.txt");
    ASSERT_TRUE(file);
    file->write("half");
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(AtomicFile, ReplacesOnlyOnCommit) {
  const ScratchFolder folder;
  ASSERT_TRUE(write_file(folder / "a.txt", "old"));
  auto file = AtomicFile::create(folder / "a.txt");
  ASSERT_TRUE(file);
  file->write("new");
  EXPECT_EQ(content(folder / "a.txt"), "old");
  ASSERT_TRUE(file->commit());
  EXPECT_EQ(content(folder / "a.txt"), "new");
}

TEST(AtomicFile, SaysWhichFolderIsMissing) {
  const auto file = AtomicFile::create("/nonexistent/folder/a.txt");
  ASSERT_THAT(file, FailsWith(kFileNotWritable));
  EXPECT_THAT(file.error().message, testing::HasSubstr("/nonexistent/folder/a.txt"));
}

TEST(AtomicPath, RemovesThePartialFileUnlessCommitted) {
  const ScratchFolder folder;
  {
    const AtomicPath partial(folder / "a.tif");
    EXPECT_EQ(partial.path().extension(), ".tif");
    std::ofstream(partial.path()) << "half";
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(ReadFile, RefusesFoldersAndWhatIsTooLarge) {
  const ScratchFolder folder;
  ASSERT_TRUE(write_file(folder / "a.txt", "12345"));
  EXPECT_THAT(read_file(folder.path()), FailsWith(kFileNotReadable));
  EXPECT_THAT(read_file(folder / "a.txt", 4), FailsWith(kFileTooLarge));
  EXPECT_EQ(read_file(folder / "a.txt", 5).value(), "12345");
}

}  // namespace
}  // namespace maquette
