// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/gcode_writer.hpp"

#include <array>
#include <cmath>

namespace maquette::cnc {

void append_decimal(std::string& text, std::int64_t ticks) {
  std::array<char, 24> digits;
  std::size_t at = digits.size();
  const bool negative = ticks < 0;
  auto rest = negative ? 0 - static_cast<std::uint64_t>(ticks) : static_cast<std::uint64_t>(ticks);
  std::uint64_t fraction = rest % 10000;
  rest /= 10000;
  if (fraction != 0) {
    int places = 4;
    for (; fraction % 10 == 0; fraction /= 10) --places;
    for (; places > 0; --places, fraction /= 10)
      digits[--at] = static_cast<char>('0' + fraction % 10);
    digits[--at] = '.';
  }
  do {
    digits[--at] = static_cast<char>('0' + rest % 10);
    rest /= 10;
  } while (rest != 0);
  if (negative) digits[--at] = '-';
  text.append(digits.data() + at, digits.size() - at);
}

std::string comment_text(std::string_view text) {
  std::string safe;
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (c == '(' || c == '[')
      safe += '[';
    else if (c == ')' || c == ']')
      safe += ']';
    else if (code < 0x20 || code >= 0x7f || c == ';' || c == '%')
      safe += '_';
    else
      safe += c;
  }
  return safe;
}

void GcodeWriter::line(std::string_view text) {
  text_.append(text).push_back('\n');
  ++blocks_;
}

void GcodeWriter::move(int motion, ToolPosition to, double feed) {
  constexpr auto kUnknown = ToolPosition::kUnknown;
  if (to.x == kUnknown) to.x = at_.x;
  if (to.y == kUnknown) to.y = at_.y;
  if (to.z == kUnknown) to.z = at_.z;
  if (to == at_) return;
  const std::size_t start = text_.size();
  if (motion != motion_) {
    text_ += motion == 0 ? "G0" : "G1";
    motion_ = motion;
  }
  const auto word = [&](char letter, std::int64_t from, std::int64_t value) {
    if (value == from) return;
    text_ += letter;
    append_decimal(text_, value);
  };
  word('X', at_.x, to.x);
  word('Y', at_.y, to.y);
  word('Z', at_.z, to.z);
  if (motion == 1) {
    if (feed != feed_) {
      text_ += 'F';
      append_decimal(text_, std::llround(feed * 100.0) * 100);
      feed_ = feed;
    }
    if (at_.x != kUnknown && at_.y != kUnknown && at_.z != kUnknown) {
      const double dx = static_cast<double>(to.x - at_.x), dy = static_cast<double>(to.y - at_.y),
                   dz = static_cast<double>(to.z - at_.z);
      const double length = std::sqrt(dx * dx + dy * dy + dz * dz) / 10000.0;
      cutting_length_mm_ += length;
      cutting_time_min_ += length / feed;
    }
  }
  at_ = to;
  if (text_.size() != start) {
    text_ += '\n';
    ++blocks_;
  }
}

}  // namespace maquette::cnc
