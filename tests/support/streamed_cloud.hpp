// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file streamed_cloud.hpp
/// Clouds of several stations with every field, for the tests of the file formats.

#include <filesystem>
#include <string>
#include <vector>

#include "core/random.hpp"
#include "scan/cloud_stream.hpp"
#include "scan/detail/cloud_parts.hpp"

namespace maquette::testing_support {

/// All batches of a station in one.
struct StreamedCloud {
  std::string format;
  std::vector<scan::ScanStation> stations;
  std::vector<scan::PointBatch> points;  ///< one per station
  std::vector<scan::CloudImage> images;
};

inline void append_batch(scan::PointBatch& all, const scan::PointBatch& more) {
  const auto add = [](auto& to, const auto& from) {
    to.insert(to.end(), from.begin(), from.end());
  };
  if (all.flags.empty() && !more.flags.empty()) all.flags.resize(all.size());
  if (!all.flags.empty() && more.flags.empty()) all.flags.resize(all.size() + more.size());
  add(all.points_mm, more.points_mm);
  add(all.intensity, more.intensity);
  add(all.colours, more.colours);
  add(all.normals, more.normals);
  add(all.grid, more.grid);
  add(all.time_s, more.time_s);
  add(all.return_index, more.return_index);
  add(all.return_count, more.return_count);
  add(all.scan_angle_rad, more.scan_angle_rad);
  add(all.flags, more.flags);
}

inline Result<StreamedCloud> stream_in(scan::CloudReader& reader) {
  StreamedCloud cloud;
  scan::PointBatch batch;
  std::size_t last = 0;
  while (true) {
    MAQUETTE_TRY(const bool more, reader.next(batch));
    if (!more) break;
    if (batch.begins_station != (cloud.points.size() == batch.station) || batch.station < last)
      return fail({"TEST"}, "begins_station is set wrongly, or stations go backwards");
    last = batch.station;
    cloud.points.resize(std::max(cloud.points.size(), batch.station + 1));
    append_batch(cloud.points[batch.station], batch);
  }
  cloud.format = reader.format();
  cloud.stations = reader.stations();
  cloud.images = reader.images();
  cloud.points.resize(cloud.stations.size());
  return cloud;
}

inline Result<StreamedCloud> stream_in(const std::filesystem::path& path,
                                       const scan::CloudReadOptions& options = {}) {
  MAQUETTE_TRY(const auto reader, scan::open_cloud(path, options));
  return stream_in(*reader);
}

/// From memory; the name's extension says the format.
inline Result<StreamedCloud> stream_bytes(const std::string& name, std::string_view bytes,
                                          const scan::CloudReadOptions& options = {}) {
  MAQUETTE_TRY(const auto reader,
               scan::detail::open_source(scan::detail::ByteSource(bytes, name), options));
  return stream_in(*reader);
}

/// Points [from, from + n) of a batch.
inline scan::PointBatch slice(const scan::PointBatch& all, std::size_t from, std::size_t n) {
  const auto part = [&](const auto& array) {
    auto copy = array;
    if (copy.empty()) return copy;
    copy.assign(array.begin() + static_cast<std::ptrdiff_t>(from),
                array.begin() + static_cast<std::ptrdiff_t>(from + n));
    return copy;
  };
  scan::PointBatch some;
  some.points_mm = part(all.points_mm);
  some.intensity = part(all.intensity);
  some.colours = part(all.colours);
  some.normals = part(all.normals);
  some.grid = part(all.grid);
  some.time_s = part(all.time_s);
  some.return_index = part(all.return_index);
  some.return_count = part(all.return_count);
  some.scan_angle_rad = part(all.scan_angle_rad);
  some.flags = part(all.flags);
  return some;
}

/// In batches of uneven size.
inline Result<void> stream_out(const StreamedCloud& cloud, const std::filesystem::path& path,
                               const scan::CloudWriteOptions& options = {}) {
  MAQUETTE_TRY(const auto writer, scan::create_cloud(path, options));
  for (std::size_t s = 0; s < cloud.stations.size(); ++s) {
    MAQUETTE_TRY_VOID(writer->begin_station(cloud.stations[s]));
    const scan::PointBatch& all = cloud.points[s];
    for (std::size_t from = 0, n = 1; from < all.size(); from += n, n = 2 * n + 1) {
      n = std::min(n, all.size() - from);
      MAQUETTE_TRY_VOID(writer->write(slice(all, from, n)));
    }
  }
  return writer->finish();
}

/// A grid of `rows` x `columns` points, column by column, on a bumpy wall some two metres
/// from the station, with what `fields` ask for. Colours have `colour_bits`.
inline scan::PointBatch sample_points(const scan::CloudFields& fields, std::uint32_t rows,
                                      std::uint32_t columns, std::uint64_t seed,
                                      int colour_bits = 8) {
  scan::PointBatch b;
  std::uint64_t draw = 0;
  const auto uniform = [&] { return random_uniform(seed, draw++); };
  const auto colour = [&] {
    return static_cast<std::uint16_t>(colour_bits > 8 ? random_bits(seed, draw++) % 65536
                                                      : random_bits(seed, draw++) % 256 * 257);
  };
  for (std::uint32_t c = 0; c < columns; ++c)
    for (std::uint32_t r = 0; r < rows; ++r) {
      b.points_mm.push_back({2000.0 + 30.0 * uniform(), 7.0 * c + uniform(), 7.0 * r + uniform()});
      if (fields.intensity) b.intensity.push_back(static_cast<float>(uniform()));
      if (fields.colour) b.colours.push_back({colour(), colour(), colour()});
      if (fields.normals)
        b.normals.push_back(normalized(Vec3{1.0, uniform() - 0.5, uniform() - 0.5}));
      if (fields.grid) b.grid.push_back({r, c});
      if (fields.time) b.time_s.push_back(1e-4 * static_cast<double>(draw) + 1e-9 * uniform());
      if (fields.returns) {
        const auto count = static_cast<std::uint8_t>(1 + random_bits(seed, draw++) % 5);
        b.return_count.push_back(count);
        b.return_index.push_back(static_cast<std::uint8_t>(random_bits(seed, draw++) % count));
      }
      if (fields.scan_angle) b.scan_angle_rad.push_back(static_cast<float>(uniform() - 0.5));
    }
  return b;
}

inline scan::CloudFields all_fields() {
  scan::CloudFields f;
  f.intensity = f.colour = f.normals = f.grid = f.time = f.returns = f.scan_angle = true;
  return f;
}

inline scan::ScanStation sample_station(const scan::CloudFields& fields, std::uint32_t rows,
                                        std::uint32_t columns, std::uint64_t seed) {
  scan::ScanStation s;
  s.name = "station " + std::to_string(seed);
  s.model_from_station = {
      rotation_about(normalized(Vec3{1.0, 2.0, -0.5 * static_cast<double>(seed)}),
                     0.3 + 0.7 * static_cast<double>(seed)),
      {100.5 * static_cast<double>(seed), -1500.25, 1250.0}};
  s.position_mm = s.model_from_station.translation_mm;
  s.rows = rows;
  s.columns = columns;
  s.points = std::uint64_t{rows} * columns;
  s.fields = fields;
  return s;
}

}  // namespace maquette::testing_support
