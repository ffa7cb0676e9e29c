// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/gcode_reader.hpp"

#include <map>
#include <memory>
#include <vector>

#include <fmt/format.h>

#include "cnc/gcode_control.hpp"
#include "cnc/gcode_machine.hpp"
#include "cnc/gcode_words.hpp"
#include "cnc/heidenhain_reader.hpp"
#include "cnc/program_lines.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kBatch = 4096;
// Stop is polled after so many lines.
constexpr std::uint64_t kPollEvery = 65536;
constexpr int kDeepestCall = 10;  // LinuxCNC's own limit
// A block that may run again is kept in memory; and a loop must end.
constexpr std::size_t kMostKeptBytes = std::size_t{256} << 20;
constexpr std::uint64_t kMostLinesOfLoops = 1'000'000'000;
constexpr std::uint64_t kMostLinesWithoutMotion = 1'000'000;

using Kind = ControlLine::Kind;
using Block = std::vector<KeptLine>;

/// Everything between "a line" and "a batch of motions".
class Reader {
 public:
  Reader(const ProgramLines& source, const MotionSink& sink, const RunContext& run)
      : source_(source), name_(source.name()), sink_(sink), run_(run) {
    batch_.reserve(kBatch);
  }

  /// @param complete  the line had its line end
  /// @return false: the program is over
  Result<bool> line(std::string_view text, bool complete) {
    ++summary_.lines;
    number_ = summary_.lines;
    if (summary_.lines % kPollEvery == 0 && run_.stopped())
      return fail(kCancelled, fmt::format("{}: reading was stopped", name_));
    if (text.size() > kLongestLine)
      return error(
          kGcodeSyntax, static_cast<int>(kLongestLine) + 1,
          fmt::format("found a line of {} bytes, expected at most {}", text.size(), kLongestLine));
    complete_ = complete;
    if (language_ == Language::unknown && !choose_language(text)) return true;
    if (language_ == Language::heidenhain) {
      MAQUETTE_TRY_VOID(conversational(text));
    } else if (may_be_control(text) || !kept_.empty()) {
      MAQUETTE_TRY_VOID(control(text));
    } else {
      MAQUETTE_TRY_VOID(plain(text));
      if (words_.any && machine_.jump().kind != SubprogramJump::Kind::none)
        MAQUETTE_TRY_VOID(jump());
    }
    if (!summary_.ended && !complete)
      return truncated(static_cast<int>(text.size()) + 1, "found the end of the file");
    return !summary_.ended;
  }

  Result<ProgramSummary> finish(std::uint64_t bytes) {
    number_ = summary_.lines + 1;
    if (!kept_.empty())
      return error(
          kGcodeTruncated, 1,
          fmt::format("found the end of the file, expected o{} {} (it begins in line {}): "
                      "is the file whole?",
                      kept_[0].control.label, end_of(kept_[0].control.kind), kept_[0].number));
    if (!summary_.ended && language_ == Language::heidenhain)
      return error(kGcodeTruncated, 1,
                   "found the end of the file, expected END PGM, M2 or M30: is "
                   "the file whole?");
    if (!summary_.ended && demarcated_)
      return error(kGcodeTruncated, 1,
                   "found the end of the file, expected M2, M30 or the closing '%' (the program "
                   "opens with one): is the file whole?");
    MAQUETTE_TRY_VOID(flush());
    summary_.bytes = bytes;
    if (language_ == Language::heidenhain) {
      summary_.dwell_s = heidenhain_.dwell_s();
      summary_.tool_changes = heidenhain_.tool_changes();
    } else {
      summary_.dwell_s = machine_.dwell_s();
      summary_.tool_changes = machine_.tool_changes();
    }
    return summary_;
  }

 private:
  enum class Language : std::uint8_t { unknown, rs274, heidenhain };
  enum class End : std::uint8_t { through, returned };  // or summary_.ended

  /// @return false: nothing on the line, ask again
  bool choose_language(std::string_view text) {
    if (text.find_first_not_of(" \t\r") == std::string_view::npos) return false;
    language_ = HeidenhainReader::begins(text) ? Language::heidenhain : Language::rs274;
    return true;
  }

