// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/block_text.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "cnc/arc_geometry.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr auto kUnknown = ToolPosition::kUnknown;
// A block of three coordinates, three of a centre, number, codes and feed stays below.
constexpr std::size_t kLongestBlock = 512;
constexpr int kCutsInARow = 100;  // in G91, then one in G90

/// "00" "01" .. "99".
constexpr std::array<char, 200> kPairs = [] {
  std::array<char, 200> pairs{};
  for (std::size_t i = 0; i < 100; ++i) {
    pairs[2 * i] = static_cast<char>('0' + i / 10);
    pairs[2 * i + 1] = static_cast<char>('0' + i % 10);
  }
  return pairs;
}();

char* put(char* at, std::string_view text) {
  std::memcpy(at, text.data(), text.size());
  return at + text.size();
}

char* put_whole(char* at, std::uint64_t value) {
  std::array<char, 20> digits;
  std::size_t i = digits.size();
  for (; value >= 100; value /= 100) std::memcpy(&digits[i -= 2], &kPairs[2 * (value % 100)], 2);
  if (value >= 10)
    std::memcpy(&digits[i -= 2], &kPairs[2 * value], 2);
  else
    digits[--i] = static_cast<char>('0' + value);
  const std::size_t n = digits.size() - i;
  std::memcpy(at, &digits[i], n);
  return at + n;
}

/// Value / 10^Places without trailing zeros; without a zero before the point if `bare`.
template <int Places>
char* put_decimal(char* at, std::int64_t value, bool point, bool bare = false) {
  constexpr std::uint64_t kScale = Places == 2 ? 100 : Places == 3 ? 1000 : 10000;
  if (value < 0) *at++ = '-';
  const auto size = static_cast<std::uint64_t>(value < 0 ? -value : value);
  if (!bare || size >= kScale) at = put_whole(at, size / kScale);
  // Four digits in any case, so that the pairs fit.
  std::uint64_t fraction = size % kScale * (10000 / kScale);
  if (fraction == 0) {
    if (point) *at++ = '.';
    return at;
  }
  *at = '.';
  std::memcpy(at + 1, &kPairs[2 * (fraction / 100)], 2);
  std::memcpy(at + 3, &kPairs[2 * (fraction % 100)], 2);
  at += 5;
  while (at[-1] == '0') --at;
  return at;
}

struct PlaneWords {
  std::int64_t ToolPosition::*first;
  std::int64_t ToolPosition::*second;
  char first_axis, second_axis, first_centre, second_centre;
  std::string_view code;
};
constexpr std::array<PlaneWords, 3> kPlanes{{
    {&ToolPosition::x, &ToolPosition::y, 'X', 'Y', 'I', 'J', "G17"},
    {&ToolPosition::z, &ToolPosition::x, 'Z', 'X', 'K', 'I', "G18"},
    {&ToolPosition::y, &ToolPosition::z, 'Y', 'Z', 'J', 'K', "G19"},
}};

}  // namespace

BlockText::BlockText(const Post& post, bool numbered, bool relative)
    : post_(post),
      numbered_((numbered || post.numbered) && post.last_line_number > 0),
      relative_(relative),
      unit_(post.decimals == 3 ? 10 : 1),
      text_(std::size_t{1} << 16) {
  MAQUETTE_CHECK(post.decimals == 3 || post.decimals == 4, "{} decimals", post.decimals);
  MAQUETTE_CHECK(!relative || post.exact_increments, "increments for {}", post.name);
  restart();
}

void BlockText::forget() {
  at_ = exact_ = {};
  mode_ = Mode::unknown;
  plane_ = -1;
  feed_ = -1;
  since_absolute_ = -1;
}

void BlockText::restart() {
  forget();
  incremental_ = false;
  lines_ = bytes_ = 0;
  next_number_ = post_.numbered ? 0 : 1;
}

std::int64_t BlockText::in_units(std::int64_t ticks) const {
  if (unit_ == 1 || ticks == kUnknown) return ticks;
  return (ticks >= 0 ? ticks + unit_ / 2 : ticks - unit_ / 2) / unit_;
}

