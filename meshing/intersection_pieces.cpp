// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/intersection_pieces.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using Triangle = std::array<std::uint32_t, 3>;

enum class Kind : std::uint8_t { other, plain, shell };

constexpr std::uint32_t kNoNode = UINT32_MAX;
/// Triangles of a square in the mean. Without a surface bases are in squares, too: long triangles
/// of a fan, which must not be in too many.
constexpr double kAimWithSurface = 4096.0, kAim = 65536.0;

template <class Work>
void for_each(std::size_t count, Work work) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 4096),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      for (std::size_t i = range.begin(); i != range.end(); ++i) work(i);
                    });
}

/// The node that a vertex is, to the bit: row * cols + col.
std::uint32_t node_of(const ModelField& f, CoordinateRounding rounding, Vec3 v) {
  const double s = f.spacing.value();
  const double c = std::round((v.x - f.x0.value()) / s), r = std::round((v.y - f.y0.value()) / s);
  if (!(c >= 0.0 && r >= 0.0 && c < static_cast<double>(f.z_mm.cols()) &&
        r < static_cast<double>(f.z_mm.rows())))
    return kNoNode;
  const auto col = static_cast<std::ptrdiff_t>(c), row = static_cast<std::ptrdiff_t>(r);
  if (rounded(f.x_mm(col), rounding) != v.x || rounded(f.y_mm(row), rounding) != v.y ||
      rounded(static_cast<double>(f.z_mm(row, col)), rounding) != v.z)
    return kNoNode;
  return static_cast<std::uint32_t>(row * f.z_mm.cols() + col);
}

/// Vertex by vertex; of those that are the same node only the first.
std::vector<std::uint32_t> nodes_of(const ModelField& f, CoordinateRounding rounding,
                                    const TriMesh& mesh) {
  std::vector<std::uint32_t> node(mesh.vertices_mm.size());
  for_each(node.size(),
           [&](std::size_t v) { node[v] = node_of(f, rounding, mesh.vertices_mm[v]); });
  std::vector<bool> taken(static_cast<std::size_t>(f.z_mm.rows() * f.z_mm.cols()), false);
  for (std::uint32_t& n : node) {
    if (n == kNoNode) continue;
    if (taken[n])
      n = kNoNode;
    else
      taken[n] = true;
  }
  return node;
}

/// Half a cell of the field, counter-clockwise from above.
bool is_half_cell(const std::array<std::uint32_t, 3>& node, std::uint32_t cols) {
  for (const std::uint32_t n : node)
    if (n == kNoNode) return false;
  for (std::size_t k = 0; k < 3; ++k) {  // from the south-western corner on
    const std::uint32_t a = node[k], b = node[(k + 1) % 3], c = node[(k + 2) % 3];
    if (a % cols + 1 < cols && c == a + cols + 1 && b == a + 1) return true;
    if (a % cols + 1 < cols && b == a + cols + 1 && c == a + cols) return true;
  }
  return false;
}

class Kinds {
 public:
  Kinds(const TriMesh& mesh, const ModelField* surface, CoordinateRounding rounding)
      : mesh_(mesh), box_(mesh.bounds()) {
    kind_.assign(mesh.triangles.size(), Kind::other);
    if (surface == nullptr || surface->z_mm.rows() < 2 || surface->z_mm.cols() < 2) return;
    const std::vector<std::uint32_t> node = nodes_of(*surface, rounding, mesh);
    const auto cols = static_cast<std::uint32_t>(surface->z_mm.cols());
    for_each(kind_.size(), [&](std::size_t i) {
      const Triangle& t = mesh_.triangles[i];
      if (is_half_cell({node[t[0]], node[t[1]], node[t[2]]}, cols) && above_base(t))
        kind_[i] = Kind::plain;
      else if ((planes(t[0]) & planes(t[1]) & planes(t[2])) != 0)
        kind_[i] = Kind::shell;
    });
    with_shell_ = true;
  }
  [[nodiscard]] Kind operator[](std::size_t i) const { return kind_[i]; }
  /// Whether there are shell triangles that this one could cut.
  [[nodiscard]] bool touches_shell(const Triangle& t) const {
    return with_shell_ && (planes(t[0]) | planes(t[1]) | planes(t[2])) != 0;
  }
  [[nodiscard]] const Box3& box() const { return box_; }

