// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/photo_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <OpenImageIO/imageio.h>

#include "core/random.hpp"

namespace challenge {
namespace {

constexpr double kAdc = 16383;  // 14 bit at saturation

/// Counts of a Poisson law: exact where few, else from a normal number with the law's skewness.
double electrons(double mean, std::uint64_t seed, std::uint64_t counter) {
  if (mean <= 0) return 0;
  if (mean < 30) {
    // Knuth: arrivals until the time is up; 64 draws are kept for each count.
    double left = std::exp(-mean), product = 1;
    for (std::uint64_t k = 0;; ++k) {
      product *= maquette::random_uniform(~seed, 128 * counter + k);
      if (product <= left) return static_cast<double>(k);
    }
  }
  const double z = maquette::random_normal(seed, counter);
  return std::max(0.0, std::round(mean + std::sqrt(mean) * z + (z * z - 1) / 6));
}

Plane blurred(const Plane& from, const Kernel& kernel) {
  Plane to = make_plane(from.width, from.height);
  const int side = 2 * kernel.reach + 1;
  for (int r = kernel.reach; r < from.height - kernel.reach; ++r)
    for (int i = 0; i < side; ++i)
      for (int j = 0; j < side; ++j) {
        const auto w = static_cast<float>(kernel.weight[static_cast<std::size_t>(i * side + j)]);
        if (w == 0) continue;
        for (int c = kernel.reach; c < from.width - kernel.reach; ++c)
          to.at(r, c) += w * from.at(r + i - kernel.reach, c + j - kernel.reach);
      }
  return to;
}

}  // namespace

std::array<double, 4> cubic_weights(double t) {
  return {0.5 * t * (-1 + t * (2 - t)), 0.5 * (2 + t * t * (-5 + 3 * t)),
          0.5 * t * (1 + t * (4 - 3 * t)), 0.5 * t * t * (t - 1)};
}

Kernel kernel_of(const Lens& lens) {
  constexpr int kFineParts = 24;
  const double radius = 0.5 * lens.defocus_px;
  const double length = std::hypot(lens.motion_px[0], lens.motion_px[1]);
  Kernel k;
  if (radius == 0 && length == 0) return {0, {1.0}};
  k.reach = static_cast<int>(std::ceil(radius + 0.5 * length)) + 2;
  const int side = 2 * k.reach + 1;
  k.weight.assign(static_cast<std::size_t>(side * side), 0.0);
  const int discs = radius > 0 ? static_cast<int>(kFineParts * radius) + 2 : 1,
            lines = length > 0 ? static_cast<int>(kFineParts * length) + 2 : 1;
  double sum = 0;
  for (int a = 0; a < discs; ++a)
    for (int b = 0; b < discs; ++b) {
      const double x = radius * ((2 * a + 1.0) / discs - 1),
                   y = radius * ((2 * b + 1.0) / discs - 1);
      if (x * x + y * y > radius * radius) continue;
      for (int l = 0; l < lines; ++l) {
        // What lies between pixels is read off a cubic: the nearest would blur once more.
        const double s = (l + 0.5) / lines - 0.5;
        const double px = x + s * lens.motion_px[0], py = y + s * lens.motion_px[1];
        const int c = static_cast<int>(std::floor(px)), r = static_cast<int>(std::floor(py));
        const auto wc = cubic_weights(px - c), wr = cubic_weights(py - r);
        for (int i = 0; i < 4; ++i)
          for (int j = 0; j < 4; ++j)
            k.weight[static_cast<std::size_t>((r + i - 1 + k.reach) * side + c + j - 1 +
                                              k.reach)] +=
                wr[static_cast<std::size_t>(i)] * wc[static_cast<std::size_t>(j)];
        sum += 1;
      }
    }
  for (double& w : k.weight) w /= sum;
  return k;
}

double Kernel::spread_px(double x, double y) const {
  const int side = 2 * reach + 1;
  double square = 0;
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c) {
      const double along = (c - reach) * x + (r - reach) * y;
      square += weight[static_cast<std::size_t>(r * side + c)] * along * along;
    }
  return std::sqrt(std::max(0.0, square));
}

