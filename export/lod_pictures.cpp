// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_pictures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "export/detail/gdal_memory.hpp"
#include "export/sky_view.hpp"

namespace maquette::exporting {
namespace {

/// Between two nodes of a level: the first, and the share of the second.
struct Between {
  std::ptrdiff_t first = 0;
  double share = 0.0;
};
/// @param at  in nodes of the field
Between between(std::ptrdiff_t nodes, int level, double at) {
  const std::ptrdiff_t last = lod_nodes(nodes, level) - 1;
  if (last == 0) return {};
  const auto first =
      std::clamp(static_cast<std::ptrdiff_t>(at) >> level, std::ptrdiff_t{0}, last - 1);
  const auto from = static_cast<double>(lod_node(nodes, level, first)),
             to = static_cast<double>(lod_node(nodes, level, first + 1));
  return {first, std::clamp((at - from) / (to - from), 0.0, 1.0)};
}

/// The four nodes of a level about a place, and what each counts.
struct Four {
  std::array<std::ptrdiff_t, 2> rows, cols;
  std::array<std::array<double, 2>, 2> weights;
};
Four four(const LodPyramid& pyramid, int level, double row, double col) {
  const Grid<float>& field = pyramid.field().z_mm;
  const Between r = between(field.rows(), level, row), c = between(field.cols(), level, col);
  const auto next = [&](std::ptrdiff_t nodes, std::ptrdiff_t first) {
    return std::min(first + 1, lod_nodes(nodes, level) - 1);
  };
  return {{r.first, next(field.rows(), r.first)},
          {c.first, next(field.cols(), c.first)},
          {{{(1.0 - r.share) * (1.0 - c.share), (1.0 - r.share) * c.share},
            {r.share * (1.0 - c.share), r.share * c.share}}}};
}

Vec3 normal_at(const LodPyramid& pyramid, int level, double row, double col) {
  const Four at = four(pyramid, level, row, col);
  double dx = 0.0, dy = 0.0;
  for (std::size_t i = 0; i < 2; ++i)
    for (std::size_t k = 0; k < 2; ++k) {
      const LodPyramid::Slope slope = pyramid.slope(level, at.rows[i], at.cols[k]);
      dx += at.weights[i][k] * static_cast<double>(slope[0]);
      dy += at.weights[i][k] * static_cast<double>(slope[1]);
    }
  return normalized(Vec3{-dx, -dy, 1.0});
}

double light_at(const LodPyramid& pyramid, int level, const Grid<float>& light, double row,
                double col) {
  const Four at = four(pyramid, level, row, col);
  double sum = 0.0;
  for (std::size_t i = 0; i < 2; ++i)
    for (std::size_t k = 0; k < 2; ++k)
      sum += at.weights[i][k] * static_cast<double>(light(at.rows[i], at.cols[k]));
  return sum;
}

std::uint8_t byte_of(double share) {
  return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(share, 0.0, 1.0)));
}

int occlusion_level(const LodPyramid& pyramid) {
  return std::min(1, pyramid.levels() - 1);
}

}  // namespace

PictureSquare picture_square(const LodTileMesh& tile) {
  const auto north = static_cast<double>(tile.rows.back()),
             south = static_cast<double>(tile.rows.front()),
             west = static_cast<double>(tile.cols.front()),
             east = static_cast<double>(tile.cols.back());
  return {north, south, west, east, std::fmax(north - south, east - west)};
}

Grid<float> lod_occlusion(const LodPyramid& pyramid) {
  const int level = occlusion_level(pyramid);
  return sky_view(pyramid.heights_mm(level), std::ldexp(pyramid.field().spacing.value(), level),
                  [&](std::ptrdiff_t r, std::ptrdiff_t c) { return pyramid.slope(level, r, c); });
}

Result<LodPictures> make_lod_pictures(const LodPyramid& pyramid, const Grid<float>& occlusion,
                                      const LodTileMesh& tile, int texels) {
  const auto [north, south, west, east, side] = picture_square(tile);
  /// of(row, col, texel) in nodes of the field, for each texel from the upper left.
  const auto each = [&](int count, const auto& of) {
    const double texel = side / count;
    for (int y = 0; y < count; ++y)
      for (int x = 0; x < count; ++x)
        of(std::fmax(north - (y + 0.5) * texel, south), std::fmin(west + (x + 0.5) * texel, east),
           texel);
  };
  LodPictures pictures;
  if (tile.key.level > 0) {
    // Slopes from where nodes stand as close as texels or closer: their means are over that.
    const int level =
        std::clamp(static_cast<int>(std::floor(std::log2(std::fmax(side / texels, 1.0)))), 0,
                   pyramid.levels() - 1);
    std::array<std::vector<std::uint8_t>, 3> bands;
    each(texels, [&](double row, double col, double) {
      const Vec3 n = normal_at(pyramid, level, row, col);
      bands[0].push_back(byte_of(0.5 + 0.5 * n.x));
      bands[1].push_back(byte_of(0.5 + 0.5 * n.y));
      bands[2].push_back(byte_of(0.5 + 0.5 * n.z));
    });
    MAQUETTE_TRY(pictures.normal_png, detail::png_bytes(texels, texels, bands));
  }
  const int light = occlusion_level(pyramid);
  const int count = std::clamp(static_cast<int>(std::ldexp(side, -light)), 1, texels);
  std::array<std::vector<std::uint8_t>, 1> band;
  each(count, [&](double row, double col, double texel) {
    // Texels that are wider than a node of the light are the mean of what they cover.
    const int across = std::max(1, static_cast<int>(std::lround(std::ldexp(texel, -light))));
    double sum = 0.0;
    for (int i = 0; i < across; ++i)
      for (int k = 0; k < across; ++k) {
        const double part = texel / across, r = row + (i + 0.5) * part - 0.5 * texel,
                     c = col + (k + 0.5) * part - 0.5 * texel;
        sum += light_at(pyramid, light, occlusion, std::clamp(r, south, north),
                        std::clamp(c, west, east));
      }
    band[0].push_back(byte_of(sum / (across * across)));
  });
  MAQUETTE_TRY(pictures.occlusion_png, detail::png_bytes(count, count, band));
  return pictures;
}

}  // namespace maquette::exporting
