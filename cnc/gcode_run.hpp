// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gcode_run.hpp
/// A program as it runs: from "a line" to "a batch of motions". Used by gcode_reader only.

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "cnc/gcode_control.hpp"
#include "cnc/gcode_machine.hpp"
#include "cnc/gcode_reader.hpp"
#include "cnc/gcode_words.hpp"
#include "cnc/heidenhain_reader.hpp"
#include "cnc/program_lines.hpp"

namespace maquette::cnc {

class GcodeRun {
 public:
  GcodeRun(const ProgramLines& source, const MotionSink& sink, const RunContext& run);

  /// @param complete  the line had its line end
  /// @return false: the program is over
  Result<bool> line(std::string_view text, bool complete);

  Result<ProgramSummary> finish(std::uint64_t bytes);

 private:
  using Block = std::vector<KeptLine>;
  enum class Language : std::uint8_t { unknown, rs274, heidenhain };
  enum class End : std::uint8_t { through, returned };  // or summary_.ended

  /// @return false: nothing on the line, ask again
  bool choose_language(std::string_view text);

  static bool may_be_control(std::string_view text);

  // ---- one block -------------------------------------------------------------------------

  Result<void> plain(std::string_view text);

  Result<void> conversational(std::string_view text);

  Result<void> give(Motion motion);

  // ---- which line is next ----------------------------------------------------------------

  /// A line with an O word, or one inside of what is being kept.
  Result<void> control(std::string_view text);

  [[nodiscard]] bool ends_kept(ControlLine::Kind kind) const;

  /// Runs kept lines with its own count of each loop.
  Result<void> run_block(const Block& block);

  Result<End> run_lines(const Block& block, std::size_t at);

  Result<void> count_kept_line();

  Result<double> condition(const KeptLine& line);

  Result<void> return_value(const KeptLine& line);

  // ---- subprograms -----------------------------------------------------------------------

  Result<void> call(std::string_view text, const ControlLine& c);

  /// M98 and M99 of the block that was just executed.
  Result<void> jump();

  Result<void> deeper(int column, const Block& block, std::size_t at);

  /// The lines from "O<number>" to M99, wherever in the file.
  Result<std::shared_ptr<const Block>> program_block(const SubprogramJump& jump);

  /// Whether M99 stands on the line, outside of comments.
  static bool returns(std::string_view text);

  // ---- errors ----------------------------------------------------------------------------

  Result<void> flush();
  [[nodiscard]] tl::unexpected<Error> error(ErrorCode code, int column,
                                            const std::string& text) const;
  /// On a line that was cut off, whatever is wrong is wrong because of that.
  [[nodiscard]] tl::unexpected<Error> block_error(const BlockFault& fault) const;
  [[nodiscard]] tl::unexpected<Error> word_error() const;
  [[nodiscard]] tl::unexpected<Error> control_error(const ControlFault& fault) const;
  [[nodiscard]] tl::unexpected<Error> truncated(int column, const std::string& text) const;

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

}  // namespace maquette::cnc
