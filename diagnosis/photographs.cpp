// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/photographs.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>

#include <fmt/format.h>

#include "camera/srgb.hpp"
#include "core/chi_squared.hpp"
#include "core/median.hpp"
#include "core/random.hpp"
#include "core/run_part.hpp"
#include "diagnosis/controls.hpp"
#include "diagnosis/detail/model_search.hpp"
#include "diagnosis/detail/photo_fit.hpp"
#include "diagnosis/detail/photo_remainder.hpp"
#include "diagnosis/detail/ridge.hpp"
#include "diagnosis/path_contact.hpp"
#include "diagnosis/surface.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::diagnosis {
namespace {

using detail::kAll;
using detail::kChoose;
using detail::kConfirm;
using detail::kReport;
using detail::PhotoFit;
using detail::PhotoLinear;
using detail::PhotoMember;
using detail::PhotoMembers;

constexpr std::size_t kLeastPixels = 3000;
constexpr std::size_t kMostCauses = 4, kRounds = 7;
/// Steps of Gauss and Newton in a trial.
constexpr int kTrialSteps = 3;
/// Candidates that are rendered: the best to first order.
constexpr std::size_t kRendered = 4;
/// And no farther from the best than that.
constexpr double kNear = 0.5;
/// Models whose scores differ by less than that of what the best one gains are close.
constexpr double kCloseScore = 0.05;
/// What moves the picture less, rms of full scale over its mean, is not told from what the
/// rendering itself may be wrong by.
constexpr double kFloor = 1e-3;
/// And as a share of what the other causes move: by that their own chain may be wrong. What the
/// sensor does to numbers is simple.
constexpr double kFloorShare = 0.12, kFloorShareOfSensor = 0.01;
/// What is smooth over the part and larger than that, of the pictures' mean, is no noise.
constexpr double kSmooth = 3e-3;
/// Penumbras narrower than that are not told from shadows' steps between rays, pixels.
constexpr double kPenumbra_px = 1.5;
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
/// The scatter of pixels must be off by this factor to be called a cause: full well and read noise
/// are known to a few per cent.
constexpr double kScatterOff = 0.1;
/// By more where what is left, rms, is larger than that scatter by the second.
constexpr double kScatterOffBesideMore = 0.3, kNoiseAlone = 1.8;

struct Candidate {
  const Effect* effect;
  std::vector<PhotoForm> forms;
};

struct Trial {
  std::size_t candidate, form;
  double score;  ///< in -2 log likelihood less the price, to first order
  double gain;
  std::vector<double> values;
};

double price_of(const PhotoForm& form) {
  return detail::kPricePerCause +
         detail::kPricePerColumn * static_cast<double>(form.parameters.size());
}
double price_of(const PhotoMembers& members) {
  double sum = 0.0;
  for (const PhotoMember& m : members) sum += price_of(m.form);
  return sum;
}
std::vector<int> columns_of(const PhotoLinear& linear, const PhotoMembers& members,
                            std::size_t but = SIZE_MAX) {
  std::vector<int> all;
  for (std::size_t k = 0; k < members.size(); ++k)
    if (k != but)
      for (const int c : linear.of(members[k].form))
        if (std::find(all.begin(), all.end(), c) == all.end()) all.push_back(c);
  return all;
}
Eigen::VectorXd values_of(const PhotoMember& m) {
  return Eigen::Map<const Eigen::VectorXd>(m.values.data(),
                                           static_cast<Eigen::Index>(m.values.size()));
}
/// Has a form all parameters of another?
bool has_all(const PhotoForm& form, const PhotoForm& other) {
  return std::all_of(other.parameters.begin(), other.parameters.end(), [&](const auto& p) {
    return std::any_of(form.parameters.begin(), form.parameters.end(),
                       [&](const PhotoParameter& q) { return q.key == p.key; });
  });
}
/// Of places on the part: a form with that many parameters, all of them factors on its light.
bool is_map(const PhotoForm& form) {
  return form.parameters.size() >= kManyParameters && form.parameters.front().of_light;
}
PhotoMembers without(PhotoMembers members, std::size_t k) {
  members.erase(members.begin() + static_cast<std::ptrdiff_t>(k));
  return members;
}

/// rms of what a member moves, of full scale.
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

/// Share of what a member moves (its rms) that the others could not move in its place.
double own_share(const PhotoLinear& linear, const PhotoMembers& members, std::size_t k) {
  const Eigen::MatrixXd g = linear.sum(kAll);
  const auto mine = linear.of(members[k].form);
  const Eigen::VectorXd v = values_of(members[k]);
  const double all = v.dot(g(mine, mine) * v);
  if (!(all > 0.0)) return 1.0;
  const double own = v.dot(detail::Reduced(g, mine, columns_of(linear, members, k)).a * v);
  return std::sqrt(std::clamp(own / all, 0.0, 1.0));
}

/// By how much what the others move, rms, may be wrong.
double others_wrong(const PhotoLinear& linear, const PhotoMembers& members, std::size_t but) {
  double sum = 0.0;
  for (std::size_t k = 0; k < members.size(); ++k)
    if (k != but)
      sum = std::hypot(
          sum, (members[k].effect->acts_on == "sensor" ? kFloorShareOfSensor : kFloorShare) *
                   moved_by(linear, members[k]));
  return sum;
}

/// Search over the library for one case.
class Search {
 public:
  /// @param light  mean value of the pictures
  Search(PhotoFit& fit, std::vector<Candidate> candidates, double light)
      : fit_(fit), candidates_(std::move(candidates)), light_(light) {
    for (const Candidate& c : candidates_)
      for (const PhotoForm& f : c.forms)
        for (const PhotoParameter& p : f.parameters) parameters_.push_back(&p);
  }
  [[nodiscard]] const std::vector<const PhotoParameter*>& parameters() const { return parameters_; }

