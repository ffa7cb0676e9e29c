// SPDX-License-Identifier: GPL-3.0-or-later
// What the rays of pixels meet: surface, lamp, and what is around them.
#include "diagnosis/detail/photo_views.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "camera/disc_samples.hpp"
#include "core/random.hpp"
#include "diagnosis/detail/pictures.hpp"
#include "diagnosis/photographs.hpp"

namespace maquette::diagnosis::detail {
namespace {
using heightmap::ModelField;

constexpr double kOff_mm = 1e-3;         // where a ray to the lamp starts above the surface
constexpr int kLampRays = 32;            // of a pixel's ray, to lamps with a size
constexpr std::ptrdiff_t kAround = 160;  // grid of places that look around, and rays of each
constexpr int kAroundRays = 64;
constexpr int kBounces = 3;  // beyond the first; each leaves a tenth or less

/// A lamp as it stands in a state.
struct Lamp {
  Vec3 position, right, up;  ///< right and up across its axis
  double diameter_mm;

  Lamp(const PhotoScene& scene, const PhotoState& state, std::size_t photo) {
    const PhotoInput& p = scene.photos[photo];
    const std::size_t lamp = scene.lamp_of[photo];
    position = p.lamp_position_mm + state.lamp_mm[lamp] + state.lamp_refocused_mm[lamp];
    const auto axes = across(normalized(position - p.lamp_target_mm));
    right = axes[0];
    up = axes[1];
    diameter_mm = p.lamp_diameter_mm + state.lamp_diameter_mm;
  }
  [[nodiscard]] Vec3 at(double x, double y, double diameter) const {
    return position + 0.5 * diameter * (x * right + y * up);
  }
};

constexpr std::ptrdiff_t kBlock = 4;   // side of a square of rays that are traced together
constexpr std::size_t kTogether = 16;  // rays in it

heightmap::FieldTracer::Segment segment(Vec3 from, Vec3 to) {
  const double way = norm(to - from);
  return {from, (1.0 / way) * (to - from), way};
}
/// Calls `cell` for each cell of a square of kBlock x kBlock, then `end`, square by square.
template <class State, class Cell, class End>
void in_squares(std::ptrdiff_t rows, std::ptrdiff_t cols, const Cell& cell, const End& end) {
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, (rows + kBlock - 1) / kBlock, [&](std::ptrdiff_t i) {
    State state;
    for (std::ptrdiff_t left = 0; left < cols; left += kBlock) {
      for (std::ptrdiff_t r = i * kBlock; r < std::min(rows, (i + 1) * kBlock); ++r)
        for (std::ptrdiff_t c = left; c < std::min(cols, left + kBlock); ++c) cell(r, c, state);
      end(state);
    }
  });
}
/// What a place sees of points on a lamp's disc.
SeenLamp seen_of(const heightmap::FieldTracer& tracer, Vec3 from, const Lamp& lamp,
                 double diameter_mm, const std::vector<camera::DiscPoint>& disc) {
  int seen = 0;
  double x = 0.0, y = 0.0;
  std::array<heightmap::FieldTracer::Segment, kTogether> rays;
  std::array<bool, kTogether> blocked;
  for (std::size_t first = 0; first < disc.size(); first += kTogether) {
    const std::size_t n = std::min(kTogether, disc.size() - first);
    for (std::size_t i = 0; i < n; ++i)
      rays[i] = segment(from, lamp.at(disc[first + i].x, disc[first + i].y, diameter_mm));
    tracer.blocked_many({rays.data(), n}, {blocked.data(), n});
    for (std::size_t i = 0; i < n; ++i) {
      if (blocked[i]) continue;
      ++seen;
      x += disc[first + i].x;
      y += disc[first + i].y;
    }
  }
  const auto all = static_cast<int>(disc.size());
  if (seen == all) return {1.0F, 0.0F, 0.0F};
  const double each = 0.5 * diameter_mm / all;
  return {static_cast<float>(seen) / static_cast<float>(all), static_cast<float>(each * x),
          static_cast<float>(each * y)};
}
/// Is what a place sees of a lamp's rim other than what it sees of its middle?
bool differs_at_rim(const heightmap::FieldTracer& tracer, Vec3 from, const Lamp& lamp,
                    double diameter_mm, bool middle) {
  std::array<heightmap::FieldTracer::Segment, 4> rays;
  std::size_t n = 0;
  for (const auto& [x, y] : {std::pair{1.0, 0.0}, {-1.0, 0.0}, {0.0, 1.0}, {0.0, -1.0}})
    rays[n++] = segment(from, lamp.at(x, y, diameter_mm));
  std::array<bool, 4> blocked;
  tracer.blocked_many(rays, blocked);
  return std::any_of(blocked.begin(), blocked.end(), [&](bool b) { return b == middle; });
}
SeenLamp mean_of(const SeenLamp& sum, double n) {
  const auto k = static_cast<float>(1.0 / n);
  return {k * sum.share, k * sum.x_mm, k * sum.y_mm};
}
SeenLamp& operator+=(SeenLamp& a, const SeenLamp& b) {
  a.share += b.share;
  a.x_mm += b.x_mm;
  a.y_mm += b.y_mm;
  return a;
}

}  // namespace

