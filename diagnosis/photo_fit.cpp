// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_fit.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <oneapi/tbb/parallel_for.h>

#include "core/median.hpp"
#include "diagnosis/detail/cut_off.hpp"
#include "diagnosis/detail/ridge.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// A rendered edge may be off by that, pixels: relief between its nodes.
constexpr double kEdge_px = 0.1;
/// Rendered light may be off by that: interpolated slopes, samples of a penumbra.
constexpr double kLight = 0.002;
constexpr double kHuber = 3.0;  // of the noise as found
constexpr float kLargest = 1e4F;
constexpr double kLargeGain = 20.0;   // of a step, in -2 log likelihood
constexpr double kLightStep = 0.005;  // relative, of its derivative
constexpr int kSettleSteps = 2;       // for each kind of slopes between nodes

}  // namespace

PhotoState PhotoFit::state_of(const PhotoMembers& members) const {
  const PhotoScene& scene = views_.scene();
  PhotoState s;
  s.lamp_mm.resize(scene.lamps);
  s.lamp_refocused_mm.resize(scene.lamps);
  s.picture.resize(scene.photos.size());
  for (const PhotoMembers* all : {&known, &members})
    for (const PhotoMember& m : *all)
      for (std::size_t k = 0; k < m.values.size(); ++k) m.form.parameters[k].add(s, m.values[k]);
  return s;
}

std::vector<int> PhotoLinear::of(const PhotoForm& form) const {
  std::vector<int> at;
  for (const PhotoParameter& p : form.parameters) at.push_back(static_cast<int>(index.at(p.key)));
  return at;
}

Eigen::MatrixXd PhotoLinear::sum(const std::vector<int>& sets) const {
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(gram[0].rows(), gram[0].cols());
  for (const int s : sets) all += gram[static_cast<std::size_t>(s)];
  return all;
}

void PhotoFit::look_at(const std::vector<int>& sets) {
  if (sets.empty()) return views_.look_at({});
  views_.look_at([&](const Vec3& place) {
    return std::find(sets.begin(), sets.end(), layout_.set_of(place.x, place.y)) != sets.end();
  });
}