  /// What each form would gain beside a model, best first; of a cause that the model has, what a
  /// form with more parameters would gain in its place.
  [[nodiscard]] std::vector<Trial> trials(const PhotoLinear& linear, const PhotoMembers& members,
                                          const std::vector<int>& sets) const {
    const Eigen::MatrixXd g = linear.sum(sets);
    const auto model = columns_of(linear, members);
    const double unit = fit_.noise.factor * fit_.noise.over;
    std::vector<Trial> all;
    for (std::size_t c = 0; c < candidates_.size(); ++c) {
      const auto mine = std::find_if(members.begin(), members.end(), [&](const PhotoMember& m) {
        return m.effect == candidates_[c].effect;
      });
      std::vector<Trial> best;
      for (std::size_t f = 0; f < candidates_[c].forms.size(); ++f) {
        const PhotoForm& form = candidates_[c].forms[f];
        std::vector<int> at = linear.of(form);
        double less = 0.0;
        if (mine != members.end()) {
          if (form.parameters.size() <= mine->form.parameters.size()) continue;
          const auto has = linear.of(mine->form);
          if (!std::all_of(has.begin(), has.end(),
                           [&](int k) { return std::find(at.begin(), at.end(), k) != at.end(); }))
            continue;
          std::erase_if(
              at, [&](int k) { return std::find(model.begin(), model.end(), k) != model.end(); });
          less = price_of(mine->form);
        }
        Eigen::VectorXd values;
        const double gain = detail::gain_of(g, model, at, form.sign, &values) / unit;
        Trial t{c, f, gain - price_of(form) + less, gain, {}};
        if (mine == members.end()) t.values.assign(values.data(), values.data() + values.size());
        best.push_back(std::move(t));
      }
      std::sort(best.begin(), best.end(),
                [](const Trial& a, const Trial& b) { return a.score > b.score; });
      // The two best; of forms one of which has all that another has, one: else the same would be
      // rendered twice, and another law not at all.
      std::vector<Trial> kept;
      for (Trial& t : best) {
        if (kept.size() == 2) break;
        const PhotoForm& form = candidates_[c].forms[t.form];
        if (std::none_of(kept.begin(), kept.end(), [&](const Trial& k) {
              const PhotoForm& other = candidates_[c].forms[k.form];
              return has_all(form, other) || has_all(other, form);
            }))
          kept.push_back(std::move(t));
      }
      all.insert(all.end(), kept.begin(), kept.end());
    }
    std::sort(all.begin(), all.end(),
              [](const Trial& a, const Trial& b) { return a.score > b.score; });
    return all;
  }

  /// The model with a trial's form, fitted.
  [[nodiscard]] PhotoMembers with(const PhotoMembers& members, const Trial& t) {
    PhotoMembers model = members;
    const Candidate& c = candidates_[t.candidate];
    const PhotoForm& form = c.forms[t.form];
    PhotoMember added{c.effect, form, std::vector<double>(form.parameters.size(), 0.0)};
    const auto mine = std::find_if(model.begin(), model.end(),
                                   [&](const PhotoMember& m) { return m.effect == c.effect; });
    if (mine != model.end()) {
      for (std::size_t k = 0; k < form.parameters.size(); ++k)
        for (std::size_t i = 0; i < mine->form.parameters.size(); ++i)
          if (mine->form.parameters[i].key == form.parameters[k].key)
            added.values[k] = mine->values[i];
      *mine = std::move(added);
    } else {
      model.push_back(std::move(added));
    }
    return fit_.fitted(std::move(model), kTrialSteps);
  }

  /// Likelihood and price of a fitted model on the choosing blocks; less is better.
  [[nodiscard]] double score(const PhotoMembers& members) {
    return fit_.objective(members, {kChoose}) + price_of(members);
  }

  /// The same with its pictures rendered anew as a whole, edges and all.
  [[nodiscard]] double whole_score(const PhotoMembers& members) {
    return fit_.objective(fit_.about(members, parameters_of(members)), {kChoose}) +
           price_of(members);
  }

  [[nodiscard]] PhotoMembers choose(std::vector<Ranked>& ranking, const RunContext& run) {
    PhotoMembers members;
    for (std::size_t round = 0; round < kRounds && !run.stopped(); ++round) {
      const PhotoLinear linear = fit_.about(members, parameters_);
      fit_.noise = fit_.noise_of(linear);
      const double now = fit_.objective(linear, {kChoose}) + price_of(members);
      const auto all = trials(linear, members, {kChoose});
      if (members.empty())
        for (const Trial& t : all)
          ranking.push_back({candidates_[t.candidate].effect->name,
                             candidates_[t.candidate].forms[t.form].law, t.score});
      PhotoMembers best = best_of(all, linear, members, now);
      if (best.empty()) break;
      best = pruned(std::move(best));
      // A displaced picture says little of what lies between nodes.
      if (members.empty()) {
        const detail::Normals was = fit_.normals;
        PhotoMembers settled = fit_.settle_normals(best);
        if (fit_.normals != was) best = fit_.fitted(std::move(settled));
      }
      if (best.size() > 1) best = exchanged(std::move(best), run);
      // What comes in and drives out another must leave less than before, or it would go on so.
      const bool better = members.empty() || score(best) < now - 1.0;
      if (!better) break;
      members = std::move(best);
    }
    // Sizes with shadows and edges where this model has them.
    if (!members.empty()) static_cast<void>(fit_.about(members, parameters_of(members)));
    return fit_.fitted(std::move(members));
  }

