// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/depth_of_field.hpp"

#include <cmath>
#include <cstdint>
#include <numbers>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace maquette::camera {
namespace {

constexpr std::ptrdiff_t kTile = 16;
constexpr float kLargestRadiusPx = 128.0F;
constexpr float kNoTrace = 0.5F;    ///< radius in pixels
constexpr float kSameLayer = 1.0F;  ///< difference of radii in pixels
constexpr int kAreaSteps = 16;      ///< of a pixel of radius, in the table of areas

/// The aperture's picture of unit area-equivalent radius.
class Aperture {
 public:
  Aperture(int blades, double rotation_deg) {
    if (blades < 3) return;
    const double wedge = std::numbers::pi / blades;
    // The polygon's apothem for the area of the unit disc: n a^2 tan(pi / n) = pi.
    apothem_ = static_cast<float>(std::sqrt(std::numbers::pi / (blades * std::tan(wedge))));
    corner_ = static_cast<float>(1.0 / std::cos(wedge));
    for (int i = 0; i < blades; ++i) {
      const double angle = rotation_deg * std::numbers::pi / 180.0 + 2.0 * wedge * i;
      normals_.push_back(
          {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))});
    }
  }
  /// Share of the pixel at (dx, dy) that the picture of radius r covers. Behind the focus it stands
  /// on its head: r is signed.
  [[nodiscard]] float coverage(float dx, float dy, float r) const {
    const float size = std::abs(r);
    if (normals_.empty()) return std::clamp(size + 0.5F - std::sqrt(dx * dx + dy * dy), 0.0F, 1.0F);
    const float side = r < 0.0F ? -1.0F : 1.0F;
    float farthest = 0.0F;
    for (const auto& [nx, ny] : normals_) farthest = std::max(farthest, side * (nx * dx + ny * dy));
    return std::clamp(apothem_ * size + 0.5F - farthest, 0.0F, 1.0F);
  }
  /// coverage() of most pixels, which are clearly in the picture or clearly outside, without its
  /// edges.
  [[nodiscard]] float quick_coverage(float dx, float dy, float r) const {
    constexpr float kClearly = 1e-3F;
    const float square = dx * dx + dy * dy, apothem = apothem_ * std::abs(r);
    const float far = beyond(std::abs(r));
    if (square > far * far) return 0.0F;
    const float within = apothem - 0.5F - kClearly;
    if (within > 0.0F && square < within * within) return 1.0F;
    return coverage(dx, dy, r);
  }
  /// Nothing is covered at this distance or beyond it by a picture of radius r or less.
  [[nodiscard]] float beyond(float r) const {
    constexpr float kClearly = 1e-3F;
    return (apothem_ * r + 0.5F + kClearly) * corner_;
  }
  /// How far it reaches, in radii.
  [[nodiscard]] float reach() const {
    if (normals_.empty()) return 1.0F;
    const auto wedge = static_cast<float>(std::numbers::pi) / static_cast<float>(normals_.size());
    return apothem_ / std::cos(wedge);
  }

 private:
  float apothem_ = 1.0F;
  float corner_ = 1.0F;  ///< distance of a corner, in apothems
  std::vector<std::array<float, 2>> normals_;
};

/// Sum of a picture's coverage over all pixels, by its radius: what its light is divided by.
class Areas {
 public:
  Areas(const Aperture& aperture, float largest) {
    const int count = static_cast<int>(std::ceil(largest * kAreaSteps)) + 2;
    inverse_.resize(static_cast<std::size_t>(count), 1.0F);
    tbb::parallel_for(0, count, [&](int i) {
      const float r = static_cast<float>(i) / kAreaSteps;
      if (r <= kNoTrace) return;
      const int reach = static_cast<int>(std::ceil(r * aperture.reach() + 0.5F));
      float sum = 0.0F;
      for (int y = -reach; y <= reach; ++y)
        for (int x = -reach; x <= reach; ++x)
          sum += aperture.coverage(static_cast<float>(x), static_cast<float>(y), r);
      inverse_[static_cast<std::size_t>(i)] = 1.0F / sum;
    });
  }
  [[nodiscard]] float inverse(float radius) const {
    const float place = std::abs(radius) * kAreaSteps;
    const auto i = static_cast<std::size_t>(static_cast<int>(place));
    const float share = place - static_cast<float>(i);
    return inverse_[i] + share * (inverse_[i + 1] - inverse_[i]);
  }

