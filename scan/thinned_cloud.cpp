// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/thinned_cloud.hpp"

#include <algorithm>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::scan::detail {
namespace {

constexpr std::size_t kBatch = 65'536;

ScanStation thinned_station(const std::vector<ScanStation>& from, bool intensity, bool colour) {
  ScanStation s;
  s.name = "thinned";
  if (from.size() == 1) {
    s = from.front();
    s.model_from_station = {};
    s.rows = s.columns = 0;
    s.points = 0;
  }
  s.fields = {};
  s.fields.normals = s.fields.statistics = true;
  s.fields.intensity = intensity;
  s.fields.colour = colour;
  for (const ScanStation& f : from) s.colour_bits = std::max(s.colour_bits, f.colour_bits);
  return s;
}

}  // namespace

Result<std::uint64_t> write_thinned(const VoxelStatistics& voxels, const ThinnedSlices& slices,
                                    const std::vector<ScanStation>& from, bool intensity,
                                    bool colour, const StationSink& out) {
  const ScanStation station = thinned_station(from, intensity, colour);
  PointBatch b;
  std::vector<std::size_t> chosen;
  std::uint64_t written = 0;
  for (std::size_t next = 0; next < voxels.size();) {
    chosen.clear();
    for (; next < voxels.size() && chosen.size() < kBatch; ++next) {
      const std::int64_t slice = VoxelGrid::x_of(voxels.key(next));
      if (slice >= slices.begin && slice < slices.end) chosen.push_back(next);
    }
    const std::size_t n = chosen.size();
    if (n == 0) break;
    b.clear();
    b.begins_station = slices.begin_station && written == 0;
    b.points_mm.resize(n);
    b.normals.resize(n);
    b.counts.resize(n);
    b.spread_mm.resize(n);
    if (intensity) b.intensity.resize(n);
    if (colour) b.colours.resize(n);
    oneapi::tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
      const VoxelSummary s = voxels.summary(chosen[i]);
      b.points_mm[i] = s.mean_mm;
      b.normals[i] = s.normal;
      b.counts[i] = s.points;
      b.spread_mm[i] = static_cast<float>(s.spread_mm);
      if (intensity) b.intensity[i] = static_cast<float>(s.intensity);
      if (colour) b.colours[i] = s.colour;
    });
    MAQUETTE_TRY_VOID(out(station, b));
    written += n;
  }
  return written;
}

}  // namespace maquette::scan::detail