/// Slopes at nodes: central differences, or over four neighbours, which a wave of eight nodes
/// brings within 1 % instead of 10.
void PhotoViews::take_slopes() {
  if (normals_ != Normals::smooth && normals_ != Normals::smoother) return;
  if (slopes_of_ == normals_) return;
  slopes_of_ = normals_;
  slopes_.clear();
  for (std::size_t k = 0; k < surfaces_.size(); ++k) {
    if (tracer_of_[k] < slopes_.size()) continue;  // taken already
    const ModelField& f = *surfaces_[k];
    const std::ptrdiff_t rows = f.z_mm.rows(), cols = f.z_mm.cols();
    const double step = f.spacing.value();
    Slopes slopes{Grid<float>(rows, cols, NAN), Grid<float>(rows, cols, NAN)};
    const bool four = normals_ == Normals::smoother;
    const auto along = [&](const auto& z, std::ptrdiff_t i, std::ptrdiff_t n) {
      if (four && i > 1 && i < n - 2)
        return static_cast<float>((8.0 * (z(i + 1) - z(i - 1)) - (z(i + 2) - z(i - 2))) /
                                  (12.0 * step));
      const std::ptrdiff_t low = std::max<std::ptrdiff_t>(0, i - 1), high = std::min(n - 1, i + 1);
      return static_cast<float>((z(high) - z(low)) / (step * static_cast<double>(high - low)));
    };
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        slopes.x(r, c) =
            along([&](std::ptrdiff_t i) { return static_cast<double>(f.z_mm(r, i)); }, c, cols);
        slopes.y(r, c) =
            along([&](std::ptrdiff_t i) { return static_cast<double>(f.z_mm(i, c)); }, r, rows);
      }
    });
    slopes_.push_back(std::move(slopes));
  }
}

Vec3 PhotoViews::normal_at(std::size_t photo, double x, double y) const {
  const ModelField& f = *surfaces_[photo];
  const double step = f.spacing.value();
  const double c = std::clamp((x - f.x0.value()) / step, 0.0,
                              static_cast<double>(f.z_mm.cols() - 1)),
               r = std::clamp((y - f.y0.value()) / step, 0.0,
                              static_cast<double>(f.z_mm.rows() - 1));
  double gx = 0.0, gy = 0.0;
  if (normals_ == Normals::smooth || normals_ == Normals::smoother) {
    const Slopes& s = slopes_[tracer_of_[photo]];
    gx = bilinear(s.x, r, c);
    gy = bilinear(s.y, r, c);
  } else {
    const auto c0 = std::min(static_cast<std::ptrdiff_t>(c), f.z_mm.cols() - 2),
               r0 = std::min(static_cast<std::ptrdiff_t>(r), f.z_mm.rows() - 2);
    const double fc = c - static_cast<double>(c0), fr = r - static_cast<double>(r0);
    const double a = f.z_mm(r0, c0), b = f.z_mm(r0, c0 + 1), d = f.z_mm(r0 + 1, c0),
                 e = f.z_mm(r0 + 1, c0 + 1);
    if (normals_ == Normals::patches) {
      gx = std::lerp(b - a, e - d, fr) / step;
      gy = std::lerp(d - a, e - b, fc) / step;
    } else {
      gx = (fc > fr ? b - a : e - d) / step;
      gy = (fc > fr ? e - b : d - a) / step;
    }
  }
  return normalized(Vec3{-gx, -gy, 1.0});
}

