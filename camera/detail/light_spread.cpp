// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/light_spread.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numbers>

#include <tbb/parallel_for.h>

namespace maquette::camera::detail {
namespace {

constexpr int kAreaSteps = 16;        ///< of a pixel of radius, in the table of areas
constexpr std::ptrdiff_t kLanes = 8;  ///< pixels of a row that are worked on together
constexpr float kNowhere = -1.0F;     ///< an edge within which nothing lies
constexpr float kOneLayer = 0.999F;   ///< kSameLayerRadius, less its rounding

using Lanes = float __attribute__((vector_size(4 * kLanes)));
using Mask = std::int32_t __attribute__((vector_size(4 * kLanes)));

Lanes load(const float* from) {
  Lanes v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
Lanes all(float v) {
  return v - Lanes{};
}
Lanes least(Lanes a, Lanes b) {
  return b < a ? b : a;
}
Lanes clamped(Lanes v) {
  const Lanes zero{}, one = all(1.0F);
  v = v < zero ? zero : v;
  return one < v ? one : v;
}

/// Light of one layer.
template <std::size_t kBands>
struct Layer {
  Lanes weight{};
  std::array<Lanes, kBands> light{};
  void add(Lanes w, const std::array<Lanes, kBands>& bands) {
    weight += w;
    for (std::size_t b = 0; b < kBands; ++b) light[b] += w * bands[b];
  }
  [[nodiscard]] Lanes mean(std::size_t b, Lanes otherwise) const {
    return weight > Lanes{} ? light[b] / weight : otherwise;
  }
};

}  // namespace

Aperture::Aperture(int blades, double rotation_deg) {
  if (blades < 3) return;
  const double wedge = std::numbers::pi / blades;
  // The polygon's apothem for the area of the unit disc: n a^2 tan(pi / n) = pi.
  apothem_ = static_cast<float>(std::sqrt(std::numbers::pi / (blades * std::tan(wedge))));
  corner_ = static_cast<float>(1.0 / std::cos(wedge));
  for (int i = 0; i < blades; ++i) {
    const double angle = rotation_deg * std::numbers::pi / 180.0 + 2.0 * wedge * i;
    normals_.push_back({static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))});
  }
}

float Aperture::distance(float dx, float dy, float side) const {
  if (normals_.empty()) return std::sqrt(dx * dx + dy * dy);
  float farthest = 0.0F;
  for (const auto& [nx, ny] : normals_) farthest = std::max(farthest, side * (nx * dx + ny * dy));
  return farthest;
}

LightSpread::LightSpread(const std::vector<Grid<float>>& sharp, const Grid<float>& radius,
                         float largest, const Aperture& aperture)
    : sharp_(sharp), radius_(radius), aperture_(aperture), most_reach_(reach(largest)) {
  const std::ptrdiff_t side = 2 * most_reach_ + 1;
  distance_ = {Grid<float>(side, side), Grid<float>(side, side)};
  for (std::ptrdiff_t y = 0; y < side; ++y)
    for (std::ptrdiff_t x = 0; x < side; ++x)
      for (const std::size_t k : {0U, 1U})
        distance_[k](y, x) =
            aperture.distance(static_cast<float>(x - most_reach_),
                              static_cast<float>(y - most_reach_), k == 0 ? 1.0F : -1.0F);
  const int count = static_cast<int>(std::ceil(largest * kAreaSteps)) + 2;
  inverse_.resize(static_cast<std::size_t>(count), 1.0F);
  tbb::parallel_for(0, count, [&](int i) {
    const float r = static_cast<float>(i) / kAreaSteps;
    if (r <= kNoTraceRadius) return;
    // The last radii of the table are a step beyond the largest.
    const std::ptrdiff_t far = reach(r);
    float sum = 0.0F;
    for (std::ptrdiff_t y = -far; y <= far; ++y)
      for (std::ptrdiff_t x = -far; x <= far; ++x)
        sum += std::clamp(aperture.edge(r) -
                              aperture.distance(static_cast<float>(x), static_cast<float>(y), 1.0F),
                          0.0F, 1.0F);
    inverse_[static_cast<std::size_t>(i)] = 1.0F / sum;
  });
}

