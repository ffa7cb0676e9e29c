// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/e57_pages.hpp"

#include <utility>

#include <fmt/format.h>

#include "core/check.hpp"
#include "core/random.hpp"
#include "scan/cloud.hpp"
#include "scan/detail/crc32c.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {
constexpr std::size_t kPagesAtOnce = 128;
constexpr std::string_view kSignature = "ASTM-E57";
}  // namespace

Result<void> E57PageReader::open() {
  const std::string& file = source_.name();
  if (source_.peek(kSignature.size()) != kSignature)
    return fail(kCloudFormat, fmt::format("{}: byte 0: expected 'ASTM-E57'", file));
  if (source_.size() % kE57Page != 0)
    return fail(
        kCloudFormat,
        fmt::format("{}: {} bytes are no whole number of pages of {}; the file is truncated", file,
                    source_.size(), kE57Page));
  MAQUETTE_TRY(const std::string_view head, peek(48));
  const auto u32 = [&](std::size_t at) { return load<std::uint32_t>(head.data() + at); };
  const auto u64 = [&](std::size_t at) { return load<std::uint64_t>(head.data() + at); };
  if (u32(8) != 1)
    return fail(kCloudFormat, fmt::format("{}: byte 8: E57 of version {}.{}; 1.0 can be read", file,
                                          u32(8), u32(12)));
  if (u64(40) != kE57Page)
    return fail(kCloudFormat,
                fmt::format("{}: byte 40: pages of {} bytes; E57 has {}", file, u64(40), kE57Page));
  if (u64(16) != source_.size())
    return fail(kCloudFormat, fmt::format("{}: byte 16: the header promises {} bytes, the file has "
                                          "{}; it is truncated or was changed",
                                          file, u64(16), source_.size()));
  xml_physical_ = u64(24);
  xml_bytes_ = u64(32);
  return {};
}

Result<std::uint64_t> E57PageReader::logical(std::uint64_t physical, std::string_view what) const {
  if (physical >= source_.size() || physical % kE57Page >= kE57Content)
    return fail(
        kCloudFormat,
        fmt::format("{}: {} is said to be at byte {}, which is {}", source_.name(), what, physical,
                    physical >= source_.size() ? "beyond the file" : "in a checksum"));
  return physical / kE57Page * kE57Content + physical % kE57Page;
}

void E57PageReader::seek(std::uint64_t logical) {
  if (logical >= start_ && logical - start_ <= window_.size()) {
    at_ = static_cast<std::size_t>(logical - start_);
    return;
  }
  start_ = logical / kE57Content * kE57Content;
  window_.clear();
  at_ = static_cast<std::size_t>(logical - start_);
}

Result<std::string_view> E57PageReader::peek(std::size_t n) {
  if (at_ > window_.size() || window_.size() - at_ < n) MAQUETTE_TRY_VOID(fill(n));
  return std::string_view(window_).substr(at_, n);
}

/// Reads on from the end of the window until n bytes stand behind at_.
Result<void> E57PageReader::fill(std::size_t n) {
  const std::size_t gone = std::min(at_, window_.size()) / kE57Content * kE57Content;
  window_.erase(0, gone);
  start_ += gone;
  at_ -= gone;
  while (window_.size() < at_ + n) {
    std::uint64_t page = start_ / kE57Content + window_.size() / kE57Content;
    source_.seek(page * kE57Page);
    const std::string_view bytes = source_.peek(kPagesAtOnce * kE57Page);
    if (bytes.size() < kE57Page) return source_.ended("before what its header promises");
    for (std::size_t at = 0; at + kE57Page <= bytes.size(); at += kE57Page, ++page) {
      const std::string_view content = bytes.substr(at, kE57Content);
      const std::uint32_t stored = load<std::uint32_t>(bytes.data() + at + kE57Content, true);
      if (crc32c(content) != stored)
        return fail(kCloudChecksum,
                    fmt::format("{}: page {} (byte {}) is damaged: its checksum is {:08x}, its "
                                "content gives {:08x}; get the file again",
                                source_.name(), page, page * kE57Page, stored, crc32c(content)));
      window_ += content;
      if (window_.size() >= at_ + n) break;  // a damaged page ahead is no reason to stop here
    }
  }
  return {};
}

E57PageWriter::E57PageWriter(AtomicFile file) : file_(std::move(file)) {
  end_page();  // page 0, until finish() knows it
}

void E57PageWriter::write(std::string_view bytes) {
  while (!bytes.empty()) {
    const std::size_t n = std::min(bytes.size(), kE57Content - page_.size());
    page_ += bytes.substr(0, n);
    bytes.remove_prefix(n);
    if (page_.size() == kE57Content) end_page();
  }
}

namespace {

std::string with_checksum(std::string content) {
  const std::uint32_t crc = crc32c(content);
  for (const int shift : {24, 16, 8, 0}) content += static_cast<char>((crc >> shift) & 0xFFU);
  return content;
}

}  // namespace

void E57PageWriter::end_page() {
  if (page_.empty() && pages_ > 0) return;
  page_.resize(kE57Content);
  if (kept_page_ == pages_ && pages_ > 0) kept_ = page_;
  fingerprint_ = mix64(fingerprint_ ^ crc32c(page_));
  file_.write(with_checksum(page_));
  page_.clear();
  ++pages_;
}

void E57PageWriter::keep_page() {
  MAQUETTE_CHECK(page_.empty(), "a page begins with {} bytes", page_.size());
  kept_page_ = pages_;
  kept_.clear();
}

void E57PageWriter::patch_page(std::string_view bytes) {
  MAQUETTE_CHECK(kept_.size() == kE57Content, "page {} is not written yet", kept_page_);
  kept_.replace(0, bytes.size(), bytes);
  fingerprint_ = mix64(fingerprint_ ^ crc32c(kept_));
  file_.rewrite(kept_page_ * kE57Page, with_checksum(kept_));
}

Result<void> E57PageWriter::finish(std::uint64_t xml_physical, std::uint64_t xml_bytes) {
  end_page();
  std::string head(kSignature);
  store(head, std::uint32_t{1});
  store(head, std::uint32_t{0});
  for (const std::uint64_t v :
       {pages_ * kE57Page, xml_physical, xml_bytes, std::uint64_t{kE57Page}})
    store(head, v);
  head.resize(kE57Content);
  file_.rewrite(0, with_checksum(head));
  return file_.commit();
}

}  // namespace maquette::scan::detail