void PhotoViews::trace(std::size_t k) {
  const PhotoInput& photo = scene_.photos[k];
  View& view = views_[k];
  const heightmap::FieldTracer& tracer = tracers_[tracer_of_[k]];
  const double f = photo.focal_length_mm * 1000.0 / photo.pixel_pitch_um;
  const Vec3 origin = photo.camera_position_mm + state_.picture[k].camera_mm;
  const Vec3 turn = state_.picture[k].camera_rad;
  const double turned = norm(turn);
  const Quaternion model_from_camera =
      turned > 0.0 ? rotation_about((1.0 / turned) * turn, turned) * photo.model_from_camera
                   : photo.model_from_camera;
  const std::ptrdiff_t far = reach();
  struct Square {
    std::size_t n = 0;
    std::array<Sample*, kTogether> of;
    std::array<heightmap::FieldTracer::Ray, kTogether> rays;
    std::array<std::optional<heightmap::FieldHit>, kTogether> hits;
  };
  in_squares<Square>(
      view.samples.rows(), view.samples.cols(),
      [&](std::ptrdiff_t r, std::ptrdiff_t c, Square& square) {
        Sample& s = view.samples(r, c);
        s = {};
        if (!view.wanted(r / kAcross, c / kAcross, far)) return;
        const double u0 = (static_cast<double>(c) + 0.5) / kAcross - photo.principal_u_px,
                     v0 = (static_cast<double>(r) + 0.5) / kAcross - photo.principal_v_px;
        const bool bends = state_.radial_1 != 0.0 || state_.radial_2 != 0.0;
        double u = u0, v = v0;
        for (int round = 0; round < (bends ? 6 : 1); ++round) {  // back from where the lens puts it
          const double r2 = (u * u + v * v) / (f * f);
          const double radial =
              1.0 + state_.focal + state_.radial_1 * r2 + state_.radial_2 * r2 * r2;
          u = u0 / radial;
          v = v0 / radial;
        }
        square.of[square.n] = &s;
        square.rays[square.n++] = {origin, rotate(model_from_camera, normalized(Vec3{u, -v, -f}))};
      },
      [&](Square& square) {
        const std::size_t n = std::exchange(square.n, 0);
        tracer.trace_many({square.rays.data(), n}, {square.hits.data(), n});
        for (std::size_t i = 0; i < n; ++i) {
          const auto& hit = square.hits[i];
          if (!hit) continue;
          square.of[i]->x = static_cast<float>(hit->point_mm.x);
          square.of[i]->y = static_cast<float>(hit->point_mm.y);
          square.of[i]->z = static_cast<float>(hit->point_mm.z);
        }
      });
}

