// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/challenge_case.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <fstream>
#include <stdexcept>
#include <thread>

#include <fmt/format.h>

#include "challenge/challenge_world.hpp"
#include "heightmap/field_io.hpp"

namespace challenge {
namespace {

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
  void add_to(Field& f) const {
    using Turn = std::complex<double>;
    const auto n = static_cast<std::size_t>(f.n);
    std::vector<Turn> along(n);
    for (const Wave& w : waves) {
      for (std::size_t c = 0; c < n; ++c)
        along[c] = std::polar(amplitude, w.kx * f.step * static_cast<double>(c) + w.phase);
      for (std::size_t r = 0; r < n; ++r) {
        const Turn up = std::polar(1.0, w.ky * f.step * static_cast<double>(r));
        for (std::size_t c = 0; c < n; ++c)
          f.z[r * n + c] += up.real() * along[c].real() - up.imag() * along[c].imag();
      }
    }
  }
};

/// Rough coat, and in some cases a smooth random part of the block.
void roughen(Field& cut, const Noise& law, Draw& d) {
  Field noise = make_field(cut.n, kCell);
  for (double& v : noise.z) v = d.normal();
  if (law.rough_length > 0.3) noise = smooth(noise, 0.7 * law.rough_length);
  double square = 0;
  for (const double v : noise.z) square += v * v;
  const double scale = law.rough / std::sqrt(square / static_cast<double>(noise.z.size()));
  for (std::size_t i = 0; i < cut.z.size(); ++i) cut.z[i] += scale * noise.z[i];
  if (law.wavy > 0) Waves(d, law.wavy, law.wavy_length, 60).add_to(cut);
}

/// Range at which a ray meets the surface, -1: it does not. Looked for on the grid.
/// @param exact  told by the balls that made the surface, else by the grid
double hit(const Cut& cut, double top, Vec3 o, Vec3 b, double from, bool exact) {
  if (b.z >= 0) return -1;
  const Field& f = cut.surface;
  double t = std::max(from, (top - o.z) / b.z);
  const double step = 0.25, apart = 0.05;  // of the grid from the balls
  for (int i = 0; i < 4000; ++i, t += step) {
    const Vec3 p = o + t * b;
    if (p.x < 0 || p.y < 0 || p.x > kSide || p.y > kSide) {
      if (p.z < 0) return -1;
      continue;
    }
    if (p.z < f.height(p.x, p.y)) {
      const auto above_ground = [&](double at) {
        const Vec3 q = o + at * b;
        return q.z - (exact ? cut.height(q.x, q.y) : f.height(q.x, q.y));
      };
      // Regula falsi, the end that stays counted half (Illinois).
      double a = t - step - (exact ? apart : 0.0), c = t + (exact ? apart : 0.0);
      double up = above_ground(a), down = above_ground(c), m = c;
      for (int k = 0; k < 40 && up > down; ++k) {
        m = (a * down - c * up) / (down - up);
        const double v = above_ground(m);
        if (std::abs(v) < 1e-6) break;
        if (v > 0) {
          a = m, up = v, down *= 0.5;
        } else {
          c = m, down = v, up *= 0.5;
        }
      }
      const Vec3 q = o + m * b;
      return q.x < 0.3 || q.y < 0.3 || q.x > kSide - 0.3 || q.y > kSide - 0.3 ? -1 : m;
    }
  }
  return -1;
}

void write_scan(const std::vector<std::array<double, 3>>& points,
                const std::filesystem::path& file) {
  std::ofstream out(file, std::ios::binary);
  out << fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty "
      "double y\nproperty double z\nend_header\n",
      points.size());
  out.write(reinterpret_cast<const char*>(points.data()),
            static_cast<std::streamsize>(points.size() * sizeof(points[0])));
}

}  // namespace

