// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_views.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "camera/disc_samples.hpp"
#include "camera/effects/sampling.hpp"
#include "camera/image_io.hpp"
#include "camera/srgb.hpp"
#include "core/median.hpp"
#include "core/random.hpp"
#include "diagnosis/photographs.hpp"

namespace maquette::diagnosis::detail {
namespace {
using heightmap::ModelField;

constexpr std::ptrdiff_t kAcross = 2;        // rays of a pixel along each side
constexpr std::size_t kMostPixels = 50'000;  // of all photographs that are compared
/// Variance that a square pixel has beyond that of its rays, of a pixel's square.
constexpr double kPixelRest = 1.0 / (12.0 * kAcross * kAcross);
constexpr double kOff_mm = 1e-3;     // where a ray to the lamp starts above the surface
constexpr int kLampRays = 32;        // of a pixel's ray, to lamps with a size
constexpr std::ptrdiff_t kRim = 10;  // pixels beside the surface's end that are not compared
constexpr double kSaturated = 0.97;
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
bool same_lamp(const PhotoState& a, const PhotoState& b, std::size_t lamp) {
  return a.lamp_mm[lamp] == b.lamp_mm[lamp] &&
         a.lamp_refocused_mm[lamp] == b.lamp_refocused_mm[lamp] &&
         a.lamp_diameter_mm == b.lamp_diameter_mm;
}

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

/// Gaussians of less variance are no longer that when sampled at pixels (a tenth too narrow at
/// 0.27, 0.2 % at this): they are three values that have it.
constexpr double kNarrow_px2 = 0.49;

/// Separable Gaussian of that variance in pixels.
void blur(Grid<float>& image, double variance) {
  if (!(variance > 0.0)) return;
  const double sigma = std::sqrt(variance);
  // As a box of a pixel's width is in every sample's way anyway, the kernel is sampled at pixels.
  std::vector<float> k;
  if (variance < kNarrow_px2) {
    const auto side = static_cast<float>(0.5 * variance);
    k = {side, 1.0F - 2.0F * side, side};
  } else {
    const auto reach = static_cast<int>(std::ceil(4.0 * sigma));
    double sum = 0.0;
    for (int i = -reach; i <= reach; ++i) sum += std::exp(-0.5 * i * i / variance);
    for (int i = -reach; i <= reach; ++i)
      k.push_back(static_cast<float>(std::exp(-0.5 * i * i / variance) / sum));
  }
  const auto reach = static_cast<std::ptrdiff_t>(k.size() / 2);
  const std::ptrdiff_t rows = image.rows(), cols = image.cols();
  Grid<float> half(rows, cols, 0.0F);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      float sum = 0.0F;
      for (std::ptrdiff_t i = -reach; i <= reach; ++i)
        sum += k[static_cast<std::size_t>(i + reach)] *
               image(r, std::clamp<std::ptrdiff_t>(c + i, 0, cols - 1));
      half(r, c) = sum;
    }
  });
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      float sum = 0.0F;
      for (std::ptrdiff_t i = -reach; i <= reach; ++i)
        sum += k[static_cast<std::size_t>(i + reach)] *
               half(std::clamp<std::ptrdiff_t>(r + i, 0, rows - 1), c);
      image(r, c) = sum;
    }
  });
}

/// Gaussian of each pixel's own variance, where that is not 0.
void blur_by_place(Grid<float>& image, const Grid<float>& variance) {
  const Grid<float> from = image;
  const std::ptrdiff_t rows = image.rows(), cols = image.cols();
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    std::vector<double> weight;
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const auto v = static_cast<double>(variance(r, c));
      if (!(v > 0.0)) continue;
      const bool narrow = v < kNarrow_px2;
      const std::ptrdiff_t reach =
          narrow ? 1 : static_cast<std::ptrdiff_t>(std::ceil(4.0 * std::sqrt(v)));
      weight.clear();
      for (std::ptrdiff_t i = -reach; i <= reach; ++i)
        weight.push_back(narrow ? (i == 0 ? 1.0 - v : 0.5 * v)
                                : std::exp(-0.5 * static_cast<double>(i * i) / v));
      double sum = 0.0, all = 0.0;
      for (std::ptrdiff_t i = -reach; i <= reach; ++i)
        for (std::ptrdiff_t j = -reach; j <= reach; ++j) {
          const double w = weight[static_cast<std::size_t>(i + reach)] *
                           weight[static_cast<std::size_t>(j + reach)];
          all += w;
          sum += w * static_cast<double>(from(std::clamp<std::ptrdiff_t>(r + i, 0, rows - 1),
                                              std::clamp<std::ptrdiff_t>(c + j, 0, cols - 1)));
        }
      image(r, c) = static_cast<float>(sum / all);
    }
  });
}