void PhotoViews::see_lamp(std::size_t k) {
  View& view = views_[k];
  const heightmap::FieldTracer& tracer = tracers_[tracer_of_[k]];
  const Lamp lamp(scene_, state_, k);
  struct Square {
    std::size_t n = 0;
    std::array<Sample*, kTogether> of;
    std::array<heightmap::FieldTracer::Segment, kTogether> rays;
    std::array<bool, kTogether> blocked;
  };
  in_squares<Square>(
      view.samples.rows(), view.samples.cols(),
      [&](std::ptrdiff_t r, std::ptrdiff_t c, Square& square) {
        Sample& s = view.samples(r, c);
        if (std::isnan(s.x)) return;
        square.of[square.n] = &s;
        square.rays[square.n++] =
            segment({s.x, s.y, static_cast<double>(s.z) + kOff_mm}, lamp.position);
      },
      [&](Square& square) {
        const std::size_t n = std::exchange(square.n, 0);
        tracer.blocked_many({square.rays.data(), n}, {square.blocked.data(), n});
        for (std::size_t i = 0; i < n; ++i)
          square.of[i]->lamp = {square.blocked[i] ? 0.0F : 1.0F, 0.0F, 0.0F};
      });
  if (!(lamp.diameter_mm > 0.0)) return;
  // Penumbras: where a neighbour within their width sees what this does not.
  const auto reach = std::clamp<std::ptrdiff_t>(
      static_cast<std::ptrdiff_t>(std::ceil(kAcross * penumbra_px(lamp.diameter_mm, k))) + 1, 2,
      400);
  const std::ptrdiff_t rows = view.samples.rows(), cols = view.samples.cols();
  // Summed over squares: is it all light or all shadow?
  Grid<std::int32_t> lit(rows + 1, cols + 1, 0), hit(rows + 1, cols + 1, 0);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const Sample& s = view.samples(r, c);
      const int h = std::isnan(s.x) ? 0 : 1, l = h == 1 && s.lamp.share > 0.0F ? 1 : 0;
      hit(r + 1, c + 1) = h + hit(r, c + 1) + hit(r + 1, c) - hit(r, c);
      lit(r + 1, c + 1) = l + lit(r, c + 1) + lit(r + 1, c) - lit(r, c);
    }
  const auto one_light = [&](std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t far) {
    const std::ptrdiff_t r0 = std::max<std::ptrdiff_t>(0, r - far),
                         r1 = std::min(rows, r + kAcross + far),
                         c0 = std::max<std::ptrdiff_t>(0, c - far),
                         c1 = std::min(cols, c + kAcross + far);
    const auto sum = [&](const Grid<std::int32_t>& g) {
      return g(r1, c1) - g(r0, c1) - g(r1, c0) + g(r0, c0);
    };
    const int lights = sum(lit);
    return lights == 0 || lights == sum(hit);
  };
  // Of pictures that are rendered in part the shadow may lie where nothing is.
  const bool whole = view.looked_at.empty();
  static_assert(kAcross == 2, "two rays on a diagonal tell of all four");
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows / kAcross, [&](std::ptrdiff_t row) {
    std::vector<camera::DiscPoint> disc;
    for (std::ptrdiff_t col = 0; col < cols / kAcross; ++col) {
      const std::ptrdiff_t r = kAcross * row, c = kAcross * col;
      if (whole && one_light(r, c, reach)) continue;
      const auto differs = [&](std::ptrdiff_t i) {
        const Sample& s = view.samples(r + i, c + i);
        if (std::isnan(s.x)) return false;
        return differs_at_rim(tracer, {s.x, s.y, static_cast<double>(s.z) + kOff_mm}, lamp,
                              lamp.diameter_mm, s.lamp.share > 0.0F);
      };
      if (one_light(r, c, 0) && !differs(0) && !differs(1)) continue;
      for (std::ptrdiff_t i = r; i < r + kAcross; ++i)
        for (std::ptrdiff_t j = c; j < c + kAcross; ++j) {
          Sample& s = view.samples(i, j);
          if (std::isnan(s.x)) continue;
          camera::stratified_disc(kLampRays, static_cast<std::uint64_t>(i * cols + j), disc);
          s.lamp = seen_of(tracer, {s.x, s.y, static_cast<double>(s.z) + kOff_mm}, lamp,
                           lamp.diameter_mm, disc);
        }
    }
  });
}

std::array<SeenLamp, kLampSizes> PhotoViews::lamp_of_sizes(std::size_t k, std::uint32_t at) const {
  const PhotoInput& photo = scene_.photos[k];
  const View& view = views_[k];
  const heightmap::FieldTracer& tracer = tracers_[tracer_of_[k]];
  const Lamp lamp(scene_, state_, k);
  const auto row = static_cast<std::ptrdiff_t>(at) / photo.width_px,
             col = static_cast<std::ptrdiff_t>(at) % photo.width_px;
  std::array<SeenLamp, kLampSizes> sum{};
  double largest = 0.0;
  for (const double d : scene_.lamp_sizes_mm)
    largest = std::fmax(largest, photo.lamp_diameter_mm + d);
  bool edge = false;
  float first = -1.0F;
  std::vector<Vec3> places;
  for (std::ptrdiff_t i = 0; i < kAcross; ++i)
    for (std::ptrdiff_t j = 0; j < kAcross; ++j) {
      const Sample& s = view.samples(kAcross * row + i, kAcross * col + j);
      if (std::isnan(s.x)) continue;
      const Vec3 p{s.x, s.y, static_cast<double>(s.z) + kOff_mm};
      places.push_back(p);
      if (first < 0.0F) first = s.lamp.share;
      edge |= s.lamp.share != first;
      edge = edge || differs_at_rim(tracer, p, lamp, largest, first >= 0.5F);
    }
  std::array<SeenLamp, kLampSizes> out;
  if (!edge || places.empty()) {
    out.fill({std::fmax(0.0F, first), 0.0F, 0.0F});
    return out;
  }
  std::vector<camera::DiscPoint> disc;
  for (std::size_t n = 0; n < places.size(); ++n) {
    camera::stratified_disc(kLampRays, 0x1a3bU + 64ULL * at + n, disc);
    for (std::size_t size = 0; size < kLampSizes; ++size) {
      const double diameter = std::fmax(0.0, photo.lamp_diameter_mm + scene_.lamp_sizes_mm[size]);
      sum[size] += seen_of(tracer, places[n], lamp, diameter, disc);
    }
  }
  for (std::size_t size = 0; size < kLampSizes; ++size)
    out[size] = mean_of(sum[size], static_cast<double>(places.size()));
  return out;
}

