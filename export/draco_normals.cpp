// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/draco_normals.hpp"

#include <cmath>
#include <cstdlib>

namespace maquette::exporting {
namespace {

using Whole3 = std::array<std::int64_t, 3>;

constexpr int kFinerBits = 3;
constexpr std::int64_t kFineSteps = std::int64_t{1} << kFinerBits;  ///< in a coarse one
/// Of a coarse step: as far as a normal is from the prediction it may take that for its own. More
/// than half, since zeros are cheap: a fifth more error at most, a twentieth fewer bytes.
constexpr double kTakenAsPredicted = 0.6;
/// Draco divides longer sums by a whole number before it goes on.
constexpr std::int64_t kLongestSum = std::int64_t{1} << 29;

std::int64_t length(const Whole3& v) {
  return std::abs(v[0]) + std::abs(v[1]) + std::abs(v[2]);
}

/// Sums of the triangles' cross products at their corners.
std::vector<Whole3> sums_of_areas(std::span<const Float3> positions,
                                  std::span<const std::array<std::uint32_t, 3>> triangles) {
  std::vector<Whole3> sums(positions.size(), Whole3{});
  for (const auto& t : triangles) {
    Whole3 u{}, v{};
    for (std::size_t k = 0; k < 3; ++k) {
      const auto at = static_cast<std::int64_t>(positions[t[0]][k]);
      u[k] = static_cast<std::int64_t>(positions[t[1]][k]) - at;
      v[k] = static_cast<std::int64_t>(positions[t[2]][k]) - at;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
      const std::int64_t area = u[i] * v[j] - u[j] * v[i];
      for (const std::uint32_t corner : t) sums[corner][k] += area;
    }
  }
  return sums;
}

/// y and z on the grid, cut off as Draco does.
std::array<std::int64_t, 2> predicted(Whole3 sum, std::int64_t half) {
  if (const std::int64_t l = length(sum); l > kLongestSum)
    for (std::int64_t& x : sum) x /= l / kLongestSum;
  const std::int64_t l = length(sum);
  if (l == 0) return {0, 0};
  // Its third number is what the other two leave.
  const std::int64_t x = sum[0] * half / l, y = sum[1] * half / l;
  const std::int64_t z = half - std::abs(x) - std::abs(y);
  return {y, sum[2] < 0 ? -z : z};
}

}  // namespace

DracoNormals draco_normals(std::span<const Float3> positions, std::span<const Float3> normals,
                           std::span<const std::array<std::uint32_t, 3>> triangles,
                           const std::vector<bool>& shared, int bits) {
  DracoNormals made{.values = {normals.begin(), normals.end()}, .bits = bits + kFinerBits};
  const std::int64_t half = ((std::int64_t{1} << made.bits) - 2) / 2;
  const std::vector<Whole3> sums = sums_of_areas(positions, triangles);
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const Float3& n = normals[i];
    const double l = std::fabs(static_cast<double>(n[0])) + std::fabs(static_cast<double>(n[1])) +
                     std::fabs(static_cast<double>(n[2]));
    const auto from = shared[i] ? std::array<std::int64_t, 2>{0, 0} : predicted(sums[i], half);
    std::array<std::int64_t, 2> to{};
    for (std::size_t k = 0; k < 2; ++k) {
      const double own = static_cast<double>(half) * static_cast<double>(n[k + 1]) / l;
      const double steps = (own - static_cast<double>(from[k])) / static_cast<double>(kFineSteps);
      const double stay = shared[i] ? 0.5 : kTakenAsPredicted;
      const auto whole = static_cast<std::int64_t>(std::fabs(steps) + 1.0 - stay);
      to[k] = from[k] + kFineSteps * (steps < 0.0 ? -whole : whole);
    }
    const std::int64_t up = half - std::abs(to[0]) - std::abs(to[1]);
    if (up <= 0) continue;  // rounded over the edge of what is not folded: as it is
    made.values[i] = {static_cast<float>(up), static_cast<float>(to[0]), static_cast<float>(to[1])};
  }
  return made;
}

}  // namespace maquette::exporting
