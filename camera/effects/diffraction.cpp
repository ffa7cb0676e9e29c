// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/diffraction.hpp"

#include <cmath>
#include <complex>
#include <memory>
#include <mutex>
#include <numbers>

#include <fftw3.h>
#include <tbb/parallel_for.h>

namespace maquette::camera {
namespace {

constexpr int kFine = 8;                 ///< samples of the figure in a pixel
constexpr std::ptrdiff_t kCore = 3;      ///< pixels to each side that are convolved one by one
constexpr std::ptrdiff_t kBlock = 4;     ///< pixels a side, farther out
constexpr int kEdgeSamples = 4;          ///< a side in each sample of the aperture's edge
constexpr double kFewestSamples = 16.0;  ///< across the aperture

/// FFTW plans are made one at a time.
std::mutex& planner() {
  static std::mutex mutex;
  return mutex;
}

template <class T>
struct FftwFree {
  void operator()(T* p) const {
    if constexpr (std::is_same_v<T, float> || std::is_same_v<T, fftwf_complex>)
      fftwf_free(p);
    else
      fftw_free(p);
  }
};

/// Share of the sample around (x, y) inside the aperture of radius 1; coordinates in radii.
double open_share(const Diffraction& e, double x, double y, double side) {
  // Most samples are clearly in the aperture or clearly outside.
  const double from_middle = std::hypot(x, y), within = side + 1e-9;
  const double apothem = e.blades < 3 ? 1.0 : std::cos(std::numbers::pi / e.blades);
  if (from_middle + within < apothem) return 1.0;
  if (from_middle - within > 1.0) return 0.0;
  int inside = 0;
  for (int i = 0; i < kEdgeSamples; ++i)
    for (int j = 0; j < kEdgeSamples; ++j) {
      const double px = x + side * ((j + 0.5) / kEdgeSamples - 0.5);
      const double py = y + side * ((i + 0.5) / kEdgeSamples - 0.5);
      if (e.blades < 3) {
        inside += px * px + py * py <= 1.0 ? 1 : 0;
        continue;
      }
      const double wedge = 2.0 * std::numbers::pi / e.blades;
      const double angle = std::atan2(py, px) - e.rotation_deg * std::numbers::pi / 180.0;
      const double turned = std::remainder(angle, wedge);  // to the middle of the nearest side
      inside += std::hypot(px, py) * std::cos(turned) <= std::cos(0.5 * wedge) ? 1 : 0;
    }
  return static_cast<double>(inside) / (kEdgeSamples * kEdgeSamples);
}

/// Side of the transform: room for the reach on both sides, and enough samples in the aperture.
int transform_side(const Diffraction& e, double samples_per_side) {
  int side = 256;
  const double wanted = 2.0 * (e.reach_px + 1.0) * kFine;
  while (side < wanted || side * samples_per_side < kFewestSamples) side *= 2;
  return side;
}

}  // namespace

FineFigure fine_figure(const Diffraction& e, double f_number, double wavelength_nm,
                       double pixel_pitch_um) {
  FineFigure figure;
  figure.spacing_um = pixel_pitch_um / kFine;
  const double lambda_f_um = wavelength_nm * 1e-3 * f_number;
  // A transform of n samples, m of them across the aperture, has samples lambda F m / n apart.
  const double across = figure.spacing_um / lambda_f_um;  // m / n
  const int n = transform_side(e, across);
  const double radius = 0.5 * across * n;  // samples
  const auto cells = static_cast<std::size_t>(n) * static_cast<std::size_t>(n);
  const std::unique_ptr<fftw_complex, FftwFree<fftw_complex>> data(fftw_alloc_complex(cells));
  for (std::size_t i = 0; i < cells; ++i) data.get()[i][0] = data.get()[i][1] = 0.0;
  const int reach = std::min(n / 2 - 1, static_cast<int>(radius) + 2);
  for (int y = -reach; y <= reach; ++y)
    for (int x = -reach; x <= reach; ++x) {
      const auto row = static_cast<std::size_t>((y + n) % n);
      const auto col = static_cast<std::size_t>((x + n) % n);
      data.get()[row * static_cast<std::size_t>(n) + col][0] =
          open_share(e, x / radius, y / radius, 1.0 / radius);
    }
  fftw_plan plan = nullptr;
  {
    const std::scoped_lock lock(planner());
    plan = fftw_plan_dft_2d(n, n, data.get(), data.get(), FFTW_FORWARD, FFTW_ESTIMATE);
  }
  fftw_execute(plan);
  {
    const std::scoped_lock lock(planner());
    fftw_destroy_plan(plan);
  }
  figure.irradiance = Grid<double>(n, n);
  const double middle = data.get()[0][0] * data.get()[0][0] + data.get()[0][1] * data.get()[0][1];
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const auto& v = data.get()[static_cast<std::size_t>(y) * static_cast<std::size_t>(n) +
                                 static_cast<std::size_t>(x)];
      figure.irradiance((y + n / 2) % n, (x + n / 2) % n) = (v[0] * v[0] + v[1] * v[1]) / middle;
    }
  return figure;
}

