// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file program_lines.hpp
/// The lines of a program, from a file or from memory. Used by gcode_reader only.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "core/result.hpp"

namespace maquette::cnc {

/// Longer lines are refused as CNC_GCODE_SYNTAX.
inline constexpr std::size_t kLongestLine = 65536;

class ProgramLines {
 public:
  explicit ProgramLines(std::filesystem::path file) : file_(std::move(file)) {}
  /// `text` must outlive this.
  ProgramLines(std::string_view text, std::string_view name) : text_(text), name_(name) {}

  [[nodiscard]] std::string name() const { return file_.empty() ? name_ : file_.string(); }

  /// A line without its end; not complete: it had none. False: enough.
  using Line = std::function<Result<bool>(std::string_view line, bool complete)>;
  /// @return bytes read; what `line` returns; CORE_FILE_NOT_FOUND, CORE_FILE_NOT_READABLE.
  ///         Of a line beyond kLongestLine only a longer beginning is handed on, then all ends.
  [[nodiscard]] Result<std::uint64_t> each(const Line& line) const;

 private:
  [[nodiscard]] Result<std::uint64_t> each_of_file(const Line& line) const;

  std::filesystem::path file_;
  std::string_view text_;
  std::string name_;
};

}  // namespace maquette::cnc
