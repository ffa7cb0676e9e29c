// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/merge_files.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/random.hpp"
#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan {
namespace {

constexpr std::uint64_t kShareSeed = 0x6d657267;

CloudFields common(const CloudFields& a, const CloudFields& b) {
  CloudFields f;
  f.intensity = a.intensity && b.intensity;
  f.colour = a.colour && b.colour;
  f.normals = a.normals && b.normals;
  f.grid = a.grid && b.grid;
  f.time = a.time && b.time;
  f.returns = a.returns && b.returns;
  f.scan_angle = a.scan_angle && b.scan_angle;
  f.statistics = a.statistics && b.statistics;
  f.flags = a.flags || b.flags;  // says what points lack, and belongs to no layout
  return f;
}

/// An even share of each scan's points that fits together, whatever the scans turn out to be.
class Shares {
 public:
  explicit Shares(std::uint64_t most) : most_(most) {}
  void begin(const ScanStation& station) {
    Cloud& c = clouds_.emplace_back();
    c.stations = {station};
    c.station_mm = detail::scanner_of(station);
    c.stations.front().position_mm = c.station_mm;
    kept_.push_back(1.0);
    met_.push_back(0);
  }
  void add(const ScanStation& station, const PointBatch& b) {
    Cloud& c = clouds_.back();
    double& kept = kept_.back();
    const std::uint64_t seed = kShareSeed + clouds_.size();
    for (std::size_t i = 0; i < b.size(); ++i) {
      if (!b.has_position(i)) continue;
      const std::uint64_t number = met_.back()++;
      if (kept < 1.0 && random_uniform(seed, number) >= kept) continue;
      c.points_mm.push_back(station.model_from_station.point(b.points_mm[i]));
      if (!b.colours.empty()) c.colours.push_back(b.colours[i]);
      if (++all_ > most_) halve();
    }
  }
  [[nodiscard]] std::uint64_t met(std::size_t scan) const { return met_[scan]; }
  [[nodiscard]] std::size_t size() const { return clouds_.size(); }
  /// Scans with points; what is left is empty.
  [[nodiscard]] std::vector<Cloud> take() {
    std::vector<Cloud> some;
    for (Cloud& c : clouds_) {
      if (c.points_mm.empty()) continue;
      c.stations.front().points = c.points_mm.size();
      some.push_back(std::move(c));
    }
    clouds_.clear();
    return some;
  }

 private:
  void halve() {
    const auto most = std::max_element(
        clouds_.begin(), clouds_.end(),
        [](const Cloud& a, const Cloud& b) { return a.points_mm.size() < b.points_mm.size(); });
    const auto scan = static_cast<std::size_t>(most - clouds_.begin());
    Cloud& c = *most;
    const bool colours = !c.colours.empty();
    std::size_t to = 0;
    for (std::size_t i = 0; i < c.points_mm.size(); ++i) {
      if (random_bits(kShareSeed + all_, i) % 2 != 0) continue;
      c.points_mm[to] = c.points_mm[i];
      if (colours) c.colours[to] = c.colours[i];
      ++to;
    }
    all_ -= c.points_mm.size() - to;
    c.points_mm.resize(to);
    if (colours) c.colours.resize(to);
    kept_[scan] *= 0.5;
  }

  std::uint64_t most_, all_ = 0;
  std::vector<Cloud> clouds_;
  std::vector<double> kept_;  ///< share of each scan's points
  std::vector<std::uint64_t> met_;
};

/// Stations with points, by their number in the file.
Result<void> read_shares(const std::filesystem::path& path, std::size_t file, Shares& shares,
                         MergedFiles& merged, const RunContext& run) {
  MAQUETTE_TRY(const auto reader, open_cloud(path));
  PointBatch batch;
  std::vector<std::size_t> stations;
  bool first = merged.scans.empty();  // those before have said what is common
  const std::size_t before = shares.size(), scans_before = merged.scans.size();
  while (true) {
    if (run.stopped()) return fail(kCancelled, fmt::format("{}: cancelled", path.string()));
    MAQUETTE_TRY(const bool more, reader->next(batch));
    if (!more) break;
    const ScanStation& station = reader->stations()[batch.station];
    if (stations.empty() || stations.back() != batch.station) {
      stations.push_back(batch.station);
      shares.begin(station);
    }
    if (batch.size() == 0) continue;
    merged.fields = first ? station.fields : common(merged.fields, station.fields);
    first = false;
    shares.add(station, batch);
  }
  for (std::size_t k = 0; k < stations.size(); ++k)
    if (const std::uint64_t points = shares.met(before + k); points > 0)
      merged.scans.push_back({reader->stations()[stations[k]].name, file, stations[k], points, 0});
  const std::size_t n = merged.scans.size() - scans_before;
  if (n == 0) return fail(kCloudEmpty, fmt::format("{}: the cloud has no points", path.string()));
  for (std::size_t k = 0; k < n; ++k) {
    FileScan& s = merged.scans[scans_before + k];
    const std::string name = path.filename().string();
    s.name = n == 1
                 ? name
                 : fmt::format("{}:{}", name, s.name.empty() ? fmt::format("{}", k + 1) : s.name);
  }
  return {};
}

class MergedReader final : public CloudReader {
 public:
  explicit MergedReader(const MergedFiles& merged) : merged_(merged) {}
  [[nodiscard]] std::string_view format() const override { return "merged"; }
  [[nodiscard]] const std::vector<ScanStation>& stations() const override { return stations_; }
  [[nodiscard]] const std::vector<CloudImage>& images() const override { return images_; }
  [[nodiscard]] double progress() const override {
    const double now = reader_ ? reader_->progress() : 0.0;
    return (static_cast<double>(file_) + now) / static_cast<double>(merged_.files.size());
  }
  [[nodiscard]] Result<bool> next(PointBatch& batch) override {
    while (file_ < merged_.files.size()) {
      if (!reader_) {
        MAQUETTE_TRY(reader_, open_cloud(merged_.files[file_]));
      }
      MAQUETTE_TRY(const bool more, reader_->next(batch));
      if (!more) {
        reader_.reset();
        ++file_;
        continue;
      }
      if (take(batch)) return true;
    }
    return false;
  }