PhotoLinear PhotoFit::about(const PhotoMembers& model,
                            const std::vector<const PhotoParameter*>& parameters, bool whole) {
  const PhotoState wanted = state_of(model);
  const bool sizes =
      std::any_of(parameters.begin(), parameters.end(), [&](const PhotoParameter* p) {
        PhotoState changed = wanted;
        p->add(changed, 1.0);
        return changed.lamp_diameter_mm != wanted.lamp_diameter_mm;
      });
  views_.render(wanted, normals, !parameters.empty() && whole, sizes);
  const PhotoScene& scene = views_.scene();
  const PhotoState& state = views_.state();
  PhotoLinear out;
  std::vector<const PhotoParameter*> each;
  for (const PhotoParameter* p : parameters)
    if (out.index.emplace(p->key, static_cast<Eigen::Index>(each.size())).second) each.push_back(p);
  struct Step {
    PhotoState low, high;
    double span;
    bool light;  // it changes what comes to the lens
    const PhotoParameter* of;
  };
  std::vector<Step> steps;
  steps.reserve(each.size());  // chains keep references
  std::vector<std::array<PhotoChain, 2>> chains;
  const PhotoChain chain(state, state, scene);
  for (const PhotoParameter* p : each) {
    const auto [low, high] = p->between(state, scene);
    Step s{state, state, high - low, true, p};
    p->add(s.low, low);
    p->add(s.high, high);
    s.light = !same_light(s.low, s.high);
    steps.push_back(std::move(s));
    chains.push_back(
        {PhotoChain(steps.back().low, state, scene), PhotoChain(steps.back().high, state, scene)});
  }
  const bool maps = std::any_of(each.begin(), each.end(), [](const PhotoParameter* p) {
    return static_cast<bool>(p->of_light);
  });
  const auto& pixels = views_.pixels();
  const std::size_t channels = views_.channels();
  const auto rows = static_cast<Eigen::Index>(pixels.size() * channels),
             cols = static_cast<Eigen::Index>(each.size());
  out.columns.resize(rows, cols);
  out.residual.resize(rows);
  out.sigma.resize(rows);
  out.set.resize(static_cast<std::size_t>(rows));
  out.cell.resize(static_cast<std::size_t>(rows));
  oneapi::tbb::parallel_for(std::size_t{0}, pixels.size(), [&](std::size_t i) {
    const MeasuredPixel& p = pixels[i];
    const int set = layout_.set_of(p.place.x, p.place.y);
    const auto cell = static_cast<std::uint32_t>(
        std::clamp<std::ptrdiff_t>(
            static_cast<std::ptrdiff_t>((p.place.y - layout_.y0) / layout_.cell_mm), 0,
            layout_.rows - 1) *
            layout_.cols +
        std::clamp<std::ptrdiff_t>(
            static_cast<std::ptrdiff_t>((p.place.x - layout_.x0) / layout_.cell_mm), 0,
            layout_.cols - 1));
    std::vector<std::array<double, 2>> light(steps.size(), {p.light, p.light});
    std::vector<double> by_map(maps ? steps.size() : 0, 0.0);
    for (std::size_t k = 0; k < steps.size(); ++k) {
      const Step& s = steps[k];
      if (s.of->photo && *s.of->photo != p.photo) continue;
      if (s.of->of_light)
        by_map[k] = s.of->of_light(p.place, scene);
      else if (s.light)
        light[k] = {chains[k][0].radiance(p), chains[k][1].radiance(p)};
    }
    PhotoPixel q = p;
    for (std::size_t ch = 0; ch < channels; ++ch) {
      const int channel = channel_of(ch, channels);
      q.value[static_cast<std::size_t>(channel)] = p.value[ch];
      q.mean[static_cast<std::size_t>(channel)] = p.mean[ch];
      q.around[static_cast<std::size_t>(channel)] = p.around[ch];
      const auto row = static_cast<Eigen::Index>(i * channels + ch);
      const auto cut_sigma = static_cast<double>(p.cut_sigma[ch]);
      const auto [y, share] = cut_off(chain.value(q, channel, p.light), cut_sigma);
      const double slope =
          std::hypot(static_cast<double>(p.du), static_cast<double>(p.dv)) +
          0.3 * (std::abs(static_cast<double>(p.duu)) + std::abs(static_cast<double>(p.dvv)));
      const double sigma = std::sqrt(static_cast<double>(p.variance_around[ch]) +
                                     std::pow(kEdge_px * slope, 2) + std::pow(kLight * y, 2));
      out.sigma(row) = static_cast<float>(sigma);
      out.residual(row) =
          std::clamp(static_cast<float>((static_cast<double>(p.measured[ch]) - y) / sigma),
                     -kLargest, kLargest);
      // A map's waves are factors on all of the light; its own sum is close to 1.
      const double by_light = !maps ? 0.0
                                    : (chain.value(q, channel, (1.0 + kLightStep) * p.light) -
                                       chain.value(q, channel, (1.0 - kLightStep) * p.light)) /
                                          (2.0 * kLightStep * sigma) * share;
      for (Eigen::Index k = 0; k < cols; ++k) {
        const auto at = static_cast<std::size_t>(k);
        const Step& s = steps[at];
        if (s.of->photo && *s.of->photo != p.photo) {
          out.columns(row, k) = 0.0F;
          continue;
        }
        const double d = s.of->of_light ? by_light * by_map[at]
                                        : (chains[at][1].value(q, channel, light[at][1]) -
                                           chains[at][0].value(q, channel, light[at][0])) /
                                              (s.span * sigma) * share;
        out.columns(row, k) = std::isfinite(d) ? static_cast<float>(d) : 0.0F;
      }
      out.set[static_cast<std::size_t>(row)] = set;
      out.cell[static_cast<std::size_t>(row)] = cell;
    }
  });
  // Huber's weights at the spread of this residual: before a large cause is known all of it counts.
  std::vector<double> size;
  for (Eigen::Index i = 0; i < rows; i += 7)
    size.push_back(std::abs(static_cast<double>(out.residual(i))));
  const double spread = std::fmax(std::sqrt(noise.factor),
                                  size.empty() ? 1.0 : kMadToSigma * median(std::move(size)));
  for (auto& g : out.gram) g = Eigen::MatrixXd::Zero(cols + 1, cols + 1);
  // Rows of one picture have nothing in columns of another.
  struct Block {
    std::size_t photo;
    int set;
    std::vector<Eigen::Index> rows;
  };
  constexpr std::size_t kBlock = 4096;
  std::vector<Block> blocks;
  std::map<std::pair<std::size_t, int>, std::size_t> open;
  for (Eigen::Index i = 0; i < rows; ++i) {
    const int set = out.set[static_cast<std::size_t>(i)];
    if (set < 0) continue;
    const std::size_t photo = pixels[static_cast<std::size_t>(i) / channels].photo;
    const auto [at, fresh] = open.try_emplace({photo, set}, blocks.size());
    if (!fresh && blocks[at->second].rows.size() == kBlock) at->second = blocks.size();
    if (at->second == blocks.size()) blocks.push_back({photo, set, {}});
    blocks[at->second].rows.push_back(i);
  }
  std::vector<std::vector<Eigen::Index>> active(scene.photos.size());
  for (std::size_t photo = 0; photo < active.size(); ++photo)
    for (Eigen::Index k = 0; k < cols; ++k)
      if (const auto& of = each[static_cast<std::size_t>(k)]->photo; !of || *of == photo)
        active[photo].push_back(k);
  // Sums in an order that threads do not change.
  std::vector<Eigen::MatrixXf> sums(blocks.size());
  oneapi::tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) {
    const Block& block = blocks[b];
    const auto& mine = active[block.photo];
    const auto count = static_cast<Eigen::Index>(block.rows.size()),
               n = static_cast<Eigen::Index>(mine.size());
    Eigen::MatrixXf x(count, n + 1);
    Eigen::VectorXf w(count);
    for (Eigen::Index i = 0; i < count; ++i) {
      const float r = out.residual(block.rows[static_cast<std::size_t>(i)]);
      const double large = std::abs(static_cast<double>(r)) / (kHuber * spread);
      w(i) = static_cast<float>(large > 1.0 ? std::sqrt(1.0 / large) : 1.0);
      x(i, n) = w(i) * r;
    }
    for (Eigen::Index k = 0; k < n; ++k)
      for (Eigen::Index i = 0; i < count; ++i)
        x(i, k) = w(i) * out.columns(block.rows[static_cast<std::size_t>(i)],
                                     mine[static_cast<std::size_t>(k)]);
    sums[b].setZero(n + 1, n + 1);
    sums[b].selfadjointView<Eigen::Lower>().rankUpdate(x.transpose());
  });
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    Eigen::MatrixXd& sum = out.gram[static_cast<std::size_t>(blocks[b].set)];
    std::vector<Eigen::Index> to = active[blocks[b].photo];
    to.push_back(cols);
    const auto n = static_cast<Eigen::Index>(to.size());
    for (Eigen::Index k = 0; k < n; ++k)
      for (Eigen::Index i = k; i < n; ++i)
        sum(to[static_cast<std::size_t>(i)], to[static_cast<std::size_t>(k)]) +=
            static_cast<double>(sums[b](i, k));
  }
  for (auto& g : out.gram) g.triangularView<Eigen::StrictlyUpper>() = g.transpose();
  return out;
}

