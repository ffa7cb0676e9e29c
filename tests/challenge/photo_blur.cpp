// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/photo_blur.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace challenge {
namespace {

/// Kernels are made for diameters of so many parts of a pixel.
constexpr double kParts = 16;

bool turns(const Lens& lens) {
  return maquette::norm(lens.turning_rad) > 0;
}

/// Along the camera's axis; 0: nothing is there.
double depth_at(const PhotoCamera& c, const Relief& relief, double px, double py) {
  const Vec3 along = ray_at(c, px, py, 1);
  const double t = relief.meet(c.place, along);
  return t < 0 ? 0 : t * maquette::dot(along, maquette::rotate(c.turn, Vec3{0, 0, -1}));
}

Plane spread_by_focus(const Lens& lens, const PhotoCamera& camera, const Plane& depth,
                      const Plane& from) {
  Plane to = make_plane(from.width, from.height);
  std::map<int, Kernel> kernels;
  for (int r = 0; r < from.height; ++r)
    for (int c = 0; c < from.width; ++c) {
      const float v = from.at(r, c);
      if (v == 0) continue;
      const int size = static_cast<int>(
          std::lround(kParts * confusion_px(lens, camera, static_cast<double>(depth.at(r, c)))));
      const auto [at, anew] = kernels.try_emplace(size);
      if (anew) {
        Lens disc;
        disc.defocus_px = size / kParts;
        at->second = kernel_of(disc);
      }
      const Kernel& k = at->second;
      const int side = 2 * k.reach + 1;
      for (int i = std::max(0, k.reach - r); i < std::min(side, from.height + k.reach - r); ++i)
        for (int j = std::max(0, k.reach - c); j < std::min(side, from.width + k.reach - c); ++j)
          to.at(r + i - k.reach, c + j - k.reach) +=
              v * static_cast<float>(k.weight[static_cast<std::size_t>(i * side + j)]);
    }
  return to;
}

/// Between pixels by a cubic: straight lines between them would blur once more.
double cubic(const Plane& p, double row, double col) {
  const int r0 = static_cast<int>(std::floor(row)), c0 = static_cast<int>(std::floor(col));
  const auto wr = cubic_weights(row - r0), wc = cubic_weights(col - c0);
  double sum = 0;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      sum += wr[static_cast<std::size_t>(i)] * wc[static_cast<std::size_t>(j)] *
             static_cast<double>(p.at(std::clamp(r0 + i - 1, 0, p.height - 1),
                                      std::clamp(c0 + j - 1, 0, p.width - 1)));
  return sum;
}

/// Where a pixel looked before (-0.5) or after (0.5) half of the turn, in the picture between.
std::array<double, 2> looked(const Lens& lens, const PhotoCamera& camera, double px, double py,
                             double part) {
  const double turn = maquette::norm(lens.turning_rad);
  PhotoCamera then = camera;
  then.turn = maquette::normalized(
      camera.turn * maquette::rotation_about(maquette::normalized(lens.turning_rad), part * turn));
  return pixel_of(camera, camera.place + ray_at(then, px, py, 1), 1);
}

Plane spread_by_turning(const Lens& lens, const PhotoCamera& camera, int margin,
                        const Plane& from) {
  Plane to = make_plane(from.width, from.height);
  for (int r = 0; r < from.height; ++r)
    for (int c = 0; c < from.width; ++c) {
      const double px = c - margin + 0.5, py = r - margin + 0.5;
      const auto a = looked(lens, camera, px, py, -0.5), b = looked(lens, camera, px, py, 0.5);
      const int n = 2 + static_cast<int>(4 * std::hypot(b[0] - a[0], b[1] - a[1]));
      double sum = 0;
      for (int i = 0; i < n; ++i) {
        const double s = (i + 0.5) / n;
        sum += cubic(from, std::lerp(a[1], b[1], s) + margin - 0.5,
                     std::lerp(a[0], b[0], s) + margin - 0.5);
      }
      to.at(r, c) = static_cast<float>(sum / n);
    }
  return to;
}

}  // namespace

double confusion_px(const Lens& lens, const PhotoCamera& camera, double depth_mm) {
  if (lens.pupil_mm == 0 || depth_mm <= 0) return 0;
  return camera.focal_px * lens.pupil_mm * std::abs(1 / depth_mm - 1 / lens.focus_mm);
}

int place_margin_of(const Lens& lens, const PhotoCamera& camera, const Relief& relief) {
  double reach = 0;
  for (int i = 0; i <= 8; ++i)
    for (int j = 0; j <= 8; ++j) {
      const double px = camera.width * j / 8.0, py = camera.height * i / 8.0;
      double here = 0.5 * confusion_px(lens, camera, depth_at(camera, relief, px, py));
      if (turns(lens)) {
        const auto a = looked(lens, camera, px, py, 0.5);
        here += std::hypot(a[0] - px, a[1] - py);
      }
      reach = std::max(reach, here);
    }
  return reach > 0 ? static_cast<int>(std::ceil(reach)) + 3 : 0;
}

void blur_by_place(const Lens& lens, const PhotoCamera& camera, const Relief& relief, int margin,
                   int more, Picture& picture) {
  if (margin == 0) return;
  const int all = margin + more;
  Plane depth = make_plane(picture[0].width, picture[0].height);
  if (lens.pupil_mm > 0)
    for (int r = 0; r < depth.height; ++r)
      for (int c = 0; c < depth.width; ++c)
        depth.at(r, c) = static_cast<float>(depth_at(camera, relief, c - all + 0.5, r - all + 0.5));
  for (std::size_t band = 0; band < picture.size(); ++band) {
    Plane& plane = picture[band];
    if (band > 0 && plane.v == picture[0].v) continue;
    Plane spread = plane;
    if (lens.pupil_mm > 0) spread = spread_by_focus(lens, camera, depth, spread);
    if (turns(lens)) spread = spread_by_turning(lens, camera, all, spread);
    Plane cut = make_plane(plane.width - 2 * margin, plane.height - 2 * margin);
    for (int r = 0; r < cut.height; ++r)
      for (int c = 0; c < cut.width; ++c) cut.at(r, c) = spread.at(r + margin, c + margin);
    if (band == 0) {
      // Bands that were alike stay so.
      for (std::size_t other = 1; other < picture.size(); ++other)
        if (picture[other].v == plane.v) picture[other] = cut;
    }
    plane = std::move(cut);
  }
}

}  // namespace challenge
