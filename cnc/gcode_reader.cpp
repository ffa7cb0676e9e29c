// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/gcode_reader.hpp"

#include <fmt/format.h>

#include "cnc/gcode_run.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kBatch = 4096;
// Stop is polled after so many lines.
constexpr std::uint64_t kPollEvery = 65536;

Result<ProgramSummary> read(const ProgramLines& source, const MotionSink& sink,
                            const RunContext& run) {
  GcodeRun reader(source, sink, run);
  MAQUETTE_TRY(const std::uint64_t bytes, source.each([&](std::string_view line, bool complete) {
    return reader.line(line, complete);
  }));
  return reader.finish(bytes);
}

}  // namespace

GcodeRun::GcodeRun(const ProgramLines& source, const MotionSink& sink, const RunContext& run)
    : source_(source), name_(source.name()), sink_(sink), run_(run) {
  batch_.reserve(kBatch);
}

Result<bool> GcodeRun::line(std::string_view text, bool complete) {
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
    if (words_.any && machine_.jump().kind != SubprogramJump::Kind::none) MAQUETTE_TRY_VOID(jump());
  }
  if (!summary_.ended && !complete)
    return truncated(static_cast<int>(text.size()) + 1, "found the end of the file");
  return !summary_.ended;
}

Result<ProgramSummary> GcodeRun::finish(std::uint64_t bytes) {
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

bool GcodeRun::choose_language(std::string_view text) {
  if (text.find_first_not_of(" \t\r") == std::string_view::npos) return false;
  language_ = HeidenhainReader::begins(text) ? Language::heidenhain : Language::rs274;
  return true;
}

bool GcodeRun::may_be_control(std::string_view text) {
  std::size_t i = 0;
  while (i < text.size() && gcode_blank(text[i])) ++i;
  if (i < text.size() && (text[i] == 'N' || text[i] == 'n')) {
    ++i;
    while (i < text.size() && (gcode_blank(text[i]) || (text[i] >= '0' && text[i] <= '9'))) ++i;
  }
  return i < text.size() && (text[i] == 'O' || text[i] == 'o' || text[i] == ':');
}

Result<void> GcodeRun::plain(std::string_view text) {
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

Result<void> GcodeRun::conversational(std::string_view text) {
  if (const auto fault = heidenhain_.line(
          text, [&](const Motion& motion) -> Result<void> { return give(motion); })) {
    if (fault->sink) return tl::unexpected(*fault->sink);
    return block_error({fault->code, fault->column, fault->text});
  }
  summary_.blocks = heidenhain_.blocks();
  summary_.ended = heidenhain_.ended();
  return {};
}

Result<void> GcodeRun::give(Motion motion) {
  motion.line = number_;
  batch_.push_back(motion);
  ++summary_.motions;
  if (batch_.size() == kBatch) return flush();
  return {};
}

Result<void> GcodeRun::flush() {
  if (batch_.empty()) return {};
  auto result = sink_(batch_);
  batch_.clear();
  return result;
}

tl::unexpected<Error> GcodeRun::error(ErrorCode code, int column, const std::string& text) const {
  return fail(code, fmt::format("{}:{}:{}: {}", name_, number_, column, text));
}

tl::unexpected<Error> GcodeRun::block_error(const BlockFault& fault) const {
  return complete_ ? error(fault.code, fault.column, fault.text)
                   : truncated(fault.column, fault.text);
}

tl::unexpected<Error> GcodeRun::word_error() const {
  const WordFault& fault = parser_.fault();
  const bool syntax = fault.kind == WordFault::Kind::syntax;
  return block_error({syntax ? kGcodeSyntax : kGcodeUnsupported, fault.column, fault.text});
}

tl::unexpected<Error> GcodeRun::control_error(const ControlFault& fault) const {
  return fail(kGcodeSyntax,
              fmt::format("{}:{}:{}: {}", name_, fault.line, fault.column, fault.text));
}

tl::unexpected<Error> GcodeRun::truncated(int column, const std::string& text) const {
  return error(kGcodeTruncated, column,
               fmt::format("{}; the last line has no line end and no M2, M30 or '%' came "
                           "before, expected the whole program: is the file cut off?",
                           text));
}

Result<ProgramSummary> read_gcode_text(std::string_view text, std::string_view name,
                                       const MotionSink& sink, const RunContext& run) {
  return read(ProgramLines(text, name), sink, run);
}

Result<ProgramSummary> read_gcode(const std::filesystem::path& program, const MotionSink& sink,
                                  const RunContext& run) {
  return read(ProgramLines(program), sink, run);
}

}  // namespace maquette::cnc