std::ptrdiff_t LightSpread::reach(float most) const {
  return static_cast<std::ptrdiff_t>(aperture_.beyond(most));
}

float LightSpread::inverse_area(float radius) const {
  const float place = std::abs(radius) * kAreaSteps;
  const auto i = static_cast<std::size_t>(static_cast<int>(place));
  const float share = place - static_cast<float>(i);
  return inverse_[i] + share * (inverse_[i + 1] - inverse_[i]);
}

/// A tile and all around it from which light may come; (0, 0) is `reach` above and to the left.
struct LightSpread::Window {
  std::ptrdiff_t top, left;      ///< of the tile
  std::ptrdiff_t reach, stride;  ///< pixels
  bool layers = false;           ///< there is more than one
};

/// What the tile's pixels look at. Beyond the picture there is no light.
void LightSpread::load(Window& w, Scratch& s) const {
  const std::ptrdiff_t side = kSpreadTile + 2 * w.reach;
  const auto cells = static_cast<std::size_t>(side * w.stride);
  const std::ptrdiff_t first = std::max(std::ptrdiff_t{0}, w.left - w.reach);
  const std::ptrdiff_t last = std::min(radius_.cols(), w.left + kSpreadTile + w.reach);
  const std::ptrdiff_t upper = std::max(std::ptrdiff_t{0}, w.top - w.reach);
  const std::ptrdiff_t lower = std::min(radius_.rows(), w.top + kSpreadTile + w.reach);
  const bool inside = last - first == side && lower - upper == side;
  const auto prepare = [&](std::vector<float>& v, float beyond) {
    if (inside)
      v.resize(cells);
    else
      v.assign(cells, beyond);
  };
  prepare(s.radius, -INFINITY);
  prepare(s.edge, kNowhere);
  prepare(s.inverse, 0.0F);
  for (std::size_t b = 0; b < sharp_.size(); ++b) prepare(s.light[b], 0.0F);
  float least_radius = INFINITY, most_radius = -INFINITY;
  for (std::ptrdiff_t y = upper; y < lower; ++y) {
    const std::ptrdiff_t at = (y - w.top + w.reach) * w.stride + first - w.left + w.reach;
    const float* from = radius_.row(y).data() + first;
    float *radius = s.radius.data() + at, *edge = s.edge.data() + at,
          *inverse = s.inverse.data() + at;
    const std::ptrdiff_t n = last - first;
    for (std::ptrdiff_t i = 0; i < n; ++i) {
      const float r = from[i], size = std::abs(r);
      least_radius = r < least_radius ? r : least_radius;
      most_radius = r > most_radius ? r : most_radius;
      radius[i] = r;
      edge[i] = size > kNoTraceRadius ? aperture_.edge(size) : kNowhere;
      inverse[i] = inverse_area(size);
    }
    for (std::size_t b = 0; b < sharp_.size(); ++b) {
      const float* light = sharp_[b].row(y).data() + first;
      float* to = s.light[b].data() + at;
      for (std::ptrdiff_t i = 0; i < n; ++i) to[i] = light[i];
    }
  }
  w.layers = most_radius - least_radius > kOneLayer;
}

