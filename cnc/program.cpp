// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/program.hpp"

#include <algorithm>
#include <numbers>
#include <optional>

#include <fmt/format.h>

#include "cnc/arc_geometry.hpp"
#include "cnc/block_text.hpp"
#include "cnc/post_text.hpp"
#include "core/check.hpp"
#include "core/files.hpp"

namespace maquette::cnc {
namespace {

constexpr auto kUnknown = ToolPosition::kUnknown;
constexpr std::int64_t kFarthest = 1'000'000'000;  // ticks: 100 m
constexpr std::int64_t kEntryGap = 10'000;         // ticks: 1 mm
// Of a file with limits: what the end of a program takes, a move at most, a tool's head.
constexpr std::uint64_t kEndLines = 16, kMoveLines = 8, kToolLines = 16;
constexpr std::uint64_t kLineBytes = 64;
constexpr std::size_t kWriteAt = std::size_t{1} << 20;

/// An arc in its plane, axes in right-handed order.
struct PlaneArc {
  std::int64_t ToolPosition::*first;
  std::int64_t ToolPosition::*second;
  std::int64_t ToolPosition::*third;
  std::int64_t arm1, arm2;  // centre minus start, ticks; of an arc by its radius rounded
};
PlaneArc plane_arc(const ToolPosition& from, const PathMove& m) {
  using P = ToolPosition;
  const PlanePoint arm = arm_of(from, m);
  const std::int64_t u = std::llround(arm.u), v = std::llround(arm.v);
  if (m.plane == ArcPlane::xy) return {&P::x, &P::y, &P::z, u, v};
  if (m.plane == ArcPlane::zx) return {&P::z, &P::x, &P::y, u, v};
  return {&P::y, &P::z, &P::x, u, v};
}

}  // namespace

struct ProgramWriter::State {
  ProgramOptions options;
  Post post;
  std::filesystem::path path;
  BlockText text;
  PostWords words;
  std::vector<std::filesystem::path> paths;
  std::vector<AtomicFile> files;
  std::optional<Error> error;
  ProgramReport report;
  Tool tool;
  ToolPosition last;  // where the moves as given are
  std::int64_t safe;

  State(const std::filesystem::path& file, const ProgramOptions& o)
      : options(o),
        post(*post_by_name(o.post)),
        path(file),
        text(post, o.line_numbers, o.relative) {
    words.name = plain_name(o.name);
    set_limits(o);
  }

  void set_limits(const ProgramOptions& o) {
    options.blending = o.blending;
    options.safe_z = o.safe_z;
    options.entry_feed = o.entry_feed;
    // Never more than was allowed.
    words.tolerance =
        shortest(std::max(1e-4, std::floor(o.blending.value() * 1e5) / 1e5), 5, false);
    // Never lower.
    const double scale = post.decimals == 3 ? 1e3 : 1e4;
    const double units = std::ceil(o.safe_z.value() * scale - 1e-6);
    safe = static_cast<std::int64_t>(units) * text.unit();
    words.safe = shortest(units / scale, post.decimals, post.point);
  }

  Result<void> open_file() {
    std::filesystem::path name = path;
    if (!files.empty())
      name.replace_filename(fmt::format("{}_{}{}", path.stem().string(), files.size() + 1,
                                        path.extension().string()));
    MAQUETTE_TRY(auto file, AtomicFile::create(name));
    files.push_back(std::move(file));
    paths.push_back(std::move(name));
    return {};
  }

  void template_lines(std::string_view lines) {
    if (!lines.empty()) text.lines(filled(lines, words));
  }
  void write() {
    files.back().write(text.text());
    text.drop();
  }
  [[nodiscard]] bool has_room(std::uint64_t lines) const {
    const std::uint64_t all = text.line_count() + lines + kEndLines;
    return (options.max_lines == 0 || all <= options.max_lines) &&
           (options.max_bytes == 0 ||
            text.byte_count() + (lines + kEndLines) * kLineBytes <= options.max_bytes);
  }

