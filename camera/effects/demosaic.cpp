// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/demosaic.hpp"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace maquette::camera {
namespace {

constexpr std::ptrdiff_t kMargin = 2;

/// Index of a mirrored row or column; keeps its parity, so its colour too.
std::ptrdiff_t mirrored(std::ptrdiff_t i, std::ptrdiff_t n) {
  if (n == 1) return 0;
  const std::ptrdiff_t period = 2 * (n - 1);
  i = ((i % period) + period) % period;
  return i < n ? i : period - i;
}

/// Rows r - 2 to r + 2 with a margin on both sides.
struct Window {
  std::array<std::vector<float>, 5> rows;
  void load(const Grid<float>& mosaic, std::ptrdiff_t r) {
    const std::ptrdiff_t cols = mosaic.cols();
    for (std::ptrdiff_t k = 0; k < 5; ++k) {
      auto& to = rows[static_cast<std::size_t>(k)];
      to.resize(static_cast<std::size_t>(cols + 2 * kMargin));
      const auto from = mosaic.row(mirrored(r + k - 2, mosaic.rows()));
      std::copy(from.begin(), from.end(), to.begin() + kMargin);
      for (std::ptrdiff_t m = 1; m <= kMargin; ++m) {
        to[static_cast<std::size_t>(kMargin - m)] =
            from[static_cast<std::size_t>(mirrored(-m, cols))];
        to[static_cast<std::size_t>(cols + kMargin - 1 + m)] =
            from[static_cast<std::size_t>(mirrored(cols - 1 + m, cols))];
      }
    }
  }
  [[nodiscard]] const float* at(int k) const {
    return rows[static_cast<std::size_t>(k)].data() + kMargin;
  }
};

/// What the other colours are at a pixel, for each kind of neighbourhood.
struct Guesses {
  std::vector<float> cross;       ///< of the four neighbours' colour
  std::vector<float> horizontal;  ///< of the left and right neighbours' colour, at green
  std::vector<float> vertical;    ///< of the upper and lower neighbours' colour, at green
  std::vector<float> diagonal;    ///< of the corners' colour
};

void guess(const Window& w, std::size_t cols, bool malvar, Guesses& g) {
  for (auto* v : {&g.cross, &g.horizontal, &g.vertical, &g.diagonal}) v->resize(cols);
  const float *a = w.at(0), *b = w.at(1), *c = w.at(2), *d = w.at(3), *e = w.at(4);
  float *cross = g.cross.data(), *hor = g.horizontal.data(), *ver = g.vertical.data(),
        *dia = g.diagonal.data();
  const float own = malvar ? 1.0F : 0.0F;  // weight of the pixel's own second differences
  for (std::ptrdiff_t x = 0; x < static_cast<std::ptrdiff_t>(cols); ++x) {
    const float ns = b[x] + d[x], we = c[x - 1] + c[x + 1];
    const float far_ns = a[x] + e[x], far_we = c[x - 2] + c[x + 2];
    const float corners = b[x - 1] + b[x + 1] + d[x - 1] + d[x + 1];
    const float self = c[x];
    cross[x] = 0.25F * (ns + we) + own * 0.125F * (4.0F * self - far_ns - far_we);
    hor[x] = 0.5F * we + own * 0.125F * (5.0F * self - corners - far_we + 0.5F * far_ns);
    ver[x] = 0.5F * ns + own * 0.125F * (5.0F * self - corners - far_ns + 0.5F * far_we);
    dia[x] = 0.25F * corners + own * 0.1875F * (4.0F * self - far_ns - far_we);
  }
}

}  // namespace

Result<void> check(const Demosaic& e, const Shot&) {
  if (e.method == "malvar" || e.method == "bilinear") return {};
  return fail(kEffectOutOfRange,
              fmt::format("demosaic.method is \"{}\"; malvar or bilinear is possible", e.method));
}

void apply(const Demosaic& e, const Shot& shot, Frame& frame) {
  if (!frame.mosaic) return;
  const BayerPattern pattern = *frame.mosaic;
  const Grid<float> mosaic = std::move(frame.bands.front());
  frame.bands.clear();
  for (int b = 0; b < 3; ++b) frame.bands.emplace_back(mosaic.rows(), mosaic.cols());
  const auto cols = static_cast<std::size_t>(mosaic.cols());
  const bool malvar = e.method == "malvar";
  const auto most = static_cast<float>(std::ldexp(1.0, shot.bits) - 1.0);
  using Range = tbb::blocked_range<std::ptrdiff_t>;
  tbb::parallel_for(Range(0, mosaic.rows(), 16), [&](const Range& range) {
    Window window;
    Guesses g;
    for (std::ptrdiff_t r = range.begin(); r != range.end(); ++r) {
      window.load(mosaic, r);
      guess(window, cols, malvar, g);
      const float* self = window.at(2);
      for (std::size_t first = 0; first < 2 && first < cols; ++first) {
        const int own = pattern.at(r, static_cast<std::ptrdiff_t>(first));
        const int beside = pattern.at(r, static_cast<std::ptrdiff_t>(first) + 1);
        const int other = 3 - own - beside;  // of the rows above and below, or of the corners
        float* to_own = frame.bands[static_cast<std::size_t>(own)].row(r).data();
        float* to_beside = frame.bands[static_cast<std::size_t>(beside)].row(r).data();
        float* to_other = frame.bands[static_cast<std::size_t>(other)].row(r).data();
        const float* from_beside = own == 1 ? g.horizontal.data() : g.cross.data();
        const float* from_other = own == 1 ? g.vertical.data() : g.diagonal.data();
        for (std::size_t c = first; c < cols; c += 2) {
          to_own[c] = self[c];
          to_beside[c] = std::clamp(from_beside[c], 0.0F, most);
          to_other[c] = std::clamp(from_other[c], 0.0F, most);
        }
      }
    }
  });
  frame.mosaic.reset();
}

}  // namespace maquette::camera