 private:
  /// False: nothing of it belongs to the cloud.
  bool take(PointBatch& b) {
    const auto scan = static_cast<std::size_t>(
        std::find_if(merged_.scans.begin(), merged_.scans.end(),
                     [&](const FileScan& s) { return s.file == file_ && s.station == b.station; }) -
        merged_.scans.begin());
    if (scan == merged_.scans.size()) return false;
    const bool begins = scan >= stations_.size();
    if (begins) stations_.push_back(station_of(scan, reader_->stations()[b.station]));
    keep_positions(b);
    drop_fields(b);
    balance(b, merged_.merge.scans[scan].gain);
    b.station = scan;
    b.begins_station = begins;
    return begins || b.size() > 0;
  }
  [[nodiscard]] ScanStation station_of(std::size_t scan, ScanStation s) const {
    const RigidTransform& moved = merged_.merge.scans[scan].correction;
    s.model_from_station = moved * s.model_from_station;
    if (s.position_mm) s.position_mm = moved.point(*s.position_mm);
    s.points = merged_.scans[scan].points;
    s.fields = merged_.fields;
    return s;
  }
  void keep_positions(PointBatch& b) {
    if (b.flags.empty()) return;
    wanted_.clear();
    for (std::size_t i = 0; i < b.size(); ++i)
      if (b.has_position(i)) wanted_.push_back(static_cast<std::uint32_t>(i));
    if (wanted_.size() < b.size()) detail::pick(b, wanted_);
  }
  void drop_fields(PointBatch& b) const {
    const CloudFields& f = merged_.fields;
    if (!f.intensity) b.intensity.clear();
    if (!f.colour) b.colours.clear();
    if (!f.normals) b.normals.clear();
    if (!f.grid) b.grid.clear();
    if (!f.time) b.time_s.clear();
    if (!f.returns) b.return_index.clear(), b.return_count.clear();
    if (!f.scan_angle) b.scan_angle_rad.clear();
    if (!f.statistics) b.counts.clear(), b.spread_mm.clear();
  }
  static void balance(PointBatch& b, const std::array<double, 3>& gain) {
    if (gain == std::array{1.0, 1.0, 1.0}) return;
    const auto times = [](std::uint16_t v, double g) {
      return static_cast<std::uint16_t>(std::fmin(65'535.0, std::round(v * g)));
    };
    for (Colour& c : b.colours)
      c = {times(c.red, gain[0]), times(c.green, gain[1]), times(c.blue, gain[2])};
  }

  const MergedFiles& merged_;
  std::vector<ScanStation> stations_;
  std::vector<CloudImage> images_;
  std::unique_ptr<CloudReader> reader_;
  std::size_t file_ = 0;
  std::vector<std::uint32_t> wanted_;
};

}  // namespace

Result<MergedFiles> merge_files(std::span<const std::filesystem::path> files,
                                const MergeOptions& options, const RunContext& run,
                                std::uint64_t most_points) {
  MergedFiles merged;
  merged.files.assign(files.begin(), files.end());
  Shares shares(most_points);
  for (std::size_t k = 0; k < files.size(); ++k)
    MAQUETTE_TRY_VOID(read_shares(files[k], k, shares, merged, run));
  const std::vector<Cloud> scans = shares.take();
  for (std::size_t k = 0; k < scans.size(); ++k) merged.scans[k].used = scans[k].points_mm.size();
  MAQUETTE_TRY(merged.merge, merge_scans(scans, options, run));
  return merged;
}

Result<std::unique_ptr<CloudReader>> open_merged(const MergedFiles& merged) {
  return std::make_unique<MergedReader>(merged);
}

Result<void> copy_cloud(const OpenCloud& from, const std::filesystem::path& to,
                        const RunContext& run) {
  MAQUETTE_TRY(const auto reader, from());
  MAQUETTE_TRY(const auto writer, create_cloud(to));
  PointBatch batch;
  while (true) {
    if (run.stopped()) return fail(kCancelled, fmt::format("{}: cancelled", to.string()));
    run.progress(reader->progress());
    MAQUETTE_TRY(const bool more, reader->next(batch));
    if (!more) return writer->finish();
    if (batch.begins_station)
      MAQUETTE_TRY_VOID(writer->begin_station(reader->stations()[batch.station]));
    MAQUETTE_TRY_VOID(writer->write(batch));
  }
}

}  // namespace maquette::scan
