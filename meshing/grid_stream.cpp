// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/grid_stream.hpp"

#include <cmath>
#include <numeric>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "meshing/detail/shell.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;

/// The rounded coordinates of columns or rows first .. last; fails where they do not rise.
Result<std::vector<double>> rounded_lines(const ModelField& field, bool columns,
                                          std::ptrdiff_t first, std::ptrdiff_t last,
                                          CoordinateRounding rounding) {
  std::vector<double> at;
  for (std::ptrdiff_t i = first; i <= last; ++i) {
    at.push_back(rounded(columns ? field.x_mm(i) : field.y_mm(i), rounding));
    if (i > first && !(at.back() > at[at.size() - 2]))
      return fail(
          kRoundingCollapses,
          fmt::format("{0}s {1} and {2} both become {3} = {4} mm in this file format: their "
                      "spacing of {5} mm is too small at that distance from the origin; "
                      "write PLY, or move the origin nearer",
                      columns ? "column" : "row", i - 1, i, columns ? 'x' : 'y', at.back(),
                      field.spacing.value()));
  }
  return at;
}

struct Sums {
  double volume_mm3 = 0.0, area_mm2 = 0.0, squares_mm2 = 0.0;
  double worst_height_mm = 0.0, worst_move_mm = 0.0;
};

/// Corners relative to the first one.
double area_of(Vec3 b, Vec3 c) {
  return 0.5 * norm(cross(b, c));
}

double total(const std::vector<Sums>& rows, double Sums::*member) {
  return std::accumulate(rows.begin(), rows.end(), 0.0,
                         [member](double sum, const Sums& s) { return sum + s.*member; });
}

double worst(const std::vector<Sums>& rows, double Sums::*member) {
  return std::accumulate(rows.begin(), rows.end(), 0.0, [member](double most, const Sums& s) {
    return std::fmax(most, s.*member);
  });
}

/// One row of nodes of the window and the cells north of it, as the file has them.
class RowSums {
 public:
  RowSums(const ModelField& field, const NodeWindow& window, const std::vector<double>& x,
          const std::vector<double>& y, double base, CoordinateRounding rounding)
      : field_(field), window_(window), x_(x), y_(y), base_(base), rounding_(rounding) {}

  [[nodiscard]] Sums operator()(std::ptrdiff_t r) const {
    Sums s;
    for (std::ptrdiff_t c = 0; c < window_.cols(); ++c) add_node(r, c, s);
    if (r + 1 == window_.rows()) return s;
    const double dy = y_[at(r + 1)] - y_[at(r)];
    for (std::ptrdiff_t c = 0; c + 1 < window_.cols(); ++c) {
      const double dx = x_[at(c + 1)] - x_[at(c)];
      const double z = height(r, c), east = height(r, c + 1) - z, north = height(r + 1, c) - z,
                   across = height(r + 1, c + 1) - z;
      s.volume_mm3 += dx * dy * (z - base_ + (east + 2.0 * across + north) / 6.0);
      s.area_mm2 += area_of({dx, 0.0, east}, {dx, dy, across});
      s.area_mm2 += area_of({dx, dy, across}, {0.0, dy, north});
    }
    return s;
  }

  /// The highest node is no help: one that reaches the base is.
  [[nodiscard]] bool above_base(std::ptrdiff_t r) const {
    for (std::ptrdiff_t c = 0; c < window_.cols(); ++c)
      if (!(height(r, c) > base_)) return false;
    return true;
  }

 private:
  static std::size_t at(std::ptrdiff_t i) { return static_cast<std::size_t>(i); }
  [[nodiscard]] double raw(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<double>(field_.z_mm(window_.row0 + r, window_.col0 + c));
  }
  [[nodiscard]] double height(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return rounded(raw(r, c), rounding_);
  }
  void add_node(std::ptrdiff_t r, std::ptrdiff_t c, Sums& s) const {
    const double x = x_[at(c)], y = y_[at(r)], z = height(r, c);
    const Vec3 move{x - field_.x_mm(window_.col0 + c), y - field_.y_mm(window_.row0 + r),
                    z - raw(r, c)};
    if (move == Vec3{}) return;
    s.worst_move_mm = std::fmax(s.worst_move_mm, norm(move));
    const double off = z - heightmap::height_at(field_, x, y);
    if (std::isnan(off)) return;  // rounded out of the field by less than a rounding step
    s.worst_height_mm = std::fmax(s.worst_height_mm, std::abs(off));
    s.squares_mm2 += off * off;
  }
  const ModelField& field_;
  NodeWindow window_;
  const std::vector<double>&x_, &y_;
  double base_;
  CoordinateRounding rounding_;
};

}  // namespace

double rounded(double coordinate_mm, CoordinateRounding rounding) {
  switch (rounding) {
    case CoordinateRounding::float32:
      return static_cast<double>(static_cast<float>(coordinate_mm));
    case CoordinateRounding::micro:
      return std::round(coordinate_mm * 1e6) / 1e6;
    case CoordinateRounding::lib3mf: {
      const float millionths = static_cast<float>(coordinate_mm) * 1e6F;
      return std::trunc(static_cast<double>(millionths)) / 1e6;
    }
    case CoordinateRounding::none:
      break;
  }
  return coordinate_mm;
}

