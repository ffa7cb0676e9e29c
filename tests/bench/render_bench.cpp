// SPDX-License-Identifier: GPL-3.0-or-later

// Terrain under the renderer: our tracer and Embree's robust grid on the same 4000 x 4000 quads of
// 0.5 mm, the same rays, one by one and sixteen at a time (4 x 4 pixels). Build, memory, rays per
// CPU second of a picture and of its shadows, and how many rays the two do not agree on. Before it
// a picture of 4256 x 2832 pixels with a hard shadow and all effects, without and with 500 stones.
//
//   render_bench [pixels on a side]     3200 unless given, a multiple of 4
//   render_bench frame                  the picture alone
//   render_bench descent [frames]       60 unless given, of 1024 x 1024 pixels, from 1.5 m down to
//                                       0.1 m over the terrain with 500 stones: pictures a second
//   render_bench leak [million rays]    100 unless given: rays that must cross the surface, at its
//                                       nodes and edges, one by one and in packets

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "camera/render.hpp"
#include "camera/stack.hpp"
#include "core/random.hpp"
#include "heightmap/field_tracer.hpp"
#include "support/bench_times.hpp"
#include "support/d700_stack.hpp"
#include "support/embree_terrain.hpp"
#include "support/scan_terrain.hpp"
#include "support/shapes.hpp"

