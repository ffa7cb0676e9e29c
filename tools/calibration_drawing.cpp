// SPDX-License-Identifier: GPL-3.0-or-later

// transfer_drawing and residual_drawing of jobs_calibrate.hpp.

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "tools/jobs_calibrate.hpp"

namespace maquette::tools {
namespace {

constexpr Colour kBlue{33, 102, 172}, kRed{178, 24, 43}, kGrey{150, 150, 150};

void cross_at(Drawing& d, Point at, double half, Colour colour) {
  d.parts.emplace_back(DrawnLine{{{at.x - half, at.y}, {at.x + half, at.y}}, colour, 1.5, 0.0});
  d.parts.emplace_back(DrawnLine{{{at.x, at.y - half}, {at.x, at.y + half}}, colour, 1.5, 0.0});
}

}  // namespace

Drawing transfer_drawing(const camera::SensorCalibration& s) {
  constexpr double kLeft = 90.0, kTop = 50.0, kWidth = 760.0, kHeight = 480.0;
  Drawing d{900.0, 600.0, {}};
  double low_x = INFINITY, high_x = 0.0, low_y = INFINITY, high_y = 0.0;
  for (const camera::TransferPoint& p : s.points) {
    if (!(p.signal_dn > 0.0) || !(p.variance_dn2.value > 0.0)) continue;
    low_x = std::min(low_x, p.signal_dn), high_x = std::max(high_x, p.signal_dn);
    low_y = std::min(low_y, p.variance_dn2.value), high_y = std::max(high_y, p.variance_dn2.value);
  }
  if (!(high_x > 0.0)) return d;
  low_x /= 1.5, high_x *= 1.5, low_y /= 2.0, high_y *= 2.0;
  const auto place = [&](double x, double y) {
    return Point{kLeft + kWidth * std::log(x / low_x) / std::log(high_x / low_x),
                 kTop + kHeight * (1.0 - std::log(y / low_y) / std::log(high_y / low_y))};
  };
  for (const double v : log_ticks(low_x, high_x, 9)) {
    const Point at = place(v, low_y);
    d.parts.emplace_back(DrawnLine{{{at.x, kTop}, {at.x, at.y}}, {225, 225, 225}, 1.0, 0.0});
    d.parts.emplace_back(DrawnText{
        {at.x, at.y + 18.0}, fmt::format("{:g}", v), 12.0, DrawnText::Anchor::middle, false, {}});
  }
  for (const double v : log_ticks(low_y, high_y, 9)) {
    const Point at = place(low_x, v);
    d.parts.emplace_back(
        DrawnLine{{{at.x, at.y}, {at.x + kWidth, at.y}}, {225, 225, 225}, 1.0, 0.0});
    d.parts.emplace_back(DrawnText{
        {at.x - 6.0, at.y + 4.0}, fmt::format("{:g}", v), 12.0, DrawnText::Anchor::end, false, {}});
  }
  const double k = 1.0 / s.gain_e_per_dn.value;
  DrawnLine line{{}, kGrey, 2.0, 0.0};
  for (const double x : {low_x, high_x}) {
    const double y = std::clamp(k * x, low_y, high_y);
    line.points.push_back(place(y / k, y));
  }
  line.points.back().x = std::min(line.points.back().x, kLeft + kWidth);
  d.parts.emplace_back(line);
  for (const camera::TransferPoint& p : s.points)
    if (p.signal_dn > 0.0 && p.variance_dn2.value > 0.0)
      cross_at(d, place(p.signal_dn, p.variance_dn2.value), 4.0,
               p.saturated ? kRed
               : p.used    ? kBlue
                           : kGrey);
  d.parts.emplace_back(DrawnText{{kLeft, 28.0},
                                 fmt::format("photon transfer: {:.5g} +- {:.2g} e per DN",
                                             s.gain_e_per_dn.value, s.gain_e_per_dn.u),
                                 16.0});
  d.parts.emplace_back(DrawnText{{kLeft + 0.5 * kWidth, kTop + kHeight + 44.0},
                                 "signal over the dark, DN",
                                 13.0,
                                 DrawnText::Anchor::middle});
  d.parts.emplace_back(DrawnText{{22.0, kTop + 0.5 * kHeight},
                                 "variance over the dark, DN²",
                                 13.0,
                                 DrawnText::Anchor::middle,
                                 true});
  return d;
}

Drawing residual_drawing(const camera::TargetCalibration& t,
                         const std::vector<camera::TargetPoint>& points) {
  constexpr double kLongest = 860.0, kMargin = 20.0, kHead = 40.0;
  const auto& k = t.intrinsics;
  const double scale = kLongest / std::max(k.width_px, k.height_px);
  Drawing d{scale * k.width_px + 2.0 * kMargin, scale * k.height_px + 2.0 * kMargin + kHead, {}};
  const auto place = [&](camera::Vec2 px) {
    return Point{kMargin + scale * px.x, kHead + kMargin + scale * px.y};
  };
  const Point a = place({0.0, 0.0}), b = place({1.0 * k.width_px, 1.0 * k.height_px});
  d.parts.emplace_back(DrawnLine{{a, {b.x, a.y}, b, {a.x, b.y}, a}, kGrey, 1.0, 0.0});
  // An arrow of four standard deviations is 30 long, rounded to a decade's 1, 2 or 5.
  constexpr double kArrow = 30.0;
  const double wanted = kArrow / (4.0 * std::max(t.noise_px, 1e-9) * scale);
  const double decade = std::pow(10.0, std::floor(std::log10(wanted)));
  const double times = decade * (wanted >= 5.0 * decade ? 5.0 : wanted >= 2.0 * decade ? 2.0 : 1.0);
  for (const camera::TargetResidual& r : t.residuals) {
    const Point from = place(points[r.point].seen_px);
    const double length = std::hypot(r.off_px.x, r.off_px.y) * times * scale;
    // Those left out are as long as fits; where they point is what is of use.
    const double shorter = length > 4.0 * kArrow ? 4.0 * kArrow / length : 1.0;
    const Point to{from.x + shorter * times * scale * r.off_px.x,
                   from.y + shorter * times * scale * r.off_px.y};
    const Colour colour = r.left_out ? kRed : kBlue;
    d.parts.emplace_back(DrawnLine{{from, to}, colour, 1.0, 0.0});
    d.parts.emplace_back(DrawnBox{{from.x - 1.0, from.y - 1.0}, 2.0, 2.0, colour});
  }
  cross_at(d, place({k.cx_px, k.cy_px}), 8.0, {34, 34, 34});
  d.parts.emplace_back(
      DrawnText{{kMargin, 28.0},
                fmt::format("residuals x {:g}, {:.2g} px a coordinate; cross: principal point",
                            times, t.noise_px),
                15.0});
  return d;
}

}  // namespace maquette::tools