/// Between nodes; the edge goes on.
float bilinear(const Grid<float>& g, double r, double c) {
  return camera::bilinear(g, static_cast<float>(c) + 0.5F, static_cast<float>(r) + 0.5F);
}
float cubic(const Grid<float>& g, double r, double c) {
  return camera::bicubic(g, static_cast<float>(c) + 0.5F, static_cast<float>(r) + 0.5F);
}

/// A straight motion: values along a line, its variance that of the tensor's larger axis; what is
/// across is Gaussian.
/// @param wanted  (row, column): elsewhere the picture stays as it is
template <class Wanted>
void smear(Grid<float>& image, const std::array<double, 3>& px2, const Wanted& wanted) {
  const double mean = 0.5 * (px2[0] + px2[2]), apart = std::hypot(0.5 * (px2[0] - px2[2]), px2[1]),
               most = mean + apart;
  if (!(most > 1e-6)) return;
  const double angle = 0.5 * std::atan2(2.0 * px2[1], px2[0] - px2[2]);
  const double length = std::sqrt(12.0 * most);
  const int n = std::max(3, 2 * static_cast<int>(std::ceil(length)) + 1);
  const Grid<float> from = image;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, image.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < image.cols(); ++c) {
      if (!wanted(r, c)) continue;
      float sum = 0.0F;
      for (int i = 0; i < n; ++i) {
        const double at = length * ((i + 0.5) / n - 0.5);
        sum += cubic(from, static_cast<double>(r) + at * std::sin(angle),
                     static_cast<double>(c) + at * std::cos(angle));
      }
      image(r, c) = sum / static_cast<float>(n);
    }
  });
  blur(image, std::fmax(0.0, mean - apart));
}

}  // namespace

Result<Photograph> read_photograph(const PhotoInput& photo) {
  MAQUETTE_TRY(auto image, camera::read_image(photo.image));
  std::erase_if(image.names, [](const std::string& n) { return n == "A"; });
  if (image.channels.size() > image.names.size()) image.channels.resize(image.names.size());
  const auto& first = image.channels.front();
  if (first.cols() != photo.width_px || first.rows() != photo.height_px)
    return fail(kPhotograph,
                fmt::format("{}: {} x {} pixels, the case says resolution_px = [{}, {}]; give the "
                            "picture as it was taken or correct the case",
                            photo.image.string(), first.cols(), first.rows(), photo.width_px,
                            photo.height_px));
  if (image.channels.size() != 1 && image.channels.size() < 3)
    return fail(kPhotograph, fmt::format("{}: {} channels; expected one, or red, green and blue",
                                         photo.image.string(), image.channels.size()));
  image.channels.resize(std::min<std::size_t>(3, image.channels.size()));
  Photograph p;
  p.value = std::move(image.channels);
  if (p.value.size() == 3) {
    // EXR files order channels by name.
    const auto at = [&](const char* name) {
      return std::find(image.names.begin(), image.names.end(), name) - image.names.begin();
    };
    if (at("R") == 2 && at("B") == 0) std::swap(p.value[0], p.value[2]);
  }
  if (photo.srgb) {
    if (image.eight_bit) p.quantum = 1.0 / 255.0;
    for (auto& channel : p.value)
      for (float& v : channel.cells()) v = camera::linear_of_srgb(v);
  }
  return p;
}

