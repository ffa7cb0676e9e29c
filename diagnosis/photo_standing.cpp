// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_standing.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "core/chi_squared.hpp"
#include "core/median.hpp"
#include "diagnosis/detail/ridge.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Nor is what moves it by less than this share of what the other causes move: by that their own
/// chain may be wrong. What the sensor does to numbers is simple.
constexpr double kFloorShare = 0.12, kFloorShareOfSensor = 0.01;
/// A map is a factor, wrong by what is finer than its waves alone; a sky, by how it is brighter
/// here than there. A vignetting of 0.16 at the corners beside both was an eleventh of what these
/// moved.
constexpr double kFloorShareOfMap = 0.03, kFloorShareOfSky = 0.06;
/// What leaves places where they are and as sharp as they are is wrong by what looks little like
/// places that have moved or spread: that shows at edges, a law of reflection on slopes. A corner 5
/// pixels off beside a matt surface taken for Lambert's was a twelfth of what that moved, a spread
/// of 1.4 pixels beside lamps 80 mm off a thirteenth.
constexpr double kFloorShareElsewhere = 0.03;
/// Light that bounced is sharp in creases, and is rendered on cells of a millimetre or two, where
/// another renderer has others: a spread of 0.7 pixels that was not there was an eighth of it.
constexpr double kFloorShareOfBounces = 0.16;
/// Penumbras whose widest is narrower are not told from shadows' steps between rays, pixels: most
/// shadows have a small part of that. Rough ground without a cause had 5, lamps of 140 mm 13.
constexpr double kPenumbra_px = 8.0;
/// Poses are not stated better than that, rms over the pictures that are elsewhere, pixels: where
/// each is known to a twentieth of a pixel in every direction one of four pictures showed places
/// 0.15 off, and four together 0.11.
constexpr double kPose_px = 0.25;
/// A size is named from that many of its standard errors on.
constexpr double kSure = 4.0;
/// What is not in a map's waves errs together in all of a place's pixels.
constexpr double kMapOver = 30.0;
/// Maps have that many parameters at least.
constexpr std::size_t kManyParameters = 12;
/// A map is confirmed in cells of the part's width over this that were seen so often under each of
/// two lamps.
constexpr std::size_t kMapCells = 48;
constexpr int kMapSeen = 2;

Eigen::VectorXd values_of(const PhotoMember& m) {
  return Eigen::Map<const Eigen::VectorXd>(m.values.data(),
                                           static_cast<Eigen::Index>(m.values.size()));
}
/// Values that a set alone asks for; a map's waves of which it says nothing are as likely as all
/// are large.
Eigen::VectorXd values_on(const PhotoFit& fit, const Eigen::MatrixXd& g, const PhotoLinear& linear,
                          const PhotoMembers& members, std::size_t k) {
  const auto others = columns_of(linear, members, k);
  const auto mine = linear.of(members[k].form);
  const Eigen::VectorXd rendered = values_of(members[k]);
  if (!is_map(members[k].form)) {
    Eigen::VectorXd step;
    static_cast<void>(gain_of(g, others, mine, 0, &step));
    return rendered + step;
  }
  Reduced own(g, mine, others);
  own.b += own.a * rendered;
  // Few waves that nothing tells may be huge: what most are like. One that all pictures together
  // tell is as large as it is: of a coat that thins out one way, few are large.
  std::vector<double> size;
  for (const double v : members[k].values) size.push_back(std::abs(v));
  const double typical = std::pow(kMadToSigma * median(std::move(size)), 2),
               unit = fit.noise.factor * kMapOver * fit.noise.over;
  const Eigen::MatrixXd all = Reduced(linear.sum(kAll), mine, others).a;
  const Eigen::VectorXd error =
      unit * ridge_solve(all, Eigen::MatrixXd::Identity(all.rows(), all.cols()), 1e-9).diagonal();
  for (Eigen::Index i = 0; i < rendered.size(); ++i)
    own.a(i, i) += unit / std::max({1e-12, typical, rendered(i) * rendered(i) - error(i)});
  return own.a.ldlt().solve(own.b);
}

