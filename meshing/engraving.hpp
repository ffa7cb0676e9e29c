// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file engraving.hpp
/// Text and a scale bar, engraved in the walls of a solid.
///
/// Room    meshing:  text, scale -> marks -> [engraving] -> shaped_solid
/// Takes   ModelField, height of the base; marks: polylines on a wall, as a round cutter or a
///         stroke font draws them (core/stroke_letters.hpp)
/// Gives   for each mark the piece of wall that replaces the plain one: grooves as wide as the
///         stroke, as deep as asked, with level floors and upright sides
///
/// Method. Each straight piece of a stroke is a capsule with ends of 16 sides. A triangulation
/// of the wall between two nodes has the edges of all capsules and of the wall as constraints
/// (CGAL, exact predicates and constructions); what lies in any capsule is the floor, moved
/// inwards, and sides stand along the borders. So the wall is a graph of a depth, with the rims of
/// the field's nodes as they were. Place. On the wall's middle height between the base and the
/// lowest node near the mark; a label begins at the wall's left end, seen from outside, a scale bar
/// ends at its right end.
///
/// Accuracy. Corners of capsules to 2^-11 mm; depth to rounding.
/// Cost    10 ms a letter

#include <array>
#include <span>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/grid_stream.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kLabelDoesNotFit{"MESHING_LABEL_DOES_NOT_FIT"};
inline constexpr ErrorCode kLabelLetter{"MESHING_LABEL_LETTER"};

enum class WallSide { south, east, north, west };

struct EngravingStyle {
  WallSide side = WallSide::south;
  Millimetres letter{5.0};  ///< height of capitals
  Millimetres depth{0.6};
  Millimetres stroke{0.0};  ///< width; 0: an eighth of the letters' height
  [[nodiscard]] double stroke_mm() const {
    return stroke.value() != 0.0 ? stroke.value() : letter.value() / 8.0;
  }
};

/// Middle lines of strokes, in a box with its lower left corner at the origin, x to the right seen
/// from outside. Strokes reach half their width beyond.
struct WallMark {
  std::string name;  ///< for messages: what it says
  std::vector<std::vector<std::array<double, 2>>> lines_mm{};
  double width_mm = 0.0, height_mm = 0.0;
  bool at_right = false;  ///< end of the wall where it stands
};

/// MESHING_LABEL_LETTER: a letter that the font has not, or none at all.
/// MESHING_LABEL_DOES_NOT_FIT: lengths that are none.
[[nodiscard]] Result<WallMark> text_mark(const std::string& utf8, const EngravingStyle& style);

/// A bar with ticks and what it is long on the ground: 1, 2 or 5 times a power of ten, at most two
/// fifths of the wall.
/// MESHING_LABEL_DOES_NOT_FIT: no scale, lengths that are none.
/// @param scale_denominator  N of 1:N
[[nodiscard]] Result<WallMark> scale_bar_mark(double scale_denominator, double wall_mm,
                                              const EngravingStyle& style);

/// In the place of a wall between two nodes: grooves, or a hole (dowels.hpp).
struct EngravedWall {
  /// Edges of the outline that it replaces, counted from the south-western corner
  /// counter-clockwise.
  std::uint64_t first_edge = 0, edges = 0;
  /// Corners of triangles: first the lower rim's vertices of these edges, edges + 1 of them, then
  /// as many upper ones, then `vertices_mm`.
  std::vector<Vec3> vertices_mm;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  double volume_mm3 = 0.0;          ///< of the grooves or the hole
  double floor_area_mm2 = 0.0;      ///< of their floors
  std::array<double, 2> from_mm{};  ///< lower left corner of the mark: along the wall, height
};

/// Length of a wall, mm.
[[nodiscard]] double wall_length_mm(const heightmap::ModelField& surface, WallSide side);
[[nodiscard]] double wall_length_mm(const heightmap::ModelField& surface, const NodeWindow& window,
                                    WallSide side);

/// One piece for each mark.
/// MESHING_LABEL_DOES_NOT_FIT: a mark is longer than the wall, higher than it under the relief, two
/// marks meet, or grooves are deeper than a quarter of the part; says what would do.
/// CORE_CANCELLED.
/// @pre base below the surface
[[nodiscard]] Result<std::vector<EngravedWall>> engrave_wall(const heightmap::ModelField& surface,
                                                             Millimetres base_z,
                                                             const std::vector<WallMark>& marks,
                                                             const EngravingStyle& style,
                                                             const RunContext& run = {});

/// The same for a part over the window, in the frame of the whole. Marks keep off what is taken of
/// the wall: each stands where there is room for it first, from its end on.
[[nodiscard]] Result<std::vector<EngravedWall>> engrave_wall(
    const heightmap::ModelField& surface, const NodeWindow& window, Millimetres base_z,
    const std::vector<WallMark>& marks, const EngravingStyle& style,
    std::span<const EngravedWall> taken, const RunContext& run = {});

}  // namespace maquette::meshing
