// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file placing_template.hpp
/// Where the stones go, at 1:1, to be laid on the milled surface: as sheets of paper and as a
/// drawing for a plotter or a laser.
///
/// Takes   outlines, centres and headings in the model frame, millimetres, seen from above
/// Gives   PDF of A4 or A3 sheets that overlap; DXF
/// Errors  CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL, EXPORT_OPTION_OUT_OF_RANGE

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "core/result.hpp"

namespace maquette::exporting {

struct TemplateStone {
  int number = 0;
  std::string part;                               ///< of the catalogue
  std::vector<std::array<double, 2>> outline_mm;  ///< on the ground, not closed; may be empty
  std::array<double, 2> centre_mm{};
  double heading_deg = 0.0;  ///< of the long axis, from x towards y
  double radius_mm = 1.0;    ///< where the heading's tick ends
};

struct PlacingTemplate {
  std::string name;                           ///< on every sheet
  std::array<double, 2> min_mm{}, max_mm{};   ///< the part's outline
  std::vector<std::array<double, 4>> joints;  ///< x, y, x, y: where bands meet
  std::vector<TemplateStone> stones;
};

struct Sheet {
  double width_mm = 210.0, height_mm = 297.0;
  double margin_mm = 12.0;   ///< printers leave it white; the sheet's title stands there
  double overlap_mm = 15.0;  ///< of neighbours
  [[nodiscard]] double window_width_mm() const { return width_mm - 2.0 * margin_mm; }
  [[nodiscard]] double window_height_mm() const { return height_mm - 2.0 * margin_mm; }
};
[[nodiscard]] inline Sheet a4_sheet() {
  return {};
}
[[nodiscard]] inline Sheet a3_sheet() {
  return {297.0, 420.0, 12.0, 15.0};
}

/// Which sheets there are: columns from west to east, rows from south to north.
struct SheetGrid {
  int columns = 1, rows = 1;
  double step_x_mm = 0.0, step_y_mm = 0.0;
};
/// As few as cover the part.
[[nodiscard]] SheetGrid sheets_of(const PlacingTemplate& plan, const Sheet& sheet);

inline constexpr double kLabelLetters_mm = 2.5;
/// "7 S003".
[[nodiscard]] std::string label_of(const TemplateStone& stone);
/// Where the tick of its heading ends, which begins at its centre.
[[nodiscard]] std::array<double, 2> heading_end(const TemplateStone& stone);
/// Where each label begins, on its base line: right, left, above or below of its stone, the first
/// place where it covers no stone and no label before it, as far as there is one.
[[nodiscard]] std::vector<std::array<double, 2>> label_places(const PlacingTemplate& plan);

/// PDF by Cairo. Page 1 is the way the sheets lie; then row by row, from the south-western one:
/// the model point min + (column step_x, row step_y) is `margin` right of and above the page's
/// lower left corner, so nothing needs to be measured to join sheets. Crop marks stand at the
/// window's corners, the same crosses appear on both sheets of an overlap, and each sheet has a
/// bar of 100 mm (50 where the window is below 130) to be measured after printing. Fonts are
/// whatever the system has for sans-serif. EXPORT_OPTION_OUT_OF_RANGE: a window below 70 mm, an
/// overlap of more than half of it, or more than 2000 sheets.
/// @pre min < max
[[nodiscard]] Result<void> write_template_pdf(const PlacingTemplate& plan, const Sheet& sheet,
                                              const std::filesystem::path& path);

/// DXF (R12): PART (outline of the part), JOINT, STONE (outlines), NUMBER (TEXT), HEADING (line
/// from the centre to the long axis' end), CENTRE (points), all at height 0.
[[nodiscard]] Result<void> write_template_dxf(const PlacingTemplate& plan,
                                              const std::filesystem::path& path);

}  // namespace maquette::exporting
