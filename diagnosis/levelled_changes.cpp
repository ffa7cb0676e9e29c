// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/levelled_changes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/ridge.hpp"
#include "diagnosis/detail/smoothed.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Cells are this share of the mean's standard deviation.
constexpr double kCellOfWidth = 0.5;
/// Observations under the mean's weight (2 pi sigma^2) that tell what it is.
constexpr double kPointsOfMean = 8.0;
/// Seen flatter than that, a spot has no mean to speak of.
constexpr double kFlattest = 0.2;

/// What one mm of height, or of range, is of an observation's residual.
double of_change(const Observation& o, bool of_range) {
  return of_range ? dot(o.along, o.beam) : dot(o.along, o.normal) * o.normal.z;
}

struct SetUpPlaces {
  std::vector<std::uint32_t> at;
  Box3 box;
};

/// Takes off what a rigid motion of the set-up would make of it.
void unmove(const std::vector<Observation>& all, const SetUpPlaces& places,
            std::vector<double>& change) {
  using Row = Eigen::Matrix<double, 6, 1>;
  const Vec3 centre = 0.5 * (places.box.min + places.box.max);
  const double half = std::fmax(1.0, 0.5 * (places.box.max.x - places.box.min.x));
  const auto row = [&](const Observation& o) {
    const Vec3 along = level_along(o), turn = (1.0 / half) * cross(o.place - centre, along);
    return Row{along.x, along.y, along.z, turn.x, turn.y, turn.z};
  };
  // Stripes are fixed: sums do not depend on threads.
  constexpr std::size_t kStripes = 16;
  const std::size_t n = places.at.size();
  std::array<Eigen::Matrix<double, 6, 7>, kStripes> sums;  // and the changes
  const auto each = [&](const auto& work) {
    oneapi::tbb::parallel_for(std::size_t{0}, kStripes, [&](std::size_t s) {
      for (std::size_t k = s * n / kStripes; k < (s + 1) * n / kStripes; ++k) work(s, places.at[k]);
    });
  };
  for (auto& sum : sums) sum.setZero();
  each([&](std::size_t s, std::uint32_t i) {
    const Row r = row(all[i]);
    sums[s].leftCols<6>() += r * r.transpose();
    sums[s].col(6) += change[i] * r;
  });
  for (std::size_t s = 1; s < kStripes; ++s) sums[0] += sums[s];
  const Eigen::MatrixXd motion = ridge_solve(sums[0].leftCols<6>(), sums[0].col(6), 1e-10);
  each([&](std::size_t, std::uint32_t i) { change[i] -= row(all[i]).dot(motion.col(0)); });
}

void add_mean(const std::vector<Observation>& all, const SetUpPlaces& places,
              const std::vector<double>& change, const Levels& levels, double coefficient,
              std::vector<double>& to) {
  const auto counts = [&](const Observation& o) {
    return !levels.by_the_spot || (o.has_station && std::abs(o.beam.z) > kFlattest &&
                                   std::abs(dot(o.along, o.beam)) > kFlattest);
  };
  double points = 0.0, lengthened = 0.0;
  for (const std::uint32_t i : places.at)
    if (counts(all[i])) {
      points += 1.0;
      lengthened += levels.by_the_spot ? 1.0 / std::abs(all[i].beam.z) : 1.0;
    }
  const double wide = places.box.max.x - places.box.min.x,
               high = places.box.max.y - places.box.min.y;
  const double weight = 2.0 * std::numbers::pi * levels.sigma_mm * levels.sigma_mm;
  if (!(points * weight > kPointsOfMean * wide * high)) return;
  const double cell = kCellOfWidth * levels.sigma_mm;
  // A spot is longer along the beam: a round one of the same area stands for it. Sorting into cells
  // and reading between them have blurred by a quarter of cell^2 already.
  const double nodes = std::sqrt(lengthened / points / (kCellOfWidth * kCellOfWidth) - 0.25);
  const auto rows = static_cast<std::ptrdiff_t>(high / cell) + 2,
             cols = static_cast<std::ptrdiff_t>(wide / cell) + 2;
  Grid<float> sum(rows, cols, 0.0F), count(rows, cols, 0.0F);
  for (const std::uint32_t i : places.at) {
    const Observation& o = all[i];
    if (!counts(o)) continue;
    const auto r = static_cast<std::ptrdiff_t>((o.place.y - places.box.min.y) / cell),
               c = static_cast<std::ptrdiff_t>((o.place.x - places.box.min.x) / cell);
    sum(r, c) += static_cast<float>(change[i] / of_change(o, levels.by_the_spot));
    count(r, c) += 1.0F;
  }
  // Of cells, not of points: what lies denser by chance would draw the mean to it.
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      sum(r, c) = count(r, c) > 0.0F ? sum(r, c) / count(r, c) : NAN;
  const heightmap::ModelField mean{std::move(smoothed(sum, std::array{nodes})[0]),
                                   Millimetres{cell}, Millimetres{places.box.min.x + 0.5 * cell},
                                   Millimetres{places.box.min.y + 0.5 * cell}};
  oneapi::tbb::parallel_for(std::size_t{0}, places.at.size(), [&](std::size_t k) {
    const std::uint32_t i = places.at[k];
    const Observation& o = all[i];
    if (!counts(o)) return;
    const double m = heightmap::height_at(mean, o.place.x, o.place.y);
    if (std::isfinite(m)) to[i] += coefficient * (of_change(o, levels.by_the_spot) * m - change[i]);
  });
}

}  // namespace

void add_levelled(const std::vector<Observation>& all, std::vector<double> change,
                  const std::vector<LevellingTerm>& terms, std::vector<double>& to) {
  constexpr double kFlat = 1e-3;
  std::vector<SetUpPlaces> set_ups;
  for (std::uint32_t i = 0; i < all.size(); ++i) {
    const Observation& o = all[i];
    if (!o.on_surface || !(std::abs(of_change(o, false)) > kFlat)) continue;
    if (o.set_up >= set_ups.size()) set_ups.resize(o.set_up + 1);
    set_ups[o.set_up].at.push_back(i);
    set_ups[o.set_up].box.add(o.place);
  }
  for (const SetUpPlaces& places : set_ups)
    if (!places.at.empty()) unmove(all, places, change);
  for (const bool by_the_spot : {false, true}) {
    for (const LevellingTerm& t : terms)
      if (t.levels.by_the_spot == by_the_spot)
        for (const SetUpPlaces& places : set_ups)
          if (!places.at.empty()) add_mean(all, places, change, t.levels, t.coefficient, to);
    if (by_the_spot) break;
    for (const LevellingTerm& t : terms)
      if (!t.levels.by_the_spot)
        for (std::size_t i = 0; i < all.size(); ++i) change[i] += t.moved_mm(i);
  }
}

}  // namespace maquette::diagnosis::detail
