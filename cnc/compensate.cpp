// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/compensate.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <optional>
#include <span>
#include <string>

#include <fmt/format.h>

#include "cnc/cutter_location.hpp"
#include "cnc/gcode_reader.hpp"
#include "core/files.hpp"

namespace maquette::cnc {
namespace {

constexpr double kLeastPiece_mm = 0.02;
constexpr double kStill_mm = 1e-7;  // an axis that moves less does not turn back

double& axis_of(Vec3& v, int axis) {
  return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}
double axis_of(const Vec3& v, int axis) {
  return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

double between(const MachineErrors::Straightness& s, double at) {
  if (s.position_mm.empty()) return 0.0;
  const auto next = std::upper_bound(s.position_mm.begin(), s.position_mm.end(), at);
  if (next == s.position_mm.begin()) return s.error_mm.front();
  if (next == s.position_mm.end()) return s.error_mm.back();
  const auto i = static_cast<std::size_t>(next - s.position_mm.begin());
  const double share = (at - s.position_mm[i - 1]) / (s.position_mm[i] - s.position_mm[i - 1]);
  return s.error_mm[i - 1] + share * (s.error_mm[i] - s.error_mm[i - 1]);
}

struct Word {
  char letter;
  std::string text;  ///< with its letter
  double value;
};

/// Words of a block, comments and the rest; none: '#', '[' or a word of control flow.
std::optional<std::vector<Word>> words_of(const std::string& line, std::string& comments) {
  std::vector<Word> words;
  for (std::size_t i = 0; i < line.size();) {
    const char c = static_cast<char>(std::toupper(static_cast<unsigned char>(line[i])));
    if (c == '(' || c == ';') {
      const std::size_t end =
          c == '(' ? std::min(line.find(')', i), line.size() - 1) + 1 : line.size();
      comments.append(" ").append(line, i, end - i);
      i = end;
    } else if (std::isspace(static_cast<unsigned char>(c)) || c == '%' || c == '/') {
      ++i;
    } else if (c >= 'A' && c <= 'Z' && c != 'O') {
      std::size_t end = i + 1;
      while (end < line.size() &&
             (std::isdigit(static_cast<unsigned char>(line[end])) || line[end] == '.' ||
              line[end] == '-' || line[end] == '+' || line[end] == ' '))
        ++end;
      std::string number = line.substr(i + 1, end - i - 1);
      std::erase(number, ' ');
      words.push_back({c, fmt::format("{}{}", c, number), std::strtod(number.c_str(), nullptr)});
      i = end;
    } else {
      return std::nullopt;
    }
  }
  return words;
}

class Rewriter {
 public:
  Rewriter(std::filesystem::path name, const MachineErrors& errors,
           const CompensateOptions& options, std::ostream& out)
      : name_(std::move(name)), in_(name_), errors_(errors), options_(options), out_(out) {
    if (options.design == nullptr || errors.radius_error_mm == 0.0) return;
    programmed_.emplace(*options.design, Cutter::ball(options.ball_radius_mm));
    real_.emplace(*options.design, Cutter::ball(options.ball_radius_mm + errors.radius_error_mm));
  }

  Result<void> take(std::span<const Motion> motions) {
    for (const Motion& m : motions) {
      if (m.line < line_ || (m.line == line_ && !rewritten_))
        return flat("it is run more than once");
      while (line_ < m.line) MAQUETTE_TRY_VOID(next(m.line));
      MAQUETTE_TRY_VOID(rewrite(m));
    }
    return {};
  }
  /// What follows the last motion.
  Result<void> finish() {
    while (!ended_) MAQUETTE_TRY_VOID(next(0));
    while (figures.marks.size() < options_.marks.size()) figures.marks.push_back(lines_out_);
    if (most_at_ == std::streampos(-1)) return {};
    out_.seekp(most_at_);
    out_ << fmt::format("{:8.4f}", figures.largest_mm);
    return {};
  }
  CompensateFigures figures;

 private:
  tl::unexpected<Error> flat(const std::string& why) const {
    return fail(kNotFlat, fmt::format("{}:{}: {}; only a program of absolute moves in mm, each "
                                      "line once, can be rewritten: have it posted so",
                                      name_.string(), line_, why));
  }

  /// Reads a line; those before `motion` go out as they are.
  Result<void> next(std::uint64_t motion) {
    if (!std::getline(in_, text_)) {
      ended_ = true;
      return motion == 0 ? Result<void>{} : flat("the file has changed while it was read");
    }
    while (figures.marks.size() < options_.marks.size() &&
           options_.marks[figures.marks.size()] <= line_)
      figures.marks.push_back(lines_out_);
    ++line_;
    rewritten_ = false;
    comments_.clear();
    auto words = words_of(text_, comments_);
    if (!words) {
      if (line_ == motion) return flat("parameters or control flow");
      words.emplace();
    }
    words_ = std::move(*words);
    if (!words_.empty() && !headed_) head();
    for (const Word& w : words_) {
      if (w.letter != 'G') continue;
      const int code = static_cast<int>(std::lround(10.0 * w.value));
      for (const int refused : {200, 700, 920, 520, 100, 930})
        if (code == refused) return flat(w.text + " stands here");
      if (code == 900 || code == 910) relative_ = code == 910;
    }
    if (line_ != motion) {
      out_ << text_ << '\n';
      ++lines_out_;
      rewritten_ = true;
    }
    return {};
  }

  /// Before the first block; how far the path is moved is filled in at the end.
  void head() {
    headed_ = true;
    if (options_.head.empty()) return;
    for (const std::string& comment : options_.head) out_ << '(' << comment << ")\n";
    out_ << "(called at most ";
    most_at_ = out_.tellp();
    out_ << fmt::format("{:8.4f}", 0.0) << " mm beside where it is meant to be)\n";
    lines_out_ += options_.head.size() + 1;
  }

  [[nodiscard]] double corner_mm(int tool) const {
    for (const Tool& t : options_.tools)
      if (t.number == tool) return t.cutter.corner_radius_mm;
    return options_.tools.empty() ? options_.ball_radius_mm
                                  : options_.tools.front().cutter.corner_radius_mm;
  }

  [[nodiscard]] Vec3 called(Vec3 p, const Motion& m) const {
    if (programmed_ && m.kind != Motion::Kind::rapid && errors_.tool_counts(m.tool)) {
      const double was = programmed_->drop(p.x, p.y).tip_mm, is = real_->drop(p.x, p.y).tip_mm;
      if (std::isfinite(was) && std::isfinite(is)) p.z += is - was;
    }
    const Vec3 up{0.0, 0.0, corner_mm(m.tool)};
    p = errors_.machine_from_part.point(p + up) - up;
    Vec3 q = p;
    for (int step = 0; step < 2; ++step) q = p - errors_.at(q, m.tool);
    return q;
  }

  void out(const std::string& head, bool rapid, Vec3 p, const std::string& tail) {
    const auto zero = [](double v) { return std::abs(v) < 5e-5 ? 0.0 : v; };
    out_ << fmt::format("{}{} X{:.4f} Y{:.4f} Z{:.4f}{}\n", head, rapid ? "G0" : "G1", zero(p.x),
                        zero(p.y), zero(p.z), tail);
    ++figures.lines;
    ++lines_out_;
  }

  /// A called place with the slack taken up, and the move that does so where an axis turns.
  void go(Vec3 from, Vec3 to, const std::string& head, bool rapid, const std::string& tail) {
    bool turned = false;
    for (int axis = 0; axis < 3; ++axis) {
      const double step = axis_of(to, axis) - axis_of(from, axis);
      if (std::abs(step) < kStill_mm) continue;
      const double side = step > 0.0 ? 1.0 : -1.0;
      turned |= axis_of(errors_.backlash_mm, axis) != 0.0 && axis_of(side_, axis) == -side;
      axis_of(side_, axis) = side;
    }
    const auto taken_up = [&](Vec3 p) {
      return p + 0.5 * Vec3{side_.x * errors_.backlash_mm.x, side_.y * errors_.backlash_mm.y,
                            side_.z * errors_.backlash_mm.z};
    };
    if (turned && !rapid) {
      out(head, false, taken_up(from), tail);
      ++figures.take_ups;
    }
    out(turned && !rapid ? "" : head, rapid, taken_up(to), turned && !rapid ? "" : tail);
  }

  /// Splits until the called line is straight enough.
  void split(Vec3 a, Vec3 b, Vec3 called_a, Vec3 called_b, const Motion& m,
             std::vector<Vec3>& places) {
    const Vec3 middle = 0.5 * (a + b), called_middle = called(middle, m);
    if (m.kind != Motion::Kind::rapid && norm(b - a) > 2.0 * kLeastPiece_mm &&
        norm(called_middle - 0.5 * (called_a + called_b)) > kMapping_mm) {
      split(a, middle, called_a, called_middle, m, places);
      split(middle, b, called_middle, called_b, m, places);
      return;
    }
    places.push_back(called_b);
  }

  Result<void> rewrite(const Motion& m) {
    const bool rapid = m.kind == Motion::Kind::rapid;
    if (m.probe) return flat("a probing move");
    const bool by_machine = std::any_of(words_.begin(), words_.end(), [](const Word& w) {
      return w.letter == 'G' && (w.value == 28.0 || w.value == 30.0 || w.value == 53.0);
    });
    if (relative_ || by_machine) {  // home from where it stands, as controls are sent at the end
      if (!(m.from_mm == m.to_mm))
        return flat(relative_ ? "a move in G91" : "a move by the machine's own coordinates");
      if (!rewritten_) {
        out_ << text_ << '\n';
        ++lines_out_;
      }
      rewritten_ = true;
      return {};
    }
    // Words that are not of the motion stay with its first piece; what ends it, with its last.
    std::string head, tail;
    if (!rewritten_)
      for (const Word& w : words_) {
        const bool motion_word = w.letter == 'G' && (w.value == 0.0 || w.value == 1.0 ||
                                                     w.value == 2.0 || w.value == 3.0);
        if (motion_word || std::string("XYZIJKR").find(w.letter) != std::string::npos ||
            (w.letter == 'P' && m.kind == Motion::Kind::arc))
          continue;
        if (w.letter == 'M' && (w.value < 3.0 || w.value == 30.0))
          return flat("the program stops in a line that moves");
        (w.letter == 'F' || w.letter == 'M' ? tail : head) +=
            w.letter == 'F' || w.letter == 'M' ? " " + w.text : w.text + " ";
      }
    tail += rewritten_ ? "" : comments_;
    rewritten_ = true;
    ++figures.moves;
    std::vector<Vec3> places;
    Vec3 at = called(m.from_mm, m);
    const Vec3 start = at;
    const auto piece = [&](Vec3 a, Vec3 b) {
      const Vec3 end = called(b, m);
      split(a, b, at, end, m, places);
      at = end;
    };
    if (m.kind == Motion::Kind::arc)
      for_each_chord(m, kMapping_mm, piece);
    else
      piece(m.from_mm, m.to_mm);
    const Vec3 d = at - m.to_mm;
    figures.largest_mm =
        std::max({figures.largest_mm, std::abs(d.x), std::abs(d.y), std::abs(d.z)});
    at = start;
    for (const Vec3& p : places) {
      go(at, p, &p == places.data() ? head : "", rapid, &p == places.data() ? tail : "");
      at = p;
    }
    return {};
  }

  std::filesystem::path name_;
  std::ifstream in_;
  const MachineErrors& errors_;
  const CompensateOptions& options_;
  std::ostream& out_;
  std::streampos most_at_ = -1;  // where the head says how far the path is moved
  std::uint64_t lines_out_ = 0;
  bool headed_ = false;
  std::optional<DropCutter> programmed_, real_;
  std::string text_, comments_;
  std::vector<Word> words_;
  std::uint64_t line_ = 0;
  bool rewritten_ = true, ended_ = false, relative_ = false;
  Vec3 side_;  // from which each axis was last moved: -1, 1; 0: not known
};

}  // namespace

Vec3 MachineErrors::at(Vec3 p, int number) const {
  const Vec3 q = 1e-6 * (p - exact_at_mm);
  Vec3 d{scale_um_per_m.x * q.x + squareness_xy_urad * q.y + squareness_xz_urad * q.z,
         squareness_yx_urad * q.x + scale_um_per_m.y * q.y + squareness_yz_urad * q.z,
         squareness_zx_urad * q.x + squareness_zy_urad * q.y + scale_um_per_m.z * q.z};
  if (tool_counts(number)) d.z += length_offset_mm;
  for (const Straightness& s : straightness) axis_of(d, s.moves) += between(s, axis_of(p, s.along));
  return d;
}

Result<CompensateFigures> compensate(const std::filesystem::path& program,
                                     const MachineErrors& errors, const CompensateOptions& options,
                                     const std::filesystem::path& out, const RunContext& run) {
  AtomicPath file(out);
  MAQUETTE_TRY_VOID(file.prepare());
  std::ofstream stream(file.path(), std::ios::binary);
  Rewriter rewriter(program, errors, options, stream);
  MAQUETTE_TRY(const auto summary,
               read_gcode(
                   program, [&](std::span<const Motion> m) { return rewriter.take(m); }, run));
  (void)summary;
  MAQUETTE_TRY_VOID(rewriter.finish());
  stream.close();
  if (!stream) return tl::unexpected(write_error(out, errno));
  MAQUETTE_TRY_VOID(file.commit());
  return rewriter.figures;
}

}  // namespace maquette::cnc