namespace maquette {
namespace {

using namespace testing_support;

template <class F>
double cost(const F& f) {
  const double start = cpu_seconds();
  f();
  return cpu_seconds() - start;
}

struct Bench {
  const heightmap::ModelField& part;
  const heightmap::FieldTracer& own;
  const EmbreeTerrain& peer;
};
/// Rays in the order of a picture's 4 x 4 blocks.
struct Shots {
  std::vector<heightmap::FieldTracer::Segment> rays;
  std::vector<unsigned char> own, own_many, peer, peer_many;
  explicit Shots(std::size_t n) : rays(n), own(n), own_many(n), peer(n), peer_many(n) {}
};

void line(const char* what, double n, double own_s, double peer_s) {
  fmt::print("{:<26}{:>12.2f}{:>16.2f}\n", what, 1e-6 * n / own_s, 1e-6 * n / peer_s);
}
/// What the two do not agree on, and how many of those rays Embree, which works in single
/// precision, answers as we do one that is moved by some thousandths of a millimetre.
template <class Ask>
void compare(const Shots& s, const Ask& ask) {
  std::size_t differ = 0, apart = 0, hits = 0, many = 0;
  const std::array<double, 3> moves_mm{0.001, 0.003, 0.01};
  std::array<std::size_t, 3> agree{};
  for (std::size_t i = 0; i < s.rays.size(); ++i) {
    hits += s.own[i];
    many += s.own[i] != s.own_many[i] ? 1U : 0U;
    apart += s.peer[i] != s.peer_many[i] ? 1U : 0U;
    if (s.own[i] == s.peer[i]) continue;
    ++differ;
    for (std::size_t k = 0; k < moves_mm.size(); ++k) {
      bool either = false;
      for (const Vec3 way : {Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}})
        for (const double by : {-moves_mm[k], moves_mm[k]}) {
          auto moved = s.rays[i];
          moved.origin_mm = moved.origin_mm + by * way;
          either = either || ask(moved) == (s.peer[i] != 0);
        }
      agree[k] += either ? 1U : 0U;
    }
  }
  fmt::print(
      "  {} of {} differ between ours and Embree ({}, {}, {} of them agree if moved by 0.001, "
      "0.003, 0.01 mm),\n  {} between our rays alone and in packets, {} between Embree's; {} "
      "hit\n",
      differ, s.rays.size(), agree[0], agree[1], agree[2], many, apart, hits);
}

void primary(const Bench& b, Shots& s, std::vector<Vec3>& point) {
  const std::size_t n = s.rays.size();
  std::vector<std::optional<heightmap::FieldHit>> hits(16);
  std::vector<heightmap::FieldTracer::Ray> rays(16);
  const double own = cost([&] {
    for (std::size_t i = 0; i < n; ++i) {
      const auto hit = b.own.trace(s.rays[i].origin_mm, s.rays[i].direction);
      s.own[i] = hit ? 1 : 0;
      if (hit) point[i] = hit->point_mm + 0.02 * hit->normal;
    }
  });
  const double own_many = cost([&] {
    for (std::size_t i = 0; i < n; i += 16) {
      for (std::size_t k = 0; k < 16; ++k)
        rays[k] = {s.rays[i + k].origin_mm, s.rays[i + k].direction};
      b.own.trace_many(rays, hits);
      for (std::size_t k = 0; k < 16; ++k) {
        s.own_many[i + k] = hits[k] ? 1 : 0;
        if (hits[k] && point[i + k] != hits[k]->point_mm + 0.02 * hits[k]->normal)
          s.own_many[i + k] = 2;  // another place
      }
    }
  });
  const double peer = cost([&] {
    for (std::size_t i = 0; i < n; ++i)
      s.peer[i] = b.peer.trace(s.rays[i].origin_mm, s.rays[i].direction) ? 1 : 0;
  });
  std::array<Vec3, 16> from, way;
  std::array<bool, 16> met;
  const double peer_many = cost([&] {
    for (std::size_t i = 0; i < n; i += 16) {
      for (std::size_t k = 0; k < 16; ++k)
        from[k] = s.rays[i + k].origin_mm, way[k] = s.rays[i + k].direction;
      b.peer.trace16(from.data(), way.data(), met.data());
      for (std::size_t k = 0; k < 16; ++k) s.peer_many[i + k] = met[k] ? 1 : 0;
    }
  });
  line("primary, M rays/CPU s", static_cast<double>(n), own, peer);
  line("  in packets", static_cast<double>(n), own_many, peer_many);
  compare(s, [&](const auto& r) { return b.own.trace(r.origin_mm, r.direction).has_value(); });
}

void shadow(const Bench& b, Shots& s) {
  const std::size_t n = s.rays.size();
  const double own = cost([&] {
    for (std::size_t i = 0; i < n; ++i) {
      const auto& r = s.rays[i];
      s.own[i] = b.own.blocked(r.origin_mm, r.direction, r.to_mm) ? 1 : 0;
    }
  });
  std::array<bool, 16> met;
  const double own_many = cost([&] {
    for (std::size_t i = 0; i < n; i += 16) {
      b.own.blocked_many({&s.rays[i], 16}, met);
      for (std::size_t k = 0; k < 16; ++k) s.own_many[i + k] = met[k] ? 1 : 0;
    }
  });
  const double peer = cost([&] {
    for (std::size_t i = 0; i < n; ++i) {
      const auto& r = s.rays[i];
      s.peer[i] = b.peer.blocked(r.origin_mm, r.direction, r.to_mm) ? 1 : 0;
    }
  });
  std::array<Vec3, 16> from, way;
  std::array<double, 16> length;
  const double peer_many = cost([&] {
    for (std::size_t i = 0; i < n; i += 16) {
      for (std::size_t k = 0; k < 16; ++k) {
        const auto& r = s.rays[i + k];
        from[k] = r.origin_mm, way[k] = r.direction, length[k] = r.to_mm;
      }
      b.peer.blocked16(from.data(), way.data(), length.data(), met.data());
      for (std::size_t k = 0; k < 16; ++k) s.peer_many[i + k] = met[k] ? 1 : 0;
    }
  });
  line("shadow, M rays/CPU s", static_cast<double>(n), own, peer);
  line("  in packets", static_cast<double>(n), own_many, peer_many);
  compare(s, [&](const auto& r) { return b.own.blocked(r.origin_mm, r.direction, r.to_mm); });
}

/// Rays from above all heights to below all of them, over the field all the way, through nodes and
/// points of edges and diagonals: each must meet the surface.
int leak(double millions) {
  const heightmap::ModelField part = rough_part(1, 4001, 4001, 0.5);
  const heightmap::HeightRange range = heightmap::height_range(part.z_mm);
  const double top = static_cast<double>(range.max) + 1.0;
  int lost = 0;
  for (const auto instructions :
       {heightmap::FieldTracer::Instructions::best, heightmap::FieldTracer::Instructions::common}) {
    const heightmap::FieldTracer tracer(part, instructions);
    const auto packets = static_cast<std::uint64_t>(millions * 1e6 / 32.0);
    std::uint64_t alone = 0, together = 0, differ = 0;
    std::array<heightmap::FieldTracer::Ray, 16> rays;
    std::array<std::optional<heightmap::FieldHit>, 16> hits;
    const double seconds = cost([&] {
      for (std::uint64_t p = 0; p < packets; ++p) {
        std::uint64_t draw = 64 * p;
        const auto uniform = [&](double lo, double hi) {
          return lo + (hi - lo) * random_uniform(77, draw++);
        };
        const auto r0 = static_cast<std::ptrdiff_t>(uniform(1600.0, 2400.0));
        const auto c0 = static_cast<std::ptrdiff_t>(uniform(1600.0, 2400.0));
        const double turn = uniform(0.0, 6.283185307179586), lean = uniform(0.0, 3.0);
        const Vec3 way = p % 16 == 0 ? Vec3{0.0, 0.0, -1.0}
                                     : Vec3{lean * std::cos(turn), lean * std::sin(turn), -1.0};
        const Vec3 at{part.x_mm(c0), part.y_mm(r0), static_cast<double>(part.z_mm(r0, c0))};
        const Vec3 eye = at - (top - at.z + uniform(0.0, 300.0)) * way;
        for (std::size_t k = 0; k < 16; ++k) {
          const auto r = r0 + static_cast<std::ptrdiff_t>(k / 4);
          const auto c = c0 + static_cast<std::ptrdiff_t>(k % 4);
          const auto node = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
            return Vec3{part.x_mm(c + j), part.y_mm(r + i),
                        static_cast<double>(part.z_mm(r + i, c + j))};
          };
          const std::size_t kind = (p / 16 + k) % 4;
          const double share = kind == 0 ? 0.0 : uniform(0.0, 1.0);
          const Vec3 a = node(0, 0), b = node(kind >= 2 ? 1 : 0, kind % 2 == 1 ? 1 : 0);
          const Vec3 target = a + share * (b - a);
          // From one eye, and side by side.
          rays[k] = p % 2 == 0 ? heightmap::FieldTracer::Ray{eye, normalized(target - eye)}
                               : heightmap::FieldTracer::Ray{target + (eye - at), normalized(way)};
        }
        tracer.trace_many(rays, hits);
        for (std::size_t k = 0; k < 16; ++k) {
          const auto one = tracer.trace(rays[k].origin_mm, rays[k].direction);
          together += hits[k] ? 0U : 1U;
          alone += one ? 0U : 1U;
          differ += one.has_value() != hits[k].has_value() ||
                            (one && one->distance_mm != hits[k]->distance_mm)
                        ? 1U
                        : 0U;
        }
      }
    });
    fmt::print(
        "{}: {} rays through nodes and edges, alone and in packets: {} and {} slip through, "
        "{} differ ({:.0f} CPU s)\n",
        instructions == heightmap::FieldTracer::Instructions::best ? "best" : "common",
        32 * packets, alone, together, differ, seconds);
    lost += alone + together + differ > 0 ? 1 : 0;
  }
  return lost == 0 ? 0 : 1;
}