  void head() {
    text.restart();
    words.number = options.number + static_cast<int>(files.size()) - 1;
    template_lines(post.open);
    if (!post.numbered && post.open.empty()) text.comment(options.name);
    text.comment(fmt::format("for {}, unit mm, z is the tip of the cutter", post.control));
    for (const std::string& comment : options.comments) text.comment(comment);
    if (files.size() > 1) text.comment(fmt::format("part {}", files.size()));
    template_lines(post.modes);
    template_lines(post.offsets[*offset_index(options.work_offset)]);
    tool_head(post.first_tool);
    if (!has_room(kMoveLines + kToolLines) && !error)
      error = Error{
          kProgramOptionOutOfRange,
          fmt::format("max_lines is {}, max_bytes {}; the head of the program alone has "
                      "{} lines and {} bytes: fewer comments, or larger files",
                      options.max_lines, options.max_bytes, text.line_count(), text.byte_count())};
  }
  void tool_head(std::string_view change) {
    text.comment(fmt::format("T{} {}", tool.number, tool.name));
    template_lines(change);
    if (!post.length_with_z) template_lines(post.length);
    if (words.rpm > 0.0) template_lines(post.spindle_on);
    if (options.coolant) template_lines(post.coolant_on);
    template_lines(options.blending.value() > 0.0 ? post.blend : post.exact);
    text.forget();
    length_pending = post.length_with_z;
  }
  void retreat() {
    if (text.exact().z != kUnknown && text.exact().z < safe) text.rapid({kUnknown, kUnknown, safe});
  }
  void tool_end() {
    retreat();
    if (options.blending.value() > 0.0) template_lines(post.blend_off);
    if (options.coolant) template_lines(post.coolant_off);
    template_lines(post.spindle_off);
    template_lines(post.retreat);
  }
  void end_file(std::string_view comment) {
    tool_end();
    if (!comment.empty()) text.comment(comment);
    template_lines(post.end);
    report.blocks += text.line_count();
    report.bytes += text.byte_count();
    write();
  }

  void next_file() {
    const ToolPosition at = text.exact();
    end_file(fmt::format("goes on in part {}", files.size() + 1));
    // Closed now, renamed at the end.
    if (auto closed = files.back().close(); !closed) error = closed.error();
    if (auto opened = open_file(); !opened) error = opened.error();
    if (error) return;
    head();
    if (at.z != kUnknown) enter(at, options.entry_feed.value());
  }
  void make_room(std::uint64_t lines) {
    if (!has_room(lines) && !error) next_file();
    if (text.text().size() >= kWriteAt) write();
  }

  /// At or above the safe height over `to`, from wherever the machine stands.
  void over(ToolPosition to) {
    const std::int64_t level = std::max(to.z, safe);
    if (length_pending) {
      text.rapid({to.x, to.y, kUnknown});
      template_lines(post.length);
      text.stands_at_z(safe);
      length_pending = false;
      if (level > safe) text.rapid({kUnknown, kUnknown, level});
      return;
    }
    if (text.exact().z == kUnknown || text.exact().z < level)
      text.rapid({kUnknown, kUnknown, level});
    text.rapid({to.x, to.y, kUnknown});
  }
  void enter(ToolPosition to, double feed) {
    over(to);
    if (to.z >= safe) {
      text.rapid(to);
      return;
    }
    text.rapid({kUnknown, kUnknown, std::min(safe, to.z + kEntryGap)});
    text.line(to, feed);
  }

  void rapid(ToolPosition to) {
    const ToolPosition at = text.exact();
    if (at.z == kUnknown || at.x == kUnknown) {
      over(to);
      text.rapid(to);
      return;
    }
    const int axes = (at.x != to.x) + (at.y != to.y) + (at.z != to.z);
    // At or above the safe height every way is free.
    const bool free = std::min(at.z, to.z) >= safe;
    if (axes > 1 && !post.straight_rapids && !free) over(to);
    text.rapid(to);
  }

