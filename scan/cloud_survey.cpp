// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/cloud_survey.hpp"

#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/voxel_statistics.hpp"

namespace maquette::scan::detail {
namespace {

template <class Take>
Result<void> each_batch(const OpenCloud& open, const RunContext& run, const Take& take) {
  MAQUETTE_TRY(const auto reader, open());
  PointBatch batch;
  while (true) {
    if (run.stopped()) return fail(kCancelled, "reading was cancelled");
    run.progress(reader->progress());
    MAQUETTE_TRY(const bool more, reader->next(batch));
    if (!more) return {};
    if (batch.size() > 0) take(reader->stations()[batch.station], batch);
  }
}

}  // namespace

Result<CloudSurvey> survey_cloud(const OpenCloud& open, const RunContext& run) {
  CloudSurvey survey;
  MAQUETTE_TRY_VOID(each_batch(open, run, [&](const ScanStation& station, const PointBatch& b) {
    survey.coloured &= !b.colours.empty();
    for (std::size_t i = 0; i < b.size(); ++i) {
      if (!b.has_position(i)) continue;
      const Vec3 p = station.model_from_station.point(b.points_mm[i]);
      survey.bounds_mm.add(p);
      survey.sample.add(p);
    }
  }));
  return survey;
}

Result<std::vector<Surfel>> gather_surfels(const OpenCloud& open, const CloudSurvey& survey,
                                           const VoxelGrid& grid, const RunContext& run) {
  const Box3& box = survey.bounds_mm;
  const Vec3 above =
      0.5 * (box.min + box.max) + Vec3{0.0, 0.0, 1e3 * (1.0 + norm(box.max - box.min))};
  VoxelStatistics voxels(grid);
  MAQUETTE_TRY_VOID(each_batch(open, run, [&](const ScanStation& station, const PointBatch& b) {
    const Vec3 from = scanner_of(station).value_or(above);
    for (std::size_t i = 0; i < b.size(); ++i) {
      if (!b.has_position(i)) continue;
      const Vec3 p = station.model_from_station.point(b.points_mm[i]), way = from - p;
      voxels.add(p, (1.0 / std::fmax(norm(way), 1e-9)) * way, 0.0F,
                 b.colours.empty() ? Colour{} : b.colours[i]);
    }
  }));
  voxels.sort();
  std::vector<Surfel> surfels(voxels.size());
  oneapi::tbb::parallel_for(std::size_t{0}, surfels.size(), [&](std::size_t i) {
    const VoxelSummary v = voxels.summary(i);
    Surfel& s = surfels[i];
    s.key = voxels.key(i);
    s.centre_mm = v.mean_mm;
    s.normal = v.normal;
    s.rough_mm = v.rough_mm;
    s.points = v.points;
    s.red = static_cast<float>(v.colour.red);
    s.green = static_cast<float>(v.colour.green);
    s.blue = static_cast<float>(v.colour.blue);
  });
  return surfels;
}

}  // namespace maquette::scan::detail
