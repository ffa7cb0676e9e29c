// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/shell.hpp"

#include <atomic>

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using Triangle = std::array<std::uint32_t, 3>;

/// Rows handled between two looks at the stop token.
constexpr std::ptrdiff_t kRowsAtOnce = 64;

template <class Work>
void for_rows(std::ptrdiff_t rows, const RunContext& run, Work work) {
  tbb::parallel_for(tbb::blocked_range<std::ptrdiff_t>(0, rows, kRowsAtOnce),
                    [&](const tbb::blocked_range<std::ptrdiff_t>& range) {
                      if (run.stopped()) return;
                      for (std::ptrdiff_t r = range.begin(); r != range.end(); ++r) work(r);
                    });
}

/// Which vertex a node became, and where a row's cells begin in the triangle list.
/// Without patches that is plain arithmetic; with them two tables.
class Numbering {
 public:
  Numbering(const ModelField& field, const std::vector<Patch>& patches)
      : rows_(field.z_mm.rows()), cols_(field.z_mm.cols()) {
    if (patches.empty()) {
      nodes_ = static_cast<std::uint32_t>(rows_ * cols_);
      return;
    }
    index_.assign(static_cast<std::size_t>(rows_ * cols_), 0);
    first_cell_.resize(static_cast<std::size_t>(rows_));
    for (const Patch& p : patches) {
      for (std::ptrdiff_t r = p.block.row0 + 1; r < p.block.row1; ++r)
        for (std::ptrdiff_t c = p.block.col0 + 1; c < p.block.col1; ++c)
          index_[at(r, c)] = Patch::kNotANode;
      for (const std::uint32_t n : p.node)
        if (n != Patch::kNotANode) index_[n] = 0;
      for (std::ptrdiff_t r = p.block.row0; r < p.block.row1; ++r)
        first_cell_[static_cast<std::size_t>(r)] += p.block.col1 - p.block.col0;
    }
    for (std::uint32_t& i : index_)
      if (i != Patch::kNotANode) i = nodes_++;
    std::ptrdiff_t before = 0;
    for (std::ptrdiff_t& first : first_cell_) {
      const std::ptrdiff_t left = cols_ - 1 - first;
      first = before;
      before += left;
    }
  }

  [[nodiscard]] std::uint32_t nodes() const { return nodes_; }
  [[nodiscard]] std::uint32_t operator()(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return index_.empty() ? static_cast<std::uint32_t>(r * cols_ + c) : index_[at(r, c)];
  }
  [[nodiscard]] std::size_t first_cell(std::ptrdiff_t r) const {
    return static_cast<std::size_t>(first_cell_.empty() ? r * (cols_ - 1)
                                                        : first_cell_[static_cast<std::size_t>(r)]);
  }

 private:
  [[nodiscard]] std::size_t at(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<std::size_t>(r * cols_ + c);
  }
  std::ptrdiff_t rows_, cols_;
  std::uint32_t nodes_ = 0;
  std::vector<std::uint32_t> index_;
  std::vector<std::ptrdiff_t> first_cell_;
};

void add_walls_and_base(const ModelField& field, double base_z_mm, const Numbering& vertex_of,
                        TriMesh& mesh) {
  const std::ptrdiff_t rows = field.z_mm.rows();
  const std::ptrdiff_t cols = field.z_mm.cols();
  std::vector<std::array<std::ptrdiff_t, 2>> rim;  // counter-clockwise seen from above
  for (std::ptrdiff_t c = 0; c + 1 < cols; ++c) rim.push_back({0, c});
  for (std::ptrdiff_t r = 0; r + 1 < rows; ++r) rim.push_back({r, cols - 1});
  for (std::ptrdiff_t c = cols - 1; c > 0; --c) rim.push_back({rows - 1, c});
  for (std::ptrdiff_t r = rows - 1; r > 0; --r) rim.push_back({r, 0});

  const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  for (const auto& [r, c] : rim)
    mesh.vertices_mm.push_back({field.x_mm(c), field.y_mm(r), base_z_mm});
  const auto centre = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  mesh.vertices_mm.push_back({0.5 * (field.x_mm(0) + field.x_mm(cols - 1)),
                              0.5 * (field.y_mm(0) + field.y_mm(rows - 1)), base_z_mm});
  for (std::uint32_t i = 0; i < rim.size(); ++i) {
    const auto next = static_cast<std::uint32_t>((i + 1) % rim.size());
    const std::uint32_t top_i = vertex_of(rim[i][0], rim[i][1]);
    const std::uint32_t top_next = vertex_of(rim[next][0], rim[next][1]);
    // North and west the other diagonal, so that two solids side by side have the same wall.
    if (i < rim.size() / 2) {
      mesh.triangles.push_back({first + i, first + next, top_next});
      mesh.triangles.push_back({first + i, top_next, top_i});
    } else {
      mesh.triangles.push_back({first + i, first + next, top_i});
      mesh.triangles.push_back({first + next, top_next, top_i});
    }
    mesh.triangles.push_back({centre, first + next, first + i});
  }
}

}  // namespace

