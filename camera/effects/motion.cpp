// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/motion.hpp"

#include <algorithm>
#include <cmath>

#include <tbb/parallel_for.h>

#include "camera/effects/sampling.hpp"

namespace maquette::camera {
namespace {

constexpr int kMostSamples = 512;
constexpr float kStillPx = 1e-3F;  ///< shorter ways change nothing that can be seen

bool still(const Shot& shot) {
  return norm(shot.velocity_mm_s) == 0.0 && norm(shot.angular_rate_rad_s) == 0.0;
}

Result<void> needs_depth(std::string_view effect, const Shot& shot, const Frame& frame) {
  if (norm(shot.velocity_mm_s) == 0.0 || !frame.depth_mm.empty()) return {};
  return fail(kFrame, std::string(effect) +
                          ": the camera has a velocity, but the picture has no "
                          "depth (channel Z, mm); without it only turning can "
                          "be worked out");
}

/// The pixel in which a place lies, or the edge's.
std::ptrdiff_t nearest(float place, std::ptrdiff_t count) {
  return std::clamp(static_cast<std::ptrdiff_t>(std::floor(place)), std::ptrdiff_t{0}, count - 1);
}

Vec2 motion_at(const Shot& shot, const Frame& frame, std::ptrdiff_t r, std::ptrdiff_t c) {
  const double depth =
      frame.depth_mm.empty() ? INFINITY : static_cast<double>(frame.depth_mm(r, c));
  return image_motion(shot, {static_cast<double>(c) + 0.5, static_cast<double>(r) + 0.5}, depth);
}

}  // namespace

Vec2 image_motion(const Shot& shot, Vec2 px, double depth_mm) {
  const auto [x, y] = tangents(shot.intrinsics, px);
  const double nearness =
      std::isfinite(depth_mm) && depth_mm > 0.0 ? std::sqrt(1.0 + x * x + y * y) / depth_mm : 0.0;
  const Vec3 v{shot.velocity_mm_s.x, -shot.velocity_mm_s.y, -shot.velocity_mm_s.z};
  const Vec3 w{shot.angular_rate_rad_s.x, -shot.angular_rate_rad_s.y, -shot.angular_rate_rad_s.z};
  const double dx = (x * v.z - v.x) * nearness + x * y * w.x - (1.0 + x * x) * w.y + y * w.z;
  const double dy = (y * v.z - v.y) * nearness + (1.0 + y * y) * w.x - x * y * w.y - x * w.z;
  const Intrinsics& k = shot.intrinsics;
  return {k.fx_px * dx + k.skew_px * dy, k.fy_px * dy};
}

Result<void> check(const RollingShutter& e, const Shot&) {
  return in_range("rolling_shutter", "row_s", e.row_s, -1.0, 1.0);
}

Result<void> apply(const MotionBlur&, const Shot& shot, Frame& frame) {
  MAQUETTE_TRY_VOID(needs_depth("motion_blur", shot, frame));
  if (still(shot)) return {};
  const std::vector<Grid<float>> sharp = frame.bands;
  tbb::parallel_for(std::ptrdiff_t{0}, sharp[0].rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < sharp[0].cols(); ++c) {
      const Vec2 way = motion_at(shot, frame, r, c);
      const auto dx = static_cast<float>(way.x * shot.exposure_s);
      const auto dy = static_cast<float>(way.y * shot.exposure_s);
      const float length = std::hypot(dx, dy);
      if (length < kStillPx) continue;
      // Two samples a pixel: what lies between them is linear.
      const int samples = std::min(kMostSamples, 2 + static_cast<int>(2.0F * length));
      for (std::size_t b = 0; b < sharp.size(); ++b) {
        float sum = 0.0F;
        for (int i = 0; i < samples; ++i) {
          const float t = (static_cast<float>(i) + 0.5F) / static_cast<float>(samples) - 0.5F;
          sum += bilinear(sharp[b], static_cast<float>(c) + 0.5F - t * dx,
                          static_cast<float>(r) + 0.5F - t * dy);
        }
        frame.bands[b](r, c) = sum / static_cast<float>(samples);
      }
    }
  });
  return {};
}

Result<void> apply(const RollingShutter& e, const Shot& shot, Frame& frame) {
  MAQUETTE_TRY_VOID(needs_depth("rolling_shutter", shot, frame));
  if (still(shot) || e.row_s == 0.0) return {};
  const Frame before = frame;
  const Grid<float>& first = before.bands[0];
  const double middle = 0.5 * static_cast<double>(first.rows());
  tbb::parallel_for(std::ptrdiff_t{0}, first.rows(), [&](std::ptrdiff_t r) {
    const double time = (static_cast<double>(r) + 0.5 - middle) * e.row_s;
    for (std::ptrdiff_t c = 0; c < first.cols(); ++c) {
      const Vec2 way = motion_at(shot, before, r, c);
      const auto x = static_cast<float>(static_cast<double>(c) + 0.5 - way.x * time);
      const auto y = static_cast<float>(static_cast<double>(r) + 0.5 - way.y * time);
      for (std::size_t b = 0; b < before.bands.size(); ++b)
        frame.bands[b](r, c) = bicubic(before.bands[b], x, y);
      const auto row = nearest(y, first.rows()), col = nearest(x, first.cols());
      if (!before.depth_mm.empty()) frame.depth_mm(r, c) = before.depth_mm(row, col);
      if (!before.lit.empty()) frame.lit(r, c) = before.lit(row, col);
    }
  });
  return {};
}

}  // namespace maquette::camera