 private:
  std::vector<float> inverse_;
};

/// Signed radius in pixels of each pixel's circle: circle_of_confusion_mm() as a - b / z, which has
/// no case of its own for what is infinitely far.
Grid<float> radii(const Shot& shot, const Frame& frame, double focus_mm) {
  Grid<float> r(frame.depth_mm.rows(), frame.depth_mm.cols());
  const double aperture = shot.focal_length_mm / shot.f_number;
  const bool far = std::isinf(focus_mm);
  const double scale = 0.5 / (1e-3 * shot.pixel_pitch_um) * aperture * shot.focal_length_mm;
  const double at_infinity = far ? 0.0 : scale / (focus_mm - shot.focal_length_mm);
  const double by_depth = far ? scale : at_infinity * focus_mm;
  const Intrinsics& k = shot.intrinsics;
  tbb::parallel_for(std::ptrdiff_t{0}, r.rows(), [&](std::ptrdiff_t row) {
    const Vec2 first = tangents(k, {0.5, static_cast<double>(row) + 0.5});
    const double step = 1.0 / k.fx_px, off_axis = 1.0 + first.y * first.y;
    const float* depth = frame.depth_mm.row(row).data();
    float* to = r.row(row).data();
    const int cols = static_cast<int>(r.cols());
    for (int c = 0; c < cols; ++c) {
      const double x = first.x + step * static_cast<double>(c);
      const double inverse_z = std::sqrt(off_axis + x * x) / static_cast<double>(depth[c]);
      to[c] = static_cast<float>(at_infinity - by_depth * inverse_z);
    }
  });
  return r;
}

/// Largest |radius| in each tile, then in all tiles from which light reaches it.
Grid<float> reaching(const Grid<float>& radius) {
  const std::ptrdiff_t rows = (radius.rows() + kTile - 1) / kTile;
  const std::ptrdiff_t cols = (radius.cols() + kTile - 1) / kTile;
  Grid<float> own(rows, cols), all(rows, cols);
  tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t i) {
    for (std::ptrdiff_t r = i * kTile; r < std::min((i + 1) * kTile, radius.rows()); ++r) {
      const auto row = radius.row(r);
      for (std::ptrdiff_t j = 0; j < cols; ++j) {
        float most = own(i, j);
        for (std::ptrdiff_t c = j * kTile; c < std::min((j + 1) * kTile, radius.cols()); ++c)
          most = std::max(most, std::abs(row[static_cast<std::size_t>(c)]));
        own(i, j) = most;
      }
    }
  });
  const std::ptrdiff_t far = static_cast<std::ptrdiff_t>(2.0F * kLargestRadiusPx) / kTile + 1;
  tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t i) {
    for (std::ptrdiff_t j = 0; j < cols; ++j)
      for (std::ptrdiff_t a = std::max(std::ptrdiff_t{0}, i - far);
           a <= std::min(rows - 1, i + far); ++a)
        for (std::ptrdiff_t b = std::max(std::ptrdiff_t{0}, j - far);
             b <= std::min(cols - 1, j + far); ++b) {
          const std::ptrdiff_t gap =
              std::max(std::ptrdiff_t{0}, std::max(std::abs(a - i), std::abs(b - j)) - 1) * kTile;
          if (own(a, b) * 1.6F + 1.0F > static_cast<float>(gap))
            all(i, j) = std::max(all(i, j), own(a, b));
        }
  });
  return all;
}

