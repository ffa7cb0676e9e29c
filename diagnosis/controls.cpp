// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/controls.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include <oneapi/tbb/parallel_for.h>

#include "core/random.hpp"
#include "diagnosis/detail/poses.hpp"
#include "diagnosis/detail/random_field.hpp"
#include "diagnosis/detail/stones.hpp"
#include "diagnosis/extended_model.hpp"

namespace maquette::diagnosis {
namespace {

constexpr std::size_t kFields = 4;  // three scales of details, and means of cells

/// Mean correlation between two places of a square.
double within(double side, double length, bool gauss) {
  constexpr int kPlaces = 7;
  double sum = 0.0;
  for (int dx = -kPlaces + 1; dx < kPlaces; ++dx)
    for (int dy = -kPlaces + 1; dy < kPlaces; ++dy) {
      const double r = side / kPlaces * std::hypot(dx, dy) / length;
      sum += (kPlaces - std::abs(dx)) * (kPlaces - std::abs(dy)) *
             (gauss ? std::exp(-0.5 * r * r) : std::exp(-r));
    }
  return sum / (kPlaces * kPlaces * kPlaces * kPlaces);
}

/// Variance, as of one point, that a field of variance 1 adds to details of a scale (3: means of
/// cells), at so many points a square millimetre.
double response(std::size_t scale, double cell, double density, double length, bool gauss) {
  if (scale == 3) return density * cell * cell * within(cell, length, gauss);
  const double side = cell / static_cast<double>(1U << scale);
  const double points = density * 0.25 * side * side;  // of a quarter
  const double of_occupied = points / -std::expm1(-points);
  return of_occupied * (4.0 / 3.0) *
         (within(0.5 * side, length, gauss) - within(side, length, gauss));
}

double field_length(std::size_t scale, double cell) {
  return scale == 3 ? 0.4 * cell : 0.15 * cell / static_cast<double>(1U << scale);
}

/// Variances of the fields that together give the wanted variances of details, none below 0.
std::array<double, kFields> field_variances(const std::array<double, kFields>& wanted, double cell,
                                            double density, const FittedNoise::Top& process) {
  std::array<double, kFields> variance{}, left = wanted;
  for (std::size_t s = 0; s < 3; ++s)
    left[s] -= process.smooth_mm2 * response(s, cell, density, process.length_mm, process.gauss);
  for (int round = 0; round < 200; ++round)
    for (std::size_t t = 0; t < kFields; ++t) {
      double off = left[t];
      for (std::size_t u = 0; u < kFields; ++u)
        off -= variance[u] * response(t, cell, density, field_length(u, cell), true);
      variance[t] = std::fmax(
          0.0, variance[t] + off / response(t, cell, density, field_length(t, cell), true));
    }
  return variance;
}

/// What one part, or one set-up, adds to its points.
detail::RandomField field_of(const std::array<double, kFields>& wanted, double cell, double density,
                             const FittedNoise::Top& process, const Box3& box, double blur_mm,
                             std::uint64_t seed, double& white) {
  std::vector<detail::FieldLaw> laws{{process.smooth_mm2, process.length_mm, process.gauss}};
  const auto variance = field_variances(wanted, cell, density, process);
  for (std::size_t t = 0; t < kFields; ++t)
    laws.push_back({variance[t], field_length(t, cell), true});
  for (const detail::FieldLaw& law : laws)
    white -= law.variance * (1.0 - within(cell / 8.0, law.length_mm, law.gauss));
  return {box, laws, blur_mm, seed};
}

}  // namespace

bool Controls::passed() const {
  return null_verdict == "consistent" && false_claims.empty() &&
         std::none_of(recoveries.begin(), recoveries.end(),
                      [](const Recovery& r) { return r.named_as.empty(); });
}

std::vector<double> simulated_noise(const std::vector<Observation>& places, std::size_t set_ups,
                                    const Box3& box, const FittedNoise& noise, double every,
                                    std::uint64_t seed) {
  const double area = (box.max.x - box.min.x) * (box.max.y - box.min.y);
  const double density = every * static_cast<double>(places.size()) / area;
  const double n = static_cast<double>(set_ups);
  const auto beyond = [](const std::array<double, 3>& details, double top,
                         const std::array<double, 3>& base, double base_top) {
    std::array<double, kFields> wanted{};
    for (std::size_t s = 0; s < 3; ++s) wanted[s] = std::fmax(0.0, details[s] - base[s]);
    wanted[3] = std::fmax(0.0, top - base_top);
    return wanted;
  };
  // A point that stands for several stands for the mean of the square that they share.
  const double blur =
      std::sqrt(area / static_cast<double>(places.size()) / 12.0 * (1.0 - 1.0 / every));
  std::array<double, 3> white_base{};
  white_base.fill(noise.point_mm2);
  double white = noise.point_mm2;
  FittedNoise::Top own = noise.own, common = noise.common;
  own.smooth_mm2 *= 0.5;  // a difference has both
  common.smooth_mm2 = std::fmax(0.0, common.smooth_mm2 - own.smooth_mm2 / n);
  const auto shared =
      field_of(beyond(noise.common_mm2, common.white_mm2, noise.own_mm2, own.white_mm2),
               noise.cell_mm, density, common, box, blur, mix64(seed + 1), white);
  std::vector<detail::RandomField> of_set_up;
  for (std::size_t s = 0; s < set_ups; ++s) {
    double own_white = white;
    of_set_up.push_back(field_of(beyond(noise.own_mm2, own.white_mm2, white_base, noise.point_mm2),
                                 noise.cell_mm, density / n, own, box, blur, mix64(seed + 100 + s),
                                 own_white));
    if (s + 1 == set_ups) white = own_white;
  }
  // What fields vary by between close points is part of their scatter.
  const double scatter = every < 1.5 ? std::fmax(0.1 * noise.point_mm2, white) : noise.point_mm2;
  const double sigma = std::sqrt(scatter / every);
  std::vector<double> residual(places.size());
  oneapi::tbb::parallel_for(std::size_t{0}, places.size(), [&](std::size_t i) {
    const Observation& o = places[i];
    residual[i] = sigma * random_normal(seed, i) + shared.at(o.place.x, o.place.y) +
                  of_set_up[o.set_up].at(o.place.x, o.place.y);
  });
  return residual;
}

void recover(const std::vector<Cause>& injected, const std::vector<Cause>& found, Controls& c) {
  std::set<std::size_t> used;
  const auto match = [&](const Cause& wanted, const auto& is) {
    Controls::Recovery* r = &c.recoveries[static_cast<std::size_t>(&wanted - injected.data())];
    for (std::size_t k = 0; k < found.size() && r->named_as.empty(); ++k)
      if (!used.contains(k) && is(found[k])) {
        const Cause& f = found[k];
        used.insert(k);
        r->named_as = f.effect;
        if (f.effect != wanted.effect) continue;
        for (const Estimate& e : wanted.parameters)
          for (const Estimate& back : f.parameters)
            if (e.name == back.name) r->sizes.push_back({e.name, e.value, back.value, back.sigma});
      }
  };
  for (const Cause& cause : injected) c.recoveries.push_back({cause.effect, "", {}});
  const auto holds = [](const std::vector<std::string>& names, const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  for (const Cause& cause : injected)
    match(cause, [&](const Cause& f) {
      // Of stones each is a cause of its own.
      return f.effect == cause.effect &&
             (find_effect(f.effect)->needs != Needs::stones || f.law == cause.law);
    });
  for (const Cause& cause : injected)
    match(cause, [&](const Cause& f) {
      return holds(f.equivalent, cause.effect) || holds(cause.equivalent, f.effect);
    });
  for (std::size_t k = 0; k < found.size(); ++k)
    if (!used.contains(k)) c.false_claims.push_back(found[k].effect);
}

Result<Controls> controls(const Measurements& m, const Diagnosis& d, std::uint64_t seed,
                          const RunContext& run) {
  Controls c;
  Measurements few = m;
  few.strays_gather = false;
  few.settled_anew = {};  // what is simulated is in no file
  const std::size_t all = m.observations.size();
  const std::size_t kept = std::min(all, kControlPoints);
  few.notes.clear();
  few.observations.clear();
  for (std::size_t k = 0; k < kept; ++k) {
    const std::size_t first = k * all / kept, end = (k + 1) * all / kept;
    few.observations.push_back(m.observations[first + random_bits(seed ^ 0xc0, k) % (end - first)]);
  }
  c.points = kept;
  // As the diagnosis saw them.
  if (d.contact == MadeBy::tip && m.contact != MadeBy::tip) cut_by_tips(few);
  few.contact = d.contact;
  auto noise = simulated_noise(few.observations, m.set_ups.size(), m.scene.box, d.noise,
                               static_cast<double>(all) / static_cast<double>(kept), mix64(seed));
  // A shift of all poses along an axis is that of named causes where they, or those that may stand
  // in their place, make it unknown.
  Vec3 theirs;
  for (const PoseEstimate& p : d.poses)
    theirs += (1.0 / static_cast<double>(d.poses.size())) * p.shift_mm;
  const auto unknown = [&](char axis) { return detail::shift_unknown(d.causes, axis); };
  theirs = {unknown('x') ? theirs.x : 0.0, unknown('y') ? theirs.y : 0.0,
            unknown('z') ? theirs.z : 0.0};
  // Poses stay as wrong as they were found to be: what their files say and what the fit moved.
  for (std::size_t i = 0; i < kept; ++i) {
    const Observation& o = few.observations[i];
    const Vec3 off = detail::pose_error(o.place, d.poses[o.set_up], m.set_ups[o.set_up]);
    noise[i] += dot(level_along(o), off - theirs);
  }
  const auto terms = [&](bool of_poses) -> Result<std::vector<KnownTerm>> {
    std::vector<KnownCause> known;
    for (const Cause& cause : d.causes)
      if ((cause.law == kPoseLaw) == of_poses) known.push_back(as_known(cause));
    return restore(known, m.scene, centres_of(m));
  };
  MAQUETTE_TRY(const auto in_residuals, terms(false));
  MAQUETTE_TRY(const auto in_poses, terms(true));
  RunContext quiet;
  quiet.stop = run.stop;
  const auto again = [&](const std::vector<KnownTerm>& with, double sign,
                         bool moved_stones) -> Result<Diagnosis> {
    if (m.stones) {
      MAQUETTE_TRY(auto stones, detail::simulated_stones(m, d, moved_stones, mix64(seed + 7)));
      few.stones = std::make_shared<const StonesSeen>(std::move(stones));
    }
    const auto moved = moved_mm(few.observations, with, m.scene.ball_radius_mm);
    for (std::size_t i = 0; i < kept; ++i)
      few.observations[i].residual_mm = noise[i] + sign * moved[i];
    return diagnose(few, seed, quiet);
  };
  MAQUETTE_TRY(const Diagnosis null, again(in_poses, -1.0, false));
  c.null_verdict = null.verdict;
  for (const Cause& cause : null.causes) c.null_claims.push_back(cause.effect);
  if (d.causes.empty()) return c;
  MAQUETTE_TRY(const Diagnosis back, again(in_residuals, 1.0, true));
  recover(d.causes, back.causes, c);
  return c;
}

}  // namespace maquette::diagnosis
