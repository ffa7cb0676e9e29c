// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file byte_source.hpp
/// A file (or bytes in memory, for tests) read forward through a window of constant size.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "core/result.hpp"

namespace maquette::scan::detail {

class ByteSource {
 public:
  /// CORE_FILE_NOT_FOUND, CORE_FILE_NOT_READABLE (folder, pipe, permission)
  [[nodiscard]] static Result<ByteSource> open(const std::filesystem::path& path);
  /// @param bytes  must outlive the source
  ByteSource(std::string_view bytes, std::string name);
  ByteSource(ByteSource&&) noexcept;
  ByteSource& operator=(ByteSource&&) noexcept;
  ~ByteSource();

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }
  [[nodiscard]] std::uint64_t position() const { return window_start_ + at_; }
  [[nodiscard]] std::uint64_t remaining() const { return size_ - position(); }
  [[nodiscard]] double progress() const {
    return size_ == 0 ? 1.0 : static_cast<double>(position()) / static_cast<double>(size_);
  }

  /// The next n bytes without taking them; fewer only at the end of the file or when
  /// reading fails. Valid until the next call.
  [[nodiscard]] std::string_view peek(std::size_t n) {
    if (end_ - at_ < n) fill(n);
    return {window_ + at_, std::min(n, end_ - at_)};
  }
  /// @pre n was peeked
  void skip(std::size_t n) { at_ += n; }
  /// Anywhere in the file (beyond its end: to the end).
  void seek(std::uint64_t position);
  /// The next line without its end (LF or CR LF); nothing at the end of the file. Lines are
  /// cut at kLongestLine. Valid until the next call.
  [[nodiscard]] std::optional<std::string_view> line();
  /// Number of the last line(), from 1.
  [[nodiscard]] std::uint64_t line_number() const { return line_number_; }

  /// For a view that came back short: CORE_FILE_NOT_READABLE if the system failed, else
  /// SCAN_CLOUD_FORMAT "NAME: byte SIZE: the file ends " + where.
  [[nodiscard]] tl::unexpected<Error> ended(std::string_view where) const;

  static constexpr std::size_t kLongestLine = std::size_t{1} << 20;

 private:
  ByteSource() = default;
  void fill(std::size_t n);

  std::string name_;
  std::uint64_t size_ = 0;
  int file_ = -1;  // -1: from memory
  std::unique_ptr<char[]> own_;
  std::size_t capacity_ = 0;
  const char* window_ = nullptr;  // own_, or the bytes in memory
  std::uint64_t window_start_ = 0;
  std::size_t at_ = 0, end_ = 0;  // within the window
  std::uint64_t line_number_ = 0;
  int error_ = 0;
};

}  // namespace maquette::scan::detail
