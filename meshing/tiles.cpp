// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/tiles.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "meshing/detail/joint_lines.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;

/// What a joint has to keep off, along one axis.
struct Stretch {
  double from_mm, to_mm;
  int stone;
};

/// Lines of nodes 0 .. count - 1, as coordinates.
struct Axis {
  char name;
  std::ptrdiff_t count;
  double first_mm, spacing_mm;
  [[nodiscard]] double at(std::ptrdiff_t i) const {
    return first_mm + spacing_mm * static_cast<double>(i);
  }
};

/// Whole cells that a width holds; a width may lie a rounding error beside a whole number.
Result<std::ptrdiff_t> most_cells(const Axis& axis, Millimetres width) {
  constexpr double kCellRounding = 1e-9;
  const double cells = std::floor(width.value() / axis.spacing_mm + kCellRounding);
  if (!(cells >= 2.0))
    return fail(kBandsDegenerate,
                fmt::format("tiles of {} mm in {} are below two cells of {} mm; choose at least "
                            "{} mm",
                            width.value(), axis.name, axis.spacing_mm, 2.0 * axis.spacing_mm));
  return static_cast<std::ptrdiff_t>(std::fmin(cells, static_cast<double>(axis.count - 1)));
}

std::vector<char> blocked_lines(const Axis& axis, std::span<const Stretch> stones) {
  std::vector<char> blocked(static_cast<std::size_t>(axis.count), 0);
  for (const Stretch& s : stones) {
    const auto line = [&](double mm) {
      return std::clamp((mm - axis.first_mm) / axis.spacing_mm, -1.0,
                        static_cast<double>(axis.count));
    };
    const auto last = static_cast<std::ptrdiff_t>(std::floor(line(s.to_mm)));
    for (auto i = static_cast<std::ptrdiff_t>(std::ceil(line(s.from_mm))); i <= last; ++i)
      if (i > 0 && i < axis.count - 1) blocked[static_cast<std::size_t>(i)] = 1;
  }
  return blocked;
}

/// Wider tiles that would do: the widest run of lines without a joint decides.
Error no_joint(const Axis& axis, std::span<const Stretch> stones, const std::vector<char>& blocked,
               std::ptrdiff_t reached, std::ptrdiff_t most) {
  std::vector<int> numbers;
  const double from = axis.at(reached + 1), to = axis.at(std::min(reached + most, axis.count - 1));
  for (const Stretch& s : stones)
    if (s.to_mm >= from && s.from_mm <= to) numbers.push_back(s.stone);
  std::sort(numbers.begin(), numbers.end());
  std::ptrdiff_t widest = 0, last_free = 0;
  for (std::ptrdiff_t i = 1; i < axis.count; ++i)
    if (!blocked[static_cast<std::size_t>(i)]) {
      widest = std::max(widest, i - last_free);
      last_free = i;
    }
  return {kJointMeetsStones,
          fmt::format("between {0} = {1:g} and {2:g} mm every joint across {0} would meet a stone "
                      "(number {3}); tiles of {4:g} mm in {0}, a smaller clearance or other stones "
                      "would do",
                      axis.name, from, to, fmt::join(numbers, ", "),
                      axis.spacing_mm * static_cast<double>(widest))};
}

/// The farthest free line that tiles of that width come to.
std::ptrdiff_t reached_line(const std::vector<char>& blocked, std::ptrdiff_t most) {
  std::ptrdiff_t reached = 0;
  for (std::size_t i = 1; i < blocked.size(); ++i)
    if (const auto line = static_cast<std::ptrdiff_t>(i); !blocked[i] && line - reached <= most)
      reached = line;
  return reached;
}

/// @return first line, joints, last line
Result<std::vector<std::ptrdiff_t>> cut(const Axis& axis, std::span<const Stretch> stones,
                                        Millimetres width) {
  MAQUETTE_TRY(const std::ptrdiff_t most, most_cells(axis, width));
  const std::vector<char> blocked = blocked_lines(axis, stones);
  const std::vector<detail::LineCost> cost(blocked.begin(), blocked.end());
  auto lines = detail::best_lines(cost, 1, most);
  for (const std::ptrdiff_t line : lines)
    if (blocked[static_cast<std::size_t>(line)])
      return tl::unexpected(no_joint(axis, stones, blocked, reached_line(blocked, most), most));
  return lines;
}

}  // namespace

Result<std::vector<Tile>> split_into_tiles(const ModelField& surface,
                                           std::span<const PlacedStone> stones,
                                           const TileOptions& options) {
  if (surface.z_mm.rows() < 2 || surface.z_mm.cols() < 2)
    return fail(kBandsDegenerate, fmt::format("surface of {} x {} nodes; tiles need at least 2 x 2",
                                              surface.z_mm.rows(), surface.z_mm.cols()));
  const double clearance = options.clearance.value();
  if (!(clearance >= 0.0))
    return fail(kBandsDegenerate,
                fmt::format("clearance of {} mm between joints and stones; choose 0 mm or more",
                            clearance));
  std::vector<Box3> boxes;
  std::vector<Stretch> along_y;
  for (const PlacedStone& stone : stones) {
    boxes.push_back(stone_mesh(stone).bounds());
    along_y.push_back(
        {boxes.back().min.y - clearance, boxes.back().max.y + clearance, stone.number});
  }
  const double spacing = surface.spacing.value();
  const Axis x{'x', surface.z_mm.cols(), surface.x0.value(), spacing};
  const Axis y{'y', surface.z_mm.rows(), surface.y0.value(), spacing};
  MAQUETTE_TRY(const auto rows, cut(y, along_y, options.max_length));
  std::vector<Tile> tiles;
  for (std::size_t s = 0; s + 1 < rows.size(); ++s) {
    std::vector<Stretch> along_x;
    for (std::size_t k = 0; k < stones.size(); ++k)
      if (along_y[k].to_mm >= y.at(rows[s]) && along_y[k].from_mm <= y.at(rows[s + 1]))
        along_x.push_back(
            {boxes[k].min.x - clearance, boxes[k].max.x + clearance, stones[k].number});
    MAQUETTE_TRY(const auto columns, cut(x, along_x, options.max_width));
    for (std::size_t p = 0; p + 1 < columns.size(); ++p)
      tiles.push_back({.number = static_cast<int>(tiles.size() + 1),
                       .strip = static_cast<int>(s + 1),
                       .place = static_cast<int>(p + 1),
                       .nodes = {rows[s], rows[s + 1], columns[p], columns[p + 1]}});
  }
  return tiles;
}

}  // namespace maquette::meshing
