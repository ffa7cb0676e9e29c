// SPDX-License-Identifier: GPL-3.0-or-later
#include <unordered_map>

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>
#include <fmt/format.h>

#include "meshing/detail/patch_soundness.hpp"
#include "meshing/detail/stone_cap.hpp"

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangle = std::array<std::uint32_t, 3>;
enum class Side : char { unknown, terrain, cap };
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<std::uint32_t, Kernel>;
using FaceBase = CGAL::Constrained_triangulation_face_base_2<
    Kernel, CGAL::Triangulation_face_base_with_info_2<Side, Kernel>>;
using Delaunay = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>,
    CGAL::No_constraint_intersection_tag>;

/// The cells under the cap and two more on each side, as far as the field goes.
CellBlock block_under(const ModelField& field, const StoneCap& cap) {
  Box3 box;
  for (const Vec3& v : cap.contoured_mm) box.add(v);
  for (const Vec3& v : cap.projected_mm) box.add(v);
  const double s = field.spacing.value();
  const auto cell = [s](double x, double x0) {
    return static_cast<std::ptrdiff_t>(std::floor((x - x0) / s));
  };
  return {std::max<std::ptrdiff_t>(cell(box.min.y, field.y0.value()) - 2, 0),
          std::min(cell(box.max.y, field.y0.value()) + 3, field.z_mm.rows() - 1),
          std::max<std::ptrdiff_t>(cell(box.min.x, field.x0.value()) - 2, 0),
          std::min(cell(box.max.x, field.x0.value()) + 3, field.z_mm.cols() - 1)};
}

double distance_to_segment(double px, double py, Vec3 a, Vec3 b) {
  const double dx = b.x - a.x;
  const double dy = b.y - a.y;
  const double along = ((px - a.x) * dx + (py - a.y) * dy) / std::fmax(dx * dx + dy * dy, 1e-300);
  const double t = std::clamp(along, 0.0, 1.0);
  return std::hypot(px - a.x - t * dx, py - a.y - t * dy);
}

/// Triangulates the block between the cap's rim and the block's border.
class TerrainRound {
 public:
  TerrainRound(const ModelField& field, const StoneCap& cap, const CellBlock& block,
               double keep_off_mm)
      : field_(field),
        cap_(cap),
        block_(block),
        rows_(block.row1 - block.row0 + 1),
        cols_(block.col1 - block.col0 + 1),
        node_free_(rows_, cols_, 1),
        cell_free_(rows_ - 1, cols_ - 1, 1) {
    keep_off_rim(keep_off_mm);
  }

  /// @return empty, or why it did not work
  [[nodiscard]] std::string build(Patch& patch) {
    for (std::ptrdiff_t i = 0; i < rows_; ++i)
      for (std::ptrdiff_t j = 0; j < cols_; ++j)
        if (on_border(i, j) && !node_free_(i, j)) return "it reaches the surface's outline";
    insert_points();
    insert_constraints();
    if (std::string why = mark(); !why.empty()) return why;
    emit(patch);
    return {};
  }

 private:
  [[nodiscard]] bool on_border(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return i == 0 || j == 0 || i == rows_ - 1 || j == cols_ - 1;
  }
  [[nodiscard]] double x(std::ptrdiff_t j) const { return field_.x_mm(block_.col0 + j); }
  [[nodiscard]] double y(std::ptrdiff_t i) const { return field_.y_mm(block_.row0 + i); }

  void keep_off_rim(double keep_off_mm) {
    const double s = field_.spacing.value();
    for (const Edge& e : cap_.rim) {
      const Vec3 a = cap_.contoured_mm[e[0]];
      const Vec3 b = cap_.contoured_mm[e[1]];
      const auto first = [&](double p, double from) {
        return static_cast<std::ptrdiff_t>(std::floor((p - keep_off_mm - from) / s));
      };
      const auto last = [&](double p, double from) {
        return static_cast<std::ptrdiff_t>(std::floor((p + keep_off_mm - from) / s));
      };
      const std::ptrdiff_t i1 = last(std::fmax(a.y, b.y), y(0)) + 1;
      const std::ptrdiff_t j1 = last(std::fmax(a.x, b.x), x(0)) + 1;
      for (std::ptrdiff_t i = first(std::fmin(a.y, b.y), y(0)); i <= i1; ++i)
        for (std::ptrdiff_t j = first(std::fmin(a.x, b.x), x(0)); j <= j1; ++j) {
          if (i < i1 && j < j1 && cell_free_.contains(i, j)) cell_free_(i, j) = 0;
          if (node_free_.contains(i, j) && distance_to_segment(x(j), y(i), a, b) < keep_off_mm)
            node_free_(i, j) = 0;
        }
    }
  }

