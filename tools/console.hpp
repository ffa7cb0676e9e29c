// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file console.hpp
/// What a person sees while the program works: a bar with the time that is left on
/// a terminal, a line now and then elsewhere, nothing with --quiet. All of it goes
/// to standard error, so that standard output carries results only.

#include <memory>
#include <string>
#include <vector>

#include "core/run_context.hpp"

namespace maquette::tools {

struct ConsoleOptions {
  bool quiet = false;
  bool json = false;  ///< standard output carries one JSON document
};

class Console {
 public:
  explicit Console(ConsoleOptions options);
  ~Console();
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;

  /// Starts a piece of work; the context reports to its bar and stops on Ctrl-C.
  [[nodiscard]] RunContext begin(const std::string& what);
  /// Ends it; `note` stands behind the time.
  void end(const std::string& note = "");

  void line(const std::string& text);     ///< a remark, silent with --quiet
  void warning(const std::string& text);  ///< shown also with --quiet
  void error(const std::string& text);
  void result(const std::string& text);       ///< standard output, unless --json
  void json_result(const std::string& text);  ///< with --json: kept until the end, then
                                              ///< one document, or a list if there are several

  [[nodiscard]] const ConsoleOptions& options() const { return options_; }

 private:
  struct Bar;
  void flush_json();

  ConsoleOptions options_;
  std::unique_ptr<Bar> bar_;
  std::vector<std::string> json_;
};

/// Ctrl-C and SIGTERM request a stop once; a second one ends the program at once.
void install_stop_handlers();
[[nodiscard]] bool stop_requested();

[[nodiscard]] std::string human_bytes(double bytes);
[[nodiscard]] std::string human_seconds(double seconds);

}  // namespace maquette::tools