/// 500 stones of 10 to 30 mm half sunk into the terrain, of ten shapes.
struct Stones {
  std::vector<TriMesh> shapes;
  std::vector<camera::SceneObject> objects;
  explicit Stones(const heightmap::ModelField& part) {
    for (std::uint64_t k = 0; k < 10; ++k)
      shapes.push_back(random_rock(k, {}, 5.0 + static_cast<double>(k), 2));
    for (std::uint64_t i = 0; i < 500; ++i) {
      const double x = 1960.0 * random_uniform(9, 3 * i) + 20.0,
                   y = 1960.0 * random_uniform(9, 3 * i + 1) + 20.0;
      camera::SceneObject stone;
      stone.mesh = &shapes[i % shapes.size()];
      stone.model_from_mesh = {rotation_about({0.0, 0.0, 1.0}, 6.28 * random_uniform(9, 3 * i + 2)),
                               {x, y, heightmap::height_at(part, x, y)}};
      objects.push_back(stone);
    }
  }
};

/// A picture through a camera, beside what the scene takes. In a process of its own.
void frame(const heightmap::ModelField& part, bool stones) {
  const Stones rocks(part);
  std::vector<camera::SceneObject> objects;
  if (stones) objects = rocks.objects;
  camera::SceneObject ground;
  ground.field = &part;
  ground.base_mm = -100.0;
  objects.push_back(ground);
  const auto scene = camera::PreparedScene::build(objects);
  const D700 d700;
  const double before = peak_mib();
  std::optional<camera::Image> image;
  const double rendered = cost([&] {
    auto got =
        scene->render({D700::width_px, D700::height_px, D700::pitch_um, D700::focal_mm},
                      camera::look_at({1000.0, -700.0, 900.0}, {1000.0, 700.0, 0.0}),
                      {{{{-3000.0, 500.0, 1200.0}, {1000.0, 1000.0, 0.0}, 0.0, 90.0}}, {}, {}},
                      {.samples_per_pixel = 1, .white_balance = {1.0, 0.95, 0.9}});
    if (got) image = std::move(*got);
  });
  if (!image) return fmt::print("picture: not rendered\n");
  const double middle = peak_mib();
  std::ptrdiff_t lit = 0;
  for (const auto v : image->lit.cells()) lit += v;
  camera::Frame light;
  light.bands = std::move(image->bands);
  light.depth_mm = std::move(image->depth_mm);
  image.reset();
  const double exposed = cost([&] {
    if (!camera::expose(d700.whole(), d700.shot, std::move(light))) fmt::print("not exposed\n");
  });
  fmt::print(
      "picture of {} x {}, hard shadow, {} stones, 1 sample: {:.1f} CPU s and the whole "
      "stack {:.1f}, together {:.1f};\n  {:.0f} and {:.0f} MiB beside the scene; {:.0f} % "
      "lit\n",
      D700::width_px, D700::height_px, stones ? 500 : 0, rendered, exposed, rendered + exposed,
      middle - before, peak_mib() - before,
      100.0 * static_cast<double>(lit) / D700::width_px / D700::height_px);
}
void frames() {
  const heightmap::ModelField part = rough_part(1, 4001, 4001, 0.5);
  for (const bool stones : {false, true}) in_its_own_process([&] { frame(part, stones); });
}

