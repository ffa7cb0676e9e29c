// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/cloud_parts.hpp"

#include <cfloat>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "core/check.hpp"

namespace maquette::scan {

void PointBatch::clear() {
  begins_station = false;
  points_mm.clear();
  intensity.clear();
  colours.clear();
  normals.clear();
  grid.clear();
  time_s.clear();
  return_index.clear();
  return_count.clear();
  scan_angle_rad.clear();
  counts.clear();
  spread_mm.clear();
  flags.clear();
}

namespace detail {
namespace {

constexpr std::array<std::pair<std::string_view, Channel>, 38> kNames{{
    {"x", kX},
    {"y", kY},
    {"z", kZ},
    {"intensity", kIntensity},
    {"nx", kNx},
    {"ny", kNy},
    {"nz", kNz},
    {"normal_x", kNx},
    {"normal_y", kNy},
    {"normal_z", kNz},
    {"red", kRed},
    {"green", kGreen},
    {"blue", kBlue},
    {"r", kRed},
    {"g", kGreen},
    {"b", kBlue},
    {"diffuse_red", kRed},
    {"diffuse_green", kGreen},
    {"diffuse_blue", kBlue},
    {"row", kRow},
    {"column", kColumn},
    {"rowindex", kRow},
    {"columnindex", kColumn},
    {"row_index", kRow},
    {"column_index", kColumn},
    {"time", kTime},
    {"time_s", kTime},
    {"timestamp", kTime},
    {"gpstime", kTime},
    {"gps_time", kTime},
    {"return_index", kReturnIndex},
    {"returnindex", kReturnIndex},
    {"return_count", kReturnCount},
    {"returncount", kReturnCount},
    {"scan_angle_rad", kScanAngle},
    {"scan_angle", kScanAngle},
    {"point_count", kCount},
    {"spread", kSpread},
}};

std::uint16_t colour_value(double v) {
  return v >= 65535.0 ? 65535 : v > 0.0 ? static_cast<std::uint16_t>(v + 0.5) : 0;  // NaN: 0
}

std::uint8_t byte_value(double v) {
  return v >= 255.0 ? 255 : v > 0.0 ? static_cast<std::uint8_t>(v) : 0;
}

std::uint32_t count_value(double v) {
  return v >= 4294967295.0 ? 4294967295U : v > 0.0 ? static_cast<std::uint32_t>(v) : 0;
}

/// Keeps the elements of `all` whose index is listed.
template <class T>
void pick(std::vector<T>& all, const std::vector<std::uint32_t>& wanted) {
  if (all.empty()) return;
  std::size_t to = 0;
  for (const std::uint32_t i : wanted) all[to++] = all[i];
  all.resize(to);
}

float float_value(double v) {  // beyond float's range a conversion would be undefined
  return static_cast<float>(std::isfinite(v) ? std::clamp<double>(v, -FLT_MAX, FLT_MAX) : v);
}

}  // namespace

std::size_t channel_by_name(std::string_view name) {
  std::string key;
  for (const char c : name)
    if (c != '"' && c != ' ' && c != '\t' && c != '\r')
      key += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  if (key.size() > 3 && key.ends_with("_mm")) key.resize(key.size() - 3);
  if (key.starts_with("scalar_")) key.erase(0, 7);
  for (const auto& [known, channel] : kNames)
    if (key == known) return channel;
  return kIgnored;
}

bool RecordPlan::declare(std::size_t channel) {
  if (present[channel]) return false;
  return present[channel] = true;
}

CloudFields RecordPlan::fields() const {
  CloudFields f;
  f.intensity = has(kIntensity);
  f.colour = has_colour();
  f.normals = has_normals();
  f.grid = has_grid();
  f.time = has(kTime);
  f.returns = has(kReturnIndex);
  f.scan_angle = has(kScanAngle);
  f.statistics = has(kCount) && has(kSpread);
  return f;
}

Result<void> append(const RecordPlan& plan, const Row& row, std::uint64_t index,
                    const std::string& file, PointBatch& batch, std::uint8_t flags,
                    bool with_flags) {
  const double u = plan.unit_mm;
  Vec3 p{u * row[kX], u * row[kY], u * row[kZ]};
  if ((flags & kNoPosition) != 0) {
    p = {};
  } else if ((flags & kDirectionOnly) != 0) {
    const double length = norm(p);
    p = length > 0.0 && std::isfinite(length) ? (1.0 / length) * p : Vec3{};
  } else {
    const auto usable = [](double v) { return std::abs(v) <= kLargestCoordinateMm; };  // NaN: no
    if (!usable(p.x) || !usable(p.y) || !usable(p.z))
      return fail(kCloudNotFinite,
                  fmt::format("{}: point {} (counting from 0) is ({}, {}, {}) mm; coordinates "
                              "must be finite and below {} mm, remove such points before",
                              file, index, p.x, p.y, p.z, kLargestCoordinateMm));
  }
  if (plan.has_normals()) {
    const Vec3 n{row[kNx], row[kNy], row[kNz]};
    const double length = norm(n);
    if (!std::isfinite(length))
      return fail(kCloudNotFinite, fmt::format("{}: normal of point {} (counting from 0) is "
                                               "({}, {}, {})",
                                               file, index, n.x, n.y, n.z));
    batch.normals.push_back(length > 0.0 ? (1.0 / length) * n : Vec3{});
  }
  if (plan.has_grid()) {
    const auto inside = [](double v, std::uint32_t count) {
      return v >= 0.0 && v <= (count == 0 ? 4294967295.0 : count - 1.0) && v == std::floor(v);
    };
    if (!inside(row[kRow], plan.rows) || !inside(row[kColumn], plan.columns))
      return fail(kCloudFormat,
                  fmt::format("{}: point {} (counting from 0) has row {} and column {}, but its "
                              "grid has {} rows and {} columns",
                              file, index, row[kRow], row[kColumn], plan.rows, plan.columns));
    batch.grid.push_back(
        {static_cast<std::uint32_t>(row[kRow]), static_cast<std::uint32_t>(row[kColumn])});
  }
  batch.points_mm.push_back(p);
  if (plan.has(kIntensity)) batch.intensity.push_back(float_value(row[kIntensity]));
  if (plan.has_colour()) {
    const auto full = [&](double v) {
      return colour_value(plan.colour_scale * (v - plan.colour_offset));
    };
    batch.colours.push_back({full(row[kRed]), full(row[kGreen]), full(row[kBlue])});
  }
  if (plan.has(kTime)) batch.time_s.push_back(row[kTime]);
  if (plan.has(kReturnIndex)) {
    batch.return_index.push_back(byte_value(row[kReturnIndex]));
    batch.return_count.push_back(byte_value(row[kReturnCount]));
  }
  if (plan.has(kScanAngle)) batch.scan_angle_rad.push_back(float_value(row[kScanAngle]));
  if (plan.has(kCount) && plan.has(kSpread)) {
    batch.counts.push_back(count_value(row[kCount]));
    batch.spread_mm.push_back(float_value(u * row[kSpread]));
  }
  if (with_flags) batch.flags.push_back(flags);
  return {};
}

void pick(PointBatch& b, const std::vector<std::uint32_t>& wanted) {
  pick(b.points_mm, wanted);
  pick(b.intensity, wanted);
  pick(b.colours, wanted);
  pick(b.normals, wanted);
  pick(b.grid, wanted);
  pick(b.time_s, wanted);
  pick(b.return_index, wanted);
  pick(b.return_count, wanted);
  pick(b.scan_angle_rad, wanted);
  pick(b.flags, wanted);
  pick(b.counts, wanted);
  pick(b.spread_mm, wanted);
}

std::optional<Vec3> scanner_of(const ScanStation& station) {
  if (station.position_mm) return station.position_mm;
  if (station.model_from_station == RigidTransform{}) return std::nullopt;
  return station.model_from_station.translation_mm;
}

void BasicReader::start(PointBatch& batch, std::size_t station, bool begins) const {
  batch.clear();
  batch.station = station;
  batch.begins_station = begins;
}

std::string_view next_token(std::string_view& text, std::string_view separators) {
  // By hand: this is where reading text spends its time, and the standard's searches take a
  // call per character.
  const auto separates = [separators](char c) {
    for (const char s : separators)
      if (c == s) return true;
    return false;
  };
  std::size_t first = 0;
  while (first < text.size() && separates(text[first])) ++first;
  std::size_t end = first;
  while (end < text.size() && !separates(text[end])) ++end;
  const std::string_view token = text.substr(first, end - first);
  text.remove_prefix(end);
  return token;
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

std::string scanner_position_text(Vec3 p) {
  return fmt::format("scanner_position_mm {} {} {}", p.x, p.y, p.z);
}

std::string shown(std::string_view token) {
  std::string text;
  for (const char c : token.substr(0, 40)) text += c >= ' ' && c <= '~' ? c : '?';
  return token.size() > 40 ? text + "..." : text;
}

std::optional<Quaternion> rotation_from_axes(Vec3 x, Vec3 y, Vec3 z) {
  constexpr double kTolerance = 1e-4;  // files round to four decimals at worst
  const auto off = [](double value, double wanted) {
    return !(std::abs(value - wanted) < kTolerance);
  };
  if (off(dot(x, x), 1.0) || off(dot(y, y), 1.0) || off(dot(z, z), 1.0) || off(dot(x, y), 0.0) ||
      off(dot(y, z), 0.0) || off(dot(x, cross(y, z)), 1.0))
    return std::nullopt;
  // The largest of the four squares first, so that none is divided by a small number
  // (Shepperd, J. Guidance and Control 1, 1978, doi:10.2514/3.55767b).
  const double trace = x.x + y.y + z.z;
  Quaternion q;
  if (trace >= std::max({x.x, y.y, z.z}))
    q = {1.0 + trace, y.z - z.y, z.x - x.z, x.y - y.x};
  else if (x.x >= y.y && x.x >= z.z)
    q = {y.z - z.y, 1.0 + x.x - y.y - z.z, y.x + x.y, z.x + x.z};
  else if (y.y >= z.z)
    q = {z.x - x.z, y.x + x.y, 1.0 - x.x + y.y - z.z, z.y + y.z};
  else
    q = {x.y - y.x, z.x + x.z, z.y + y.z, 1.0 - x.x - y.y + z.z};
  return normalized(q);
}

// ---- writers of one frame --------------------------------------------------

void check_batch(const CloudFields& f, const PointBatch& b) {
  const std::size_t n = b.size();
  const auto fits = [n](bool field, std::size_t size) { return size == (field ? n : 0); };
  MAQUETTE_CHECK(
      fits(f.intensity, b.intensity.size()) && fits(f.colour, b.colours.size()) &&
          fits(f.normals, b.normals.size()) && fits(f.grid, b.grid.size()) &&
          fits(f.time, b.time_s.size()) && fits(f.returns, b.return_index.size()) &&
          fits(f.returns, b.return_count.size()) && fits(f.scan_angle, b.scan_angle_rad.size()) &&
          fits(f.statistics, b.counts.size()) && fits(f.statistics, b.spread_mm.size()) &&
          (b.flags.empty() || (f.flags && b.flags.size() == n)),
      "a batch of {} points must have the arrays of its station's fields", n);
}

std::string padded_count(std::uint64_t count) {
  return fmt::format("{:<20}", count);
}

Result<void> FlatWriter::begin_station(const ScanStation& station) {
  if (++stations_ == 1) {
    first_ = station;
    MAQUETTE_TRY(const std::string text, header(false));
    header_bytes_ = text.size();
    file_.write(text);
  } else {
    CloudFields& a = first_.fields;
    const CloudFields& b = station.fields;
    CloudFields same = b;
    same.flags = a.flags = a.flags || b.flags;  // not part of the layout
    if (same != a)
      return fail(kCloudCannotHold,
                  fmt::format("{}: station {} has other fields (intensity, colour, ...) than the "
                              "first, and this format holds one layout; write E57 or PTX",
                              name_, stations_ - 1));
  }
  model_from_station_ = station.model_from_station;
  moves_ = model_from_station_ != RigidTransform{};
  return {};
}

Result<void> FlatWriter::write(const PointBatch& batch) {
  MAQUETTE_CHECK(stations_ > 0, "write before begin_station");
  check_batch(first_.fields, batch);
  const bool normals = !batch.normals.empty();
  for (std::size_t i = 0; i < batch.size(); ++i) {
    if (!batch.has_position(i)) continue;
    Vec3 p = batch.points_mm[i], n = normals ? batch.normals[i] : Vec3{};
    if (moves_) {
      p = model_from_station_.point(p);
      n = model_from_station_.direction(n);
    }
    MAQUETTE_TRY_VOID(point(batch, i, p, n));
    ++count_;
    if (rows_.size() > (std::size_t{1} << 20)) flush_rows();
  }
  return {};
}

void FlatWriter::flush_rows() {
  file_.write(rows_);
  rows_.clear();
}

Result<void> FlatWriter::finish() {
  if (stations_ == 0) MAQUETTE_TRY_VOID(begin_station({}));
  MAQUETTE_TRY_VOID(end());
  flush_rows();
  MAQUETTE_TRY(const std::string text, header(true));
  MAQUETTE_CHECK(text.size() == header_bytes_, "header of {} bytes became {}", header_bytes_,
                 text.size());
  file_.rewrite(0, text);
  return file_.commit();
}

}  // namespace detail
}  // namespace maquette::scan