/// Sums over the pictures under every other lamp (from every other place, where there is one lamp),
/// and over the rest, of places that both show in light: a map is known nowhere else.
std::array<Eigen::MatrixXd, 2> halves_of(const PhotoLinear& linear, const PhotoViews& views,
                                         double factor) {
  const PhotoScene& scene = views.scene();
  const auto& pixels = views.pixels();
  const auto half_of = [&](const MeasuredPixel& p) {
    return static_cast<std::size_t>(scene.lamps > 1 ? scene.lamp_of[p.photo] : p.photo) % 2;
  };
  const auto cell_of = [&](const MeasuredPixel& p) {
    const auto part = [](double at, double low, double high) {
      return std::clamp(static_cast<std::size_t>(kMapCells * (at - low) / (high - low)),
                        std::size_t{0}, kMapCells - 1);
    };
    return part(p.place.y, scene.box.min.y, scene.box.max.y) * kMapCells +
           part(p.place.x, scene.box.min.x, scene.box.max.x);
  };
  std::vector<std::array<int, 2>> seen(kMapCells * kMapCells, {0, 0});
  for (const MeasuredPixel& p : pixels)
    if (p.lamp.share > 0.5F) ++seen[cell_of(p)][half_of(p)];
  const Eigen::Index n = linear.columns.cols();
  std::array<Eigen::MatrixXd, 2> halves{Eigen::MatrixXd::Zero(n + 1, n + 1),
                                        Eigen::MatrixXd::Zero(n + 1, n + 1)};
  constexpr Eigen::Index kBlock = 4096;
  const std::size_t channels = views.channels();
  const float knee = 3.0F * static_cast<float>(std::sqrt(factor));
  for (std::size_t half = 0; half < 2; ++half) {
    Eigen::MatrixXf x(kBlock, n + 1);
    Eigen::Index filled = 0;
    const auto flush = [&] {
      halves[half] += (x.topRows(filled).transpose() * x.topRows(filled)).cast<double>();
      filled = 0;
    };
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      if (half_of(pixels[i]) != half || !(pixels[i].lamp.share > 0.5F)) continue;
      const auto& both = seen[cell_of(pixels[i])];
      if (std::min(both[0], both[1]) < kMapSeen) continue;
      for (std::size_t ch = 0; ch < channels; ++ch) {
        const auto row = static_cast<Eigen::Index>(i * channels + ch);
        x.row(filled).head(n) = linear.columns.row(row);
        x(filled, n) = std::clamp(linear.residual(row), -knee, knee);
        if (++filled == kBlock) flush();
      }
    }
    flush();
  }
  return halves;
}

/// What a member gains where it had no say, and what its values from elsewhere gain there, both in
/// units of their own noise.
struct Held {
  double gain = 0.0, predicted = 0.0;
};
/// Values of other blocks; a map's, of the same places under other lamps, the worse of both ways.
Held held_out(const PhotoFit& fit, const PhotoLinear& linear, const PhotoMembers& members,
              std::size_t k, double share) {
  const auto on = [&](const Eigen::MatrixXd& chosen, const Eigen::MatrixXd& other) {
    const Eigen::VectorXd values = values_on(fit, chosen, linear, members, k);
    return Held{share * worth_of(fit, other, linear, members, k),
                share * worth_of(fit, other, linear, members, k, &values)};
  };
  if (!is_map(members[k].form)) return on(linear.sum({kChoose}), linear.sum({kConfirm}));
  const auto halves = halves_of(linear, fit.views(), fit.noise.factor);
  const Held one = on(halves[0], halves[1]), other = on(halves[1], halves[0]);
  return one.predicted < other.predicted ? one : other;
}

/// Standard errors of its parameters beside all others.
std::vector<double> sigmas_of(const PhotoLinear& linear, const PhotoFit& fit,
                              const PhotoMembers& members, std::size_t k) {
  std::vector<int> columns = columns_of(linear, members, k);
  const auto mine = linear.of(members[k].form);
  columns.insert(columns.end(), mine.begin(), mine.end());
  const Eigen::MatrixXd g = linear.sum(kAll);
  const auto size = static_cast<Eigen::Index>(columns.size());
  const Eigen::MatrixXd inverse =
      ridge_solve(g(columns, columns), Eigen::MatrixXd::Identity(size, size), 1e-9);
  std::vector<double> sigmas;
  const auto first = static_cast<Eigen::Index>(columns.size() - mine.size());
  for (std::size_t i = 0; i < mine.size(); ++i) {
    const auto at = first + static_cast<Eigen::Index>(i);
    const double over = std::fmax(fit.noise.over, fit.over_of(linear, linear.residual, mine[i]));
    sigmas.push_back(std::sqrt(std::fmax(0.0, inverse(at, at)) * fit.noise.factor * over));
  }
  return sigmas;
}

/// Whether it shows places at other pixels, or spreads them.
bool shows_at_edges(const PhotoFit& fit, const PhotoMember& member) {
  const PhotoState with = fit.state_of({member}), none = fit.state_of({});
  return !same_places(with, none) || !same_sharpness(with, none);
}