/// Tiles around which all that is near has one value: a background, a shadow. No circle of whatever
/// size changes those.
class EvenTiles {
 public:
  explicit EvenTiles(const std::vector<Grid<float>>& bands)
      : bands_(bands),
        even_((bands[0].rows() + kTile - 1) / kTile, (bands[0].cols() + kTile - 1) / kTile, 1) {
    tbb::parallel_for(std::ptrdiff_t{0}, even_.rows(), [&](std::ptrdiff_t i) {
      for (const Grid<float>& band : bands)
        for (std::ptrdiff_t r = i * kTile; r < std::min((i + 1) * kTile, band.rows()); ++r)
          for (std::ptrdiff_t j = 0; j < even_.cols(); ++j) {
            const float value = band(i * kTile, j * kTile);
            for (std::ptrdiff_t c = j * kTile; c < std::min((j + 1) * kTile, band.cols()); ++c)
              if (band(r, c) != value) even_(i, j) = 0;
          }
    });
  }
  [[nodiscard]] bool around(std::ptrdiff_t i, std::ptrdiff_t j, std::ptrdiff_t reach_px) const {
    const std::ptrdiff_t far = (reach_px + kTile - 1) / kTile;
    for (std::ptrdiff_t a = std::max(std::ptrdiff_t{0}, i - far);
         a <= std::min(even_.rows() - 1, i + far); ++a)
      for (std::ptrdiff_t b = std::max(std::ptrdiff_t{0}, j - far);
           b <= std::min(even_.cols() - 1, j + far); ++b) {
        if (even_(a, b) == 0) return false;
        for (const Grid<float>& band : bands_)
          if (band(a * kTile, b * kTile) != band(i * kTile, j * kTile)) return false;
      }
    return true;
  }

 private:
  const std::vector<Grid<float>>& bands_;
  Grid<std::uint8_t> even_;
};

/// Light of one layer.
struct Layer {
  float weight = 0.0F;
  std::array<float, 3> light{};
  void add(float w, const std::vector<Grid<float>>& bands, std::ptrdiff_t r, std::ptrdiff_t c) {
    weight += w;
    for (std::size_t b = 0; b < bands.size(); ++b) light[b] += w * bands[b](r, c);
  }
};

struct Spreader {
  const std::vector<Grid<float>>& sharp;
  const Grid<float>& radius;
  const Aperture& aperture;
  const Areas& areas;

  /// Value of each band at a pixel, from the layers before, around and behind it.
  /// @param widths  by rows away from the pixel's: how far along the row light may come from
  void pixel(std::ptrdiff_t r, std::ptrdiff_t c, const std::vector<std::ptrdiff_t>& widths,
             std::vector<Grid<float>>& out) const {
    const auto reach = static_cast<std::ptrdiff_t>(widths.size()) - 1;
    const float own_radius = radius(r, c);
    Layer front, own, behind;
    for (std::ptrdiff_t y = std::max(std::ptrdiff_t{0}, r - reach);
         y <= std::min(sharp[0].rows() - 1, r + reach); ++y) {
      const float* radius_row = radius.row(y).data();
      const std::ptrdiff_t width = widths[static_cast<std::size_t>(std::abs(r - y))];
      for (std::ptrdiff_t x = std::max(std::ptrdiff_t{0}, c - width);
           x <= std::min(sharp[0].cols() - 1, c + width); ++x) {
        const auto dx = static_cast<float>(c - x), dy = static_cast<float>(r - y);
        const float from = radius_row[x];
        const bool is_behind = from > own_radius + kSameLayer;
        const float size = is_behind ? own_radius : from;
        float w = 0.0F;
        if (std::abs(size) <= kNoTrace) {
          w = dx == 0.0F && dy == 0.0F ? 1.0F : 0.0F;
        } else {
          w = aperture.quick_coverage(dx, dy, size);
          if (w > 0.0F) w *= areas.inverse(size);
        }
        if (w <= 0.0F) continue;
        (is_behind ? behind : from < own_radius - kSameLayer ? front : own).add(w, sharp, y, x);
      }
    }
    const float hides = std::min(1.0F, front.weight);
    const float share = behind.weight > 0.0F ? std::min(1.0F, own.weight) : 1.0F;
    for (std::size_t b = 0; b < sharp.size(); ++b) {
      const float around = own.weight > 0.0F ? own.light[b] / own.weight : sharp[b](r, c);
      const float back = behind.weight > 0.0F ? behind.light[b] / behind.weight : 0.0F;
      const float before = front.weight > 0.0F ? front.light[b] / front.weight : 0.0F;
      out[b](r, c) = hides * before + (1.0F - hides) * (share * around + (1.0F - share) * back);
    }
  }
};

}  // namespace

