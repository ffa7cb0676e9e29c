// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fuse.hpp
/// Elevation products of one body -> one surface in the site frame.
///
/// Room    heightmap, steps: read -> [align, fuse] -> to_model
/// Takes   rasters with a map projection (GDAL: PDS3, PDS4, ISIS3, GeoTIFF, JPEG 2000, VRT), metres
/// Gives   PlanetField with standard uncertainty and source mask
///
/// Method. Each output node is a point of the tangent plane at the site's centre
/// (GeographicLib::LocalCartesian on the body's ellipsoid), so the distortion of
/// the sources' map projections is removed. The first source is the base and is
/// the vertical reference; each further source is moved onto it (shift, height and tilt,
/// where asked turn and scale: detail/coregister.hpp; only height where the relief does not
/// tell more) and laid over it where it has data, each band of waves trusted as far as pixel and
/// noise let the sources know it (detail/blend.hpp); the relief's power law and each source's white
/// noise are measured (detail/roughness.hpp). Voids of the base get relief as rough as what
/// surrounds them (detail/void_fill.hpp); so do voids inside a finer source that are narrower than
/// two pixels of the sources before it, which know nothing of what is missing there. Before that,
/// artefacts of each source are looked for in its own pixels (artefacts.hpp).
///
/// Accuracy (tests: ten synthetic truths, beside a solver that knows spectrum, noise and pixels):
/// error over the whole 1.10 of the best possible at most; along a source's border half of that of
/// any of gdalwarp's mosaic, a feather and a two-band blend at most; steps there below a tenth of
/// the noise of what lies below; waves of 4 to 32 nodes as strong as the relief's to 5 % up to the
/// border; 68 and 95 % of errors within 1 and 1.96 sigma, over the whole to 3 points (within one
/// sigma 65 % outside the finer source, 79 % in the coarser one along its border).
///
/// What a height is. The value at (x, y) is the sources' height above their datum at
/// the point of the ellipsoid below (x, y); it is not lowered by the curvature between
/// tangent plane and ellipsoid (0.6 m at 2 km from the centre on Mars, 1.2 m on the
/// Moon), so level ground stays level in the model. Radii are taken less the ellipsoid's
/// radius. Horizontal distances are those on the ellipsoid, not at the terrain's height:
/// they differ by height / radius (0.13 % at -4.5 km on Mars).
///
/// Enlargement. A surface with finer nodes that `enlarges` another has its heights as means over
/// the other's cells (detail/enlargement.hpp), to the rounding of float32: 0.2 um of model height
/// for 1:200 of a site at -1500 m, 0.7 um at -4400 m (limit 5 um). Fused alone they differ by 0.4
/// to 4.7 mm (tests: two sites, three seeds).
///
/// Interpolation is bicubic, so nodes much finer than pixels see a surface without
/// facets; pixels at least twice as fine as the nodes are averaged first.
///
/// Three and more sources are aligned in one adjustment (detail/joint_adjustment.hpp), which the
/// order of the sources does not change; those that no pair ties to the base are then aligned one
/// by one, and so are those with turn and scale.
///
/// Horizontal alignment is used if both share at least 30 pixels of the coarser source, slopes
/// of both correlate by 0.5 or more and the shift is known to a tenth of that pixel; else only the
/// height is moved, and the source's report says why. A base whose pixel is wider than the site is
/// a poor vertical reference; the run's warning says so.
///
/// Cost: 4001 x 4001 nodes from two sources with synthetic detail take 18 s of CPU and 1.3 GB.

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/artefacts.hpp"
#include "heightmap/body.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::heightmap {

inline constexpr ErrorCode kNoProjection{"HEIGHTMAP_NO_PROJECTION"};
inline constexpr ErrorCode kWrongBody{"HEIGHTMAP_WRONG_BODY"};
inline constexpr ErrorCode kNoOverlap{"HEIGHTMAP_NO_OVERLAP"};
inline constexpr ErrorCode kNotAligned{"HEIGHTMAP_NOT_ALIGNED"};
inline constexpr ErrorCode kNotCovered{"HEIGHTMAP_NOT_COVERED"};
inline constexpr ErrorCode kSourceUnit{"HEIGHTMAP_SOURCE_UNIT"};
inline constexpr ErrorCode kImplausibleHeight{"HEIGHTMAP_IMPLAUSIBLE_HEIGHT"};
inline constexpr ErrorCode kDatumDiffers{"HEIGHTMAP_DATUM_DIFFERS"};
inline constexpr ErrorCode kImageNotFiner{"HEIGHTMAP_IMAGE_NOT_FINER"};

