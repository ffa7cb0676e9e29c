// SPDX-License-Identifier: GPL-3.0-or-later
#include <array>
#include <cstdint>
#include <map>

#include "core/stroke_letters.hpp"

namespace maquette {
namespace {

struct Shape {
  char32_t sign;
  const char* strokes;  // pairs: x as a digit, y as a letter, 'd' is the base line
};
constexpr Shape kShapes[] = {
    {U' ', "0d3d"},  // its width only
    {U'0', "2d0g0m2p5p7m7g5d2d"},
    {U'1', "0m3p3d"},
    {U'2', "0n2p5p7n7k0d7d"},
    {U'3', "0n2p5p7n7l5j3j 5j7h7f5d2d0f"},
    {U'4', "5d5p0h7h"},
    {U'5', "6p1p0j3k5k7i7f5d2d0f"},
    {U'6', "6o4p2p0m0g2d5d7f7h5j2j0h"},
    {U'7', "0p7p3d"},
    {U'8', "2d0f0h2j5j7l7n5p2p0n0l2j 5j7h7f5d2d"},
    {U'9', "1e3d5d7g7m5p2p0n0l2j5j7l"},
    {U'A', "0d4p8d 1h7h"},
    {U'B', "0d0p4p6n6l4j0j 4j7h7f5d0d"},
    {U'C', "7n5p2p0m0g2d5d7f"},
    {U'D', "0d0p4p7m7g4d0d"},
    {U'E', "6p0p0d6d 0j5j"},
    {U'F', "6p0p0d 0j5j"},
    {U'G', "7n5p2p0m0g2d5d7f7j4j"},
    {U'H', "0d0p 7d7p 0j7j"},
    {U'I', "0d0p"},
    {U'J', "5p5f4d1d0f"},
    {U'K', "0d0p 7p0i 2k7d"},
    {U'L', "0p0d6d"},
    {U'M', "0d0p4h8p8d"},
    {U'N', "0d0p7d7p"},
    {U'O', "3d0g0m3p5p8m8g5d3d"},
    {U'P', "0d0p5p7n7l5j0j"},
    {U'Q', "3d0g0m3p5p8m8g5d3d 5g8c"},
    {U'R', "0d0p5p7n7l5j0j 3j7d"},
    {U'S', "7n5p2p0n0l2j5j7h7f5d2d0f"},
    {U'T', "0p8p 4p4d"},
    {U'U', "0p0g2d5d7g7p"},
    {U'V', "0p4d8p"},
    {U'W', "0p2d4m6d8p"},
    {U'X', "0p7d 7p0d"},
    {U'Y', "0p4j8p 4j4d"},
    {U'Z', "0p7p0d7d"},
    {U'a', "5l5d 5j3l2l0j0g2d3d5f"},
    {U'b', "0p0d 0j2l4l6j6f4d2d0f"},
    {U'c', "5k4l2l0j0f2d4d5e"},
    {U'd', "5p5d 5j3l2l0j0f2d3d5f"},
    {U'e', "0h5h5j4l2l0j0f2d4d5e"},
    {U'f', "4p3p1n1d 0l4l"},
    {U'g', "5l5c3a1a0b 5j3l2l0j0f2d3d5f"},
    {U'h', "0p0d 0j2l4l5j5d"},
    {U'i', "0l0d 0o0p"},
    {U'j', "2l2c1a0a 2o2p"},
    {U'k', "0p0d 5l0h 2i5d"},
    {U'l', "0p0d"},
    {U'm', "0l0d 0j2l3l4j4d 4j6l7l8j8d"},
    {U'n', "0l0d 0j2l4l5j5d"},
    {U'o', "2d0f0j2l4l6j6f4d2d"},
    {U'p', "0l0a 0j2l4l6j6f4d2d0f"},
    {U'q', "5l5a 5j3l2l0j0f2d3d5f"},
    {U'r', "0l0d 0j2l4l"},
    {U's', "5k4l1l0k0j1i4h5g5e4d1d0e"},
    {U't', "2o2f3d4d 0l4l"},
    {U'u', "0l0f2d3d5f 5l5d"},
    {U'v', "0l3d6l"},
    {U'w', "0l2d4k6d8l"},
    {U'x', "0l5d 5l0d"},
    {U'y', "0l3d 6l3d2b1a0a"},
    {U'z', "0l5l0d5d"},
    {U'.', "0d0e"},
    {U',', "1e1d0b"},
    {U':', "0d0e 0k0l"},
    {U';', "1e1d0b 1k1l"},
    {U'-', "0i5i"},
    {U'+', "0i6i 3l3f"},
    {U'/', "0c5p"},
    {U'(', "3q1m1f3b"},
    {U')', "0q2m2f0b"},
    {U'%', "0d7p 1p2o1n0o1p 6f7e6d5e6f"},
    {U'=', "0k5k 0g5g"},
    {U'_', "0c6c"},
    {U'<', "5l0i5f"},
    {U'>', "0l5i0f"},
    {U'\'', "0p0n"},
    {U'?', "0n2p4p6n6l3i3h 3d3e"},
    {U'²', "0o1p2p3o0j3j"},
    {U'³', "0o1p2p3o2m1m 2m3l3k2j1j0k"},
    {U'×', "0l5f 5l0f"},
};
constexpr double kGap = 3.0;

StrokeLetter letter_of(const char* text) {
  StrokeLetter letter;
  double widest = 0.0;
  letter.strokes.emplace_back();
  for (const char* c = text; *c != '\0'; ++c) {
    if (*c == ' ') {
      letter.strokes.emplace_back();
      continue;
    }
    const double x = *c - '0', y = *(c + 1) - 'd';
    widest = std::max(widest, x);
    letter.strokes.back().push_back({x, y});
    ++c;
  }
  letter.advance = widest + kGap;
  return letter;
}

const std::map<char32_t, StrokeLetter>& letters() {
  static const std::map<char32_t, StrokeLetter> all = [] {
    std::map<char32_t, StrokeLetter> made;
    for (const Shape& shape : kShapes) made[shape.sign] = letter_of(shape.strokes);
    made[U' '].strokes.clear();
    return made;
  }();
  return all;
}

/// One sign; bytes that are no UTF-8 are each a sign that is not known.
char32_t next_sign(const std::string& text, std::size_t& at) {
  const auto byte = [&](std::size_t i) {
    return i < text.size() ? static_cast<std::uint8_t>(text[i]) : std::uint8_t{0};
  };
  const std::uint8_t first = byte(at++);
  if (first < 0x80) return first;
  const int more = first >= 0xF0 ? 3 : first >= 0xE0 ? 2 : first >= 0xC0 ? 1 : 0;
  char32_t sign = first & (0x3F >> more);
  for (int i = 0; i < more && (byte(at) & 0xC0) == 0x80; ++i)
    sign = sign << 6 | (byte(at++) & 0x3FU);
  return sign;
}

}  // namespace

std::vector<StrokeLetter> stroke_letters(const std::string& utf8) {
  std::vector<StrokeLetter> result;
  for (std::size_t at = 0; at < utf8.size();) {
    const auto found = letters().find(next_sign(utf8, at));
    result.push_back(found != letters().end() ? found->second : letters().at(U'?'));
  }
  return result;
}

std::string unknown_letters(const std::string& utf8) {
  std::string unknown;
  for (std::size_t at = 0; at < utf8.size();) {
    const std::size_t from = at;
    if (letters().contains(next_sign(utf8, at))) continue;
    const auto first = static_cast<std::uint8_t>(utf8[from]);
    const std::size_t length = first < 0x80    ? 1
                               : first >= 0xF8 ? 0
                               : first >= 0xF0 ? 4
                               : first >= 0xE0 ? 3
                               : first >= 0xC0 ? 2
                                               : 0;
    const bool none = at - from != length;
    const std::string sign = none ? std::string("?") : utf8.substr(from, at - from);
    if (unknown.find(sign) == std::string::npos) unknown += sign;
  }
  return unknown;
}

}  // namespace maquette