PhotoViews::PhotoViews(const PhotoScene& scene, std::vector<Photograph> photographs,
                       std::vector<const ModelField*> surfaces, bool held_out)
    : scene_(scene),
      held_out_(held_out),
      photographs_(std::move(photographs)),
      surfaces_(std::move(surfaces)) {
  std::vector<const ModelField*> known;
  for (const ModelField* s : surfaces_) {
    auto at = std::find(known.begin(), known.end(), s);
    if (at == known.end()) {
      tracers_.emplace_back(*s);
      known.push_back(s);
      at = known.end() - 1;
    }
    tracer_of_.push_back(static_cast<std::size_t>(at - known.begin()));
  }
  const auto shown = static_cast<std::size_t>(
      std::count_if(scene_.photos.begin(), scene_.photos.end(),
                    [&](const PhotoInput& p) { return p.held_out == held_out_; }));
  const std::size_t most = kMostPixels / std::max<std::size_t>(1, shown);
  views_.resize(scene_.photos.size());
  for (std::size_t k = 0; k < scene_.photos.size(); ++k) {
    if (!shows(k)) continue;
    const PhotoInput& photo = scene_.photos[k];
    View view{Grid<Sample>(kAcross * photo.height_px, kAcross * photo.width_px), 1, {}, {}};
    // A lattice that is finer than its share, thinned by what lies on the surface later.
    const double pixels = static_cast<double>(photo.width_px) * photo.height_px;
    const auto step = std::max(
        1, static_cast<int>(std::floor(std::sqrt(pixels / static_cast<double>(most)) + 0.4)));
    view.step = step;
    for (int r = step / 2; r < photo.height_px; r += step)
      for (int c = step / 2; c + 1 < photo.width_px; c += step)
        view.lattice.push_back(static_cast<std::uint32_t>(r * photo.width_px + c));
    views_[k] = std::move(view);
  }
}

/// How far around a pixel of the lattice a picture is needed: for derivatives and for what the lens
/// spreads.
std::ptrdiff_t PhotoViews::reach() const {
  double spread = 0.0;
  for (const PictureState& p : state_.picture)
    spread = std::fmax(spread, std::fmax(p.blur_px2, 0.0) + p.smear_px2[0] + p.smear_px2[2]);
  double focus = 0.0;
  const Vec3 low = scene_.box.min, high = scene_.box.max;
  for (std::size_t k = 0; k < views_.size(); ++k)
    for (const double x : {low.x, high.x})
      for (const double y : {low.y, high.y})
        for (const double z : {low.z, high.z})
          focus = std::fmax(focus, focus_px2({x, y, z}, k, state_, scene_));
  spread += focus;
  return 2 + static_cast<std::ptrdiff_t>(std::ceil(4.0 * std::sqrt(std::fmax(0.0, spread)))) +
         (state_.red_scale != 0.0 || state_.blue_scale != 0.0 ? 4 : 0);
}

void PhotoViews::look_at(const std::function<bool(const Vec3& place)>& kind) {
  for (View& view : views_) view.looked_at.clear();
  looks_anew_ = true;
  if (!kind) return;
  std::vector<std::vector<std::uint8_t>> of(views_.size());
  for (std::size_t k = 0; k < views_.size(); ++k) of[k].assign(views_[k].lattice.size(), 0);
  std::vector<std::size_t> next(views_.size(), 0);
  for (const MeasuredPixel& p : pixels_) {  // in the lattice's order
    const auto& lattice = views_[p.photo].lattice;
    std::size_t& at = next[p.photo];
    while (lattice[at] != p.at) ++at;
    of[p.photo][at] = kind(p.place) ? 1 : 0;
  }
  for (std::size_t k = 0; k < views_.size(); ++k)
    if (std::find(of[k].begin(), of[k].end(), 1) != of[k].end())
      views_[k].looked_at = std::move(of[k]);
}

/// @post views_[k].near is what the reach asks for
void PhotoViews::find_near(std::size_t k) {
  View& view = views_[k];
  if (view.looked_at.empty()) return;
  const PhotoInput& photo = scene_.photos[k];
  const std::ptrdiff_t rows = (photo.height_px + view.step - 1) / view.step,
                       cols = (photo.width_px + view.step - 1) / view.step,
                       around = 1 + reach() / view.step;
  view.near = Grid<std::uint8_t>(rows, cols, 0);
  for (std::size_t n = 0; n < view.lattice.size(); ++n) {
    if (view.looked_at[n] == 0) continue;
    const auto at = static_cast<std::ptrdiff_t>(view.lattice[n]);
    const std::ptrdiff_t r = at / photo.width_px / view.step, c = at % photo.width_px / view.step;
    for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - around);
         i <= std::min(rows - 1, r + around); ++i)
      for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, c - around);
           j <= std::min(cols - 1, c + around); ++j)
        view.near(i, j) = 1;
  }
}

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
  // Penumbras: where a neighbour within their width sees what this does not. Along the light a low
  // lamp stretches them twice: the shadow, and the angle at which its edge meets the ground.
  const PhotoInput& photo = scene_.photos[k];
  const Vec3 from_target = lamp.position - photo.lamp_target_mm;
  const double sine = std::fmax(0.1, from_target.z / norm(from_target));
  const auto reach = std::clamp<std::ptrdiff_t>(
      static_cast<std::ptrdiff_t>(
          std::ceil(kAcross * penumbra_px(lamp.diameter_mm) / (sine * sine))) +
          1,
      2, 400);
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

