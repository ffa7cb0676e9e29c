// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/trajectory_file.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <string_view>

#include <fmt/format.h>

#include "core/files.hpp"

namespace maquette::tools {

Result<std::vector<TimedPose>> read_trajectory(const std::filesystem::path& path) {
  MAQUETTE_TRY(const std::string file, read_file(path));
  std::string_view text = file;
  std::vector<TimedPose> poses;
  for (int number = 1; !text.empty(); ++number) {
    const auto end = text.find('\n');
    std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    const auto wrong = [&](const std::string& what) {
      return fail(kTrajectoryFile, fmt::format("{}: line {}: {}", path.string(), number, what));
    };
    if (number == 1) {
      if (line != "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz")
        return wrong("the head time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz expected");
      continue;
    }
    if (line.empty() || line.front() == '#') continue;
    std::array<double, 8> v{};
    const char* at = line.data();
    const char* const last = at + line.size();
    for (std::size_t i = 0; i < v.size(); ++i) {
      const auto read = std::from_chars(at, last, v[i]);
      const bool ended =
          i + 1 == v.size() ? read.ptr == last : read.ptr != last && *read.ptr == ',';
      if (read.ec != std::errc{} || !ended || !std::isfinite(v[i]))
        return wrong(fmt::format("eight finite numbers expected; column {} is none", i + 1));
      at = read.ptr + 1;
    }
    if (!poses.empty() && !(v[0] > poses.back().time_s)) return wrong("times must ascend");
    const Quaternion q{v[4], v[5], v[6], v[7]};
    const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    if (std::abs(length - 1.0) > 1e-3)
      return wrong(fmt::format("the quaternion has length {}; a rotation has 1", length));
    poses.push_back({v[0], {normalized(q), {v[1], v[2], v[3]}}});
  }
  if (poses.empty())
    return fail(kTrajectoryFile,
                fmt::format("{}: no pose; one row a picture expected", path.string()));
  return poses;
}

}  // namespace maquette::tools
