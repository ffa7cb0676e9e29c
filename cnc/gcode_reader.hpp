// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gcode_reader.hpp
/// RS-274 program -> stream of motions of the tip. Streams the file: memory does not
/// grow with its length.
///
/// Takes   a program in the model frame; the active work coordinate system is the
///         model frame, the programmed point is the ball's lowest point (so tool
///         length offsets, G43 and kin, change nothing)
/// Gives   Motion in millimetres and mm/min, whatever units the program uses
///
/// Words that act: G0 G1 G2 G3 (I J K, G90.1/G91.1, R, helices, P turns), G4, G10 L2 L20, G17
/// G18 G19, G20 G21, G28 G30, G38.2 .. G38.5, G53 (rapids), G54 .. G59.3, G54.1 P, G154 P, G80,
/// G90 G91, G92 G92.1 G92.2 G92.3, F, T, M0 M1 (with T), M2 M6 M30 M61, M98 M99, O words
/// (gcode_control.hpp), '%', block delete '/', parameters and expressions (gcode_words.hpp).
/// Words that are read and change no place: G5.1 G61 G61.1 G64 G187, which the time depends on;
/// G8, G40, G43 G43.1 G43.2 G49, G50, G94, G97, G98 G99, G10 of the tool table, M3 .. M9, M19, M48
/// .. M53, M60, S, N, D, H. Everything else is CNC_GCODE_UNSUPPORTED, never skipped in silence:
/// cutter radius compensation, canned cycles, G93 G95, splines, rotary and secondary axes, a second
/// work coordinate system after the first motion.
///
/// Subprograms: "o.. sub" .. "endsub" with call, arguments #1 .. #30 and locals of their own;
/// M98 P L to "O.." .. M99 anywhere in the file. Loops and branches of O words. Other files are
/// not looked for. At most 10 calls deep; a block that may run more than once is kept in
/// memory (at most 256 MiB), a loop of 10^6 lines without motion is an error.
///
/// Tools: a motion has the number that the last M6 (or M61, or T beside M0) has loaded; before
/// the first of these T alone counts, for controls whose cutter is changed by hand.
///
/// Programs that begin with BEGIN PGM are Heidenhain's: heidenhain_reader.hpp.
///
/// Start state: G21 G17 G90 G91.1 G94, no motion mode, no feed, position unknown. An axis
/// stays unknown until a move gives it an absolute value; a G53 move makes it
/// unknown again, for only the machine knows where the two frames lie; so do G28 and G30 (by
/// way of the place given), a probing move (it ends where it touches; one by G91 from there gives
/// no motion) and G10 L2. G10 L20 makes it known: the model frame is what the program calls so from
/// there on. A rapid with an unknown axis at either end gives no motion; a cut towards an unknown
/// coordinate is an error, and a cut from an unknown place starts where it ends.
///
/// Lines that begin with '/' are skipped, as with the machine's block delete switch on;
/// the summary counts them. A value that follows '(' .. ')' or blanks inside a number is
/// read as the standard says: "X 1 2.5" is X12.5.
///
/// Controls differ in two things: a number without a point is whole millimetres or inches here
/// (Fanuc's DPI = 1), and F beside G20 or G21 is in the new unit (Grbl; LinuxCNC: the old one).
///
/// Speed: 8 M blocks/s of lines, one thread; Heidenhain 4 M.
/// Sources: NISTIR 6556, doi:10.6028/NIST.IR.6556; LinuxCNC 2.9, "G Codes", "O Codes"; Fanuc
/// B-64604EN, Haas 96-8210.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "cnc/program_lines.hpp"
#include "cnc/toolpath.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

/// The two radii of an arc (to its start, to its end) may differ by the larger of the
/// two; the radius then changes evenly along the arc. More is CNC_GCODE_ARC.
inline constexpr double kArcRadiusTolerance_mm = 0.005;
inline constexpr double kArcRadiusToleranceRelative = 0.001;

struct Motion {
  enum class Kind : std::uint8_t { rapid, line, arc };
  Kind kind = Kind::line;
  ArcPlane plane = ArcPlane::xy;
  Vec3 from_mm, to_mm;
  Vec3 centre_mm;          ///< arcs: of the start; the plane's normal axis is from_mm's
  double sweep_rad = 0.0;  ///< arcs: > 0 counter-clockwise (G3), whole turns included
  double feed_mm_min = 0.0;
  std::uint64_t line = 0;
  int tool = 0;  ///< number in the tool table, 0 before any is named
  std::optional<PathControl>
      control{};       ///< as G61, G61.1, G64 P, G187 E, G5.1 Q or cycle 32 have said
  bool probe = false;  ///< ends where the probe touches, at the latest at to_mm
};

/// Length of the path, mm. For an arc whose radius changes, that of the mean radius.
[[nodiscard]] double length_mm(const Motion& motion);

/// Replaces an arc by chords whose ends lie on it and that stay within
/// `deviation_mm` of it: at equal share of the sweep, arc and chord are apart by at
/// most max|P''| (dphi)^2 / 8. A line gives itself.
void for_each_chord(const Motion& motion, double deviation_mm,
                    const std::function<void(Vec3 from_mm, Vec3 to_mm)>& chord);

struct ProgramSummary {
  std::uint64_t bytes = 0, lines = 0;
  std::uint64_t blocks = 0;  ///< lines with a word
  std::uint64_t motions = 0;
  std::uint64_t skipped_blocks = 0;  ///< block delete
  std::uint64_t tool_changes = 0;    ///< M6
  double dwell_s = 0.0;
  bool ended = false;  ///< by M2, M30 or '%'
};

/// Receives motions in program order, some thousands at a time; an error ends the reading.
using MotionSink = std::function<Result<void>(std::span<const Motion>)>;

/// @return summary, or CORE_FILE_NOT_FOUND, CORE_FILE_NOT_READABLE, CORE_CANCELLED, or
///         one of verify.hpp's G-code errors as "file:line:column: found .., expected ..".
///         CNC_GCODE_TRUNCATED: the file ends without M2, M30 or closing '%', and either
///         began with '%' or its last line has no line end.
[[nodiscard]] Result<ProgramSummary> read_gcode(const std::filesystem::path& program,
                                                const MotionSink& sink, const RunContext& run = {});

/// The same for a program in memory; `name` stands for the file in messages.
[[nodiscard]] Result<ProgramSummary> read_gcode_text(std::string_view text, std::string_view name,
                                                     const MotionSink& sink,
                                                     const RunContext& run = {});

}  // namespace maquette::cnc
