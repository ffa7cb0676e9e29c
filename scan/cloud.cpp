// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/cloud.hpp"

#include <cmath>

#include <fmt/format.h>

#include "core/check.hpp"
#include "core/random.hpp"
#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan {
namespace {

constexpr std::size_t kBatch = 65'536;
constexpr std::uint64_t kShareSeed = 0x53686172;

/// Of n points, and some more than chance may add.
std::size_t kept_of(std::uint64_t n, double share) {
  if (share >= 1.0) return n;
  const double mean = share * static_cast<double>(n);
  return static_cast<std::size_t>(mean + 5.0 * std::sqrt(mean));
}

void make_room(Cloud& cloud, std::size_t n, const CloudFields& fields) {
  if (n <= cloud.points_mm.capacity()) return;
  n = std::max(n, cloud.points_mm.capacity() + cloud.points_mm.capacity() / 2);
  cloud.points_mm.reserve(n);
  if (fields.intensity) cloud.intensity.reserve(n);
  if (fields.colour) cloud.colours.reserve(n);
  if (fields.normals) cloud.normals.reserve(n);
  if (fields.grid) cloud.grid.reserve(n);
}

/// Points [from, from + n) of the cloud, seen from a station.
void fill(const Cloud& cloud, std::size_t from, std::size_t n,
          const std::optional<RigidTransform>& station_from_model, PointBatch& batch) {
  const auto part = [&](const auto& all, auto& some) {
    if (all.empty()) return;
    some.assign(all.begin() + static_cast<std::ptrdiff_t>(from),
                all.begin() + static_cast<std::ptrdiff_t>(from + n));
  };
  batch.clear();
  part(cloud.points_mm, batch.points_mm);
  part(cloud.intensity, batch.intensity);
  part(cloud.normals, batch.normals);
  part(cloud.colours, batch.colours);
  part(cloud.grid, batch.grid);
  part(cloud.counts, batch.counts);
  part(cloud.spread_mm, batch.spread_mm);
  if (!station_from_model) return;
  for (Vec3& p : batch.points_mm) p = station_from_model->point(p);
  for (Vec3& v : batch.normals) v = station_from_model->direction(v);
}

CloudFields fields_of(const Cloud& cloud) {
  CloudFields f;
  f.intensity = !cloud.intensity.empty();
  f.colour = !cloud.colours.empty();
  f.normals = !cloud.normals.empty();
  f.grid = !cloud.grid.empty();
  f.statistics = !cloud.counts.empty();
  return f;
}

class MemoryReader final : public CloudReader {
 public:
  explicit MemoryReader(const Cloud& cloud) : cloud_(cloud), stations_(cloud.stations) {
    if (stations_.empty()) stations_.emplace_back().points = cloud.points_mm.size();
    if (stations_.size() == 1 && cloud.station_mm) stations_[0].position_mm = cloud.station_mm;
    for (ScanStation& s : stations_) s.fields = fields_of(cloud);
  }
  [[nodiscard]] std::string_view format() const override { return "memory"; }
  [[nodiscard]] const std::vector<ScanStation>& stations() const override { return stations_; }
  [[nodiscard]] const std::vector<CloudImage>& images() const override { return images_; }
  [[nodiscard]] double progress() const override {
    return static_cast<double>(from_) /
           static_cast<double>(std::max<std::size_t>(1, cloud_.points_mm.size()));
  }
  [[nodiscard]] Result<bool> next(PointBatch& batch) override {
    while (station_ < stations_.size() && begun_ && left_ == 0) {
      ++station_;
      begun_ = false;
    }
    if (station_ == stations_.size()) return false;
    const ScanStation& s = stations_[station_];
    if (!begun_) left_ = s.points;
    const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(left_, kBatch));
    std::optional<RigidTransform> back;
    if (s.model_from_station != RigidTransform{}) back = s.model_from_station.inverse();
    fill(cloud_, from_, n, back, batch);
    batch.station = station_;
    batch.begins_station = !begun_;
    begun_ = true;
    from_ += n;
    left_ -= n;
    return true;
  }

 private:
  const Cloud& cloud_;
  std::vector<ScanStation> stations_;
  std::vector<CloudImage> images_;
  std::size_t station_ = 0, from_ = 0;
  std::uint64_t left_ = 0;
  bool begun_ = false;
};

}  // namespace

