// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/cloud_stream.hpp"

#include <cmath>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan {
namespace {

std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return extension;
}

bool is_text(std::string_view extension) {
  return extension == ".xyz" || extension == ".txt" || extension == ".asc";
}

tl::unexpected<Error> unknown_extension(const std::filesystem::path& path) {
  return fail(kCloudFormat,
              fmt::format("{}: clouds are .e57, .ptx, .pts, .pcd, .las, .ply, .xyz, .txt, .asc or "
                          ".csv; convert the file or rename it",
                          path.string()));
}

Result<void> check_unit(const std::filesystem::path& path, const std::optional<double>& unit_mm) {
  if (unit_mm && !(*unit_mm > 0.0 && std::isfinite(*unit_mm)))
    return fail(kCloudFormat, fmt::format("{}: the unit is {} mm; it must be a positive length",
                                          path.string(), *unit_mm));
  return {};
}

}  // namespace

namespace detail {

ReaderResult open_source(ByteSource source, const CloudReadOptions& options) {
  const std::filesystem::path path = source.name();
  MAQUETTE_TRY_VOID(check_unit(path, options.unit_mm));
  const std::string extension = extension_of(path);
  if (extension == ".e57") return open_e57(std::move(source), options);
  if (extension == ".las") return open_las(std::move(source), options);
  if (extension == ".pcd") return open_pcd(std::move(source), options);
  if (extension == ".pts") return open_pts(std::move(source), options);
  if (extension == ".ptx") return open_ptx(std::move(source), options);
  if (extension == ".ply") return open_ply(std::move(source), options);
  if (extension == ".csv" || is_text(extension))
    return open_text(std::move(source), options, extension == ".csv");
  return unknown_extension(path);
}

}  // namespace detail

Result<std::unique_ptr<CloudReader>> open_cloud(const std::filesystem::path& path,
                                                const CloudReadOptions& options) {
  MAQUETTE_TRY(auto source, detail::ByteSource::open(path));
  return detail::open_source(std::move(source), options);
}

Result<std::unique_ptr<CloudWriter>> create_cloud(const std::filesystem::path& path,
                                                  const CloudWriteOptions& options) {
  MAQUETTE_TRY_VOID(check_unit(path, options.unit_mm));
  const std::string extension = extension_of(path);
  if (extension == ".e57") return detail::create_e57(path, options);
  if (extension == ".las") return detail::create_las(path, options);
  if (extension == ".pcd") return detail::create_pcd(path, options);
  if (extension == ".pts") return detail::create_pts(path, options);
  if (extension == ".ptx") return detail::create_ptx(path, options);
  if (extension == ".ply") return detail::create_ply(path, options);
  if (extension == ".csv" || is_text(extension))
    return detail::create_text(path, options, extension == ".csv");
  return unknown_extension(path);
}

Result<CloudInfo> inspect_cloud(const std::filesystem::path& path, const CloudReadOptions& options,
                                const RunContext& run) {
  MAQUETTE_TRY(const auto reader, open_cloud(path, options));
  CloudInfo info;
  std::vector<std::uint64_t> records;
  PointBatch batch;
  while (true) {
    if (run.stopped())
      return fail(kCancelled, fmt::format("{}: reading was cancelled", path.string()));
    run.progress(reader->progress());
    MAQUETTE_TRY(const bool more, reader->next(batch));
    if (!more) break;
    records.resize(reader->stations().size());
    records[batch.station] += batch.size();
    const RigidTransform& pose = reader->stations()[batch.station].model_from_station;
    for (std::size_t i = 0; i < batch.size(); ++i) {
      if (!batch.has_position(i)) {
        ++info.without_position;
        continue;
      }
      ++info.points;
      info.bounds_mm.add(pose.point(batch.points_mm[i]));
    }
  }
  info.format = reader->format();
  info.stations = reader->stations();
  for (std::size_t k = 0; k < records.size(); ++k) info.stations[k].points = records[k];
  info.images = reader->images();
  return info;
}

}  // namespace maquette::scan
