// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/height_spline.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.hpp"
#include "meshing/detail/shell.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using std::ptrdiff_t;

/// The four cubics that are not null somewhere, of the poles `first` .. `first` + 3.
struct Basis {
  ptrdiff_t first = 0;
  std::array<double, 4> value{};
};

/// One direction: knots counted in cells of the grid.
class Knots {
 public:
  explicit Knots(std::vector<double> distinct) : distinct_(std::move(distinct)) {
    all_.assign(3, distinct_.front());
    all_.insert(all_.end(), distinct_.begin(), distinct_.end());
    all_.insert(all_.end(), 3, distinct_.back());
  }
  /// As few evenly spaced ones as lie no farther apart than `step` cells; step 1: not-a-knot.
  static Knots spaced(ptrdiff_t cells, int step) {
    std::vector<double> k;
    if (step > 1) {
      const ptrdiff_t count = (cells + step - 1) / step;
      for (ptrdiff_t i = 0; i <= count; ++i)
        k.push_back(static_cast<double>(cells) * static_cast<double>(i) /
                    static_cast<double>(count));
    } else {
      for (ptrdiff_t i = 0; i <= cells; ++i)
        if (i != 1 && i != cells - 1) k.push_back(static_cast<double>(i));
    }
    return Knots(std::move(k));
  }
  [[nodiscard]] const std::vector<double>& distinct() const { return distinct_; }
  [[nodiscard]] ptrdiff_t poles() const { return static_cast<ptrdiff_t>(distinct_.size()) + 2; }

  /// Cox and de Boor's recurrence.
  [[nodiscard]] Basis at(double t) const {
    const auto after = std::upper_bound(distinct_.begin() + 1, distinct_.end() - 1, t);
    Basis b;
    b.first = after - distinct_.begin() - 1;
    const double* const k = all_.data() + b.first + 3;  // the last knot that is not above t
    b.value[0] = 1.0;
    for (int degree = 1; degree <= 3; ++degree) {
      double carried = 0.0;
      for (int i = 0; i < degree; ++i) {
        const double right = k[i + 1], left = k[i + 1 - degree];
        const double part = b.value[static_cast<std::size_t>(i)] / (right - left);
        b.value[static_cast<std::size_t>(i)] = carried + (right - t) * part;
        carried = (t - left) * part;
      }
      b.value[static_cast<std::size_t>(degree)] = carried;
    }
    return b;
  }
  [[nodiscard]] std::vector<Basis> at_nodes(ptrdiff_t nodes) const {
    std::vector<Basis> all;
    for (ptrdiff_t i = 0; i < nodes; ++i) all.push_back(at(static_cast<double>(i)));
    return all;
  }

 private:
  std::vector<double> distinct_, all_;
};

/// L of the normal equations L L^T: the diagonal and the three below it.
class BandFactor {
 public:
  BandFactor(const std::vector<Basis>& nodes, ptrdiff_t poles)
      : l_(static_cast<std::size_t>(poles)) {
    for (const Basis& b : nodes)
      for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j <= i; ++j)
          l_[static_cast<std::size_t>(b.first) + i][i - j] += b.value[i] * b.value[j];
    for (std::size_t i = 0; i < l_.size(); ++i)
      for (std::size_t d = std::min<std::size_t>(i, 3) + 1; d-- > 0;) {
        const std::size_t j = i - d;
        double sum = l_[i][d];
        for (std::size_t e = d + 1; e <= std::min<std::size_t>(i, 3); ++e)
          if (j >= e - d && e - d <= 3) sum -= l_[i][e] * l_[j][e - d];
        l_[i][d] = d > 0 ? sum / l_[j][0] : std::sqrt(sum);
      }
  }
  /// @param value  of n: the right side's and then the solution's reference
  template <class Value>
  void solve(Value value) const {
    const std::size_t n = l_.size();
    for (std::size_t i = 0; i < n; ++i) {
      double sum = value(i);
      for (std::size_t d = 1; d <= std::min<std::size_t>(i, 3); ++d) sum -= l_[i][d] * value(i - d);
      value(i) = sum / l_[i][0];
    }
    for (std::size_t i = n; i-- > 0;) {
      double sum = value(i);
      for (std::size_t d = 1; d <= 3 && i + d < n; ++d) sum -= l_[i + d][d] * value(i + d);
      value(i) = sum / l_[i][0];
    }
  }

 private:
  std::vector<std::array<double, 4>> l_;
};

