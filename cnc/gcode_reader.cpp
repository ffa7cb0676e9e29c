// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/gcode_reader.hpp"

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "cnc/gcode_machine.hpp"
#include "cnc/gcode_words.hpp"
#include "core/files.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kBatch = 4096;
constexpr std::size_t kChunk = std::size_t{1} << 22;
// Stop is polled and progress told after so many lines.
constexpr std::uint64_t kPollEvery = 65536;

/// Everything between "a line" and "a batch of motions".
class Reader {
 public:
  Reader(std::string_view name, const MotionSink& sink, const RunContext& run)
      : name_(name), sink_(sink), run_(run) {
    batch_.reserve(kBatch);
  }

  [[nodiscard]] bool finished() const { return summary_.ended; }

  /// @param complete  the line had its line end
  Result<void> line(std::string_view text, bool complete) {
    ++summary_.lines;
    if (summary_.lines % kPollEvery == 0 && run_.stopped())
      return fail(kCancelled, fmt::format("{}: reading was stopped", name_));
    if (text.size() > kLongestLine)
      return error(
          kGcodeSyntax, static_cast<int>(kLongestLine) + 1,
          fmt::format("found a line of {} bytes, expected at most {}", text.size(), kLongestLine));
    if (!parser_.parse(text, words_)) {
      const WordFault& fault = parser_.fault();
      const bool syntax = fault.kind == WordFault::Kind::syntax;
      if (!complete) return truncated(fault.column, fault.text);
      return error(syntax ? kGcodeSyntax : kGcodeUnsupported, fault.column, fault.text);
    }
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
    Motion motion;
    bool moved = false;
    if (const auto fault = machine_.execute(words_, motion, moved)) {
      if (!complete) return truncated(fault->column, fault->text);
      return error(fault->code, fault->column, fault->text);
    }
    if (moved) {
      motion.line = summary_.lines;
      batch_.push_back(motion);
      ++summary_.motions;
      if (batch_.size() == kBatch) MAQUETTE_TRY_VOID(flush());
    }
    if (machine_.ended()) {
      summary_.ended = true;
    } else if (!complete) {
      return truncated(static_cast<int>(text.size()) + 1, "found the end of the file");
    }
    return {};
  }

  Result<ProgramSummary> finish(std::uint64_t bytes) {
    if (!summary_.ended && demarcated_)
      return fail(kGcodeTruncated,
                  fmt::format("{}:{}:1: found the end of the file, expected M2, M30 or the closing "
                              "'%' (the program opens with one): is the file whole?",
                              name_, summary_.lines + 1));
    MAQUETTE_TRY_VOID(flush());
    summary_.bytes = bytes;
    summary_.dwell_s = machine_.dwell_s();
    summary_.tool_changes = machine_.tool_changes();
    return summary_;
  }

 private:
  Result<void> flush() {
    if (batch_.empty()) return {};
    auto result = sink_(batch_);
    batch_.clear();
    return result;
  }
  [[nodiscard]] tl::unexpected<Error> error(ErrorCode code, int column,
                                            const std::string& text) const {
    return fail(code, fmt::format("{}:{}:{}: {}", name_, summary_.lines, column, text));
  }
  [[nodiscard]] tl::unexpected<Error> truncated(int column, const std::string& text) const {
    return error(kGcodeTruncated, column,
                 fmt::format("{}; the last line has no line end and no M2, M30 or '%' came "
                             "before, expected the whole program: is the file cut off?",
                             text));
  }

  std::string name_;
  const MotionSink& sink_;
  const RunContext& run_;
  LineParser parser_;
  BlockWords words_;
  GcodeMachine machine_;
  ProgramSummary summary_;
  std::vector<Motion> batch_;
  bool demarcated_ = false, seen_something_ = false;
};

/// Hands over all complete lines of `text`; returns how many bytes that was.
Result<std::size_t> feed_lines(Reader& reader, std::string_view text) {
  std::size_t at = 0;
  while (!reader.finished() && at < text.size()) {
    const void* end = std::memchr(text.data() + at, '\n', text.size() - at);
    if (end == nullptr) break;
    const auto length =
        static_cast<std::size_t>(static_cast<const char*>(end) - (text.data() + at));
    MAQUETTE_TRY_VOID(reader.line(text.substr(at, length), true));
    at += length + 1;
  }
  return at;
}

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

[[nodiscard]] std::array<double, 3> coordinates(Vec3 v) {
  return {v.x, v.y, v.z};
}
[[nodiscard]] std::size_t third_axis(ArcPlane plane) {
  return plane == ArcPlane::xy ? 2 : plane == ArcPlane::zx ? 1 : 0;
}

}  // namespace

