// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_remainder.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <numbers>

#include "core/median.hpp"
#include "diagnosis/detail/even_and_odd.hpp"
#include "diagnosis/detail/periodogram.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kFar = 8.0;      // robust standard deviations
constexpr double kClip = 3.0;     // of the noise: what edges leave is large and says little
constexpr double kSquare = 32.0;  // of a picture, pixels
constexpr double kEnough = 12.0;
constexpr double kSmoothLevel = 1e-9;
/// What bands rows and leaves columns alone, as sensors that are read row by row and lamps that
/// flicker do: scatter of the rows' means over that of the columns'.
constexpr double kRowsOverColumns = 4.0;
/// Power of a wave in a picture, over the noise's. Of 1e5 waves the largest of noise alone is 12 to
/// 17; what the relief leaves is more than noise, but no line. The surface's nodes beat with
/// pixels, where the slopes between them are not as rendered: 280 times noise, 0.08 / 255 rms.
constexpr double kFringe = 60.0;
/// What a pixel is off by over what neighbours differ by, both as of noise that is each one's own:
/// 0.94 to 1.22 beside right models, 8 of a file that was compressed to a tenth.
constexpr double kSharedNoise = 1.5;

struct Mean {
  double sum = 0.0, n = 0.0;
};

/// Largest mean over the robust spread of all, each by the square root of what it is a mean of.
double farthest(const std::map<std::uint64_t, Mean>& means) {
  std::vector<double> count, size;
  for (const auto& [key, m] : means)
    if (m.n >= kEnough) count.push_back(m.n);
  if (count.size() < 30) return 0.0;
  const double typical = median(std::move(count));
  for (const auto& [key, m] : means)
    if (m.n >= 0.5 * typical) size.push_back(std::abs(m.sum / m.n));
  if (size.size() < 30) return 0.0;
  const double spread = std::fmax(1e-9, kMadToSigma * median(size));
  return *std::max_element(size.begin(), size.end()) / spread;
}

/// What the means of one picture's lines (rows, or columns) have beyond their pixels' own scatter,
/// a parabola taken out: light that falls off across the picture is no band.
struct Lines {
  double excess = 0.0;  ///< mean square, of the noise's variance
  double level = 0.0;   ///< of it in its standard errors, were there noise alone
  int counted = 0;
};
struct Line {
  double sum = 0.0, squares = 0.0, n = 0.0;
};
Lines lines_of(const std::map<std::int64_t, Line>& lines) {
  double most = 0.0;
  for (const auto& [at, line] : lines) most = std::fmax(most, line.n);
  // Weighted by values; coordinates -1 .. 1 over the picture keep the sums well-conditioned.
  const double first = static_cast<double>(lines.begin()->first),
               last = static_cast<double>(lines.rbegin()->first),
               half = std::fmax(1.0, 0.5 * (last - first));
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const auto terms = [&](std::int64_t at) {
    const double t = (static_cast<double>(at) - first) / half - 1.0;
    return Eigen::Vector3d{1.0, t, t * t};
  };
  Lines out;
  for (const auto& [at, line] : lines) {
    if (line.n < kEnough || line.n < 0.5 * most) continue;
    const Eigen::Vector3d x = terms(at);
    normal += line.n * x * x.transpose();
    right += line.sum * x;
    ++out.counted;
  }
  if (out.counted < 20) return {};
  const Eigen::Vector3d trend = normal.ldlt().solve(right);
  double excess = 0.0, variance = 0.0;
  for (const auto& [at, line] : lines) {
    if (line.n < kEnough || line.n < 0.5 * most) continue;
    const double mean = line.sum / line.n,
                 own = std::fmax(0.0, line.squares / line.n - mean * mean) / line.n;
    excess += std::pow(mean - trend.dot(terms(at)), 2) - own;
    variance += 2.0 * own * own;
  }
  out.excess = excess / out.counted;
  out.level = excess / std::sqrt(std::fmax(1e-300, variance));
  return out;
}