/// Sky, or surface that a lamp lights, from places on a grid.
void PhotoViews::look_around() {
  const ModelField& f = *surfaces_[0];
  const heightmap::FieldTracer& tracer = tracers_[tracer_of_[0]];
  const double wide = scene_.box.max.x - scene_.box.min.x,
               high = scene_.box.max.y - scene_.box.min.y;
  around_step_mm_ = std::fmax(wide, high) / static_cast<double>(kAround - 1);
  const auto rows = static_cast<std::ptrdiff_t>(high / around_step_mm_) + 1,
             cols = static_cast<std::ptrdiff_t>(wide / around_step_mm_) + 1;
  sky_ = Grid<float>(rows, cols, 1.0F);
  sky_side_.fill(Grid<float>(rows, cols, 0.0F));
  sky_side_[2] = Grid<float>(rows, cols, 1.0F);
  bounce_.assign(scene_.lamps, Grid<float>(rows, cols, 0.0F));
  struct Seen {
    float row, col;
  };
  std::vector<std::vector<Seen>> seen(static_cast<std::size_t>(rows * cols));
  std::vector<std::size_t> photo_of(scene_.lamps, 0);
  for (std::size_t k = scene_.photos.size(); k-- > 0;) photo_of[scene_.lamp_of[k]] = k;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const double x = scene_.box.min.x + around_step_mm_ * static_cast<double>(c),
                   y = scene_.box.min.y + around_step_mm_ * static_cast<double>(r);
      const double z = heightmap::height_at(f, x, y);
      if (std::isnan(z)) continue;
      const Vec3 n = normal_at(0, x, y);
      const auto [a, b] = across(n);
      const Vec3 p = Vec3{x, y, z} + kOff_mm * n;
      int open = 0;
      Vec3 from_open;
      std::vector<double> light(scene_.lamps, 0.0);
      for (int i = 0; i < kAroundRays; ++i) {
        const auto cell = static_cast<std::uint64_t>(r * cols + c);
        const double u = (i / 8 + random_uniform(cell, static_cast<std::uint64_t>(2 * i))) / 8.0,
                     v = (i % 8 + random_uniform(cell, static_cast<std::uint64_t>(2 * i + 1))) /
                         8.0;
        const camera::DiscPoint d = camera::concentric_disc(u, v);
        const Vec3 w =
            d.x * a + d.y * b + std::sqrt(std::fmax(0.0, 1.0 - d.x * d.x - d.y * d.y)) * n;
        const auto hit = tracer.trace(p, normalized(w));
        if (!hit) {
          if (w.z > 0.0) {  // the sky is above
            ++open;
            from_open += w;
          }
          continue;
        }
        seen[cell].push_back(
            {static_cast<float>((hit->point_mm.y - scene_.box.min.y) / around_step_mm_),
             static_cast<float>((hit->point_mm.x - scene_.box.min.x) / around_step_mm_)});
        for (std::size_t lamp = 0; lamp < scene_.lamps; ++lamp) {
          const PhotoInput& photo = scene_.photos[photo_of[lamp]];
          const Vec3 from = hit->point_mm + kOff_mm * hit->normal;
          const Vec3 to = photo.lamp_position_mm - from;
          const double way = norm(to), mu0 = dot(hit->normal, to) / way;
          if (!(mu0 > 0.0) || tracer.blocked(from, (1.0 / way) * to, way, 0.0)) continue;
          const Vec3 target = photo.lamp_target_mm - photo.lamp_position_mm;
          light[lamp] += photo.albedo * mu0 * dot(target, target) / (way * way);
        }
      }
      sky_(r, c) = static_cast<float>(open) / kAroundRays;
      for (const auto& [axis, sum] :
           {std::pair{0U, from_open.x}, {1U, from_open.y}, {2U, from_open.z}})
        sky_side_[axis](r, c) = static_cast<float>(1.5 * sum / kAroundRays);
      for (std::size_t lamp = 0; lamp < scene_.lamps; ++lamp)
        bounce_[lamp](r, c) = static_cast<float>(light[lamp] / kAroundRays);
    }
  });
  // Light that bounced lights again.
  bounce_all_ = bounce_;
  for (std::size_t lamp = 0; lamp < scene_.lamps; ++lamp) {
    const double albedo = scene_.photos[photo_of[lamp]].albedo;
    for (int again = 0; again < kBounces; ++again) {
      const Grid<float> before = bounce_all_[lamp];
      oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
        for (std::ptrdiff_t c = 0; c < cols; ++c) {
          double sum = 0.0;
          for (const Seen& at : seen[static_cast<std::size_t>(r * cols + c)])
            sum += bilinear(before, at.row, at.col);
          bounce_all_[lamp](r, c) =
              bounce_[lamp](r, c) + static_cast<float>(albedo * sum / kAroundRays);
        }
      });
    }
  }
}

