// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/zip_times.hpp"

#include <cstdint>
#include <fstream>
#include <string>

#include <fmt/format.h>

#include "export/cad.hpp"

namespace maquette::exporting {
namespace {

constexpr std::uint32_t kLocal = 0x04034b50, kEntry = 0x02014b50, kEnd = 0x06054b50,
                        kEnd64 = 0x06064b50;
constexpr std::string_view kTime{"\0\0\x21\0", 4};  ///< 00:00:00, 1980-01-01

std::uint64_t number(std::string_view bytes, std::size_t at, std::size_t size) {
  std::uint64_t value = 0;
  for (std::size_t i = size; i-- > 0;)
    value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

/// An 8-byte number of the entry's ZIP64 field, if the 4-byte one is all ones. The
/// field holds only those numbers that did not fit, in fixed order.
std::uint64_t local_offset(std::string_view entry, std::size_t name_length,
                           std::size_t extra_length) {
  const std::uint64_t offset = number(entry, 42, 4);
  if (offset != 0xFFFFFFFFU) return offset;
  std::size_t skip = 0;
  for (const std::size_t at : {24U, 20U})  // uncompressed, compressed size
    if (number(entry, at, 4) == 0xFFFFFFFFU) skip += 8;
  std::size_t at = 46 + name_length;
  const std::size_t end = at + extra_length;
  while (at + 4 <= end) {
    const std::size_t size = number(entry, at + 2, 2);
    if (number(entry, at, 2) == 1 && skip + 8 <= size && at + 4 + size <= end)
      return number(entry, at + 4 + skip, 8);
    at += 4 + size;
  }
  return offset;
}

}  // namespace

Result<void> set_zip_times(const std::filesystem::path& path) {
  const auto broken = [&path] {
    return fail(kLibraryFailed,
                fmt::format("{}: the archive just written has no directory", path.string()));
  };
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  const auto read = [&file](std::uint64_t at, std::size_t size) {
    std::string bytes(size, '\0');
    file.seekg(static_cast<std::streamoff>(at));
    file.read(bytes.data(), static_cast<std::streamsize>(size));
    if (file.gcount() != static_cast<std::streamsize>(size)) bytes.clear();
    return bytes;
  };
  const auto write_time = [&file](std::uint64_t at) {
    file.seekp(static_cast<std::streamoff>(at));
    file.write(kTime.data(), kTime.size());
  };
  file.seekg(0, std::ios::end);
  const auto size = static_cast<std::uint64_t>(file.tellg());
  if (!file || size < 22) return broken();

  // The end record has no comment here (22 bytes); before it, in ZIP64, a locator of
  // 20 bytes that knows where the large end record is.
  const std::string tail = read(size - 22, 22);
  if (tail.empty() || number(tail, 0, 4) != kEnd) return broken();
  std::uint64_t entries = number(tail, 10, 2), directory = number(tail, 16, 4);
  if (entries == 0xFFFFU || directory == 0xFFFFFFFFU) {
    const std::string locator = size >= 42 ? read(size - 42, 20) : std::string();
    if (locator.empty()) return broken();
    const std::string end64 = read(number(locator, 8, 8), 56);
    if (end64.empty() || number(end64, 0, 4) != kEnd64) return broken();
    entries = number(end64, 32, 8);
    directory = number(end64, 48, 8);
  }
  for (std::uint64_t i = 0; i < entries; ++i) {
    const std::string head = read(directory, 46);
    if (head.empty() || number(head, 0, 4) != kEntry) return broken();
    const std::size_t name = number(head, 28, 2), extra = number(head, 30, 2),
                      comment = number(head, 32, 2);
    const std::string entry = read(directory, 46 + name + extra);
    if (entry.empty()) return broken();
    const std::uint64_t local = local_offset(entry, name, extra);
    const std::string local_head = read(local, 30);
    if (local_head.empty() || number(local_head, 0, 4) != kLocal) return broken();
    write_time(local + 10);
    write_time(directory + 12);
    directory += 46 + name + extra + comment;
  }
  file.flush();
  if (!file) return broken();
  return {};
}

}  // namespace maquette::exporting