class Fit {
 public:
  Fit(const ModelField& surface, int step)
      : surface_(surface),
        kx_(Knots::spaced(surface.z_mm.cols() - 1, step)),
        ky_(Knots::spaced(surface.z_mm.rows() - 1, step)),
        bx_(kx_.at_nodes(surface.z_mm.cols())),
        by_(ky_.at_nodes(surface.z_mm.rows())),
        poles_(ky_.poles(), kx_.poles(), 0.0) {}

  void solve() {
    std::vector<double> row(static_cast<std::size_t>(poles_.cols()));
    for (ptrdiff_t r = 0; r < surface_.z_mm.rows(); ++r) {
      std::fill(row.begin(), row.end(), 0.0);
      for (std::size_t c = 0; c < bx_.size(); ++c) {
        const auto z = static_cast<double>(surface_.z_mm(r, static_cast<ptrdiff_t>(c)));
        for (std::size_t k = 0; k < 4; ++k)
          row[static_cast<std::size_t>(bx_[c].first) + k] += bx_[c].value[k] * z;
      }
      const Basis& b = by_[static_cast<std::size_t>(r)];
      for (std::size_t k = 0; k < 4; ++k)
        for (ptrdiff_t i = 0; i < poles_.cols(); ++i)
          poles_(b.first + static_cast<ptrdiff_t>(k), i) +=
              b.value[k] * row[static_cast<std::size_t>(i)];
    }
    const BandFactor fx(bx_, kx_.poles()), fy(by_, ky_.poles());
    for (ptrdiff_t j = 0; j < poles_.rows(); ++j)
      fx.solve([&](std::size_t i) -> double& { return poles_(j, static_cast<ptrdiff_t>(i)); });
    for (ptrdiff_t i = 0; i < poles_.cols(); ++i)
      fy.solve([&](std::size_t j) -> double& { return poles_(static_cast<ptrdiff_t>(j), i); });
  }

  /// Error at the nodes and at the middles of cells.
  HeightSpline measured() {
    HeightSpline s;
    std::vector<Basis> middle_x;
    for (ptrdiff_t c = 0; c + 1 < surface_.z_mm.cols(); ++c)
      middle_x.push_back(kx_.at(static_cast<double>(c) + 0.5));
    std::vector<double> row(static_cast<std::size_t>(poles_.cols()));
    double squares = 0.0;
    for (ptrdiff_t r = 0; r < surface_.z_mm.rows(); ++r) {
      combine(by_[static_cast<std::size_t>(r)], row);
      for (std::size_t c = 0; c < bx_.size(); ++c) {
        const double e =
            along(bx_[c], row) - static_cast<double>(surface_.z_mm(r, static_cast<ptrdiff_t>(c)));
        s.max_error_mm = std::fmax(s.max_error_mm, std::abs(e));
        squares += e * e;
      }
      if (r + 1 == surface_.z_mm.rows()) break;
      combine(ky_.at(static_cast<double>(r) + 0.5), row);
      for (std::size_t c = 0; c < middle_x.size(); ++c) {
        const auto col = static_cast<ptrdiff_t>(c);  // the diagonal runs through the middle
        const double facet = 0.5 * (static_cast<double>(surface_.z_mm(r, col)) +
                                    static_cast<double>(surface_.z_mm(r + 1, col + 1)));
        s.max_between_mm = std::fmax(s.max_between_mm, std::abs(along(middle_x[c], row) - facet));
      }
    }
    s.rms_error_mm = std::sqrt(squares / static_cast<double>(surface_.z_mm.cells().size()));
    return s;
  }