/// Largest power of a wave in a picture's residuals on their lattice, over that of noise there.
/// Only waves of less than six steps count: what the relief leaves is longer. A finer fringe than
/// the lattice is a wave on it all the same.
struct Wave {
  double over = 0.0;  ///< its power over that of noise
  double rms = 0.0;   ///< of a sine over all of the picture, as the residual's
};
/// @param residual  NaN: no pixel
Wave clearest_wave(const Grid<double>& residual) {
  constexpr double kLongest = 1.0 / 6.0;  // cycles a step
  const std::ptrdiff_t rows = residual.rows(), cols = residual.cols();
  const Grid<double> all = periodogram(residual, rows, cols);
  const auto frequency = [](std::ptrdiff_t waves, std::ptrdiff_t of) {
    return static_cast<double>(std::min(waves, of - waves)) / static_cast<double>(of);
  };
  std::vector<double> power;
  for (std::ptrdiff_t q = 0; q < rows; ++q)
    for (std::ptrdiff_t k = 0; k < cols; ++k)
      if (std::hypot(frequency(k, cols), frequency(q, rows)) >= kLongest)
        power.push_back(all(q, k));
  if (power.size() < 200) return {};
  const auto pixels = std::count_if(residual.cells().begin(), residual.cells().end(),
                                    [](double r) { return !std::isnan(r); });
  const double most = *std::max_element(power.begin(), power.end());
  return {most / std::fmax(1e-300, median(std::move(power)) / std::numbers::ln2),
          std::sqrt(2.0 * most) / static_cast<double>(pixels)};
}

}  // namespace