ModelField window_field(const ModelField& surface, const NodeWindow& window) {
  ModelField part{Grid<float>(window.rows(), window.cols()), surface.spacing,
                  Millimetres{surface.x_mm(window.col0)}, Millimetres{surface.y_mm(window.row0)}};
  for (std::ptrdiff_t r = 0; r < window.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < window.cols(); ++c)
      part.z_mm(r, c) = surface.z_mm(window.row0 + r, window.col0 + c);
  return part;
}

double rounding_displacement_mm(const MeshStream& mesh, CoordinateRounding rounding) {
  if (rounding == CoordinateRounding::none) return 0.0;
  double most = 0.0;
  std::vector<Vec3> piece(4096);
  for (std::uint64_t first = 0; first < mesh.vertex_count(); first += piece.size()) {
    const std::span<Vec3> part(piece.data(),
                               std::min<std::uint64_t>(piece.size(), mesh.vertex_count() - first));
    mesh.vertices(first, part);
    for (const Vec3& v : part)
      most = std::fmax(most, norm(Vec3{rounded(v.x, rounding) - v.x, rounded(v.y, rounding) - v.y,
                                       rounded(v.z, rounding) - v.z}));
  }
  return most;
}

Result<GridSolidStream> GridSolidStream::create(const ModelField& surface,
                                                const SolidOptions& options) {
  return create(surface, all_nodes(surface), options);
}

Result<GridSolidStream> GridSolidStream::create(const ModelField& surface, const NodeWindow& window,
                                                const SolidOptions& options) {
  MAQUETTE_TRY_VOID(detail::check_surface(surface, options));
  MAQUETTE_CHECK(0 <= window.row0 && window.row0 < window.row1 &&
                     window.row1 < surface.z_mm.rows() && 0 <= window.col0 &&
                     window.col0 < window.col1 && window.col1 < surface.z_mm.cols(),
                 "rows {} .. {}, columns {} .. {} of {} x {} nodes", window.row0, window.row1,
                 window.col0, window.col1, surface.z_mm.rows(), surface.z_mm.cols());
  return GridSolidStream(surface, window, options.base_z.value());
}

std::uint64_t GridSolidStream::rim_count() const {
  return 2 * static_cast<std::uint64_t>(rows() + cols() - 2);
}
std::uint64_t GridSolidStream::top_count() const {
  return 2 * static_cast<std::uint64_t>((rows() - 1) * (cols() - 1));
}
std::uint64_t GridSolidStream::vertex_count() const {
  return static_cast<std::uint64_t>(rows() * cols()) + rim_count() + 1;
}
std::uint64_t GridSolidStream::triangle_count() const {
  return top_count() + 3 * rim_count();
}

GridSolidStream::Node GridSolidStream::rim(std::uint64_t i) const {
  const std::ptrdiff_t last_row = rows() - 1, last_col = cols() - 1;
  auto k = static_cast<std::ptrdiff_t>(i);
  if (k < last_col) return {0, k};
  k -= last_col;
  if (k < last_row) return {k, last_col};
  k -= last_row;
  if (k < last_col) return {last_row, last_col - k};
  return {last_row - (k - last_col), 0};
}

std::uint32_t GridSolidStream::node_index(Node n) const {
  return static_cast<std::uint32_t>(n.row * cols() + n.col);
}

Vec3 GridSolidStream::vertex(std::uint64_t i) const {
  const std::ptrdiff_t rows = this->rows(), cols = this->cols();
  const auto nodes = static_cast<std::uint64_t>(rows * cols);
  if (i < nodes) {
    const auto k = static_cast<std::ptrdiff_t>(i);
    return {x_at(k % cols), y_at(k / cols), static_cast<double>(z_at(k / cols, k % cols))};
  }
  if (i < nodes + rim_count()) {
    const Node n = rim(i - nodes);
    return {x_at(n.col), y_at(n.row), base_z_mm_};
  }
  return {0.5 * (x_at(0) + x_at(cols - 1)), 0.5 * (y_at(0) + y_at(rows - 1)), base_z_mm_};
}

MeshStream::Triangle GridSolidStream::wall_or_base(std::uint64_t i) const {
  const std::uint64_t k = i / 3, next = (k + 1) % rim_count();
  const auto first = static_cast<std::uint32_t>(rows() * cols());
  const auto low = first + static_cast<std::uint32_t>(k);
  const auto low_next = first + static_cast<std::uint32_t>(next);
  if (i % 3 == 2) return {first + static_cast<std::uint32_t>(rim_count()), low_next, low};
  const std::uint32_t high = node_index(rim(k)), high_next = node_index(rim(next));
  if (k < rim_count() / 2)
    return i % 3 == 0 ? Triangle{low, low_next, high_next} : Triangle{low, high_next, high};
  return i % 3 == 0 ? Triangle{low, low_next, high} : Triangle{low_next, high_next, high};
}