Grid<float> PhotoViews::picture(std::size_t k, Grid<float>& hits) const {
  const PhotoInput& photo = scene_.photos[k];
  const View& view = views_[k];
  Grid<float> image(photo.height_px, photo.width_px, 0.0F);
  hits = Grid<float>(photo.height_px, photo.width_px, 0.0F);
  const std::ptrdiff_t far = reach();
  const PhotoChain chain(state_, state_, scene_);
  oneapi::tbb::parallel_for(0, photo.height_px, [&](int r) {
    PhotoPixel p;
    p.photo = static_cast<std::uint32_t>(k);
    for (int c = 0; c < photo.width_px; ++c) {
      if (!view.wanted(r, c, far)) continue;
      double sum = 0.0;
      int hit = 0;
      for (std::ptrdiff_t i = 0; i < kAcross; ++i)
        for (std::ptrdiff_t j = 0; j < kAcross; ++j) {
          const Sample& s = view.samples(kAcross * r + i, kAcross * c + j);
          if (std::isnan(s.x)) continue;
          ++hit;
          show(k, s, p);
          sum += chain.radiance(p);
        }
      image(r, c) = static_cast<float>(sum / (kAcross * kAcross));
      hits(r, c) = static_cast<float>(hit) / (kAcross * kAcross);
    }
  });
  return image;
}

/// Those of the lattice that are compared, in every model: on the surface, not at its rim, not
/// saturated.
void PhotoViews::select(std::size_t k, const Grid<float>& hits) {
  const PhotoInput& photo = scene_.photos[k];
  View& view = views_[k];
  const std::ptrdiff_t far = reach();
  double part = 0.0;
  for (const std::uint32_t at : view.lattice) {
    const auto share = static_cast<double>(hits(static_cast<std::ptrdiff_t>(at) / photo.width_px,
                                                static_cast<std::ptrdiff_t>(at) % photo.width_px));
    part += share;
    if (share == 0.0) view.beside.push_back(at);
  }
  view.part_share = part / std::fmax(1.0, static_cast<double>(view.lattice.size()));
  std::erase_if(view.lattice, [&](std::uint32_t at) {
    const std::ptrdiff_t r = static_cast<std::ptrdiff_t>(at) / photo.width_px,
                         c = static_cast<std::ptrdiff_t>(at) % photo.width_px;
    if (r < kRim || c < kRim || r >= photo.height_px - kRim || c >= photo.width_px - kRim)
      return true;
    for (std::ptrdiff_t i = -kRim; i <= kRim; ++i)
      for (std::ptrdiff_t j = -kRim; j <= kRim; ++j)
        if (view.wanted(r + i, c + j, far) && hits(r + i, c + j) < 1.0F) return true;
    for (const Grid<float>& channel : photographs_[k].value)
      for (const std::ptrdiff_t j : {0, 1})
        if (!(channel(r, c + j) < kSaturated)) return true;  // NaN too
    return false;
  });
}

