// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file range_image.hpp
/// The ranges of one station by direction (four bytes, six without a grid), and which of its points
/// lie between two surfaces.
///
/// Use      survey() of every point, build(), put() of every point, finish(); then mixed()
/// Cells    the station's own grid where all points have a place in it, else squares of one
///          point's spacing on the six faces of a cube round the scanner
/// Planes   Inverse range goes linearly with direction over a plane (to 1e-5 of the range across
///          the few steps that count here), whatever its slope.

#include <array>
#include <cstdint>
#include <vector>

#include "core/vec.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan::detail {

struct BeamWidth {
  double waist_radius_mm = 1.5, divergence_rad = 0.22e-3;
};

class RangeImage {
 public:
  /// @param p     from the scanner, in its station's frame; not zero
  /// @param grid  its place, or null
  void survey(Vec3 p_mm, const GridIndex* grid);
  void build();
  void put(Vec3 p_mm, const GridIndex* grid);
  void finish();
  /// Does the point lie between the two surfaces that are seen on either side of its own
  /// beam, farther from both than noise explains? Thread-safe.
  [[nodiscard]] bool mixed(Vec3 p_mm, const GridIndex* grid, const BeamWidth& beam,
                           double least_jump_mm) const;
  /// Robust standard deviation of a range, what is rough within a step included.
  [[nodiscard]] double noise_mm() const { return noise_mm_; }
  [[nodiscard]] double spacing_rad() const { return spacing_rad_; }

 private:
  /// A rectangle of cells; all of a grid, or what is seen on one face.
  struct Sheet {
    std::int64_t rows = 0, columns = 0;
    std::size_t first = 0;      // index of its first cell
    double u0 = 0.0, v0 = 0.0;  // of a face
    double min_u = 2.0, max_u = -2.0, min_v = 2.0, max_v = -2.0;
  };
  struct Place {
    const Sheet* sheet = nullptr;
    std::int64_t row = 0, column = 0;
    double row_step_rad = 0.0, column_step_rad = 0.0;
    double row_off = 0.0, column_off = 0.0;  // from the cell's middle, cells
  };
  [[nodiscard]] Place place_of(Vec3 p, const GridIndex* grid) const;
  /// Inverse range of a cell beside a place's, 0 if there is none.
  [[nodiscard]] float look(const Place& at, std::int64_t down, std::int64_t right) const;
  struct Side {
    bool known = false;
    double range_mm = 0.0, margin_mm = 0.0;
  };
  [[nodiscard]] Side side(const Place& at, std::int64_t dr, std::int64_t dc, std::int64_t from,
                          std::int64_t stride) const;

  /// Mean angle between points that are neighbours along a line of the grid.
  struct Steps {
    struct Line {
      std::array<float, 3> direction{};
      std::uint32_t index = 0;
      bool begun = false;
      float sum = 0.0F, count = 0.0F;
    };
    std::vector<Line> lines;
    void add(std::uint32_t line, std::uint32_t index, Vec3 direction);
    [[nodiscard]] double mean(std::size_t line, double otherwise) const;
    [[nodiscard]] double mean_of_all(double otherwise) const;
  };

  std::uint64_t points_ = 0;
  bool gridded_ = true;
  std::uint32_t last_row_ = 0, last_column_ = 0;
  Steps along_rows_, along_columns_;
  double row_step_rad_ = 0.0;
  std::vector<std::uint32_t> seen_;  // cells of six faces of 512 x 512, some more than once
  std::size_t seen_limit_ = 4096;    // then each once
  std::array<Sheet, 6> sheets_;
  double cell_ = 0.0, spacing_rad_ = 0.0, noise_mm_ = 0.0;
  std::vector<float> inverse_;                   // 1 / range, 0: nothing
  std::vector<std::array<std::int8_t, 2>> off_;  // of row and column, 1/250 of a cell; not of grids
};

}  // namespace maquette::scan::detail