/// How far off a member alone shows places that it moves, rms, pixels.
double displaced_px(const PhotoFit& fit, const PhotoMember& member) {
  const PhotoState with = fit.state_of({member}), none = fit.state_of({});
  double squares = 0.0, count = 0.0;
  for (const MeasuredPixel& p : fit.views().pixels()) {
    const auto to = displacement(p, 1, with, fit.views().scene()),
               was = displacement(p, 1, none, fit.views().scene());
    const double off2 = std::pow(to[0] - was[0], 2) + std::pow(to[1] - was[1], 2);
    if (!(off2 > 0.0)) continue;
    squares += off2;
    count += 1.0;
  }
  return std::sqrt(squares / std::fmax(1.0, count));
}

/// A size of its own that its standard error does not tell from none: what few pixels (edges of
/// shadows) err by together gains much, and says little.
bool is_unsure(const PhotoLinear& linear, const PhotoFit& fit, const PhotoMembers& members,
               std::size_t k) {
  return members[k].values.size() == 1 &&
         std::abs(members[k].values[0]) < kSure * sigmas_of(linear, fit, members, k)[0];
}

}  // namespace

bool is_map(const PhotoForm& form) {
  return form.parameters.size() >= kManyParameters && form.parameters.front().of_light;
}

std::vector<const PhotoParameter*> parameters_of(const PhotoMembers& members) {
  std::vector<const PhotoParameter*> all;
  for (const PhotoMember& m : members)
    for (const PhotoParameter& p : m.form.parameters) all.push_back(&p);
  return all;
}

bool is_large_enough(const PhotoFit& fit, const PhotoMember& m, double share) {
  if (!(m.form.least > 0.0)) return true;
  const PhotoState state = fit.state_of({m});
  if (!spreads_by_distance(state)) return std::abs(m.values[0]) >= share * m.form.least;
  constexpr double kWide = 0.9;  // of the pixels have less
  std::vector<double> spread;
  for (const MeasuredPixel& p : fit.views().pixels())
    spread.push_back(focus_px2(p.place, p.photo, state, fit.views().scene()));
  if (spread.empty()) return false;
  const auto at =
      spread.begin() + static_cast<std::ptrdiff_t>(kWide * static_cast<double>(spread.size() - 1));
  std::nth_element(spread.begin(), at, spread.end());
  return *at >= share * m.form.least;
}

std::vector<int> columns_of(const PhotoLinear& linear, const PhotoMembers& members,
                            std::size_t but) {
  std::vector<int> all;
  for (std::size_t k = 0; k < members.size(); ++k)
    if (k != but)
      for (const int c : linear.of(members[k].form))
        if (std::find(all.begin(), all.end(), c) == all.end()) all.push_back(c);
  return all;
}

PhotoMembers without(PhotoMembers members, std::size_t k) {
  members.erase(members.begin() + static_cast<std::ptrdiff_t>(k));
  return members;
}

double moved_by(const PhotoLinear& linear, const PhotoMember& member) {
  const auto at = linear.of(member.form);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < linear.residual.size(); ++i) {
    double d = 0.0;
    for (std::size_t k = 0; k < at.size(); ++k)
      d += static_cast<double>(linear.columns(i, at[k])) * member.values[k];
    sum += std::pow(d * static_cast<double>(linear.sigma(i)), 2);
  }
  return std::sqrt(sum / std::fmax(1.0, static_cast<double>(linear.residual.size())));
}

double own_share(const PhotoLinear& linear, const PhotoMembers& members, std::size_t k) {
  const Eigen::MatrixXd g = linear.sum(kAll);
  const auto mine = linear.of(members[k].form);
  const Eigen::VectorXd v = values_of(members[k]);
  const double all = v.dot(g(mine, mine) * v);
  if (!(all > 0.0)) return 1.0;
  const double own = v.dot(Reduced(g, mine, columns_of(linear, members, k)).a * v);
  return std::sqrt(std::clamp(own / all, 0.0, 1.0));
}

double others_wrong(const PhotoFit& fit, const PhotoLinear& linear, const PhotoMembers& members,
                    std::size_t but) {
  const bool at_edges = shows_at_edges(fit, members[but]);
  const auto share = [&](const PhotoMember& m) {
    if (m.effect->acts_on == "sensor") return kFloorShareOfSensor;
    if (at_edges && !shows_at_edges(fit, m))
      return m.effect->name == "surface.interreflection" ? kFloorShareOfBounces
                                                         : kFloorShareElsewhere;
    if (is_map(m.form)) return kFloorShareOfMap;
    return m.effect->name == "lamp.ambient" ? kFloorShareOfSky : kFloorShare;
  };
  double sum = 0.0;
  for (std::size_t k = 0; k < members.size(); ++k)
    if (k != but) sum = std::hypot(sum, share(members[k]) * moved_by(linear, members[k]));
  return sum;
}

