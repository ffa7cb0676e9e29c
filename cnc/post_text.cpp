// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/post_text.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/check.hpp"

namespace maquette::cnc {

std::string filled(std::string_view text, const PostWords& words) {
  if (text.find('{') == std::string_view::npos) return std::string(text);
  std::string out;
  while (!text.empty()) {
    const std::size_t open = std::min(text.find('{'), text.size());
    out += text.substr(0, open);
    if (open == text.size()) break;
    const std::size_t close = text.find('}', open);
    const std::string_view key = text.substr(open + 1, close - open - 1);
    text.remove_prefix(close + 1);
    if (key == "name")
      out += words.name;
    else if (key == "tolerance")
      out += words.tolerance;
    else if (key == "safe")
      out += words.safe;
    else if (key == "tool")
      out += fmt::format("{}", words.tool);
    else if (key == "rpm")
      out += fmt::format("{:.0f}", words.rpm);
    else if (key == "number:4")
      out += fmt::format("{:04}", words.number);
    else if (key == "number:5")
      out += fmt::format("{:05}", words.number);
    else
      MAQUETTE_CHECK(false, "a post's text has {{{}}}", key);
  }
  return out;
}

std::string shortest(double value, int places, bool point) {
  std::string text = fmt::format("{:.{}f}", value, places);
  if (text.find('.') == std::string::npos) return point ? text + '.' : text;
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.' && !point) text.pop_back();
  return text;
}

std::string plain_name(std::string_view name) {
  std::string plain;
  for (const char c : name.substr(0, 24)) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    plain += letter || c == '-' || c == '_' ? c : '_';
  }
  return plain.empty() ? "PROGRAM" : plain;
}

std::optional<std::size_t> offset_index(int code) {
  if (code >= 54 && code <= 59) return static_cast<std::size_t>(code - 54);
  if (code >= 591 && code <= 593) return static_cast<std::size_t>(code - 591 + 6);
  return std::nullopt;
}

Result<void> check_options(const ProgramOptions& o) {
  const auto post = post_by_name(o.post);
  if (!post)
    return fail(kUnknownPost,
                fmt::format("post '{}' is not known; there are: {}", o.post, post_names()));
  const auto bad = [](std::string_view option, auto value, std::string_view range) {
    return fail(kProgramOptionOutOfRange,
                fmt::format("{} is {}; it must be {}", option, value, range));
  };
  const auto offset = offset_index(o.work_offset);
  if (!offset)
    return bad("work_offset", o.work_offset, "54 to 59, or 591 to 593 for G59.1 to G59.3");
  if (post->offsets[*offset].empty())
    return bad("work_offset", o.work_offset, fmt::format("54 to 59 with post {}", o.post));
  if (o.number < 1 || o.number > 7999) return bad("number", o.number, "1 to 7999");
  if (!(o.blending.value() >= 0.0 && o.blending.value() <= 1.0))
    return bad("blending", o.blending.value(), "0 to 1 mm");
  if (!(o.arc_chords.value() >= 1e-4 && o.arc_chords.value() <= 1.0))
    return bad("arc_chords", o.arc_chords.value(), "0.0001 to 1 mm");
  if (!(std::abs(o.safe_z.value()) <= 1e4))
    return bad("safe_z", o.safe_z.value(), "a height from -10000 to 10000 mm");
  if (!(o.entry_feed.value() >= 0.01 && o.entry_feed.value() <= 1e6))
    return bad("entry_feed", o.entry_feed.value(), "0.01 to 1000000 mm/min");
  if (o.max_lines != 0 && o.max_lines < 200)
    return bad("max_lines", o.max_lines, "0, or at least 200");
  if (o.max_bytes != 0 && o.max_bytes < 16384)
    return bad("max_bytes", o.max_bytes, "0, or at least 16384");
  if (o.relative && !post->exact_increments)
    return fail(kProgramOptionOutOfRange,
                fmt::format("relative is true; {} does not add up increments as exactly as it "
                            "goes to places",
                            post->control));
  return {};
}

}  // namespace maquette::cnc