  /// Other causes that do as well in the place of the k-th. @param gain  what it gains there
  [[nodiscard]] std::vector<std::string> equivalents(const PhotoMembers& members, std::size_t k,
                                                     double& gain,
                                                     std::vector<Rejected>& ruled_out) {
    const double full = fit_.objective(members, kAll);
    const PhotoMembers others = fit_.fitted(without(members, k));
    const PhotoLinear linear = fit_.about(others, parameters_);
    const double missed = fit_.objective(linear, kAll);
    gain = missed - full;
    const double far = std::fmax(detail::kEquivalent, 0.01 * gain);
    std::vector<std::string> names;
    std::vector<std::size_t> done;
    std::size_t rendered = 0;
    double own = 0.0;  // to first order
    const auto all = trials(linear, others, kAll);
    for (const Trial& t : all)
      if (candidates_[t.candidate].effect == members[k].effect) own = std::fmax(own, t.gain);
    for (const Trial& t : all) {
      const Effect* effect = candidates_[t.candidate].effect;
      if (effect == members[k].effect ||
          std::any_of(others.begin(), others.end(),
                      [&](const PhotoMember& m) { return m.effect == effect; }) ||
          std::find(done.begin(), done.end(), t.candidate) != done.end())
        continue;
      done.push_back(t.candidate);
      double worse = own - t.gain;
      if (t.gain > kNear * own && rendered < kRendered) {
        ++rendered;
        worse = fit_.objective(with(others, t), kAll) - full;
      }
      if (worse < far)
        names.push_back(effect->name);
      else if (t.gain > 20.0)
        ruled_out.push_back(
            {effect->name, fmt::format("in the place of {} it makes the data 10^{:.1f} times less "
                                       "likely",
                                       members[k].effect->name, worse / 4.605)});
    }
    return names;
  }

 private:
  /// To first order: what would not be confirmed is not worth a rendering.
  [[nodiscard]] bool too_small(const PhotoLinear& linear, PhotoMembers members,
                               PhotoMember added) const {
    if (added.form.least > 0.0 && std::abs(added.values[0]) < 0.5 * added.form.least) return true;
    members.push_back(std::move(added));
    const std::size_t k = members.size() - 1;
    return moved_by(linear, members[k]) * own_share(linear, members, k) <
           0.5 * std::fmax(kFloor * light_, others_wrong(linear, members, k));
  }
  /// The closest candidates rendered; empty: none does better than `now`.
  PhotoMembers best_of(const std::vector<Trial>& all, const PhotoLinear& linear,
                       const PhotoMembers& members, double now) {
    std::vector<std::pair<double, PhotoMembers>> better;
    double least = now;
    std::size_t rendered = 0;
    for (const Trial& t : all) {
      if (rendered == kRendered || !(t.score > 0.0) || t.score < kNear * all.front().score) break;
      const Candidate& c = candidates_[t.candidate];
      if (!t.values.empty() && too_small(linear, members, {c.effect, c.forms[t.form], t.values}))
        continue;
      const bool grows = std::any_of(members.begin(), members.end(),
                                     [&](const PhotoMember& m) { return m.effect == c.effect; });
      if (members.size() == kMostCauses && !grows) continue;
      ++rendered;
      PhotoMembers model = with(members, t);
      const double s = score(model);
      least = std::fmin(least, s);
      if (s < now) better.emplace_back(s, std::move(model));
    }
    // Edges, and what they may be off by, were where the last model has them: close ones are
    // compared with their own.
    std::erase_if(better,
                  [&](const auto& b) { return b.first > least + kCloseScore * (now - least); });
    if (better.size() > 1)
      for (auto& [s, model] : better) s = whole_score(model);
    if (better.empty()) return {};
    const auto best =
        std::min_element(better.begin(), better.end(),
                         [](const auto& a, const auto& b) { return a.first < b.first; });
    return fit_.fitted(std::move(best->second));
  }

  /// Members that are not worth their price to the others go.
  PhotoMembers pruned(PhotoMembers members) {
    while (members.size() > 1) {
      const PhotoLinear linear = fit_.about(members, parameters_of(members));
      const Eigen::MatrixXd g = linear.sum({kChoose});
      std::size_t drop = members.size();
      double least = 0.0;
      for (std::size_t k = 0; k < members.size(); ++k) {
        const double worth = worth_of(g, linear, members, k) - price_of(members[k].form);
        if (worth < least) {
          least = worth;
          drop = k;
        }
      }
      if (drop == members.size()) break;
      members = fit_.fitted(without(std::move(members), drop));
    }
    return members;
  }

  PhotoMembers exchanged(PhotoMembers members, const RunContext& run) {
    double now = score(members);
    for (std::size_t k = 0; k < members.size() && !run.stopped(); ++k) {
      const PhotoMembers others = fit_.fitted(without(members, k));
      const auto all = trials(fit_.about(others, parameters_), others, {kChoose});
      std::size_t rendered = 0;
      for (const Trial& t : all) {
        if (rendered == 2 || t.score < kNear * all.front().score) break;
        if (std::any_of(members.begin(), members.end(), [&](const PhotoMember& m) {
              return m.effect == candidates_[t.candidate].effect;
            }))
          continue;
        ++rendered;
        PhotoMembers model = with(others, t);
        if (const double s = score(model); s < now - detail::kPricePerCause) {
          now = s;
          members = std::move(model);
          break;
        }
      }
    }
    return members;
  }

