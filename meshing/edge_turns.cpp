// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/edge_turns.hpp"

#include <algorithm>

namespace maquette::meshing::detail {
namespace {

using Triangle = SurfaceTriangulation::Triangle;
constexpr std::uint32_t kNone = SurfaceTriangulation::kNone;
constexpr std::size_t kSquares = 3;  ///< the place among a triangle's products

struct Fit {
  double squares = 0.0, worst_mm = 0.0;
};

class EdgeTurns {
 public:
  EdgeTurns(SurfaceTriangulation& surface, double bound_mm)
      : surface_(surface), bound_mm_(bound_mm) {}

  std::uint64_t run() {
    for (std::uint32_t t = 0; t < surface_.triangles().size(); ++t)
      at(t).product[kSquares] = static_cast<float>(fit(at(t)).squares);
    std::uint64_t turned = 0;
    for (std::uint32_t t = 0; t < surface_.triangles().size(); ++t)
      for (std::size_t i = 0; i < 3; ++i)
        if (const std::uint32_t u = at(t).n[i]; u != kNone && u > t && turn(t, i, u)) {
          ++turned;
          break;  // the other edges have other corners now
        }
    return turned;
  }

 private:
  Triangle& at(std::uint32_t t) { return surface_.triangles()[t]; }

  [[nodiscard]] Fit fit(const Triangle& triangle) const {
    Fit sum;
    surface_.for_rows(
        triangle, false,
        [&](std::int32_t r, std::int32_t from, std::int32_t to, double z, double per_col) {
          const float* height = surface_.field().z_mm.row(r).data();
          for (std::int32_t k = from; k <= to; ++k) {
            const double off = std::abs(z + per_col * k - static_cast<double>(height[k]));
            sum.squares += off * off;
            sum.worst_mm = std::max(sum.worst_mm, off);
          }
        });
    return sum;
  }

  void relink(std::uint32_t of, std::uint32_t from, std::uint32_t to) {
    if (of == kNone) return;
    for (std::uint32_t& n : at(of).n)
      if (n == from) {
        n = to;
        return;
      }
  }

  bool turn(std::uint32_t t, std::size_t i, std::uint32_t u) {
    std::size_t j = 0;
    while (at(u).n[j] != t) ++j;
    const std::uint32_t p = at(t).v[i], b = at(t).v[(i + 1) % 3], c = at(t).v[(i + 2) % 3],
                        q = at(u).v[j];
    Triangle near, far;
    near.v = {p, b, q};
    far.v = {p, q, c};
    if (surface_.doubled_area(near) <= 0 || surface_.doubled_area(far) <= 0) return false;
    // Nodes on edges count twice; only a real gain is worth a change.
    constexpr double kGain = 0.999;
    const double before =
        static_cast<double>(at(t).product[kSquares]) + static_cast<double>(at(u).product[kSquares]);
    const Fit of_near = fit(near);
    if (of_near.worst_mm > bound_mm_ || of_near.squares >= kGain * before) return false;
    const Fit of_far = fit(far);
    if (of_far.worst_mm > bound_mm_ || of_near.squares + of_far.squares >= kGain * before)
      return false;
    const std::uint32_t past_b = at(u).n[(j + 1) % 3], past_c = at(u).n[(j + 2) % 3];
    const std::uint32_t before_c = at(t).n[(i + 1) % 3], before_b = at(t).n[(i + 2) % 3];
    near.n = {past_b, u, before_b};
    far.n = {past_c, before_c, t};
    near.product[kSquares] = static_cast<float>(of_near.squares);
    far.product[kSquares] = static_cast<float>(of_far.squares);
    at(t) = near;
    at(u) = far;
    relink(past_b, u, t);
    relink(before_c, t, u);
    return true;
  }

  SurfaceTriangulation& surface_;
  double bound_mm_;
};

}  // namespace

std::uint64_t turn_edges(SurfaceTriangulation& surface, double bound_mm) {
  return EdgeTurns(surface, bound_mm).run();
}

}  // namespace maquette::meshing::detail