Remainder judge_photographs(const PhotoLinear& left, const PhotoViews& views, const Layout& layout,
                            double factor, const PhotoScatter& scatter, double smooth_255,
                            double finer_255) {
  Remainder rest;
  const auto& pixels = views.pixels();
  const std::size_t channels = views.channels();
  const double knee = kClip * std::sqrt(factor);
  const auto clipped = [&](std::size_t i, std::size_t ch) {
    return std::clamp(
        static_cast<double>(left.residual(static_cast<Eigen::Index>(i * channels + ch))), -knee,
        knee);
  };
  const auto group = [&](const std::function<std::uint64_t(const MeasuredPixel&)>& key) {
    std::map<std::uint64_t, Mean> means;
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      Mean& m = means[key(pixels[i])];
      for (std::size_t ch = 0; ch < channels; ++ch) {
        m.sum += clipped(i, ch);
        m.n += 1.0;
      }
    }
    return means;
  };
  const auto square = [](const MeasuredPixel& p, double side) {
    return (static_cast<std::uint64_t>((p.v + 1e5F) / static_cast<float>(side)) << 24) |
           static_cast<std::uint64_t>((p.u + 1e5F) / static_cast<float>(side));
  };
  const auto note = [&](const char* kind) {
    rest.kinds.emplace_back(kind);
    rest.found = true;
  };
  // Few pixels tell little of a place: it is so large that it has twice as many as it needs.
  const Box3& box = views.scene().box;
  const double side =
      std::fmax(0.5 * layout.cell_mm,
                std::sqrt((box.max.x - box.min.x) * (box.max.y - box.min.y) * 2.0 * kEnough /
                          std::fmax(1.0, static_cast<double>(pixels.size() * channels))));
  const auto places = group([&](const MeasuredPixel& p) {
    return (static_cast<std::uint64_t>((p.place.y - layout.y0) / side) << 24) |
           static_cast<std::uint64_t>((p.place.x - layout.x0) / side);
  });
  if (farthest(places) > kFar) note("places on the part");
  if (farthest(group([&](const MeasuredPixel& p) { return square(p, kSquare); })) > kFar)
    note("places in the picture");
  if (farthest(group([&](const MeasuredPixel& p) {
        return (static_cast<std::uint64_t>(p.photo) << 48) | square(p, 1.5 * kSquare);
      })) > kFar)
    note("places in one picture");
  if (farthest(group([](const MeasuredPixel& p) {
        return (static_cast<std::uint64_t>(p.photo) << 32) | static_cast<std::uint64_t>(p.v + 1e5F);
      })) > kFar)
    note("rows");
  // Bands that fill a picture: none stands out of the others.
  std::vector<std::array<std::map<std::int64_t, Line>, 2>> lines(views.scene().photos.size());
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (const std::size_t along : {0U, 1U}) {
      Line& line = lines[pixels[i].photo][along][std::llround(
          std::floor(static_cast<double>(along == 0 ? pixels[i].v : pixels[i].u)))];
      for (std::size_t ch = 0; ch < channels; ++ch) {
        const double r = clipped(i, ch);
        line.sum += r;
        line.squares += r * r;
        line.n += 1.0;
      }
    }
  double rms_all = 0.0;
  for (Eigen::Index i = 0; i < left.residual.size(); ++i)
    rms_all += std::pow(static_cast<double>(left.sigma(i)), 2);
  rms_all = 255.0 * std::sqrt(rms_all / std::fmax(1.0, static_cast<double>(left.sigma.size())));
  for (const auto& of : lines) {
    if (of[0].empty() || of[1].empty()) continue;
    const Lines rows = lines_of(of[0]), columns = lines_of(of[1]);
    const double own = rows.excess - kRowsOverColumns * std::fmax(0.0, columns.excess);
    if (rows.level < kFar || !(own > 0.0) || rms_all * std::sqrt(rows.excess) < smooth_255)
      continue;
    if (std::find(rest.kinds.begin(), rest.kinds.end(), "rows") == rest.kinds.end()) note("rows");
    break;
  }
  // Four parameters, as unlikely as what lies kFar off by one.
  constexpr double kFarOfFour = kFar * kFar + 10.0;
  const EvenAndOdd parity = even_and_odd(left, views, knee);
  if (parity.level > kFarOfFour && parity.rms_255 > smooth_255)
    note("even and odd rows or columns");
  // Fringes: neighbouring pixels differ by them as by noise.
  for (std::size_t photo = 0; photo < views.scene().photos.size(); ++photo) {
    const std::ptrdiff_t width = views.scene().photos[photo].width_px,
                         step = views.lattice_step(photo);
    struct Place {
      std::ptrdiff_t row, col;
      double residual;
    };
    std::vector<Place> seen;
    Place least{}, most{};
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      if (pixels[i].photo != photo) continue;
      const auto at = static_cast<std::ptrdiff_t>(pixels[i].at);
      Place p{at / width / step, at % width / step, 0.0};
      for (std::size_t ch = 0; ch < channels; ++ch) p.residual += clipped(i, ch);
      if (seen.empty()) least = most = p;
      least = {std::min(least.row, p.row), std::min(least.col, p.col), 0.0};
      most = {std::max(most.row, p.row), std::max(most.col, p.col), 0.0};
      seen.push_back(p);
    }
    if (seen.empty()) continue;
    Grid<double> map(most.row - least.row + 1, most.col - least.col + 1, NAN);
    for (const Place& p : seen) map(p.row - least.row, p.col - least.col) = p.residual;
    const Wave wave = clearest_wave(map);
    const double rms_255 = rms_all * wave.rms / static_cast<double>(channels);
    if (wave.over < kFringe || rms_255 < smooth_255) continue;
    note(kWaveInPicture);
    break;
  }
  // Neighbouring places' product: what is left beyond noise that is each place's own.
  double products = 0.0, pairs = 0.0, squares = 0.0, all = 0.0, n = 0.0;
  for (const auto& [key, m] : places) {
    const auto next = places.find(key + 1);
    if (m.n < kEnough || next == places.end() || next->second.n < kEnough) continue;
    const double a = m.sum / m.n, b = next->second.sum / next->second.n;
    products += a * b;
    squares += 0.5 * (a * a + b * b);
    pairs += 1.0;
  }
  for (Eigen::Index i = 0; i < left.residual.size(); ++i) {
    all += std::pow(static_cast<double>(left.sigma(i)), 2);
    n += 1.0;
  }
  if (pairs > 0.0) {
    rest.morans_i = products / std::fmax(1e-300, squares);
    rest.p_white = std::erfc(std::fmax(0.0, rest.morans_i) * std::sqrt(0.5 * pairs));
    rest.structured_rms =
        255.0 * std::sqrt(std::fmax(0.0, products / pairs) * all / std::fmax(1.0, n));
  }
  if (scatter.own > kSharedNoise * scatter.factor) note("noise that neighbours share");
  if (rest.structured_rms > std::hypot(smooth_255, finer_255) && rest.p_white < kSmoothLevel)
    note("smooth over the part");
  if (rest.found) rest.share = 1.0;
  return rest;
}