Result<ProgramSummary> read_gcode_text(std::string_view text, std::string_view name,
                                       const MotionSink& sink, const RunContext& run) {
  Reader reader(name, sink, run);
  MAQUETTE_TRY(const std::size_t used, feed_lines(reader, text));
  if (!reader.finished() && used < text.size())
    MAQUETTE_TRY_VOID(reader.line(text.substr(used), false));
  return reader.finish(text.size());
}

Result<ProgramSummary> read_gcode(const std::filesystem::path& program, const MotionSink& sink,
                                  const RunContext& run) {
  std::error_code ec;
  if (!std::filesystem::exists(program, ec))
    return fail(kFileNotFound,
                fmt::format("{}: no such file; expected a G-code program", program.string()));
  const std::unique_ptr<std::FILE, CloseFile> file(std::fopen(program.c_str(), "rb"));
  if (!file || std::filesystem::is_directory(program, ec))
    return fail(kFileNotReadable,
                fmt::format("{}: cannot be read ({}); expected a G-code program", program.string(),
                            file ? "it is a folder" : std::strerror(errno)));
  Reader reader(program.string(), sink, run);
  std::vector<char> buffer(kChunk);
  std::size_t held = 0;  // bytes of an unfinished line at the buffer's start
  std::uint64_t bytes = 0;
  for (;;) {
    const std::size_t got = std::fread(buffer.data() + held, 1, buffer.size() - held, file.get());
    if (got == 0 && std::ferror(file.get()) != 0)
      return fail(kFileNotReadable, fmt::format("{}: reading failed after {} bytes: {}",
                                                program.string(), bytes, std::strerror(errno)));
    bytes += got;
    const std::string_view text(buffer.data(), held + got);
    MAQUETTE_TRY(const std::size_t used, feed_lines(reader, text));
    if (reader.finished()) break;
    held = text.size() - used;
    if (got == 0 || held > kLongestLine) {  // the end, or a line that line() will refuse
      if (held > 0) MAQUETTE_TRY_VOID(reader.line(text.substr(used), false));
      break;
    }
    std::memmove(buffer.data(), buffer.data() + used, held);
    if (run.stopped())
      return fail(kCancelled, fmt::format("{}: reading was stopped", program.string()));
  }
  return reader.finish(bytes);
}

double length_mm(const Motion& motion) {
  const Vec3 d = motion.to_mm - motion.from_mm;
  if (motion.kind != Motion::Kind::arc) return norm(d);
  const std::size_t third = third_axis(motion.plane);
  auto radius = [&](Vec3 p) {
    auto arm = coordinates(p - motion.centre_mm);
    arm[third] = 0.0;
    return norm(Vec3{arm[0], arm[1], arm[2]});
  };
  const double mean = 0.5 * (radius(motion.from_mm) + radius(motion.to_mm));
  return std::hypot(mean * motion.sweep_rad, coordinates(d)[third]);
}

void for_each_chord(const Motion& motion, double deviation_mm,
                    const std::function<void(Vec3, Vec3)>& chord) {
  if (motion.kind != Motion::Kind::arc) {
    chord(motion.from_mm, motion.to_mm);
    return;
  }
  const std::size_t third = third_axis(motion.plane);
  const std::size_t first = (third + 1) % 3, second = (third + 2) % 3;
  const auto a = coordinates(motion.from_mm), b = coordinates(motion.to_mm),
             c = coordinates(motion.centre_mm);
  const double r0 = std::hypot(a[first] - c[first], a[second] - c[second]);
  const double r1 = std::hypot(b[first] - c[first], b[second] - c[second]);
  const double begin = std::atan2(a[second] - c[second], a[first] - c[first]);
  // P(phi) = r(phi) (cos, sin) with r linear: |P''| <= r + 2 |r'|; the third axis is linear.
  const double sweep = std::abs(motion.sweep_rad);
  const double curvature = std::fmax(r0, r1) + 2.0 * std::abs(r1 - r0) / sweep;
  const double pieces =
      std::fmax(1.0, std::ceil(sweep * std::sqrt(curvature / (8.0 * deviation_mm))));
  const auto n = static_cast<std::uint64_t>(pieces);
  Vec3 from = motion.from_mm;
  for (std::uint64_t i = 1; i <= n; ++i) {
    Vec3 to = motion.to_mm;
    if (i < n) {
      const double t = static_cast<double>(i) / pieces;
      const double phi = begin + t * motion.sweep_rad;
      const double r = r0 + t * (r1 - r0);
      std::array<double, 3> p{};
      p[first] = c[first] + r * std::cos(phi);
      p[second] = c[second] + r * std::sin(phi);
      p[third] = a[third] + t * (b[third] - a[third]);
      to = {p[0], p[1], p[2]};
    }
    chord(from, to);
    from = to;
  }
}

}  // namespace maquette::cnc