Grid<double> point_figure(const Diffraction& e, double f_number, double wavelength_nm,
                          double pixel_pitch_um) {
  const FineFigure fine = fine_figure(e, f_number, wavelength_nm, pixel_pitch_um);
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(e.reach_px));
  const std::ptrdiff_t middle = fine.irradiance.rows() / 2;
  Grid<double> figure(2 * reach + 1, 2 * reach + 1);
  double all = 0.0, inside = 0.0;
  for (const double v : fine.irradiance.cells()) all += v;
  for (std::ptrdiff_t i = -reach; i <= reach; ++i)
    for (std::ptrdiff_t j = -reach; j <= reach; ++j) {
      // Trapezoids over the pixel: its edges count one half.
      double sum = 0.0;
      for (int y = -kFine / 2; y <= kFine / 2; ++y)
        for (int x = -kFine / 2; x <= kFine / 2; ++x) {
          const double weight =
              (std::abs(y) == kFine / 2 ? 0.5 : 1.0) * (std::abs(x) == kFine / 2 ? 0.5 : 1.0);
          const std::ptrdiff_t r = middle + i * kFine + y, c = middle + j * kFine + x;
          if (fine.irradiance.contains(r, c)) sum += weight * fine.irradiance(r, c);
        }
      figure(i + reach, j + reach) = sum / all;
      inside += sum / all;
    }
  figure(reach, reach) += 1.0 - inside;
  return figure;
}

namespace {

/// The sharp part: pixels within kCore of the middle, the rest of the light in the middle.
void add_core(const Grid<float>& from, const Grid<double>& figure, Grid<float>& to) {
  const std::ptrdiff_t reach = figure.rows() / 2, n = 2 * kCore + 1;
  std::vector<float> w(static_cast<std::size_t>(n * n), 0.0F);
  for (std::ptrdiff_t i = -kCore; i <= kCore; ++i)
    for (std::ptrdiff_t j = -kCore; j <= kCore; ++j)
      if (std::abs(i) <= reach && std::abs(j) <= reach)
        w[static_cast<std::size_t>((i + kCore) * n + j + kCore)] =
            static_cast<float>(figure(reach + i, reach + j));
  const std::ptrdiff_t cols = from.cols();
  tbb::parallel_for(std::ptrdiff_t{0}, from.rows(), [&](std::ptrdiff_t r) {
    std::vector<float> padded(static_cast<std::size_t>(cols + 2 * kCore));
    float* out = to.row(r).data();
    std::fill(out, out + cols, 0.0F);
    for (std::ptrdiff_t i = -kCore; i <= kCore; ++i) {
      const auto row = from.row(std::clamp(r + i, std::ptrdiff_t{0}, from.rows() - 1));
      std::copy(row.begin(), row.end(), padded.begin() + kCore);
      std::fill(padded.begin(), padded.begin() + kCore, row.front());
      std::fill(padded.end() - kCore, padded.end(), row.back());
      const float* k = w.data() + (i + kCore) * n;
      const float* p = padded.data();
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        float sum = 0.0F;
        for (std::ptrdiff_t j = 0; j < 2 * kCore + 1; ++j) sum += k[j] * p[c + j];
        out[c] += sum;
      }
    }
  });
}