namespace {

/// A step of Gauss and Newton that leaves values of one sign at zero at most. What would go beyond
/// is held there and the others solved anew: beside a black level of 0.02 one of two lobes went
/// from 0.013 below zero, and the rest of its step, taken for both, left four times as much.
Eigen::VectorXd bounded_step(const Eigen::MatrixXd& g, const PhotoLinear& linear,
                             const PhotoMembers& model) {
  const Eigen::Index n = g.rows() - 1;
  Eigen::VectorXd step = Eigen::VectorXd::Zero(n);
  std::vector<char> held(static_cast<std::size_t>(n), 0);
  for (bool more = true; more;) {
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < n; ++i)
      if (held[static_cast<std::size_t>(i)] == 0) free.push_back(i);
    if (free.empty()) break;
    Eigen::VectorXd b = g.col(n).head(n);
    for (Eigen::Index i = 0; i < n; ++i)
      if (held[static_cast<std::size_t>(i)] != 0) b -= step(i) * g.col(i).head(n);
    const Eigen::VectorXd of_free = ridge_solve(g(free, free), b(free), 1e-7);
    step(free) = of_free;
    more = false;
    for (const PhotoMember& m : model)
      for (std::size_t k = 0; k < m.values.size(); ++k) {
        const auto at = linear.index.at(m.form.parameters[k].key);
        if (held[static_cast<std::size_t>(at)] != 0 || (k != 0 && !m.form.all_of_sign) ||
            !((m.values[k] + step(at)) * m.form.sign < 0.0))
          continue;
        step(at) = -m.values[k];
        held[static_cast<std::size_t>(at)] = 1;
        more = true;
      }
  }
  return step;
}

}  // namespace

