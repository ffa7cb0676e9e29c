// SPDX-License-Identifier: GPL-3.0-or-later

// Which line of a program is next: O words, M98 and M99.

#include <utility>

#include <fmt/format.h>

#include "cnc/gcode_run.hpp"

namespace maquette::cnc {
namespace {

// Stop is polled after so many lines.
constexpr std::uint64_t kPollEvery = 65536;
constexpr int kDeepestCall = 10;  // LinuxCNC's own limit
// A block that may run again is kept in memory; and a loop must end.
constexpr std::size_t kMostKeptBytes = std::size_t{256} << 20;
constexpr std::uint64_t kMostLinesOfLoops = 1'000'000'000;
constexpr std::uint64_t kMostLinesWithoutMotion = 1'000'000;

using Kind = ControlLine::Kind;

}  // namespace

Result<void> GcodeRun::control(std::string_view text) {
  ControlLine c = control_line(text);
  if (!kept_.empty()) {
    kept_bytes_ += text.size() + sizeof(KeptLine);
    if (kept_bytes_ > kMostKeptBytes)
      return error(kGcodeUnsupported, 1,
                   fmt::format("found more than {} MiB inside of o{}, expected a shorter "
                               "subprogram, loop or branch",
                               kMostKeptBytes >> 20, kept_[0].control.label));
    const bool ends = c.label == kept_[0].control.label && ends_kept(c.kind);
    kept_.push_back({std::string(text), number_, std::move(c)});
    if (!ends) return {};
    Block block = std::move(kept_);
    kept_.clear();
    kept_bytes_ = 0;
    if (const auto fault = match(block)) return control_error(*fault);
    if (block[0].control.kind != Kind::sub) return run_block(block);
    const std::string label = block[0].control.label;
    subs_[label] = std::make_shared<const Block>(std::move(block));
    return {};
  }
  seen_something_ = true;
  switch (c.kind) {
    case Kind::program:
      // Its comment, and nothing else.
      if (!parser_.values(text, c.after, values_)) return word_error();
      return {};
    case Kind::sub:
    case Kind::if_:
    case Kind::while_:
    case Kind::do_:
    case Kind::repeat:
      ++summary_.blocks;
      kept_.push_back({std::string(text), number_, std::move(c)});
      return {};
    case Kind::call:
    case Kind::unknown: {
      ++summary_.blocks;
      return call(text, c);
    }
    default:
      return error(kGcodeSyntax, static_cast<int>(c.column),
                   fmt::format("found the end or a branch of o{} without its beginning, expected "
                               "that before",
                               c.label));
  }
}

bool GcodeRun::ends_kept(Kind kind) const {
  switch (kept_[0].control.kind) {
    case Kind::sub:
      return kind == Kind::end_sub;
    case Kind::if_:
      return kind == Kind::end_if;
    case Kind::while_:
      return kind == Kind::end_while;
    case Kind::do_:
      return kind == Kind::while_;
    default:
      return kind == Kind::end_repeat;
  }
}

Result<void> GcodeRun::run_block(const Block& block) {
  MAQUETTE_TRY(const End end, run_lines(block, 0));
  if (end == End::returned)
    return error(kGcodeSyntax, 1, "found a return outside of a subprogram, expected it inside");
  return {};
}

Result<GcodeRun::End> GcodeRun::run_lines(const Block& block, std::size_t at) {
  std::map<std::size_t, double> left;  // of the repeats, by head
  bool jumped = false;                 // onto an elseif or else, whose if was not true
  while (at < block.size() && !summary_.ended) {
    const KeptLine& line = block[at];
    number_ = line.number;
    MAQUETTE_TRY_VOID(count_kept_line());
    const bool came_by_jump = std::exchange(jumped, false);
    switch (line.control.kind) {
      case Kind::none: {
        MAQUETTE_TRY_VOID(plain(line.text));
        const auto jump_kind = machine_.jump().kind;
        if (words_.any && jump_kind == SubprogramJump::Kind::back) return End::returned;
        if (words_.any && jump_kind == SubprogramJump::Kind::call) MAQUETTE_TRY_VOID(jump());
        break;
      }
      case Kind::program:
      case Kind::end_if:
      case Kind::do_:
        break;
      case Kind::sub:
        break;  // its own first line
      case Kind::end_sub:
      case Kind::return_:
        MAQUETTE_TRY_VOID(return_value(line));
        return End::returned;
      case Kind::call:
      case Kind::unknown:
        MAQUETTE_TRY_VOID(call(line.text, line.control));
        break;
      case Kind::else_if:
      case Kind::if_:
        if (line.control.kind == Kind::else_if && !came_by_jump) {
          at = line.end;
          continue;
        } else {
          MAQUETTE_TRY(const double yes, condition(line));
          if (yes != 0.0) break;
        }
        at = line.partner;
        jumped = true;
        continue;
      case Kind::else_:
        if (came_by_jump) break;
        at = line.end;
        continue;
      case Kind::while_: {
        MAQUETTE_TRY(const double yes, condition(line));
        if (line.end == 1) {  // of a do
          if (yes != 0.0) at = line.partner;
        } else if (yes == 0.0) {
          at = line.partner;
        }
        break;
      }
      case Kind::end_while:
        at = line.partner;
        continue;
      case Kind::repeat: {
        auto it = left.find(at);
        if (it == left.end()) {
          MAQUETTE_TRY(const double times, condition(line));
          it = left.emplace(at, times).first;
        }
        if (it->second >= 1.0) {
          it->second -= 1.0;
          break;
        }
        left.erase(it);
        at = line.partner;
        break;
      }
      case Kind::end_repeat:
        at = line.partner;
        continue;
      case Kind::break_:
        left.erase(block[line.partner].partner);
        at = line.partner;
        break;
      case Kind::continue_:
        at = line.partner;
        continue;
    }
    ++at;
  }
  return End::through;
}

Result<void> GcodeRun::count_kept_line() {
  if (++kept_lines_run_ % kPollEvery == 0 && run_.stopped())
    return fail(kCancelled, fmt::format("{}: reading was stopped", name_));
  if (summary_.motions != motions_then_) {
    motions_then_ = summary_.motions;
    lines_then_ = kept_lines_run_;
  }
  if (kept_lines_run_ > kMostLinesOfLoops ||
      kept_lines_run_ - lines_then_ > kMostLinesWithoutMotion)
    return error(kGcodeUnsupported, 1, "found a loop that does not end, expected one that does");
  return {};
}

Result<double> GcodeRun::condition(const KeptLine& line) {
  if (!parser_.values(line.text, line.control.after, values_)) return word_error();
  if (values_.size() != 1)
    return error(kGcodeSyntax, static_cast<int>(line.control.after) + 1,
                 "found no condition or several, expected one as [#1 lt 5]");
  return values_[0];
}

Result<void> GcodeRun::return_value(const KeptLine& line) {
  if (!parser_.values(line.text, line.control.after, values_)) return word_error();
  if (!values_.empty()) parser_.set("_value", values_[0]);
  parser_.set("_value_returned", values_.empty() ? 0.0 : 1.0);
  return {};
}

Result<void> GcodeRun::call(std::string_view text, const ControlLine& c) {
  std::string label = c.label;
  std::size_t after = c.after;
  if (c.kind == Kind::unknown) {  // "o#1 call": the label is a value
    double value = 0.0;
    after = c.column;
    if (!label.empty() || !parser_.label(text, after, value))
      return error(kGcodeSyntax, static_cast<int>(c.column),
                   "found an O word that says nothing known, expected sub, call, if, while, do, "
                   "repeat and their kin");
    std::string word;
    while (after < text.size() && gcode_upper(text[after]) >= 'A' &&
           gcode_upper(text[after]) <= 'Z')
      word += gcode_upper(text[after++]);
    if (word != "CALL")
      return error(kGcodeSyntax, static_cast<int>(c.column),
                   "found an O word with an expression, expected it with call only");
    label = fmt::format("{:.0f}", value);
  }
  if (!parser_.values(text, after, values_)) return word_error();
  if (values_.size() > GcodeParameters::kLocals)
    return error(kGcodeSyntax, static_cast<int>(after) + 1,
                 fmt::format("found {} arguments, expected at most {}", values_.size(),
                             int{GcodeParameters::kLocals}));
  const auto found = subs_.find(label);
  if (found == subs_.end())
    return error(kGcodeUnsupported, static_cast<int>(c.column),
                 fmt::format("found a call of o{}, expected its sub before in this file", label));
  const auto block = found->second;
  parser_.enter(values_);
  MAQUETTE_TRY_VOID(deeper(static_cast<int>(c.column), *block, 1));
  parser_.leave();
  return {};
}

Result<void> GcodeRun::jump() {
  const SubprogramJump jump = machine_.jump();
  if (jump.kind == SubprogramJump::Kind::back)
    return error(kGcodeUnsupported, jump.column,
                 "found M99 outside of a subprogram, expected a program that ends (M2, M30)");
  MAQUETTE_TRY(const auto block, program_block(jump));
  for (std::uint64_t i = 0; i < jump.times && !summary_.ended; ++i)
    MAQUETTE_TRY_VOID(deeper(jump.column, *block, 0));
  return {};
}

Result<void> GcodeRun::deeper(int column, const Block& block, std::size_t at) {
  const std::uint64_t caller = number_;
  if (depth_ == kDeepestCall)
    return error(kGcodeUnsupported, column,
                 fmt::format("found calls more than {} deep, expected fewer", kDeepestCall));
  ++depth_;
  MAQUETTE_TRY_VOID(run_lines(block, at));
  --depth_;
  number_ = caller;
  return {};
}

Result<std::shared_ptr<const GcodeRun::Block>> GcodeRun::program_block(const SubprogramJump& jump) {
  const std::string label = fmt::format("{}", jump.number);
  if (const auto it = programs_.find(label); it != programs_.end()) return it->second;
  Block block;
  bool inside = false, closed = false;
  std::uint64_t number = 0;
  std::size_t bytes = 0;
  const auto scanned = source_.each([&](std::string_view text, bool) -> Result<bool> {
    ++number;
    ControlLine c = may_be_control(text) ? control_line(text) : ControlLine{};
    if (c.kind == Kind::program) {
      if (inside) return false;
      inside = c.label == label;
      return true;
    }
    if (!inside) return true;
    bytes += text.size() + sizeof(KeptLine);
    closed = returns(text);
    block.push_back({std::string(text), number, std::move(c)});
    return !closed && bytes <= kMostKeptBytes;
  });
  if (!scanned) return tl::unexpected(scanned.error());
  if (!closed)
    return error(
        kGcodeUnsupported, jump.column,
        inside || !block.empty()
            ? fmt::format("found M98 to program {}, which does not return, expected M99 "
                          "at its end",
                          label)
            : fmt::format("found M98 to program {}, expected O{} in this file", label, label));
  if (const auto fault = match(block)) return control_error(*fault);
  return programs_[label] = std::make_shared<const Block>(std::move(block));
}

bool GcodeRun::returns(std::string_view text) {
  bool comment = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == ';' && !comment) return false;
    if (text[i] == '(') comment = true;
    if (text[i] == ')') comment = false;
    if (comment || gcode_upper(text[i]) != 'M') continue;
    std::size_t j = i + 1;
    while (j < text.size() && (gcode_blank(text[j]) || text[j] == '0')) ++j;
    if (text.substr(j, 2) != "99") continue;
    if (j + 2 == text.size() || text[j + 2] < '0' || text[j + 2] > '9') return true;
  }
  return false;
}

}  // namespace maquette::cnc
