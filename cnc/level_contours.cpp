// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/level_contours.hpp"

#include <algorithm>
#include <array>

namespace maquette::cnc {
namespace {

/// A cell's piece of contour, by the numbers of the edges where it comes in and goes out.
struct Link {
  std::uint64_t from, to;
};

}  // namespace

std::vector<LevelContour> level_contours(
    const Grid<float>& field, double level,
    const std::function<bool(std::ptrdiff_t row, std::ptrdiff_t col)>& wanted) {
  const std::ptrdiff_t rows = field.rows(), cols = field.cols();
  const auto number = [&](std::ptrdiff_t r, std::ptrdiff_t c, bool along_x) {
    return 2 * static_cast<std::uint64_t>(r * cols + c) + (along_x ? 0U : 1U);
  };
  std::vector<Link> links;
  for (std::ptrdiff_t r = 0; r + 1 < rows; ++r)
    for (std::ptrdiff_t c = 0; c + 1 < cols; ++c) {
      // Corners and edges counter-clockwise from the lower left node, the lower edge.
      const std::array corners{field(r, c), field(r, c + 1), field(r + 1, c + 1), field(r + 1, c)};
      std::array<bool, 4> below{};
      int count = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        below[k] = static_cast<double>(corners[k]) <= level;
        count += below[k] ? 1 : 0;
      }
      if (count == 0 || count == 4 || !wanted(r, c)) continue;
      const std::array edges{number(r, c, true), number(r, c + 1, false), number(r + 1, c, true),
                             number(r, c, false)};
      // Walking round the cell, edge k leads from corner k to k + 1. The contour, with what is
      // below to its left, comes in where that turns from below to above, and goes
      // out where it turns from above to below.
      const bool saddle = count == 2 && below[0] == below[2];
      const double mean =
          0.25 * (static_cast<double>(corners[0]) + static_cast<double>(corners[1]) +
                  static_cast<double>(corners[2]) + static_cast<double>(corners[3]));
      for (std::size_t in = 0; in < 4; ++in) {
        if (!below[in] || below[(in + 1) % 4]) continue;
        // Saddle: around a corner that is above if the middle is below, else around one below.
        std::size_t out = saddle && mean > level ? (in + 3) % 4 : (in + 1) % 4;
        if (!saddle)
          while (below[out] || !below[(out + 1) % 4]) out = (out + 1) % 4;
        links.push_back({edges[in], edges[out]});
      }
    }
  std::sort(links.begin(), links.end(), [](Link a, Link b) { return a.from < b.from; });
  std::vector<std::uint64_t> entered;
  entered.reserve(links.size());
  for (const Link& link : links) entered.push_back(link.to);
  std::sort(entered.begin(), entered.end());

  std::vector<bool> used(links.size(), false);
  const auto follow = [&](std::size_t first, bool closed) {
    LevelContour contour;
    contour.closed = closed;
    const auto add = [&](std::uint64_t n) {
      const auto node = static_cast<std::ptrdiff_t>(n / 2);
      contour.edges.push_back({static_cast<std::int32_t>(node / cols),
                               static_cast<std::int32_t>(node % cols), n % 2 == 0});
    };
    add(links[first].from);
    for (std::size_t at = first;;) {
      used[at] = true;
      const std::uint64_t next = links[at].to;
      const auto found =
          std::lower_bound(links.begin(), links.end(), next,
                           [](const Link& l, std::uint64_t n) { return l.from < n; });
      const auto index = static_cast<std::size_t>(found - links.begin());
      if (closed && index == first) break;
      add(next);
      if (found == links.end() || found->from != next) break;
      at = index;
    }
    return contour;
  };
  std::vector<LevelContour> contours;
  for (std::size_t i = 0; i < links.size(); ++i)
    if (!std::binary_search(entered.begin(), entered.end(), links[i].from))
      contours.push_back(follow(i, false));
  for (std::size_t i = 0; i < links.size(); ++i)
    if (!used[i]) contours.push_back(follow(i, true));
  return contours;
}

}  // namespace maquette::cnc
