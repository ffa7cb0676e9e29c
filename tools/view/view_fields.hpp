// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file view_fields.hpp
/// Rasters as the page of `maquette view` asks for them: thinned to what a screen shows, and exact
/// at places.

#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::tools {

/// Evenly spaced nodes from the first to the last of the field.
struct ThinnedField {
  std::ptrdiff_t rows = 0, cols = 0;
  double x0_mm = 0.0, y0_mm = 0.0, dx_mm = 1.0, dy_mm = 1.0;
  bool whole = true;          ///< nothing was left out
  std::vector<float> values;  ///< row by row from the southernmost; NaN: void

  [[nodiscard]] std::string shape_json() const;
};

/// @param most_nodes  a side, at least 2
/// @param mean        of what a node stands for (deviations) instead of the surface there (heights)
[[nodiscard]] ThinnedField thinned(const heightmap::ModelField& field, std::ptrdiff_t most_nodes,
                                   bool mean);

/// A square of every n-th node with one more around it (for slopes): (quads + 3)^2 values row by
/// row from the south, the second of the second row being node (row, col). The field's last row and
/// column belong to it whatever n is: beyond what fits it is the next node. NaN beside the field.
/// @pre every >= 1, quads >= 1
[[nodiscard]] std::vector<float> every_nth(const heightmap::ModelField& field, std::ptrdiff_t row,
                                           std::ptrdiff_t col, std::ptrdiff_t every,
                                           std::ptrdiff_t quads);

/// The field's triangulated surface at `count` even places from one point to another (one: at
/// `from`); their z does not matter. NaN beside the field and over voids.
[[nodiscard]] std::vector<double> profile_of(const heightmap::ModelField& field, Vec3 from_mm,
                                             Vec3 to_mm, std::size_t count);

/// The fields that were asked for last, so that a click does not read a file. Notices a file that
/// has changed. Any number of threads.
class FieldShelf {
 public:
  /// @return read_model_grid's errors
  [[nodiscard]] Result<std::shared_ptr<const heightmap::ModelField>> get(
      const std::filesystem::path& file);

 private:
  static constexpr std::size_t kMost = 3;  // of 4001 x 4001 nodes 64 MB each
  struct Held {
    std::filesystem::path file;
    std::filesystem::file_time_type written;
    std::shared_ptr<const heightmap::ModelField> field;
  };
  std::mutex mutex_;
  std::vector<Held> held_;  // the last used first
};

}  // namespace maquette::tools