/// What a picture's veil is a share of. Beside the part nothing is rendered: there the measured
/// numbers are taken back through the sensor, less the veil that is in them already.
/// @param change  of the part's light since it was pictured
double PhotoViews::mean_light(std::size_t k, std::size_t channel, double change) const {
  const PhotoInput& photo = scene_.photos[k];
  const View& view = views_[k];
  const Photograph& taken = photographs_[k];
  const int colour = channel_of(channel, taken.value.size());
  double sum = 0.0, count = 0.0;
  for (const std::uint32_t at : view.beside) {
    const auto y =
        static_cast<double>(taken.value[channel](static_cast<std::ptrdiff_t>(at) / photo.width_px,
                                                 static_cast<std::ptrdiff_t>(at) % photo.width_px));
    if (std::isnan(y)) continue;
    sum += before_sensor(y, colour, k, state_);
    count += 1.0;
  }
  const double beside = 1.0 - view.part_share;
  const double with_veil = count > 0.0 ? sum / count : 0.0, kept = 1.0 - state_.veil_scattered,
               veil = state_.veil + state_.veil_scattered;
  const double damped = 1.0 + beside * veil / kept;
  const double part = change * (static_cast<double>(view.light_of_part[0]) +
                                state_.vignette_2 * static_cast<double>(view.light_of_part[1]) +
                                state_.vignette_4 * static_cast<double>(view.light_of_part[2]));
  return (view.part_share * part + std::fmax(0.0, beside * with_veil / kept)) / damped;
}

