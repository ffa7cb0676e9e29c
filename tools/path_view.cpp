// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/path_view.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "tools/path_view_text.hpp"
#include "tools/pictures.hpp"
#include "tools/report.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

constexpr std::ptrdiff_t kGroundNodes = 200;
constexpr double kMost = 65535.0;

class Words {
 public:
  void add(double value) {
    const auto word = static_cast<unsigned>(std::lround(std::clamp(value, 0.0, kMost)));
    bytes_ += static_cast<char>(word & 0xFFU);
    bytes_ += static_cast<char>(word >> 8);
  }
  [[nodiscard]] std::string text() const { return base64(bytes_); }

 private:
  std::string bytes_;
};

double share(double value, double low, double size) {
  return size > 0.0 ? (value - low) / size * kMost : 0.0;
}

/// At most kGroundNodes a side: every k-th node, with the lowest height that is within k of it.
json ground_json(const heightmap::ModelField& design, Box3& box) {
  const std::ptrdiff_t rows = design.z_mm.rows(), cols = design.z_mm.cols();
  const auto step = std::max<std::ptrdiff_t>(
      1, (std::max(rows, cols) - 1 + kGroundNodes - 2) / (kGroundNodes - 1));
  const std::ptrdiff_t n = (rows - 1 + step - 1) / step + 1, m = (cols - 1 + step - 1) / step + 1;
  // Even steps to the last node: the drawn surface ends where the design ends.
  const double dy = (design.y_mm(rows - 1) - design.y0.value()) / static_cast<double>(n - 1),
               dx = (design.x_mm(cols - 1) - design.x0.value()) / static_cast<double>(m - 1);
  const auto lowest_within = [&](double low, double high, std::ptrdiff_t count) {
    return std::pair{
        std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::floor(low)), 0, count - 1),
        std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::ceil(high)), 0, count - 1)};
  };
  Grid<float> heights(n, m);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < m; ++c) {
      const double in_rows = dy / design.spacing.value(), in_cols = dx / design.spacing.value();
      const auto [r0, r1] = lowest_within(static_cast<double>(r - 1) * in_rows,
                                          static_cast<double>(r + 1) * in_rows, rows);
      const auto [c0, c1] = lowest_within(static_cast<double>(c - 1) * in_cols,
                                          static_cast<double>(c + 1) * in_cols, cols);
      float least = INFINITY;
      for (std::ptrdiff_t i = r0; i <= r1; ++i)
        for (std::ptrdiff_t j = c0; j <= c1; ++j) least = std::fmin(least, design.z_mm(i, j));
      heights(r, c) = std::isfinite(least) ? least : 0.0F;
    }
  const heightmap::HeightRange range = heightmap::height_range(heights);
  const auto low = static_cast<double>(range.min), high = static_cast<double>(range.max);
  Words words;
  for (const float z : heights.cells()) words.add(share(static_cast<double>(z), low, high - low));
  box.add({design.x0.value(), design.y0.value(), low});
  box.add({design.x_mm(cols - 1), design.y_mm(rows - 1), high});
  return {{"rows", n},
          {"cols", m},
          {"origin_mm", {design.x0.value(), design.y0.value()}},
          {"step_mm", {dx, dy}},
          {"low_mm", low},
          {"range_mm", high - low},
          {"heights", words.text()}};
}

}  // namespace

std::string path_scene_json(std::span<const ViewProgram> programs, bool engagement,
                            const heightmap::ModelField* design) {
  Box3 box;
  json scene{{"schema", "maquette.path_view/1"}, {"ground", nullptr}};
  if (design != nullptr) scene["ground"] = ground_json(*design, box);
  for (const ViewProgram& program : programs)
    for (const cnc::SketchRun& run : program.sketch->runs)
      for (const cnc::SketchPoint& p : run.points) box.add(p.at_mm);
  if (box.empty()) box.add({});
  const Vec3 size = box.max - box.min;
  scene["low_mm"] = {box.min.x, box.min.y, box.min.z};
  scene["size_mm"] = {size.x, size.y, size.z};
  scene["programs"] = json::array();
  const double rounding = 0.5 / kMost * norm(size);
  for (const ViewProgram& program : programs) {
    Words places, feeds, engagements;
    std::string kinds;
    for (const cnc::SketchRun& run : program.sketch->runs) {
      const char kind = run.rapid ? 2 : 1;
      for (const cnc::SketchPoint& p : run.points) {
        kinds += &p == &run.points.front() ? '\0' : kind;
        places.add(share(p.at_mm.x, box.min.x, size.x));
        places.add(share(p.at_mm.y, box.min.y, size.y));
        places.add(share(p.at_mm.z, box.min.z, size.z));
        feeds.add(p.feed_mm_min);
        engagements.add((std::log10(std::fmax(1e-4, p.engagement_mm2)) + 4.0) / 8.0 * kMost);
      }
    }
    scene["programs"].push_back(
        {{"name", program.name},
         {"operation", program.operation},
         {"cut_mm", program.cut_mm},
         {"time_min", program.time_min},
         {"cell_mm", program.sketch->cell_mm},
         {"deviation_mm", program.sketch->deviation_mm + rounding},
         {"left_out_mm", program.sketch->left_out_mm},
         {"places", places.text()},
         {"kinds", base64(kinds)},
         {"feed", feeds.text()},
         {"engagement", engagement ? json(engagements.text()) : json(nullptr)}});
  }
  return scene.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string path_view_head() {
  return fmt::format("<style>\n{}</style>\n<script>\n{}</script>\n", kPathViewStyle,
                     kPathViewScript);
}

std::string path_view_html(const std::string& scene_json) {
  // A name could hold "</script>".
  std::string safe;
  for (const char c : scene_json) {
    if (c == '<')
      safe += "\\u003c";
    else
      safe += c;
  }
  return fmt::format(
      "<div class=\"pathview\"><script type=\"application/json\">{}</script></div>\n", safe);
}

Result<void> write_path_page(const std::string& title, const std::string& scene_json,
                             const std::filesystem::path& out) {
  return write_file(out, page(title, path_view_head() + path_view_html(scene_json)));
}

}  // namespace maquette::tools