PhotoMembers PhotoFit::fitted(PhotoMembers model, int rounds) {
  std::vector<const PhotoParameter*> parameters;
  for (const PhotoMember& m : model)
    for (const PhotoParameter& p : m.form.parameters) parameters.push_back(&p);
  if (parameters.empty()) return model;
  PhotoMembers best = model;
  double least = INFINITY, gain = 0.0;
  for (int round = 0; round <= rounds; ++round) {
    const PhotoLinear linear = about(model, parameters, false);
    const double now = objective(linear, kAll);
    if (now < least) {
      best = model;
      least = now;
    } else if (round > 0) {
      // The last step did not help. One that should have helped much went too far.
      if (!(gain > kLargeGain) || round == rounds) break;
      for (std::size_t m = 0; m < model.size(); ++m)
        for (std::size_t k = 0; k < model[m].values.size(); ++k)
          model[m].values[k] = std::midpoint(model[m].values[k], best[m].values[k]);
      gain *= 0.5;
      continue;
    }
    if (round == rounds) break;
    const Eigen::MatrixXd g = linear.sum(kAll);
    const Eigen::Index n = g.rows() - 1;
    const Eigen::VectorXd step = bounded_step(g, linear, model);
    gain = step.dot(2.0 * g.col(n).head(n) - g.topLeftCorner(n, n) * step) /
           (noise.factor * noise.over);
    if (gain < 0.0) return best;  // held at bounds, the step leads nowhere
    for (PhotoMember& m : model)
      for (std::size_t k = 0; k < m.values.size(); ++k)
        m.values[k] += step(linear.index.at(m.form.parameters[k].key));
    if (gain < 0.5) return model;  // so small a step is as good as its prediction
  }
  return best;
}

