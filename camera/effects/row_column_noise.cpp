// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/row_column_noise.hpp"

#include "camera/effects/noise.hpp"

namespace maquette::camera {

Result<void> check(const RowColumnNoise& e, const Shot&) {
  MAQUETTE_TRY_VOID(in_range("row_column_noise", "row_sigma_e", e.row_sigma_e, 0.0, 1e6));
  return in_range("row_column_noise", "column_sigma_e", e.column_sigma_e, 0.0, 1e6);
}

RowFunction rows(const RowColumnNoise& e, const Shot& shot, const Frame& frame) {
  const NoiseStream by_row = temporal_noise(shot, "row_noise");
  const NoiseStream by_column = fixed_pattern(shot, "column_noise");
  const NormalTable& table = normal_table();  // lives as long as the program
  std::vector<float> column(static_cast<std::size_t>(frame.bands.front().cols()));
  for (std::size_t c = 0; c < column.size(); ++c)
    column[c] = static_cast<float>(e.column_sigma_e) * normal_at(table, by_column, c);
  return [=, &table, sigma = static_cast<float>(e.row_sigma_e)](
             std::ptrdiff_t row, const std::vector<std::span<float>>& bands) {
    const float offset = sigma * normal_at(table, by_row, static_cast<std::uint64_t>(row));
    for (const auto& band : bands)
      for (std::size_t c = 0; c < band.size(); ++c) band[c] += offset + column[c];
  };
}

}  // namespace maquette::camera
