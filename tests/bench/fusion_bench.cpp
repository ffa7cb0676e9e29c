// SPDX-License-Identifier: GPL-3.0-or-later

// Fusion of ten synthetic truths beside the oracle, gdalwarp's mosaic, a feather and a two-band
// blend: errors as ratios to the oracle's, the step at the border, the power of waves just inside
// it, and how often errors lie within the stated uncertainty. Then the time of a large one, and of
// one product alone on the nodes of a site beside gdalwarp.

#include <array>

#include <fmt/format.h>

#include "heightmap/fuse.hpp"
#include "support/bench_times.hpp"
#include "support/fusion_peers.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace {

using namespace maquette;
using namespace maquette::testing_support;
void time_large() {
  using namespace heightmap::detail;
  constexpr std::ptrdiff_t n = 4001;
  Grid<float> base(n, n), layer(n, n, NAN);
  for (std::size_t i = 0; i < base.cells().size(); ++i)
    base.cells()[i] = static_cast<float>(random_uniform(1, i));
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < 3 * n / 4; ++c)
      layer(r, c) = static_cast<float>(random_uniform(2, static_cast<std::uint64_t>(r * n + c)));
  const WaveTable waves = wave_table({0.7, 0.01, 0.1}, 0.5, 2000.0, 7);
  const Times start = now();
  Blend blend(waves, std::move(base), knowledge_of(waves, 40.0, 1.0), {}, true);
  blend.add(layer, knowledge_of(waves, 2.0, 0.1));
  fmt::print("\n{} x {} nodes, two sources: {:.1f} s\n", n, n, now().wall - start.wall);
}

/// CPU and wall seconds of gdalwarp, bilinear and on two threads, onto the nodes of the site.
Times gdalwarp_seconds(const std::filesystem::path& file, const heightmap::FuseRequest& site) {
  const double half = site.half_width.value(), step = site.spacing.value();
  std::vector<std::string> words{"-of",
                                 "MEM",
                                 "-r",
                                 "bilinear",
                                 "-multi",
                                 "-wo",
                                 "NUM_THREADS=2",
                                 "-ot",
                                 "Float32",
                                 "-t_srs",
                                 fmt::format("+proj=aeqd +lat_0={} +lon_0={} +R=1737400 +units=m",
                                             site.centre_latitude_deg, site.centre_longitude_deg)};
  words.emplace_back("-te");
  for (const double edge : {-1.0, -1.0, 1.0, 1.0})
    words.push_back(fmt::format("{}", edge * (half + 0.5 * step)));
  words.insert(words.end(), {"-tr", fmt::format("{}", step), fmt::format("{}", step)});
  std::vector<char*> arguments;
  for (std::string& w : words) arguments.push_back(w.data());
  arguments.push_back(nullptr);
  const Times start = now();
  GDALDatasetH source = GDALOpen(file.c_str(), GA_ReadOnly);
  GDALWarpAppOptions* options = GDALWarpAppOptionsNew(arguments.data(), nullptr);
  GDALDatasetH result = GDALWarp("", nullptr, 1, &source, options, nullptr);
  const Times end = now();
  if (result == nullptr || GDALGetRasterXSize(result) != 4001) fmt::print("gdalwarp failed\n");
  GDALWarpAppOptionsFree(options);
  GDALClose(result);
  GDALClose(source);
  return {end.wall - start.wall, end.cpu - start.cpu};
}

/// One product on the nodes of a site: ours with its uncertainty and masks, nothing looked for.
void time_beside_gdalwarp() {
  const ScratchFolder scratch;
  PlanetRaster raster;
  raster.cols = raster.rows = 5000;
  raster.pixel = 0.5;
  raster.west = -0.5 * raster.pixel * raster.cols;
  raster.north = 0.5 * raster.pixel * raster.rows;
  raster.height = [](double x, double y) { return 20.0 * std::sin(x / 90.0) * std::cos(y / 70.0); };
  write_planet_raster(raster, scratch / "a.tif");
  heightmap::FuseRequest site;
  site.body = *heightmap::body_by_name("moon");
  site.half_width = Metres{1000};
  site.spacing = Metres{0.5};
  site.sources = {heightmap::Source{"raster", scratch / "a.tif"}};
  site.sources[0].clean = heightmap::Clean::off;
  site.restore = false;
  const Times start = now();
  const auto fused = heightmap::fuse(site);
  const Times end = now();
  if (!fused) return fmt::print("{}\n", fused.error().message);
  const Times ours{end.wall - start.wall, end.cpu - start.cpu};
  const Times theirs = gdalwarp_seconds(scratch / "a.tif", site);
  constexpr double kNodes = 4001.0 * 4001.0;
  fmt::print(
      "one product on 4001 x 4001 nodes: {:.2f} CPU s, {:.2f} s by the clock, {:.1f} M nodes/s; "
      "gdalwarp, bilinear, two threads: {:.2f} CPU s, {:.2f} s; ratio {:.2f} (CPU), {:.2f}\n",
      ours.cpu, ours.wall, 1e-6 * kNodes / ours.wall, theirs.cpu, theirs.wall,
      ours.cpu / theirs.cpu, ours.wall / theirs.wall);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "warp") {
    time_beside_gdalwarp();
    return 0;
  }
  const FusionTable table = fusion_table();
  const Score& oracle = table.scores[0];
  fmt::print("{:26}{:>8}{:>8}{:>8}{:>8}{:>8}{:>8}   {}\n", "rmse / oracle's", "inside", "border-",
             "border+", "outside", "all", "step", "power just inside, waves of 2-4 4-8 8-16 16-32");
  for (const Score& s : table.scores) {
    fmt::print("{:26}", s.name);
    for (const Place p : {kInside, kInsideBorder, kOutsideBorder, kOutside})
      fmt::print("{:8.3f}", s.rmse(p) / oracle.rmse(p));
    fmt::print("{:8.3f}{:8.3f}  ", s.rmse_of_all() / oracle.rmse_of_all(), s.step());
    for (std::size_t k = 0; k < s.power.size(); ++k)
      if (s.true_power[k] > 0.0)
        fmt::print("{:7.3f}", s.power[k] / s.true_power[k]);
      else
        fmt::print("{:>7}", "noise");
    fmt::print("\n");
  }
  fmt::print("oracle's rmse, m          ");
  for (const Place p : {kInside, kInsideBorder, kOutsideBorder, kOutside})
    fmt::print("{:8.4f}", oracle.rmse(p));
  fmt::print("\nerrors within 1 and 1.96 sigma:");
  for (std::size_t p = 0; p < kPlaces; ++p)
    fmt::print("  {:.1f} {:.1f} %", 100.0 * table.coverage.one[p] / table.coverage.nodes[p],
               100.0 * table.coverage.two[p] / table.coverage.nodes[p]);
  fmt::print("\n");
  time_large();
  time_beside_gdalwarp();
}