PhotoMembers PhotoFit::settle_normals(const PhotoMembers& model, bool of_its_kind) {
  struct Tried {
    Normals normals;
    PhotoMembers model;
    double rough, left;
  };
  std::vector<Tried> all;
  const auto is_smooth = [](Normals n) { return n == Normals::smooth || n == Normals::smoother; };
  const bool now_smooth = is_smooth(normals);
  for (const Normals each :
       {Normals::smooth, Normals::smoother, Normals::patches, Normals::facets}) {
    if (of_its_kind && is_smooth(each) != now_smooth) continue;
    normals = each;
    // What is between nodes makes up for a blur, and a blur for it: each has its own.
    PhotoMembers own = fitted(model, kSettleSteps);
    const PhotoLinear linear = about(own, {});
    std::vector<double> left;
    for (Eigen::Index i = 0; i < linear.residual.size(); ++i)
      left.push_back(std::abs(static_cast<double>(linear.residual(i))));
    all.push_back({each, std::move(own), views_.roughness(), median(std::move(left))});
  }
  const auto smoothest = std::min_element(
      all.begin(), all.end(), [](const Tried& a, const Tried& b) { return a.rough < b.rough; });
  // Under a blur or much noise differences say little: of those that they do not tell apart the
  // one that leaves least at most pixels; what is left at shadows' edges is much, and not of
  // slopes. Standard error of a robust spread: 1.17 over the root of the count.
  const double close =
      smoothest->rough *
      (1.0 + 2.0 * 1.17 / std::sqrt(std::fmax(1.0, static_cast<double>(views_.pixels().size()))));
  const auto best = std::min_element(all.begin(), all.end(), [&](const Tried& a, const Tried& b) {
    return std::pair{a.rough > close, a.left} < std::pair{b.rough > close, b.left};
  });
  normals = best->normals;
  return std::move(best->model);
}

double PhotoFit::objective(const PhotoLinear& linear, const std::vector<int>& sets) const {
  const double s = std::sqrt(noise.factor), knee = kHuber * s;
  double sum = 0.0;
  for (Eigen::Index i = 0; i < linear.residual.size(); ++i) {
    if (std::find(sets.begin(), sets.end(), linear.set[static_cast<std::size_t>(i)]) == sets.end())
      continue;
    const double r = std::abs(static_cast<double>(linear.residual(i)));
    sum += r <= knee ? r * r : knee * (2.0 * r - knee);
  }
  return sum / (noise.factor * noise.over);
}

double PhotoFit::objective(const PhotoMembers& model, const std::vector<int>& sets) {
  return objective(about(model, {}), sets);
}

double PhotoFit::over_of(const PhotoLinear& linear, const Eigen::VectorXf& residual,
                         Eigen::Index column) const {
  const auto cells = static_cast<std::size_t>(layout_.rows * layout_.cols);
  std::vector<double> sum(cells, 0.0);
  double alone = 0.0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    if (linear.set[static_cast<std::size_t>(i)] < 0) continue;
    const double score =
        static_cast<double>(linear.columns(i, column)) *
        std::clamp(static_cast<double>(residual(i)), -kHuber * std::sqrt(noise.factor),
                   kHuber * std::sqrt(noise.factor));
    sum[linear.cell[static_cast<std::size_t>(i)]] += score;
    alone += score * score;
  }
  double together = 0.0, within = 0.0;
  for (std::ptrdiff_t r = 0; r < layout_.rows; ++r)
    for (std::ptrdiff_t c = 0; c < layout_.cols; ++c) {
      const double here = sum[static_cast<std::size_t>(r * layout_.cols + c)];
      within += here * here;
      for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - 1);
           i <= std::min(layout_.rows - 1, r + 1); ++i)
        for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, c - 1);
             k <= std::min(layout_.cols - 1, c + 1); ++k)
          together += here * sum[static_cast<std::size_t>(i * layout_.cols + k)];
    }
  return alone > 0.0 ? std::fmax(1.0, std::fmax(within, together) / alone) : 1.0;
}

PhotoNoise PhotoFit::noise_of(const PhotoLinear& linear) const {
  const Eigen::MatrixXd g = linear.sum(kAll);
  const Eigen::Index n = g.rows() - 1;
  Eigen::VectorXf left = linear.residual;
  if (n > 0) {
    const Eigen::VectorXd x = ridge_solve(g.topLeftCorner(n, n), g.col(n).head(n), 1e-5);
    left -= linear.columns * x.cast<float>();
  }
  PhotoNoise out;
  std::vector<double> size;
  for (Eigen::Index i = 0; i < left.size(); ++i)
    size.push_back(std::abs(static_cast<double>(left(i))));
  out.factor = std::pow(kMadToSigma * median(std::move(size)), 2);
  PhotoFit with = *this;
  with.noise = out;
  std::vector<double> over(static_cast<std::size_t>(n));
  oneapi::tbb::parallel_for(Eigen::Index{0}, n, [&](Eigen::Index k) {
    over[static_cast<std::size_t>(k)] = with.over_of(linear, left, k);
  });
  out.over = over.empty() ? 1.0 : std::fmax(1.0, median(std::move(over)));
  return out;
}

