// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/clean.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/range_image.hpp"
#include "scan/detail/thinned_cloud.hpp"
#include "scan/detail/voxel_statistics.hpp"

namespace maquette::scan {
namespace {

using detail::RangeImage;
using detail::VoxelCounts;
using detail::VoxelSlices;
using detail::VoxelStatistics;

enum class Verdict : std::uint8_t { kept, mixed, isolated, off_part, no_position };

/// Takes each batch with the index of its first point.
using Take = std::function<Result<void>(const ScanStation&, PointBatch&, std::uint64_t)>;

class Cleaner {
 public:
  Cleaner(OpenCloud open, const CleanOptions& options, const RunContext& run)
      : open_(std::move(open)),
        o_(options),
        run_(run),
        needs_normals_(options.normals && options.thin_mm == 0.0),
        needs_voxels_(options.least_neighbours > 0 || needs_normals_) {}

  Result<void> judge();
  /// The points that stay; with normals where they were asked for.
  Result<void> write(const detail::StationSink& out);
  /// The mixed ones, once judged.
  Result<void> write_mixed(const detail::StationSink& out);
  [[nodiscard]] const CleanFigures& figures() const { return figures_; }

 private:
  struct View {
    std::optional<Vec3> scanner_mm;  ///< station's frame
    std::unique_ptr<RangeImage> image;
  };
  /// @param from, to  progress
  [[nodiscard]] Result<void> each_batch(double from, double to, const Take& take);
  View& view_of(const PointBatch& batch, const ScanStation& station);
  [[nodiscard]] Result<void> survey();
  [[nodiscard]] Result<void> fill_images();
  [[nodiscard]] Result<void> gather();
  /// What the points that stay have in common in each voxel, for one run of slices after the other.
  using Use =
      std::function<Result<void>(const VoxelStatistics&, std::int64_t begin, std::int64_t end)>;
  [[nodiscard]] Result<void> each_run(double from, double to, const Use& use);
  [[nodiscard]] Result<void> add_run(double from, double to, std::int64_t begin, std::int64_t end,
                                     VoxelStatistics& voxels);
  [[nodiscard]] Result<void> write_points(const detail::StationSink& out);
  [[nodiscard]] Result<void> write_thinned(const detail::StationSink& out);
  /// Is the point one that stays? Once the isolated ones are known.
  [[nodiscard]] bool stays(std::uint64_t point, Vec3 p_mm);

