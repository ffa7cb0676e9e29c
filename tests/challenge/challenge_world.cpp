// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/challenge_world.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace challenge {

Field make_field(int n, double step) {
  return {n, step,
          std::vector<double>(static_cast<std::size_t>(n) * static_cast<std::size_t>(n), 0.0)};
}

Field smooth(const Field& f, double sigma_mm) {
  const double s = sigma_mm / f.step;
  // What is cut off of the Gaussian, times relief of several mm, is below 0.1 um.
  const int reach = static_cast<int>(std::ceil(4.5 * s));
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

Field draw_terrain(Draw& d) {
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

World draw_world(const Options& options, Draw& d) {
  World w;
  w.design = draw_terrain(d);
  // The program: zigzag along x or y.
  w.along_x = d.uniform(0, 1) < 0.7;
  const bool marked = d.uniform(0, 1) < 0.5;
  int& bands = w.bands;
  for (const auto& e : options.effects)
    if (e == "process.band_step") bands = static_cast<int>(d.uniform(2, 4.999));
  const int passes = w.passes = static_cast<int>(kSide / kStep) + 1;
  std::vector<Sample>& path = w.path;
  {
    std::string& out = w.program;
    out += "%\nG21 G90 G17 G94\nT1 M6\nS18000 M3\nG0 Z60\n";
    double time = 0, length = 0;
    Vec3 at{0, 0, 60};
    bool first = true;
    for (int pass = 0; pass < passes; ++pass) {
      if (pass > 0 && bands > 1 && marked &&
          (pass * bands) / passes != ((pass - 1) * bands) / passes) {
        out += fmt::format("G0 Z60\nT{} M6\nS18000 M3\n", (pass * bands) / passes + 1);
        at.z = 60;
        first = true;
      }
      const double across = pass * kStep;
      const int points = 2 * static_cast<int>(kSide) + 1;
      for (int i = 0; i < points; ++i) {
        const double s = (pass % 2 == 0 ? i : points - 1 - i) * 0.5;
        Vec3 p = w.along_x ? Vec3{s, across, 0} : Vec3{across, s, 0};
        p.z = std::round(1e4 * drop(w.design, p.x, p.y)) / 1e4;
        if (first) {
          out +=
              fmt::format("G0 X{:.4f} Y{:.4f}\nG1 Z{:.4f} F600\nF{:.0f}\n", p.x, p.y, p.z, kFeed);
          first = false;
          time += maquette::norm(Vec3{p.x, p.y, at.z} - at) / 10000 + std::abs(at.z - p.z) / 600;
          path.push_back({{p.x, p.y, at.z}, time, length, true, pass});
        } else {
          out += fmt::format("G1 X{:.4f} Y{:.4f} Z{:.4f}\n", p.x, p.y, p.z);
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
    out += "G0 Z60\nM5\nM30\n%\n";
  }
  w.total_time = path.back().time;
  w.total_length = path.back().length;

  // Two stations round the part.
  const double azimuth0 = d.uniform(0, 2 * kPi), turn = d.uniform(1.0, kPi);
  for (int k = 0; k < 2; ++k) {
    const double azimuth = azimuth0 + k * turn, elevation = d.uniform(0.6, 1.15),
                 range = d.uniform(700, 1500);
    w.station[static_cast<std::size_t>(k)] = {
        kSide / 2 + range * std::cos(elevation) * std::cos(azimuth),
        kSide / 2 + range * std::cos(elevation) * std::sin(azimuth),
        20 + range * std::sin(elevation)};
  }
  for (int k = 0; k < 2; ++k) {
    w.shift[static_cast<std::size_t>(k)] = {0.01 * d.normal(), 0.01 * d.normal(),
                                            0.01 * d.normal()};
    w.rotation[static_cast<std::size_t>(k)] = {5e-5 * d.normal(), 5e-5 * d.normal(),
                                               5e-5 * d.normal()};
  }
  for (std::size_t k = 0; k < options.effects.size(); ++k) {
    const double size = k < options.sizes.size() ? options.sizes[k] : 1.0;
    w.hidden.push_back(hide(options.effects[k], options.size * size, w, d, w.summary));
  }
  w.noise.rough = d.uniform(0.0, 0.03);
  w.noise.rough_length = 0.25 * std::pow(12.0, d.uniform(0, 1));
  if (d.uniform(0, 1) < 0.4) w.noise.wavy = d.uniform(0.002, 0.02);
  w.noise.wavy_length = 10.0 * std::pow(10.0, d.uniform(0, 1));
  w.noise.sigma = options.noise * d.uniform(0.03, 0.08);
  w.noise.rough *= options.noise;
  w.noise.wavy *= options.noise;
  if (options.wavy_mm >= 0.0) {
    w.noise.rough = 0.0;
    w.noise.wavy = options.wavy_mm;
    w.noise.wavy_length = options.wavy_length_mm;
  }
  w.summary += fmt::format(" | passes along {} noise {:.3f} rough {:.3f}/{:.2f} wavy {:.4f}/{:.0f}",
                           w.along_x ? "x" : "y", w.noise.sigma, w.noise.rough,
                           w.noise.rough_length, w.noise.wavy, w.noise.wavy_length);
  return w;
}

}  // namespace challenge