double worth_of(const PhotoFit& fit, const Eigen::MatrixXd& g, const PhotoLinear& linear,
                const PhotoMembers& members, std::size_t k, const Eigen::VectorXd* held) {
  const auto others = columns_of(linear, members, k);
  const auto mine = linear.of(members[k].form);
  Eigen::VectorXd step;
  static_cast<void>(gain_of(g, others, mine, 0, &step));
  const Eigen::VectorXd best = values_of(members[k]) + step;
  const Eigen::MatrixXd a = Reduced(g, mine, others).a;
  const double unit = fit.noise.factor * fit.noise.over;
  const double all = best.dot(a * best) / unit;
  if (held == nullptr) return all;
  const Eigen::VectorXd off = best - *held;
  return all - off.dot(a * off) / unit;
}

std::vector<Estimate> sizes_of(const PhotoLinear& linear, const PhotoFit& fit,
                               const PhotoMembers& members, std::size_t k) {
  const auto sigmas = sigmas_of(linear, fit, members, k);
  std::vector<Estimate> out;
  for (std::size_t i = 0; i < sigmas.size(); ++i) {
    const PhotoParameter& p = members[k].form.parameters[i];
    const double sigma = sigmas[i], value = members[k].values[i];
    const auto shown = [&](double v) { return p.shown ? p.shown(v) : v; };
    out.push_back({p.name, shown(value),
                   p.shown ? 0.5 * std::abs(shown(value + sigma) - shown(value - sigma)) : sigma});
  }
  return out;
}

PhotoMembers confirmed(PhotoMembers members, PhotoFit& fit, double light,
                       std::vector<double>& p_values, std::vector<Rejected>& rejected) {
  while (!members.empty()) {
    const PhotoLinear linear = fit.about(members, parameters_of(members));
    p_values.clear();
    std::size_t worst = members.size();
    double least = INFINITY;
    std::string why;
    std::size_t small_pose = members.size();
    bool goes_unnamed = false;
    for (std::size_t k = 0; k < members.size(); ++k) {
      double over = fit.noise.over;
      for (const int c : linear.of(members[k].form))
        over = std::fmax(over,
                         std::fmin(50.0 * fit.noise.over, fit.over_of(linear, linear.residual, c)));
      const double share = fit.noise.over / over;
      const auto [gain, predicted] = held_out(fit, linear, members, k, share);
      double p = chi_squared_tail(gain, static_cast<int>(members[k].form.parameters.size()));
      if (!(predicted > 0.5 * gain)) p = std::fmax(p, 0.5);
      p_values.push_back(std::fmax(p, 1e-300));
      const double floor = std::fmax(kPhotoFloor * light, others_wrong(fit, linear, members, k));
      const double own = moved_by(linear, members[k]) * own_share(linear, members, k);
      if (members[k].effect->name == "photo.pose" && displaced_px(fit, members[k]) < kPose_px)
        small_pose = k;
      const bool small = !(own > floor) || !is_large_enough(fit, members[k], 1.0) ||
                         (members[k].effect->name == "lamp.size" &&
                          fit.views().penumbra_px(fit.views().scene().photos[0].lamp_diameter_mm +
                                                  members[k].values[0]) < kPenumbra_px) ||
                         small_pose == k;
      const bool unsure = is_unsure(linear, fit, members, k);
      if (p < kClaimLevel && !small && !unsure) continue;
      if (!(gain < least)) continue;
      least = gain;
      worst = k;
      // What the others could take most of is theirs: a focal length beside poses of its own size.
      constexpr double kOfItsOwn = 0.5;
      goes_unnamed = small && small_pose != k && p < kClaimLevel && !unsure &&
                     own > kOfItsOwn * moved_by(linear, members[k]);
      why = !small && unsure ? "its size is not told from none: less than four standard errors"
            : small
                ? fmt::format(
                      "moves the picture by {:.4f} / 255 rms that no other does: no more than the "
                      "rendering may be wrong by",
                      255.0 * own)
                : fmt::format(
                      "{} gains {:.1f} with {} parameters, {:.1f} as it was fitted on the first",
                      is_map(members[k].form) ? "chosen under one lamp; under the next it"
                                              : "chosen on one third of the blocks; on the next it",
                      gain, members[k].form.parameters.size(), predicted);
    }
    if (worst == members.size()) break;
    rejected.push_back({members[worst].effect->name, why});
    if (goes_unnamed) fit.known.push_back(members[worst]);
    // A pose that is too small goes in any case: without a distortion it grows to what it is not.
    if (small_pose < members.size() && small_pose != worst) {
      rejected.push_back({members[small_pose].effect->name, "less than poses are stated to"});
      members.erase(members.begin() + static_cast<std::ptrdiff_t>(small_pose));
      if (small_pose < worst) --worst;
    }
    members = fit.fitted(without(std::move(members), worst));
  }
  return members;
}

}  // namespace maquette::diagnosis::detail