ToolPosition BlockText::in_units(ToolPosition ticks) const {
  return {in_units(ticks.x), in_units(ticks.y), in_units(ticks.z)};
}

char* BlockText::begin() {
  if (text_.size() - used_ < kLongestBlock) text_.resize(2 * text_.size());
  char* at = text_.data() + used_;
  if (numbered_) {
    if (!post_.conversational) *at++ = 'N';
    at = put_whole(at, static_cast<std::uint64_t>(next_number_));
    if (++next_number_ > post_.last_line_number) next_number_ = 1;
    *at++ = ' ';
  }
  return at;
}

void BlockText::end(char* at) {
  *at++ = '\n';
  const auto used = static_cast<std::size_t>(at - text_.data());
  bytes_ += used - used_;
  used_ = used;
  ++lines_;
}

char* BlockText::coordinate(char* at, char letter, std::int64_t units) const {
  if (post_.conversational) *at++ = ' ';
  *at++ = letter;
  if (post_.conversational && units >= 0) *at++ = '+';
  return post_.decimals == 3 ? put_decimal<3>(at, units, post_.point, incremental_)
                             : put_decimal<4>(at, units, post_.point, incremental_);
}

char* BlockText::axes(char* at, ToolPosition to) const {
  const ToolPosition from = incremental_ ? at_ : ToolPosition{0, 0, 0};
  if (all_axes_ || to.x != at_.x) at = coordinate(at, 'X', to.x - from.x);
  if (all_axes_ || to.y != at_.y) at = coordinate(at, 'Y', to.y - from.y);
  if (all_axes_ || to.z != at_.z) at = coordinate(at, 'Z', to.z - from.z);
  return at;
}

char* BlockText::distance_mode(char* at, bool cut) {
  if (!relative_) return at;
  const bool fresh = !cut || since_absolute_ < 0 || since_absolute_ >= kCutsInARow;
  since_absolute_ = !cut ? -1 : fresh ? 0 : since_absolute_ + 1;
  all_axes_ = cut && fresh;
  if (incremental_ != fresh) return at;
  incremental_ = !fresh;
  return put(at, fresh ? "G90" : "G91");
}

char* BlockText::feed(char* at, double feed_mm_min) {
  const std::int64_t hundredths = std::max<std::int64_t>(1, std::llround(feed_mm_min * 100.0));
  if (hundredths == feed_) return at;
  feed_ = hundredths;
  at = put(at, post_.conversational ? " F" : "F");
  return put_decimal<2>(at, hundredths, post_.point);
}

void BlockText::straight(Mode mode, ToolPosition to, double feed_mm_min) {
  if (to.x == kUnknown) to.x = exact_.x;
  if (to.y == kUnknown) to.y = exact_.y;
  if (to.z == kUnknown) to.z = exact_.z;
  exact_ = to;
  to = in_units(to);
  if (to == at_) return;
  char* at = distance_mode(begin(), mode == Mode::line);
  if (post_.conversational)
    at = put(at, "L");
  else if (mode != mode_)
    at = put(at, mode == Mode::rapid ? "G0" : "G1");
  at = axes(at, to);
  if (post_.conversational && mode_ == Mode::unknown) at = put(at, " R0");
  if (mode == Mode::line)
    at = feed(at, feed_mm_min);
  else if (post_.conversational)
    at = put(at, " FMAX");
  end(at);
  mode_ = mode;
  at_ = to;
}

void BlockText::rapid(ToolPosition to) {
  straight(Mode::rapid, to, 0.0);
}
void BlockText::line(ToolPosition to, double feed_mm_min) {
  straight(Mode::line, to, feed_mm_min);
}