Cut cut_of(const World& w, const std::vector<Hidden>& hidden) {
  auto path = w.path;
  for (const Hidden& h : hidden)
    if (h.machine) h.machine(path);
  Cut cut;
  for (const Hidden& h : hidden) cut.radial += h.radial;
  bool joined = false;
  for (std::size_t i = 0; i < path.size(); ++i) {
    Sample s = path[i];
    if (s.rapid) {
      joined = false;
      continue;
    }
    double radius = kBall;
    for (const Hidden& h : hidden) {
      if (h.radius) radius += h.radius(s) - kBall;
      if (h.bend) {
        // Normal of the surface of tip places: that of the contact.
        const Vec3 p = w.path[i].p;
        const Vec3 n = maquette::normalized(
            Vec3{-(drop(w.design, p.x + 0.5, p.y) - drop(w.design, p.x - 0.5, p.y)),
                 -(drop(w.design, p.x, p.y + 0.5) - drop(w.design, p.x, p.y - 0.5)), 1.0});
        s.p += h.bend(s, n);
      }
    }
    cut.balls.push_back({s.p, radius, joined});
    joined = true;
  }
  Field& bare = cut.bare = make_field(static_cast<int>(kSide / kCell) + 1, kCell);
  std::fill(bare.z.begin(), bare.z.end(), 60.0);
  cut.made.assign(bare.z.size(), 0);
  const auto rows = [&](int first, int last) {
    for (std::size_t i = 0; i < cut.balls.size(); ++i) {
      const Vec3 tip = cut.balls[i].tip;
      const double radius = cut.balls[i].radius, wide = radius + cut.radial;
      const int c0 = static_cast<int>(std::ceil((tip.x - wide) / kCell)),
                c1 = static_cast<int>(std::floor((tip.x + wide) / kCell));
      const int r0 = static_cast<int>(std::ceil((tip.y - wide) / kCell)),
                r1 = static_cast<int>(std::floor((tip.y + wide) / kCell));
      for (int r = std::max(first, r0); r <= std::min(last - 1, r1); ++r)
        for (int c = std::max(0, c0); c <= std::min(bare.n - 1, c1); ++c) {
          const double dx = c * kCell - tip.x, dy = r * kCell - tip.y;
          double q2 = dx * dx + dy * dy;
          double& z = bare.at(r, c);
          if (cut.radial > 0) {
            const double q = std::max(0.0, std::sqrt(q2) - cut.radial);
            q2 = q * q;
          }
          if (q2 >= radius * radius || tip.z + q2 / (2.0 * radius) >= z) continue;  // above that
          const double low = tip.z + radius - std::sqrt(radius * radius - q2);
          if (low >= z) continue;
          z = low;
          cut.made[static_cast<std::size_t>(r) * static_cast<std::size_t>(bare.n) +
                   static_cast<std::size_t>(c)] = static_cast<std::uint32_t>(i);
        }
    }
  };
  {
    constexpr int kStrips = 2;
    std::vector<std::jthread> strips;
    for (int k = 0; k < kStrips; ++k)
      strips.emplace_back([&, k] { rows(k * bare.n / kStrips, (k + 1) * bare.n / kStrips); });
  }
  cut.surface = bare;
  for (const Hidden& h : hidden)
    if (h.surface) h.surface(cut.surface);
  return cut;
}

double Cut::height(double x, double y) const {
  const int n = bare.n, c0 = static_cast<int>(x / kCell), r0 = static_cast<int>(y / kCell);
  std::array<std::uint32_t, 16> seen{};
  std::size_t count = 0;
  double low = 60.0;
  const auto under = [&](Vec3 tip, double radius) {
    const double dx = x - tip.x, dy = y - tip.y;
    double q2 = dx * dx + dy * dy;
    if (radial > 0) q2 = std::pow(std::max(0.0, std::sqrt(q2) - radial), 2);
    if (q2 < radius * radius && tip.z + q2 / (2.0 * radius) < low)
      low = std::min(low, tip.z + radius - std::sqrt(radius * radius - q2));
  };
  const auto between = [&](const Ball& a, const Ball& b) {
    constexpr int kParts = 5;
    for (int k = 0; k <= kParts; ++k)
      under(a.tip + (k / double{kParts}) * (b.tip - a.tip), b.radius);
  };
  for (int r = std::max(0, r0 - 1); r <= std::min(n - 1, r0 + 2); ++r)
    for (int c = std::max(0, c0 - 1); c <= std::min(n - 1, c0 + 2); ++c) {
      const std::uint32_t by = made[static_cast<std::size_t>(r) * static_cast<std::size_t>(n) +
                                    static_cast<std::size_t>(c)];
      const auto end = seen.begin() + static_cast<std::ptrdiff_t>(count);
      if (std::find(seen.begin(), end, by) != end) continue;
      seen[count++] = by;
      under(balls[by].tip, balls[by].radius);
      if (balls[by].joined) between(balls[by - 1], balls[by]);
      if (by + 1 < balls.size() && balls[by + 1].joined) between(balls[by], balls[by + 1]);
    }
  return low + surface.height(x, y) - bare.height(x, y);
}

double above(const Field& surface) {
  return *std::max_element(surface.z.begin(), surface.z.end()) + 0.1;
}

Rays rays_of(const World& w, int scan, int points) {
  const Vec3 o = w.station[static_cast<std::size_t>(scan)];
  const Vec3 axis = maquette::normalized(kMiddle - o);
  const double distance = maquette::norm(kMiddle - o);
  const double area = kSide * kSide * std::abs(axis.z);
  return {o, std::atan2(axis.y, axis.x), std::asin(axis.z), 0.62 * kSide * 1.3 / distance,
          std::sqrt(area / points) / distance};
}

