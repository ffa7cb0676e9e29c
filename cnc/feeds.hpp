// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file feeds.hpp
/// Spindle speed and feeds from what a tooth may take off, and what the machine can do.
///
/// Takes   material (assets/materials/*.toml, one source per value), tool, machine, engagement
/// Gives   spindle speed, and a feed for every move of a path
///
/// Method. The table of the material gives the chip thickness h that a tooth of a cutter of that
/// diameter may take, straight between its diameters, in proportion below the smallest and
/// constant above the largest. Cuts deeper than `max_depth_diameters` lose `deep_cut_loss` of
/// it per further diameter, at most three quarters.
///
/// A tooth that advances by f is h = f sin(phi) sin(kappa) thick at its thickest, where
///  - phi is how far it turns into the stock: cos(phi) = 1 - 2 ae / D for a width
///    ae < D / 2, sin(phi) = 1 beyond (radial thinning); D the engaged diameter,
///    2 sqrt(ap (2 r - ap)) + 2 (R - r) at a depth ap below the corner radius r;
///  - kappa is the slope of the cutter's profile where the cut ends: cos(kappa) = 1 - ap / r
///    below r, sin(kappa) = 1 beyond (axial thinning).
/// (M. E. Martellotti, "An analysis of the milling process", Trans. ASME 63, 1941; P. Lee, Y.
/// Altintas, "Prediction of ball-end milling forces from orthogonal cutting data", Int. J. Mach.
/// Tools Manufact. 36, 1996.) So the feed is h / (sin sin), at most four times h, and at most
/// what leaves cusps of `cusp_mm` along the path: sqrt(8 r cusp).
///
/// The spindle turns as fast as machine and `max_surface_speed_m_min` at the engaged diameter
/// of the deepest cut allow. Where the ball only touches, that diameter is small and the material's
/// slowest speed may be more than the machine's fastest: it turns at its fastest then, as one does
/// with small cutters, the chip stays as thick, and the answer says so.
///
/// Each move's feed is the least of: rpm x teeth x feed per tooth for its engagement; the axes'
/// largest feeds in its direction; for the way down, the plunge limit of machine and material;
/// the speed that it reaches under the machine's acceleration (motion_time.hpp), within a factor
/// of two above. The last does not slow the motion but says about what it is. A feed that the move
/// before has already is kept if it is not above and not more than a tenth below, so that programs
/// stay short; others are rounded down to three digits. A long path may be given in parts: for the
/// acceleration, each then begins and ends at rest.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "cnc/machine.hpp"
#include "cnc/motion_limits.hpp"
#include "cnc/tool.hpp"
#include "cnc/toolpath.hpp"
#include "core/result.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kUnknownMaterial{"CNC_UNKNOWN_MATERIAL"};
inline constexpr ErrorCode kSpindleOutOfRange{"CNC_SPINDLE_OUT_OF_RANGE"};

struct Material {
  std::string name, description;
  std::vector<double> cutter_diameter_mm;  ///< ascending
  std::vector<double> chip_load_mm;        ///< thickest chip a tooth may take, for each of them
  double max_depth_diameters, deep_cut_loss;
  double min_surface_speed_m_min, max_surface_speed_m_min;
  double plunge_share;  ///< of the feed, straight down
};

/// @return CNC_DATA_FILE, CORE_FILE_*
[[nodiscard]] Result<Material> parse_material(std::string_view text, std::string_view place);
[[nodiscard]] std::vector<std::string> material_names();
/// @param name_or_path  one of material_names(), or a path that ends in ".toml"
/// @return CNC_UNKNOWN_MATERIAL with the known names, or what reading returns
[[nodiscard]] Result<Material> find_material(const std::string& name_or_path);

/// Of the cutter in the stock during one move.
struct Engagement {
  double width_mm = 0.0;  ///< across the feed, ae
  double depth_mm = 0.0;  ///< along the axis, ap; 0: in air
};

[[nodiscard]] double engaged_diameter_mm(const Cutter& cutter, double depth_mm);
/// sin(phi) sin(kappa), 0 in air.
[[nodiscard]] double chip_thinning(const Cutter& cutter, Engagement engagement);
/// Thickest chip for this cutter at this depth.
[[nodiscard]] double chip_load_mm(const Material& material, const Cutter& cutter, double depth_mm);
/// Advance per tooth; in air as for the thinnest chip.
[[nodiscard]] double feed_per_tooth_mm(const Material& material, const Cutter& cutter,
                                       Engagement engagement, double cusp_mm);

struct SpindleSpeed {
  double rpm = 0.0;
  double surface_speed_m_min = 0.0;  ///< at the engaged diameter of the deepest cut
  /// The machine's fastest is slower than the material asks for at that diameter: the surface may
  /// be rougher.
  bool below_material = false;
};

/// @return CNC_SPINDLE_OUT_OF_RANGE if the slowest of the machine is too fast for the material
[[nodiscard]] Result<SpindleSpeed> spindle_speed(const Machine& machine, const Material& material,
                                                 const Tool& tool, double deepest_mm);

struct FeedOptions {
  double cusp_mm = 0.005;  ///< along the path; > 0
  PathControl control{};
  double spindle_rpm = 0.0;  ///< 0: what the deepest engagement of this path allows
};

struct FeedReport {
  double spindle_rpm = 0.0;
  double lowest_mm_min = 0.0, highest_mm_min = 0.0;
  std::uint64_t moves = 0;    ///< with a feed
  std::uint64_t changes = 0;  ///< of the feed from one move to the next
  /// What decided: chip, axes, plunge or acceleration.
  std::uint64_t by_chip = 0, by_axes = 0, by_plunge = 0, by_acceleration = 0;
};

/// Sets the feed of every line and arc.
/// @param engagement  one for each move of the path, or one for all
/// @pre path.start is known
[[nodiscard]] Result<FeedReport> set_feeds(Toolpath& path, const Machine& machine,
                                           const Material& material, const Tool& tool,
                                           std::span<const Engagement> engagement,
                                           const FeedOptions& options = {});

/// Lowers the feeds that a path has to what the axes can do in each move's direction, and to the
/// plunge limit on the way down. @pre path.start is known; feeds of cuts > 0
void limit_feeds(Toolpath& path, const Machine& machine);

}  // namespace maquette::cnc
