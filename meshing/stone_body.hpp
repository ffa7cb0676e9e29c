// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stone_body.hpp
/// Stones that others made: scans of rocks, a workshop's own shapes.
///
/// Room   file (STL, PLY, OBJ, glTF) -> [read_stone_body] -> plan of stones
/// Takes  a mesh in the units of its file
/// Gives  one closed body of diameter 1, as assets::make_rock gives them, what was repaired, and
///        how large the stone of the file is

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kStoneNotClosed{"MESHING_STONE_NOT_CLOSED"};
inline constexpr ErrorCode kStoneCutsItself{"MESHING_STONE_CUTS_ITSELF"};
inline constexpr ErrorCode kStoneInPieces{"MESHING_STONE_IN_PIECES"};
inline constexpr ErrorCode kStoneFlat{"MESHING_STONE_FLAT"};
inline constexpr ErrorCode kStoneTooLarge{"MESHING_STONE_TOO_LARGE"};

/// Every stone of a plan that has the shape is united, rendered and scanned with all of them.
inline constexpr std::size_t kMostStoneTriangles = 1'000'000;
/// Vertices nearer to each other than this share of the body's size are one: text with seven digits
/// moves them by less.
inline constexpr double kSamePointShare = 1e-6;
/// A hole is filled if it is at most so wide, as a share of the body's size (both: diagonal of the
/// box round it): what is missing there is guessed.
inline constexpr double kSmallHoleShare = 0.1;
/// A piece of less than this share of the volume is dust of a scan and left out.
inline constexpr double kDustShare = 0.01;

struct MeshRepairs {
  std::size_t merged_points = 0;     ///< vertices that lay on others
  std::size_t repeated_faces = 0;    ///< triangles that were there twice
  std::size_t degenerate_faces = 0;  ///< triangles without area
  std::size_t turned_faces = 0;      ///< triangles that were inside out
  std::size_t filled_holes = 0;
  std::size_t dropped_pieces = 0;   ///< dust
  std::size_t filled_cavities = 0;  ///< shells inside the stone
  friend bool operator==(const MeshRepairs&, const MeshRepairs&) = default;
};
/// "2 holes filled, 1 triangle turned", or "none".
[[nodiscard]] std::string to_text(const MeshRepairs& repairs);

/// One closed, outward oriented 2-manifold that does not cut itself, or why it cannot be that.
/// Method: CGAL's Polygon Mesh Processing; vertices that stay are not moved.
/// MESHING_STONE_TOO_LARGE, MESHING_MESH_EMPTY (no triangle with an area),
/// MESHING_STONE_NOT_CLOSED (a hole wider than kSmallHoleShare, or an edge of more than two
/// triangles), MESHING_STONE_CUTS_ITSELF, MESHING_STONE_IN_PIECES, MESHING_STONE_FLAT (no volume):
/// each with the place, in the mesh's own coordinates.
/// @pre coordinates are finite, indices in range
[[nodiscard]] Result<TriMesh> repair_stone(const TriMesh& mesh, MeshRepairs& repairs,
                                           const RunContext& run = {});

/// A body and where it came from.
struct StoneBody {
  std::string name;    ///< of its file beside stones.json, without the extension
  TriMesh mesh;        ///< equivalent horizontal diameter 1, centre of mass at the origin, z up
  std::string source;  ///< name of the file that was read
  std::string source_sha256;  ///< and its content
  double mm_per_unit = 1.0;   ///< of that file; of a glTF's metres 1000
  double diameter_mm = 0.0;   ///< equivalent horizontal diameter that the file shows
  double volume_mm3 = 0.0;    ///< the same
  std::string repairs = "none";
  friend bool operator==(const StoneBody& a, const StoneBody& b);
};

/// Reads and repairs; the name is the file's.
/// @param mm_per_unit  nothing: 1, and of a glTF 1000, as that format says
/// Errors: those of read_mesh and repair_stone, with the file's name.
/// @pre mm_per_unit > 0
[[nodiscard]] Result<StoneBody> read_stone_body(const std::filesystem::path& path,
                                                std::optional<double> mm_per_unit = {},
                                                const RunContext& run = {});

}  // namespace maquette::meshing