 public:
  [[nodiscard]] static std::vector<const PhotoParameter*> parameters_of(
      const PhotoMembers& members) {
    std::vector<const PhotoParameter*> all;
    for (const PhotoMember& m : members)
      for (const PhotoParameter& p : m.form.parameters) all.push_back(&p);
    return all;
  }
  /// What the k-th earns where `g` was summed, with all others refitted there.
  /// @param held  its values, of elsewhere; null: the best there
  [[nodiscard]] double worth_of(const Eigen::MatrixXd& g, const PhotoLinear& linear,
                                const PhotoMembers& members, std::size_t k,
                                const Eigen::VectorXd* held = nullptr) const {
    const auto others = columns_of(linear, members, k);
    const auto mine = linear.of(members[k].form);
    Eigen::VectorXd step;
    static_cast<void>(detail::gain_of(g, others, mine, 0, &step));
    const Eigen::VectorXd best = values_of(members[k]) + step;
    const Eigen::MatrixXd a = detail::Reduced(g, mine, others).a;
    const double unit = fit_.noise.factor * fit_.noise.over;
    const double all = best.dot(a * best) / unit;
    if (held == nullptr) return all;
    const Eigen::VectorXd off = best - *held;
    return all - off.dot(a * off) / unit;
  }
  /// Values that a set alone asks for; a map's waves of which it says nothing are as likely as all
  /// are large.
  [[nodiscard]] Eigen::VectorXd values_on(const Eigen::MatrixXd& g, const PhotoLinear& linear,
                                          const PhotoMembers& members, std::size_t k) const {
    const auto others = columns_of(linear, members, k);
    const auto mine = linear.of(members[k].form);
    const Eigen::VectorXd rendered = values_of(members[k]);
    if (!is_map(members[k].form)) {
      Eigen::VectorXd step;
      static_cast<void>(detail::gain_of(g, others, mine, 0, &step));
      return rendered + step;
    }
    detail::Reduced own(g, mine, others);
    own.b += own.a * rendered;
    // Few waves that nothing tells may be huge: what most are like. One that all pictures together
    // tell is as large as it is: of a coat that thins out one way, few are large.
    std::vector<double> size;
    for (const double v : members[k].values) size.push_back(std::abs(v));
    const double typical = std::pow(kMadToSigma * median(std::move(size)), 2),
                 unit = fit_.noise.factor * kMapOver * fit_.noise.over;
    const Eigen::MatrixXd all = detail::Reduced(linear.sum(kAll), mine, others).a;
    const Eigen::VectorXd error =
        unit * detail::ridge_solve(all, Eigen::MatrixXd::Identity(all.rows(), all.cols()), 1e-9)
                   .diagonal();
    for (Eigen::Index i = 0; i < rendered.size(); ++i)
      own.a(i, i) += unit / std::max({1e-12, typical, rendered(i) * rendered(i) - error(i)});
    return own.a.ldlt().solve(own.b);
  }