/// What a place sees around it.
void PhotoViews::look_around_from(std::size_t k, PhotoPixel& p) const {
  const double row = (p.place.y - scene_.box.min.y) / around_step_mm_,
               col = (p.place.x - scene_.box.min.x) / around_step_mm_;
  p.sky = bilinear(sky_, row, col);
  for (std::size_t axis = 0; axis < 3; ++axis)
    p.sky_side[axis] = bilinear(sky_side_[axis], row, col);
  p.bounce = bilinear(bounce_[scene_.lamp_of[k]], row, col);
  p.bounce_all = bilinear(bounce_all_[scene_.lamp_of[k]], row, col);
}
/// A pixel as one of its rays meets the surface.
void PhotoViews::show(std::size_t k, const Sample& s, PhotoPixel& p) const {
  p.place = {s.x, s.y, s.z};
  p.normal = normal_at(k, s.x, s.y);
  p.lamp = s.lamp;
  look_around_from(k, p);
}

/// Means over a pixel's rays.
PhotoViews::RayLight PhotoViews::light_of(std::size_t k, std::uint32_t at, bool moved,
                                          const PhotoChain& chain) const {
  const PhotoInput& photo = scene_.photos[k];
  const View& view = views_[k];
  const Lamp lamp(scene_, state_, k);
  const auto row = static_cast<std::ptrdiff_t>(at) / photo.width_px,
             col = static_cast<std::ptrdiff_t>(at) % photo.width_px;
  PhotoPixel p;
  p.photo = static_cast<std::uint32_t>(k);
  double sum = 0.0;
  SeenLamp seen;
  std::vector<camera::DiscPoint> disc;
  for (std::ptrdiff_t i = 0; i < kAcross; ++i)
    for (std::ptrdiff_t j = 0; j < kAcross; ++j) {
      const Sample& s = view.samples(kAcross * row + i, kAcross * col + j);
      if (std::isnan(s.x)) continue;
      show(k, s, p);
      if (moved) {
        if (lamp.diameter_mm > 0.0)
          camera::stratified_disc(
              kLampRays, 0x51fU + 64ULL * at + static_cast<std::uint64_t>(2 * i + j), disc);
        else
          disc.assign(1, {});
        p.lamp = seen_of(tracers_[tracer_of_[k]], p.place + Vec3{0.0, 0.0, kOff_mm}, lamp,
                         lamp.diameter_mm, disc);
      }
      sum += chain.radiance(p);
      seen += p.lamp;
    }
  return {sum / (kAcross * kAcross), mean_of(seen, kAcross * kAcross)};
}

}  // namespace maquette::diagnosis::detail