  void arc(const PathMove& m) {
    const ToolPosition at = text.exact();
    const PlaneArc p = plane_arc(at, m);
    const auto number = [](std::int64_t v) { return static_cast<double>(v); };
    const PlanePoint start{-number(p.arm1), -number(p.arm2)};
    const PlanePoint end{start.u + number(m.to.*p.first - at.*p.first),
                         start.v + number(m.to.*p.second - at.*p.second)};
    const double r0 = std::hypot(start.u, start.v), r1 = std::hypot(end.u, end.v);
    MAQUETTE_CHECK(r0 > 0.0 && r1 > 0.0, "an arc without radius to ({}, {}, {})", m.to.x, m.to.y,
                   m.to.z);
    const double sweep = sweep_rad(start, end, m.counter_clockwise);
    const double chord = std::hypot(end.u - start.u, end.v - start.v);
    const double length =
        std::hypot(0.5 * (r0 + r1) * sweep, number(m.to.*p.third - at.*p.third)) * kTick_mm;
    count_cut(length, m.feed_mm_min);
    // Flat to half a unit of the last decimal: a line is as near, and always well defined.
    const double unit = number(text.unit());
    if (sweep < std::numbers::pi && chord * chord <= 4.0 * r0 * unit) {
      ++report.arcs_as_lines;
      text.line(m.to, m.feed_mm_min);
      return;
    }
    // As the control will see it, in units.
    const ToolPosition a = text.in_units(at), b = text.in_units(m.to);
    const PlanePoint centre{number(text.in_units(at.*p.first + p.arm1)),
                            number(text.in_units(at.*p.second + p.arm2))};
    const PlanePoint seen0{number(a.*p.first) - centre.u, number(a.*p.second) - centre.v};
    const PlanePoint seen1{number(b.*p.first) - centre.u, number(b.*p.second) - centre.v};
    const double s0 = std::hypot(seen0.u, seen0.v), s1 = std::hypot(seen1.u, seen1.v);
    bool plain = s0 > 0.0 && s1 > 0.0 &&
                 std::abs(s1 - s0) * unit * kTick_mm < 0.9 * post.arc_radius_tolerance_mm &&
                 (post.helices || m.to.*p.third == at.*p.third);
    // Where start and end are near each other, rounding must not make a whole turn of a short
    // way, nor the other way round.
    if (plain && chord < 16.0 * unit)
      plain = std::abs(sweep_rad(seen0, seen1, m.counter_clockwise) - sweep) < 1.0;
    if (plain) {
      text.arc(m);
      return;
    }
    ++report.arcs_as_chords;
    chords(m, p, at, start, r0, r1, sweep);
  }
  void chords(const PathMove& m, const PlaneArc& p, ToolPosition at, PlanePoint start, double r0,
              double r1, double sweep) {
    // Equal shares of the sweep: arc and chord are apart by at most r (d phi)^2 / 8.
    const double deviation = options.arc_chords.value() / kTick_mm;
    const double pieces =
        std::fmax(1.0, std::ceil(sweep * std::sqrt(std::fmax(r0, r1) / (8.0 * deviation))));
    const double begin = std::atan2(start.v, start.u);
    const auto part = [](std::int64_t from, std::int64_t to, double t) {
      return from + std::llround(t * static_cast<double>(to - from));
    };
    for (double i = 1.0; i < pieces; ++i) {
      const double t = i / pieces, r = r0 + t * (r1 - r0);
      const double phi = begin + (m.counter_clockwise ? t * sweep : -t * sweep);
      ToolPosition to;
      to.*p.first = at.*p.first + p.arm1 + std::llround(r * std::cos(phi));
      to.*p.second = at.*p.second + p.arm2 + std::llround(r * std::sin(phi));
      to.*p.third = part(at.*p.third, m.to.*p.third, t);
      text.line(to, m.feed_mm_min);
      make_room(kMoveLines);
      if (error) return;
    }
    text.line(m.to, m.feed_mm_min);
  }

  void count_cut(double length_mm, double feed_mm_min) {
    ++report.cutting_moves;
    report.cutting_length_mm += length_mm;
    report.cutting_time_min += length_mm / feed_mm_min;
  }
  static double distance_mm(ToolPosition a, ToolPosition b) {
    const auto dx = static_cast<double>(b.x - a.x), dy = static_cast<double>(b.y - a.y),
               dz = static_cast<double>(b.z - a.z);
    return std::sqrt(dx * dx + dy * dy + dz * dz) * kTick_mm;
  }

  void add(const PathMove& m) {
    const ToolPosition at = text.exact();
    const auto near = [](std::int64_t v) { return v >= -kFarthest && v <= kFarthest; };
    MAQUETTE_CHECK(near(m.to.x) && near(m.to.y) && near(m.to.z), "a move to ({}, {}, {})", m.to.x,
                   m.to.y, m.to.z);
    if (m.kind == PathMove::Kind::rapid) {
      ++report.rapid_moves;
      if (at.x != kUnknown && at.z != kUnknown) report.rapid_length_mm += distance_mm(at, m.to);
      rapid(m.to);
      return;
    }
    MAQUETTE_CHECK(at.x != kUnknown && at.z != kUnknown, "a cut from an unknown place");
    MAQUETTE_CHECK(m.feed_mm_min > 0.0 && m.feed_mm_min <= 1e6, "feed {}", m.feed_mm_min);
    if (m.kind == PathMove::Kind::line) {
      count_cut(distance_mm(at, m.to), m.feed_mm_min);
      text.line(m.to, m.feed_mm_min);
    } else {
      arc(m);
    }
  }

  void set_tool(const Tool& next, double rpm) {
    tool = next;
    words.tool = next.number;
    words.rpm = rpm;
  }

