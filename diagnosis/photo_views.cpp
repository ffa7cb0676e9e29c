// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_views.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <oneapi/tbb/parallel_for.h>

#include "camera/image_io.hpp"
#include "camera/srgb.hpp"
#include "core/median.hpp"
#include "core/random.hpp"
#include "diagnosis/detail/cut_off.hpp"
#include "diagnosis/detail/pictures.hpp"
#include "diagnosis/photographs.hpp"

namespace maquette::diagnosis::detail {
namespace {
using heightmap::ModelField;

constexpr std::size_t kMostPixels = 50'000;  // of all photographs that are compared
constexpr std::ptrdiff_t kRim = 10;  // pixels beside the surface's end that are not compared
constexpr double kSaturated = 0.97;
constexpr std::ptrdiff_t kEach = 8;  // pixels of a square that halos are made of

/// Mean of what was measured up to two pixels away: a fifth of one pixel's noise.
double mean_around(const Grid<float>& value, std::ptrdiff_t row, std::ptrdiff_t col) {
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, row - 2);
       r <= std::min(value.rows() - 1, row + 2); ++r)
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, col - 2);
         c <= std::min(value.cols() - 1, col + 2); ++c) {
      const auto y = static_cast<double>(value(r, c));
      if (std::isnan(y)) continue;
      sum += y;
      n += 1.0;
    }
  return sum / std::fmax(1.0, n);
}

}  // namespace

Result<Photograph> read_photograph(const PhotoInput& photo) {
  MAQUETTE_TRY(auto image, camera::read_image(photo.image));
  const auto& first = image.channels.front();
  if (first.cols() != photo.width_px || first.rows() != photo.height_px)
    return fail(kPhotograph,
                fmt::format("{}: {} x {} pixels, the case says resolution_px = [{}, {}]; give the "
                            "picture as it was taken or correct the case",
                            photo.image.string(), first.cols(), first.rows(), photo.width_px,
                            photo.height_px));
  // Files order channels by name, and renderers add others (distance, normals).
  Photograph p;
  const auto take = [&](std::initializer_list<const char*> names) {
    for (const char* name : names) {
      Grid<float>* const channel = camera::channel_of(image, name);
      if (channel == nullptr) return p.value.clear();
      p.value.push_back(std::move(*channel));
    }
  };
  if (image.channels.size() > 1) take({"R", "G", "B"});
  if (image.channels.size() > 1 && p.value.empty()) take({"Y"});
  if (image.channels.size() == 1) p.value = std::move(image.channels);
  if (p.value.empty())
    return fail(kPhotograph,
                fmt::format("{}: channels {}; expected R, G and B, or Y, or a single one",
                            photo.image.string(), fmt::join(image.names, ", ")));
  if (photo.srgb) {
    if (image.eight_bit) p.quantum = 1.0 / 255.0;
    for (auto& channel : p.value)
      for (float& v : channel.cells()) v = camera::linear_of_srgb(v);
  }
  return p;
}

PhotoViews::PhotoViews(const PhotoScene& scene, std::vector<Photograph> photographs,
                       std::vector<const ModelField*> surfaces,
                       std::vector<Grid<std::uint8_t>> left_out, bool held_out)
    : scene_(scene),
      left_out_(std::move(left_out)),
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
  dark_.resize(scene_.photos.size());
  around_.resize(scene_.photos.size());
  for (std::size_t k = 0; k < scene_.photos.size(); ++k) {
    if (!shows(k)) continue;
    const PhotoInput& photo = scene_.photos[k];
    View view{Grid<Sample>(kAcross * photo.height_px, kAcross * photo.width_px), 1, {}, {}};
    // A lattice that is finer than its share, thinned by what lies on the surface later. Its step
    // is odd: sensors and mosaics differ between even and odd rows and columns, and all are to be
    // seen.
    const double pixels = static_cast<double>(photo.width_px) * photo.height_px;
    const double share = std::sqrt(pixels / static_cast<double>(most));
    const int step = share < 1.6 ? 1 : std::max(3, 2 * static_cast<int>(0.5 * share) + 1);
    view.step = step;
    for (int r = step / 2; r < photo.height_px; r += step)
      for (int c = step / 2; c + 1 < photo.width_px; c += step)
        view.lattice.push_back(static_cast<std::uint32_t>(r * photo.width_px + c));
    views_[k] = std::move(view);
    take_surroundings(k);
  }
}

