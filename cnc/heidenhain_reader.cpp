// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/heidenhain_reader.hpp"

#include <charconv>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "cnc/arc_geometry.hpp"
#include "cnc/gcode_words.hpp"
#include "cnc/verify.hpp"

namespace maquette::cnc {
namespace {

using Fault = HeidenhainReader::Fault;

constexpr double kLongestTravel_mm = 1e6;
constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr std::string_view kAxes = "XYZ";

bool digit(char c) {
  return c >= '0' && c <= '9';
}
bool letter(char c) {
  return gcode_upper(c) >= 'A' && gcode_upper(c) <= 'Z';
}

}  // namespace

bool HeidenhainReader::begins(std::string_view line) {
  std::size_t i = 0;
  while (i < line.size() && (gcode_blank(line[i]) || digit(line[i]))) ++i;
  constexpr std::string_view kBegin = "BEGIN PGM";
  if (line.size() - i < kBegin.size()) return false;
  for (std::size_t k = 0; k < kBegin.size(); ++k)
    if (gcode_upper(line[i + k]) != kBegin[k]) return false;
  return true;
}

std::optional<Fault> HeidenhainReader::syntax(int column, std::string text) const {
  return Fault{kGcodeSyntax, column, std::move(text), {}};
}
std::optional<Fault> HeidenhainReader::unsupported(int column, std::string_view what,
                                                   std::string_view expected) const {
  return Fault{kGcodeUnsupported, column, fmt::format("found {}, expected {}", what, expected), {}};
}

std::string HeidenhainReader::found() const {
  if (at_ >= line_.size()) return "the end of the line";
  const char c = line_[at_];
  if (c < 0x20 || c > 0x7e)
    return fmt::format("byte 0x{:02x}", static_cast<unsigned>(static_cast<unsigned char>(c)));
  return fmt::format("'{}'", c);
}

void HeidenhainReader::skip_blanks() {
  while (at_ < line_.size() && gcode_blank(line_[at_])) ++at_;
}
bool HeidenhainReader::at_end() {
  skip_blanks();
  return at_ >= line_.size();
}
/// The run of letters here, in upper case.
std::string_view HeidenhainReader::letters() {
  word_.clear();
  while (at_ < line_.size() && letter(line_[at_])) word_ += gcode_upper(line_[at_++]);
  return word_;
}

std::optional<Fault> HeidenhainReader::number(double& value) {
  const std::size_t start = at_;
  if (at_ < line_.size() && (line_[at_] == '+' || line_[at_] == '-')) ++at_;
  const std::size_t digits = at_;
  while (at_ < line_.size() && (digit(line_[at_]) || line_[at_] == '.')) ++at_;
  const char* end = line_.data() + at_;
  const auto result = std::from_chars(line_.data() + digits, end, value, std::chars_format::fixed);
  if (digits == at_ || result.ec != std::errc() || result.ptr != end) {
    at_ = digits == at_ ? at_ : static_cast<std::size_t>(result.ptr - line_.data());
    return syntax(column(), fmt::format("found {}, expected a number", found()));
  }
  if (line_[start] == '-') value = -value;
  if (!(std::abs(value) <= 1e10))
    return syntax(static_cast<int>(start) + 1,
                  "found a number beyond 1e10, expected a length or rate in reach");
  return std::nullopt;
}

std::optional<Fault> HeidenhainReader::line(std::string_view text, const Give& give) {
  line_ = text.substr(0, std::min(text.find(';'), text.size()));
  at_ = 0;
  while (!line_.empty() && gcode_blank(line_.back())) line_.remove_suffix(1);
  const bool continues = !line_.empty() && line_.back() == '~';
  const bool belongs = std::exchange(continued_, continues);
  if (continues) line_.remove_suffix(1);
  if (belongs) return std::nullopt;  // the parameters of a cycle that changes nothing
  skip_blanks();
  while (at_ < line_.size() && digit(line_[at_])) ++at_;  // the block number
  if (at_end() || line_[at_] == '*') return std::nullopt;
  ++blocks_;
  const int start = column();
  const std::string_view word = letters();
  if (!begun_ && word != "BEGIN") return syntax(start, "found a block, expected BEGIN PGM first");
  if (continues && word != "CYCL")
    return unsupported(start, "a block of several lines", "that with cycles only");
  if (word == "BEGIN") return begin_program();
  if (word == "END") {
    ended_ = true;
    return std::nullopt;
  }
  if (word == "BLK" || word == "LBL") return std::nullopt;
  if (word == "TOOL") return tool_call();
  if (word == "CYCL") return cycle();
  Block block;
  block.column = start;
  if (word == "CC") {
    if (auto fault = words(block)) return fault;
    return set_centre(block);
  }
  if (word == "L" || word == "C" || word == "CR" || word == "CP") {
    const std::string kind(word);
    if (auto fault = words(block)) return fault;
    return path(kind, block, give);
  }
  if (word == "STOP" || word == "M") {
    if (word == "M") at_ = static_cast<std::size_t>(start) - 1;
    if (auto fault = words(block)) return fault;
    if (block.any_axis) return syntax(start, "found an axis without a path, expected L before");
    return std::nullopt;
  }
  if (word.empty())
    return syntax(start, fmt::format("found {}, expected a block such as L or TOOL CALL", found()));
  return unsupported(start, word, "one of the blocks listed in heidenhain_reader.hpp");
}

std::optional<Fault> HeidenhainReader::begin_program() {
  begun_ = true;
  std::string last;
  while (!at_end()) {
    last.clear();
    while (at_ < line_.size() && !gcode_blank(line_[at_])) last += gcode_upper(line_[at_++]);
  }
  if (last != "MM" && last != "INCH")
    return syntax(column(), "found BEGIN PGM without a unit, expected MM or INCH at its end");
  unit_mm_ = last == "MM" ? 1.0 : 25.4;
  return std::nullopt;
}

std::optional<Fault> HeidenhainReader::tool_call() {
  skip_blanks();
  const int start = column();
  const std::string_view word = letters();
  if (word == "DEF") return std::nullopt;
  if (word != "CALL")
    return syntax(start, fmt::format("found TOOL {}, expected TOOL CALL or TOOL DEF", word));
  if (at_end()) return syntax(column(), "found no tool, expected its number");
  if (!digit(line_[at_])) {
    // "TOOL CALL Z S2000" alone sets the speed.
    if (gcode_upper(line_[at_]) == 'Z' || gcode_upper(line_[at_]) == 'S') return std::nullopt;
    return unsupported(column(), "a tool without a number", "its number in the tool table");
  }
  double tool = 0.0;
  if (auto fault = number(tool)) return fault;
  if (tool != std::floor(tool) || tool > 99999999.0)
    return syntax(start, fmt::format("found tool {}, expected a whole number", tool));
  tool_ = static_cast<int>(tool);
  ++tool_changes_;
  while (!at_end()) {
    const int here = column();
    const char name = gcode_upper(line_[at_]);
    if (name == 'Z' && (at_ + 1 == line_.size() || gcode_blank(line_[at_ + 1]))) {
      ++at_;
      continue;
    }
    if (name == 'X' || name == 'Y')
      return unsupported(here, fmt::format("tool axis {}", name), "Z");
    const std::string_view key = letters();
    if (key != "S" && key != "F" && key != "DL" && key != "DR")
      return syntax(here, fmt::format("found '{}', expected Z, S, F, DL or DR", key));
    const bool feed = key == "F";
    double value = 0.0;
    if (auto fault = number(value)) return fault;
    if (feed) feed_mm_min_ = value * unit_mm_;
  }
  return std::nullopt;
}

std::optional<Fault> HeidenhainReader::cycle() {
  skip_blanks();
  const int start = column();
  if (letters() != "DEF") return unsupported(start, "CYCL", "CYCL DEF 9, 32 or 247");
  skip_blanks();
  double cycle = 0.0;
  const int place = column();
  if (auto fault = number(cycle)) return fault;
  const double kind = std::floor(cycle);
  if (kind == 9.0) {
    if (cycle == kind) return std::nullopt;  // the heading
    skip_blanks();
    // "9.1 DWELL 0.5"; older ones "V.ZEIT".
    while (at_ < line_.size() && !digit(line_[at_])) ++at_;
    double seconds = 0.0;
    if (auto fault = number(seconds)) return fault;
    dwell_s_ += seconds;
    return std::nullopt;
  }
  if (kind == 247.0) return std::nullopt;
  if (kind == 32.0) {
    // "32.0 TOLERANCE", "32.1 T0.01", "32.2 HSC-MODE:1 TA0.5"; 32.1 without T switches it off.
    if (std::lround(10.0 * (cycle - kind)) != 1) return std::nullopt;
    control_.reset();
    if (at_end()) return std::nullopt;
    double tolerance = 0.0;
    const int t = column();
    const std::string what = found();
    if (letters() != "T")
      return syntax(t, fmt::format("found {}, expected T with the tolerance", what));
    if (auto fault = number(tolerance)) return fault;
    if (tolerance > 0.0) control_ = PathControl{PathControl::Mode::blend, tolerance * unit_mm_};
    return std::nullopt;
  }
  return unsupported(place, fmt::format("cycle {:.0f}", kind), "cycle 9, 32 or 247");
}

std::optional<Fault> HeidenhainReader::m_code(int code, int column, Block& block) {
  if (code == 2 || code == 30)
    ended_ = true;
  else if (code == 91 || code == 92)
    block.machine_frame = true;
  else if (code == 140)
    known_[2] = false;
  else if (code > 14)
    return unsupported(column, fmt::format("M{}", code),
                       "one of the codes listed in heidenhain_reader.hpp");
  return std::nullopt;
}

std::optional<Fault> HeidenhainReader::words(Block& block) {
  while (!at_end()) {
    const int start = column();
    const std::string name(letters());
    const bool incremental = name.size() == 2 && name[0] == 'I';
    const std::size_t axis =
        name.size() == (incremental ? 2U : 1U) ? kAxes.find(name.back()) : std::string_view::npos;
    double value = 0.0;
    if (name == "FMAX") {
      block.rapid = true;
    } else if (name == "RL" || name == "RR") {
      return unsupported(start, name, "a path of the tool's centre (R0)");
    } else if (name == "DR") {
      const char sign = at_ < line_.size() ? line_[at_] : '\0';
      if (sign != '+' && sign != '-')
        return syntax(column(), fmt::format("found {}, expected DR+ or DR-", found()));
      ++at_;
      block.counter_clockwise = sign == '+';
    } else if (name == "MB" || name == "MAX") {
      if (name == "MB" && at_ < line_.size() && !gcode_blank(line_[at_]))
        if (auto fault = number(value)) return fault;  // M140 MB50: away all the same
    } else if (axis != std::string_view::npos) {
      if (auto fault = number(value)) return fault;
      (incremental ? block.incremental : block.absolute)[axis] = value * unit_mm_;
      block.any_axis = true;
    } else if (name == "R" || name == "F" || name == "M" || name == "S" || name == "PA" ||
               name == "IPA") {
      const std::size_t digits = at_;
      if (auto fault = number(value)) return fault;
      const bool sign = line_[digits] == '+' || line_[digits] == '-';
      if (name == "R" && (sign || value != 0.0)) {
        block.radius = value * unit_mm_;
      } else if (name == "F") {
        if (!(value >= 0.0))
          return syntax(start, fmt::format("found feed {}, expected one above zero", value));
        feed_mm_min_ = value * unit_mm_;
      } else if (name == "M") {
        if (value != std::floor(value) || value < 0.0 || value > 999.0)
          return syntax(start, "found M without a code, expected M0 to M999");
        if (auto fault = m_code(static_cast<int>(value), start, block)) return fault;
      } else if (name == "PA" || name == "IPA") {
        block.angle = value;
        block.angle_incremental = name == "IPA";
      }
    } else if (name.empty()) {
      return syntax(start, fmt::format("found {}, expected a word such as X+10", found()));
    } else {
      return unsupported(start, name, "X, Y, Z, their increments, R0, F, FMAX, DR or M");
    }
  }
  return std::nullopt;
}

std::optional<Fault> HeidenhainReader::set_centre(const Block& block) {
  std::array<bool, 3> named{};
  for (std::size_t i = 0; i < 3; ++i) {
    if (block.absolute[i]) {
      centre_mm_[i] = *block.absolute[i];
    } else if (block.incremental[i]) {
      if (!known_[i])
        return syntax(block.column, fmt::format("found a centre from an unknown {0}, expected a "
                                                "move with {0} before",
                                                kAxes[i]));
      centre_mm_[i] = position_mm_[i] + *block.incremental[i];
    } else {
      continue;
    }
    named[i] = true;
  }
  if (named[0] && named[1] && !named[2])
    centre_plane_ = ArcPlane::xy;
  else if (named[0] && !named[1] && named[2])
    centre_plane_ = ArcPlane::zx;
  else if (!named[0] && named[1] && named[2])
    centre_plane_ = ArcPlane::yz;
  else
    return syntax(block.column, "found CC, expected two of X, Y and Z with it");
  return std::nullopt;
}

/// The end of the block's path into position_mm_, the rest into `motion`.
std::optional<Fault> HeidenhainReader::move(const Block& block, Motion& motion) {
  motion.from_mm = {position_mm_[0], position_mm_[1], position_mm_[2]};
  for (std::size_t i = 0; i < 3; ++i) {
    if (block.absolute[i]) {
      position_mm_[i] = *block.absolute[i];
      known_[i] = true;
    } else if (block.incremental[i]) {
      position_mm_[i] += *block.incremental[i];
    }
    if (!(std::abs(position_mm_[i]) <= kLongestTravel_mm))
      return syntax(block.column, fmt::format("found {} at {} mm, expected less than 1 km",
                                              kAxes[i], position_mm_[i]));
  }
  motion.to_mm = {position_mm_[0], position_mm_[1], position_mm_[2]};
  motion.tool = tool_;
  motion.control = control_;
  motion.feed_mm_min = feed_mm_min_;
  return std::nullopt;
}

std::optional<Fault> HeidenhainReader::path(std::string_view kind, Block& block, const Give& give) {
  if (block.machine_frame) {
    for (std::size_t i = 0; i < 3; ++i)
      if (block.absolute[i] || block.incremental[i]) known_[i] = false;
    if (!block.rapid || kind != "L")
      return unsupported(block.column, "a cut in machine coordinates", "FMAX with M91");
    return std::nullopt;
  }
  const std::array<bool, 3> before = known_;
  const bool was_known = before[0] && before[1] && before[2];
  Motion motion;
  const bool line = kind == "L";
  if (line && !block.any_axis) return std::nullopt;  // F, M alone
  if (!line && block.rapid) return syntax(block.column, "found an arc with FMAX, expected a feed");
  if (!line && !was_known)
    return syntax(block.column,
                  "found an arc from a place that is not known, expected a move "
                  "before");
  if (line) {
    if (auto fault = move(block, motion)) return fault;
    motion.kind = block.rapid ? Motion::Kind::rapid : Motion::Kind::line;
  } else if (auto fault = arc(kind, block, motion)) {
    return fault;
  }
  const bool is_known = known_[0] && known_[1] && known_[2];
  if (block.rapid) {
    if (!was_known || !is_known) return std::nullopt;
  } else {
    if (!is_known)
      return syntax(block.column,
                    "found a cut before X, Y and Z were all given, expected absolute "
                    "ones before");
    if (feed_mm_min_ <= 0.0)
      return Fault{kGcodeNoFeed,
                   block.column,
                   "found a cut without a feed, expected F above zero here or before",
                   {}};
    if (!before[0]) motion.from_mm.x = motion.to_mm.x;
    if (!before[1]) motion.from_mm.y = motion.to_mm.y;
    if (!before[2]) motion.from_mm.z = motion.to_mm.z;
  }
  if (auto given = give(motion); !given) return Fault{kGcodeSyntax, 1, "", given.error()};
  return std::nullopt;
}

std::optional<Fault> HeidenhainReader::arc(std::string_view kind, const Block& block,
                                           Motion& motion) {
  if (!block.counter_clockwise)
    return syntax(block.column, "found an arc without a direction, expected DR+ or DR-");
  const bool ccw = *block.counter_clockwise;
  const bool by_radius = kind == "CR";
  if (by_radius != block.radius.has_value())
    return syntax(block.column, "found C with R or CR without it, expected R with CR only");
  if (!by_radius && !centre_plane_)
    return syntax(block.column, "found an arc without a centre, expected CC before");
  ArcPlane plane = by_radius ? ArcPlane::xy : *centre_plane_;
  if (by_radius && (block.absolute[2] || block.incremental[2]))
    plane = block.absolute[0] || block.incremental[0] ? ArcPlane::zx : ArcPlane::yz;
  const auto [first, second, third] = axes_of(plane);
  const std::array<double, 3> a = position_mm_;
  const bool third_moves = block.absolute[third] || block.incremental[third];
  Block end = block;
  if (kind == "CP") {
    if (!block.angle) return syntax(block.column, "found CP without an angle, expected PA or IPA");
    const PlanePoint arm{a[first] - centre_mm_[first], a[second] - centre_mm_[second]};
    const double degrees = std::numbers::pi / 180.0;
    const double phi =
        *block.angle * degrees + (block.angle_incremental ? std::atan2(arm.v, arm.u) : 0.0);
    const double r = std::hypot(arm.u, arm.v);
    end.absolute[first] = centre_mm_[first] + r * std::cos(phi);
    end.absolute[second] = centre_mm_[second] + r * std::sin(phi);
  } else if (third_moves) {
    return unsupported(block.column, "a helix by C or CR", "CP");
  }
  if (auto fault = move(end, motion)) return fault;
  const std::array<double, 3>& b = position_mm_;
  const PlanePoint chord{b[first] - a[first], b[second] - a[second]};
  PlanePoint arm{centre_mm_[first] - a[first], centre_mm_[second] - a[second]};
  if (by_radius) {
    const double half = 0.5 * std::hypot(chord.u, chord.v);
    if (!(half > 0.0) || half > std::abs(*block.radius) + kHeidenhainArcTolerance_mm)
      return Fault{kGcodeArc,
                   block.column,
                   fmt::format("found radius {:.6g} mm for ends {:.6g} mm apart, expected at least "
                               "half of that and ends apart",
                               *block.radius, 2.0 * half),
                   {}};
    arm = centre_by_radius(chord, *block.radius, ccw);
  }
  const double r0 = std::hypot(arm.u, arm.v), r1 = std::hypot(chord.u - arm.u, chord.v - arm.v);
  if (!(r0 > 0.0) || !(r0 <= kLongestTravel_mm) || std::abs(r1 - r0) > kHeidenhainArcTolerance_mm)
    return Fault{kGcodeArc,
                 block.column,
                 fmt::format("found an arc with radius {:.6f} mm at its start and {:.6f} mm at its "
                             "end, expected equal ones within {} mm",
                             r0, r1, kHeidenhainArcTolerance_mm),
                 {}};
  double sweep = sweep_rad({-arm.u, -arm.v}, {chord.u - arm.u, chord.v - arm.v}, ccw);
  if (kind == "CP" && block.angle_incremental) {
    sweep = std::abs(*block.angle) / 360.0 * kTurn;
    if (*block.angle != 0.0 && (*block.angle > 0.0) != ccw)
      return syntax(block.column,
                    "found an angle against the direction, expected IPA and DR with "
                    "one sign");
  }
  if (sweep <= 0.0 || (chord.u == 0.0 && chord.v == 0.0 && kind != "CP")) sweep = kTurn;
  motion.kind = Motion::Kind::arc;
  motion.plane = plane;
  motion.sweep_rad = ccw ? sweep : -sweep;
  std::array<double, 3> centre = a;
  centre[first] += arm.u;
  centre[second] += arm.v;
  motion.centre_mm = {centre[0], centre[1], centre[2]};
  return std::nullopt;
}

}  // namespace maquette::cnc