/// A picture of blocks, convolved with the far part of the figure by Fourier transform.
class FarPart {
 public:
  FarPart(std::ptrdiff_t rows, std::ptrdiff_t cols, std::ptrdiff_t reach_blocks)
      : reach_(reach_blocks),
        rows_(good(rows + 2 * reach_blocks)),
        cols_(good(cols + 2 * reach_blocks)),
        half_(cols_ / 2 + 1),
        real_(fftwf_alloc_real(static_cast<std::size_t>(rows_ * cols_))),
        image_(fftwf_alloc_complex(static_cast<std::size_t>(rows_ * half_))),
        kernel_(fftwf_alloc_complex(static_cast<std::size_t>(rows_ * half_))) {
    const std::scoped_lock lock(planner());
    there_ = fftwf_plan_dft_r2c_2d(static_cast<int>(rows_), static_cast<int>(cols_), real_.get(),
                                   image_.get(), FFTW_ESTIMATE);
    there_kernel_ = fftwf_plan_dft_r2c_2d(static_cast<int>(rows_), static_cast<int>(cols_),
                                          real_.get(), kernel_.get(), FFTW_ESTIMATE);
    back_ = fftwf_plan_dft_c2r_2d(static_cast<int>(rows_), static_cast<int>(cols_), image_.get(),
                                  real_.get(), FFTW_ESTIMATE);
  }
  FarPart(const FarPart&) = delete;
  FarPart& operator=(const FarPart&) = delete;
  ~FarPart() {
    const std::scoped_lock lock(planner());
    for (fftwf_plan plan : {there_, there_kernel_, back_}) fftwf_destroy_plan(plan);
  }

  /// @param kernel  square, odd, its middle at zero shift
  void set_kernel(const Grid<double>& kernel) {
    std::fill_n(real_.get(), rows_ * cols_, 0.0F);
    const std::ptrdiff_t reach = kernel.rows() / 2;
    for (std::ptrdiff_t i = -reach; i <= reach; ++i)
      for (std::ptrdiff_t j = -reach; j <= reach; ++j)
        real_.get()[((i + rows_) % rows_) * cols_ + (j + cols_) % cols_] =
            static_cast<float>(kernel(i + reach, j + reach));
    fftwf_execute(there_kernel_);
  }
  /// In place; beyond the edge the picture's last block goes on.
  void convolve(Grid<float>& blocks) {
    for (std::ptrdiff_t r = 0; r < rows_; ++r)
      for (std::ptrdiff_t c = 0; c < cols_; ++c)
        real_.get()[r * cols_ + c] =
            blocks(std::clamp(r - reach_, std::ptrdiff_t{0}, blocks.rows() - 1),
                   std::clamp(c - reach_, std::ptrdiff_t{0}, blocks.cols() - 1));
    fftwf_execute(there_);
    const float scale = 1.0F / static_cast<float>(rows_ * cols_);
    for (std::ptrdiff_t i = 0; i < rows_ * half_; ++i) {
      const std::complex<float> a(image_.get()[i][0], image_.get()[i][1]);
      const std::complex<float> b(kernel_.get()[i][0], kernel_.get()[i][1]);
      image_.get()[i][0] = scale * (a.real() * b.real() - a.imag() * b.imag());
      image_.get()[i][1] = scale * (a.real() * b.imag() + a.imag() * b.real());
    }
    fftwf_execute(back_);
    for (std::ptrdiff_t r = 0; r < blocks.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < blocks.cols(); ++c)
        blocks(r, c) = real_.get()[(r + reach_) * cols_ + c + reach_];
  }

 private:
  /// The next length with small prime factors only.
  static std::ptrdiff_t good(std::ptrdiff_t n) {
    for (;; ++n) {
      std::ptrdiff_t m = n;
      for (const std::ptrdiff_t p : {2, 3, 5})
        while (m % p == 0) m /= p;
      if (m == 1) return n;
    }
  }
  std::ptrdiff_t reach_, rows_, cols_, half_;
  std::unique_ptr<float, FftwFree<float>> real_;
  std::unique_ptr<fftwf_complex, FftwFree<fftwf_complex>> image_, kernel_;
  fftwf_plan there_ = nullptr, there_kernel_ = nullptr, back_ = nullptr;
};

/// Means over blocks of kBlock x kBlock pixels; the last ones may be smaller.
Grid<float> blocks_of(const Grid<float>& g) {
  Grid<float> blocks((g.rows() + kBlock - 1) / kBlock, (g.cols() + kBlock - 1) / kBlock);
  tbb::parallel_for(std::ptrdiff_t{0}, blocks.rows(), [&](std::ptrdiff_t i) {
    for (std::ptrdiff_t j = 0; j < blocks.cols(); ++j) {
      float sum = 0.0F;
      int count = 0;
      for (std::ptrdiff_t r = i * kBlock; r < std::min((i + 1) * kBlock, g.rows()); ++r)
        for (std::ptrdiff_t c = j * kBlock; c < std::min((j + 1) * kBlock, g.cols()); ++c, ++count)
          sum += g(r, c);
      blocks(i, j) = sum / static_cast<float>(count);
    }
  });
  return blocks;
}