Echo echo(const Cut& cut, double top, const std::vector<Hidden>& hidden, int scan, Vec3 o,
          double azimuth, double elevation) {
  Echo e;
  e.azimuth = azimuth;
  e.elevation = elevation;
  const Vec3 b = e.beam = direction(azimuth, elevation);
  e.range = hit(cut, top, o, b, 0, true);
  if (e.range < 0) return e;
  e.met = true;
  const Vec3 p0 = o + e.range * b;
  double spot = 0;
  for (const Hidden& h : hidden) spot = std::max(spot, h.spot);
  if (spot > 0) {
    const Vec3 e1 = maquette::normalized(maquette::cross(b, {0, 0, 1})),
               e2 = maquette::cross(b, e1);
    double sum = 0;
    int count = 0;
    // Rings of like shares of a Gaussian, scaled to its variance. They must look alike from all
    // sides: a spiral of as many beams has a covariance of 6 % across its axes, 0.05 mm at a rim.
    // All that meet the surface count: a slope seen at a flat angle is 10 mm deep within a spot.
    constexpr int kRings = 8, kDirections = 8, kBeams = kRings * kDirections;
    double variance = 0;  // along each axis
    for (int ring = 0; ring < kRings; ++ring)
      variance -= std::log(1 - (ring + 0.5) / kRings) / kRings;
    for (int q = 0; q < kBeams; ++q) {
      const int ring = q / kDirections;
      const double r = spot * std::sqrt(-2 * std::log(1 - (ring + 0.5) / kRings) / variance),
                   angle = 2 * kPi * (q + 0.5 * (ring % 2)) / kDirections;
      const Vec3 off = p0 + r * std::cos(angle) * e1 + r * std::sin(angle) * e2;
      const double there = hit(cut, top, o, maquette::normalized(off - o), e.range - 30, false);
      if (there > 0) sum += there, ++count;
    }
    if (count > kBeams / 2) e.range = sum / count;
  }
  const Vec3 n = e.normal = cut.surface.normal(p0.x, p0.y, 0.6);
  const double incidence = std::acos(std::clamp(-maquette::dot(n, b), 0.01, 1.0));
  for (const Hidden& h : hidden)
    if (h.block) {
      // The block has grown: the ray meets another place, the same to first order along the normal.
      const Vec3 moved = h.block(p0) - p0;
      e.range += maquette::dot(moved, n) / maquette::dot(b, n);
    }
  for (const Hidden& h : hidden)
    if (h.scanner) h.scanner(scan, e.range, e.azimuth, e.elevation, incidence);
  return e;
}

Truth make_case(const Options& options, const std::filesystem::path& folder) {
  Draw d{std::mt19937_64(options.seed * 7919 + 13)};
  std::filesystem::create_directories(folder);
  const World w = draw_world(options, d);
  {
    maquette::heightmap::ModelField f{
        maquette::Grid<float>(w.design.n, w.design.n), maquette::Millimetres{kStep}, {}, {}};
    for (int r = 0; r < w.design.n; ++r)
      for (int c = 0; c < w.design.n; ++c) f.z_mm(r, c) = static_cast<float>(w.design.at(r, c));
    if (const auto done = maquette::heightmap::write_model_field(f, folder / "design.tif"); !done)
      throw std::runtime_error(done.error().message);
  }
  std::ofstream(folder / "part.ngc") << w.program;

  Cut cut = cut_of(w, w.hidden);
  roughen(cut.surface, w.noise, d);
  std::vector<std::array<double, 3>> holes;
  for (int i = 0; i < static_cast<int>(d.uniform(0, 5)); ++i)
    holes.push_back({d.uniform(0, kSide), d.uniform(0, kSide), d.uniform(3, 15)});
  const double top = above(cut.surface);
  std::string toml =
      "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\ngcode = "
      "\"part.ngc\"\n[tool]\nball_diameter_mm = 6.0\n[coating]\nthickness_mm = "
      "0.0\nroughness_sigma_mm = 0.02\nroughness_correlation_mm = 0.5\n";
  for (int k = 0; k < 2; ++k) {
    const auto ku = static_cast<std::size_t>(k);
    const Vec3 o = w.station[ku];
    std::vector<std::array<double, 3>> points;
    rays_of(w, k, options.points).each([&](double azimuth, double elevation) {
      const Echo e = echo(cut, top, w.hidden, k, o, azimuth, elevation);
      if (!e.met) return;
      Vec3 p = o + (e.range + w.noise.sigma * d.normal()) * direction(e.azimuth, e.elevation);
      bool lost = d.uniform(0, 1) < 0.01;
      for (const auto& hole : holes) lost |= std::hypot(p.x - hole[0], p.y - hole[1]) < hole[2];
      if (lost) return;
      p = p + maquette::cross(w.rotation[ku], p - kMiddle) + w.shift[ku];
      points.push_back({p.x, p.y, p.z});
    });
    const std::string name = k == 0 ? "scan_a.ply" : "scan_b.ply";
    write_scan(points, folder / name);
    toml += fmt::format(
        "[[scan]]\npoints = \"{}\"\nscanner_position_mm = [{:.3f}, {:.3f}, {:.3f}]\nrange_sigma_mm "
        "= 0.05\n",
        name, o.x, o.y, o.z);
  }
  std::ofstream(folder / "case.toml") << toml;
  std::vector<double> sizes;
  for (const Hidden& h : w.hidden) sizes.push_back(h.size);
  return {options.effects, std::move(sizes), w.summary};
}

}  // namespace challenge