 private:
  /// A bit for each of the five planes that a vertex lies in.
  [[nodiscard]] unsigned planes(std::uint32_t v) const {
    const Vec3 p = mesh_.vertices_mm[v];
    return (p.x == box_.min.x ? 1U : 0U) | (p.x == box_.max.x ? 2U : 0U) |
           (p.y == box_.min.y ? 4U : 0U) | (p.y == box_.max.y ? 8U : 0U) |
           (p.z == box_.min.z ? 16U : 0U);
  }
  [[nodiscard]] bool above_base(const Triangle& t) const {
    return ((planes(t[0]) | planes(t[1]) | planes(t[2])) & 16U) == 0;
  }
  const TriMesh& mesh_;
  Box3 box_;
  std::vector<Kind> kind_;
  bool with_shell_ = false;
};

/// Squares of the box seen from above.
class Squares {
 public:
  Squares(const Box3& box, std::size_t triangles, double aim)
      : box_(box),
        side_(static_cast<std::size_t>(
            std::clamp(std::ceil(std::sqrt(static_cast<double>(triangles) / aim)), 1.0, 2048.0))) {}
  [[nodiscard]] std::size_t count() const { return side_ * side_; }
  /// Calls work(square) for all that the triangle's box meets. A coordinate's square never falls
  /// where the coordinate rises, so that no rounding parts a point from its triangle.
  template <class Work>
  void of(const TriMesh& mesh, const Triangle& t, Work work) const {
    const Vec3 a = mesh.vertices_mm[t[0]], b = mesh.vertices_mm[t[1]], c = mesh.vertices_mm[t[2]];
    const std::size_t x1 = at(std::max({a.x, b.x, c.x}), box_.min.x, box_.max.x),
                      y1 = at(std::max({a.y, b.y, c.y}), box_.min.y, box_.max.y);
    for (std::size_t y = at(std::min({a.y, b.y, c.y}), box_.min.y, box_.max.y); y <= y1; ++y)
      for (std::size_t x = at(std::min({a.x, b.x, c.x}), box_.min.x, box_.max.x); x <= x1; ++x)
        work(y * side_ + x);
  }

 private:
  [[nodiscard]] std::size_t at(double p, double from, double to) const {
    if (!(to > from)) return 0;
    const double square = (p - from) / (to - from) * static_cast<double>(side_);
    return std::min(static_cast<std::size_t>(square), side_ - 1);
  }
  Box3 box_;
  std::size_t side_;
};

}  // namespace

IntersectionPieces intersection_pieces(const TriMesh& mesh, const ModelField* surface,
                                       CoordinateRounding rounding) {
  const Kinds kinds(mesh, surface, rounding);
  const Squares squares(kinds.box(), mesh.triangles.size(),
                        surface != nullptr ? kAimWithSurface : kAim);
  std::vector<bool> wanted(squares.count(), false);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    if (kinds[i] == Kind::other)
      squares.of(mesh, mesh.triangles[i], [&](std::size_t s) { wanted[s] = true; });

  // The last piece is that of the shell.
  const std::size_t shell = squares.count();
  IntersectionPieces pieces;
  pieces.first.assign(shell + 2, 0);
  const auto for_each_place = [&](auto&& work) {
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const Triangle& t = mesh.triangles[i];
      if (kinds.touches_shell(t)) work(i, shell);
      if (kinds[i] == Kind::shell) continue;
      squares.of(mesh, t, [&](std::size_t s) {
        if (wanted[s]) work(i, s);
      });
    }
  };
  for_each_place([&](std::size_t, std::size_t piece) { ++pieces.first[piece + 1]; });
  for (std::size_t p = 1; p < pieces.first.size(); ++p) pieces.first[p] += pieces.first[p - 1];
  pieces.faces.resize(pieces.first.back());
  std::vector<std::size_t> next(pieces.first.begin(), pieces.first.end() - 1);
  for_each_place([&](std::size_t i, std::size_t piece) {
    pieces.faces[next[piece]++] = static_cast<std::uint32_t>(i);
  });
  return pieces;
}

}  // namespace maquette::meshing::detail
