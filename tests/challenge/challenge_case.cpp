// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/challenge_case.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <random>
#include <stdexcept>

#include <fmt/format.h>

#include "core/vec.hpp"
#include "heightmap/field_io.hpp"

namespace challenge {
namespace {

using maquette::Vec3;
constexpr double kPi = 3.14159265358979323846;
constexpr double kSide = 160.0, kStep = 0.5;  // design
constexpr double kCell = 0.2;                 // cut surface
constexpr double kBall = 3.0;
constexpr double kFeed = 3000.0;

struct Draw {
  std::mt19937_64 bits;
  double uniform(double a, double b) {
    return a + (b - a) * std::generate_canonical<double, 53>(bits);
  }
  double normal() { return std::normal_distribution<double>()(bits); }
  double sign() { return uniform(0, 1) < 0.5 ? -1.0 : 1.0; }
  double size(double a, double b) { return sign() * uniform(a, b); }
};

struct Field {
  int n = 0;
  double step = 1.0;
  std::vector<double> z;
  double& at(int r, int c) {
    return z[static_cast<std::size_t>(r) * static_cast<std::size_t>(n) +
             static_cast<std::size_t>(c)];
  }
  double at(int r, int c) const {
    return z[static_cast<std::size_t>(r) * static_cast<std::size_t>(n) +
             static_cast<std::size_t>(c)];
  }
  double height(double x, double y) const {
    const double u = std::clamp(x / step, 0.0, n - 1.000001),
                 v = std::clamp(y / step, 0.0, n - 1.000001);
    const int c = static_cast<int>(u), r = static_cast<int>(v);
    const double a = u - c, b = v - r;
    return (1 - b) * ((1 - a) * at(r, c) + a * at(r, c + 1)) +
           b * ((1 - a) * at(r + 1, c) + a * at(r + 1, c + 1));
  }
  Vec3 normal(double x, double y, double h) const {
    const double gx = (height(x + h, y) - height(x - h, y)) / (2 * h),
                 gy = (height(x, y + h) - height(x, y - h)) / (2 * h);
    return maquette::normalized(Vec3{-gx, -gy, 1.0});
  }
};

Field make_field(int n, double step) {
  return {n, step,
          std::vector<double>(static_cast<std::size_t>(n) * static_cast<std::size_t>(n), 0.0)};
}

/// Gaussian smoothing of a square field, reflected at the border.
Field smooth(const Field& f, double sigma_mm) {
  const double s = sigma_mm / f.step;
  const int reach = static_cast<int>(std::ceil(3.0 * s));
  std::vector<double> kernel;
  double sum = 0;
  for (int i = -reach; i <= reach; ++i)
    kernel.push_back(std::exp(-0.5 * i * i / (s * s))), sum += kernel.back();
  const auto mirror = [&](int i) { return i < 0 ? -i : i >= f.n ? 2 * f.n - 2 - i : i; };
  Field a = f, b = f;
  for (int r = 0; r < f.n; ++r)
    for (int c = 0; c < f.n; ++c) {
      double v = 0;
      for (int k = -reach; k <= reach; ++k)
        v += kernel[static_cast<std::size_t>(k + reach)] *
             f.at(r, std::clamp(mirror(c + k), 0, f.n - 1));
      a.at(r, c) = v / sum;
    }
  for (int r = 0; r < f.n; ++r)
    for (int c = 0; c < f.n; ++c) {
      double v = 0;
      for (int k = -reach; k <= reach; ++k)
        v += kernel[static_cast<std::size_t>(k + reach)] *
             a.at(std::clamp(mirror(r + k), 0, f.n - 1), c);
      b.at(r, c) = v / sum;
    }
  return b;
}

/// Stationary Gaussian noise by random waves: any correlation length on any grid.
struct Waves {
  struct Wave {
    double kx, ky, phase;
  };
  std::vector<Wave> waves;
  double amplitude = 0;
  Waves(Draw& d, double sigma, double length, int count) {
    amplitude = sigma * std::sqrt(2.0 / count);
    for (int i = 0; i < count; ++i)
      waves.push_back({d.normal() / length, d.normal() / length, d.uniform(0, 2 * kPi)});
  }
  double operator()(double x, double y) const {
    double v = 0;
    for (const Wave& w : waves) v += std::cos(w.kx * x + w.ky * y + w.phase);
    return amplitude * v;
  }
};

Field terrain(Draw& d) {
  const int n = static_cast<int>(kSide / kStep) + 1;
  Field f = make_field(n, kStep);
  const double relief = d.uniform(4.0, 9.0);
  struct Wave {
    double kx, ky, phase, a;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < 120; ++i) {
    const double wavelength = 6.0 * std::pow(25.0, d.uniform(0, 1)), angle = d.uniform(0, 2 * kPi),
                 k = 2 * kPi / wavelength;
    waves.push_back({k * std::cos(angle), k * std::sin(angle), d.uniform(0, 2 * kPi),
                     relief * std::pow(wavelength / 150.0, 1.3) * 0.25});
  }
  struct Crater {
    double x, y, r;
  };
  std::vector<Crater> craters;
  for (int i = 0; i < 6; ++i)
    craters.push_back({d.uniform(0, kSide), d.uniform(0, kSide), d.uniform(6, 25)});
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c) {
      const double x = c * kStep, y = r * kStep;
      double z = 20.0;
      for (const Wave& w : waves) z += w.a * std::cos(w.kx * x + w.ky * y + w.phase);
      for (const Crater& k : craters) {
        const double q = std::hypot(x - k.x, y - k.y) / k.r;
        z += 0.25 * k.r * (q < 1 ? q * q - 0.8 : 0.2 * std::exp(-3.0 * (q - 1)));
      }
      f.at(r, c) = static_cast<double>(static_cast<float>(z));
    }
  return f;
}

struct Sample {
  Vec3 p;
  double time, length;
  bool rapid = false;
  int pass = 0;
};

double drop(const Field& f, double x, double y) {
  const int reach = static_cast<int>(kBall / kStep);
  const int c0 = static_cast<int>(std::lround(x / kStep)),
            r0 = static_cast<int>(std::lround(y / kStep));
  double best = -1e9;
  for (int r = std::max(0, r0 - reach - 1); r <= std::min(f.n - 1, r0 + reach + 1); ++r)
    for (int c = std::max(0, c0 - reach - 1); c <= std::min(f.n - 1, c0 + reach + 1); ++c) {
      const double dx = c * kStep - x, dy = r * kStep - y, q = kBall * kBall - dx * dx - dy * dy;
      if (q > 0) best = std::max(best, f.at(r, c) + std::sqrt(q) - kBall);
    }
  return best;
}

struct Hidden {
  std::function<void(std::vector<Sample>&)> machine;     // moves the tip
  std::function<double(const Sample&)> radius;           // of the ball, tip held
  double radial = 0.0;                                   // runout
  std::function<Vec3(const Sample&, Vec3 normal)> bend;  // by the surface's normal
  std::function<void(Field&)> surface;                   // after the cut: heights
  std::function<Vec3(Vec3)> block;                       // of a measured place
  std::function<void(int scan, double& range, double& azimuth, double& elevation, double incidence)>
      scanner;
  double spot = 0.0;
};

}  // namespace

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
const std::vector<std::string>& nameless() {
  static const std::vector<std::string> all{"dents", "rings", "ripples", "patches"};
  return all;
}

