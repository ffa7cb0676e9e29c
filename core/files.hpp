// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file files.hpp
/// Output files appear whole or not at all, and every file has a fingerprint.

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "core/result.hpp"

namespace maquette {

inline constexpr ErrorCode kFileNotFound{"CORE_FILE_NOT_FOUND"};
inline constexpr ErrorCode kFileNotReadable{"CORE_FILE_NOT_READABLE"};
inline constexpr ErrorCode kFileTooLarge{"CORE_FILE_TOO_LARGE"};
inline constexpr ErrorCode kFileNotWritable{"CORE_FILE_NOT_WRITABLE", ErrorKind::environment};
inline constexpr ErrorCode kDiskFull{"CORE_DISK_FULL", ErrorKind::environment};

/// A file that is written beside its final name and renamed by commit(). If the
/// object dies before, the partial file is removed and whatever had the final
/// name stays. Write errors are sticky and come out of commit().
class AtomicFile {
 public:
  /// @return the open file; CORE_FILE_NOT_WRITABLE if the folder is missing or
  ///         not writable, with the system's reason
  [[nodiscard]] static Result<AtomicFile> create(const std::filesystem::path& final_path);
  AtomicFile(AtomicFile&&) noexcept;
  AtomicFile& operator=(AtomicFile&&) noexcept;
  ~AtomicFile();

  void write(const void* data, std::size_t bytes);
  void write(std::string_view text) { write(text.data(), text.size()); }
  /// Overwrites bytes that have been written, for headers whose counts are known at the end;
  /// write() goes on at the file's end.
  void rewrite(std::uint64_t offset, std::string_view bytes);

  /// Flushes to disk and lets go of the file handle and its buffer; commit() may come later.
  /// For work of so many files that they cannot all be open. @return as commit()
  [[nodiscard]] Result<void> close();

  /// Flushes to disk and renames. CORE_DISK_FULL or CORE_FILE_NOT_WRITABLE if any
  /// write failed; then the final name is untouched.
  [[nodiscard]] Result<void> commit();

 private:
  struct State;
  explicit AtomicFile(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// For libraries that insist on opening the file themselves: they write to
/// `path()`, which keeps the final extension, and commit() renames it.
class AtomicPath {
 public:
  explicit AtomicPath(std::filesystem::path final_path);
  AtomicPath(const AtomicPath&) = delete;
  AtomicPath& operator=(const AtomicPath&) = delete;
  ~AtomicPath();  ///< removes the partial file unless committed
  [[nodiscard]] const std::filesystem::path& path() const { return partial_; }
  /// Checks first that the folder can be written, so that a library's own vague
  /// message is never the only one.
  [[nodiscard]] Result<void> prepare() const;
  [[nodiscard]] Result<void> commit();

 private:
  std::filesystem::path final_, partial_;
  bool committed_ = false;
};

[[nodiscard]] Result<void> write_file(const std::filesystem::path& path, std::string_view content);
/// @param limit_bytes larger files are refused with CORE_FILE_TOO_LARGE
[[nodiscard]] Result<std::string> read_file(const std::filesystem::path& path,
                                            std::size_t limit_bytes = std::size_t{1} << 32);

/// Lower-case hex SHA-256.
[[nodiscard]] std::string sha256(std::string_view data);
[[nodiscard]] Result<std::string> sha256_file(const std::filesystem::path& path);

/// The error for errno `number` after writing to `path`: disk full or not writable.
[[nodiscard]] Error write_error(const std::filesystem::path& path, int number);

}  // namespace maquette