namespace detail {

std::unique_ptr<CloudReader> reader_of(const Cloud& cloud) {
  return std::make_unique<MemoryReader>(cloud);
}

Result<Cloud> read_all(CloudReader& reader, const std::string& file, const RunContext& run,
                       double share) {
  Cloud cloud;
  std::uint64_t record = 0;
  PointBatch batch;
  // A part counts only if every station with points has it.
  std::optional<CloudFields> common;
  std::vector<std::uint64_t> kept;
  while (true) {
    if (run.stopped()) return fail(kCancelled, fmt::format("{}: reading was cancelled", file));
    run.progress(reader.progress());
    MAQUETTE_TRY(const bool more, reader.next(batch));
    if (!more) break;
    const ScanStation& station = reader.stations()[batch.station];
    kept.resize(reader.stations().size());
    if (batch.size() == 0) continue;
    const CloudFields& f = station.fields;
    if (!common) common = f;
    common->intensity &= f.intensity;
    common->colour &= f.colour;
    common->normals &= f.normals;
    common->grid &= f.grid;
    common->statistics &= f.statistics;
    // The reader has compared the count with the file's size.
    if (batch.begins_station)
      make_room(cloud, cloud.points_mm.size() + kept_of(station.points, share), *common);
    const RigidTransform& pose = station.model_from_station;
    const bool moves = pose != RigidTransform{};
    for (std::size_t i = 0; i < batch.size(); ++i) {
      const std::uint64_t number = record++;
      if (!batch.has_position(i)) continue;
      if (share < 1.0 && random_uniform(kShareSeed, number) >= share) {
        ++cloud.passed_over;
        continue;
      }
      cloud.points_mm.push_back(moves ? pose.point(batch.points_mm[i]) : batch.points_mm[i]);
      ++kept[batch.station];
      if (common->intensity) cloud.intensity.push_back(batch.intensity[i]);
      if (common->colour) cloud.colours.push_back(batch.colours[i]);
      if (common->normals)
        cloud.normals.push_back(moves ? pose.direction(batch.normals[i]) : batch.normals[i]);
      if (common->grid) cloud.grid.push_back(batch.grid[i]);
      if (!common->statistics) continue;
      cloud.counts.push_back(batch.counts[i]);
      cloud.spread_mm.push_back(batch.spread_mm[i]);
    }
  }
  const std::size_t n = cloud.points_mm.size();
  if (n == 0) return fail(kCloudEmpty, fmt::format("{}: the cloud has no points", file));
  if (cloud.intensity.size() != n) cloud.intensity.clear();
  if (cloud.colours.size() != n) cloud.colours.clear();
  if (cloud.normals.size() != n) cloud.normals.clear();
  if (cloud.grid.size() != n) cloud.grid.clear();
  if (cloud.counts.size() != n) {
    cloud.counts.clear();
    cloud.spread_mm.clear();
  }
  cloud.stations = reader.stations();
  kept.resize(cloud.stations.size());
  for (std::size_t s = 0; s < kept.size(); ++s) {
    ScanStation& station = cloud.stations[s];
    station.points = kept[s];
    station.fields = fields_of(cloud);
  }
  if (cloud.stations.size() == 1) cloud.station_mm = cloud.stations.front().position_mm;
  return cloud;
}

Result<void> write_all(const Cloud& cloud, const RigidTransform* transform, CloudWriter& writer) {
  const std::size_t n = cloud.points_mm.size();
  const auto whole = [n](std::size_t size) { return size == 0 || size == n; };
  MAQUETTE_CHECK(whole(cloud.intensity.size()) && whole(cloud.normals.size()) &&
                     whole(cloud.colours.size()) && whole(cloud.grid.size()) &&
                     whole(cloud.counts.size()) && cloud.counts.size() == cloud.spread_mm.size(),
                 "{} points need {} intensities, normals, colours, places, counts or none", n, n);
  std::vector<ScanStation> stations = cloud.stations;
  std::uint64_t listed = 0;
  for (const ScanStation& s : stations) listed += s.points;
  MAQUETTE_CHECK(stations.empty() || listed == n, "stations of {} points, {} points", listed, n);
  if (stations.empty()) {
    stations.emplace_back().points = n;
    if (cloud.station_mm && writer.keeps_poses())
      stations.front().model_from_station.translation_mm = *cloud.station_mm;
  }
  if (stations.size() == 1 && cloud.station_mm) stations.front().position_mm = cloud.station_mm;
  PointBatch batch;
  std::size_t from = 0;
  for (std::size_t s = 0; s < stations.size(); ++s) {
    ScanStation& station = stations[s];
    std::optional<RigidTransform> station_from_model;
    if (writer.keeps_poses()) {
      if (station.model_from_station != RigidTransform{})
        station_from_model = station.model_from_station.inverse();
    } else {
      station.model_from_station = transform != nullptr ? *transform : RigidTransform{};
      if (transform != nullptr && station.position_mm)
        station.position_mm = transform->point(*station.position_mm);
    }
    station.fields = fields_of(cloud);
    MAQUETTE_TRY_VOID(writer.begin_station(station));
    for (const std::size_t end = from + station.points; from < end;) {
      const std::size_t count = std::min(kBatch, end - from);
      fill(cloud, from, count, station_from_model, batch);
      batch.station = s;
      MAQUETTE_TRY_VOID(writer.write(batch));
      from += count;
    }
  }
  return writer.finish();
}

}  // namespace detail

namespace {

/// Of those that the reader says it has; of formats that say it station by station, those met.
Result<std::uint64_t> points_in(const std::filesystem::path& path, const CloudReader& reader,
                                std::uint64_t most_points, const RunContext& run) {
  constexpr std::uint64_t kLeastBytes = 6;  // "1 2 3\n"
  std::error_code ec;
  const std::uintmax_t bytes = std::filesystem::file_size(path, ec);
  if (!ec && bytes / kLeastBytes < most_points) return 0;
  std::uint64_t said = 0;
  for (const ScanStation& s : reader.stations()) said += s.points;
  if (reader.format() == "E57" || reader.format() == "LAS" || said > most_points) return said;
  MAQUETTE_TRY(const CloudInfo info, inspect_cloud(path, {}, run));
  return info.points;
}

}  // namespace

Result<Cloud> read_cloud(const std::filesystem::path& path, const RunContext& run,
                         std::uint64_t most_points) {
  MAQUETTE_TRY(const auto reader, open_cloud(path));
  double share = 1.0;
  if (most_points < UINT64_MAX) {
    MAQUETTE_TRY(const std::uint64_t points, points_in(path, *reader, most_points, run));
    if (points > most_points)
      share = static_cast<double>(most_points) / static_cast<double>(points);
  }
  return detail::read_all(*reader, path.string(), run, share);
}

Result<void> write_cloud(const Cloud& cloud, const std::filesystem::path& path) {
  MAQUETTE_TRY(const auto writer, create_cloud(path));
  return detail::write_all(cloud, nullptr, *writer);
}

}  // namespace maquette::scan