void show_photographs(const PhotoLinear& before, const std::vector<MeasuredPixel>& pixels_before,
                      const PhotoLinear& after, const PhotoViews& views, const Layout& layout,
                      Diagnosis& d) {
  const std::size_t channels = views.channels();
  const auto mean = [&](const PhotoLinear& linear, std::size_t pixel) {
    double sum = 0.0;
    for (std::size_t ch = 0; ch < channels; ++ch) {
      const auto i = static_cast<Eigen::Index>(pixel * channels + ch);
      sum += static_cast<double>(linear.residual(i) * linear.sigma(i));
    }
    return 255.0 * sum / static_cast<double>(channels);
  };
  const auto map = [&](const PhotoLinear& linear, const std::vector<MeasuredPixel>& pixels) {
    const double side = 0.2 * layout.cell_mm;
    Grid<float> sum(5 * layout.rows, 5 * layout.cols, 0.0F),
        n(5 * layout.rows, 5 * layout.cols, 0.0F);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const auto r = static_cast<std::ptrdiff_t>((pixels[i].place.y - layout.y0) / side),
                 c = static_cast<std::ptrdiff_t>((pixels[i].place.x - layout.x0) / side);
      if (!sum.contains(r, c)) continue;
      sum(r, c) += static_cast<float>(mean(linear, i));
      n(r, c) += 1.0F;
    }
    for (std::size_t i = 0; i < sum.cells().size(); ++i)
      sum.cells()[i] = n.cells()[i] > 0.0F ? sum.cells()[i] / n.cells()[i] : NAN;
    return sum;
  };
  d.map = {layout.x0, layout.y0, 0.2 * layout.cell_mm, map(before, pixels_before),
           map(after, views.pixels())};
  const PhotoScene& scene = views.scene();
  struct Covariate {
    const char* name;
    std::function<double(const MeasuredPixel&)> of;
  };
  const auto angle = [](Vec3 a, Vec3 b) {
    return 180.0 / std::numbers::pi *
           std::acos(std::clamp(dot(a, b) / (norm(a) * norm(b)), -1.0, 1.0));
  };
  const std::vector<Covariate> covariates{
      {"radius in the picture, of half its diagonal",
       [&](const MeasuredPixel& p) { return std::sqrt(radius2(p.u, p.v, scene.photos[p.photo])); }},
      {"incidence, degrees",
       [&](const MeasuredPixel& p) {
         return angle(p.normal, scene.photos[p.photo].lamp_position_mm - p.place);
       }},
      {"phase angle, degrees",
       [&](const MeasuredPixel& p) {
         return angle(scene.photos[p.photo].camera_position_mm - p.place,
                      scene.photos[p.photo].lamp_position_mm - p.place);
       }},
      {"value, of full scale",
       [](const MeasuredPixel& p) { return static_cast<double>(p.value[0]); }},
      {"distance from the lamp, mm",
       [&](const MeasuredPixel& p) {
         return norm(scene.photos[p.photo].lamp_position_mm - p.place);
       }},
      {"openness", [](const MeasuredPixel& p) { return static_cast<double>(p.sky); }},
      {"row", [](const MeasuredPixel& p) { return static_cast<double>(p.v); }}};
  constexpr int kClasses = 20;
  for (const Covariate& c : covariates) {
    double low = INFINITY, high = -INFINITY;
    for (const auto& p : views.pixels()) {
      low = std::fmin(low, c.of(p));
      high = std::fmax(high, c.of(p));
    }
    if (!(high > low)) continue;
    Dependence out{c.name, {}, {}, {}, {}};
    std::vector<Mean> was(kClasses), is(kClasses);
    std::vector<double> square(kClasses, 0.0);
    const auto at = [&](const MeasuredPixel& p) {
      return static_cast<std::size_t>(
          std::clamp(static_cast<int>(kClasses * (c.of(p) - low) / (high - low)), 0, kClasses - 1));
    };
    for (std::size_t i = 0; i < pixels_before.size(); ++i) {
      Mean& m = was[at(pixels_before[i])];
      m.sum += mean(before, i);
      m.n += 1.0;
    }
    for (std::size_t i = 0; i < views.pixels().size(); ++i) {
      const std::size_t k = at(views.pixels()[i]);
      const double r = mean(after, i);
      is[k].sum += r;
      is[k].n += 1.0;
      square[k] += r * r;
    }
    for (int k = 0; k < kClasses; ++k) {
      const auto i = static_cast<std::size_t>(k);
      if (is[i].n < 20.0 || was[i].n < 20.0) continue;
      out.at.push_back(low + (high - low) * (k + 0.5) / kClasses);
      out.before.push_back(was[i].sum / was[i].n);
      out.after.push_back(is[i].sum / is[i].n);
      out.sigma.push_back(std::sqrt(square[i] / is[i].n / is[i].n));
    }
    d.dependences.push_back(std::move(out));
  }
}

}  // namespace maquette::diagnosis::detail