/// One elevation product as the site file names it.
struct Source {
  std::string name;            ///< for messages and the source mask
  std::filesystem::path path;  ///< what GDAL opens: image, label, VRT
  std::string unit = "auto";   ///< of the values after scale and offset: auto, m, km
  double sigma_m = 1.0;        ///< standard uncertainty of one pixel
  /// How it is brought onto the sources before it.
  enum class Align {
    automatic,  ///< shift, height and tilt, or height alone where the relief tells no more
    required,   ///< shift, height and tilt, or an error that says why not
    height,     ///< height alone
    none        ///< as the product says
  };
  Align align = Align::automatic;
  bool similarity = false;  ///< turn about the vertical and scale too
  /// What is done about spikes, boxes, seams, ripples and stripes (artefacts.hpp).
  Clean clean = Clean::detect;
  /// Of the joint adjustment: a bow (x^2, x y, y^2), and steps along the seams of CCDs, four
  /// numbers each: x and y of begin and end in the site frame, metres.
  bool bow = false;
  std::vector<double> seams_m{};
};

/// A map-projected image whose shading adds detail that elevation products do not show
/// (photoclinometry.hpp). It must lie on the surface as the first source does.
struct ImageSource {
  std::string name;
  std::filesystem::path path;      ///< any unit; values that are not positive are no image
  double sun_azimuth_deg = 270.0;  ///< clockwise from north, at the site
  double sun_elevation_deg = 30.0;
  double lunar_lambert = 0.55;     ///< 1 Lommel-Seeliger, 0 Lambert
  double noise = 0.01;             ///< of a pixel, relative
  double albedo_contrast = 0.1;    ///< standard deviation of log albedo
  double albedo_length_m = 500.0;  ///< over which albedo is alike
};

struct ImageReport {
  std::string name;
  double pixel_m = 0.0, coverage = 0.0;  ///< share of nodes that it shows
  double added_rms_m = 0.0;
  double variance_lowered_m2 = 0.0;  ///< of a node's error, where the image shows ground
  int steps = 0;
};

/// What happened to one source; goes into the manifest.
struct SourceReport {
  std::string name;
  double pixel_m = 0.0;   ///< longer side of its pixel on the ground, at the site's centre
  double coverage = 0.0;  ///< share of the site's nodes that it covers, before any shift
  /// Its relief's power law, mean squared height difference over L: coefficient L^(2 hurst), and
  /// the white noise of a pixel; coefficient 0: too few pixels to tell.
  double hurst = 0.5, coefficient = 0.0, noise_m = 0.0;
  ArtefactReport artefacts;
  double filled_share = 0.0;  ///< of the window's pixels: small voids inside it
  /// By how much the source was moved to lie on what was there before.
  double shift_east_m = 0.0, shift_north_m = 0.0, shift_up_m = 0.0;
  double tilt_east = 0.0, tilt_north = 0.0;  ///< metres per metre, added
  double turn_rad = 0.0, scale = 1.0;        ///< about the site's centre, counter-clockwise
  bool joint = false;                        ///< by the joint adjustment
  std::array<double, 3> bow_per_m{};         ///< of x^2, x y, y^2 from the site's centre, added
  std::vector<double> steps_m;               ///< added left of each seam, half; taken right of it
  /// Of the values above in their order; zeros where only the height was moved.
  std::array<std::array<double, 7>, 7> covariance{};
  double overlap = 0.0;     ///< share of the site in which both have heights
  std::string height_only;  ///< why only the height was moved; empty if it was not so
  /// Lower less this, in the coarser one's resolution; 0 for the base.
  double median_before_m = 0.0, median_after_m = 0.0;
  double nmad_before_m = 0.0, nmad_after_m = 0.0;
};

/// What is left between a source, where it was laid, and the most exact of those before it.
struct ResidualMap {
  std::size_t source = 0;  ///< index
  Metres spacing, x0, y0;  ///< of cells' middles; a third of the coarser pixel, or wider
  Grid<float> residual_m;  ///< those before it less this, in the coarser one's resolution
  double median_m = 0.0, nmad_m = 0.0;
};

/// A surface of the same sources with wider nodes, which this one enlarges. Its heights are kept as
/// means over its nodes' cells; sources lie as they lay in it and have the roughness that was seen
/// there; one that ends outside the enlargement is left out.
struct Enlarged {
  PlanetField field;                  ///< without nodes: heights are matched by `enlarge` later
  std::vector<SourceReport> sources;  ///< as in the request
  /// On the nodes of `field`, or empty. What a wider window tells of artefacts counts in the
  /// enlargement too, and no node is surer than the mean over the cell that it lies in.
  Grid<float> sigma_m{};
  Grid<std::uint8_t> artefacts{};
};

