// SPDX-License-Identifier: GPL-3.0-or-later

// Terrain under the renderer: our tracer and Embree's robust grid on the same 4000 x 4000 quads of
// 0.5 mm, the same rays. Build, memory, rays per CPU second of a picture and of its shadows, and
// how many rays the two do not agree on; then a picture of 4256 x 2832 pixels with a hard shadow.
//
//   render_bench [pixels on a side]     3200 unless given

#include <cstdio>
#include <cstdlib>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "camera/render.hpp"
#include "heightmap/field_tracer.hpp"
#include "support/bench_times.hpp"
#include "support/embree_terrain.hpp"
#include "support/scan_terrain.hpp"

namespace maquette {
namespace {

using namespace testing_support;

template <class F>
double cost(const F& f) {
  const double start = cpu_seconds();
  f();
  return cpu_seconds() - start;
}

int run(int side) {
  const heightmap::ModelField part = testing_support::rough_part(1, 4001, 4001, 0.5);
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
  const std::size_t rays = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  std::vector<Vec3> way(rays), point(rays), to_lamp(rays);
  std::vector<double> length(rays);
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c)
      way[static_cast<std::size_t>(r) * static_cast<std::size_t>(side) +
          static_cast<std::size_t>(c)] =
          normalized(pose.direction({(c + 0.5) / side - 0.5, 0.5 - (r + 0.5) / side, -1.0}));
  std::vector<unsigned char> ours(rays), theirs(rays);
  const double own_primary = cost([&] {
    for (std::size_t i = 0; i < rays; ++i) {
      const auto hit = own->trace(eye, way[i]);
      ours[i] = hit ? 1 : 0;
      if (hit) point[i] = hit->point_mm + 0.02 * hit->normal;
    }
  });
  const double peer_primary = cost([&] {
    for (std::size_t i = 0; i < rays; ++i) theirs[i] = peer->trace(eye, way[i]) ? 1 : 0;
  });
  const auto report = [&](const char* what, double a, double b, std::size_t n) {
    std::size_t differ = 0, hits = 0;
    for (std::size_t i = 0; i < rays; ++i)
      differ += ours[i] != theirs[i] ? 1U : 0U, hits += std::size_t{ours[i]};
    fmt::print("{:<26}{:>12.2f}{:>16.2f}   {} of {} differ, {} hit\n", what,
               1e-6 * static_cast<double>(n) / a, 1e-6 * static_cast<double>(n) / b, differ, n,
               hits);
  };
  report("primary, M rays per CPU s", own_primary, peer_primary, rays);
  std::vector<std::size_t> seen;
  for (std::size_t i = 0; i < rays; ++i) {
    if (ours[i] == 0) continue;
    const Vec3 l = lamp - point[i];
    length[i] = norm(l);
    to_lamp[i] = normalized(l);
    seen.push_back(i);
  }
  std::fill(ours.begin(), ours.end(), static_cast<unsigned char>(0));
  std::fill(theirs.begin(), theirs.end(), static_cast<unsigned char>(0));
  const double own_shadow = cost([&] {
    for (const std::size_t i : seen)
      ours[i] = own->blocked(point[i], to_lamp[i], length[i]) ? 1 : 0;
  });
  const double peer_shadow = cost([&] {
    for (const std::size_t i : seen)
      theirs[i] = peer->blocked(point[i], to_lamp[i], length[i]) ? 1 : 0;
  });
  report("shadow, M rays per CPU s", own_shadow, peer_shadow, seen.size());
  peer.reset();
  own.reset();

  camera::SceneObject ground;
  ground.field = &part;
  ground.base_mm = -20.0;
  const double before = peak_mib();
  const auto scene = camera::PreparedScene::build({ground});
  const camera::Lamp bulb{lamp, {1000.0, 1000.0, 0.0}, 0.0, 90.0};
  double samples = 0.0;
  const double picture = cost([&] {
    const auto image =
        scene->render({4256, 2832, 8.45, 34.5}, pose, {{bulb}, {}, {}}, {.samples_per_pixel = 1});
    samples = image ? image->mean_samples : 0.0;
  });
  fmt::print(
      "picture of 4256 x 2832 pixels, hard shadow, {} sample: {:.1f} CPU s, peak {:.0f} MiB more\n",
      samples, picture, peak_mib() - before);
  return 0;
}

}  // namespace
}  // namespace maquette

int main(int count, char** words) {
  return maquette::run(count > 1 ? std::atoi(words[1]) : 3200);
}
