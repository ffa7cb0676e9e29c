// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stones.hpp
/// Which stone lies where. The plan is drawn once, in metres of the site, and
/// brought to each model scale, so that a stone of the 1:200 section is the same
/// stone at 1:1000.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "assets/rocks.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/stone_body.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kStonesDoNotFit{"MESHING_STONES_DO_NOT_FIT"};
inline constexpr ErrorCode kStoneLargerThanSite{"MESHING_STONE_LARGER_THAN_SITE"};
inline constexpr ErrorCode kStonePlanFormat{"MESHING_STONE_PLAN_FORMAT"};

/// A body from a file; stones of the same file share it.
using StoneBodyPtr = std::shared_ptr<const StoneBody>;

/// A stone of the site, before it is laid on a surface.
struct SiteStone {
  int number = 0;  ///< 1, 2, ... the same at every scale
  assets::RockShape shape{};
  StoneBodyPtr body{};  ///< if there is one, the stone is that, and `shape` says nothing
  Metres diameter{0.0};
  double east_m = 0.0, north_m = 0.0;  ///< site frame
  Radians heading{0.0};                ///< of the long axis, about the vertical
  bool is_inner = false;               ///< keeps to the inner square
  bool has_place = false;              ///< the user says where; else it was drawn
};

/// Where the planner is told to lay a stone.
struct StonePlace {
  double east_m = 0.0, north_m = 0.0;  ///< site frame
};

/// Stones of one file.
struct OwnStones {
  StoneBodyPtr body;
  Metres diameter{0.0};              ///< equivalent horizontal one, on the planet
  int count = 0;                     ///< that are laid where there is room
  std::vector<StonePlace> places{};  ///< and of those that lie where they are told to
  double heading_rad = NAN;          ///< of x of the file, about the vertical; NaN: drawn
};

struct SitePlanRequest {
  int count = 12;
  double inner_share = 0.5;      ///< share (rounded up) that lies inside the inner square
  Metres half_width{0.0};        ///< of the site
  Metres inner_half_width{0.0};  ///< of the 1:200 section; 0: none
  Metres min_diameter{2.0}, max_diameter{5.0};
  double k = 0.1;  ///< Golombek-Rapp area fraction
  std::uint64_t seed = 1;
  /// A workshop's catalogue: that many distinct shapes, and sizes at that many steps of equal ratio
  /// from min to max, the nearest one for each stone. 0: each stone its own.
  int shapes = 0, sizes = 0;
  /// Of all drawn stones, 0 rounded to 1 angular; none: each has its own. What a stone needs of
  /// room depends on it, so it is not to be changed in a plan.
  std::optional<double> angularity{};
  std::vector<OwnStones> own{};  ///< beside the `count` drawn ones
  /// How dense drawn places are there (site frame, metres), 0 to 1; none: the same everywhere.
  std::function<double(double east_m, double north_m)> density{};
};

/// Draws sizes, shapes and positions; numbers them by falling size. The circumscribed
/// spheres do not overlap, and centres keep one diameter from the site's border and,
/// on either side, from the inner square's (centred on the site). Own stones have the numbers
/// behind the drawn ones, in their order, those with a place first; these come into the plan
/// before all others. Of own stones without a place the inner share lies inside, too. Where a
/// density is given, the drawn places are a sample of it, within each square by itself, as far as
/// stones leave each other room.
/// MESHING_STONE_LARGER_THAN_SITE: a stone cannot keep its distance from the border of
/// its square; MESHING_STONES_DO_NOT_FIT: says how many did, or which two of those with a place
/// overlap.
/// @pre counts, shapes, sizes >= 0, inner_share and angularity within 0 .. 1, widths >= 0, k and
///      diameters as assets::draw_rock_diameters asks; own stones have a body and a diameter
[[nodiscard]] Result<std::vector<SiteStone>> plan_stones(const SitePlanRequest& request);

/// Whether the plan would have a stone there: the site's border and the inner square's are kept
/// away from as plan_stones says; other stones are not looked at.
[[nodiscard]] bool keeps_to_its_square(const SitePlanRequest& request, const SiteStone& stone,
                                       double east_m, double north_m);
/// Another place for a drawn stone, by the law of the first: a function of the request's seed, the
/// stone's number and `attempt`. Nothing: this attempt was drawn where it may not lie.
[[nodiscard]] std::optional<StonePlace> draw_other_place(const SitePlanRequest& request,
                                                         const SiteStone& stone,
                                                         std::uint64_t attempt);

/// Distance of the farthest vertex from the origin, for diameter 1.
[[nodiscard]] double circumscribed_radius(const SiteStone& stone);