template <std::size_t kBands, bool kLayers>
void LightSpread::rows(const Window& w, const Scratch& s, std::vector<Grid<float>>& out) const {
  const std::ptrdiff_t bottom = std::min(w.top + kSpreadTile, radius_.rows());
  const std::ptrdiff_t right = std::min(w.left + kSpreadTile, radius_.cols());
  for (std::ptrdiff_t r = w.top; r < bottom; ++r)
    for (std::ptrdiff_t c = w.left; c < right; c += kLanes) {
      // Of the eight pixels themselves.
      const std::ptrdiff_t here = (r - w.top + w.reach) * w.stride + c - w.left + w.reach;
      const Lanes own_radius = detail::load(&s.radius[static_cast<std::size_t>(here)]);
      const Lanes own_edge = detail::load(&s.edge[static_cast<std::size_t>(here)]);
      const Lanes own_inverse = detail::load(&s.inverse[static_cast<std::size_t>(here)]);
      Layer<kBands> front, own, behind;
      for (std::ptrdiff_t y = std::max(std::ptrdiff_t{0}, r - w.reach);
           y <= std::min(radius_.rows() - 1, r + w.reach); ++y) {
        const std::ptrdiff_t down = r - y,
                             width = s.widths[static_cast<std::size_t>(std::abs(down))];
        const float* behind_focus = &distance_[0](down + most_reach_, most_reach_);
        const float* before_focus = &distance_[1](down + most_reach_, most_reach_);
        for (std::ptrdiff_t x = width; x >= -width; --x) {  // from the left to the right
          const auto at = static_cast<std::size_t>(here - down * w.stride - x);
          const Lanes from = detail::load(&s.radius[at]);
          Lanes size = from, edge = detail::load(&s.edge[at]),
                inverse = detail::load(&s.inverse[at]);
          [[maybe_unused]] Mask is_behind{};
          if constexpr (kLayers) {
            is_behind = from > own_radius + kSameLayerRadius;
            size = is_behind ? own_radius : size;
            edge = is_behind ? own_edge : edge;
            inverse = is_behind ? own_inverse : inverse;
          }
          const Lanes distance = size < Lanes{} ? all(before_focus[x]) : all(behind_focus[x]);
          Lanes weight = clamped(edge - distance) * inverse;
          if (x == 0 && down == 0) weight = edge == all(kNowhere) ? all(1.0F) : weight;
          std::array<Lanes, kBands> light;
          for (std::size_t b = 0; b < kBands; ++b) light[b] = detail::load(&s.light[b][at]);
          if constexpr (kLayers) {
            const Mask is_front = from < own_radius - kSameLayerRadius;
            front.add(is_front ? weight : Lanes{}, light);
            behind.add(is_behind ? weight : Lanes{}, light);
            own.add((is_front | is_behind) ? Lanes{} : weight, light);
          } else {
            own.add(weight, light);
          }
        }
      }
      const Lanes one = all(1.0F);
      const Lanes hides = least(one, front.weight);
      const Lanes share = behind.weight > Lanes{} ? least(one, own.weight) : one;
      for (std::size_t b = 0; b < kBands; ++b) {
        const Lanes around = own.mean(b, detail::load(&s.light[b][static_cast<std::size_t>(here)]));
        const Lanes value =
            hides * front.mean(b, Lanes{}) +
            (one - hides) * (share * around + (one - share) * behind.mean(b, Lanes{}));
        std::memcpy(&out[b](r, c), &value,
                    static_cast<std::size_t>(std::min(kLanes, right - c)) * sizeof(float));
      }
    }
}

void LightSpread::tile(std::ptrdiff_t i, std::ptrdiff_t j, float most, Scratch& scratch,
                       std::vector<Grid<float>>& out) const {
  Window w{i * kSpreadTile, j * kSpreadTile, reach(most), 0};
  w.stride = kSpreadTile + 2 * w.reach;
  const float beyond = aperture_.beyond(most);
  scratch.widths.clear();
  for (std::ptrdiff_t y = 0; y <= w.reach; ++y) {
    const auto away = static_cast<float>(y);
    scratch.widths.push_back(static_cast<std::ptrdiff_t>(std::sqrt(beyond * beyond - away * away)));
  }
  load(w, scratch);
  if (sharp_.size() == 1)
    w.layers ? rows<1, true>(w, scratch, out) : rows<1, false>(w, scratch, out);
  else
    w.layers ? rows<3, true>(w, scratch, out) : rows<3, false>(w, scratch, out);
}

}  // namespace maquette::camera::detail
