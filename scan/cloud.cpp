// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/cloud.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

#include "core/check.hpp"
#include "core/files.hpp"
#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan {
namespace detail {

std::size_t channel_by_name(std::string_view name) {
  std::string key;
  for (const char c : name)
    if (c != '"' && c != ' ' && c != '\t' && c != '\r')
      key += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  if (key.size() > 3 && key.ends_with("_mm")) key.resize(key.size() - 3);
  if (key.starts_with("scalar_")) key.erase(0, 7);
  if (key == "x") return kX;
  if (key == "y") return kY;
  if (key == "z") return kZ;
  if (key == "intensity") return kIntensity;
  if (key == "nx") return kNx;
  if (key == "ny") return kNy;
  if (key == "nz") return kNz;
  return kIgnored;
}

bool CloudBuilder::declare(std::size_t channel) {
  if (present_[channel]) return false;
  return present_[channel] = true;
}

void CloudBuilder::reserve(std::size_t points) {
  cloud_.points_mm.reserve(points);
  if (has(kIntensity)) cloud_.intensity.reserve(points);
  if (has_normals()) cloud_.normals.reserve(points);
}

Result<void> CloudBuilder::add(const std::array<double, kChannels + 1>& row) {
  const auto usable = [](double v) { return std::abs(v) <= kLargestCoordinateMm; };  // false: NaN
  if (!usable(row[kX]) || !usable(row[kY]) || !usable(row[kZ]))
    return fail(kCloudNotFinite,
                fmt::format("{}: point {} (counting from 0) is ({}, {}, {}); coordinates must be "
                            "finite millimetres, remove such points before",
                            file_, size(), row[kX], row[kY], row[kZ]));
  if (has_normals()) {
    const Vec3 n{row[kNx], row[kNy], row[kNz]};
    const double length = norm(n);
    if (!std::isfinite(length))
      return fail(kCloudNotFinite,
                  fmt::format("{}: normal of point {} (counting from 0) is ({}, {}, {})", file_,
                              size(), n.x, n.y, n.z));
    cloud_.normals.push_back(length > 0.0 ? (1.0 / length) * n : Vec3{});
  }
  cloud_.points_mm.push_back({row[kX], row[kY], row[kZ]});
  if (has(kIntensity)) cloud_.intensity.push_back(static_cast<float>(row[kIntensity]));
  return {};
}

Result<Cloud> CloudBuilder::finish() && {
  if (cloud_.points_mm.empty())
    return fail(kCloudEmpty, fmt::format("{}: the cloud has no points", file_));
  return std::move(cloud_);
}

std::string_view next_token(std::string_view& text, std::string_view separators) {
  const std::size_t first = text.find_first_not_of(separators);
  if (first == std::string_view::npos) {
    text = {};
    return {};
  }
  const std::size_t end = std::min(text.find_first_of(separators, first), text.size());
  const std::string_view token = text.substr(first, end - first);
  text.remove_prefix(end);
  return token;
}

std::string_view next_line(std::string_view data, std::size_t& at) {
  const std::size_t end = std::min(data.find('\n', at), data.size());
  std::string_view line = data.substr(at, end - at);
  at = std::min(end + 1, data.size());
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

Result<std::optional<Vec3>> station_comment(std::string_view comment, std::string_view where) {
  if (next_token(comment) != "scanner_position_mm") return std::optional<Vec3>{};
  std::array<double, 3> v{};
  for (double& value : v) {
    const auto number = parse_number<double>(next_token(comment));
    if (!number || !(std::abs(*number) <= kLargestCoordinateMm))
      return fail(kCloudFormat,
                  fmt::format("{}: scanner_position_mm needs three finite numbers", where));
    value = *number;
  }
  return std::optional<Vec3>{Vec3{v[0], v[1], v[2]}};
}

std::string shown(std::string_view token) {
  std::string text;
  for (const char c : token.substr(0, 40)) text += c >= ' ' && c <= '~' ? c : '?';
  return token.size() > 40 ? text + "..." : text;
}

Result<void> write_ply_cloud(const Cloud& cloud, const RigidTransform* transform,
                             const ExtraScalar* extra, const std::filesystem::path& path) {
  static_assert(std::endian::native == std::endian::little, "written as the machine holds it");
  const std::size_t n = cloud.points_mm.size();
  const bool intensity = !cloud.intensity.empty(), normals = !cloud.normals.empty();
  MAQUETTE_CHECK(!intensity || cloud.intensity.size() == n, "{} intensities, {} points",
                 cloud.intensity.size(), n);
  MAQUETTE_CHECK(!normals || cloud.normals.size() == n, "{} normals, {} points",
                 cloud.normals.size(), n);
  MAQUETTE_CHECK(extra == nullptr || extra->values->size() == n, "{} scalars, {} points",
                 extra->values->size(), n);
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));

  std::string header = "ply\nformat binary_little_endian 1.0\ncomment maquette cloud, unit mm\n";
  if (cloud.station_mm) {
    const Vec3 s = transform != nullptr ? transform->point(*cloud.station_mm) : *cloud.station_mm;
    header += fmt::format("comment scanner_position_mm {} {} {}\n", s.x, s.y, s.z);
  }
  header += fmt::format("element vertex {}\n", n);
  header += "property double x\nproperty double y\nproperty double z\n";
  if (intensity) header += "property float intensity\n";
  if (normals) header += "property double nx\nproperty double ny\nproperty double nz\n";
  if (extra != nullptr) header += fmt::format("property float {}\n", extra->name);
  file.write(header + "end_header\n");

  std::string rows;
  const auto put = [&rows](const auto& value) {
    rows.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3 p = transform != nullptr ? transform->point(cloud.points_mm[i]) : cloud.points_mm[i];
    put(p);
    if (intensity) put(cloud.intensity[i]);
    if (normals)
      put(transform != nullptr ? transform->direction(cloud.normals[i]) : cloud.normals[i]);
    if (extra != nullptr) put((*extra->values)[i]);
    if (rows.size() > (std::size_t{1} << 20)) {
      file.write(rows);
      rows.clear();
    }
  }
  file.write(rows);
  return file.commit();
}

}  // namespace detail

Result<Cloud> read_cloud(const std::filesystem::path& path, const RunContext& run) {
  std::string extension = path.extension().string();
  for (char& c : extension)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  const bool ply = extension == ".ply", csv = extension == ".csv";
  const bool xyz = extension == ".xyz" || extension == ".txt" || extension == ".asc";
  MAQUETTE_TRY(const std::string data, read_file(path));
  if (ply) return detail::read_ply_cloud(data, path.string(), run);
  if (csv || xyz) return detail::read_text_cloud(data, path.string(), csv, run);
  return fail(kCloudFormat,
              fmt::format("{}: clouds are read from .ply, .xyz, .txt, .asc and .csv; convert the "
                          "file or rename it",
                          path.string()));
}

Result<void> write_cloud(const Cloud& cloud, const std::filesystem::path& path) {
  return detail::write_ply_cloud(cloud, nullptr, nullptr, path);
}

}  // namespace maquette::scan