  static bool may_be_control(std::string_view text) {
    std::size_t i = 0;
    while (i < text.size() && gcode_blank(text[i])) ++i;
    if (i < text.size() && (text[i] == 'N' || text[i] == 'n')) {
      ++i;
      while (i < text.size() && (gcode_blank(text[i]) || (text[i] >= '0' && text[i] <= '9'))) ++i;
    }
    return i < text.size() && (text[i] == 'O' || text[i] == 'o' || text[i] == ':');
  }

  // ---- one block -------------------------------------------------------------------------

  Result<void> plain(std::string_view text) {
    if (!parser_.parse(text, words_)) return word_error();
    if (words_.percent) {
      // The first line with anything on it opens the program; any later one closes it.
      if (seen_something_)
        summary_.ended = true;
      else
        demarcated_ = seen_something_ = true;
      return {};
    }
    if (words_.deleted) {
      ++summary_.skipped_blocks;
      seen_something_ = true;
      return {};
    }
    if (!words_.any) return {};
    seen_something_ = true;
    ++summary_.blocks;
    bool moved = false;
    if (const auto fault = machine_.execute(words_, motion_, moved)) return block_error(*fault);
    if (moved) MAQUETTE_TRY_VOID(give(motion_));
    summary_.ended = machine_.ended();
    return {};
  }

  Result<void> conversational(std::string_view text) {
    if (const auto fault = heidenhain_.line(
            text, [&](const Motion& motion) -> Result<void> { return give(motion); })) {
      if (fault->sink) return tl::unexpected(*fault->sink);
      return block_error({fault->code, fault->column, fault->text});
    }
    summary_.blocks = heidenhain_.blocks();
    summary_.ended = heidenhain_.ended();
    return {};
  }

  Result<void> give(Motion motion) {
    motion.line = number_;
    batch_.push_back(motion);
    ++summary_.motions;
    if (batch_.size() == kBatch) return flush();
    return {};
  }

  // ---- which line is next ----------------------------------------------------------------

