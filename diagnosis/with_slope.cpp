// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/with_slope.hpp"

#include <algorithm>
#include <cmath>

#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/sizes.hpp"
#include "diagnosis/detail/standing.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr const char* kSquareness = "machine.squareness_xy";
/// Of the curve's way from its lowest to its highest: a whole wave's best line rises by as much as
/// what is left of the wave then.
constexpr double kOfItsLine = 2.0;

bool is_sideways(const Member& m) {
  return m.effect->name.starts_with("machine.straightness_") && m.form.law.starts_with("sideways");
}

double peak_to_valley_mm(const Member& m, const std::vector<Estimate>& sizes) {
  constexpr int kStops = 64;
  double low = INFINITY, high = -INFINITY;
  for (int i = 0; i <= kStops; ++i) {
    double at = 0.0;
    for (std::size_t c = 0; c < m.form.columns.size(); ++c)
      at += sizes[c].value * legendre(static_cast<int>(c) + 2, 2.0 * i / kStops - 1.0);
    low = std::fmin(low, at);
    high = std::fmax(high, at);
  }
  return high - low;
}

}  // namespace

Form with_slope(Form curve, const Scene& scene) {
  Column slope = find_effect(kSquareness)->forms(scene)[0].columns[0];
  slope.parameter.name = "slope_urad";
  curve.columns.push_back(std::move(slope));
  curve.law += kWithSlope;
  curve.finer = nullptr;
  return curve;
}

void join_slopes(const Search& search, const Bank& bank, Linearised& residuals,
                 std::vector<Confirmed>& confirmed, std::vector<Rejected>& rejected) {
  const auto square = std::find_if(confirmed.begin(), confirmed.end(), [](const Confirmed& c) {
    return c.member.effect->name == kSquareness;
  });
  if (square == confirmed.end()) return;
  const Members members = members_of(confirmed);
  const auto sizes = [&](std::size_t k) {
    return sizes_of(search, bank, members, residuals.fit_of(members), k);
  };
  const auto at = static_cast<std::size_t>(square - confirmed.begin());
  const double angle = 1e-6 * std::abs(sizes(at)[0].value);
  for (std::size_t k = 0; k < members.size(); ++k) {
    if (!is_sideways(members[k])) continue;
    const int axis = members[k].effect->name.back() == 'x' ? 0 : 1;
    const Box3& box = residuals.scene().box;
    const double rises_mm = angle * component(box.max - box.min, axis);
    if (!(rises_mm < kOfItsLine * peak_to_valley_mm(members[k], sizes(k)))) continue;
    confirmed[k].member.form = with_slope(members[k].form, residuals.scene());
    confirmed.erase(square);
    rejected.push_back({kSquareness, members[k].effect->name +
                                         " is measured from a line that may lie so: its slope"});
    residuals.about(members_of(confirmed));
    return;
  }
}

}  // namespace maquette::diagnosis::detail
