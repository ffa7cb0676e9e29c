// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file node_map.hpp
/// From the nodes of a grid in the site frame to the pixels of one source.
///
/// The way (tangent plane, ellipsoid, map projection, geotransform) costs about 1 us a
/// node, and is smooth. So it is walked at 3 x 3 nodes of each tile of 32 x 32, and
/// interpolated biquadratically between; at four more points of the tile both are
/// compared, and a tile off by more than 0.005 pixel (near a pole of a cylindrical
/// map, at its seam) is walked node by node instead.

#include <array>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/dem_reader.hpp"
#include "heightmap/detail/site_frame.hpp"

namespace maquette::heightmap::detail {

/// Where the nodes are: node (r, c) at (x0 + c spacing, y0 + r spacing).
struct NodeGrid {
  double x0_m = 0.0, y0_m = 0.0, spacing_m = 1.0;
  std::ptrdiff_t rows = 0, cols = 0;
};

/// From where in the site frame the height at a node is taken, of a source that was moved there:
/// (x, y) -> (xx x + xy y + x, yx x + yy y + y).
struct Origin {
  double xx = 1.0, xy = 0.0, yx = 0.0, yy = 1.0, x_m = 0.0, y_m = 0.0;
};

/// Ground size of one pixel.
struct PixelSize {
  double along_u_m = 0.0, along_v_m = 0.0;
  [[nodiscard]] double longer_m() const { return std::max(along_u_m, along_v_m); }
};
/// At the site's centre; if that is a pole, where a map may have no direction, at a point
/// `aside_m` away.
[[nodiscard]] PixelSize pixel_size(const DemReader& dem, const SiteFrame& site, double aside_m);

class NodeMap {
 public:
  /// Keeps references to `dem` and `site`.
  /// @return the map, or CORE_CANCELLED
  [[nodiscard]] static Result<NodeMap> build(const DemReader& dem, const SiteFrame& site,
                                             const NodeGrid& nodes, const RunContext& run,
                                             const Origin& origin = {});

  [[nodiscard]] const NodeGrid& nodes() const { return nodes_; }
  /// True if some node lies in the raster.
  [[nodiscard]] bool touches() const { return touches_; }
  /// Pixels that interpolation at all nodes needs, for cells of step_u x step_v pixels.
  [[nodiscard]] PixelRectangle needed(int step_u, int step_v) const;

  /// Heights at all nodes from a window that covers needed(); NaN where the source has
  /// none. Same result for any number of threads.
  [[nodiscard]] Result<Grid<float>> sample(const PixelWindow& window, const RunContext& run) const;
  /// The values of the cells in which the nodes lie, as they are.
  [[nodiscard]] Result<Grid<float>> sample_nearest(const PixelWindow& window,
                                                   const RunContext& run) const;

 private:
  static constexpr std::ptrdiff_t kTile = 32;
  enum Channel { kU, kV, kDeficit, kChannels };
  struct Tile {
    std::array<std::array<double, 9>, kChannels> lattice{};
    bool exact = false;
  };
  struct Row;  // scratch of one row of tiles

  NodeMap(const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes, const Origin& origin);
  void build_row(std::ptrdiff_t tile_row);
  void walk(const std::vector<double>& x, const std::vector<double>& y,
            std::array<std::vector<double>, kChannels>& out) const;
  void sample_row(std::ptrdiff_t tile_row, const PixelWindow& window, bool nearest,
                  Grid<float>& z) const;
  [[nodiscard]] Result<Grid<float>> sample_by(const PixelWindow& window, bool nearest,
                                              const RunContext& run) const;

  const DemReader* dem_;
  const SiteFrame* site_;
  NodeGrid nodes_;
  Origin origin_;
  std::ptrdiff_t tile_rows_ = 0, tile_cols_ = 0;
  std::vector<Tile> tiles_;
  struct Bounds {
    double u_min = INFINITY, u_max = -INFINITY, v_min = INFINITY, v_max = -INFINITY;
    void add(double u, double v);
  };
  std::vector<Bounds> row_bounds_;
  Bounds bounds_;
  bool touches_ = false;
};

/// Bicubic height (Keys 1981, a = -1/2, doi:10.1109/TASSP.1981.1163711) at pixel
/// coordinates; next to voids bilinear over what is there, so that data reach exactly
/// as far as their pixels. NaN in void pixels. The caller checks that (u, v) lies in the
/// raster; the window has two more cells on each side.
[[nodiscard]] double sample_window(const PixelWindow& window, double u, double v);

}  // namespace maquette::heightmap::detail
