// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/reflectance/brdf_table.hpp"

#include <charconv>
#include <map>
#include <numbers>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "core/files.hpp"

namespace maquette::camera {
namespace {

/// Place of a value in ascending angles: the node below and the share of the one above.
struct Place {
  std::size_t below = 0;
  double share = 0.0;

  Place(const std::vector<double>& nodes, double value) {
    if (nodes.size() < 2 || value <= nodes.front()) return;
    const auto above = std::upper_bound(nodes.begin(), nodes.end(), value);
    if (above == nodes.end()) {
      below = nodes.size() - 2;
      share = 1.0;
      return;
    }
    below = static_cast<std::size_t>(above - nodes.begin()) - 1;
    share = (value - nodes[below]) / (nodes[below + 1] - nodes[below]);
  }
};

Bands look_up(const BrdfTable::Grid3& g, double incidence, double emission, double azimuth) {
  const Place i(g.incidence_deg, incidence), e(g.emission_deg, emission), a(g.azimuth_deg, azimuth);
  Bands sum{};
  for (int corner = 0; corner < 8; ++corner) {
    const bool ui = (corner & 1) != 0, ue = (corner & 2) != 0, ua = (corner & 4) != 0;
    const double weight = (ui ? i.share : 1.0 - i.share) * (ue ? e.share : 1.0 - e.share) *
                          (ua ? a.share : 1.0 - a.share);
    if (weight == 0.0) continue;
    const Bands& f =
        g.brdf[((i.below + ui) * g.emission_deg.size() + e.below + ue) * g.azimuth_deg.size() +
               a.below + ua];
    for (std::size_t k = 0; k < 3; ++k) sum[k] += weight * f[k];
  }
  return sum;
}

/// Comma-separated numbers of a line; false if one is none.
bool numbers_of(std::string_view line, std::vector<double>& values) {
  values.clear();
  while (true) {
    const auto comma = line.find(',');
    std::string_view word = line.substr(0, comma);
    while (!word.empty() && (word.front() == ' ' || word.front() == '\t')) word.remove_prefix(1);
    while (!word.empty() && (word.back() == ' ' || word.back() == '\r')) word.remove_suffix(1);
    double value = 0.0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc{} || end != word.data() + word.size() || !std::isfinite(value))
      return false;
    values.push_back(value);
    if (comma == std::string_view::npos) return true;
    line.remove_prefix(comma + 1);
  }
}

std::vector<double> ascending(const std::set<double>& values) {
  return {values.begin(), values.end()};
}

using Rows = std::map<std::array<double, 3>, Bands>;

Result<Rows> read_rows(const std::filesystem::path& path, std::string_view text) {
  Rows rows;
  std::vector<double> v;
  std::size_t columns = 0;
  for (int number = 1; !text.empty(); ++number) {
    const auto end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    const auto wrong = [&](const std::string& what) {
      return fail(kBrdfFile, fmt::format("{}: line {}: {}", path.string(), number, what));
    };
    if (number == 1) {
      columns = line.starts_with("incidence_deg,emission_deg,azimuth_deg,brdf_r,brdf_g,brdf_b") ? 6
                : line.starts_with("incidence_deg,emission_deg,azimuth_deg,brdf")               ? 4
                                                                                                : 0;
      if (columns == 0)
        return wrong(
            "the head must be incidence_deg,emission_deg,azimuth_deg,brdf (or brdf_r,"
            "brdf_g,brdf_b)");
      continue;
    }
    if (line.find_first_not_of(" \t\r") == std::string_view::npos || line.front() == '#') continue;
    if (!numbers_of(line, v) || v.size() != columns)
      return wrong(fmt::format("{} finite numbers expected", columns));
    if (!(v[0] >= 0.0 && v[0] <= 90.0 && v[1] >= 0.0 && v[1] <= 90.0 && v[2] >= 0.0 &&
          v[2] <= 180.0))
      return wrong("incidence and emission within 0 to 90, azimuth within 0 to 180 expected");
    if (*std::min_element(v.begin() + 3, v.end()) < 0.0) return wrong("a BRDF is not negative");
    const Bands f = columns == 6 ? Bands{v[3], v[4], v[5]} : Bands{v[3], v[3], v[3]};
    if (!rows.emplace(std::array{v[0], v[1], v[2]}, f).second)
      return wrong("these angles stand in the table twice");
  }
  return rows;
}

}  // namespace

Bands BrdfTable::radiance_factor(const Angles& a) const {
  if (!a.front()) return {};
  constexpr double kDegrees = 180.0 / std::numbers::pi;
  const double i = kDegrees * std::acos(std::min(a.mu0, 1.0));
  const double e = kDegrees * std::acos(std::min(a.mu, 1.0));
  const double azimuth = kDegrees * std::acos(a.cos_azimuth());
  const Bands one = look_up(*grid, i, e, azimuth), other = look_up(*grid, e, i, azimuth);
  const double k = 0.5 * std::numbers::pi * scale * a.mu0;
  return {k * (one[0] + other[0]), k * (one[1] + other[1]), k * (one[2] + other[2])};
}

Result<BrdfTable> read_brdf_table(const std::filesystem::path& path) {
  MAQUETTE_TRY(const std::string text, read_file(path));
  MAQUETTE_TRY(const Rows rows, read_rows(path, text));
  std::array<std::set<double>, 3> angles;
  for (const auto& [where, f] : rows)
    for (std::size_t k = 0; k < 3; ++k) angles[k].insert(where[k]);
  auto grid = std::make_shared<BrdfTable::Grid3>();
  grid->incidence_deg = ascending(angles[0]);
  grid->emission_deg = ascending(angles[1]);
  grid->azimuth_deg = ascending(angles[2]);
  const std::size_t expected = angles[0].size() * angles[1].size() * angles[2].size();
  if (rows.empty() || rows.size() != expected)
    return fail(kBrdfFile,
                fmt::format("{}: {} rows; a full grid of {} incidences, {} emissions and {} "
                            "azimuths has {}",
                            path.string(), rows.size(), angles[0].size(), angles[1].size(),
                            angles[2].size(), expected));
  grid->brdf.reserve(rows.size());
  for (const auto& [where, f] : rows) grid->brdf.push_back(f);  // the map's order is the grid's
  return BrdfTable{std::move(grid), 1.0};
}

}  // namespace maquette::camera