int margin_of(const Lens& lens) {
  return kernel_of(lens).reach;
}

void pass(const Lens& lens, Picture& picture) {
  const Kernel kernel = kernel_of(lens);
  for (Plane& plane : picture) {
    if (kernel.reach > 0) {
      const Plane all = blurred(plane, kernel);
      Plane cut = make_plane(all.width - 2 * kernel.reach, all.height - 2 * kernel.reach);
      for (int r = 0; r < cut.height; ++r)
        for (int c = 0; c < cut.width; ++c)
          cut.at(r, c) = all.at(r + kernel.reach, c + kernel.reach);
      plane = std::move(cut);
    }
    double mean = 0;
    const double x0 = 0.5 * plane.width, y0 = 0.5 * plane.height;
    for (int r = 0; r < plane.height; ++r)
      for (int c = 0; c < plane.width; ++c) {
        const double x = c + 0.5 - x0, y = r + 0.5 - y0, q2 = (x * x + y * y) / (x0 * x0 + y0 * y0);
        plane.at(r, c) *= static_cast<float>(1 + lens.fall2 * q2 + lens.fall4 * q2 * q2);
        mean += static_cast<double>(plane.at(r, c));
      }
    mean /= static_cast<double>(plane.v.size());
    for (float& v : plane.v)
      v = static_cast<float>((1 - lens.veil) * static_cast<double>(v) + lens.veil * mean);
  }
}

namespace {

/// From electrons over the full well to a number, before the ADC.
double number_of(const Sensor& s, std::size_t band, double filled) {
  const double v = std::min(1.0, filled) * s.gain[band] + s.black;
  return s.gamma == 1 ? v : std::copysign(std::pow(std::abs(v), s.gamma), v);
}

}  // namespace

double expected(const Sensor& s, std::size_t band, double light) {
  return std::min(1.0, number_of(s, band, light * s.exposure * s.filter[band]));
}

double noise_of(double full_well_e, double read_noise_e, double value) {
  return std::sqrt(std::max(0.0, value) * full_well_e + read_noise_e * read_noise_e) / full_well_e;
}

void expose(const Sensor& s, Picture& picture, std::uint64_t seed, int photo) {
  for (std::size_t band = 0; band < picture.size(); ++band) {
    std::vector<float>& values = picture[band].v;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::uint64_t pixel = i * 3 + band,
                          counter = pixel + (static_cast<std::uint64_t>(photo) << 32U);
      double light = static_cast<double>(values[i]) * s.exposure * s.filter[band];
      if (s.pixels > 0) light *= 1 + s.pixels * maquette::random_normal(seed + 2, pixel);
      const double e = electrons(light * s.full_well_e, seed, counter) +
                       s.read_noise_e * maquette::random_normal(seed + 1, counter);
      const double v = number_of(s, band, e / s.full_well_e);
      values[i] = static_cast<float>(std::min(1.0, std::round(v * kAdc) / kAdc));
    }
  }
}

void write_picture(const Picture& picture, const std::filesystem::path& file) {
  const int width = picture[0].width, height = picture[0].height;
  OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::FLOAT);
  spec.attribute("compression", "zip");
  spec.attribute("oiio:ColorSpace", "Linear");
  spec.attribute("DateTime", "2000:01:01 00:00:00");  // the same case, the same bytes
  std::vector<float> all;
  all.reserve(picture[0].v.size() * 3);
  for (std::size_t i = 0; i < picture[0].v.size(); ++i)
    for (const Plane& plane : picture) all.push_back(plane.v[i]);
  const auto out = OIIO::ImageOutput::create(file.string());
  if (!out || !out->open(file.string(), spec) ||
      !out->write_image(OIIO::TypeDesc::FLOAT, all.data()) || !out->close())
    throw std::runtime_error("not written: " + file.string());
}

}  // namespace challenge