/// A camera comes down onto the middle, slowly at the end, as a lander brakes.
int descent(int count) {
  const heightmap::ModelField part = rough_part(1, 4001, 4001, 0.5);
  const Stones rocks(part);
  std::vector<camera::SceneObject> objects = rocks.objects;
  camera::SceneObject ground;
  ground.field = &part;
  ground.base_mm = -100.0;
  objects.push_back(ground);
  const auto scene = camera::PreparedScene::build(objects);
  const Vec3 site{1000.0, 1000.0, heightmap::height_at(part, 1000.0, 1000.0)};
  const camera::CameraModel camera{1024, 1024, 14.0, 14.0};
  const camera::Lighting sun{
      {{.position_mm = {-3000.0, 500.0, 1200.0}, .target_mm = site, .sun_diameter_deg = 0.533}},
      {},
      {}};
  const auto begin = std::chrono::steady_clock::now();
  const auto seconds = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  double light = 0.0;
  const double cpu = cost([&] {
    for (int i = 0; i < count; ++i) {
      const double left = 1.0 - (i + 0.5) / count;
      const Vec3 eye =
          site + Vec3{-900.0 * left * left, -600.0 * left * left, 100.0 + 1400.0 * left * left};
      const auto image =
          scene->render(camera, camera::look_at(eye, site + Vec3{0.0, 1.0, 0.0}), sun,
                        {.samples_per_pixel = 1, .seed = 1U + static_cast<unsigned>(i)});
      if (!image) return fmt::print("frame {}: {}\n", i + 1, image.error().message);
      light += static_cast<double>(image->bands[0](512, 512));
      if ((i + 1) % 10 == 0)
        fmt::print("  {} of {} frames, {:.2f} pictures/s\n", i + 1, count, (i + 1) / seconds());
      std::fflush(stdout);
    }
  });
  const double wall = seconds();
  fmt::print(
      "descent of {} frames of 1024 x 1024, soft shadow of the sun, 500 stones, 1 sample: "
      "{:.1f} s, {:.1f} CPU s, {:.2f} pictures/s, {:.2f} pictures/CPU s; mean of the middle "
      "pixels {:.4f}\n",
      count, wall, cpu, count / wall, count / cpu, light / count);
  return 0;
}