double circle_of_confusion_mm(double focal_length_mm, double f_number, double focus_mm,
                              double z_mm) {
  const double aperture = focal_length_mm / f_number;
  if (std::isinf(focus_mm)) return std::isinf(z_mm) ? 0.0 : -aperture * focal_length_mm / z_mm;
  const double at_infinity = aperture * focal_length_mm / (focus_mm - focal_length_mm);
  return std::isinf(z_mm) ? at_infinity : at_infinity * (z_mm - focus_mm) / z_mm;
}

Result<void> check(const DepthOfField& e, const Shot& shot) {
  if (e.focus_mm != 0.0 && !(e.focus_mm > shot.focal_length_mm))
    return fail(kEffectOutOfRange,
                fmt::format("depth_of_field.focus_mm is {}; it must be more than the focal length "
                            "of {} mm",
                            e.focus_mm, shot.focal_length_mm));
  if (e.blades != 0) return in_range("depth_of_field", "blades", e.blades, 3, 30);
  return in_range("depth_of_field", "rotation_deg", e.rotation_deg, -360.0, 360.0);
}

Result<void> apply(const DepthOfField& e, const Shot& shot, Frame& frame) {
  if (frame.depth_mm.empty())
    return fail(kFrame,
                "depth_of_field: the picture has no depth (channel Z, mm); render with "
                "depth, or leave the effect out");
  double focus = e.focus_mm;
  if (focus == 0.0)
    focus =
        static_cast<double>(frame.depth_mm(frame.depth_mm.rows() / 2, frame.depth_mm.cols() / 2));
  if (!(focus > shot.focal_length_mm))
    return fail(kEffectOutOfRange,
                fmt::format("depth_of_field: the picture's middle is {} mm away, nearer than the "
                            "focal length of {} mm; give focus_mm",
                            focus, shot.focal_length_mm));
  const Grid<float> radius = radii(shot, frame, focus);
  float largest = 0.0F;
  for (const float r : radius.cells()) largest = std::max(largest, std::abs(r));
  if (!(largest <= kLargestRadiusPx))
    return fail(kEffectOutOfRange,
                fmt::format("depth_of_field: circles of confusion up to {} pixels wide; at most {} "
                            "are possible: check focus_mm ({:.1f}) and the f-number ({})",
                            2.0F * largest, 2.0F * kLargestRadiusPx, focus, shot.f_number));
  if (largest <= kNoTrace) return {};
  const Aperture aperture(e.blades, e.rotation_deg);
  const Areas areas(aperture, largest);
  const Grid<float> around = reaching(radius);
  const std::vector<Grid<float>> sharp = frame.bands;
  const EvenTiles even(sharp);
  const Spreader spreader{sharp, radius, aperture, areas};
  tbb::parallel_for(std::ptrdiff_t{0}, around.rows(), [&](std::ptrdiff_t i) {
    std::vector<std::ptrdiff_t> widths;
    for (std::ptrdiff_t j = 0; j < around.cols(); ++j) {
      if (around(i, j) <= kNoTrace) continue;
      const float beyond = aperture.beyond(around(i, j));
      const auto reach = static_cast<std::ptrdiff_t>(beyond);
      if (even.around(i, j, reach)) continue;
      widths.clear();
      for (std::ptrdiff_t y = 0; y <= reach; ++y) {
        const auto away = static_cast<float>(y);
        widths.push_back(static_cast<std::ptrdiff_t>(std::sqrt(beyond * beyond - away * away)));
      }
      for (std::ptrdiff_t r = i * kTile; r < std::min((i + 1) * kTile, radius.rows()); ++r)
        for (std::ptrdiff_t c = j * kTile; c < std::min((j + 1) * kTile, radius.cols()); ++c)
          spreader.pixel(r, c, widths, frame.bands);
    }
  });
  return {};
}

}  // namespace maquette::camera