void BlockText::arc(const PathMove& move) {
  const auto plane = static_cast<std::size_t>(move.plane);
  const PlaneWords& axis = kPlanes[plane];
  // A centre in any case, for controls that know radii in the main plane only.
  const PlanePoint arm = arm_of(exact_, move);
  const std::int64_t c1 = in_units(exact_.*axis.first + std::llround(arm.u));
  const std::int64_t c2 = in_units(exact_.*axis.second + std::llround(arm.v));
  const ToolPosition to = in_units(move.to);
  char* at = begin();
  if (post_.conversational) {
    at = put(at, "CC");
    at = coordinate(at, axis.first_axis, c1);
    at = coordinate(at, axis.second_axis, c2);
    end(at);
    at = put(begin(), "C");
    at = coordinate(at, axis.first_axis, to.*axis.first);
    at = coordinate(at, axis.second_axis, to.*axis.second);
    at = put(at, move.counter_clockwise ? " DR+" : " DR-");
    if (mode_ == Mode::unknown) at = put(at, " R0");
  } else {
    at = distance_mode(at, true);
    if (plane_ != static_cast<int>(plane)) at = put(at, axis.code);
    plane_ = static_cast<int>(plane);
    const Mode mode = move.counter_clockwise ? Mode::counter_clockwise : Mode::clockwise;
    if (mode != mode_) at = put(at, move.counter_clockwise ? "G3" : "G2");
    at = axes(at, to);
    const std::int64_t arm1 = c1 - at_.*axis.first, arm2 = c2 - at_.*axis.second;
    if (move.radius > 0) {
      at = coordinate(at, 'R', in_units(move.radius));
    } else {
      if (arm1 != 0 || arm2 == 0) at = coordinate(at, axis.first_centre, arm1);
      if (arm2 != 0) at = coordinate(at, axis.second_centre, arm2);
    }
  }
  mode_ = move.counter_clockwise ? Mode::counter_clockwise : Mode::clockwise;
  at = feed(at, move.feed_mm_min);
  end(at);
  exact_ = move.to;
  at_ = to;
}

void BlockText::lines(std::string_view text) {
  if (incremental_) end(put(begin(), "G90"));
  incremental_ = false;
  since_absolute_ = -1;
  bool continued = false;
  while (!text.empty()) {
    const std::size_t length = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, length);
    text.remove_prefix(std::min(length + 1, text.size()));
    MAQUETTE_CHECK(line.size() <= post_.longest_line, "{} characters: {}", line.size(), line);
    // What belongs to the line before, and the frame of the file, has no number.
    const bool plain = continued || line.starts_with('%') || line.starts_with('O');
    char* at = plain && numbered_ ? nullptr : begin();
    if (at == nullptr) {
      if (text_.size() - used_ < kLongestBlock) text_.resize(2 * text_.size());
      at = put(text_.data() + used_, continued ? "  " : "");
    }
    end(put(at, line));
    continued = line.ends_with('~');
  }
  mode_ = Mode::unknown;
  feed_ = -1;
}

void BlockText::stands_at_z(std::int64_t ticks) {
  exact_.z = ticks;
  at_.z = in_units(ticks);
}

void BlockText::comment(std::string_view text) {
  const std::size_t frame = post_.comment_open.size() + post_.comment_close.size() + 12;
  const std::size_t room = post_.longest_line - frame;
  do {
    std::size_t length = std::min(text.size(), room);
    if (length < text.size())  // between words where that is possible
      if (const std::size_t blank = text.rfind(' ', length); blank != text.npos && blank > 0)
        length = blank;
    char* at = put(begin(), post_.comment_open);
    for (const char c : text.substr(0, length)) {
      // What would end a comment early, or is not of every control's alphabet.
      const auto code = static_cast<unsigned char>(c);
      const bool bad = code < 0x20 || code >= 0x7f || c == ';' || c == '%' || c == '~';
      *at++ = c == '(' ? '[' : c == ')' ? ']' : bad ? '_' : c;
    }
    end(put(at, post_.comment_close));
    text.remove_prefix(length);
    while (text.starts_with(' ')) text.remove_prefix(1);
  } while (!text.empty());
}

}  // namespace maquette::cnc
