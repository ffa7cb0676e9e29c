// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/height_fit.hpp"

#include <algorithm>

namespace maquette::meshing::detail {
namespace {

using Triangle = SurfaceTriangulation::Triangle;
using Vertex = SurfaceTriangulation::Vertex;

class HeightFit {
 public:
  HeightFit(SurfaceTriangulation& surface, double bound_mm)
      : surface_(surface), bound_mm_(bound_mm), count_(surface.vertices().size()) {}

  void run() {
    assemble();
    solve();
    apply();
  }

 private:
  static constexpr int kRounds = 6;    ///< of conjugate gradients
  static constexpr int kHalvings = 5;  ///< then the corner stays

  /// Products of the corners' weights summed over the nodes, and of weights and what is missing.
  void assemble() {
    diagonal_.assign(count_, 0.0F);
    missing_.assign(count_, 0.0F);
    for (std::uint32_t t = 0; t < surface_.triangles().size(); ++t) {
      Triangle& triangle = surface_.triangles()[t];
      std::array<double, 3> square{}, product{}, pull{};
      const Vertex &a = surface_.vertices()[triangle.v[0]], &b = surface_.vertices()[triangle.v[1]],
                   &c = surface_.vertices()[triangle.v[2]];
      const double r1 = b.row - a.row, c1 = b.col - a.col, r2 = c.row - a.row, c2 = c.col - a.col;
      const double per_area = 1.0 / (c1 * r2 - r1 * c2);
      // Weights of the corners change by this from column to column.
      const std::array<double, 3> change{(r1 - r2) * per_area, r2 * per_area, -r1 * per_area};
      surface_.for_rows(
          triangle, true,
          [&](std::int32_t r, std::int32_t from, std::int32_t to, double z, double per_col) {
            const float* height = surface_.field().z_mm.row(r).data() + from;
            double off = 0.0, off_columns = 0.0;
            const double first = z + per_col * from;
            for (std::int32_t k = 0; k <= to - from; ++k) {
              const double here = static_cast<double>(height[k]) - (first + per_col * k);
              off += here;
              off_columns += here * k;
            }
            const double dr = r - a.row, dc = from - a.col;
            const double w1 = (dc * r2 - dr * c2) * per_area, w2 = (c1 * dr - r1 * dc) * per_area;
            const std::array<double, 3> w{1.0 - w1 - w2, w1, w2};
            const double n = to - from + 1, sum = 0.5 * n * (n - 1.0),
                         squares = sum * (2.0 * n - 1.0) / 3.0;  // of 0 .. n - 1
            for (std::size_t i = 0; i < 3; ++i) {
              const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
              square[i] +=
                  n * w[i] * w[i] + 2.0 * sum * w[i] * change[i] + squares * change[i] * change[i];
              product[i] += n * w[j] * w[k] + sum * (w[j] * change[k] + w[k] * change[j]) +
                            squares * change[j] * change[k];
              pull[i] += w[i] * off + change[i] * off_columns;
            }
          });
      for (std::size_t i = 0; i < 3; ++i) {
        triangle.product[i] = static_cast<float>(product[i]);
        diagonal_[triangle.v[i]] += static_cast<float>(square[i]);
        missing_[triangle.v[i]] += static_cast<float>(pull[i]);
      }
    }
    for (std::uint32_t v = 0; v < count_; ++v)
      if (surface_.on_border(surface_.vertices()[v])) diagonal_[v] = 0.0F;
  }

  void multiply(const std::vector<float>& x, std::vector<float>& y) {
    for (std::uint32_t v = 0; v < count_; ++v) y[v] = diagonal_[v] * x[v];
    for (std::uint32_t t = 0; t < surface_.triangles().size(); ++t) {
      const Triangle& triangle = surface_.triangles()[t];
      const auto [a, b, c] = triangle.v;
      y[a] += triangle.product[2] * x[b] + triangle.product[1] * x[c];
      y[b] += triangle.product[2] * x[a] + triangle.product[0] * x[c];
      y[c] += triangle.product[1] * x[a] + triangle.product[0] * x[b];
    }
  }

  /// Of vertices that may move; the others have no diagonal.
  void solve() {
    move_.assign(count_, 0.0F);
    std::vector<float> along(count_), image(count_);
    double before = 0.0;
    for (std::uint32_t v = 0; v < count_; ++v) {
      if (diagonal_[v] == 0.0F) missing_[v] = 0.0F;
      along[v] = diagonal_[v] > 0.0F ? missing_[v] / diagonal_[v] : 0.0F;
      before += static_cast<double>(along[v]) * static_cast<double>(missing_[v]);
    }
    for (int round = 0; round < kRounds && before > 0.0; ++round) {
      multiply(along, image);
      double bend = 0.0;
      for (std::uint32_t v = 0; v < count_; ++v)
        bend += static_cast<double>(along[v]) * static_cast<double>(image[v]);
      if (!(bend > 0.0)) return;
      const auto step = static_cast<float>(before / bend);
      double after = 0.0;
      for (std::uint32_t v = 0; v < count_; ++v) {
        if (diagonal_[v] == 0.0F) continue;
        move_[v] += step * along[v];
        missing_[v] -= step * image[v];
        after += static_cast<double>(missing_[v]) * static_cast<double>(missing_[v]) /
                 static_cast<double>(diagonal_[v]);
      }
      const auto keep = static_cast<float>(after / before);
      for (std::uint32_t v = 0; v < count_; ++v)
        along[v] = diagonal_[v] > 0.0F ? missing_[v] / diagonal_[v] + keep * along[v] : 0.0F;
      before = after;
    }
  }

  [[nodiscard]] bool too_far(const Triangle& triangle) const {
    bool far = false;
    surface_.for_rows(
        triangle, false,
        [&](std::int32_t r, std::int32_t from, std::int32_t to, double z, double per_col) {
          const float* height = surface_.field().z_mm.row(r).data();
          for (std::int32_t k = from; k <= to; ++k)
            far |= std::abs(z + per_col * k - static_cast<double>(height[k])) > bound_mm_;
        });
    return far;
  }

  /// Heights move; those around triangles that are too far then go back by halves.
  void apply() {
    std::vector<float>& start = missing_;  // needed no more
    std::vector<char> share(count_, kHalvings), changed(count_, 1);
    for (std::uint32_t v = 0; v < count_; ++v) {
      start[v] = surface_.vertices()[v].z_mm;
      surface_.vertices()[v].z_mm = start[v] + move_[v];
    }
    for (bool again = true; again;) {
      again = false;
      std::vector<char> back(count_, 0);
      for (std::uint32_t t = 0; t < surface_.triangles().size(); ++t) {
        const Triangle& triangle = surface_.triangles()[t];
        const auto [a, b, c] = triangle.v;
        if (!(changed[a] || changed[b] || changed[c]) || !too_far(triangle)) continue;
        back[a] = back[b] = back[c] = 1;
      }
      std::fill(changed.begin(), changed.end(), 0);
      for (std::uint32_t v = 0; v < count_; ++v) {
        if (!back[v] || share[v] == 0) continue;
        --share[v];
        move_[v] = share[v] == 0 ? 0.0F : 0.5F * move_[v];
        surface_.vertices()[v].z_mm = start[v] + move_[v];
        changed[v] = 1;
        again = true;
      }
    }
  }

  SurfaceTriangulation& surface_;
  double bound_mm_;
  std::uint32_t count_;
  std::vector<float> diagonal_, missing_, move_;
};

}  // namespace

void fit_heights(SurfaceTriangulation& surface, double bound_mm) {
  HeightFit(surface, bound_mm).run();
}

}  // namespace maquette::meshing::detail
