// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/contours.hpp"
#include "export/dxf_text.hpp"
#include "export/limits.hpp"

namespace maquette::exporting {
namespace {

/// More lines than a person can tell apart; a larger number is a slip of the unit.
constexpr double kMaxLevels = 10'000;

ContourLine outline(const heightmap::ModelField& f) {
  const double x0 = f.x_mm(0), x1 = f.x_mm(f.z_mm.cols() - 1);
  const double y0 = f.y_mm(0), y1 = f.y_mm(f.z_mm.rows() - 1);
  return {{{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}, true};
}

std::string header(const ContourLine& border, double z_min, double z_max) {
  constexpr std::array<DxfLayer, 2> kLayers{{{"CONTOUR", 3}, {"OUTLINE", 7}}};
  const auto lo = border.points_mm[0], hi = border.points_mm[2];
  return dxf_header("contour lines", {{lo[0], lo[1], z_min}, {hi[0], hi[1], z_max}}, kLayers);
}

struct Range {
  double min = INFINITY, max = -INFINITY;
};

Result<Range> check_field(const heightmap::ModelField& f, const std::filesystem::path& path) {
  if (f.z_mm.rows() < 2 || f.z_mm.cols() < 2)
    return fail(kEmptyMesh, fmt::format("{}: a field of {} x {} nodes has no cell", path.string(),
                                        f.z_mm.cols(), f.z_mm.rows()));
  Range range;
  for (const float z : f.z_mm.cells()) {
    if (!std::isfinite(z)) continue;
    range.min = std::min(range.min, static_cast<double>(z));
    range.max = std::max(range.max, static_cast<double>(z));
  }
  if (range.min > range.max)
    return fail(kEmptyMesh, fmt::format("{}: every node of the field is void", path.string()));
  return range;
}

}  // namespace

Result<void> write_dxf_contours(const heightmap::ModelField& surface, Millimetres interval,
                                const std::filesystem::path& path, const RunContext& run) {
  const double step = interval.value();
  if (!(step > 0.0) || !std::isfinite(step))
    return fail(kOptionOutOfRange, fmt::format("{}: contour interval {} mm: more than 0 expected",
                                               path.string(), step));
  MAQUETTE_TRY(const Range range, check_field(surface, path));
  if ((range.max - range.min) / step > kMaxLevels)
    return fail(kOptionOutOfRange,
                fmt::format("{}: heights from {} to {} mm have more than {} contour lines at an "
                            "interval of {} mm; choose a larger one",
                            path.string(), range.min, range.max, kMaxLevels, step));

  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  const ContourLine border = outline(surface);
  file.write(header(border, range.min, range.max));
  fmt::memory_buffer text;
  append_dxf_polyline(text, "OUTLINE", border.points_mm, border.closed, 0.0);
  file.write(text.data(), text.size());

  const ContourTracer tracer(surface);
  const auto first = static_cast<std::int64_t>(std::floor(range.min / step)) + 1;
  const auto last = static_cast<std::int64_t>(std::floor(range.max / step));
  for (std::int64_t k = first; k <= last; ++k) {
    if (run.stopped())
      return fail(kCancelled, fmt::format("{}: stopped while it was written", path.string()));
    const double level = static_cast<double>(k) * step;
    for (const ContourLine& line : tracer.trace(level)) {
      text.clear();
      append_dxf_polyline(text, "CONTOUR", line.points_mm, line.closed, level);
      file.write(text.data(), text.size());
    }
    run.progress(static_cast<double>(k - first + 1) / static_cast<double>(last - first + 1));
  }
  file.write(kDxfEnd);
  return file.commit();
}

}  // namespace maquette::exporting
