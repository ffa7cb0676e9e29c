// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file site.hpp
/// The site file: one mock-up, from its sources to its scanner. Every key, its
/// default and its range stand once, in site.cpp.

#include <cmath>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "tools/operations.hpp"
#include "tools/schema.hpp"

namespace maquette::tools {

struct SiteSource {
  std::string name;
  std::filesystem::path path;
  std::string unit = "auto";
  double sigma_m = 1.0;
  std::string align = "auto";
  bool similarity = false;
  std::string clean = "detect";
  bool bow = false;
  std::vector<double> seams_m{};  ///< four a seam
  std::string body = "site";
};

struct SiteImage {
  std::string name;
  std::filesystem::path path;
  double sun_azimuth_deg = 270.0, sun_elevation_deg = 30.0;
  double lunar_lambert = 0.55, noise = 0.01, albedo_contrast = 0.1, albedo_length_m = 500.0;
};

/// Stones that the user brings.
struct SiteStones {
  std::filesystem::path file;
  std::string unit = "file";
  double scale = 0.0;       ///< 1:N of what the file shows; 0: the first of the site's scales
  double diameter_m = 0.0;  ///< on the planet; 0: as large as the file says
  std::int64_t count = 1;
  std::vector<double> places_m{};  ///< two a stone: east, north
  double heading_deg = NAN;        ///< NaN: drawn
};

/// Whose rim stones lie around.
struct SiteCrater {
  double east_m = 0.0, north_m = 0.0, diameter_m = 0.0;
};

struct Site {
  std::string schema_name = "maquette.site/1";
  std::string name = "default";
  std::string body = "moon";
  double centre_latitude_deg = -43.3;
  double centre_longitude_deg = 348.8;
  double size_mm = 200.0;
  double spacing_mm = 0.5;
  std::vector<double> scales{1000.0, 200.0};
  double exaggeration = 1.0;
  std::int64_t seed = 1;
  std::deque<SiteSource>
      sources;  ///< none: the embedded site is generated; deque: stable addresses
  std::deque<SiteImage> images;

  std::int64_t synthetic_seed = 20260101;
  double synthetic_detail = 1.0;
  bool restore = true, joint = true;
  std::string combine = "same_body";
  double detail_latitude_deg = 0.0, detail_longitude_deg = 0.0;  ///< of a composite
  double crossover_m = 0.0;                                      ///< 0: by the relief's pixel
  double crater_age_gyr = 0.0;                                   ///< 0: no craters

  std::int64_t stone_count = -1;                   ///< -1: as many as the law of k has on the site
  std::int64_t stone_shapes = 0, stone_sizes = 0;  ///< of a catalogue; 0: each its own
  double stone_inner_share = 0.5;
  double stone_min_diameter_m = 1.5, stone_max_diameter_m = 5.0;
  double stone_k = 0.1;
  double stone_angularity = 0.6;
  double stone_embedded_share = 0.25;
  std::string stone_rest = "fitted";
  double stone_repose_deg = 35.0;
  std::string stone_density = "even";
  double stone_decay_m = 50.0, stone_far_share = 0.1, stone_slope_slowness = 1.0;

  std::deque<SiteStones> own_stones;  ///< beside the drawn ones
  std::deque<SiteCrater> craters;     ///< that stone_density speaks of

  bool stone_parts = true;  ///< files for the workshop, of each distinct stone
  double part_clearance_mm = 0.1, part_wall_mm = 1.0, part_spacing_mm = 3.0;
  std::vector<double> build_mm{200.0, 200.0, 200.0};
  std::string placing_paper = "a4";

  double base_thickness_mm = 10.0;
  double lowest_mm = 0.0;
  double stock_margin_mm = 1.0;
  std::string material = "polyurethane_650";

  double band_max_width_mm = 500.0;
  bool avoid_stones = true;
  double joint_clearance_mm = 1.0;                                    ///< from joints to stones
  double dowel_mm = 0.0, dowel_depth_mm = 10.0, dowel_play_mm = 0.2;  ///< 0 mm: none
  double dowel_wall_mm = 2.0, dowel_spacing_mm = 200.0;
  double magnet_mm = 0.0, magnet_depth_mm = 3.2, magnet_play_mm = 0.2;
  double magnet_wall_mm = 2.0, magnet_spacing_mm = 200.0;

