// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/console.hpp"

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <mutex>
#include <thread>

#include <fmt/format.h>
#include <unistd.h>

namespace maquette::tools {
namespace {

using Clock = std::chrono::steady_clock;

volatile std::sig_atomic_t g_signals = 0;

extern "C" void on_stop_signal(int number) {
  if (g_signals != 0) {
    // The second Ctrl-C: do not wait for anything. Partial files are beside their
    // final names and are cleaned by the next run.
    std::signal(number, SIG_DFL);
    std::raise(number);
  }
  g_signals = 1;
}

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

}  // namespace

void install_stop_handlers() {
  std::signal(SIGINT, on_stop_signal);
  std::signal(SIGTERM, on_stop_signal);
}

bool stop_requested() {
  return g_signals != 0;
}

std::string human_bytes(double bytes) {
  static constexpr std::array kUnits{"B", "KiB", "MiB", "GiB", "TiB"};
  std::size_t unit = 0;
  while (bytes >= 1024.0 && unit + 1 < kUnits.size()) bytes /= 1024.0, ++unit;
  return unit == 0 ? fmt::format("{:.0f} B", bytes) : fmt::format("{:.1f} {}", bytes, kUnits[unit]);
}

std::string human_seconds(double seconds) {
  if (seconds < 60.0) return fmt::format("{:.1f} s", seconds);
  const auto whole = static_cast<long>(seconds + 0.5);
  if (whole < 3600) return fmt::format("{}:{:02} min", whole / 60, whole % 60);
  return fmt::format("{}:{:02}:{:02} h", whole / 3600, whole / 60 % 60, whole % 60);
}

/// One watcher thread draws and turns the signal into a stop request; the work
/// only stores a number.
struct Console::Bar {
  Bar(std::string text, bool quiet_, bool terminal_)
      : what(std::move(text)), quiet(quiet_), terminal(terminal_), watcher([this] { watch(); }) {}

  ~Bar() { finish(); }

  void finish() {
    {
      const std::lock_guard lock(mutex);
      if (done) return;
      done = true;
    }
    wake.notify_one();
    watcher.join();
    if (terminal && !quiet) std::fputs("\r\033[K", stderr);
  }

  void watch() {
    auto last_line = Clock::now();
    std::unique_lock lock(mutex);
    while (!done) {
      wake.wait_for(lock, std::chrono::milliseconds(50), [this] { return done; });
      if (stop_requested()) source.request_stop();
      const double share = fraction.load(std::memory_order_relaxed);
      const double spent = seconds_since(start);
      constexpr double kTerminalPeriod = 0.2, kLinePeriod = 15.0;
      if (!quiet && seconds_since(last_line) > (terminal ? kTerminalPeriod : kLinePeriod)) {
        last_line = Clock::now();
        const std::string eta =
            share > 0.02 ? fmt::format(", {} left", human_seconds(spent * (1.0 - share) / share))
                         : "";
        if (terminal) {
          constexpr int kWidth = 24;
          const int full = static_cast<int>(share * kWidth);
          fmt::print(stderr, "\r\033[K{:<28} [{}{}] {:3.0f} % {}{}", what,
                     std::string(static_cast<std::size_t>(full), '#'),
                     std::string(static_cast<std::size_t>(kWidth - full), '.'), 100.0 * share,
                     human_seconds(spent), eta);
        } else {
          fmt::print(stderr, "{}: {:.0f} % after {}{}\n", what, 100.0 * share, human_seconds(spent),
                     eta);
        }
        std::fflush(stderr);
      }
    }
  }

  std::string what;
  bool quiet, terminal;
  Clock::time_point start = Clock::now();
  std::atomic<double> fraction{0.0};
  std::stop_source source;
  std::mutex mutex;
  std::condition_variable wake;
  bool done = false;
  std::thread watcher;  // last: starts when the rest is there
};

Console::Console(ConsoleOptions options) : options_(options) {}
Console::~Console() {
  flush_json();
}

RunContext Console::begin(const std::string& what) {
  bar_ = std::make_unique<Bar>(what, options_.quiet, ::isatty(STDERR_FILENO) != 0);
  RunContext run;
  run.stop = bar_->source.get_token();
  run.progress = [bar = bar_.get()](double share) {
    bar->fraction.store(share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share, std::memory_order_relaxed);
  };
  run.warn = [this](const std::string& text) { warning(text); };
  return run;
}

void Console::end(const std::string& note) {
  if (!bar_) return;
  bar_->finish();
  const double spent = seconds_since(bar_->start);
  line(fmt::format("{:<28} {:>10}  {}", bar_->what, human_seconds(spent), note));
  bar_.reset();
}

void Console::line(const std::string& text) {
  if (!options_.quiet) fmt::print(stderr, "{}\n", text);
}

void Console::warning(const std::string& text) {
  const char* clear_bar = bar_ && bar_->terminal && !options_.quiet ? "\r\033[K" : "";
  fmt::print(stderr, "{}warning: {}\n", clear_bar, text);
}
void Console::error(const std::string& text) {
  fmt::print(stderr, "error: {}\n", text);
}

void Console::result(const std::string& text) {
  if (!options_.json) fmt::print("{}\n", text);
}

void Console::json_result(const std::string& text) {
  if (options_.json) json_.push_back(text);
}

void Console::flush_json() {
  if (json_.size() == 1) fmt::print("{}\n", json_.front());
  if (json_.size() > 1) fmt::print("[{}]\n", fmt::join(json_, ",\n"));
  json_.clear();
}

}  // namespace maquette::tools