  void insert_points() {
    const auto caps = static_cast<std::uint32_t>(cap_.contoured_mm.size());
    node_vertex_ = Grid<Delaunay::Vertex_handle>(rows_, cols_);
    Delaunay::Face_handle near;
    for (std::ptrdiff_t i = 0; i < rows_; ++i)
      for (std::ptrdiff_t j = 0; j < cols_; ++j) {
        if (!node_free_(i, j)) continue;
        const auto v = delaunay_.insert({x(j), y(i)}, near);
        v->info() = caps + static_cast<std::uint32_t>(i * cols_ + j);
        near = v->face();
        node_vertex_(i, j) = v;
      }
    rim_vertex_.resize(caps);
    for (const Edge& e : cap_.rim) {
      const Vec3 p = cap_.contoured_mm[e[0]];
      const auto v = delaunay_.insert({p.x, p.y}, near);
      v->info() = e[0];
      near = v->face();
      rim_vertex_[e[0]] = v;
    }
  }

  /// The border, the field's own diagonals in cells that the rim leaves alone, the rim.
  void insert_constraints() {
    for (std::ptrdiff_t j = 0; j + 1 < cols_; ++j)
      for (const std::ptrdiff_t i : {std::ptrdiff_t{0}, rows_ - 1})
        delaunay_.insert_constraint(node_vertex_(i, j), node_vertex_(i, j + 1));
    for (std::ptrdiff_t i = 0; i + 1 < rows_; ++i)
      for (const std::ptrdiff_t j : {std::ptrdiff_t{0}, cols_ - 1})
        delaunay_.insert_constraint(node_vertex_(i, j), node_vertex_(i + 1, j));
    for (std::ptrdiff_t i = 0; i + 1 < rows_; ++i)
      for (std::ptrdiff_t j = 0; j + 1 < cols_; ++j)
        if (cell_free_(i, j) && node_free_(i, j) && node_free_(i + 1, j + 1))
          delaunay_.insert_constraint(node_vertex_(i, j), node_vertex_(i + 1, j + 1));
    for (const Edge& e : cap_.rim)
      delaunay_.insert_constraint(rim_vertex_[e[0]], rim_vertex_[e[1]]);
  }

  /// Floods from the rim: terrain lies to the right of its edges, cap to the left.
  [[nodiscard]] std::string mark() {
    std::unordered_map<Edge, char, EdgeHash> rim;
    for (const Edge& e : cap_.rim) rim[{std::min(e[0], e[1]), std::max(e[0], e[1])}] = 1;
    std::vector<Delaunay::Face_handle> queue;
    const auto put = [&](Delaunay::Face_handle f, Side side) {
      if (delaunay_.is_infinite(f)) return side == Side::terrain;
      if (f->info() == Side::unknown) {
        f->info() = side;
        queue.push_back(f);
      }
      return f->info() == side;
    };
    for (auto f : delaunay_.finite_face_handles()) f->info() = Side::unknown;
    constexpr const char* kCrossed = "its rim crosses itself seen from above";
    for (const Edge& e : cap_.rim) {
      Delaunay::Face_handle f;
      int i = 0;
      if (!delaunay_.is_edge(rim_vertex_[e[0]], rim_vertex_[e[1]], f, i)) return kCrossed;
      // f lies to the left of e[0] -> e[1] if its vertices follow each other so.
      const bool left = f->vertex(Delaunay::ccw(i)) == rim_vertex_[e[0]];
      const auto other = f->neighbor(i);
      if (!put(left ? f : other, Side::cap) || !put(left ? other : f, Side::terrain))
        return kCrossed;
    }
    while (!queue.empty()) {
      const auto f = queue.back();
      queue.pop_back();
      for (int i = 0; i < 3; ++i) {
        const std::uint32_t a = f->vertex(Delaunay::ccw(i))->info();
        const std::uint32_t b = f->vertex(Delaunay::cw(i))->info();
        if (rim.contains({std::min(a, b), std::max(a, b)})) continue;
        if (!put(f->neighbor(i), f->info())) return kCrossed;
      }
    }
    return {};
  }