/// Halos are wide: of squares of kEach pixels. Beyond its edge a picture is black: nothing is known
/// of what lies there, and what is scattered there is lost.
void PhotoViews::take_surroundings(std::size_t k) {
  const auto& value = photographs_[k].value;
  for (std::size_t ch = 0; ch < value.size(); ++ch) {
    const std::ptrdiff_t rows = (value[ch].rows() + kEach - 1) / kEach,
                         cols = (value[ch].cols() + kEach - 1) / kEach;
    const auto rim = static_cast<std::ptrdiff_t>(
        std::ceil(3.0 * kHaloWidths.back() * static_cast<double>(cols)));
    Grid<float> small(rows + 2 * rim, cols + 2 * rim, 0.0F);
    for (std::ptrdiff_t r = 0; r < value[ch].rows(); ++r)
      for (std::ptrdiff_t c = 0; c < value[ch].cols(); ++c)
        if (const float y = value[ch](r, c); !std::isnan(y))
          small(rim + r / kEach, rim + c / kEach) += y / static_cast<float>(kEach * kEach);
    for (std::size_t w = 0; w < kHaloWidths.size(); ++w) {
      Grid<float> wide = small;
      blur(wide, std::pow(kHaloWidths[w] * static_cast<double>(cols), 2));
      Grid<float>& around = around_[k][ch][w] = Grid<float>(rows, cols);
      for (std::ptrdiff_t r = 0; r < rows; ++r)
        for (std::ptrdiff_t c = 0; c < cols; ++c) around(r, c) = wide(rim + r, rim + c);
    }
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
/// saturated, not left out.
void PhotoViews::select(std::size_t k, const Grid<float>& hits) {
  const PhotoInput& photo = scene_.photos[k];
  View& view = views_[k];
  const std::ptrdiff_t far = reach();
  double part = 0.0;
  for (const std::uint32_t at : view.lattice) {
    const auto share = static_cast<double>(hits(static_cast<std::ptrdiff_t>(at) / photo.width_px,
                                                static_cast<std::ptrdiff_t>(at) % photo.width_px));
    if (share == 0.0 || is_left_out(k, at))
      view.beside.push_back(at);
    else
      part += share;
  }
  view.part_share = part / std::fmax(1.0, static_cast<double>(view.lattice.size()));
  std::erase_if(view.lattice, [&](std::uint32_t at) {
    const std::ptrdiff_t r = static_cast<std::ptrdiff_t>(at) / photo.width_px,
                         c = static_cast<std::ptrdiff_t>(at) % photo.width_px;
    if (r < kRim || c < kRim || r >= photo.height_px - kRim || c >= photo.width_px - kRim)
      return true;
    if (is_left_out(k, at)) return true;
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
  // Variance that a square pixel has beyond that of its rays, of a pixel's square.
  constexpr double kPixelRest = 1.0 / (12.0 * kAcross * kAcross);
  blur(image, kPixelRest + own.blur_px2);
  if (spreads_by_distance(state_)) {
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
      if (!view.wanted(r, c, far) || !(hits(r, c) > 0.0F) ||
          is_left_out(k, static_cast<std::uint32_t>(r * photo.width_px + c)))
        continue;
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
    for (std::ptrdiff_t i = 0; i < kAcross; ++i)
      for (std::ptrdiff_t j = 0; j < kAcross; ++j) {
        const Sample& sample = view.samples(kAcross * r + i, kAcross * c + j);
        if (std::isnan(sample.x)) continue;
        rays += 1.0;
        p.place += Vec3{sample.x, sample.y, sample.z};
        p.normal += normal_at(k, sample.x, sample.y);
      }
    if (!(rays > 0.0)) return;
    p.place = (1.0 / rays) * p.place;
    p.normal = normalized(p.normal);
    if (sizes_anew) view.lamp_of_size[n] = lamp_of_sizes(k, static_cast<std::uint32_t>(at));
    if (!view.lamp_of_size.empty()) p.lamp_of_size = view.lamp_of_size[n];
    p.at = static_cast<std::uint32_t>(at);
    const RayLight of_rays = light_of(k, p.at, false, chain);
    p.of_rays = of_rays.light;
    p.lamp = of_rays.lamp;
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
      for (std::size_t w = 0; w < kHaloWidths.size(); ++w)
        p.around[ch][w] = static_cast<float>(before_sensor(
            static_cast<double>(bilinear(around_[k][ch][w],
                                         (static_cast<double>(r) + 0.5) / kEach - 0.5,
                                         (static_cast<double>(c) + 0.5) / kEach - 0.5)),
            channel, k, state_));
      const double y = static_cast<double>(taken.value[ch](r, c));
      p.measured[ch] = static_cast<float>(y);
      p.next[ch] = taken.value[ch](r, c + 1);
      const double model = number_of(p, ch, p.value[ch]);
      // Electrons scatter, not the offset that is added to them; a tone curve stretches that: by
      // what it makes of the scatter as a whole, for in the dark it bends within it.
      const double power = 1.0 + state_.gamma,
                   linear = std::copysign(std::pow(std::abs(model), 1.0 / power), model);
      const auto sigma_of = [&](double light, double read_e) {
        return std::sqrt(std::fmax(0.0, light) * photo.full_well_e + read_e * read_e) /
               photo.full_well_e;
      };
      const double sigma = sigma_of(linear - own.black, photo.read_noise_e);
      const Dark& dark = dark_[k][ch];
      const double read_e = dark.sigma > 0.0F ? static_cast<double>(dark.sigma) * photo.full_well_e
                                              : photo.read_noise_e;
      double variance = sigma * sigma,
             around = std::pow(sigma_of(mean_around(taken.value[ch], r, c), read_e), 2);
      if (dark.cut) p.cut_sigma[ch] = static_cast<float>(sigma_of(linear - own.black, read_e));
      if (state_.gamma != 0.0) {
        const auto toned = [&](double v) { return std::copysign(std::pow(std::abs(v), power), v); };
        variance = std::pow(0.5 * (toned(linear + sigma) - toned(linear - sigma)), 2);
      }
      if (taken.quantum > 0.0) {
        const double l = std::clamp(model, 0.0, 1.0);
        const double slope = l <= 0.0031308 ? 1.0 / 12.92 : 2.4 / 1.055 * std::pow(l, 1.4 / 2.4);
        const double of_steps = std::pow(taken.quantum * slope, 2) / 12.0;
        variance += of_steps;
        around += of_steps;
      }
      p.variance[ch] = static_cast<float>(variance);
      p.variance_around[ch] = static_cast<float>(around);
    }
    made[n] = p;
    good[n] = 1;
  });
  for (std::size_t n = 0; n < made.size(); ++n)
    if (good[n] == 1) out.push_back(made[n]);
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
  double widest = 0.0;
  for (std::size_t k = 0; k < scene_.photos.size(); ++k)
    widest = std::fmax(widest, penumbra_px(diameter_mm, k));
  return widest;
}

double PhotoViews::penumbra_px(double diameter_mm, std::size_t k) const {
  const PhotoInput& photo = scene_.photos[k];
  const std::size_t l = scene_.lamp_of[k];
  const Vec3 lamp = photo.lamp_position_mm + state_.lamp_mm[l] + state_.lamp_refocused_mm[l] -
                    photo.lamp_target_mm;
  const double way = norm(lamp);
  // Along the light a low lamp stretches it twice: the shadow, and the angle at which its edge
  // meets the ground.
  const double sine = std::fmax(0.1, lamp.z / way);
  return diameter_mm * (scene_.box.max.z - scene_.box.min.z) / (way * sine * sine) *
         photo.focal_length_mm * 1000.0 / photo.pixel_pitch_um /
         norm(photo.camera_position_mm - photo.lamp_target_mm);
}

/// What noise there is where no light comes: the declared read noise may be wrong, and a file
/// without numbers below 0 has a light there that is none.
/// @return whether anything is known now that pixels were not taken with
bool PhotoViews::look_into_the_dark() {
  bool news = false;
  constexpr std::size_t kLeast = 200;
  constexpr double kAsDeclared = 1.2;
  for (std::size_t k = 0; k < photographs_.size(); ++k)
    for (std::size_t ch = 0; ch < photographs_[k].value.size(); ++ch) {
      if (photographs_[k].quantum > 0.0) continue;
      std::vector<float> numbers;
      std::vector<double> differences;
      for (const MeasuredPixel& p : pixels_) {
        if (p.photo != k || p.lamp.share > 0.0F) continue;
        numbers.push_back(p.measured[ch]);
        differences.push_back(
            static_cast<double>((p.next[ch] - p.value_next[ch]) - (p.measured[ch] - p.value[ch])));
      }
      if (numbers.size() < kLeast) continue;
      const PhotoInput& photo = scene_.photos[k];
      Dark& dark = dark_[k][ch];
      dark.cut = *std::min_element(numbers.begin(), numbers.end()) >= 0.0F;
      const double sigma = dark.cut ? sigma_of_cut(std::move(numbers))
                                    : nmad(std::move(differences)) / std::numbers::sqrt2;
      dark.cut &= sigma > 0.0;
      if (dark.cut || sigma > kAsDeclared * photo.read_noise_e / photo.full_well_e)
        dark.sigma = static_cast<float>(sigma);
      news |= dark.sigma > 0.0F;
    }
  return news;
}

double PhotoViews::roughness() const {
  // Green lies where the others do or between them: a lens that colours edges shifts it least.
  const std::size_t ch = channels() / 2;
  std::vector<double> difference;
  for (const MeasuredPixel& p : pixels_)
    difference.push_back(
        static_cast<double>((p.next[ch] - p.value_next[ch]) - (p.measured[ch] - p.value[ch])));
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
  if (first && look_into_the_dark()) {
    pixels_.clear();
    selected_ = true;
    for (std::size_t k = 0; k < scene_.photos.size(); ++k)
      if (shows(k)) take_pixels(k, lamp_sizes, pixels_);
  }
  traced_ = state_;
  looks_anew_ = false;
  selected_ = true;
  pictured_ = state_;
  pictured_pixels_ = pixels_;
  light_before_ = light_by_photo();
}

double PhotoViews::before_cut(const MeasuredPixel& p, std::size_t channel,
                              float behind_lens) const {
  return exposed(static_cast<double>(behind_lens), static_cast<double>(p.mean[channel]),
                 p.around[channel], radius2(p.u, p.v, scene_.photos[p.photo]),
                 channel_of(channel, channels()), p.photo, state_);
}

double PhotoViews::number_of(const MeasuredPixel& p, std::size_t channel, float behind_lens) const {
  return cut_off(before_cut(p, channel, behind_lens), static_cast<double>(p.cut_sigma[channel]))
      .mean;
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
        const auto cut_sigma = static_cast<double>(p.cut_sigma[ch]);
        const double sigma =
            std::fmax(cut_sigma, noise_factor * std::sqrt(static_cast<double>(p.variance[ch])));
        const double number =
            before_cut(p, ch, behind_lens) + sigma * random_normal(seed, 2 * (3 * i + ch) + draw);
        return static_cast<float>(cut_sigma > 0.0 ? std::fmax(0.0, number) : number);
      };
      taken[ch](r, c) = p.measured[ch] = of(p.value[ch], 0);
      taken[ch](r, c + 1) = p.next[ch] = of(p.value_next[ch], 1);
    }
  }
  pictured_pixels_ = pixels_;
}

}  // namespace maquette::diagnosis::detail
