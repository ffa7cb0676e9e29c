// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/contours.hpp"
#include "export/limits.hpp"
#include "export/text_lines.hpp"

namespace maquette::exporting {
namespace {

/// More lines than a person can tell apart; a larger number is a slip of the unit.
constexpr double kMaxLevels = 10'000;

void append_coordinate(fmt::memory_buffer& out, std::string_view group, double value) {
  append_text(out, group);
  append_micro(out, value);
  out.push_back('\n');
}

void append_polyline(fmt::memory_buffer& out, std::string_view layer, const ContourLine& line,
                     double z) {
  append_text(out, "0\nPOLYLINE\n8\n");
  append_text(out, layer);
  append_text(out, "\n66\n1\n10\n0.0\n20\n0.0\n");
  append_coordinate(out, "30\n", z);
  append_text(out, line.closed ? "70\n1\n" : "70\n0\n");
  for (const auto& p : line.points_mm) {
    append_text(out, "0\nVERTEX\n8\n");
    append_text(out, layer);
    out.push_back('\n');
    append_coordinate(out, "10\n", p[0]);
    append_coordinate(out, "20\n", p[1]);
    append_coordinate(out, "30\n", z);
  }
  append_text(out, "0\nSEQEND\n8\n");
  append_text(out, layer);
  out.push_back('\n');
}

ContourLine outline(const heightmap::ModelField& f) {
  const double x0 = f.x_mm(0), x1 = f.x_mm(f.z_mm.cols() - 1);
  const double y0 = f.y_mm(0), y1 = f.y_mm(f.z_mm.rows() - 1);
  return {{{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}, true};
}

std::string header(const ContourLine& border, double z_min, double z_max) {
  const auto lo = border.points_mm[0], hi = border.points_mm[2];
  return fmt::format(
      "999\nmaquette: contour lines, model frame x east y north z up, millimetres\n"
      "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n"
      "9\n$EXTMIN\n10\n{:.6f}\n20\n{:.6f}\n30\n{:.6f}\n"
      "9\n$EXTMAX\n10\n{:.6f}\n20\n{:.6f}\n30\n{:.6f}\n0\nENDSEC\n"
      "0\nSECTION\n2\nTABLES\n"
      "0\nTABLE\n2\nLTYPE\n70\n1\n0\nLTYPE\n2\nCONTINUOUS\n70\n0\n3\nSolid line\n72\n65\n73\n0\n"
      "40\n0.0\n0\nENDTAB\n"
      "0\nTABLE\n2\nLAYER\n70\n2\n"
      "0\nLAYER\n2\nCONTOUR\n70\n0\n62\n3\n6\nCONTINUOUS\n"
      "0\nLAYER\n2\nOUTLINE\n70\n0\n62\n7\n6\nCONTINUOUS\n0\nENDTAB\n0\nENDSEC\n"
      "0\nSECTION\n2\nENTITIES\n",
      lo[0], lo[1], z_min, hi[0], hi[1], z_max);
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
  append_polyline(text, "OUTLINE", border, 0.0);
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
      append_polyline(text, "CONTOUR", line, level);
      file.write(text.data(), text.size());
    }
    run.progress(static_cast<double>(k - first + 1) / static_cast<double>(last - first + 1));
  }
  file.write("0\nENDSEC\n0\nEOF\n");
  return file.commit();
}

}  // namespace maquette::exporting
