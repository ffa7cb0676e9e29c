// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/match_level.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace maquette::camera::detail {
namespace {

constexpr double kHuber = 1.345;      ///< 95 % of least squares' efficiency for normal errors
constexpr double kOfMedian = 1.4826;  ///< standard deviation over the median of absolute values
constexpr int kEdgePx = 2;
constexpr float kEdgeWeight = 0.1F;
constexpr std::size_t kBins = 16;  ///< of brightness
constexpr std::size_t kLeastInBin = 60;
constexpr std::size_t kLeastPixels = 40;
constexpr double kLeastSigma = 1e-5;
constexpr double kLampTurn = 0.005;  ///< step of a lamp's place over its distance
/// Of a pixel's light: one of its samples has come into a shadow. Such jumps are thirty times what
/// shading changes by; taken for derivatives they hide it, and a lamp's distance is never found.
constexpr double kFlip = 0.15;
constexpr double kBrighter = 0.1;
constexpr int kDifferingSamples = 4;
constexpr std::ptrdiff_t kCellsAcross = 24, kLeastCellPx = 4, kLargestCellPx = 32;

double median(std::vector<double>& v) {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

double principal(double given, int size_px) {
  return std::isnan(given) ? 0.5 * size_px : given;
}

}  // namespace

int factor_for(int width_px, int wanted_px) {
  int factor = 1;
  while (width_px / factor > wanted_px) factor *= 2;
  return factor;
}

MatchLevel::MatchLevel(const PreparedScene& scene, const std::vector<MatchPhoto>& photos,
                       const Unknowns& unknowns, RenderOptions render, int factor)
    : scene_(scene), photos_(photos), unknowns_(unknowns), render_(render) {
  render_.exposure_scale = 1.0;
  render_.white_balance = {1.0, 1.0, 1.0};
  render_.geometry = false;
  // What a step is made of need not be as good as what it is judged by; other places of the pixels,
  // so that a derivative has nothing in common with what is left.
  differing_ = render_;
  differing_.samples_per_pixel = std::min(kDifferingSamples, render.samples_per_pixel);
  differing_.noise_target = 0.0;
  ++differing_.seed;
  for (const MatchPhoto& photo : photos) {
    Shown& s = shown_.emplace_back();
    const std::ptrdiff_t rows = photo.light[0].rows() / factor,
                         cols = photo.light[0].cols() / factor;
    s.camera = photo.camera;
    s.camera.width_px = static_cast<int>(cols), s.camera.height_px = static_cast<int>(rows);
    s.camera.pixel_pitch_um *= factor;
    s.camera.skew_px /= factor;
    s.camera.principal_x_px =
        principal(photo.camera.principal_x_px, photo.camera.width_px) / factor;
    s.camera.principal_y_px =
        principal(photo.camera.principal_y_px, photo.camera.height_px) / factor;
    s.usable = Grid<std::uint8_t>(rows, cols, 1);
    for (const Grid<float>& band : photo.light) {
      Grid<float>& to = s.light.emplace_back(rows, cols);
      for (std::ptrdiff_t r = 0; r < rows; ++r)
        for (std::ptrdiff_t c = 0; c < cols; ++c) {
          double sum = 0.0;
          for (std::ptrdiff_t i = 0; i < factor; ++i)
            for (std::ptrdiff_t j = 0; j < factor; ++j) {
              const auto v = static_cast<double>(band(factor * r + i, factor * c + j));
              if (!(v < kSaturated)) s.usable(r, c) = 0;  // what is not finite, too
              sum += v;
            }
          if (!std::isfinite(sum)) s.usable(r, c) = 0;
          to(r, c) = static_cast<float>(sum / (factor * factor));
        }
    }
    s.sigma.assign(s.light.size(), Grid<float>(rows, cols));
  }
}

Result<Image> MatchLevel::picture(std::size_t photo, const MatchState& state,
                                  const RenderOptions& render, const RunContext& run) const {
  RunContext quiet = run;
  quiet.progress = [](double) {};
  auto image = scene_.render(shown_[photo].camera, state.model_from_camera[photo], state.lighting,
                             render, quiet);
  if (!image) return tl::unexpected(std::move(image.error()).within(photos_[photo].name));
  return image;
}

double MatchLevel::factor(std::size_t photo, std::size_t band, const MatchState& state) const {
  const double balance = shown_[photo].light.size() == 3 ? state.white_balance[band] : 1.0;
  return state.exposure_scale[photo] * balance;
}

double MatchLevel::rendered(const Shown& s, const Image& image, std::size_t band,
                            std::size_t i) const {
  const auto at = [&](std::size_t k) { return static_cast<double>(image.bands[k].cells()[i]); };
  if (image.bands.size() == 1) return at(0);
  return s.light.size() == 3 ? at(band) : (at(0) + at(1) + at(2)) / 3.0;
}

Result<void> MatchLevel::stand_at(const MatchState& state, const RunContext& run) {
  state_ = state;
  const MatchSearch& search = unknowns_.search();
  for (std::size_t p = 0; p < shown_.size(); ++p) {
    Shown& s = shown_[p];
    MAQUETTE_TRY(s.image, picture(p, state, render_, run));
    MAQUETTE_TRY_VOID(mask(p));
    if (search.lamp_position) {
      const Lamp& lamp = state.lighting.lamps.front();
      lamp_step_mm_ = kLampTurn * norm(lamp.target_mm - lamp.position_mm);
      const std::array<Vec3, 3> ways{Vec3{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
      for (std::size_t k = 0; k < 3; ++k)
        for (const double side : {-1.0, 1.0}) {
          MatchState moved = state;
          moved.lighting.lamps.front().position_mm += side * lamp_step_mm_ * ways[k];
          MAQUETTE_TRY((side < 0.0 ? s.lamp_minus : s.lamp_plus)[k],
                       picture(p, moved, differing_, run));
        }
    }
    if (search.lamp_brightness) {
      MatchState brighter = state;
      for (double& c : brighter.lighting.lamps.front().colour) c *= 1.0 + kBrighter;
      MAQUETTE_TRY(s.brighter, picture(p, brighter, render_, run));
    }
  }
  weigh();
  return {};
}

Result<void> MatchLevel::mask(std::size_t photo) {
  Shown& s = shown_[photo];
  const std::ptrdiff_t rows = s.usable.rows(), cols = s.usable.cols();
  s.weight = Grid<float>(rows, cols, 0.0F);
  std::size_t pixels = 0;
  for (std::ptrdiff_t r = 1; r + 1 < rows; ++r)
    for (std::ptrdiff_t c = 1; c + 1 < cols; ++c) {
      bool inside = s.usable(r, c) != 0;
      for (std::ptrdiff_t i = -1; i <= 1; ++i)
        for (std::ptrdiff_t j = -1; j <= 1; ++j)
          inside = inside && std::isfinite(s.image.depth_mm(r + i, c + j));
      if (!inside) continue;
      bool edge = false;
      for (std::ptrdiff_t i = -kEdgePx; i <= kEdgePx; ++i)
        for (std::ptrdiff_t j = -kEdgePx; j <= kEdgePx; ++j)
          edge = edge || (s.image.lit.contains(r + i, c + j) &&
                          s.image.lit(r + i, c + j) != s.image.lit(r, c));
      s.weight(r, c) = edge ? kEdgeWeight : 1.0F;
      ++pixels;
    }
  if (pixels < kLeastPixels)
    return fail(kMatchPhotograph,
                fmt::format("{}: only {} of {} x {} pixels show the scene and are not saturated; "
                            "check the pose and the exposure",
                            photos_[photo].name, pixels, cols, rows));
  return {};
}

template <class Each>
void MatchLevel::over_values(const Each& each) const {
  for (std::size_t p = 0; p < shown_.size(); ++p) {
    const Shown& s = shown_[p];
    for (std::ptrdiff_t r = 0; r < s.weight.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < s.weight.cols(); ++c) {
        if (!(s.weight(r, c) > 0.0F)) continue;
        const auto i = static_cast<std::size_t>(r * s.weight.cols() + c);
        for (std::size_t b = 0; b < s.light.size(); ++b)
          each(p, r, c, b,
               static_cast<double>(s.light[b].cells()[i]) -
                   factor(p, b, state_) * rendered(s, s.image, b, i));
      }
  }
}

/// Scatter against brightness, of all photographs together.
void MatchLevel::weigh() {
  const auto bright = [&](std::size_t p, std::ptrdiff_t r, std::ptrdiff_t c, std::size_t b) {
    const Shown& s = shown_[p];
    const auto i = static_cast<std::size_t>(r * s.weight.cols() + c);
    return std::sqrt(std::max(0.0, factor(p, b, state_) * rendered(s, s.image, b, i)));
  };
  double most = 1e-9;
  over_values(
      [&](auto p, auto r, auto c, auto b, double) { most = std::max(most, bright(p, r, c, b)); });
  const auto bin = [&](double value) { return std::min(value / most, 0.999999) * kBins; };
  std::array<std::vector<double>, kBins> off;
  std::vector<double> all;
  over_values([&](auto p, auto r, auto c, auto b, double e) {
    all.push_back(std::abs(e));
    if (shown_[p].weight(r, c) == 1.0F)
      off[static_cast<std::size_t>(bin(bright(p, r, c, b)))].push_back(std::abs(e));
  });
  const double usual = kOfMedian * median(all), least = std::max(kLeastSigma, 0.1 * usual);
  std::array<double, kBins> sigma{};
  for (std::size_t k = 0; k < kBins; ++k)
    sigma[k] = off[k].size() < kLeastInBin ? NAN : std::max(least, kOfMedian * median(off[k]));
  const auto filled = sigma;  // thin bins have the nearest one's
  for (std::size_t k = 0; k < kBins; ++k)
    for (std::size_t away = 1; away < kBins && std::isnan(sigma[k]); ++away) {
      if (k >= away) sigma[k] = filled[k - away];
      if (std::isnan(sigma[k]) && k + away < kBins) sigma[k] = filled[k + away];
    }
  for (double& v : sigma)
    if (std::isnan(v)) v = std::max(least, usual);
  over_values([&](auto p, auto r, auto c, auto b, double) {
    const double at = std::clamp(bin(bright(p, r, c, b)) - 0.5, 0.0, kBins - 1.0);
    const auto k = std::min(static_cast<std::size_t>(at), kBins - 2);
    const double share = at - static_cast<double>(k);
    shown_[p].sigma[b](r, c) = static_cast<float>((1.0 - share) * sigma[k] + share * sigma[k + 1]);
  });
}

Eigen::Matrix<double, kOwn, 1> MatchLevel::derivative(std::size_t p, std::size_t b,
                                                      std::ptrdiff_t r, std::ptrdiff_t c) const {
  Eigen::Matrix<double, kOwn, 1> d = Eigen::Matrix<double, kOwn, 1>::Zero();
  const Shown& s = shown_[p];
  const MatchSearch& search = unknowns_.search();
  const std::ptrdiff_t cols = s.weight.cols();
  const auto i = static_cast<std::size_t>(r * cols + c);
  const double f = factor(p, b, state_), value = f * rendered(s, s.image, b, i);
  d(kExposure) = value;
  if (s.light.size() == 3 && b == 0) d(kRed) = value;
  if (s.light.size() == 3 && b == 2) d(kBlue) = value;
  if (search.lamp_position && s.weight(r, c) == 1.0F)
    for (std::size_t k = 0; k < 3; ++k) {
      const double more = rendered(s, s.lamp_plus[k], b, i),
                   less = rendered(s, s.lamp_minus[k], b, i);
      if (std::abs(more - less) < kFlip * std::max(more, less))
        d(kLamp + static_cast<Eigen::Index>(k)) = f * (more - less) / (2.0 * lamp_step_mm_);
    }
  if (search.lamp_brightness)
    d(kBrightness) = (f * rendered(s, s.brighter, b, i) - value) / kBrighter;
  if (!search.pose) return d;
  const auto at = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
    return f * rendered(s, s.image, b, static_cast<std::size_t>(row * cols + col));
  };
  const double gx = 0.5 * (at(r, c + 1) - at(r, c - 1)), gy = 0.5 * (at(r + 1, c) - at(r - 1, c));
  // The place in the camera's frame; a camera that moves by t and turns by w sees it at
  // p - t - w x p.
  const CameraModel& camera = s.camera;
  const double fx = 1e3 * camera.focal_length_mm / camera.pixel_pitch_um, fy = camera.aspect * fx;
  const double y = -(static_cast<double>(r) + 0.5 - camera.principal_y_px) / fy;
  const double x = (static_cast<double>(c) + 0.5 - camera.principal_x_px + camera.skew_px * y) / fx;
  const double depth = static_cast<double>(s.image.depth_mm(r, c)) / std::sqrt(1.0 + x * x + y * y);
  const Vec3 place = depth * Vec3{x, y, -1.0};
  const std::array<Vec3, 3> ways{Vec3{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (Eigen::Index k = 0; k < 6; ++k) {
    const Vec3 way = ways[static_cast<std::size_t>(k % 3)];
    const Vec3 moves = k < 3 ? -way : -cross(way, place);
    const double du = fx * (moves.x + x * moves.z) / depth,
                 dv = -fy * (moves.y + y * moves.z) / depth;
    d(kPose + k) = -(gx * du + gy * dv);
  }
  return d;
}

NormalEquations MatchLevel::equations() const {
  const Eigen::Index n = unknowns_.count();
  NormalEquations out{Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(n, n),
                      Eigen::VectorXd::Zero(n)};
  using Own2 = Eigen::Matrix<double, kOwn, kOwn>;
  using Own1 = Eigen::Matrix<double, kOwn, 1>;
  std::vector<Own2> normal(shown_.size(), Own2::Zero()), bread = normal;
  std::vector<Own1> gradient(shown_.size(), Own1::Zero());
  over_values([&](auto p, auto r, auto c, auto b, double e) {
    const double sigma = static_cast<double>(shown_[p].sigma[b](r, c)),
                 weight = static_cast<double>(shown_[p].weight(r, c)), z = e / sigma;
    const bool inside = std::abs(z) <= kHuber;
    const double down = inside ? 1.0 : kHuber / std::abs(z);
    const Own1 d = derivative(p, b, r, c) / sigma;
    const Own2 square = weight * d * d.transpose();
    normal[p] += down * square;
    if (inside) bread[p] += square;
    gradient[p] += weight * down * z * d;
    ++out.values;
    out.cost += weight * (inside ? 0.5 * z * z : kHuber * (std::abs(z) - 0.5 * kHuber));
  });
  for (std::size_t p = 0; p < shown_.size(); ++p)
    for (Eigen::Index i = 0; i < kOwn; ++i) {
      const auto row = unknowns_.place(p, i);
      if (!row) continue;
      out.gradient(*row) += gradient[p](i);
      for (Eigen::Index j = 0; j < kOwn; ++j)
        if (const auto col = unknowns_.place(p, j)) {
          out.normal(*row, *col) += normal[p](i, j);
          out.bread(*row, *col) += bread[p](i, j);
        }
    }
  return out;
}

ScoreSums MatchLevel::scores() const {
  const Eigen::Index n = unknowns_.count();
  ScoreSums out{Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(n, n)};
  std::vector<Grid<Eigen::VectorXd>> cells;
  std::vector<std::ptrdiff_t> side;
  for (const Shown& s : shown_) {
    side.push_back(std::clamp(s.weight.cols() / kCellsAcross, kLeastCellPx, kLargestCellPx));
    cells.emplace_back(s.weight.rows() / side.back() + 1, s.weight.cols() / side.back() + 1);
  }
  over_values([&](auto p, auto r, auto c, auto b, double e) {
    const double sigma = static_cast<double>(shown_[p].sigma[b](r, c)),
                 z = std::clamp(e / sigma, -kHuber, kHuber) *
                     static_cast<double>(shown_[p].weight(r, c)) / sigma;
    const auto own = derivative(p, b, r, c);
    Eigen::VectorXd score = Eigen::VectorXd::Zero(n);
    for (Eigen::Index k = 0; k < kOwn; ++k)
      if (const auto at = unknowns_.place(p, k)) score(*at) = z * own(k);
    out.of_values += score * score.transpose();
    ++out.values;
    Eigen::VectorXd& cell = cells[p](r / side[p], c / side[p]);
    if (cell.size() == 0) cell = Eigen::VectorXd::Zero(n);
    cell += score;
  });
  // Bartlett's weights: half for a neighbour, a quarter across a corner; never negative.
  for (const auto& grid : cells)
    for (std::ptrdiff_t r = 0; r < grid.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < grid.cols(); ++c) {
        if (grid(r, c).size() == 0) continue;
        ++out.cells;
        Eigen::VectorXd around = Eigen::VectorXd::Zero(n);
        for (std::ptrdiff_t i = -1; i <= 1; ++i)
          for (std::ptrdiff_t j = -1; j <= 1; ++j)
            if (grid.contains(r + i, c + j) && grid(r + i, c + j).size() != 0)
              around += (i == 0 ? 1.0 : 0.5) * (j == 0 ? 1.0 : 0.5) * grid(r + i, c + j);
        out.of_cells += grid(r, c) * around.transpose();
      }
  return out;
}

Result<double> MatchLevel::cost(const MatchState& state, const RunContext& run) const {
  std::vector<Image> images;
  for (std::size_t p = 0; p < shown_.size(); ++p) {
    MAQUETTE_TRY(auto image, picture(p, state, render_, run));
    images.push_back(std::move(image));
  }
  double cost = 0.0;
  over_values([&](auto p, auto r, auto c, auto b, double) {
    const Shown& s = shown_[p];
    const auto i = static_cast<std::size_t>(r * s.weight.cols() + c);
    const double z = std::abs(static_cast<double>(s.light[b].cells()[i]) -
                              factor(p, b, state) * rendered(s, images[p], b, i)) /
                     static_cast<double>(s.sigma[b](r, c));
    cost += static_cast<double>(s.weight(r, c)) *
            (z <= kHuber ? 0.5 * z * z : kHuber * (z - 0.5 * kHuber));
  });
  return cost;
}

double MatchLevel::scatter() const {
  std::vector<double> all;
  over_values([&](auto, auto, auto, auto, double e) { all.push_back(std::abs(e)); });
  return kOfMedian * median(all);
}

std::vector<double> MatchLevel::likeness() const {
  struct Sums {
    double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  };
  std::vector<Sums> sums(shown_.size());
  over_values([&](auto p, auto r, auto c, auto band, double e) {
    const auto a = static_cast<double>(shown_[p].light[band](r, c)), b = a - e;
    Sums& s = sums[p];
    s.n += 1, s.a += a, s.b += b, s.aa += a * a, s.bb += b * b, s.ab += a * b;
  });
  std::vector<double> out;
  for (const Sums& s : sums) {
    const double va = s.aa - s.a * s.a / s.n, vb = s.bb - s.b * s.b / s.n;
    out.push_back(va > 0 && vb > 0 ? (s.ab - s.a * s.b / s.n) / std::sqrt(va * vb) : 0.0);
  }
  return out;
}

}  // namespace maquette::camera::detail