  void give(HeightSpline& s) {
    const double step = surface_.spacing.value();
    for (const double k : kx_.distinct()) s.knots_x_mm.push_back(surface_.x0.value() + step * k);
    for (const double k : ky_.distinct()) s.knots_y_mm.push_back(surface_.y0.value() + step * k);
    s.poles_mm = std::move(poles_);
  }

 private:
  void combine(const Basis& b, std::vector<double>& row) const {
    for (ptrdiff_t i = 0; i < poles_.cols(); ++i) {
      double sum = 0.0;
      for (std::size_t k = 0; k < 4; ++k)
        sum += b.value[k] * poles_(b.first + static_cast<ptrdiff_t>(k), i);
      row[static_cast<std::size_t>(i)] = sum;
    }
  }
  static double along(const Basis& b, const std::vector<double>& row) {
    double z = 0.0;
    for (std::size_t k = 0; k < 4; ++k)
      z += b.value[k] * row[static_cast<std::size_t>(b.first) + k];
    return z;
  }

  const ModelField& surface_;
  Knots kx_, ky_;
  std::vector<Basis> bx_, by_;
  Grid<double> poles_;
};

}  // namespace

Result<HeightSpline> fit_height_spline(const ModelField& surface, Millimetres tolerance,
                                       const RunContext& run) {
  const ptrdiff_t least = std::min(surface.z_mm.rows(), surface.z_mm.cols());
  MAQUETTE_CHECK(least >= 4 && tolerance.value() > 0.0, "{} nodes, {} mm", least,
                 tolerance.value());
  MAQUETTE_TRY_VOID(detail::check_no_voids(surface.z_mm, "fitting"));
  constexpr std::array kSteps{32, 24, 16, 12, 8, 6, 4, 3, 2, 1};
  for (std::size_t i = 0; i < kSteps.size(); ++i) {
    if (run.stopped()) return fail(kCancelled, "fitting the surface was stopped");
    // Wider knots than half of the part leave no node for some of the poles.
    if (kSteps[i] > 1 && 2 * kSteps[i] > least - 1) continue;
    Fit fit(surface, kSteps[i]);
    fit.solve();
    HeightSpline spline = fit.measured();
    run.progress(static_cast<double>(i + 1) / kSteps.size());
    if (spline.max_error_mm > tolerance.value() && kSteps[i] > 1) continue;
    fit.give(spline);
    return spline;
  }
  MAQUETTE_CHECK(false, "interpolation is always tried");
  return HeightSpline{};
}

double height_of(const HeightSpline& spline, double x_mm, double y_mm) {
  const Knots kx(spline.knots_x_mm), ky(spline.knots_y_mm);
  const Basis bx = kx.at(std::clamp(x_mm, spline.knots_x_mm.front(), spline.knots_x_mm.back()));
  const Basis by = ky.at(std::clamp(y_mm, spline.knots_y_mm.front(), spline.knots_y_mm.back()));
  double z = 0.0;
  for (std::size_t j = 0; j < 4; ++j)
    for (std::size_t i = 0; i < 4; ++i)
      z += by.value[j] * bx.value[i] *
           spline.poles_mm(by.first + static_cast<ptrdiff_t>(j),
                           bx.first + static_cast<ptrdiff_t>(i));
  return z;
}

std::vector<double> greville_places(const std::vector<double>& knots_mm) {
  std::vector<double> all(2, knots_mm.front());
  all.insert(all.end(), knots_mm.begin(), knots_mm.end());
  all.insert(all.end(), 2, knots_mm.back());
  std::vector<double> places;
  for (std::size_t i = 0; i + 2 < all.size(); ++i)
    places.push_back((all[i] + all[i + 1] + all[i + 2]) / 3.0);
  return places;
}

}  // namespace maquette::meshing
