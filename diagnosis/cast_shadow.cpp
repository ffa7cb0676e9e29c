// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/cast_shadow.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <mutex>

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/smoothed.hpp"
#include "heightmap/field_tracer.hpp"

namespace maquette::diagnosis {

namespace {

using heightmap::ModelField;
/// Of the coarse copy: finer than its edges, at most so many nodes a side.
constexpr double kFinest_mm = 0.7, kMostNodes = 800.0;
constexpr double kAll = 255.0;

ModelField coarse(const ModelField& of) {
  const double wide = of.x_mm(of.z_mm.cols() - 1) - of.x0.value(),
               high = of.y_mm(of.z_mm.rows() - 1) - of.y0.value();
  const double step =
      std::max({kFinest_mm, of.spacing.value(), std::fmax(wide, high) / kMostNodes});
  const auto nodes = [step](double side) {
    return std::max(std::ptrdiff_t{2}, static_cast<std::ptrdiff_t>(side / step) + 1);
  };
  ModelField made{Grid<float>(nodes(high), nodes(wide), NAN), Millimetres{step}, of.x0, of.y0};
  for (std::ptrdiff_t r = 0; r < made.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < made.z_mm.cols(); ++c)
      made.z_mm(r, c) = static_cast<float>(heightmap::height_at(of, made.x_mm(c), made.y_mm(r)));
  return made;
}

class Shadows {
 public:
  explicit Shadows(const ModelField& relief) : relief_(coarse(relief)), tracer_(relief_) {}
  Shadows(const Shadows&) = delete;  // the tracer refers to the relief
  Shadows& operator=(const Shadows&) = delete;

  std::shared_ptr<const CastShadow> of(Vec3 towards) {
    const std::array key{towards.x, towards.y, towards.z};
    {
      const std::scoped_lock lock(guard_);
      if (const auto known = made_.find(key); known != made_.end()) return known->second;
    }
    auto shadow = std::make_shared<const CastShadow>(cast(towards));
    const std::scoped_lock lock(guard_);
    return made_.emplace(key, std::move(shadow)).first->second;
  }

 private:
  ModelField relief_;
  heightmap::FieldTracer tracer_;
  std::mutex guard_;
  std::map<std::array<double, 3>, std::shared_ptr<const CastShadow>> made_;

  [[nodiscard]] CastShadow cast(Vec3 towards) const {
    constexpr double kFar_mm = 1e5;
    const auto& z = relief_.z_mm;
    const double step = relief_.spacing.value();
    Grid<float> free(z.rows(), z.cols(), NAN);
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.rows(), [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
        if (std::isnan(z(r, c))) continue;
        const Vec3 place{relief_.x_mm(c), relief_.y_mm(r), static_cast<double>(z(r, c))};
        // A face that turns away gets none whatever it sees; what it stands in is another's.
        free(r, c) = tracer_.blocked(place, towards, kFar_mm, step) ? 0.0F : 1.0F;
      }
    });
    const std::array width{kShadowEdge_mm / step};
    const auto soft = std::move(detail::smoothed(free, width)[0]);
    CastShadow made{Grid<std::uint8_t>(z.rows(), z.cols(), 0), relief_.x0.value(),
                    relief_.y0.value(), step, 0.0};
    double dark = 0.0, count = 0.0;
    for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
        const double seen = std::isnan(soft(r, c)) ? 1.0 : static_cast<double>(soft(r, c));
        made.reached(r, c) = static_cast<std::uint8_t>(std::lround(kAll * seen));
        dark += 1.0 - seen;
        count += 1.0;
      }
    made.share = count > 0.0 ? dark / count : 0.0;
    return made;
  }
};

}  // namespace

double CastShadow::at(double x_mm, double y_mm) const {
  const auto within = [](double v, std::ptrdiff_t n) {
    return std::clamp(v, 0.0, std::fmax(0.0, static_cast<double>(n) - 1.0));
  };
  const double u = within((x_mm - x0_mm) / spacing_mm, reached.cols()),
               v = within((y_mm - y0_mm) / spacing_mm, reached.rows());
  const auto c = static_cast<std::ptrdiff_t>(u), r = static_cast<std::ptrdiff_t>(v);
  const auto c1 = std::min(c + 1, reached.cols() - 1), r1 = std::min(r + 1, reached.rows() - 1);
  const double fu = u - static_cast<double>(c), fv = v - static_cast<double>(r);
  const auto node = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
    return static_cast<double>(reached(row, col));
  };
  return (std::lerp(node(r, c), node(r, c1), fu) * (1.0 - fv) +
          std::lerp(node(r1, c), node(r1, c1), fu) * fv) /
         kAll;
}

std::function<std::shared_ptr<const CastShadow>(Vec3 towards)> cast_shadows(
    const ModelField& relief) {
  return [all = std::make_shared<Shadows>(relief)](Vec3 towards) { return all->of(towards); };
}

}  // namespace maquette::diagnosis
