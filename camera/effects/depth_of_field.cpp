// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/depth_of_field.hpp"

#include <cmath>
#include <cstdint>

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "camera/detail/light_spread.hpp"

namespace maquette::camera {
namespace {

constexpr std::ptrdiff_t kTile = detail::kSpreadTile;
constexpr float kLargestRadiusPx = 128.0F;
constexpr float kNoTrace = detail::kNoTraceRadius;

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
  const detail::Aperture aperture(e.blades, e.rotation_deg);
  const Grid<float> around = reaching(radius);
  const std::vector<Grid<float>> sharp = frame.bands;
  const EvenTiles even(sharp);
  const detail::LightSpread spread(sharp, radius, largest, aperture);
  tbb::enumerable_thread_specific<detail::LightSpread::Scratch> scratch;
  tbb::parallel_for(std::ptrdiff_t{0}, around.rows(), [&](std::ptrdiff_t i) {
    for (std::ptrdiff_t j = 0; j < around.cols(); ++j) {
      const float most = around(i, j);
      if (most > kNoTrace && !even.around(i, j, spread.reach(most)))
        spread.tile(i, j, most, scratch.local(), frame.bands);
    }
  });
  return {};
}

}  // namespace maquette::camera
