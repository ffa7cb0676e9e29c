// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/datum_check.hpp"

#include <cmath>
#include <vector>

#include <fmt/format.h>

#include "core/median.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kLeast_m = 150.0;  // products of one datum agree better than that
constexpr double kSpreads = 10.0;   // of the differences
constexpr std::size_t kSamples = 200'000;
constexpr std::size_t kFewest = 30;

/// Steps between surfaces that heights are counted from.
std::string known_step(double median_m, const Body& body) {
  const double flattening_m = body.equatorial_radius_m - body.polar_radius_m;
  const double step = std::abs(median_m);
  if (body.name == "moon" && std::abs(step - 600.0) < 120.0)
    return "; spheres of 1737.4 and 1738.0 km are 600 m apart";
  if (body.name == "mars" && std::abs(step - 190.0) < 40.0)
    return "; spheres of 3396.19 and 3396.0 km are 190 m apart";
  if (body.name == "mars" && step < 1.2 * flattening_m)
    return "; on Mars heights above the areoid, the ellipsoid and the sphere of 3396.19 km differ "
           "by up to 20 km";
  return "";
}

}  // namespace

std::optional<std::string> datum_doubt(const Grid<float>& below, const Grid<float>& layer,
                                       double sigma_m, const Body& body) {
  std::vector<double> difference;
  const std::size_t step = 1 + below.cells().size() / kSamples;
  for (std::size_t i = 0; i < below.cells().size(); i += step) {
    const double d = static_cast<double>(layer.cells()[i]) - static_cast<double>(below.cells()[i]);
    if (!std::isnan(d)) difference.push_back(d);
  }
  if (difference.size() < kFewest) return std::nullopt;
  const double middle = median(difference), spread = nmad(std::move(difference));
  if (std::abs(middle) < std::fmax(kLeast_m, kSpreads * std::hypot(spread, sigma_m)))
    return std::nullopt;
  return fmt::format(
      "its heights lie {:.1f} m {} those of the sources before it, all alike to "
      "{:.1f} m: another datum{}",
      std::abs(middle), middle > 0.0 ? "above" : "below", spread, known_step(middle, body));
}

}  // namespace maquette::heightmap::detail