/// The figure outside kCore by blocks: light that goes from a block to another, a mean over the
/// places in the block (a triangle's weights).
Grid<double> far_kernel(const Grid<double>& figure) {
  const std::ptrdiff_t reach = figure.rows() / 2, blocks = (reach + kBlock) / kBlock + 1;
  Grid<double> kernel(2 * blocks + 1, 2 * blocks + 1);
  for (std::ptrdiff_t i = -reach; i <= reach; ++i)
    for (std::ptrdiff_t j = -reach; j <= reach; ++j) {
      if (std::abs(i) <= kCore && std::abs(j) <= kCore) continue;
      const auto place = [&](std::ptrdiff_t k) {
        const double at = static_cast<double>(k) / kBlock;
        const auto low = static_cast<std::ptrdiff_t>(std::floor(at));
        return std::pair{low, at - static_cast<double>(low)};
      };
      const auto [a, s] = place(i);
      const auto [b, t] = place(j);
      const double v = figure(i + reach, j + reach);
      kernel(a + blocks, b + blocks) += (1.0 - s) * (1.0 - t) * v;
      kernel(a + blocks, b + 1 + blocks) += (1.0 - s) * t * v;
      kernel(a + 1 + blocks, b + blocks) += s * (1.0 - t) * v;
      kernel(a + 1 + blocks, b + 1 + blocks) += s * t * v;
    }
  return kernel;
}

/// Bilinear between the blocks' middles.
void add_blocks(const Grid<float>& blocks, Grid<float>& to) {
  const auto place = [](std::ptrdiff_t i, std::ptrdiff_t n) {
    const float at =
        std::clamp((static_cast<float>(i) + 0.5F) / kBlock - 0.5F, 0.0F, static_cast<float>(n - 1));
    const auto low = std::min(static_cast<std::ptrdiff_t>(at), std::max<std::ptrdiff_t>(0, n - 2));
    return std::pair{low, at - static_cast<float>(low)};
  };
  tbb::parallel_for(std::ptrdiff_t{0}, to.rows(), [&](std::ptrdiff_t r) {
    const auto [i, t] = place(r, blocks.rows());
    const std::ptrdiff_t down = blocks.rows() > 1 ? 1 : 0, right = blocks.cols() > 1 ? 1 : 0;
    std::vector<float> line(static_cast<std::size_t>(blocks.cols()));
    for (std::ptrdiff_t j = 0; j < blocks.cols(); ++j)
      line[static_cast<std::size_t>(j)] = blocks(i, j) + t * (blocks(i + down, j) - blocks(i, j));
    for (std::ptrdiff_t c = 0; c < to.cols(); ++c) {
      const auto [j, s] = place(c, blocks.cols());
      const float a = line[static_cast<std::size_t>(j)];
      const float v = to(r, c) + a + s * (line[static_cast<std::size_t>(j + right)] - a);
      to(r, c) = v > 0.0F ? v : 0.0F;  // the transform's rounding
    }
  });
}

}  // namespace

Result<void> check(const Diffraction& e, const Shot&) {
  if (e.blades != 0) MAQUETTE_TRY_VOID(in_range("diffraction", "blades", e.blades, 3, 30));
  MAQUETTE_TRY_VOID(in_range("diffraction", "rotation_deg", e.rotation_deg, -360.0, 360.0));
  return in_range("diffraction", "reach_px", e.reach_px, 3.0, 250.0);
}

void apply(const Diffraction& e, const Shot& shot, Frame& frame) {
  Grid<float> out(frame.bands.front().rows(), frame.bands.front().cols());
  std::unique_ptr<FarPart> far;
  for (std::size_t b = 0; b < frame.bands.size(); ++b) {
    const std::size_t band = shot.wavelength_nm.size() == 3 && frame.bands.size() == 1 ? 1 : b;
    const Grid<double> figure =
        point_figure(e, shot.f_number, of_band(shot.wavelength_nm, band), shot.pixel_pitch_um);
    const Grid<double> kernel = far_kernel(figure);
    Grid<float> blocks = blocks_of(frame.bands[b]);
    if (!far) far = std::make_unique<FarPart>(blocks.rows(), blocks.cols(), kernel.rows() / 2);
    far->set_kernel(kernel);
    far->convolve(blocks);
    add_core(frame.bands[b], figure, out);
    add_blocks(blocks, out);
    std::swap(frame.bands[b], out);
  }
}

}  // namespace maquette::camera
