// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file synthetic_products.hpp
/// The embedded default site: true-format elevation products of a surface whose
/// truth is known.
///
/// The truth is a closed function of position (synthetic_terrain.hpp), evaluated
/// anywhere to rounding. From it are written, in the style of the archives:
///   synthetic_<body>_dtm.img   PDS3, attached label, float32, equirectangular with the
///                    standard parallel at a multiple of 5 degrees and the body's
///                    radius there, HiRISE DTM style, with a small known offset
///                    against the truth; the outermost corners are void
///   synthetic_<body>_ldem.img, .lbl   PDS3, detached label, 16-bit, simple cylindrical
///                    with a whole number of pixels per degree, LOLA GDR style:
///                    SCALING_FACTOR 0.5, OFFSET the body's equatorial radius, so
///                    that DN * 0.5 is the height and DN * 0.5 + OFFSET the radius
///   synthetic_<body>_truth.json   the parameters of the truth and of the planted offsets
///
/// A pixel holds the truth at its centre (a point sample, no mean over the pixel)
/// plus noise. Latitudes are planetocentric. A point of the body belongs to the
/// (east, north) of the site's tangent plane that GeographicLib's LocalCartesian
/// gives for it at height 0 of the ellipsoid.

#include <cstdint>
#include <filesystem>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/body.hpp"

namespace maquette::assets {

inline constexpr ErrorCode kSiteOutOfRange{"ASSETS_SITE_OUT_OF_RANGE"};

struct SyntheticSite {
  heightmap::Body body{"moon", 1737400.0, 1737400.0};
  double centre_latitude_deg = -43.3;
  double centre_longitude_deg = 348.8;
  Metres half_width{150.0};  ///< area covered by the fine product; the coarse covers 4 x
  Metres fine_pixel{1.0};
  Metres coarse_pixel{20.0};
  /// Of the fine product against the truth: what is at (e, n) appears at
  /// (e + east, n + north), higher by `up`.
  Metres planted_shift_east{1.7};
  Metres planted_shift_north{-0.9};
  Metres planted_shift_up{4.2};
  double fine_noise_m = 0.05;  ///< standard deviation per pixel
  double coarse_noise_m = 0.3;
  std::uint64_t seed = 20260101;
};

struct SyntheticProducts {
  std::filesystem::path fine_img, coarse_lbl, coarse_img, truth_json;
};

/// Height of the truth in metres above the body's ellipsoid at a point of the site's
/// tangent-plane frame. Depends on site.seed alone. Thread-safe; about a microsecond.
[[nodiscard]] double synthetic_height_m(const SyntheticSite& site, double east_m, double north_m);

/// Writes the four files into `folder`, each by rename, so that existing ones are
/// replaced whole. Same site, same bytes, for any number of threads.
/// @return their paths, or
///   ASSETS_SITE_OUT_OF_RANGE  a field of `site` is out of range; names it
///   CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL, CORE_CANCELLED
[[nodiscard]] Result<SyntheticProducts> write_synthetic_products(
    const SyntheticSite& site, const std::filesystem::path& folder, const RunContext& run = {});

}  // namespace maquette::assets