  bool started = false;
  bool length_pending = false;
};

ProgramWriter::ProgramWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
ProgramWriter::ProgramWriter(ProgramWriter&&) noexcept = default;
ProgramWriter& ProgramWriter::operator=(ProgramWriter&&) noexcept = default;
ProgramWriter::~ProgramWriter() = default;

Result<ProgramWriter> ProgramWriter::create(const std::filesystem::path& path,
                                            const ProgramOptions& options) {
  MAQUETTE_TRY_VOID(check_options(options));
  auto state = std::make_unique<State>(path, options);
  MAQUETTE_TRY_VOID(state->open_file());
  return ProgramWriter(std::move(state));
}

void ProgramWriter::tool(const Tool& tool, double spindle_rpm) {
  State& s = *state_;
  MAQUETTE_CHECK(tool.number >= 1 && tool.number <= 99999, "tool {}", tool.number);
  MAQUETTE_CHECK(spindle_rpm >= 0.0 && spindle_rpm <= 1e6, "{} 1/min", spindle_rpm);
  if (s.error) return;
  if (s.started) s.make_room(kToolLines);
  if (s.started) s.tool_end();
  s.set_tool(tool, spindle_rpm);
  if (s.started)
    s.tool_head(s.post.next_tool);
  else
    s.head();
  s.started = true;
}

void ProgramWriter::operation(const Tool& tool, double spindle_rpm, const ProgramOptions& options) {
  State& s = *state_;
  MAQUETTE_CHECK(std::isfinite(options.safe_z.value()), "safe height {}", options.safe_z.value());
  if (s.error) return;
  const auto say = [&] {
    for (const std::string& comment : options.comments) s.text.comment(comment);
  };
  if (!s.started) {
    s.set_limits(options);
    s.set_tool(tool, spindle_rpm);
    s.head();
    s.started = true;
    return say();
  }
  s.make_room(kToolLines + options.comments.size());
  if (s.error) return;
  const bool stays = s.tool.number == tool.number && s.words.rpm == spindle_rpm;
  // As high as the operation before had to go.
  if (stays)
    s.retreat();
  else
    s.tool_end();
  if (stays && s.options.blending.value() > 0.0) s.template_lines(s.post.blend_off);
  s.set_limits(options);
  s.set_tool(tool, spindle_rpm);
  say();
  if (stays)
    s.template_lines(options.blending.value() > 0.0 ? s.post.blend : s.post.exact);
  else
    s.tool_head(s.post.next_tool);
  s.text.forget();
}

ProgramPlace ProgramWriter::place() const {
  return {state_->files.size() - 1, state_->text.line_count()};
}

void ProgramWriter::comment(std::string_view text) {
  MAQUETTE_CHECK(state_->started, "a comment before the first tool");
  state_->make_room(2 + text.size() / 32);
  if (!state_->error) state_->text.comment(text);
}

void ProgramWriter::lines(std::string_view text) {
  State& s = *state_;
  MAQUETTE_CHECK(s.started, "lines before the first tool");
  s.make_room(static_cast<std::uint64_t>(std::count(text.begin(), text.end(), '\n')) + 2);
  if (s.error) return;
  s.text.lines(text);
  s.text.forget();
}

void ProgramWriter::go_to(ToolPosition start, double feed_mm_min) {
  State& s = *state_;
  MAQUETTE_CHECK(s.started, "go_to before the first tool");
  s.make_room(kMoveLines);
  if (s.error) return;
  s.retreat();
  s.enter(start, feed_mm_min);
}

Result<void> ProgramWriter::add(std::span<const PathMove> moves) {
  State& s = *state_;
  MAQUETTE_CHECK(s.started, "a move before the first tool");
  for (const PathMove& move : moves) {
    s.make_room(kMoveLines);
    if (s.error) return tl::unexpected(*s.error);
    s.add(move);
  }
  return {};
}

Result<void> ProgramWriter::add(const Toolpath& path) {
  if (!(state_->text.exact() == path.start)) {
    PathMove above;
    above.kind = PathMove::Kind::rapid;
    above.to = path.start;
    MAQUETTE_TRY_VOID(add({&above, 1}));
  }
  return add(path.moves);
}

Result<ProgramReport> ProgramWriter::commit() {
  State& s = *state_;
  MAQUETTE_CHECK(s.started, "a program without a tool");
  if (s.error) return tl::unexpected(*s.error);
  s.end_file(s.files.size() > 1 ? fmt::format("end of the last of {} parts", s.files.size()) : "");
  // The first one last: who finds it finds the others.
  for (std::size_t i = s.files.size(); i-- > 0;) MAQUETTE_TRY_VOID(s.files[i].commit());
  s.report.files = s.paths;
  return s.report;
}

}  // namespace maquette::cnc
