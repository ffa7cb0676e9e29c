// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/trajectory_file.hpp"

#include <array>
#include <cmath>
#include <string_view>

#include <fmt/format.h>

#include "tools/row_file.hpp"

namespace maquette::tools {

Result<std::vector<TimedPose>> read_trajectory(const std::filesystem::path& path) {
  std::vector<TimedPose> poses;
  const auto row = [&](std::string_view line, int, const auto& wrong) -> Result<void> {
    std::array<double, 8> v{};
    if (const std::size_t column = take_numbers(line, v, true))
      return wrong(fmt::format("eight finite numbers expected; column {} is none", column));
    if (!poses.empty() && !(v[0] > poses.back().time_s)) return wrong("times must ascend");
    const Quaternion q{v[4], v[5], v[6], v[7]};
    const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    if (std::abs(length - 1.0) > 1e-3)
      return wrong(fmt::format("the quaternion has length {}; a rotation has 1", length));
    poses.push_back({v[0], {normalized(q), {v[1], v[2], v[3]}}});
    return {};
  };
  MAQUETTE_TRY_VOID(each_row(path, "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz", kTrajectoryFile, row));
  if (poses.empty())
    return fail(kTrajectoryFile,
                fmt::format("{}: no pose; one row a picture expected", path.string()));
  return poses;
}

}  // namespace maquette::tools