Result<void> check_no_voids(const Grid<float>& z, std::string_view before) {
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      if (!std::isfinite(z(r, c)))
        return fail(kSurfaceHasVoids,
                    fmt::format("the surface has a void at row {}, column {} (row 0 is the "
                                "southernmost); fill voids before {}",
                                r, c, before));
  return {};
}

Result<void> check_surface(const ModelField& surface, const SolidOptions& options) {
  const Grid<float>& z = surface.z_mm;
  MAQUETTE_CHECK(z.rows() >= 2 && z.cols() >= 2, "a field of {} x {} nodes has no cell", z.rows(),
                 z.cols());
  MAQUETTE_CHECK(z.rows() < std::ptrdiff_t{0xF0000000} / z.cols(),
                 "{} x {} nodes: more than 32 bit indices reach", z.rows(), z.cols());
  MAQUETTE_CHECK(surface.spacing.value() > 0.0, "spacing {} mm", surface.spacing.value());
  MAQUETTE_TRY_VOID(check_no_voids(z, "meshing"));
  const auto lowest = static_cast<double>(heightmap::height_range(z).min);
  const double base = options.base_z.value();
  if (!(base <= lowest - 1.0))
    return fail(kBaseTooThin,
                fmt::format("the base at {} mm is not 1 mm below the lowest node at {} mm; set it "
                            "to {} mm or lower",
                            base, lowest, lowest - 1.0));
  return {};
}

Result<TriMesh> close_shell(const ModelField& surface, double base_z_mm,
                            const std::vector<Patch>& patches, const RunContext& run) {
  const std::ptrdiff_t rows = surface.z_mm.rows();
  const std::ptrdiff_t cols = surface.z_mm.cols();
  const Numbering vertex_of(surface, patches);
  const std::size_t rim = 2 * static_cast<std::size_t>(rows + cols - 2);

  std::size_t vertices = vertex_of.nodes() + rim + 1;
  std::size_t cells = static_cast<std::size_t>((rows - 1) * (cols - 1));
  std::size_t patch_triangles = 0;
  for (const Patch& p : patches) {
    vertices += p.node.size();  // an upper bound, only for the reserve
    patch_triangles += p.mesh.triangles.size();
    cells -=
        static_cast<std::size_t>((p.block.row1 - p.block.row0) * (p.block.col1 - p.block.col0));
  }
  TriMesh mesh;
  mesh.vertices_mm.reserve(vertices);
  mesh.vertices_mm.resize(vertex_of.nodes());
  mesh.triangles.reserve(2 * cells + patch_triangles + 3 * rim);
  mesh.triangles.resize(2 * cells);

  // Blocks per row of cells are few; the row asks each.
  std::atomic<std::ptrdiff_t> rows_done{0};
  for_rows(rows, run, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      if (const std::uint32_t v = vertex_of(r, c); v != Patch::kNotANode)
        mesh.vertices_mm[v] = {surface.x_mm(c), surface.y_mm(r),
                               static_cast<double>(surface.z_mm(r, c))};
    if (r + 1 < rows) {
      std::vector<const CellBlock*> blocks;
      for (const Patch& p : patches)
        if (p.block.row0 <= r && r < p.block.row1) blocks.push_back(&p.block);
      Triangle* out = mesh.triangles.data() + 2 * vertex_of.first_cell(r);
      for (std::ptrdiff_t c = 0; c + 1 < cols; ++c) {
        const auto inside = [c](const CellBlock* b) { return b->col0 <= c && c < b->col1; };
        if (std::any_of(blocks.begin(), blocks.end(), inside)) continue;
        const std::uint32_t v00 = vertex_of(r, c);
        const std::uint32_t v10 = vertex_of(r, c + 1);
        const std::uint32_t v01 = vertex_of(r + 1, c);
        const std::uint32_t v11 = vertex_of(r + 1, c + 1);
        *out++ = {v00, v10, v11};
        *out++ = {v00, v11, v01};
      }
    }
    const std::ptrdiff_t done = ++rows_done;
    if (done % kRowsAtOnce == 0)
      run.progress(static_cast<double>(done) / static_cast<double>(rows));
  });
  if (run.stopped()) return fail(kCancelled, "meshing the surface was stopped");

  for (const Patch& p : patches) {
    std::vector<std::uint32_t> renamed(p.node.size());
    for (std::size_t i = 0; i < p.node.size(); ++i) {
      if (p.node[i] != Patch::kNotANode) {
        renamed[i] = vertex_of(p.node[i] / cols, p.node[i] % cols);
      } else {
        renamed[i] = static_cast<std::uint32_t>(mesh.vertices_mm.size());
        mesh.vertices_mm.push_back(p.mesh.vertices_mm[i]);
      }
    }
    for (const Triangle& t : p.mesh.triangles)
      mesh.triangles.push_back({renamed[t[0]], renamed[t[1]], renamed[t[2]]});
  }
  add_walls_and_base(surface, base_z_mm, vertex_of, mesh);
  run.progress(1.0);
  return mesh;
}

}  // namespace maquette::meshing::detail
