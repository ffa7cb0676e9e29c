// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file e57_pages.hpp
/// The lowest layer of E57 (ASTM E2807): the file is a row of pages of 1024 bytes, 1020 of
/// content and the CRC-32C of these, most significant byte first. Content without checksums
/// is the logical file. Offsets stored in files are physical, lengths logical.
///
/// Page 0 starts with 48 bytes: "ASTM-E57", version (two uint32: 1, 0), and as uint64 the
/// physical length of the file, the physical offset of the XML, its logical length, 1024.

#include <cstdint>
#include <string>
#include <string_view>

#include "core/files.hpp"
#include "core/result.hpp"
#include "scan/detail/byte_source.hpp"

namespace maquette::scan::detail {

inline constexpr std::size_t kE57Page = 1024, kE57Content = 1020;

/// Reads the logical file; each page is verified before a byte of it is given.
class E57PageReader {
 public:
  explicit E57PageReader(ByteSource source) : source_(std::move(source)) {}
  /// Checks page 0 against the file. SCAN_CLOUD_FORMAT, SCAN_CLOUD_CHECKSUM
  [[nodiscard]] Result<void> open();
  [[nodiscard]] const ByteSource& source() const { return source_; }
  [[nodiscard]] std::uint64_t xml_physical() const { return xml_physical_; }
  [[nodiscard]] std::uint64_t xml_bytes() const { return xml_bytes_; }
  [[nodiscard]] std::uint64_t logical_size() const {
    return source_.size() / kE57Page * kE57Content;
  }
  /// @param what  for the message: SCAN_CLOUD_FORMAT if the offset is outside the file or in a
  ///              checksum
  [[nodiscard]] Result<std::uint64_t> logical(std::uint64_t physical, std::string_view what) const;
  void seek(std::uint64_t logical);
  [[nodiscard]] std::uint64_t position() const { return start_ + at_; }
  /// The next n bytes; SCAN_CLOUD_CHECKSUM with page and offset, SCAN_CLOUD_FORMAT at the end
  /// of the file. Valid until the next call. @pre n <= 64 KiB
  [[nodiscard]] Result<std::string_view> peek(std::size_t n);
  /// @pre n was peeked
  void skip(std::size_t n) { at_ += n; }

 private:
  [[nodiscard]] Result<void> fill(std::size_t n);
  ByteSource source_;
  std::uint64_t xml_physical_ = 0, xml_bytes_ = 0;
  std::string window_;       // verified content
  std::uint64_t start_ = 0;  // logical position of the window
  std::size_t at_ = 0;       // within it
};

/// Writes the logical file from its beginning; page 0 is left for finish().
class E57PageWriter {
 public:
  explicit E57PageWriter(AtomicFile file);
  void write(std::string_view bytes);
  /// Physical position of the next byte.
  [[nodiscard]] std::uint64_t physical() const { return pages_ * kE57Page + page_.size(); }
  /// Logical position of the next byte.
  [[nodiscard]] std::uint64_t logical() const { return pages_ * kE57Content + page_.size(); }
  /// Fills the page up with zeros, so that the next byte starts one.
  void end_page();
  /// The content of the page that starts now is kept until patch_page().
  void keep_page();
  /// Overwrites the kept page's first bytes. @pre it has been ended
  void patch_page(std::string_view bytes);
  /// A number made of all checksums so far: the same content, the same number.
  [[nodiscard]] std::uint64_t fingerprint() const { return fingerprint_; }
  /// Writes page 0 and commits.
  [[nodiscard]] Result<void> finish(std::uint64_t xml_physical, std::uint64_t xml_bytes);

 private:
  AtomicFile file_;
  std::string page_;         // content of the page being filled
  std::uint64_t pages_ = 0;  // written
  std::string kept_;
  std::uint64_t kept_page_ = 0;
  std::uint64_t fingerprint_ = 0;
};

}  // namespace maquette::scan::detail