  /// Cap vertices first, then the nodes that the terrain's triangles use.
  void emit(Patch& patch) const {
    const std::size_t caps = cap_.contoured_mm.size();
    patch.block = block_;
    patch.mesh.vertices_mm = cap_.contoured_mm;
    patch.node.assign(caps, Patch::kNotANode);
    patch.mesh.triangles = cap_.triangles;
    std::vector<Triangle> terrain;
    for (const auto f : delaunay_.finite_face_handles()) {
      if (f->info() != Side::terrain) continue;
      Triangle t{f->vertex(0)->info(), f->vertex(1)->info(), f->vertex(2)->info()};
      std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
      terrain.push_back(t);
    }
    std::sort(terrain.begin(), terrain.end());
    std::vector<std::uint32_t> renamed(static_cast<std::size_t>(rows_ * cols_), Patch::kNotANode);
    for (Triangle t : terrain) {
      for (std::uint32_t& v : t) {
        if (v < caps) continue;
        std::uint32_t& name = renamed[v - caps];
        if (name == Patch::kNotANode) {
          name = static_cast<std::uint32_t>(patch.node.size());
          const auto r = block_.row0 + static_cast<std::ptrdiff_t>(v - caps) / cols_;
          const auto c = block_.col0 + static_cast<std::ptrdiff_t>(v - caps) % cols_;
          patch.node.push_back(static_cast<std::uint32_t>(r * field_.z_mm.cols() + c));
          patch.mesh.vertices_mm.push_back(
              {field_.x_mm(c), field_.y_mm(r), static_cast<double>(field_.z_mm(r, c))});
        }
        v = name;
      }
      patch.mesh.triangles.push_back(t);
    }
  }

  const ModelField& field_;
  const StoneCap& cap_;
  CellBlock block_;
  std::ptrdiff_t rows_, cols_;
  Grid<char> node_free_;  ///< far enough from the rim to be a vertex
  Grid<char> cell_free_;  ///< the rim does not come near
  Delaunay delaunay_;
  Grid<Delaunay::Vertex_handle> node_vertex_;
  std::vector<Delaunay::Vertex_handle> rim_vertex_;
};

}  // namespace

Result<Patch> fit_cap(const ModelField& surface, const StoneCap& cap, const CellBlock& reach,
                      double voxel_mm) try {
  const CellBlock block = block_under(surface, cap);
  if (block.row0 < reach.row0 || block.row1 > reach.row1 || block.col0 < reach.col0 ||
      block.col1 > reach.col1)
    return fail(kNotASolid, "it reaches too far");
  // From here on the rim's height is the terrain's.
  StoneCap on_terrain = cap;
  for (const Edge& e : cap.rim) on_terrain.contoured_mm[e[0]] = cap.projected_mm[e[0]];
  Patch patch;
  const double keep_off = 0.25 * std::fmin(surface.spacing.value(), voxel_mm);
  if (std::string why = TerrainRound(surface, on_terrain, block, keep_off).build(patch);
      !why.empty())
    return fail(kNotASolid, std::move(why));
  std::vector<Vec3> goal = patch.mesh.vertices_mm;
  std::copy(cap.projected_mm.begin(), cap.projected_mm.end(), goal.begin());
  if (std::string why = keep_manifold_sheet(surface, patch, goal); !why.empty())
    return fail(kNotASolid, std::move(why));
  if (std::string why = settle(patch.mesh, goal); !why.empty())
    return fail(kNotASolid, std::move(why));
  return patch;
} catch (const std::exception& e) {
  return fail(kNotASolid,
              fmt::format("the rim could not be fitted into the terrain ({})", e.what()));
}

}  // namespace maquette::meshing::detail