  double hollow_mm = 0.0, rib_mm = 3.0, pocket_mm = 40.0, ceiling_step_mm = 0.0;  ///< 0: solid
  std::string label{}, label_side = "west";
  bool scale_bar = false;
  double letter_mm = 5.0, engrave_depth_mm = 0.6, stroke_mm = 0.0;

  std::filesystem::path spheres;  ///< none: the block has no reference spheres

  double ball_diameter_mm = 6.0;
  double unreached_mm = 0.05, max_unreached_percent = 100.0, max_slope_deg = 90.0;
  double cutter_length_mm = 0.0, stock_height_mm = 0.0;
  std::deque<Operation> operations;  ///< none: roughing, if enabled, and raster passes
  bool roughing = true;
  double rough_diameter_mm = 12.0, rough_corner_radius_mm = 1.0, rough_stepover_mm = 6.0;
  double rough_step_down_mm = 5.0, rough_allowance_mm = 0.5, rough_ramp_deg = 3.0;
  double rough_cell_mm = 1.0;

  double stepover_mm = 0.5;
  double tolerance_mm = 0.01;
  double direction_deg = 0.0;
  bool zigzag = true, climb = true, arcs = true, constant_scallop = false;
  double scallop_limit_mm = 0.011, excess_limit_mm = 0.0, stated_stepover_mm = 0.0;
  double feed_mm_per_min = 0.0;
  double plunge_feed_mm_per_min = 0.0;
  double spindle_rpm = 0.0;
  double clearance_mm = 5.0;
  std::string post = "linuxcnc";
  std::int64_t max_lines = 0, max_bytes = 0;
  bool relative = false;
  std::filesystem::path compensate, corrections;  ///< none: programs are called as they are meant
  std::string corrections_for = "this";
  std::int64_t work_offset = 54;
  bool work_offset_per_band = false;
  std::string machine = "portal_mill_2500";

  std::filesystem::path extended;  ///< none: nothing is known of what differs from the simulation
  double verify_cell_mm = 0.1;
  double max_gouge_mm = 0.02;

  std::vector<std::string> export_formats{"stl", "glb"};
  std::int64_t lod_triangles = 100000;
  std::int64_t position_bits = 16;
  double contour_interval_mm = 5.0, step_tolerance_mm = 0.02;
  std::string step_schema = "ap242";

  std::string camera = "mono_space";
  double camera_azimuth_deg = 200.0, camera_elevation_deg = 40.0, camera_distance_mm = 0.0;
  std::int64_t samples_per_pixel = 4;
  std::string lamp = "arri_d5";
  double lamp_azimuth_deg = 290.0, lamp_elevation_deg = 20.0, lamp_distance_mm = 4000.0;
  std::int64_t lamp_samples = 1;
  std::string reflectance = "lunar_lambert";
  double albedo = 0.3;

  std::string scanner = "zf5006h";
  std::int64_t stations = 2;
  double scanner_elevation_deg = 55.0, scanner_distance_mm = 1500.0;
  std::int64_t max_points = 1'000'000;
  /// On parts of a few beams' width the blur of a beam is most of the relief that is missing, and
  /// registration refuses; so the run's scans look with rays unless asked for the beam.
  std::int64_t footprint_rays = 1;
  double reach_mm = 5.0;
};

/// A site and the schema that is bound to it; keep them together.
struct SiteFile {
  std::unique_ptr<Site> site = std::make_unique<Site>();
  Schema schema;
};
[[nodiscard]] SiteFile empty_site_file();

/// Reads, overrides and cross-checks (size a whole multiple of spacing, stones smaller
/// than the site, scales descending and distinct, ...).
[[nodiscard]] Result<SiteFile> read_site(const std::filesystem::path& path,
                                         const std::vector<std::string>& overrides = {});

/// What is milled, in order: the site's operations, or those that its sections describe.
[[nodiscard]] std::vector<Operation> operations_of(const Site& site);

/// Whether it can have any: drawn or brought.
[[nodiscard]] bool has_stones(const Site& site);

/// How many work offsets there are from the site's first one on.
[[nodiscard]] std::size_t work_offsets_left(const Site& site);

/// Of a program: 54 to 59, 591 to 593 for G59.1 to G59.3.
[[nodiscard]] int work_offset_of(const Site& site, std::size_t band);

/// Nodes of one surface are spacing apart and span size.
[[nodiscard]] double half_width_m(const Site& site, double scale);

}  // namespace maquette::tools