void GridSolidStream::vertices(std::uint64_t first, std::span<Vec3> out) const {
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = vertex(first + i);
}

void GridSolidStream::triangles(std::uint64_t first, std::span<Triangle> out) const {
  const auto cells = static_cast<std::uint64_t>(cols() - 1);
  const auto cols = static_cast<std::uint32_t>(cells + 1);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const std::uint64_t t = first + i;
    if (t >= top_count()) {
      out[i] = wall_or_base(t - top_count());
      continue;
    }
    const std::uint64_t cell = t / 2;
    const auto v = static_cast<std::uint32_t>(cell / cells * cols + cell % cells);
    if (t % 2 == 0)
      out[i] = {v, v + 1, v + cols + 1};
    else
      out[i] = {v, v + cols + 1, v + cols};
  }
}

void GridSolidStream::corners(std::uint64_t first, std::span<Corners> out) const {
  const auto cells = static_cast<std::uint64_t>(cols() - 1);
  auto r = static_cast<std::ptrdiff_t>(first / 2 / cells);
  auto c = static_cast<std::ptrdiff_t>(first / 2 % cells);
  std::size_t i = 0;
  for (; i < out.size() && first + i < top_count(); ++i) {
    const auto node = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
      return Vec3{x_at(col), y_at(row), static_cast<double>(z_at(row, col))};
    };
    if ((first + i) % 2 == 0) {
      out[i] = {node(r, c), node(r, c + 1), node(r + 1, c + 1)};
      continue;
    }
    out[i] = {node(r, c), node(r + 1, c + 1), node(r + 1, c)};
    if (++c == static_cast<std::ptrdiff_t>(cells)) {
      c = 0;
      ++r;
    }
  }
  for (; i < out.size(); ++i) {
    const Triangle t = wall_or_base(first + i - top_count());
    out[i] = {vertex(t[0]), vertex(t[1]), vertex(t[2])};
  }
}

Result<MeshCertificate> GridSolidStream::certify(CoordinateRounding rounding,
                                                 const RunContext& run) const {
  const std::ptrdiff_t rows = this->rows(), cols = this->cols();
  MAQUETTE_TRY(const std::vector<double> x,
               rounded_lines(*surface_, true, window_.col0, window_.col1, rounding));
  MAQUETTE_TRY(const std::vector<double> y,
               rounded_lines(*surface_, false, window_.row0, window_.row1, rounding));
  const double base = rounded(base_z_mm_, rounding);
  const RowSums row_sums(*surface_, window_, x, y, base, rounding);
  std::vector<Sums> of_row(static_cast<std::size_t>(rows));
  std::vector<char> sound(of_row.size(), 0);
  oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<std::size_t>(0, of_row.size()),
                            [&](const oneapi::tbb::blocked_range<std::size_t>& range) {
                              if (run.stopped()) return;
                              for (std::size_t r = range.begin(); r != range.end(); ++r) {
                                const auto row = static_cast<std::ptrdiff_t>(r);
                                of_row[r] = row_sums(row);
                                sound[r] = row_sums.above_base(row);
                              }
                            });
  if (run.stopped()) return fail(kCancelled, "checking the solid was stopped");
  for (std::size_t r = 0; r < sound.size(); ++r)
    if (!sound[r])
      return fail(kRoundingCollapses,
                  fmt::format("row {}: a node becomes as low as the base at {} mm in this file "
                              "format; write PLY, or move the origin nearer",
                              r, base));

  MeshCertificate c;
  c.proof = "graph of a height";
  c.vertices = vertex_count();
  c.triangles = triangle_count();
  c.manifold = c.closed = c.oriented_outward = c.self_intersection_checked = true;
  c.shells = 1;
  c.euler_number = 2;
  c.volume_mm3 = total(of_row, &Sums::volume_mm3);
  c.area_mm2 = total(of_row, &Sums::area_mm2) + (x.back() - x.front()) * (y.back() - y.front());
  for (std::uint64_t i = 0; i < rim_count(); ++i) {
    const Node a = rim(i), b = rim((i + 1) % rim_count());
    const auto at = [](const std::vector<double>& lines, std::ptrdiff_t n) {
      return lines[static_cast<std::size_t>(n)];
    };
    const double width = std::abs(at(x, a.col) - at(x, b.col)) +  // one of the two is zero
                         std::abs(at(y, a.row) - at(y, b.row));
    const auto above = [&](Node n) {
      return rounded(static_cast<double>(z_at(n.row, n.col)), rounding) - base;
    };
    c.area_mm2 += 0.5 * width * (above(a) + above(b));
  }
  c.vertices_compared = static_cast<std::uint64_t>(rows * cols);
  c.max_vertical_error_mm = worst(of_row, &Sums::worst_height_mm);
  c.rms_vertical_error_mm =
      std::sqrt(total(of_row, &Sums::squares_mm2) / static_cast<double>(c.vertices_compared));
  c.rounding_mm = worst(of_row, &Sums::worst_move_mm);
  c.hausdorff_bound_mm = c.rounding_mm;
  run.progress(1.0);
  return c;
}

}  // namespace maquette::meshing
