// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/probed_spheres.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include <fmt/format.h>

#include "core/files.hpp"

namespace maquette::cnc {
namespace {

/// Gauss-Newton steps on the distances; five touches around half a sphere make it well posed.
Vec3 fitted_centre(std::span<const Vec3> points, Vec3 start, double distance_mm) {
  Vec3 centre = start;
  for (int step = 0; step < 50; ++step) {
    // Normal equations; d |p - c| / dc is the unit vector from p to c.
    Vec3 a{}, b{}, c{}, right{};
    for (const Vec3& p : points) {
      const Vec3 to = centre - p;
      const double length = norm(to);
      if (!(length > 0.0)) continue;
      const Vec3 u = (1.0 / length) * to;
      a += u.x * u;
      b += u.y * u;
      c += u.z * u;
      right += (distance_mm - length) * u;
    }
    const double volume = dot(a, cross(b, c));
    if (!(std::abs(volume) > 1e-12)) break;
    const Vec3 move =
        (1.0 / volume) * (right.x * cross(b, c) + right.y * cross(c, a) + right.z * cross(a, b));
    centre += move;
    if (norm(move) < 1e-12) break;
  }
  return centre;
}

}  // namespace

Result<std::vector<Vec3>> read_contacts(const std::filesystem::path& file) {
  MAQUETTE_TRY(const std::string text, read_file(file));
  std::istringstream lines(text);
  std::vector<Vec3> tips;
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    std::istringstream words(line);
    Vec3 tip;
    if (!(words >> tip.x >> tip.y >> tip.z))
      return fail(kProbedContacts,
                  fmt::format("{}:{}: expected the place of a touch, x y z in mm, found '{}'",
                              file.string(), number, line.substr(0, 60)));
    tips.push_back(tip);
  }
  return tips;
}

Result<std::vector<ProbedSphere>> spheres_of_contacts(std::span<const Vec3> tips,
                                                      std::span<const Vec3> planned_mm,
                                                      double sphere_radius_mm,
                                                      double ball_radius_mm, double farthest_mm) {
  if (tips.size() != kTouchesPerSphere * planned_mm.size())
    return fail(kProbedContacts,
                fmt::format("{} touches; expected {}, {} for each of {} spheres: the program was "
                            "broken off, or it was that of other spheres",
                            tips.size(), kTouchesPerSphere * planned_mm.size(), kTouchesPerSphere,
                            planned_mm.size()));
  const double distance = sphere_radius_mm + ball_radius_mm;
  std::vector<ProbedSphere> spheres;
  for (std::size_t k = 0; k < planned_mm.size(); ++k) {
    std::array<Vec3, kTouchesPerSphere / 2> points;
    for (std::size_t i = 0; i < points.size(); ++i)
      points[i] = tips[kTouchesPerSphere * k + 2 * i + 1] + Vec3{0.0, 0.0, ball_radius_mm};
    ProbedSphere sphere;
    sphere.centre_mm = fitted_centre(points, planned_mm[k], distance);
    for (const Vec3& p : points)
      sphere.residual_mm =
          std::max(sphere.residual_mm, std::abs(norm(p - sphere.centre_mm) - distance));
    if (!(sphere.residual_mm <= kContactResidual_mm))
      return fail(kProbedContacts,
                  fmt::format("sphere {}: a touch is {:.3f} mm off a sphere of radius {} mm felt "
                              "with a ball of radius {} mm, at most {} are expected; are these "
                              "radii right, and was it the sphere that was touched?",
                              k + 1, sphere.residual_mm, sphere_radius_mm, ball_radius_mm,
                              kContactResidual_mm));
    if (const double off = norm(sphere.centre_mm - planned_mm[k]); !(off <= farthest_mm))
      return fail(kProbedContacts,
                  fmt::format("sphere {}: its centre is {:.2f} mm off the planned one, more than "
                              "the {} mm that the probe searched",
                              k + 1, off, farthest_mm));
    spheres.push_back(sphere);
  }
  return spheres;
}

}  // namespace maquette::cnc
