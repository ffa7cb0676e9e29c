// SPDX-License-Identifier: GPL-3.0-or-later

// Fusion of ten synthetic truths beside the oracle, gdalwarp's mosaic, a feather and a two-band
// blend: errors as ratios to the oracle's, the step at the border, the power of waves just inside
// it, and how often errors lie within the stated uncertainty. Then the time of a large one.

#include <array>
#include <chrono>

#include <fmt/format.h>

#include "support/fusion_peers.hpp"

namespace {

using namespace maquette;
using namespace maquette::testing_support;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

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
  const auto start = Clock::now();
  Blend blend(waves, std::move(base), knowledge_of(waves, 40.0, 1.0), {}, true);
  blend.add(layer, knowledge_of(waves, 2.0, 0.1));
  fmt::print("\n{} x {} nodes, two sources: {:.1f} s\n", n, n, seconds_since(start));
}

}  // namespace

int main() {
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
}