Truth make_case(const Options& options, const std::filesystem::path& folder) {
  Draw d{std::mt19937_64(options.seed * 7919 + 13)};
  std::filesystem::create_directories(folder);
  const Field design = terrain(d);
  {
    maquette::heightmap::ModelField f{
        maquette::Grid<float>(design.n, design.n), maquette::Millimetres{kStep}, {}, {}};
    for (int r = 0; r < design.n; ++r)
      for (int c = 0; c < design.n; ++c) f.z_mm(r, c) = static_cast<float>(design.at(r, c));
    if (const auto done = maquette::heightmap::write_model_field(f, folder / "design.tif"); !done)
      throw std::runtime_error(done.error().message);
  }
  // The program: zigzag along x or y.
  const bool along_x = d.uniform(0, 1) < 0.7;
  const bool marked = d.uniform(0, 1) < 0.5;
  int bands = 1;
  for (const auto& e : options.effects)
    if (e == "process.band_step") bands = static_cast<int>(d.uniform(2, 4.999));
  const int passes = static_cast<int>(kSide / kStep) + 1;
  std::vector<Sample> path;
  {
    std::ofstream out(folder / "part.ngc");
    out << "%\nG21 G90 G17 G94\nT1 M6\nS18000 M3\nG0 Z60\n";
    double time = 0, length = 0;
    Vec3 at{0, 0, 60};
    bool first = true;
    for (int pass = 0; pass < passes; ++pass) {
      if (pass > 0 && bands > 1 && marked &&
          (pass * bands) / passes != ((pass - 1) * bands) / passes) {
        out << fmt::format("G0 Z60\nT{} M6\nS18000 M3\n", (pass * bands) / passes + 1);
        at.z = 60;
        first = true;
      }
      const double across = pass * kStep;
      const int points = 2 * static_cast<int>(kSide) + 1;
      for (int i = 0; i < points; ++i) {
        const double s = (pass % 2 == 0 ? i : points - 1 - i) * 0.5;
        Vec3 p = along_x ? Vec3{s, across, 0} : Vec3{across, s, 0};
        p.z = std::round(1e4 * drop(design, p.x, p.y)) / 1e4;
        if (first) {
          out << fmt::format("G0 X{:.4f} Y{:.4f}\nG1 Z{:.4f} F600\nF{:.0f}\n", p.x, p.y, p.z,
                             kFeed);
          first = false;
          time += maquette::norm(Vec3{p.x, p.y, at.z} - at) / 10000 + std::abs(at.z - p.z) / 600;
          path.push_back({{p.x, p.y, at.z}, time, length, true, pass});
        } else {
          out << fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f}\n", p.x, p.y, p.z);
        }
        const Vec3 from = path.back().p;
        const double way = maquette::norm(p - from);
        const int parts = std::max(1, static_cast<int>(way / 0.25 + 0.5));
        const bool plunge = path.back().rapid;
        for (int k = 1; k <= parts; ++k) {
          const double share = static_cast<double>(k) / parts;
          path.push_back({from + share * (p - from), time + (plunge ? 0 : share * way / kFeed),
                          length + share * way, plunge && k < parts, pass});
        }
        if (!plunge) time += way / kFeed;
        length += way;
        at = p;
      }
    }
    out << "G0 Z60\nM5\nM30\n%\n";
  }
  const double total_time = path.back().time, total_length = path.back().length;

  Truth truth;
  truth.effects = options.effects;
  const double size = options.size;
  std::vector<Hidden> hidden;
  // Two stations round the part.
  std::array<Vec3, 2> station;
  const double azimuth0 = d.uniform(0, 2 * kPi), turn = d.uniform(1.0, kPi);
  for (int k = 0; k < 2; ++k) {
    const double azimuth = azimuth0 + k * turn, elevation = d.uniform(0.6, 1.15),
                 range = d.uniform(700, 1500);
    station[static_cast<std::size_t>(k)] = {
        kSide / 2 + range * std::cos(elevation) * std::cos(azimuth),
        kSide / 2 + range * std::cos(elevation) * std::sin(azimuth),
        20 + range * std::sin(elevation)};
  }
  std::array<Vec3, 2> shift{}, rotation{};
  for (int k = 0; k < 2; ++k) {
    shift[static_cast<std::size_t>(k)] = {0.01 * d.normal(), 0.01 * d.normal(), 0.01 * d.normal()};
    rotation[static_cast<std::size_t>(k)] = {5e-5 * d.normal(), 5e-5 * d.normal(),
                                             5e-5 * d.normal()};
  }
  for (const std::string& e : options.effects) {
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
      truth.summary += of_path ? " (along the path)" : " (along the axis)";
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
      const Vec3 s{std::cos(up) * std::cos(azimuth), std::cos(up) * std::sin(azimuth),
                   std::sin(up)};
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
                  std::exp(-0.5 *
                           (std::pow(k * f.step - t[0], 2) + std::pow(r * f.step - t[1], 2)) /
                           (t[2] * t[2]));
      };
    } else if (e == "rings" || e == "ripples") {
      a = size * d.uniform(0.03, 0.1);
      const double wavelength = d.uniform(5, 20), cx = d.uniform(0, kSide),
                   cy = d.uniform(0, kSide),
                   angle = d.uniform(0.25, 1.3) + kPi / 2 * std::floor(d.uniform(0, 2));
      h.surface = [=](Field& f) {
        for (int r = 0; r < f.n; ++r)
          for (int k = 0; k < f.n; ++k) {
            const double x = k * f.step, y = r * f.step;
            const double way = e == "rings" ? std::hypot(x - cx, y - cy)
                                            : x * std::cos(angle) + y * std::sin(angle);
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
    truth.summary += fmt::format(" {}={:.4g}", e, a);
    hidden.push_back(std::move(h));
  }

  // The cut.
  const auto commanded = path;
  for (const Hidden& h : hidden)
    if (h.machine) h.machine(path);
  Field cut = make_field(static_cast<int>(kSide / kCell) + 1, kCell);
  std::fill(cut.z.begin(), cut.z.end(), 60.0);
  double radial = 0;
  for (const Hidden& h : hidden) radial += h.radial;
  for (std::size_t i = 0; i < path.size(); ++i) {
    Sample s = path[i];
    if (s.rapid) continue;
    double radius = kBall;
    for (const Hidden& h : hidden) {
      if (h.radius) radius = h.radius(s);
      if (h.bend) {
        // Normal of the surface of tip places: that of the contact.
        const Vec3 p = commanded[i].p;
        const Vec3 n = maquette::normalized(
            Vec3{-(drop(design, p.x + 0.5, p.y) - drop(design, p.x - 0.5, p.y)),
                 -(drop(design, p.x, p.y + 0.5) - drop(design, p.x, p.y - 0.5)), 1.0});
        s.p += h.bend(s, n);
      }
    }
    const double wide = radius + radial;
    const int c0 = static_cast<int>(std::ceil((s.p.x - wide) / kCell)),
              c1 = static_cast<int>(std::floor((s.p.x + wide) / kCell));
    const int r0 = static_cast<int>(std::ceil((s.p.y - wide) / kCell)),
              r1 = static_cast<int>(std::floor((s.p.y + wide) / kCell));
    for (int r = std::max(0, r0); r <= std::min(cut.n - 1, r1); ++r)
      for (int c = std::max(0, c0); c <= std::min(cut.n - 1, c1); ++c) {
        const double dx = c * kCell - s.p.x, dy = r * kCell - s.p.y;
        double q2 = dx * dx + dy * dy;
        if (radial > 0) {
          const double q = std::max(0.0, std::sqrt(q2) - radial);
          q2 = q * q;
        }
        if (q2 >= radius * radius) continue;
        double& z = cut.at(r, c);
        z = std::min(z, s.p.z + radius - std::sqrt(radius * radius - q2));
      }
  }
  for (const Hidden& h : hidden)
    if (h.surface) h.surface(cut);
  // Rough coat, and in some cases a smooth random part of the block.
  const double rough = d.uniform(0.0, 0.03), rough_length = 0.25 * std::pow(12.0, d.uniform(0, 1));
  {
    Field noise = make_field(cut.n, kCell);
    for (double& v : noise.z) v = d.normal();
    if (rough_length > 0.3) noise = smooth(noise, 0.7 * rough_length);
    double square = 0;
    for (const double v : noise.z) square += v * v;
    const double scale = rough / std::sqrt(square / static_cast<double>(noise.z.size()));
    for (std::size_t i = 0; i < cut.z.size(); ++i) cut.z[i] += scale * noise.z[i];
  }
  const double wavy = d.uniform(0, 1) < 0.4 ? d.uniform(0.002, 0.02) : 0.0,
               wavy_length = 10.0 * std::pow(10.0, d.uniform(0, 1));
  if (wavy > 0) {
    const Waves field(d, wavy, wavy_length, 60);
    for (int r = 0; r < cut.n; ++r)
      for (int c = 0; c < cut.n; ++c) cut.at(r, c) += field(c * kCell, r * kCell);
  }
  // The scans.
  const double sigma = d.uniform(0.03, 0.08);
  std::vector<std::array<double, 3>> holes;
  for (int i = 0; i < static_cast<int>(d.uniform(0, 5)); ++i)
    holes.push_back({d.uniform(0, kSide), d.uniform(0, kSide), d.uniform(3, 15)});
  const double top = *std::max_element(cut.z.begin(), cut.z.end()) + 0.1;
  std::string toml =
      "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\ngcode = "
      "\"part.ngc\"\n[tool]\nball_diameter_mm = 6.0\n[coating]\nthickness_mm = "
      "0.0\nroughness_sigma_mm = 0.02\nroughness_correlation_mm = 0.5\n";
  for (int k = 0; k < 2; ++k) {
    const auto ku = static_cast<std::size_t>(k);
    const Vec3 o = station[ku];
    const auto hit = [&](Vec3 b, double from) -> double {
      if (b.z >= 0) return -1;
      double t = std::max(from, (top - o.z) / b.z);
      const double step = 0.25;
      for (int i = 0; i < 4000; ++i, t += step) {
        const Vec3 p = o + t * b;
        if (p.x < 0 || p.y < 0 || p.x > kSide || p.y > kSide) {
          if (p.z < 0) return -1;
          continue;
        }
        if (p.z < cut.height(p.x, p.y)) {
          double a = t - step, c = t;
          for (int m = 0; m < 16; ++m) {
            const double middle = 0.5 * (a + c);
            const Vec3 q = o + middle * b;
            (q.z < cut.height(q.x, q.y) ? c : a) = middle;
          }
          const Vec3 q = o + c * b;
          return q.x < 0.3 || q.y < 0.3 || q.x > kSide - 0.3 || q.y > kSide - 0.3 ? -1
                                                                                  : 0.5 * (a + c);
        }
      }
      return -1;
    };
    // Directions towards evenly drawn places keep the density about even; on a grid of angles.
    const Vec3 middle{kSide / 2, kSide / 2, 20};
    const Vec3 axis_dir = maquette::normalized(middle - o);
    const double distance = maquette::norm(middle - o);
    const double az0 = std::atan2(axis_dir.y, axis_dir.x), el0 = std::asin(axis_dir.z);
    const double half = 0.62 * kSide * 1.3 / distance;
    const double area = kSide * kSide * std::abs(axis_dir.z);
    const double step = std::sqrt(area / options.points) / distance;
    std::vector<std::array<double, 3>> points;
    for (double el = el0 - half; el < el0 + half; el += step)
      for (double da = -half / std::cos(el); da < half / std::cos(el); da += step / std::cos(el)) {
        double azimuth = az0 + da, elevation = el;
        const Vec3 b{std::cos(elevation) * std::cos(azimuth),
                     std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
        double range = hit(b, 0);
        if (range < 0) continue;
        const Vec3 p0 = o + range * b;
        double spot = 0;
        for (const Hidden& h : hidden) spot = std::max(spot, h.spot);
        if (spot > 0) {
          const Vec3 e1 = maquette::normalized(maquette::cross(b, {0, 0, 1})),
                     e2 = maquette::cross(b, e1);
          double sum = 0;
          int count = 0;
          // Golden spiral of a Gaussian; one of 16 places leans by 0.7 in its third moment.
          constexpr int kBeams = 64;
          for (int q = 0; q < kBeams; ++q) {
            const double r = spot * std::sqrt(-2 * std::log(1 - (q + 0.5) / kBeams)),
                         angle = 2.399963 * q;
            const Vec3 off = p0 + r * std::cos(angle) * e1 + r * std::sin(angle) * e2;
            const double there = hit(maquette::normalized(off - o), range - 8);
            if (there > 0 && std::abs(there - range) < 8) sum += there, ++count;
          }
          if (count > kBeams / 2) range = sum / count;
        }
        const Vec3 n = cut.normal(p0.x, p0.y, 0.6);
        const double incidence = std::acos(std::clamp(-maquette::dot(n, b), 0.01, 1.0));
        for (const Hidden& h : hidden)
          if (h.block) {
            // The block has grown: the ray meets another place, the same to first order along the
            // normal.
            const Vec3 moved = h.block(p0) - p0;
            range += maquette::dot(moved, n) / maquette::dot(b, n);
          }
        for (const Hidden& h : hidden)
          if (h.scanner) h.scanner(k, range, azimuth, elevation, incidence);
        range += sigma * d.normal();
        Vec3 p = o + range * Vec3{std::cos(elevation) * std::cos(azimuth),
                                  std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
        bool lost = d.uniform(0, 1) < 0.01;
        for (const auto& hole : holes) lost |= std::hypot(p.x - hole[0], p.y - hole[1]) < hole[2];
        if (lost) continue;
        p = p + maquette::cross(rotation[ku], p - middle) + shift[ku];
        points.push_back({p.x, p.y, p.z});
      }
    const std::string name = k == 0 ? "scan_a.ply" : "scan_b.ply";
    std::ofstream out(folder / name, std::ios::binary);
    out << fmt::format(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty "
        "double y\nproperty double z\nend_header\n",
        points.size());
    out.write(reinterpret_cast<const char*>(points.data()),
              static_cast<std::streamsize>(points.size() * sizeof(points[0])));
    toml += fmt::format(
        "[[scan]]\npoints = \"{}\"\nscanner_position_mm = [{:.3f}, {:.3f}, {:.3f}]\nrange_sigma_mm "
        "= 0.05\n",
        name, o.x, o.y, o.z);
  }
  std::ofstream(folder / "case.toml") << toml;
  truth.summary +=
      fmt::format(" | passes along {} noise {:.3f} rough {:.3f}/{:.2f} wavy {:.4f}/{:.0f}",
                  along_x ? "x" : "y", sigma, rough, rough_length, wavy, wavy_length);
  return truth;
}

}  // namespace challenge