struct FuseRequest {
  Body body;
  double centre_latitude_deg = 0.0;   ///< planetocentric
  double centre_longitude_deg = 0.0;  ///< east positive, any of -180..180 and 0..360
  Metres half_width{100.0};           ///< the square site spans +- this
  Metres spacing{0.5};                ///< of the output nodes; 2 half_width / spacing whole
  std::vector<Source> sources;        ///< coarse to fine; the first is the base
  bool restore = true;                ///< waves as strong as relief is: noise is lowered, what
                                      ///< pixels weaken is raised
  double synthetic_detail = 0.0;      ///< strength of relief below the finest source's pixel,
                                      ///< 0 none, 1 continues the measured spectrum; all over
                                      ///< the site, from the roughness of the finest source in it
  double crater_age_gyr = 0.0;        ///< of the ground: its synthetic detail has the craters of
                                      ///< that age (crater_production.hpp); 0 none
  std::uint64_t seed = 1;             ///< of the synthetic detail
  std::vector<ImageSource> images{};  ///< coarse to fine
  /// Three and more sources (and any with a bow or seams) are aligned at once, so that their order
  /// does not matter; false: each onto the ones before it.
  bool joint = true;
  std::optional<Enlarged> enlarges{};
};

struct FusedSurface {
  PlanetField field;
  /// Same nodes: standard uncertainty from the sources' noise and the relief that they do not
  /// show, as the power law has it; grows into filled voids with the distance; includes the
  /// standard deviation of synthetic detail.
  Grid<float> sigma_m;
  /// Index of the most exact source of those there; 255 = filled: a void of the base, a small
  /// one of that source, or a box or spike that was taken out of it. Synthetic
  /// detail has no mean of its own over a pixel, so a node keeps the source that measured it.
  Grid<std::uint8_t> source;
  /// Same nodes: bits of Artefact of any source there. Of the most exact source they are in sigma_m
  /// too.
  Grid<std::uint8_t> artefacts;
  /// Same nodes: 1 where synthetic detail was added.
  Grid<std::uint8_t> synthetic;
  double synthetic_m = 0.0;  ///< its standard deviation
  std::size_t craters = 0;   ///< synthetic ones
  std::vector<SourceReport> sources;
  std::vector<ResidualMap> residuals;  ///< of all but the base; none of an enlargement
  std::vector<ImageReport> images;
  /// Farthest that a mean over the cell of an enlarged surface's node lies from its height, before
  /// and after it was made to.
  double mean_off_before_m = 0.0, mean_off_m = 0.0;
  /// Largest sum of shifts around three sources, in pixels of the coarsest: of pairs alone, and of
  /// what pairs still ask for after the joint adjustment; 0 without it.
  double loop_before_px = 0.0, loop_after_px = 0.0;
  double loop_sigma_px = 0.0;  ///< of the latter: noise of its pairs (detail/joint_adjustment.hpp)
};

/// @pre 2 half_width / spacing is whole, |latitude| <= 90, 1 to 254 sources
/// @return the fused surface without voids inside the site, or
///   CORE_FILE_NOT_FOUND, HEIGHTMAP_RASTER_NOT_READABLE (truncated, label without image)
///   HEIGHTMAP_NO_PROJECTION      file has no map projection; names the file
///   HEIGHTMAP_WRONG_BODY         file's ellipsoid belongs to another body; names both
///   HEIGHTMAP_SOURCE_UNIT        band unit unknown or contradicts `unit`; undeclared is metres,
///                                or kilometres if the offset is the body's radius in km
///   HEIGHTMAP_IMPLAUSIBLE_HEIGHT heights beyond any relief of the body (raw numbers, radius
///                                taken for height, wrong byte order): gives the range seen
///   HEIGHTMAP_ALL_VOID           nothing but voids inside the site
///   HEIGHTMAP_NO_OVERLAP         source does not touch the site; gives both extents
///   HEIGHTMAP_NOT_ALIGNED        `required`, and relief or overlap do not tell where; says why
///   HEIGHTMAP_DATUM_DIFFERS      `none`, and heights differ by more than 150 m everywhere alike (a
///                                warning where heights may be moved)
///   HEIGHTMAP_NOT_COVERED        the base leaves more than 1 % of the site uncovered
///   HEIGHTMAP_IMAGE_NOT_FINER    an image shows no more than the elevation products
///   CORE_CANCELLED
[[nodiscard]] Result<FusedSurface> fuse(const FuseRequest& request, const RunContext& run = {});

/// Makes the means of a surface over the cells of wide nodes the heights of these
/// (detail/enlargement.hpp), and says in the surface how far they were and are apart; takes over
/// artefacts and uncertainty.
void enlarge(FusedSurface& surface, const Enlarged& wide);

/// The one place where the planet becomes a model. The lowest height of the
/// field becomes `floor`, the lower-left node (0, 0).
[[nodiscard]] ModelField to_model(const PlanetField& field, const ModelScale& scale,
                                  Millimetres floor);

/// Shaded relief for people, 0..255, row 0 southernmost; Lambert, sun from the
/// north-west at 45 degrees unless given. Voids are 0.
[[nodiscard]] Grid<std::uint8_t> hillshade(const ModelField& field,
                                           Radians sun_azimuth = degrees(315),
                                           Radians sun_elevation = degrees(45));

}  // namespace maquette::heightmap