  /// A line with an O word, or one inside of what is being kept.
  Result<void> control(std::string_view text) {
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

  [[nodiscard]] bool ends_kept(Kind kind) const {
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

  /// Runs kept lines with its own count of each loop.
  Result<void> run_block(const Block& block) {
    MAQUETTE_TRY(const End end, run_lines(block, 0));
    if (end == End::returned)
      return error(kGcodeSyntax, 1, "found a return outside of a subprogram, expected it inside");
    return {};
  }

  Result<End> run_lines(const Block& block, std::size_t at) {
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

  Result<void> count_kept_line() {
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

  Result<double> condition(const KeptLine& line) {
    if (!parser_.values(line.text, line.control.after, values_)) return word_error();
    if (values_.size() != 1)
      return error(kGcodeSyntax, static_cast<int>(line.control.after) + 1,
                   "found no condition or several, expected one as [#1 lt 5]");
    return values_[0];
  }

  Result<void> return_value(const KeptLine& line) {
    if (!parser_.values(line.text, line.control.after, values_)) return word_error();
    if (!values_.empty()) parser_.set("_value", values_[0]);
    parser_.set("_value_returned", values_.empty() ? 0.0 : 1.0);
    return {};
  }

  // ---- subprograms -----------------------------------------------------------------------

  Result<void> call(std::string_view text, const ControlLine& c) {
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
    MAQUETTE_TRY_VOID(deeper(static_cast<int>(c.column), [&] { return run_lines(*block, 1); }));
    parser_.leave();
    return {};
  }

  /// M98 and M99 of the block that was just executed.
  Result<void> jump() {
    const SubprogramJump jump = machine_.jump();
    if (jump.kind == SubprogramJump::Kind::back)
      return error(kGcodeUnsupported, jump.column,
                   "found M99 outside of a subprogram, expected a program that ends (M2, M30)");
    MAQUETTE_TRY(const auto block, program_block(jump));
    for (std::uint64_t i = 0; i < jump.times && !summary_.ended; ++i)
      MAQUETTE_TRY_VOID(deeper(jump.column, [&] { return run_lines(*block, 0); }));
    return {};
  }

  Result<void> deeper(int column, const auto& work) {
    const std::uint64_t caller = number_;
    if (depth_ == kDeepestCall)
      return error(kGcodeUnsupported, column,
                   fmt::format("found calls more than {} deep, expected fewer", kDeepestCall));
    ++depth_;
    MAQUETTE_TRY_VOID(work());
    --depth_;
    number_ = caller;
    return {};
  }

  /// The lines from "O<number>" to M99, wherever in the file.
  Result<std::shared_ptr<const Block>> program_block(const SubprogramJump& jump) {
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

  /// Whether M99 stands on the line, outside of comments.
  static bool returns(std::string_view text) {
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

  // ---- errors ----------------------------------------------------------------------------

  Result<void> flush() {
    if (batch_.empty()) return {};
    auto result = sink_(batch_);
    batch_.clear();
    return result;
  }
  [[nodiscard]] tl::unexpected<Error> error(ErrorCode code, int column,
                                            const std::string& text) const {
    return fail(code, fmt::format("{}:{}:{}: {}", name_, number_, column, text));
  }
  /// On a line that was cut off, whatever is wrong is wrong because of that.
  [[nodiscard]] tl::unexpected<Error> block_error(const BlockFault& fault) const {
    return complete_ ? error(fault.code, fault.column, fault.text)
                     : truncated(fault.column, fault.text);
  }
  [[nodiscard]] tl::unexpected<Error> word_error() const {
    const WordFault& fault = parser_.fault();
    const bool syntax = fault.kind == WordFault::Kind::syntax;
    return block_error({syntax ? kGcodeSyntax : kGcodeUnsupported, fault.column, fault.text});
  }
  [[nodiscard]] tl::unexpected<Error> control_error(const ControlFault& fault) const {
    return fail(kGcodeSyntax,
                fmt::format("{}:{}:{}: {}", name_, fault.line, fault.column, fault.text));
  }
  [[nodiscard]] tl::unexpected<Error> truncated(int column, const std::string& text) const {
    return error(kGcodeTruncated, column,
                 fmt::format("{}; the last line has no line end and no M2, M30 or '%' came "
                             "before, expected the whole program: is the file cut off?",
                             text));
  }

  const ProgramLines& source_;
  std::string name_;
  const MotionSink& sink_;
  const RunContext& run_;
  Language language_ = Language::unknown;
  LineParser parser_;
  BlockWords words_;
  GcodeMachine machine_;
  HeidenhainReader heidenhain_;
  Motion motion_;
  ProgramSummary summary_;
  std::vector<Motion> batch_;
  std::uint64_t number_ = 0;  // of the line being executed
  bool complete_ = true;
  bool demarcated_ = false, seen_something_ = false;

  Block kept_;  // the block being read that may run more than once
  std::size_t kept_bytes_ = 0;
  std::map<std::string, std::shared_ptr<const Block>> subs_, programs_;
  std::vector<double> values_;
  int depth_ = 0;
  std::uint64_t kept_lines_run_ = 0, motions_then_ = 0, lines_then_ = 0;
};

Result<ProgramSummary> read(const ProgramLines& source, const MotionSink& sink,
                            const RunContext& run) {
  Reader reader(source, sink, run);
  MAQUETTE_TRY(const std::uint64_t bytes, source.each([&](std::string_view line, bool complete) {
    return reader.line(line, complete);
  }));
  return reader.finish(bytes);
}

}  // namespace

Result<ProgramSummary> read_gcode_text(std::string_view text, std::string_view name,
                                       const MotionSink& sink, const RunContext& run) {
  return read(ProgramLines(text, name), sink, run);
}

Result<ProgramSummary> read_gcode(const std::filesystem::path& program, const MotionSink& sink,
                                  const RunContext& run) {
  return read(ProgramLines(program), sink, run);
}

}  // namespace maquette::cnc