 private:
  PhotoFit& fit_;
  std::vector<Candidate> candidates_;
  std::vector<const PhotoParameter*> parameters_;
  double light_;
};

/// Sums over the pictures under every other lamp (from every other place, where there is one lamp),
/// and over the rest, of places that both show in light: a map is known nowhere else.
std::array<Eigen::MatrixXd, 2> halves_of(const PhotoLinear& linear, const detail::PhotoViews& views,
                                         double factor) {
  const PhotoScene& scene = views.scene();
  const auto& pixels = views.pixels();
  const auto half_of = [&](const detail::MeasuredPixel& p) {
    return static_cast<std::size_t>(scene.lamps > 1 ? scene.lamp_of[p.photo] : p.photo) % 2;
  };
  const auto cell_of = [&](const detail::MeasuredPixel& p) {
    const auto part = [](double at, double low, double high) {
      return std::clamp(static_cast<std::size_t>(kMapCells * (at - low) / (high - low)),
                        std::size_t{0}, kMapCells - 1);
    };
    return part(p.place.y, scene.box.min.y, scene.box.max.y) * kMapCells +
           part(p.place.x, scene.box.min.x, scene.box.max.x);
  };
  std::vector<std::array<int, 2>> seen(kMapCells * kMapCells, {0, 0});
  for (const detail::MeasuredPixel& p : pixels)
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
Held held_out(const Search& search, const PhotoFit& fit, const PhotoLinear& linear,
              const PhotoMembers& members, std::size_t k, double share) {
  const auto on = [&](const Eigen::MatrixXd& chosen, const Eigen::MatrixXd& other) {
    const Eigen::VectorXd values = search.values_on(chosen, linear, members, k);
    return Held{share * search.worth_of(other, linear, members, k),
                share * search.worth_of(other, linear, members, k, &values)};
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
      detail::ridge_solve(g(columns, columns), Eigen::MatrixXd::Identity(size, size), 1e-9);
  std::vector<double> sigmas;
  const auto first = static_cast<Eigen::Index>(columns.size() - mine.size());
  for (std::size_t i = 0; i < mine.size(); ++i) {
    const auto at = first + static_cast<Eigen::Index>(i);
    const double over = std::fmax(fit.noise.over, fit.over_of(linear, linear.residual, mine[i]));
    sigmas.push_back(std::sqrt(std::fmax(0.0, inverse(at, at)) * fit.noise.factor * over));
  }
  return sigmas;
}

/// A size of its own that its standard error does not tell from none: what few pixels (edges of
/// shadows) err by together gains much, and says little.
bool is_unsure(const PhotoLinear& linear, const PhotoFit& fit, const PhotoMembers& members,
               std::size_t k) {
  return members[k].values.size() == 1 &&
         std::abs(members[k].values[0]) < kSure * sigmas_of(linear, fit, members, k)[0];
}

/// Those that hold on other blocks and are large enough.
PhotoMembers confirmed(PhotoMembers members, Search& search, PhotoFit& fit, double level_of_light,
                       std::vector<double>& p_values, std::vector<Rejected>& rejected) {
  while (!members.empty()) {
    const PhotoLinear linear = fit.about(members, Search::parameters_of(members));
    p_values.clear();
    std::size_t worst = members.size();
    double least = INFINITY;
    std::string why;
    for (std::size_t k = 0; k < members.size(); ++k) {
      double over = fit.noise.over;
      for (const int c : linear.of(members[k].form))
        over = std::fmax(over,
                         std::fmin(50.0 * fit.noise.over, fit.over_of(linear, linear.residual, c)));
      const double share = fit.noise.over / over;
      const auto [gain, predicted] = held_out(search, fit, linear, members, k, share);
      double p = chi_squared_tail(gain, static_cast<int>(members[k].form.parameters.size()));
      if (!(predicted > 0.5 * gain)) p = std::fmax(p, 0.5);
      p_values.push_back(std::fmax(p, 1e-300));
      const double floor = std::fmax(kFloor * level_of_light, others_wrong(linear, members, k));
      const double own = moved_by(linear, members[k]) * own_share(linear, members, k);
      const PhotoForm& form = members[k].form;
      const bool small = !(own > floor) ||
                         (form.least > 0.0 && std::abs(members[k].values[0]) < form.least) ||
                         (members[k].effect->name == "lamp.size" &&
                          fit.views().penumbra_px(fit.views().scene().photos[0].lamp_diameter_mm +
                                                  members[k].values[0]) < kPenumbra_px);
      const bool unsure = is_unsure(linear, fit, members, k);
      if (p < kClaimLevel && !small && !unsure) continue;
      if (!(gain < least)) continue;
      least = gain;
      worst = k;
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
    members = fit.fitted(without(std::move(members), worst));
  }
  return members;
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

double rms_of(const PhotoLinear& linear, int set, std::size_t* count) {
  double sum = 0.0, n = 0.0;
  for (Eigen::Index i = 0; i < linear.residual.size(); ++i) {
    if (linear.set[static_cast<std::size_t>(i)] != set) continue;
    sum += std::pow(static_cast<double>(linear.residual(i) * linear.sigma(i)), 2);
    n += 1.0;
  }
  if (count != nullptr) *count = static_cast<std::size_t>(n);
  return 255.0 * std::sqrt(sum / std::fmax(1.0, n));
}

/// rms of the noise that the pixels' own scatter shows.
double noise_rms(const detail::PhotoViews& views, double factor) {
  double sum = 0.0, n = 0.0;
  for (const auto& p : views.pixels())
    for (std::size_t ch = 0; ch < views.channels(); ++ch) {
      sum += static_cast<double>(p.variance[ch]);
      n += 1.0;
    }
  return 255.0 * factor * std::sqrt(sum / std::fmax(1.0, n));
}

/// Held-out photographs beside what two models expect.
std::vector<Diagnosis::HeldOut> held_out_of(PhotoFit& fit, const PhotoMembers& members,
                                            double noise_factor) {
  const PhotoScene& scene = fit.views().scene();
  std::vector<Diagnosis::HeldOut> all(scene.photos.size());
  std::vector<double> count(scene.photos.size(), 0.0);
  const std::size_t channels = fit.views().channels();
  for (const bool after : {false, true}) {
    static_cast<void>(fit.about(after ? members : PhotoMembers{}, {}));
    for (const auto& p : fit.views().pixels()) {
      const PhotoInput& photo = scene.photos[p.photo];
      const auto number = [&](double v) {
        return 255.0 * (photo.srgb ? static_cast<double>(camera::srgb_of_linear(
                                         static_cast<float>(std::clamp(v, 0.0, 1.0))))
                                   : v);
      };
      for (std::size_t ch = 0; ch < channels; ++ch) {
        const double expected = fit.views().number_of(p, ch, p.value[ch]);
        const double measured = static_cast<double>(p.measured[ch]);
        Diagnosis::HeldOut& h = all[p.photo];
        (after ? h.after : h.before) += std::abs(number(measured) - number(expected));
        if (!after) continue;
        const double sigma = noise_factor * std::sqrt(static_cast<double>(p.variance[ch]));
        // Mean absolute value of a normal distribution.
        h.noise += std::sqrt(2.0 / std::numbers::pi) *
                   (number(expected + 0.5 * sigma) - number(expected - 0.5 * sigma));
        count[p.photo] += 1.0;
      }
    }
  }
  std::vector<Diagnosis::HeldOut> out;
  for (std::size_t k = 0; k < all.size(); ++k)
    if (count[k] > 0.0)
      out.push_back({scene.photos[k].image.filename().string(), all[k].before / count[k],
                     all[k].after / count[k], all[k].noise / count[k]});
  return out;
}

Result<PhotoScene> scene_of(const std::vector<PhotoInput>& photos) {
  PhotoScene scene;
  scene.photos = photos;
  std::vector<Vec3> lamps;
  for (PhotoInput& p : scene.photos) {
    if (std::isnan(p.principal_u_px)) p.principal_u_px = 0.5 * p.width_px;
    if (std::isnan(p.principal_v_px)) p.principal_v_px = 0.5 * p.height_px;
    const double length = std::sqrt(p.model_from_camera.w * p.model_from_camera.w +
                                    p.model_from_camera.x * p.model_from_camera.x +
                                    p.model_from_camera.y * p.model_from_camera.y +
                                    p.model_from_camera.z * p.model_from_camera.z);
    if (!(length > 0.5))
      return fail(kPhotograph, fmt::format("{}: camera_quaternion_wxyz is no rotation; expected w, "
                                           "x, y, z with squares that add up to 1",
                                           p.image.string()));
    p.model_from_camera = normalized(p.model_from_camera);
    if (!(norm(p.lamp_position_mm - p.lamp_target_mm) > 0.0))
      return fail(kPhotograph,
                  fmt::format("{}: lamp_position_mm and lamp_target_mm are the same place; say "
                              "where the lamp stands and where it points to",
                              p.image.string()));
    std::size_t lamp = 0;
    while (lamp < lamps.size() && norm(lamps[lamp] - p.lamp_position_mm) > 1e-6) ++lamp;
    if (lamp == lamps.size()) lamps.push_back(p.lamp_position_mm);
    scene.lamp_of.push_back(lamp);
  }
  scene.lamps = lamps.size();
  return scene;
}

std::vector<Candidate> candidates_of(const PhotoScene& scene) {
  std::vector<Candidate> all;
  for (const Effect& e : library()) {
    if (!e.photo_forms) continue;
    auto forms = e.photo_forms(scene);
    if (!forms.empty()) all.push_back({&e, std::move(forms)});
  }
  return all;
}

/// What the model has already (extended.toml).
Result<PhotoMembers> known_members(const std::vector<KnownCause>& known,
                                   const std::vector<Candidate>& candidates) {
  PhotoMembers members;
  for (const KnownCause& k : known) {
    const Effect* effect = find_effect(k.effect);
    if (effect == nullptr || !effect->photo_forms) continue;
    for (const Candidate& c : candidates) {
      if (c.effect != effect) continue;
      for (const PhotoForm& f : c.forms) {
        if (f.law != k.law) continue;
        PhotoMember m{effect, f, std::vector<double>(f.parameters.size(), 0.0)};
        for (std::size_t i = 0; i < f.parameters.size(); ++i)
          for (const auto& [name, value] : k.parameters)
            if (name == f.parameters[i].key) m.values[i] = value;
        members.push_back(std::move(m));
      }
    }
    if (members.empty() || members.back().effect != effect)
      return fail(kUnknownCause, fmt::format("[[cause]] {}: no law \"{}\"; take it from a "
                                             "diagnosis of the same photographs",
                                             k.effect, k.law));
  }
  return members;
}

/// A search and what it found.
struct Named {
  PhotoMembers members;
  Diagnosis d;
  double scatter = 1.0;  ///< of neighbouring pixels, over the declared noise
};

/// The smallest of those that explain too little beside what remains unexplained: many a thing
/// without a name looks a little like each, and a map, a light from one side, or a factor for each
/// picture takes the better part of it (a reflex in the lens is a map of albedo in the middle of
/// all pictures, a second lamp a bright side of the sky). members.size(): none.
std::size_t beside_unknown(const PhotoLinear& linear, const PhotoMembers& members,
                           const Diagnosis& d) {
  constexpr double kOfOneLaw = 1.5, kOfMany = 5.0;
  constexpr std::size_t kMany = 3;  // parameters
  const double left_255 =
      std::sqrt(std::fmax(0.0, d.rms_after * d.rms_after - d.rms_noise * d.rms_noise));
  std::size_t weakest = members.size();
  double least = 1.0;
  for (std::size_t k = 0; k < members.size(); ++k) {
    const double own_255 = 255.0 * moved_by(linear, members[k]) * own_share(linear, members, k);
    const double wanted = members[k].form.parameters.size() < kMany ? kOfOneLaw : kOfMany;
    if (const double share = own_255 / (wanted * left_255); share < least) {
      least = share;
      weakest = k;
    }
  }
  return weakest;
}

/// The same with an offset of the numbers in the place of ambient light, fitted, where that does as
/// well; else empty.
PhotoMembers offset_for_light(PhotoMembers members, const std::vector<Candidate>& candidates,
                              PhotoFit& fit) {
  const auto light = std::find_if(members.begin(), members.end(), [](const PhotoMember& m) {
    return m.effect->name == "lamp.ambient";
  });
  const auto offset = std::find_if(candidates.begin(), candidates.end(), [](const Candidate& c) {
    return c.effect->name == "photo.black_level";
  });
  if (light == members.end() || offset == candidates.end() || offset->forms.empty()) return {};
  const double before = fit.objective(members, kAll);
  *light = {offset->effect, offset->forms[0],
            std::vector<double>(offset->forms[0].parameters.size(), 0.0)};
  members = fit.fitted(std::move(members));
  return fit.objective(members, kAll) < before + detail::kEquivalent ? members : PhotoMembers{};
}

bool knows(const std::vector<KnownCause>& known, const std::string& effect) {
  return std::any_of(known.begin(), known.end(),
                     [&](const KnownCause& k) { return k.effect == effect; });
}

/// @param whole  with maps, dependences and equivalents; else causes and verdict alone
Result<Named> named(PhotoFit& fit, const std::vector<Candidate>& candidates,
                    const detail::Layout& layout, bool noise_known, bool whole,
                    const RunContext& run) {
  Named out;
  Diagnosis& d = out.d;
  d.unit = "/ 255";
  const detail::PhotoViews& views = fit.views();
  const PhotoLinear before = fit.about({}, {});
  d.rms_before = rms_of(before, kReport, &d.n_report);
  double light = 0.0;
  for (const auto& p : views.pixels()) light += static_cast<double>(p.measured[0]);
  light /= static_cast<double>(views.pixels().size());
  const auto first_pixels = views.pixels();
  Search search(fit, candidates, light);

  PhotoMembers& members = out.members;
  members = search.choose(d.ranking, run);
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  run.progress(0.6);
  std::vector<double> p_values;
  members = confirmed(std::move(members), search, fit, light, p_values, d.rejected);
  run.progress(0.7);

  PhotoLinear after;
  detail::PhotoScatter scatter;
  bool told_by_scatter = false;
  while (true) {
    after = fit.about(members, Search::parameters_of(members));
    d.rms_after = rms_of(after, kReport, nullptr);
    scatter = detail::scatter_of(views);
    d.rms_noise = noise_rms(views, scatter.factor);
    d.remainder =
        detail::judge_photographs(after, views, layout, fit.noise.factor, 255.0 * kSmooth * light);
    const std::size_t drop = d.remainder.found ? beside_unknown(after, members, d) : members.size();
    if (drop == members.size()) {
      if (noise_known || d.remainder.found || told_by_scatter || !(scatter.off() > kScatterOff))
        break;
      // Light has shot noise, an offset of the numbers has none.
      told_by_scatter = true;
      PhotoMembers instead = offset_for_light(members, candidates, fit);
      if (instead.empty()) break;
      static_cast<void>(fit.about(instead, Search::parameters_of(instead)));
      if (const auto its = detail::scatter_of(views); its.off() < kScatterOff)
        members = std::move(instead);
      continue;
    }
    d.rejected.push_back(
        {members[drop].effect->name, "explains too little beside what remains unexplained"});
    p_values.erase(p_values.begin() + static_cast<std::ptrdiff_t>(drop));
    members = fit.fitted(without(std::move(members), drop));
  }
  out.scatter = scatter.factor;
  if (whole) detail::show_photographs(before, first_pixels, after, views, layout, d);
  std::vector<double> gains(members.size(), 0.0);
  for (std::size_t k = 0; k < members.size(); ++k) {
    Cause c;
    const PhotoMember& m = members[k];
    c.effect = m.effect->name;
    c.law = m.form.law;
    c.parameters = sizes_of(after, fit, members, k);
    c.fixed = m.form.fixed;
    for (std::size_t i = 0; i < m.values.size(); ++i)
      c.raw.emplace_back(m.form.parameters[i].key, m.values[i]);
    c.separate_by = m.effect->separate_by;
    c.p_value = p_values[k];
    d.causes.push_back(std::move(c));
  }
  for (std::size_t k = 0; whole && k < members.size(); ++k) {
    d.causes[k].equivalent = search.equivalents(members, k, gains[k], d.rejected);
    run.progress(0.7 + 0.3 * static_cast<double>(k + 1) / static_cast<double>(members.size()));
  }
  double all = 1e-300;
  for (const double g : gains) all += std::fmax(0.0, g);
  for (std::size_t k = 0; k < members.size(); ++k)
    d.causes[k].share = std::clamp(gains[k] / all, 0.0, 1.0);

  // What has no name scatters neighbours, too, and so does what is left at edges, by less.
  const double off = d.rms_after < kNoiseAlone * d.rms_noise ? kScatterOff : kScatterOffBesideMore;
  if (!noise_known && !d.remainder.found && scatter.off() > off) {
    Cause c;
    const Effect* effect = find_effect("photo.noise");
    c.effect = effect->name;
    c.law = "scatter of neighbouring pixels";
    c.parameters = {{"factor", scatter.factor, scatter.sigma},
                    {"factor_dark", scatter.dark, scatter.sigma_of_third},
                    {"factor_light", scatter.light, scatter.sigma_of_third}};
    c.raw = {{"factor", scatter.factor}};
    c.separate_by = effect->separate_by;
    c.p_value = std::fmax(1e-300, std::erfc(4.0 + (scatter.off() - off) / scatter.sigma_of_third));
    d.causes.push_back(std::move(c));
  }
  d.verdict = d.causes.empty()    ? (d.remainder.found ? "unexplained" : "consistent")
              : d.remainder.found ? "partly_explained"
                                  : "explained";
  return out;
}

/// The same search on pictures simulated from what was found. @post `views` show these
Result<Controls> controls_of(detail::PhotoViews& views, const PhotoFit& fit, const Named& found,
                             const std::vector<Candidate>& candidates, const detail::Layout& layout,
                             bool noise_known, std::uint64_t seed, const RunContext& run) {
  Controls c;
  views.simulate(fit.state_of(found.members), fit.normals, found.scatter, mix64(seed));
  c.points = views.pixels().size();
  noise_known |= std::any_of(found.d.causes.begin(), found.d.causes.end(),
                             [](const Cause& cause) { return cause.effect == "photo.noise"; });
  for (const bool recovery : {false, true}) {
    if (recovery && found.members.empty()) break;
    PhotoFit again(views, layout);
    again.normals = fit.normals;
    again.known = fit.known;
    std::vector<Candidate> rest = candidates;
    if (!recovery) {
      again.known.insert(again.known.end(), found.members.begin(), found.members.end());
      for (const PhotoMember& m : found.members)
        std::erase_if(rest, [&](const Candidate& k) { return k.effect == m.effect; });
    }
    MAQUETTE_TRY(const Named back, named(again, rest, layout, noise_known, false,
                                         part(run, recovery ? 0.7 : 0.6, recovery ? 1.0 : 0.7)));
    if (recovery) {
      std::vector<Cause> injected = found.d.causes;
      injected.resize(found.members.size());  // without the scatter's
      recover(injected, back.d.causes, c);
    } else {
      c.null_verdict = back.d.verdict;
      for (const Cause& cause : back.d.causes) c.null_claims.push_back(cause.effect);
    }
  }
  return c;
}

}  // namespace

Result<Diagnosis> diagnose_photographs(const CaseInput& part, const std::vector<PhotoInput>& photos,
                                       bool with_controls, const RunContext& run) {
  MAQUETTE_TRY(PhotoScene scene, scene_of(photos));
  const auto held =
      std::count_if(photos.begin(), photos.end(), [](const PhotoInput& p) { return p.held_out; });
  if (held == std::ssize(photos))
    return fail(kPhotograph, fmt::format("{}: all photographs have held_out = true; leave at least "
                                         "one to choose by",
                                         photos.front().image.string()));
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(part.design));
  std::vector<detail::Photograph> taken;
  bool milled = false;
  for (const PhotoInput& p : scene.photos) {
    MAQUETTE_TRY(auto photo, detail::read_photograph(p));
    milled |= p.as_milled && !part.programs.empty();
    taken.push_back(std::move(photo));
  }
  scene.colour = std::all_of(taken.begin(), taken.end(),
                             [](const detail::Photograph& p) { return p.value.size() == 3; });
  if (!scene.colour)
    for (auto& p : taken) p.value.resize(1);
  std::optional<CutPath> path;
  std::unique_ptr<SimulatedSurface> cut;
  if (milled) {
    MAQUETTE_TRY(auto read, CutPath::read(part.programs, 0.5 * part.ball_diameter_mm, run));
    path.emplace(std::move(read));
    cut = std::make_unique<SimulatedSurface>(design, &*path, run);
  }
  std::vector<const heightmap::ModelField*> surfaces;
  for (const PhotoInput& p : scene.photos)
    surfaces.push_back(p.as_milled && cut ? &cut->field() : &design);
  scene.box = maquette::diagnosis::scene_of(design, nullptr, 0.5 * part.ball_diameter_mm).box;
  run.progress(0.05);

  const auto layout = detail::lay_out(scene.box, part.seed);
  std::vector<detail::Photograph> shown_later(taken.size());
  for (std::size_t k = 0; k < taken.size(); ++k)
    if (scene.photos[k].held_out) std::swap(taken[k], shown_later[k]);
  detail::PhotoViews views(scene, std::move(taken), surfaces);
  PhotoFit fit(views, layout);
  auto candidates = candidates_of(scene);
  MAQUETTE_TRY(fit.known, known_members(part.known, candidates));
  for (const PhotoMember& m : fit.known)
    std::erase_if(candidates, [&](const Candidate& c) { return c.effect == m.effect; });

  // Facets, patches or smooth slopes: what no cause makes, differences of neighbouring pixels,
  // decides.
  fit.settle_normals({});
  if (views.pixels().size() < kLeastPixels)
    return fail(kPhotograph,
                fmt::format("{} pixels of the lattice show the surface; at least {} are needed: do "
                            "camera_position_mm and camera_quaternion_wxyz look at the part?",
                            views.pixels().size(), kLeastPixels));
  run.progress(0.2);

  const bool noise_known = knows(part.known, "photo.noise");
  MAQUETTE_TRY(Named found, named(fit, candidates, layout, noise_known, true,
                                  maquette::part(run, 0.2, with_controls ? 0.6 : 0.95)));
  Diagnosis& d = found.d;
  if (held > 0) {
    detail::PhotoViews others(scene, std::move(shown_later), surfaces, true);
    PhotoFit expected(others, layout);
    expected.known = fit.known;
    expected.normals = fit.normals;
    d.held_out = held_out_of(expected, found.members, found.scatter);
  }
  const std::map<detail::Normals, const char*> kinds{
      {detail::Normals::smooth, "smooth between nodes"},
      {detail::Normals::smoother, "smooth between nodes, of fourth order"},
      {detail::Normals::patches, "those of bilinear patches"},
      {detail::Normals::facets, "those of facets"}};
  d.notes.push_back(
      fmt::format("photographs: slopes of the surface are {}", kinds.at(fit.normals)));
  if (with_controls) {
    MAQUETTE_TRY(d.controls,
                 controls_of(views, fit, found, candidates, layout, noise_known, part.seed, run));
    if (!d.controls->passed()) d.notes.push_back("a control did not pass: see the report");
  }
  run.progress(1.0);
  return std::move(d);
}

}  // namespace maquette::diagnosis