double gain_of(const Eigen::MatrixXd& g, const std::vector<int>& model,
               const std::vector<int>& form, int sign, Eigen::VectorXd* values) {
  const Reduced own(g, form, model);
  // What the model has already is worth nothing.
  const Eigen::VectorXd x = ridge_solve(own.a, own.b, 1e-6, g.diagonal()(form));
  if (values != nullptr) *values = x;
  if (sign != 0 && x(0) * sign < 0.0) return 0.0;
  return x.dot(own.b);
}

double PhotoScatter::off() const {
  return std::max({std::abs(factor - 1.0) - 4.0 * sigma,
                   std::abs(dark - 1.0) - 4.0 * sigma_of_third,
                   std::abs(light - 1.0) - 4.0 * sigma_of_third});
}

PhotoScatter scatter_of(const PhotoViews& views) {
  // Differences to the next pixel: what the simulation gets wrong is nearly alike in both.
  std::vector<std::pair<double, double>> by_sigma;
  std::vector<double> own;
  const std::size_t channels = views.channels();
  // A file of numbers from 0 up cuts off half of the noise in the dark, and what a tone curve does
  // to numbers below 0 nobody knows.
  constexpr double kCutOff = 3.5;  // standard deviations
  std::vector<char> from_zero(views.scene().photos.size(), 1);
  if (views.state().gamma == 0.0)
    for (const MeasuredPixel& p : views.pixels())
      for (std::size_t ch = 0; ch < channels; ++ch)
        if (p.measured[ch] < 0.0F) from_zero[p.photo] = 0;
  for (const MeasuredPixel& p : views.pixels()) {
    const double slope = std::abs(static_cast<double>(p.du)) + std::abs(static_cast<double>(p.dv)) +
                         std::abs(static_cast<double>(p.duu)) +
                         std::abs(static_cast<double>(p.dvv));
    for (std::size_t ch = 0; ch < channels; ++ch) {
      const auto sigma = std::sqrt(static_cast<double>(p.variance[ch]));
      if (0.1 * slope > 0.3 * sigma) continue;
      const double here = views.number_of(p, ch, p.value[ch]),
                   next = views.number_of(p, ch, p.value_next[ch]);
      if (from_zero[p.photo] != 0 &&
          std::fmin(here, next) < kCutOff * std::fmax(sigma, static_cast<double>(p.cut_sigma[ch])))
        continue;
      const double difference =
          (static_cast<double>(p.next[ch]) - next) - (static_cast<double>(p.measured[ch]) - here);
      by_sigma.emplace_back(sigma, std::abs(difference) / (std::sqrt(2.0) * sigma));
      own.push_back(std::abs(static_cast<double>(p.measured[ch]) - here) / sigma);
    }
  }
  PhotoScatter s;
  if (by_sigma.size() < 1500) return s;
  // By sigma alone: in the dark all have one, and shall not come by how far they are off.
  std::stable_sort(by_sigma.begin(), by_sigma.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  const auto of = [&](std::size_t from, std::size_t to) {
    std::vector<double> ratio;
    for (std::size_t i = from; i < to; ++i) ratio.push_back(by_sigma[i].second);
    return kMadToSigma * median(std::move(ratio));
  };
  const std::size_t n = by_sigma.size();
  // The median's efficiency is 0.37 of a standard deviation's.
  s.sigma = 1.17 / std::sqrt(static_cast<double>(n));
  s.sigma_of_third = std::sqrt(3.0) * s.sigma;
  s.factor = of(0, n);
  s.own = kMadToSigma * median(std::move(own));
  s.dark = of(0, n / 3);
  s.light = of(n - n / 3, n);
  return s;
}

}  // namespace maquette::diagnosis::detail
