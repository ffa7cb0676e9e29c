// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/view_fields.hpp"

#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "heightmap/field_io.hpp"

namespace maquette::tools {
namespace {

/// Even places on a line of `count` nodes.
struct Line {
  std::ptrdiff_t places = 2;
  double step = 1.0;  // in nodes
};
Line line_of(std::ptrdiff_t count, std::ptrdiff_t most) {
  const std::ptrdiff_t every = std::max<std::ptrdiff_t>(1, (count - 2) / (most - 1) + 1);
  const std::ptrdiff_t places = (count - 1 + every - 1) / every + 1;
  return {places, static_cast<double>(count - 1) / static_cast<double>(places - 1)};
}

struct Range {
  std::ptrdiff_t first, last;
};
/// Nodes that are nearer to this place than to the next ones.
Range around(std::ptrdiff_t i, double step, std::ptrdiff_t count) {
  const double middle = static_cast<double>(i) * step;
  return {std::max<std::ptrdiff_t>(0, std::lround(middle - 0.5 * step + 0.25)),
          std::min(count - 1, std::lround(middle + 0.5 * step - 0.25))};
}

float mean_of(const Grid<float>& z, Range rows, Range cols) {
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = rows.first; r <= rows.last; ++r)
    for (std::ptrdiff_t c = cols.first; c <= cols.last; ++c)
      if (const float v = z(r, c); !std::isnan(v)) sum += static_cast<double>(v), n += 1.0;
  return n > 0.0 ? static_cast<float>(sum / n) : NAN;
}

}  // namespace

std::string ThinnedField::shape_json() const {
  return nlohmann::json{{"rows", rows},   {"cols", cols},   {"x0_mm", x0_mm}, {"y0_mm", y0_mm},
                        {"dx_mm", dx_mm}, {"dy_mm", dy_mm}, {"whole", whole}}
      .dump();
}

ThinnedField thinned(const heightmap::ModelField& field, std::ptrdiff_t most_nodes, bool mean) {
  const Grid<float>& z = field.z_mm;
  const Line down = line_of(z.rows(), most_nodes), across = line_of(z.cols(), most_nodes);
  const double spacing = field.spacing.value();
  ThinnedField thin;
  thin.rows = down.places;
  thin.cols = across.places;
  thin.x0_mm = field.x0.value();
  thin.y0_mm = field.y0.value();
  thin.dx_mm = across.step * spacing;
  thin.dy_mm = down.step * spacing;
  thin.whole = down.places == z.rows() && across.places == z.cols();
  thin.values.reserve(static_cast<std::size_t>(thin.rows * thin.cols));
  for (std::ptrdiff_t r = 0; r < thin.rows; ++r)
    for (std::ptrdiff_t c = 0; c < thin.cols; ++c) {
      if (thin.whole) {
        thin.values.push_back(z(r, c));
      } else if (mean) {
        thin.values.push_back(
            mean_of(z, around(r, down.step, z.rows()), around(c, across.step, z.cols())));
      } else {
        // Inside by construction; rounding must not put the last node outside.
        const double y = std::min(static_cast<double>(r) * down.step,
                                  static_cast<double>(z.rows() - 1)),
                     x = std::min(static_cast<double>(c) * across.step,
                                  static_cast<double>(z.cols() - 1));
        thin.values.push_back(static_cast<float>(
            heightmap::height_at(field, thin.x0_mm + x * spacing, thin.y0_mm + y * spacing)));
      }
    }
  return thin;
}

std::vector<float> every_nth(const heightmap::ModelField& field, std::ptrdiff_t row,
                             std::ptrdiff_t col, std::ptrdiff_t every, std::ptrdiff_t quads) {
  const Grid<float>& z = field.z_mm;
  // -1: beside the field.
  const auto node = [&](std::ptrdiff_t first, std::ptrdiff_t i, std::ptrdiff_t count) {
    const std::ptrdiff_t at = first + i * every;
    if (at < 0 || at - every >= count - 1) return std::ptrdiff_t{-1};
    return std::min(at, count - 1);
  };
  std::vector<float> values;
  values.reserve(static_cast<std::size_t>((quads + 3) * (quads + 3)));
  for (std::ptrdiff_t i = -1; i <= quads + 1; ++i) {
    const std::ptrdiff_t r = node(row, i, z.rows());
    for (std::ptrdiff_t j = -1; j <= quads + 1; ++j) {
      const std::ptrdiff_t c = node(col, j, z.cols());
      values.push_back(r < 0 || c < 0 ? NAN : z(r, c));
    }
  }
  return values;
}

std::vector<double> profile_of(const heightmap::ModelField& field, Vec3 from_mm, Vec3 to_mm,
                               std::size_t count) {
  std::vector<double> heights(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = count < 2 ? 0.0 : static_cast<double>(i) / static_cast<double>(count - 1);
    heights[i] = heightmap::height_at(field, from_mm.x + t * (to_mm.x - from_mm.x),
                                      from_mm.y + t * (to_mm.y - from_mm.y));
  }
  return heights;
}

Result<std::shared_ptr<const heightmap::ModelField>> FieldShelf::get(
    const std::filesystem::path& file) {
  // Held while a file is read: two requests for the same file read it once.
  const std::lock_guard lock(mutex_);
  std::error_code ec;
  const auto written = std::filesystem::last_write_time(file, ec);
  const auto found = std::find_if(held_.begin(), held_.end(), [&](const Held& h) {
    return h.file == file && h.written == written;
  });
  if (found != held_.end()) {
    std::rotate(held_.begin(), found, found + 1);
    return held_.front().field;
  }
  MAQUETTE_TRY(auto field, heightmap::read_model_grid(file));
  if (held_.size() == kMost) held_.pop_back();
  held_.insert(held_.begin(),
               {file, written, std::make_shared<const heightmap::ModelField>(std::move(field))});
  return held_.front().field;
}

}  // namespace maquette::tools
