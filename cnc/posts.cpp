// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/posts.hpp"

namespace maquette::cnc {
namespace {

// LinuxCNC 2.9, "G Codes" and "INI Configuration" of its documentation: lines of up to 255
// characters; G64 P is the deviation, Q the thinning of collinear points, which a certified
// path must not have; CENTER_ARC_RADIUS_TOLERANCE_MM is 0.00127 unless the machine says more.
constexpr Post kLinuxCnc{
    .name = "linuxcnc",
    .control = "LinuxCNC 2.9",
    .extension = "ngc",
    .last_line_number = 99999,
    .exact_increments = true,
    .modes = "G21 G90 G17 G94 G40 G49 G80",
    .offsets = {"G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"},
    .first_tool = "T{tool} M6",
    .next_tool = "G17 T{tool} M6",
    .length = "G43 H{tool}",
    .spindle_on = "S{rpm} M3",
    .spindle_off = "M5",
    .coolant_on = "M8",
    .coolant_off = "M9",
    .blend = "G64 P{tolerance} Q0",
    .exact = "G61",
    .end = "M30",
};

// Grbl 1.1, its wiki ("Grbl v1.1 Commands") and gcode.c: refuses M6, G43, G64 and G59.1; keeps
// T; M0 waits; lines of 79 characters; numbers are binary32; the radii of an arc may differ by
// 0.005 mm. It does not wait for the spindle, so the program does.
constexpr Post kGrbl{
    .name = "grbl",
    .control = "Grbl 1.1",
    .extension = "nc",
    .longest_line = 79,
    .arc_radius_tolerance_mm = 0.005,
    .modes = "G21 G90 G17 G94 G40 G49 G80",
    .offsets = {"G54", "G55", "G56", "G57", "G58", "G59"},
    .first_tool = "T{tool}",
    .next_tool = "G17 T{tool} M0",
    .spindle_on = "S{rpm} M3\nG4 P4",
    .spindle_off = "M5",
    .coolant_on = "M8",
    .coolant_off = "M9",
    .end = "M30",
};

// Fanuc Series 0i-F and 30i, "Operator's Manual (Common)", B-64604EN and B-64484EN: increment
// system IS-B, 0.001 mm, finer digits are lost; whole numbers without a point count least
// increments (parameter 3401#0 DPI); G28 over the present height; G43 with Z; G05.1 Q1 AI
// contour control, whose tolerance is the machine builder's; G54.1 P1 on; rapids run axis by
// axis unless parameter 1401#1 LRP says otherwise; parameter 3410 holds the arc tolerance.
constexpr Post kFanuc{
    .name = "fanuc",
    .control = "Fanuc 0i / 30i",
    .extension = "nc",
    .decimals = 3,
    .point = true,
    .last_line_number = 99999,
    .exact_increments = true,
    .straight_rapids = false,
    .arc_radius_tolerance_mm = 0.01,
    .open = "%\nO{number:4}({name})",
    .modes = "G21\nG0 G17 G40 G49 G80 G90 G94",
    .offsets = {"G54", "G55", "G56", "G57", "G58", "G59", "G54.1 P1", "G54.1 P2", "G54.1 P3"},
    .retreat = "G91 G28 Z0.\nG90",
    .first_tool = "T{tool} M6",
    .next_tool = "G17 T{tool} M6",
    .length_with_z = true,
    .length = "G43 H{tool} Z{safe}",
    .spindle_on = "S{rpm} M3",
    .spindle_off = "M5",
    .coolant_on = "M8",
    .coolant_off = "M9",
    .blend = "G5.1 Q1",
    .blend_off = "G5.1 Q0",
    .end = "M30\n%",
};

// Haas NGC, "Mill Operator's Manual", 96-8210: five digits of program number, three decimals
// in millimetres, F needs its point (setting 77), G187 P3 E finish with the largest rounding of
// a corner, G154 P1 on for more offsets, rapids run axis by axis (setting 335).
constexpr Post kHaas{
    .name = "haas",
    .control = "Haas NGC",
    .extension = "nc",
    .decimals = 3,
    .point = true,
    .last_line_number = 99999,
    .exact_increments = true,
    .straight_rapids = false,
    .arc_radius_tolerance_mm = 0.01,
    .open = "%\nO{number:5}({name})",
    .modes = "G21\nG0 G17 G40 G49 G80 G90 G94",
    .offsets = {"G54", "G55", "G56", "G57", "G58", "G59", "G154 P1", "G154 P2", "G154 P3"},
    .retreat = "G53 G0 Z0.",
    .first_tool = "T{tool} M6",
    .next_tool = "G17 T{tool} M6",
    .length_with_z = true,
    .length = "G43 H{tool} Z{safe}",
    .spindle_on = "S{rpm} M3",
    .spindle_off = "M5",
    .coolant_on = "M8",
    .coolant_off = "M9",
    .blend = "G187 P3 E{tolerance}",
    .blend_off = "G187",
    .end = "M30\n%",
};

// Heidenhain TNC 640 and iTNC 530, "User's Manual for Conversational Programming": every block
// numbered from 0; TOOL CALL takes up the length and speed and changes at the builder's place;
// cycle 247 sets the datum, cycle 32 the contour tolerance; arcs by centre CC and end point C,
// also in planes through the tool axis, end on the circle within 0.016 mm (circleDeviation);
// helices only in polar coordinates with an end angle, too coarse here, hence chords.
constexpr Post kHeidenhain{
    .name = "heidenhain",
    .control = "Heidenhain TNC 640 / iTNC 530, conversational",
    .extension = "h",
    .conversational = true,
    .longest_line = 128,
    .last_line_number = 999999999,
    .numbered = true,
    .comment_open = "; ",
    .comment_close = "",
    .helices = false,
    .arc_radius_tolerance_mm = 0.016,
    .open = "BEGIN PGM {name} MM",
    .offsets = {"CYCL DEF 247 DATUM SETTING ~\nQ339=+1 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+2 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+3 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+4 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+5 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+6 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+7 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+8 ;DATUM NUMBER",
                "CYCL DEF 247 DATUM SETTING ~\nQ339=+9 ;DATUM NUMBER"},
    .first_tool = "TOOL CALL {tool} Z S{rpm}",
    .next_tool = "TOOL CALL {tool} Z S{rpm}",
    .spindle_on = "M3",
    .spindle_off = "M5",
    .coolant_on = "M8",
    .coolant_off = "M9",
    .blend = "CYCL DEF 32.0 TOLERANCE\nCYCL DEF 32.1 T{tolerance}",
    .blend_off = "CYCL DEF 32.0 TOLERANCE\nCYCL DEF 32.1",
    .end = "M30\nEND PGM {name} MM",
};

constexpr std::array kPosts{kLinuxCnc, kGrbl, kFanuc, kHeidenhain, kHaas};

}  // namespace

std::optional<Post> post_by_name(std::string_view name) {
  for (const Post& post : kPosts)
    if (post.name == name) return post;
  return std::nullopt;
}

std::string post_names() {
  std::string names;
  for (const Post& post : kPosts) names.append(names.empty() ? "" : ", ").append(post.name);
  return names;
}

}  // namespace maquette::cnc
