// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "challenge/challenge_world.hpp"

namespace challenge {

const std::vector<std::string>& hideable() {
  static const std::vector<std::string> all{"machine.scale_x",
                                            "machine.scale_y",
                                            "machine.scale_z",
                                            "machine.squareness_xy",
                                            "machine.squareness_xz",
                                            "machine.squareness_yz",
                                            "machine.straightness_x",
                                            "machine.straightness_y",
                                            "machine.backlash_x",
                                            "machine.backlash_z",
                                            "machine.servo_lag",
                                            "machine.thermal_growth_z",
                                            "machine.step_loss_x",
                                            "machine.step_loss_y",
                                            "machine.step_loss_z",
                                            "tool.radius_error",
                                            "tool.wear",
                                            "tool.runout",
                                            "tool.deflection",
                                            "process.band_step",
                                            "process.chatter",
                                            "stock.warp",
                                            "stock.swelling",
                                            "coating.thickness",
                                            "coating.pooling",
                                            "coating.shadow",
                                            "scanner.range_scale",
                                            "scanner.incidence_bias",
                                            "scanner.encoder_eccentricity",
                                            "scanner.spot_blur"};
  return all;
}
const std::vector<std::string>& smooth_ones() {
  static const std::vector<std::string> all{"machine.scale_x",          "machine.scale_y",
                                            "machine.scale_z",          "machine.squareness_xy",
                                            "machine.squareness_xz",    "machine.squareness_yz",
                                            "machine.straightness_x",   "machine.straightness_y",
                                            "machine.thermal_growth_z", "stock.warp",
                                            "stock.swelling",           "scanner.range_scale"};
  return all;
}
const std::vector<std::string>& nameless() {
  static const std::vector<std::string> all{"dents", "rings", "ripples", "patches"};
  return all;
}

Hidden hide(const std::string& e, double size, const World& w, Draw& d, std::string& summary) {
  const bool along_x = w.along_x;
  const int bands = w.bands, passes = w.passes;
  const double total_time = w.total_time, total_length = w.total_length;
  Hidden h;
  double a = 0;
  const auto axis = [&](Vec3& v) -> double& {
    return e.back() == 'x' ? v.x : e.back() == 'y' ? v.y : v.z;
  };
  if (e.starts_with("machine.scale_")) {
    a = size * d.size(300e-6, 1500e-6) * (e.back() == 'z' ? 4 : 1);
    h.machine = [=](std::vector<Sample>& all) {
      for (auto& s : all) axis(s.p) *= 1 + a;
    };
  } else if (e.starts_with("machine.squareness_")) {
    a = size * d.size(400e-6, 1500e-6) * (e.back() == 'z' ? 4 : 1);
    h.machine = [=](std::vector<Sample>& all) {
      for (auto& s : all) {
        if (e.ends_with("xy")) s.p.x += a * s.p.y;
        if (e.ends_with("xz")) s.p.x += a * s.p.z;
        if (e.ends_with("yz")) s.p.y += a * s.p.z;
      }
    };
  } else if (e.starts_with("machine.straightness_")) {
    a = size * d.size(0.03, 0.1);
    const double waves = d.uniform(0.9, 1.6), phase = d.uniform(0, 2 * kPi);
    h.machine = [=](std::vector<Sample>& all) {
      for (auto& s : all) s.p.z += a * std::sin(2 * kPi * waves * axis(s.p) / kSide + phase);
    };
  } else if (e.starts_with("machine.backlash_")) {
    a = size * d.uniform(0.06, 0.2);
    h.machine = [=](std::vector<Sample>& all) {
      double real = axis(all[0].p);
      for (auto& s : all) {
        double& c = axis(s.p);
        real = std::clamp(real, c - a / 2, c + a / 2);
        c = real;
      }
    };
  } else if (e == "machine.servo_lag") {
    a = std::sqrt(size) * d.uniform(0.8, 2.0);
    h.machine = [=](std::vector<Sample>& all) {
      Vec3 real = all[0].p, last = all[0].p;
      for (auto& s : all) {
        const double way = maquette::norm(s.p - last);
        const Vec3 before = last;
        last = s.p;
        if (way > 0) {
          const Vec3 u = (1 / way) * (s.p - before);
          real = s.p - a * u + std::exp(-way / a) * (real - before + a * u);
        }
        s.p = real;
      }
    };
  } else if (e == "machine.thermal_growth_z") {
    a = size * d.uniform(0.04, 0.12);
    const double tau = d.uniform(0.08, 0.5) * total_time;
    h.machine = [=](std::vector<Sample>& all) {
      for (auto& s : all) s.p.z -= a * (1 - std::exp(-s.time / tau));
    };
  } else if (e.starts_with("machine.step_loss_")) {
    a = size * d.size(0.04, 0.15);
    const double when = d.uniform(0.15, 0.85) * total_time;
    h.machine = [=](std::vector<Sample>& all) {
      for (auto& s : all)
        if (s.time > when) axis(s.p) += a;
    };
  } else if (e == "tool.radius_error") {
    a = size * d.size(0.05, 0.15);
    h.radius = [=](const Sample&) { return kBall + a; };
  } else if (e == "tool.wear") {
    a = size * d.uniform(0.08, 0.2);
    h.radius = [=](const Sample& s) { return kBall - a * s.length / total_length; };
  } else if (e == "tool.runout") {
    a = size * d.uniform(0.03, 0.1);
    h.radial = a;
  } else if (e == "tool.deflection") {
    a = size * d.uniform(0.1, 0.3);
    h.bend = [=](const Sample&, Vec3 n) { return Vec3{a * n.x, a * n.y, 0}; };
  } else if (e == "process.band_step") {
    std::vector<double> step{0};
    for (int b = 1; b < bands; ++b) step.push_back(size * d.size(0.03, 0.1));
    a = step[1];
    h.machine = [=](std::vector<Sample>& all) {
      for (auto& s : all) s.p.z += step[static_cast<std::size_t>((s.pass * bands) / passes)];
    };
  } else if (e == "process.chatter") {
    a = size * d.uniform(0.02, 0.05);
    const double wavelength = d.uniform(2.5, 8);
    const bool of_path = d.uniform(0, 1) < 0.5;
    h.machine = [=](std::vector<Sample>& all) {
      for (auto& s : all)
        s.p.z += a * std::sin(2 * kPi *
                              (of_path   ? s.length
                               : along_x ? s.p.x
                                         : s.p.y) /
                              wavelength);
    };
    summary += of_path ? " (along the path)" : " (along the axis)";
  } else if (e == "stock.warp") {
    a = size * d.size(0.04, 0.15);
    const double b = size * d.size(0.04, 0.15), c = size * d.size(0.04, 0.15);
    h.surface = [=](Field& f) {
      for (int r = 0; r < f.n; ++r)
        for (int k = 0; k < f.n; ++k) {
          const double u = 2 * k * f.step / kSide - 1, v = 2 * r * f.step / kSide - 1;
          f.at(r, k) += a * u * u + b * v * v + c * u * v;
        }
    };
  } else if (e == "stock.swelling") {
    a = size * d.size(400e-6, 1500e-6);
    h.block = [=](Vec3 p) { return (1 + a) * p; };
  } else if (e == "coating.thickness") {
    a = size * d.size(0.05, 0.15);
    h.surface = [=](Field& f) {
      const Field was = smooth(f, 0.4);
      for (int r = 0; r < f.n; ++r)
        for (int k = 0; k < f.n; ++k) f.at(r, k) += a / was.normal(k * f.step, r * f.step, 0.3).z;
    };
  } else if (e == "coating.pooling") {
    a = d.uniform(1.5, 4.0);
    const double share = size * d.uniform(0.3, 0.8);
    h.surface = [=](Field& f) {
      const Field was = smooth(f, a);
      for (std::size_t i = 0; i < f.z.size(); ++i) f.z[i] += share * (was.z[i] - f.z[i]);
    };
  } else if (e == "coating.shadow") {
    a = size * d.uniform(0.1, 0.25);
    const double azimuth = d.uniform(0, 2 * kPi), up = d.uniform(0.3, 0.7);
    const Vec3 s{std::cos(up) * std::cos(azimuth), std::cos(up) * std::sin(azimuth), std::sin(up)};
    h.surface = [=](Field& f) {
      const Field was = smooth(f, 0.4);
      for (int r = 0; r < f.n; ++r)
        for (int k = 0; k < f.n; ++k) {
          const Vec3 n = was.normal(k * f.step, r * f.step, 0.3);
          f.at(r, k) += a * std::max(0.0, maquette::dot(n, s)) / n.z;
        }
    };
  } else if (e == "scanner.range_scale") {
    a = size * d.size(400e-6, 1500e-6);
    h.scanner = [=](int, double& range, double&, double&, double) { range *= 1 + a; };
  } else if (e == "scanner.incidence_bias") {
    a = size * d.uniform(0.03, 0.1);
    h.scanner = [=](int, double& range, double&, double&, double i) {
      range += a * std::pow(std::tan(std::min(i, 1.4)), 2);
    };
  } else if (e == "scanner.encoder_eccentricity") {
    a = size * d.uniform(8e-4, 2e-3);
    const double phase = d.uniform(0, 2 * kPi);
    h.scanner = [=](int, double&, double& azimuth, double&, double) {
      azimuth += a * std::cos(azimuth - phase);
    };
  } else if (e == "scanner.spot_blur") {
    a = std::sqrt(size) * d.uniform(1.0, 2.0);
    h.spot = a;
  } else if (e == "dents") {
    std::vector<std::array<double, 4>> dents;
    for (int i = 0; i < static_cast<int>(d.uniform(2, 9)); ++i)
      dents.push_back(
          {d.uniform(10, 150), d.uniform(10, 150), d.uniform(2, 7), d.uniform(0.08, 0.3) * size});
    h.surface = [=](Field& f) {
      for (int r = 0; r < f.n; ++r)
        for (int k = 0; k < f.n; ++k)
          for (const auto& t : dents)
            f.at(r, k) -=
                t[3] *
                std::exp(-0.5 * (std::pow(k * f.step - t[0], 2) + std::pow(r * f.step - t[1], 2)) /
                         (t[2] * t[2]));
    };
  } else if (e == "rings" || e == "ripples") {
    a = size * d.uniform(0.03, 0.1);
    const double wavelength = d.uniform(5, 20), cx = d.uniform(0, kSide), cy = d.uniform(0, kSide),
                 angle = d.uniform(0.25, 1.3) + kPi / 2 * std::floor(d.uniform(0, 2));
    h.surface = [=](Field& f) {
      for (int r = 0; r < f.n; ++r)
        for (int k = 0; k < f.n; ++k) {
          const double x = k * f.step, y = r * f.step;
          const double way =
              e == "rings" ? std::hypot(x - cx, y - cy) : x * std::cos(angle) + y * std::sin(angle);
          f.at(r, k) += a * std::sin(2 * kPi * way / wavelength);
        }
    };
  } else if (e == "patches") {
    a = size * d.size(0.05, 0.15);
    std::vector<std::array<double, 4>> patches;
    for (int i = 0; i < static_cast<int>(d.uniform(1, 4)); ++i)
      patches.push_back(
          {d.uniform(10, 120), d.uniform(10, 120), d.uniform(15, 40), d.uniform(15, 40)});
    h.surface = [=](Field& f) {
      for (int r = 0; r < f.n; ++r)
        for (int k = 0; k < f.n; ++k)
          for (const auto& p : patches) {
            const double x = k * f.step - p[0], y = r * f.step - p[1];
            if (x > 0 && y > 0 && x < p[2] && y < p[3]) f.at(r, k) += a;
          }
    };
  } else {
    throw std::runtime_error("no such effect: " + e);
  }
  summary += fmt::format(" {}={:.4g}", e, a);
  h.size = a;
  return h;
}

}  // namespace challenge