  OpenCloud open_;
  const CleanOptions& o_;
  const RunContext& run_;
  CleanFigures figures_;
  std::vector<View> views_;
  std::vector<ScanStation> stations_;  // their points counted
  detail::PointSample sample_;         // model frame
  Box3 bounds_;
  std::vector<Verdict> verdicts_;
  std::unique_ptr<VoxelCounts> counts_;  // where isolated points are sought
  detail::VoxelGrid grid_;               // of normals or of thinning
  std::unique_ptr<VoxelSlices> slices_;  // of it, where there may be more than go at once
  bool needs_normals_, needs_voxels_;
};

Result<void> Cleaner::each_batch(double from, double to, const Take& take) {
  MAQUETTE_TRY(const auto reader, open_());
  PointBatch batch;
  std::uint64_t first = 0;
  while (true) {
    if (run_.stopped()) return fail(kCancelled, "cleaning was cancelled");
    run_.progress(from + (to - from) * reader->progress());
    MAQUETTE_TRY(const bool more, reader->next(batch));
    if (!more) return {};
    const std::size_t n = batch.size();
    MAQUETTE_TRY_VOID(take(reader->stations()[batch.station], batch, first));
    first += n;
  }
}

Cleaner::View& Cleaner::view_of(const PointBatch& batch, const ScanStation& station) {
  if (batch.station >= views_.size()) views_.resize(batch.station + 1);
  View& v = views_[batch.station];
  if (v.scanner_mm) return v;
  if (const auto scanner = detail::scanner_of(station))
    v.scanner_mm = station.model_from_station.inverse().point(*scanner);
  return v;
}

Result<void> Cleaner::survey() {
  MAQUETTE_TRY_VOID(each_batch(
      0.0, 0.25, [&](const ScanStation& station, PointBatch& b, std::uint64_t) -> Result<void> {
        View& view = view_of(b, station);
        if (b.begins_station) {
          stations_.push_back(station);
          stations_.back().points = 0;
        }
        stations_.back().points += b.size();
        if (b.begins_station && b.size() > 0) {
          if (!view.scanner_mm)
            ++figures_.not_judged;
          else if (o_.mixed)
            view.image = std::make_unique<RangeImage>();
        }
        for (std::size_t i = 0; i < b.size(); ++i) {
          if (!b.has_position(i)) {
            ++figures_.without_position;
            continue;
          }
          ++figures_.points;
          const Vec3 p = station.model_from_station.point(b.points_mm[i]);
          bounds_.add(p);
          if (needs_voxels_ && o_.voxel_mm == 0.0) sample_.add(p);
          if (!view.image) continue;
          const Vec3 d = b.points_mm[i] - *view.scanner_mm;
          if (dot(d, d) > 0.0) view.image->survey(d, b.grid.empty() ? nullptr : &b.grid[i]);
        }
        return {};
      }));
  if (figures_.points == 0) return fail(kCloudEmpty, "there are no points to clean");
  figures_.voxel_mm = o_.voxel_mm;
  if (needs_voxels_ && o_.voxel_mm == 0.0) figures_.voxel_mm = sample_.voxel_for(8.0);
  sample_ = {};
  return {};
}

Result<void> Cleaner::fill_images() {
  for (View& v : views_)
    if (v.image) v.image->build();
  MAQUETTE_TRY_VOID(
      each_batch(0.25, 0.5, [&](const ScanStation&, PointBatch& b, std::uint64_t) -> Result<void> {
        const View& view = views_[b.station];
        if (!view.image) return {};
        for (std::size_t i = 0; i < b.size(); ++i) {
          const Vec3 d = b.points_mm[i] - *view.scanner_mm;
          if (b.has_position(i) && dot(d, d) > 0.0)
            view.image->put(d, b.grid.empty() ? nullptr : &b.grid[i]);
        }
        return {};
      }));
  for (View& v : views_) {
    if (!v.image) continue;
    v.image->finish();
    figures_.range_noise_mm = std::fmax(figures_.range_noise_mm, v.image->noise_mm());
  }
  return {};
}

Result<void> Cleaner::gather() {
  const detail::BeamWidth beam{0.5 * o_.beam_diameter_mm, 1e-3 * o_.beam_divergence_mrad};
  const double jump = o_.least_jump_mm > 0.0 ? o_.least_jump_mm : 2.0 * o_.beam_diameter_mm;
  detail::VoxelGrid grid;
  if (needs_voxels_ &&
      (!(figures_.voxel_mm > 0.0) || !detail::make_voxel_grid(bounds_, figures_.voxel_mm, grid)))
    return fail(kCleanOptions,
                fmt::format("voxels of {} mm do not fit a cloud of {} mm; they must be larger than "
                            "a two-millionth of it",
                            figures_.voxel_mm, norm(bounds_.max - bounds_.min)));
  if (o_.least_neighbours > 0) counts_ = std::make_unique<VoxelCounts>(grid);
  if (needs_normals_) grid_ = grid;
  if (o_.thin_mm > 0.0 && !detail::make_voxel_grid(bounds_, o_.thin_mm, grid_))
    return fail(kCleanOptions, fmt::format("voxels of {} mm are too small to thin {} mm",
                                           o_.thin_mm, norm(bounds_.max - bounds_.min)));
  if ((o_.thin_mm > 0.0 || needs_normals_) && figures_.points > o_.voxels_at_once)
    slices_ = std::make_unique<VoxelSlices>(grid_);
  verdicts_.reserve(figures_.points + figures_.without_position);
  return each_batch(
      0.5, 0.75,
      [&](const ScanStation& station, PointBatch& b, std::uint64_t first) -> Result<void> {
        const View& view = views_[b.station];
        verdicts_.resize(first + b.size(), Verdict::kept);
        oneapi::tbb::parallel_for(std::size_t{0}, b.size(), [&](std::size_t i) {
          Verdict& verdict = verdicts_[first + i];
          if (!b.has_position(i)) {
            verdict = Verdict::no_position;
            return;
          }
          if (o_.part_mm) {
            const Vec3 p = station.model_from_station.point(b.points_mm[i]);
            const Box3& box = *o_.part_mm;
            if (!(p.x >= box.min.x && p.x <= box.max.x && p.y >= box.min.y && p.y <= box.max.y &&
                  p.z >= box.min.z && p.z <= box.max.z)) {
              verdict = Verdict::off_part;
              return;
            }
          }
          if (!view.image) return;
          const Vec3 d = b.points_mm[i] - *view.scanner_mm;
          if (dot(d, d) > 0.0 &&
              view.image->mixed(d, b.grid.empty() ? nullptr : &b.grid[i], beam, jump))
            verdict = Verdict::mixed;
        });
        for (std::size_t i = 0; i < b.size(); ++i) {
          const Verdict verdict = verdicts_[first + i];
          figures_.off_part += verdict == Verdict::off_part ? 1 : 0;
          figures_.mixed += verdict == Verdict::mixed ? 1 : 0;
          if (verdict != Verdict::kept || !(counts_ || slices_)) continue;
          const Vec3 p = station.model_from_station.point(b.points_mm[i]);
          if (counts_) counts_->add(p);
          if (slices_) slices_->add(p);
        }
        return {};
      });
}

Result<void> Cleaner::judge() {
  MAQUETTE_TRY_VOID(survey());
  if (o_.mixed) MAQUETTE_TRY_VOID(fill_images());
  MAQUETTE_TRY_VOID(gather());
  for (View& v : views_) v.image.reset();
  if (counts_) counts_->mark_lonely(o_.least_neighbours);
  return {};
}

bool Cleaner::stays(std::uint64_t point, Vec3 p) {
  if (verdicts_[point] != Verdict::kept) return false;
  if (!counts_ || !counts_->lonely(p)) return true;
  verdicts_[point] = Verdict::isolated;
  ++figures_.isolated;
  return false;
}

Result<void> Cleaner::add_run(double from, double to, std::int64_t begin, std::int64_t end,
                              VoxelStatistics& voxels) {
  return each_batch(
      from, to,
      [&](const ScanStation& station, PointBatch& b, std::uint64_t first) -> Result<void> {
        const View& view = views_[b.station];
        for (std::size_t i = 0; i < b.size(); ++i) {
          const Vec3 p = station.model_from_station.point(b.points_mm[i]);
          if (!stays(first + i, p)) continue;
          // Normals ask the neighbours, too.
          const std::int64_t slice = detail::VoxelGrid::x_of(grid_.key_of(p));
          if (slice < begin - 1 || slice > end) continue;
          Vec3 towards;
          if (view.scanner_mm)
            towards =
                station.model_from_station.direction(normalized(*view.scanner_mm - b.points_mm[i]));
          voxels.add(p, towards, b.intensity.empty() ? 0.0F : b.intensity[i],
                     b.colours.empty() ? Colour{} : b.colours[i]);
        }
        return {};
      });
}

Result<void> Cleaner::each_run(double from, double to, const Use& use) {
  const std::vector<std::int64_t> ends =
      slices_ ? slices_->ends(o_.voxels_at_once) : std::vector{detail::VoxelGrid::kSide};
  slices_.reset();
  std::int64_t begin = 0;
  const double share = (to - from) / static_cast<double>(ends.size());
  for (std::size_t k = 0; k < ends.size(); ++k) {
    VoxelStatistics voxels(grid_);
    const double at = from + share * static_cast<double>(k);
    MAQUETTE_TRY_VOID(add_run(at, at + share, begin, ends[k], voxels));
    MAQUETTE_TRY_VOID(use(voxels, begin, ends[k]));
    begin = ends[k];
  }
  return {};
}

Result<void> Cleaner::write_points(const detail::StationSink& out) {
  detail::VoxelNormals normals(grid_);
  if (needs_normals_)
    MAQUETTE_TRY_VOID(each_run(
        0.75, 0.9, [&](const VoxelStatistics& voxels, std::int64_t begin, std::int64_t end) {
          normals.put(voxels, begin, end);
          return Result<void>{};
        }));
  std::vector<std::uint32_t> wanted;
  return each_batch(
      needs_normals_ ? 0.9 : 0.75, 1.0,
      [&](const ScanStation& station, PointBatch& b, std::uint64_t first) -> Result<void> {
        const RigidTransform& pose = station.model_from_station;
        wanted.clear();
        for (std::size_t i = 0; i < b.size(); ++i)
          if (stays(first + i, pose.point(b.points_mm[i])))
            wanted.push_back(static_cast<std::uint32_t>(i));
        figures_.written += wanted.size();
        detail::pick(b, wanted);
        ScanStation kept = station;
        kept.points = 0;
        if (needs_normals_) {
          kept.fields.normals = true;
          b.normals.resize(b.size());
          const RigidTransform back = pose.inverse();
          oneapi::tbb::parallel_for(std::size_t{0}, b.size(), [&](std::size_t i) {
            b.normals[i] = back.direction(normals.at(pose.point(b.points_mm[i])));
          });
        }
        return out(kept, b);
      });
}

Result<void> Cleaner::write_thinned(const detail::StationSink& out) {
  bool intensity = true, colour = true;
  for (std::size_t k = 0; k < stations_.size(); ++k) {
    intensity &= stations_[k].fields.intensity || stations_[k].points == 0;
    colour &= stations_[k].fields.colour || stations_[k].points == 0;
  }
  return each_run(
      0.75, 1.0,
      [&](const VoxelStatistics& voxels, std::int64_t begin, std::int64_t end) -> Result<void> {
        const detail::ThinnedSlices slices{begin, end, figures_.written == 0};
        MAQUETTE_TRY(const std::uint64_t written,
                     detail::write_thinned(voxels, slices, stations_, intensity, colour, out));
        figures_.written += written;
        return {};
      });
}

Result<void> Cleaner::write(const detail::StationSink& out) {
  MAQUETTE_TRY_VOID(o_.thin_mm > 0.0 ? write_thinned(out) : write_points(out));
  figures_.kept = figures_.points - figures_.mixed - figures_.isolated - figures_.off_part;
  if (figures_.kept > 0) return {};
  return fail(kCloudEmpty,
              fmt::format("of {} points none is left: {} mixed, {} isolated, {} off the part; "
                          "look at the part's box and its unit",
                          figures_.points, figures_.mixed, figures_.isolated, figures_.off_part));
}

Result<void> Cleaner::write_mixed(const detail::StationSink& out) {
  std::vector<std::uint32_t> wanted;
  return each_batch(0.75, 0.75,
                    [&](const ScanStation& station, PointBatch& b, std::uint64_t first) {
                      wanted.clear();
                      for (std::size_t i = 0; i < b.size(); ++i)
                        if (verdicts_[first + i] == Verdict::mixed)
                          wanted.push_back(static_cast<std::uint32_t>(i));
                      detail::pick(b, wanted);
                      ScanStation kept = station;
                      kept.points = 0;
                      return out(kept, b);
                    });
}

Result<void> check(const CleanOptions& o) {
  struct Limit {
    const char* what;
    double value, least, most;
  };
  const Limit limits[] = {{"beam_diameter_mm", o.beam_diameter_mm, 0.0, 1e3},
                          {"beam_divergence_mrad", o.beam_divergence_mrad, 0.0, 100.0},
                          {"least_jump_mm", o.least_jump_mm, 0.0, 1e6},
                          {"voxel_mm", o.voxel_mm, 0.0, 1e6},
                          {"thin_mm", o.thin_mm, 0.0, 1e6},
                          {"least_neighbours", static_cast<double>(o.least_neighbours), 0.0,
                           static_cast<double>(VoxelCounts::kMost)}};
  for (const Limit& l : limits)
    if (!(l.value >= l.least && l.value <= l.most))
      return fail(kCleanOptions, fmt::format("cleaning: {} must be between {} and {} but is {}",
                                             l.what, l.least, l.most, l.value));
  return {};
}

}  // namespace

Result<CleanFigures> clean_cloud(const std::filesystem::path& from, const std::filesystem::path& to,
                                 const CleanOptions& options, const RunContext& run) {
  return clean_cloud([&] { return open_cloud(from); }, to, options, run);
}

Result<CleanFigures> clean_cloud(const OpenCloud& from, const std::filesystem::path& to,
                                 const CleanOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(check(options));
  Cleaner cleaner(from, options, run);
  MAQUETTE_TRY_VOID(cleaner.judge());
  MAQUETTE_TRY(const auto writer, create_cloud(to));
  MAQUETTE_TRY_VOID(cleaner.write(detail::into(*writer)));
  MAQUETTE_TRY_VOID(writer->finish());
  run.progress(1.0);
  return cleaner.figures();
}

Result<CleanFigures> clean_cloud(Cloud& cloud, const CleanOptions& options, const RunContext& run,
                                 Cloud* mixed) {
  MAQUETTE_TRY_VOID(check(options));
  Cleaner cleaner([&] { return detail::reader_of(cloud); }, options, run);
  MAQUETTE_TRY_VOID(cleaner.judge());
  if (mixed != nullptr) {
    *mixed = {};
    MAQUETTE_TRY_VOID(cleaner.write_mixed(detail::into(*mixed)));
    mixed->station_mm = cloud.station_mm;
  }
  Cloud kept;
  MAQUETTE_TRY_VOID(cleaner.write(detail::into(kept)));
  kept.station_mm = cloud.station_mm;
  kept.passed_over = cloud.passed_over;
  cloud = std::move(kept);
  run.progress(1.0);
  return cleaner.figures();
}

}  // namespace maquette::scan
