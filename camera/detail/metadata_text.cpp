// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/metadata_text.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>

#include <nlohmann/json.hpp>

namespace maquette::camera::detail {
namespace {

using nlohmann::ordered_json;

constexpr std::string_view kPrefix = "maquette:";
constexpr std::size_t kLongestSegment = 65533;  ///< 16 bits of length count themselves
constexpr unsigned kComment = 0xFE, kApplication = 0xE0, kStartOfScan = 0xDA;

/// The whole number of `count` bytes at the reader's place; 0 behind the file's end.
std::uint32_t number(std::istream& in, int count, bool big_endian) {
  std::array<unsigned char, 4> bytes{};
  in.read(reinterpret_cast<char*>(bytes.data()), count);
  std::uint32_t value = 0;
  for (int i = 0; i < count; ++i)
    value = (value << 8U) | bytes[static_cast<std::size_t>(big_endian ? i : count - 1 - i)];
  return value;
}

unsigned byte_at(std::string_view text, std::size_t i) {
  return static_cast<unsigned char>(text[i]);
}

}  // namespace

std::string text_of(const Metadata& metadata) {
  ordered_json json = ordered_json::object();
  for (const auto& [key, value] : metadata) json[key] = value;
  return json.dump(-1, ' ', true, ordered_json::error_handler_t::replace);
}

Metadata metadata_of_text(std::string_view text) {
  Metadata metadata;
  const ordered_json json = ordered_json::parse(text, nullptr, false);
  if (!json.is_object()) return metadata;
  for (const auto& [key, value] : json.items())
    if (key.starts_with(kPrefix) && value.is_string())
      metadata.emplace_back(key, value.get<std::string>());
  return metadata;
}

std::string with_jpeg_comment(std::string_view jpeg, std::string_view text) {
  std::size_t at = 2;  // behind the start of the image
  while (at + 4 <= jpeg.size() && byte_at(jpeg, at) == 0xFF &&
         (byte_at(jpeg, at + 1) & 0xF0U) == kApplication)
    at += 2 + 256 * byte_at(jpeg, at + 2) + byte_at(jpeg, at + 3);
  std::string out(jpeg.substr(0, at));
  while (!text.empty()) {
    const std::string_view piece = text.substr(0, kLongestSegment);
    const std::size_t length = piece.size() + 2;
    out += {static_cast<char>(0xFF), static_cast<char>(kComment), static_cast<char>(length >> 8U),
            static_cast<char>(length & 0xFFU)};
    out += piece;
    text.remove_prefix(piece.size());
  }
  out += jpeg.substr(at);
  return out;
}

std::string jpeg_comment(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text;
  if (number(in, 2, true) != 0xFFD8) return text;
  while (in) {
    const std::uint32_t marker = number(in, 2, true);
    if ((marker & 0xFF00U) != 0xFF00 || (marker & 0xFFU) == kStartOfScan) break;
    const std::uint32_t length = number(in, 2, true);
    if (!in || length < 2) break;
    if ((marker & 0xFFU) != kComment) {
      in.seekg(length - 2, std::ios::cur);
      continue;
    }
    std::string piece(length - 2, '\0');
    if (!in.read(piece.data(), static_cast<std::streamsize>(piece.size()))) break;
    text += piece;
  }
  return text;
}

std::string tiff_description(const std::filesystem::path& path) {
  constexpr std::uint32_t kClassic = 42, kImageDescription = 270, kAscii = 2;
  std::ifstream in(path, std::ios::binary);
  const std::uint32_t order = number(in, 2, true);
  const bool big_endian = order == 0x4D4D;
  if ((!big_endian && order != 0x4949) || number(in, 2, big_endian) != kClassic) return {};
  in.seekg(number(in, 4, big_endian));
  const std::uint32_t entries = number(in, 2, big_endian);
  for (std::uint32_t i = 0; i < entries && in; ++i) {
    const std::uint32_t tag = number(in, 2, big_endian), type = number(in, 2, big_endian);
    const std::uint32_t count = number(in, 4, big_endian), place = number(in, 4, big_endian);
    if (tag != kImageDescription || type != kAscii || count <= 4) continue;
    // A damaged count must not ask for memory that the file has no bytes for.
    in.seekg(0, std::ios::end);
    const auto size = static_cast<std::uint64_t>(std::max<std::streamoff>(0, in.tellg()));
    if (!in || std::uint64_t{place} + count > size) return {};
    std::string text(count, '\0');
    in.seekg(place);
    if (!in.read(text.data(), static_cast<std::streamsize>(count))) return {};
    return text.substr(0, text.find('\0'));
  }
  return {};
}

}  // namespace maquette::camera::detail