int run(int side) {
  const heightmap::ModelField part = rough_part(1, 4001, 4001, 0.5);
  const double cells = 4000.0 * 4000.0;
  std::optional<heightmap::FieldTracer> own;
  const double own_build = cost([&] { own.emplace(part); });
  std::optional<EmbreeTerrain> peer;
  const double peer_build = cost([&] { peer.emplace(part); });
  const double own_bytes = 4.0 * 4001.0 * 4001.0 + static_cast<double>(own->memory_bytes());
  fmt::print("{:<26}{:>12}{:>16}\n", "4000 x 4000 quads", "ours", "Embree robust");
  fmt::print("{:<26}{:>12.2f}{:>16.2f}\n", "build, CPU s", own_build, peer_build);
  fmt::print("{:<26}{:>12.2f}{:>16.2f}\n", "bytes per quad", own_bytes / cells,
             static_cast<double>(peer->bytes) / cells);

  // A camera beyond the south edge that sees sky, too.
  const Vec3 eye{1000.0, -700.0, 900.0}, lamp{-3000.0, 500.0, 1200.0};
  const RigidTransform pose = camera::look_at(eye, {1000.0, 700.0, 0.0});
  const Bench bench{part, *own, *peer};
  std::vector<Vec3> point;
  std::vector<unsigned char> seen;
  {
    Shots shots(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    point.resize(shots.rays.size());
    std::size_t i = 0;
    for (int block = 0; block < side / 4 * (side / 4); ++block)
      for (int k = 0; k < 16; ++k) {
        const int r = block / (side / 4) * 4 + k / 4, c = block % (side / 4) * 4 + k % 4;
        shots.rays[i++] = {
            eye, normalized(pose.direction({(c + 0.5) / side - 0.5, 0.5 - (r + 0.5) / side, -1.0})),
            0.0};
      }
    primary(bench, shots, point);
    seen = std::move(shots.own);
  }
  std::vector<heightmap::FieldTracer::Segment> to_lamp;
  for (std::size_t i = 0; i < point.size(); ++i)
    if (seen[i] != 0)
      to_lamp.push_back({point[i], normalized(lamp - point[i]), norm(lamp - point[i])});
  to_lamp.resize(to_lamp.size() / 16 * 16);
  Shots shots(to_lamp.size());
  shots.rays = std::move(to_lamp);
  shadow(bench, shots);
  peer.reset();
  own.reset();
  return 0;
}

}  // namespace
}  // namespace maquette

int main(int count, char** words) {
  if (count > 1 && std::string_view(words[1]) == "leak")
    return maquette::leak(count > 2 ? std::atof(words[2]) : 100.0);
  if (count > 1 && std::string_view(words[1]) == "descent")
    return maquette::descent(count > 2 ? std::max(1, std::atoi(words[2])) : 60);
  maquette::frames();
  if (count > 1 && std::string_view(words[1]) == "frame") return 0;
  return maquette::run(count > 1 ? std::atoi(words[1]) : 3200);
}