/// A stone in its pose on one model surface: x_model = translation + R (scale x_rock).
struct PlacedStone {
  int number = 0;
  assets::RockShape shape;
  StoneBodyPtr body{};              ///< as of SiteStone
  double scale_mm = 0.0;            ///< equivalent diameter in the model
  RigidTransform model_from_stone;  ///< rotation and translation
  double embedded_depth_mm = 0.0;   ///< how deep its lowest point is under the surface there

  friend bool operator==(const PlacedStone& a, const PlacedStone& b);
};

/// A model surface and where it lies on the site.
struct StoneGround {
  const heightmap::ModelField& surface;
  ModelScale scale;
  double east_of_x0_m = 0.0, north_of_y0_m = 0.0;  ///< site coordinates of model point (0, 0)
  double height_of_z0_m = 0.0;                     ///< site height of model z = 0
};

/// Of a stone seen from above: its circumscribed sphere.
struct StoneDisc {
  double east_m = 0.0, north_m = 0.0, radius_m = 0.0;
};
[[nodiscard]] inline bool overlap(const StoneDisc& a, const StoneDisc& b) {
  return std::hypot(a.east_m - b.east_m, a.north_m - b.north_m) <= a.radius_m + b.radius_m;
}

/// Whether two stones are the same but for size and pose.
[[nodiscard]] bool same_shape(const PlacedStone& a, const PlacedStone& b);

/// Closed, of equivalent horizontal diameter 1, in the stone's own frame.
[[nodiscard]] TriMesh unit_stone(const assets::RockShape& shape, const StoneBodyPtr& body);

/// Lays the stones onto the surface. The stone's origin stays on the vertical through
/// its site position; its base is parallel to the plane that fits the nodes under the
/// footprint best (least squares); it is sunk along the plane's normal by
/// `embedded_share` of its height, and then straight down until none of the vertices
/// of that lowest share lies above the surface: no gap stays under the rim.
/// Stones that do not lie on the surface as a whole, or lie on a void, are left out.
/// Stones are true to the horizontal scale; a vertical exaggeration does not stretch them.
/// Same stones, same surface, same bits for any number of threads.
/// @param east_of_x0_m  site coordinates of model point (0, 0)
/// @pre embedded_share within 0 .. 1; at least 2 x 2 nodes
[[nodiscard]] std::vector<PlacedStone> lay_stones(std::span<const SiteStone> stones,
                                                  const heightmap::ModelField& surface,
                                                  const ModelScale& scale, double east_of_x0_m,
                                                  double north_of_y0_m,
                                                  double embedded_share = 0.25);

/// Closed mesh of a stone in its pose, model frame.
[[nodiscard]] TriMesh stone_mesh(const PlacedStone& stone);

/// Raises the field to the stones' upper surface where they stand above it: the
/// envelope that a scanner or a probe from above meets. Exact at the nodes (rounded to
/// float); voids stay voids. Time goes with the nodes under the stones.
[[nodiscard]] heightmap::ModelField with_stones(const heightmap::ModelField& surface,
                                                std::span<const PlacedStone> stones);

/// stones.json, exact (round trip to the bit): the plan that other rooms read. Bodies of files lie
/// beside it as stone_bodies/NAME.ply, each with its provenance in the plan.
/// Reading: CORE_FILE_NOT_FOUND; MESHING_STONE_PLAN_FORMAT with line and column where it
/// is not JSON, else with the path of the key (/stones/3/shape/flatness): missing,
/// unknown, of the wrong type or out of range; of a body those of read_mesh, and
/// MESHING_STONE_PLAN_FORMAT if its content is not what the plan was written with.
/// @pre writing: numbers are finite; bodies that differ have different names
[[nodiscard]] Result<void> write_stone_plan(std::span<const PlacedStone> stones,
                                            const std::filesystem::path& path);
[[nodiscard]] Result<std::vector<PlacedStone>> read_stone_plan(const std::filesystem::path& path);
/// The bodies' files that write_stone_plan writes beside `path`.
[[nodiscard]] std::vector<std::filesystem::path> stone_body_files(
    std::span<const PlacedStone> stones, const std::filesystem::path& path);
/// stones.csv for the workshop: number, position, quaternion, diameter, embedded depth,
/// in the columns number,x_mm,y_mm,z_mm,qw,qx,qy,qz,diameter_mm,embedded_depth_mm.
/// x_model = (x, y, z) + R(q) x_stone; lengths to 0.1 um.
[[nodiscard]] Result<void> write_stone_table(std::span<const PlacedStone> stones,
                                             const std::filesystem::path& path);

}  // namespace maquette::meshing
