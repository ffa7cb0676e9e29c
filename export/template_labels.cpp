// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "export/placing_template.hpp"

namespace maquette::exporting {
namespace {

struct Box {
  double x0, y0, x1, y1;
};

bool meet(const Box& a, const Box& b) {
  return a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1;
}

Box around(const TemplateStone& s) {
  const auto [x, y] = s.centre_mm;
  return {x - s.radius_mm, y - s.radius_mm, x + s.radius_mm, y + s.radius_mm};
}

}  // namespace

std::string label_of(const TemplateStone& stone) {
  return fmt::format("{} {}", stone.number, stone.part);
}

std::array<double, 2> heading_end(const TemplateStone& stone) {
  const double heading = stone.heading_deg * std::numbers::pi / 180.0;
  return {stone.centre_mm[0] + stone.radius_mm * std::cos(heading),
          stone.centre_mm[1] + stone.radius_mm * std::sin(heading)};
}

std::vector<std::array<double, 2>> label_places(const PlacingTemplate& plan) {
  constexpr double kWidthOfLetter = 0.65, kGap_mm = 0.8;  // wide enough for common fonts
  std::vector<std::array<double, 2>> places;
  std::vector<Box> labels;
  for (const TemplateStone& s : plan.stones) {
    const double wide = kWidthOfLetter * kLabelLetters_mm * static_cast<double>(label_of(s).size());
    const double high = 0.75 * kLabelLetters_mm, r = s.radius_mm + kGap_mm;
    const auto [x, y] = s.centre_mm;
    const std::array<std::array<double, 2>, 8> candidates{{{x + r, y - 0.5 * high},
                                                           {x - r - wide, y - 0.5 * high},
                                                           {x - 0.5 * wide, y + r},
                                                           {x - 0.5 * wide, y - r - high},
                                                           {x + 0.5 * r, y + r},
                                                           {x + 0.5 * r, y - r - high},
                                                           {x - 0.5 * r - wide, y + r},
                                                           {x - 0.5 * r - wide, y - r - high}}};
    const auto covered = [&](const std::array<double, 2>& at) {
      const Box box{at[0], at[1], at[0] + wide, at[1] + high};
      const auto by = [&](const Box& other) { return meet(box, other); };
      return std::any_of(labels.begin(), labels.end(), by) ||
             std::any_of(plan.stones.begin(), plan.stones.end(),
                         [&](const TemplateStone& other) { return by(around(other)); });
    };
    const auto* free = std::find_if_not(candidates.begin(), candidates.end(), covered);
    const auto at = free == candidates.end() ? candidates.front() : *free;
    places.push_back(at);
    labels.push_back({at[0], at[1], at[0] + wide, at[1] + high});
  }
  return places;
}

}  // namespace maquette::exporting
