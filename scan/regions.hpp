// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file regions.hpp
/// Deviations where a person asks for them: regions with tolerances, texture of the residual
/// surface, what deviations depend on, and a budget of their uncertainty.

#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/bands.hpp"
#include "meshing/stones.hpp"
#include "scan/deviate.hpp"
#include "scan/significance.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kRegionFormat{"SCAN_REGION_FORMAT"};

/// A polygon in the model frame; rings by the even-odd rule (holes are holes).
struct Region {
  std::string name;
  std::vector<std::vector<std::array<double, 2>>> rings_mm;
  double lower_mm = NAN, upper_mm = NAN;  ///< tolerance zone of the deviation; NaN: none
  [[nodiscard]] bool holds(double x_mm, double y_mm) const;
};

/// GeoJSON (RFC 7946, but in model millimetres): a FeatureCollection of Polygon and MultiPolygon
/// with properties `name`, `lower_mm`, `upper_mm`.
/// Or DXF (by its ending), drawn in millimetres of the model: each closed polyline, circle,
/// ellipse, spline or hatch is a region (curves as chords of a degree), named by the text that
/// stands in it, "NAME" or "NAME LOWER UPPER", else by its layer. Open curves, points and solids
/// are passed over.
/// @return SCAN_REGION_FORMAT with the path of the element, or if a drawing's unit ($INSUNITS) is
///   not mm or it has no closed curve; CORE_FILE_*
[[nodiscard]] Result<std::vector<Region>> read_regions(const std::filesystem::path& path);
/// The bands that the part is milled in, "band NUMBER". MESHING_BANDS_DEGENERATE as
/// split_into_bands
[[nodiscard]] Result<std::vector<Region>> band_regions(const heightmap::ModelField& design,
                                                       const meshing::BandSplit& split);

/// What each planned stone covers from above: the convex hull of its mesh, "stone NUMBER".
[[nodiscard]] std::vector<Region> stone_regions(std::span<const meshing::PlacedStone> plan);

/// Decision by ISO 14253-1 with the expanded uncertainty (k = 2) of cell means as guard band.
enum class Verdict { none, pass, fail, undecided };
[[nodiscard]] std::string_view name_of(Verdict verdict);

struct RegionResult {
  std::string name;
  DeviationStatistics statistics;  ///< of its points; coverage is not stated (NaN)
  /// Standard deviation of the mean: noise over the root of the points, times what correlation
  /// over cells makes of it (CellMap::inflation of the coarsest map), and pose.
  double sigma_mean_mm = NAN;
  Verdict verdict = Verdict::none;
  double within = NAN;    ///< share of the points in the tolerance zone
  double worst_mm = NAN;  ///< cell mean that is farthest out of (or nearest to leaving) it
  Vec3 worst_at_mm;
};
[[nodiscard]] std::vector<RegionResult> judge_regions(std::span<const Vec3> points_mm,
                                                      std::span<const float> deviation_mm,
                                                      std::span<const Region> regions,
                                                      const Significance& significance,
                                                      const Registration* registration);

/// ISO 25178-2 height and hybrid parameters of the deviation map, after a polynomial of second
/// degree (form) is taken off. Gaps are left out.
struct Texture {
  double sa_mm = NAN, sq_mm = NAN, sz_mm = NAN, ssk = NAN, sku = NAN;
  double sdr = NAN;      ///< developed area over projected area, minus 1
  double form_mm = NAN;  ///< peak to valley of what was taken off
};
[[nodiscard]] Texture texture_of(const Grid<float>& deviation_mm, double spacing_mm);

/// Deviations by something else: bins of equal counts, but never is one value in two bins.
struct Dependence {
  std::string on;
  std::vector<double> from, to, mean_mm, nmad_mm;
  std::vector<std::size_t> points;
};
/// @param values  one per deviation; NaN is left out
[[nodiscard]] Dependence depend_on(std::string name, std::span<const float> values,
                                   std::span<const float> deviation_mm, std::size_t bins = 8);

/// One line of a budget by GUM (JCGM 100:2008), standard uncertainties of a cell's mean.
struct Contribution {
  std::string source;
  double u_mm = 0.0;
  std::string evaluation;  ///< type A or B, and from what
};
struct Budget {
  std::vector<Contribution> contributions;
  double combined_mm = 0.0, expanded_mm = 0.0;  ///< k = 2
};
[[nodiscard]] Budget budget_of(const CellMap& cells, const Registration* registration,
                               const heightmap::ModelField& design);

}  // namespace maquette::scan
