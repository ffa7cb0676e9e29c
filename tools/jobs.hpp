// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs.hpp
/// What each verb does: documented files in, documented files out, figures for
/// the manifest. The verbs call these directly; the pipeline wraps them as units.

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "camera/render.hpp"
#include "cnc/backplot.hpp"
#include "cnc/verify.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "meshing/bands.hpp"
#include "tools/adjustment.hpp"
#include "tools/extended.hpp"
#include "tools/pipeline.hpp"
#include "tools/scanner_file.hpp"
#include "tools/scene_file.hpp"
#include "tools/site.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kUnknownFormat{"TOOLS_UNKNOWN_FORMAT"};
inline constexpr ErrorCode kUnknownName{"TOOLS_UNKNOWN_NAME"};
inline constexpr ErrorCode kMeshFailed{"TOOLS_MESH_CHECK_FAILED", ErrorKind::internal};
inline constexpr ErrorCode kSolidInexact{"TOOLS_SOLID_INEXACT"};

namespace fs = std::filesystem;

/// The embedded site's products: synthetic_<body>_dtm.img, _ldem.lbl, _ldem.img,
/// _truth.json.
[[nodiscard]] Result<JobResult> products_job(const Site& site, const fs::path& folder,
                                             const RunContext& run);
/// The sources that the products above stand for.
[[nodiscard]] std::vector<SiteSource> embedded_sources(const Site& site, const fs::path& products);

/// What fuse_job left of a scale with wider nodes.
struct WiderSurface {
  fs::path folder;
  double scale = 0.0;
  [[nodiscard]] std::vector<fs::path> files() const {
    return {folder / "design.tif", folder / "fuse.json", folder / "sigma.tif",
            folder / "artefacts.tif"};
  }
};

/// design.tif (mm), sigma.tif (mm), source.tif (index), artefacts.tif (bits of
/// heightmap/artefacts.hpp), their pictures and hillshade.png, fuse.json.
/// @param wider  which this one enlarges: the same heights as means over its nodes
[[nodiscard]] Result<JobResult> fuse_job(const Site& site, std::span<const SiteSource> sources,
                                         double scale, const std::optional<WiderSurface>& wider,
                                         const fs::path& folder, const RunContext& run);

/// reach.tif (mm that the finishing ball leaves where it does not fit), slope.tif (degrees),
/// reach.png, slope.png, reach.json; unmet where the site sets a limit that the design does not
/// keep.
[[nodiscard]] Result<JobResult> reach_job(const Site& site, const fs::path& design,
                                          const fs::path& folder, const RunContext& run);

/// What stones_job reads of each surface: its design and, where two have the same stones, fuse.json
/// beside it.
struct StoneSurfaces {
  std::vector<fs::path> designs;  ///< of the site's scales, in their order; empty: not there

  /// Of those that stones at that scale need.
  [[nodiscard]] std::vector<fs::path> files(const Site& site, double scale) const;
};

/// stones.json, stones.csv, surface.tif (design with the stones' envelope). A stone has one pose on
/// the planet: it lies on the surface of the largest scale that it is on, and as that says on the
/// others. Without the designs of larger scales it lies on its own surface, which is said.
[[nodiscard]] Result<JobResult> stones_job(const Site& site, double scale,
                                           const StoneSurfaces& surfaces, const fs::path& folder,
                                           const RunContext& run);

/// The solid with stones and its certificate beside it (surface.ply,
/// surface.certificate.json). A mesh that fails its checks is not written; surface.refused.json
/// says why. TOOLS_SOLID_INEXACT: a sound one, but stones have no exact union with the terrain.
[[nodiscard]] Result<JobResult> mesh_job(const fs::path& design,
                                         const std::optional<fs::path>& stones,
                                         Millimetres base_thickness, const fs::path& out,
                                         const RunContext& run);

/// One band as a closed solid of terrain, with certificate. Neighbours have the same wall between
/// them, to the bit.
[[nodiscard]] Result<JobResult> band_job(const fs::path& design, const meshing::BandSplit& split,
                                         std::size_t band, Millimetres base_thickness,
                                         const fs::path& out, const RunContext& run);

struct VerifyJob {
  std::vector<fs::path> programs;    ///< each file that is to be cut, in order
  std::vector<std::string> bands{};  ///< of each program, for the table of times; or empty
  fs::path design;
  /// What is to be left where stones and spheres get their seats (machined_job): gouge and excess
  /// are against it.
  std::optional<fs::path> machined;
  std::optional<fs::path> stones, mesh;  ///< with both: gouge against the mesh is checked too
  bool stones_stand = false;             ///< while it is milled: the cutter must pass beside them
  std::optional<fs::path> stock;         ///< model field: what an earlier operation left
  /// Its stock is read from the file above; without a top, the block ends `stock_margin` above
  /// the highest point. Stones are glued on after milling, unless they stand: the cutter may pass
  /// where they will be.
  cnc::VerifyOptions options;
  Millimetres stock_margin{1.0};
  Millimetres base_thickness{10.0};  ///< from the table to the design's lowest point
  /// Unmet if exceeded, bound included. Gouges of balls deeper than this are listed, from 1 um
  /// on and at the latest from options.gouge_limit on.
  std::optional<Millimetres> max_gouge;
  /// Named causes (extended.toml): as_built.tif is what they make of the cut, on the design's
  /// nodes, and max_gouge holds for it too.
  std::optional<Extended> extended;
  /// Programs are written for a machine with these errors: all is cut as it makes them. Programs as
  /// they were meant (meant_of()), where they lie beside, are certified too.
  std::optional<Adjustment> adjust;
};
/// certificate.json, as_milled.tif, excess.png; backplot/paths.json for the page, and
/// backplot/<program>.feed.svg, .png, .engagement.svg, .png of each program.
[[nodiscard]] Result<JobResult> verify_job(const VerifyJob& job, const fs::path& folder,
                                           const RunContext& run);