void PhotoViews::take_pixels(std::size_t k, bool lamp_sizes, std::vector<MeasuredPixel>& out) {
  const PhotoInput& photo = scene_.photos[k];
  View& view = views_[k];
  const Photograph& taken = photographs_[k];
  const PictureState& own = state_.picture[k];
  Grid<float> hits;
  Grid<float> image = picture(k, hits);
  if (!selected_) select(k, hits);
  const bool sizes_anew = lamp_sizes && view.lamp_of_size.empty();
  if (sizes_anew) view.lamp_of_size.resize(view.lattice.size());
  const auto beyond =
      2 + static_cast<std::ptrdiff_t>(std::ceil(4.0 * std::sqrt(std::fmax(0.0, own.blur_px2))));
  smear(image, own.smear_px2,
        [&](std::ptrdiff_t r, std::ptrdiff_t c) { return view.wanted(r, c, beyond); });
  blur(image, kPixelRest + own.blur_px2);
  if (state_.focus_px2 != std::array<double, 3>{}) {
    Grid<float> variance(image.rows(), image.cols(), 0.0F);
    for (std::ptrdiff_t r = 0; r < image.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < image.cols(); ++c) {
        const Sample& s = view.samples(kAcross * r, kAcross * c);
        if (!view.wanted(r, c, 2) || std::isnan(s.x)) continue;
        variance(r, c) = static_cast<float>(focus_px2({s.x, s.y, s.z}, k, state_, scene_));
      }
    blur_by_place(image, variance);
  }
  const auto half_u = photo.principal_u_px, half_v = photo.principal_v_px;
  const auto coloured = [&](int channel, double r, double c) {
    const double scale = channel == 0 ? state_.red_scale : channel == 2 ? state_.blue_scale : 0.0;
    if (scale == 0.0) return image(static_cast<std::ptrdiff_t>(r), static_cast<std::ptrdiff_t>(c));
    return cubic(image, (r + 0.5 - half_v) / (1.0 + scale) + half_v - 0.5,
                 (c + 0.5 - half_u) / (1.0 + scale) + half_u - 0.5);
  };
  // Of the part as rendered; of what lies beside it as measured.
  std::array<double, 3> moments{};
  double count = 0.0;
  const std::ptrdiff_t far = reach();
  for (int r = 0; r < photo.height_px; ++r)
    for (int c = 0; c < photo.width_px; ++c) {
      if (!view.wanted(r, c, far) || !(hits(r, c) > 0.0F)) continue;
      const double r2 = radius2(c + 0.5 - half_u, r + 0.5 - half_v, photo);
      double light = image(r, c);
      for (double& m : moments) {
        m += light;
        light *= r2;
      }
      count += static_cast<double>(hits(r, c));
    }
  for (std::size_t i = 0; i < moments.size(); ++i)
    view.light_of_part[i] = static_cast<float>(moments[i] / std::fmax(1.0, count));
  std::array<float, 3> mean{};
  for (std::size_t ch = 0; ch < taken.value.size(); ++ch)
    mean[ch] = static_cast<float>(mean_light(k, ch, 1.0));
  const PhotoChain chain(state_, state_, scene_);
  std::vector<MeasuredPixel> made(view.lattice.size());
  std::vector<std::uint8_t> good(view.lattice.size(), 0);
  oneapi::tbb::parallel_for(std::size_t{0}, view.lattice.size(), [&](std::size_t n) {
    if (!view.looked_at.empty() && view.looked_at[n] == 0) return;
    const auto at = static_cast<std::ptrdiff_t>(view.lattice[n]);
    const std::ptrdiff_t r = at / photo.width_px, c = at % photo.width_px;
    MeasuredPixel p;
    p.photo = static_cast<std::uint32_t>(k);
    p.u = static_cast<float>(static_cast<double>(c) + 0.5 - half_u);
    p.v = static_cast<float>(static_cast<double>(r) + 0.5 - half_v);
    double rays = 0.0;
    SeenLamp seen;
    for (std::ptrdiff_t i = 0; i < kAcross; ++i)
      for (std::ptrdiff_t j = 0; j < kAcross; ++j) {
        const Sample& sample = view.samples(kAcross * r + i, kAcross * c + j);
        if (std::isnan(sample.x)) continue;
        rays += 1.0;
        p.place += Vec3{sample.x, sample.y, sample.z};
        p.normal += normal_at(k, sample.x, sample.y);
        seen += sample.lamp;
      }
    if (!(rays > 0.0)) return;
    p.place = (1.0 / rays) * p.place;
    p.normal = normalized(p.normal);
    p.lamp = mean_of(seen, rays);
    if (sizes_anew) view.lamp_of_size[n] = lamp_of_sizes(k, static_cast<std::uint32_t>(at));
    if (!view.lamp_of_size.empty()) p.lamp_of_size = view.lamp_of_size[n];
    p.at = static_cast<std::uint32_t>(at);
    p.of_rays = light_of(k, p.at, false, chain).light;
    look_around_from(k, p);
    p.light = chain.radiance(p);
    const auto z = [&](std::ptrdiff_t i, std::ptrdiff_t j) { return image(r + i, c + j); };
    p.du = 0.5F * (z(0, 1) - z(0, -1));
    p.dv = 0.5F * (z(1, 0) - z(-1, 0));
    p.duu = z(0, 1) - 2.0F * z(0, 0) + z(0, -1);
    p.dvv = z(1, 0) - 2.0F * z(0, 0) + z(-1, 0);
    p.duv = 0.25F * (z(1, 1) - z(1, -1) - z(-1, 1) + z(-1, -1));
    for (std::size_t ch = 0; ch < taken.value.size(); ++ch) {
      const int channel = channel_of(ch, taken.value.size());
      const auto more = static_cast<float>(tint(p, channel, state_, scene_));
      p.value[ch] = more + coloured(channel, static_cast<double>(r), static_cast<double>(c));
      p.value_next[ch] =
          more + coloured(channel, static_cast<double>(r), static_cast<double>(c + 1));
      p.mean[ch] = mean[ch];
      const double y = static_cast<double>(taken.value[ch](r, c));
      p.measured[ch] = static_cast<float>(y);
      p.next[ch] = taken.value[ch](r, c + 1);
      const double model = number_of(p, ch, p.value[ch]);
      // Electrons scatter, not the offset that is added to them; a tone curve stretches that: by
      // what it makes of the scatter as a whole, for in the dark it bends within it.
      const double power = 1.0 + state_.gamma,
                   linear = std::copysign(std::pow(std::abs(model), 1.0 / power), model),
                   sigma = std::sqrt(std::fmax(0.0, linear - own.black) * photo.full_well_e +
                                     photo.read_noise_e * photo.read_noise_e) /
                           photo.full_well_e;
      double variance = sigma * sigma;
      if (state_.gamma != 0.0) {
        const auto toned = [&](double v) { return std::copysign(std::pow(std::abs(v), power), v); };
        variance = std::pow(0.5 * (toned(linear + sigma) - toned(linear - sigma)), 2);
      }
      if (taken.quantum > 0.0) {
        const double l = std::clamp(model, 0.0, 1.0);
        const double slope = l <= 0.0031308 ? 1.0 / 12.92 : 2.4 / 1.055 * std::pow(l, 1.4 / 2.4);
        variance += std::pow(taken.quantum * slope, 2) / 12.0;
      }
      p.variance[ch] = static_cast<float>(variance);
    }
    made[n] = p;
    good[n] = 1;
  });
  for (std::size_t n = 0; n < made.size(); ++n)
    if (good[n] == 1) out.push_back(made[n]);
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

/// Light anew at the pixels, the pictures around them as they were.
void PhotoViews::light_pixels() {
  const PhotoChain chain(state_, state_, scene_);
  if (!same_light(pictured_, state_))
    oneapi::tbb::parallel_for(std::size_t{0}, pixels_.size(), [&](std::size_t i) {
      MeasuredPixel& p = pixels_[i];
      const double was = p.of_rays;
      const RayLight now =
          light_of(p.photo, p.at, !same_lamp(pictured_, state_, scene_.lamp_of[p.photo]), chain);
      p.of_rays = now.light;
      p.lamp = now.lamp;
      const auto by = static_cast<float>(p.of_rays - was);
      for (float& v : p.value) v += by;
      for (float& v : p.value_next) v += by;
      p.light = chain.radiance(p);
    });
  if (pictured_.ambient_red != state_.ambient_red || pictured_.ambient_blue != state_.ambient_blue)
    for (MeasuredPixel& p : pixels_)
      for (std::size_t ch = 0; ch < channels(); ++ch) {
        const int channel = channel_of(ch, channels());
        const auto by = static_cast<float>(tint(p, channel, state_, scene_) -
                                           tint(p, channel, pictured_, scene_));
        p.value[ch] += by;
        p.value_next[ch] += by;
      }
  // A picture's mean follows that of its pixels; what lies beside the part stays.
  const std::vector<double> now = light_by_photo();
  std::vector<std::array<float, 3>> mean(scene_.photos.size());
  for (std::size_t k = 0; k < mean.size(); ++k)
    for (std::size_t ch = 0; shows(k) && ch < channels(); ++ch)
      mean[k][ch] = static_cast<float>(
          mean_light(k, ch, light_before_[k] > 0.0 ? now[k] / light_before_[k] : 1.0));
  for (MeasuredPixel& p : pixels_) p.mean = mean[p.photo];
}

/// Do features move so little from where they were pictured that derivatives say what pixels show?
bool PhotoViews::hardly_moves(const PhotoState& state) const {
  if (same_places(pictured_, state)) return true;
  constexpr double kLittle_px = 0.2;
  constexpr std::size_t kEach = 61;
  for (std::size_t i = 0; i < pictured_pixels_.size(); i += kEach)
    for (std::size_t ch = 0; ch < channels(); ++ch) {
      const MeasuredPixel& p = pictured_pixels_[i];
      const int channel = channel_of(ch, channels());
      const auto to = displacement(p, channel, state, scene_),
                 was = displacement(p, channel, pictured_, scene_);
      if (!(std::hypot(to[0] - was[0], to[1] - was[1]) < kLittle_px)) return false;
    }
  return true;
}

/// What pixels show where features have moved a little.
void PhotoViews::shift_pixels() {
  oneapi::tbb::parallel_for(std::size_t{0}, pixels_.size(), [&](std::size_t i) {
    MeasuredPixel& p = pixels_[i];
    for (std::size_t ch = 0; ch < channels(); ++ch) {
      const auto by =
          static_cast<float>(shown_after(p, channel_of(ch, channels()), state_, pictured_, scene_));
      p.value[ch] += by;
      p.value_next[ch] += by;
    }
  });
}

/// Mean of the rays' light over the pixels of each photograph.
std::vector<double> PhotoViews::light_by_photo() const {
  std::vector<double> sum(scene_.photos.size(), 0.0), count(scene_.photos.size(), 0.0);
  for (const MeasuredPixel& p : pixels_) {
    sum[p.photo] += p.of_rays;
    count[p.photo] += 1.0;
  }
  for (std::size_t k = 0; k < sum.size(); ++k) sum[k] /= std::fmax(1.0, count[k]);
  return sum;
}

double PhotoViews::penumbra_px(double diameter_mm) const {
  const PhotoInput& photo = scene_.photos[0];
  const double way = norm(photo.lamp_position_mm - photo.lamp_target_mm);
  return diameter_mm * (scene_.box.max.z - scene_.box.min.z) / way * photo.focal_length_mm *
         1000.0 / photo.pixel_pitch_um / norm(photo.camera_position_mm - photo.lamp_target_mm);
}

double PhotoViews::roughness() const {
  std::vector<double> difference;
  for (const MeasuredPixel& p : pixels_)
    difference.push_back(
        static_cast<double>((p.next[0] - p.value_next[0]) - (p.measured[0] - p.value[0])));
  return nmad(std::move(difference));
}

void PhotoViews::render(const PhotoState& state, Normals normals, bool derivatives,
                        bool lamp_sizes) {
  const auto knows_sizes = [&] {
    for (std::size_t k = 0; k < views_.size(); ++k)
      if (shows(k) && views_[k].lamp_of_size.empty()) return false;
    return true;
  };
  if (!derivatives && rendered_ && !looks_anew_ && normals == normals_ &&
      same_sharpness(pictured_, state) && (!lamp_sizes || knows_sizes()) && hardly_moves(state)) {
    // What was shown before is the start again: steps do not add up.
    state_ = state;
    pixels_ = pictured_pixels_;
    light_pixels();
    if (!same_places(pictured_, state_)) shift_pixels();
    return;
  }
  const PhotoState before = traced_;
  const bool first = !rendered_;
  state_ = state;
  normals_ = normals;
  take_slopes();
  rendered_ = true;
  if (first) look_around();
  const double base = scene_.photos[0].lamp_diameter_mm + state_.lamp_diameter_mm;
  constexpr std::array<double, kLampSizes> kFromPoint{10.0, 20.0, 40.0, 80.0, 160.0, 320.0},
      kAbout{0.5, 0.7, 0.85, 1.18, 1.4, 2.0};
  for (std::size_t k = 0; k < kLampSizes; ++k)
    scene_.lamp_sizes_mm[k] =
        (base > 5.0 ? base * kAbout[k] : kFromPoint[k]) - scene_.photos[0].lamp_diameter_mm;
  pixels_.clear();
  for (std::size_t k = 0; k < scene_.photos.size(); ++k) {
    if (!shows(k)) continue;
    const bool lens = first || looks_anew_ || views_[k].traced_reach < reach() ||
                      !same_stand(before.picture[k], state_.picture[k]) ||
                      before.focal != state_.focal || before.radial_1 != state_.radial_1 ||
                      before.radial_2 != state_.radial_2;
    if (lens) {
      find_near(k);
      trace(k);
      views_[k].traced_reach = reach();
    }
    const bool other_sight = lens || !same_lamp(before, state_, scene_.lamp_of[k]);
    if (other_sight) {
      see_lamp(k);
      views_[k].lamp_of_size.clear();
    }
    take_pixels(k, lamp_sizes, pixels_);
  }
  traced_ = state_;
  looks_anew_ = false;
  selected_ = true;
  pictured_ = state_;
  pictured_pixels_ = pixels_;
  light_before_ = light_by_photo();
}

double PhotoViews::number_of(const MeasuredPixel& p, std::size_t channel, float behind_lens) const {
  return exposed(static_cast<double>(behind_lens), static_cast<double>(p.mean[channel]),
                 radius2(p.u, p.v, scene_.photos[p.photo]), channel_of(channel, channels()),
                 p.photo, state_);
}

void PhotoViews::simulate(const PhotoState& state, Normals normals, double noise_factor,
                          std::uint64_t seed) {
  render(state, normals, true, false);
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    MeasuredPixel& p = pixels_[i];
    const PhotoInput& photo = scene_.photos[p.photo];
    const auto r = static_cast<std::ptrdiff_t>(p.at) / photo.width_px,
               c = static_cast<std::ptrdiff_t>(p.at) % photo.width_px;
    auto& taken = photographs_[p.photo].value;
    for (std::size_t ch = 0; ch < taken.size(); ++ch) {
      const auto of = [&](float behind_lens, std::uint64_t draw) {
        return static_cast<float>(number_of(p, ch, behind_lens) +
                                  noise_factor * std::sqrt(static_cast<double>(p.variance[ch])) *
                                      random_normal(seed, 2 * (3 * i + ch) + draw));
      };
      taken[ch](r, c) = p.measured[ch] = of(p.value[ch], 0);
      taken[ch](r, c + 1) = p.next[ch] = of(p.value_next[ch], 1);
    }
  }
  pictured_pixels_ = pixels_;
}

}  // namespace maquette::diagnosis::detail