struct BackplotJob {
  std::vector<fs::path> programs;
  cnc::BackplotColour colour = cnc::BackplotColour::feed;
  /// With it the programs are cut in simulation: engagement is known, and the view has a ground.
  std::optional<fs::path> design;
  std::optional<fs::path> stock;
  Millimetres ball_diameter{6.0};  ///< of the one cutter, where there are no tools
  std::vector<cnc::Tool> tools{};  ///< T words are honoured
};
/// What a program looks like, by the ending of `out`: .svg, .png from above, each program of
/// several beside the others with its name added; .html all of them in three dimensions.
[[nodiscard]] Result<JobResult> backplot_job(const BackplotJob& job, const fs::path& out,
                                             const RunContext& run);

struct ExportOptions {
  double scale_denominator = 1000.0;
  Millimetres contour_interval{5.0};
  std::int64_t lod_triangles = 100000;
  int position_bits = 16;
  Millimetres step_tolerance{0.02};
  std::string step_schema = "ap242";  ///< or ap214
  double step_band_mm = 0.0;          ///< a file for each band not wider than that; 0: one file
  std::optional<meshing::BandSplit> step_bands{};  ///< instead: a file for each of these
};
[[nodiscard]] const std::vector<std::string>& export_formats();
/// One format: <stem>.<ext>; glb also writes the decimated level <stem>_lod1.glb where
/// a design is given. `surface` is a mesh file or a model field (.tif: its solid).
[[nodiscard]] Result<JobResult> export_job(const std::string& format, const fs::path& surface,
                                           const std::optional<fs::path>& design,
                                           const ExportOptions& options, const fs::path& folder,
                                           const RunContext& run);

/// EXR (radiance Y or R, G, B; depth Z in mm, mask lit; layers normal, position, angle, channel
/// part) and a PNG preview beside it; with a trajectory NAME_0001.exr and so on, and
/// NAME_frames.json. Pictures of a trajectory that are there already, of the same scene, are kept.
[[nodiscard]] Result<JobResult> render_job(const fs::path& scene, const fs::path& image,
                                           const RunContext& run);
/// scene.toml for the site's camera and lamp: the design with its stones.
[[nodiscard]] Result<JobResult> scene_job(const Site& site, const fs::path& design,
                                          const fs::path& stones, const fs::path& scene);

struct ScanJob {
  fs::path surface;                ///< model field (.tif) or mesh
  std::optional<fs::path> stones;  ///< stones.json
  Scanner scanner;
  std::vector<Vec3> stations_mm;         ///< one scan each
  std::optional<Vec3> target_mm;         ///< looked at by structured light; none: the middle
  std::optional<fs::path> reflectance;   ///< model field of 0 to 1 over the same place; none: 0.5
  std::uint64_t max_points = 1'000'000;  ///< of each station
  std::uint64_t seed = 1;                ///< of the first station, then one more each
  std::optional<Extended> extended;      ///< named causes: of a field, and of the points
  bool as_built = false;                 ///< the field has its causes already
  std::size_t first_scan = 0;            ///< the case's scan that the first station stands for
};
/// Simulated scans into one cloud file, its format by the extension of `out`; in constant memory.
[[nodiscard]] Result<JobResult> scan_job(const ScanJob& job, const fs::path& out,
                                         const RunContext& run);
/// Station `index` of the site's `stations`, round the part.
[[nodiscard]] Vec3 station_position(const Site& site, const heightmap::ModelField& surface,
                                    std::int64_t index);

/// case.toml for the site's scans, as deviate (and later diagnosis) takes it.
[[nodiscard]] Result<JobResult> case_job(const Site& site, const fs::path& folder,
                                         std::span<const fs::path> programs,
                                         std::span<const fs::path> scans);
/// summary.json, deviation.tif, deviation.ply, deviation.png, significant.png, report.html.
[[nodiscard]] Result<JobResult> deviate_job(const fs::path& case_file, const fs::path& folder,
                                            const RunContext& run);

/// diagnosis.json, extended.toml, report.html; unmet if a cause is required and none is named.
[[nodiscard]] Result<JobResult> diagnose_job(const fs::path& case_file, const fs::path& folder,
                                             std::uint64_t seed, bool require_cause,
                                             bool with_controls, const RunContext& run);

/// detectability.json.
[[nodiscard]] Result<JobResult> detectability_job(const fs::path& case_file, const fs::path& folder,
                                                  std::uint64_t seed, const RunContext& run);

/// A model field by its extension (.tif, .tiff); anything else is taken for a mesh.
[[nodiscard]] bool is_field(const fs::path& surface);

/// Extent of a model field or a mesh file.
[[nodiscard]] Result<Box3> surface_bounds(const fs::path& surface);

/// A mesh file, or the solid of a model field with its default base.
[[nodiscard]] Result<TriMesh> load_solid(const fs::path& surface, const RunContext& run);

}  // namespace maquette::tools
