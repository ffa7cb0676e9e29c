// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/stones.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/chi_squared.hpp"
#include "core/random.hpp"
#include "diagnosis/detail/poses.hpp"
#include "diagnosis/extended_model.hpp"
#include "scan/find_stones.hpp"

namespace maquette::diagnosis {

using meshing::PlacedStone;

namespace detail {
namespace {

constexpr double kLeastPose_mm = 0.002;  // no pose is believed to be better
constexpr double kPatch_mm = 1.0;        // a coat's grain is smaller
constexpr double kLargestShare = 0.2;    // what differs by more is another stone
constexpr int kRounds = 5;               // until a size comes to rest
constexpr double kBlurred = 2.0;         // beams across a stone that deviate warns of, too
constexpr double kAsGood = 6.6;          // chi-squared, 1 degree of freedom, 1 %
const std::string kShare = "share", kLength = "outwards_mm";  // parameters of stone.shrink

struct Body {
  Vec3 middle;
  double around_mm = 0.0, low_mm = 0.0;  ///< lowest point under its origin
};

Body body_of(const PlacedStone& stone) {
  const TriMesh mesh = meshing::stone_mesh(stone);
  const Box3 box = mesh.bounds();
  Body b{0.5 * (box.min + box.max), 0.0, stone.model_from_stone.translation_mm.z - box.min.z};
  for (const Vec3& v : mesh.vertices_mm) b.around_mm = std::fmax(b.around_mm, norm(v - b.middle));
  return b;
}

/// All points in the model frame, with where they were seen from.
struct Sighted {
  std::vector<Vec3> points;
  std::vector<scan::Viewpoint> views;
  scan::Registration pose;
};

Sighted sighted(const Measurements& m, const Diagnosis& d, const StonesSeen& stones) {
  Sighted all;
  double most = -1.0;
  for (std::size_t u = 0; u < stones.points_mm.size(); ++u) {
    const SetUp& set_up = m.set_ups[u];
    const auto in_model = [&](Vec3 of_file) {
      const Vec3 p = set_up.model_from_file.point(of_file);
      return p - pose_error(p, d.poses[u], set_up);
    };
    for (const Vec3& p : stones.points_mm[u]) all.points.push_back(in_model(p));
    scan::Viewpoint& view = all.views.emplace_back();
    if (stones.stations_mm[u]) view.station_mm = in_model(*stones.stations_mm[u]);
    view.beam_diameter_mm = stones.beams_mm[u];
    view.points = stones.points_mm[u].size();
    if (const auto n = static_cast<double>(set_up.used); n > most) {
      most = n;
      // What has no name beside the causes moves stones as it moves the ground about them.
      const double floor =
          std::hypot(kLeastPose_mm, d.remainder.found ? d.remainder.structured_rms : 0.0);
      all.pose.centre_mm = set_up.centre_mm;
      const auto square = [&](double sigma) { return sigma * sigma + floor * floor; };
      const Vec3 s = d.poses[u].shift_sigma_mm, t = 1e-6 * d.poses[u].turn_sigma_urad;
      for (std::size_t k = 0; k < 3; ++k) {
        const double shift = k == 0 ? s.x : k == 1 ? s.y : s.z;
        const double turn = k == 0 ? t.x : k == 1 ? t.y : t.z;
        all.pose.covariance[7 * k] = square(shift);
        all.pose.covariance[7 * (k + 3)] = turn * turn;
      }
    }
  }
  return all;
}

/// The mark of a seat goes where causes move the tip that made it.
Vec3 seat_shift(Observation seat, const std::vector<KnownTerm>& terms, double ball_radius_mm) {
  seat.on_surface = false;
  const auto along = [&](Vec3 axis) {
    seat.along = axis;
    return moved_mm(seat, terms, ball_radius_mm);
  };
  return {along({1, 0, 0}), along({0, 1, 0}), along({0, 0, 1})};
}

}  // namespace

Result<void> shift_seats(const std::vector<KnownCause>& known, const Measurements& m,
                         StonePlan& plan) {
  MAQUETTE_TRY(const auto all, restore(known, m.scene, centres_of(m)));
  std::vector<KnownTerm> terms;
  std::copy_if(all.begin(), all.end(), std::back_inserter(terms),
               [](const KnownTerm& t) { return !t.scanner; });
  for (std::size_t k = 0; k < plan.stones.size() && !terms.empty(); ++k)
    if (plan.seats[k])
      plan.stones[k].model_from_stone.translation_mm +=
          seat_shift(*plan.seats[k], terms, m.scene.ball_radius_mm);
  return {};
}

namespace {

/// Causes that are seen in poses only are in those poses already.
std::vector<KnownCause> known_of(const std::vector<Cause>& causes) {
  std::vector<KnownCause> known;
  for (const Cause& cause : causes)
    if (cause.law != kPoseLaw) known.push_back(as_known(cause));
  return known;
}

double value_of(const std::vector<std::pair<std::string, double>>& values,
                const std::string& name) {
  for (const auto& [n, v] : values)
    if (n == name) return v;
  return 0.0;
}

/// The stone with its surface that much farther out.
PlacedStone thickened(PlacedStone stone, double outwards_mm) {
  auto body = std::make_shared<meshing::StoneBody>();
  if (stone.body) *body = *stone.body;
  body->mesh = meshing::unit_stone(stone.shape, stone.body);
  std::vector<Vec3> normals(body->mesh.vertices_mm.size());
  for (const auto& t : body->mesh.triangles) {
    const auto at = [&](std::size_t k) { return body->mesh.vertices_mm[t[k]]; };
    const Vec3 area = cross(at(1) - at(0), at(2) - at(0));
    for (const std::uint32_t v : t) normals[v] += area;
  }
  for (std::size_t v = 0; v < normals.size(); ++v)
    if (norm(normals[v]) > 0.0)
      body->mesh.vertices_mm[v] += (outwards_mm / stone.scale_mm) * normalized(normals[v]);
  stone.body = std::move(body);
  return stone;
}

/// What stone.shrink does, by its parameter.
struct Resize {
  std::string by = kShare;
  double value = 0.0;
  double rests = 0.0;  ///< its origin stays, or (1) its lowest point
  /// By how much its lowest point would come to lie lower.
  [[nodiscard]] double sink_mm(const PlacedStone& stone) const {
    return by == kShare ? value * body_of(stone).low_mm : value;
  }
  [[nodiscard]] PlacedStone of(PlacedStone stone) const {
    const double rise = rests * sink_mm(stone);
    if (by == kShare)
      stone.scale_mm *= 1.0 + value;
    else
      stone = thickened(std::move(stone), value);
    stone.model_from_stone.translation_mm.z += rise;
    return stone;
  }
  [[nodiscard]] std::vector<PlacedStone> of_all(const std::vector<PlacedStone>& plan) const {
    std::vector<PlacedStone> all;
    for (const PlacedStone& s : plan) all.push_back(of(s));
    return all;
  }
  /// As a share of the stone.
  [[nodiscard]] double size(const PlacedStone& stone) const {
    return by == kShare ? value : value / body_of(stone).around_mm;
  }
};

/// A common size of all stones with a pose.
struct Size {
  double value = 0.0, sigma = INFINITY, chance = 1.0;
};
struct Sizes {
  std::array<double, 2> score{};
  std::array<double, 3> bread{}, meat{};
  std::size_t stones = 0;
  [[nodiscard]] Size of(std::size_t law) const {
    const std::size_t on = 2 * law;
    if (!(bread[on] > 0.0)) return {};
    const double z2 = score[law] * score[law] / meat[on];
    return {-score[law] / bread[on], std::sqrt(meat[on]) / bread[on], chi_squared_tail(z2, 1)};
  }
  /// What the other law still gains beside this one, chi-squared with one degree of freedom.
  [[nodiscard]] double beside(std::size_t law) const {
    const std::size_t on = 2 * law, other = 1 - law;
    const double k = bread[1] / bread[on];
    const double rest = score[other] - k * score[law];
    const double variance = meat[2 * other] - 2.0 * k * meat[1] + k * k * meat[on];
    return variance > 0.0 ? rest * rest / variance : 0.0;
  }
};

bool has_pose(const scan::StoneFinding& f) {
  return f.state == scan::StoneState::as_planned || f.state == scan::StoneState::moved;
}

Sizes sizes_of(const std::vector<scan::StoneFinding>& found) {
  Sizes all;
  for (const auto& f : found) {
    if (!has_pose(f)) continue;
    ++all.stones;
    for (std::size_t k = 0; k < 2; ++k) all.score[k] += f.size.score[k];
    for (std::size_t k = 0; k < 3; ++k) {
      all.bread[k] += f.size.bread[k];
      all.meat[k] += f.size.meat[k];
    }
  }
  return all;
}

/// Rotation as a vector, mrad.
Vec3 turn_of(const RigidTransform& t) {
  Quaternion q = t.rotation;
  if (q.w < 0.0) q = {-q.w, -q.x, -q.y, -q.z};
  const Vec3 axis{q.x, q.y, q.z};
  const double sine = norm(axis);
  return sine > 0.0 ? (2e3 * std::atan2(sine, q.w) / sine) * axis : Vec3{};
}

PlacedStone moved_stone(PlacedStone stone, Vec3 shift, Vec3 turn_mrad) {
  const Vec3 middle = body_of(stone).middle;
  RigidTransform move;
  if (norm(turn_mrad) > 0.0)
    move.rotation = rotation_about(normalized(turn_mrad), 1e-3 * norm(turn_mrad));
  move.translation_mm = middle - rotate(move.rotation, middle) + shift;
  stone.model_from_stone = move * stone.model_from_stone;
  return stone;
}

/// What was measured of the stones, held against a plan.
class Against {
 public:
  Against(Sighted seen, const StonesSeen& stones, double noise_mm)
      : seen_(std::move(seen)), ground_(stones.ground), noise_(noise_mm) {}

  [[nodiscard]] Result<std::vector<scan::StoneFinding>> find(
      const std::vector<PlacedStone>& plan) const {
    return scan::find_stones(seen_.points, seen_.views, ground_, plan, noise_, &seen_.pose);
  }
  /// Of every second patch, or the others.
  [[nodiscard]] Against half(bool odd) const {
    Against h = *this;
    h.seen_.points.clear();
    std::size_t at = 0;
    for (scan::Viewpoint& view : h.seen_.views) {
      std::size_t kept = 0;
      for (const std::size_t end = at + view.points; at < end; ++at) {
        const Vec3 p = seen_.points[at];
        const auto patch = static_cast<long>(std::floor(p.x / kPatch_mm)) +
                           static_cast<long>(std::floor(p.y / kPatch_mm));
        if (((patch & 1) != 0) != odd) continue;
        h.seen_.points.push_back(p);
        ++kept;
      }
      view.points = kept;
    }
    return h;
  }
  /// Rms of measured minus computed ranges about `near`, if `plan` stands there. Beyond an edge the
  /// depth says nothing: what is off by more counts as if it were off by kCut standard deviations.
  [[nodiscard]] Result<double> rms(const std::vector<PlacedStone>& plan,
                                   const std::vector<PlacedStone>& near, std::size_t* count) const {
    MAQUETTE_TRY(const auto beyond, scan::beyond_stones(seen_.points, seen_.views, ground_, plan));
    std::vector<Body> bodies;
    for (const PlacedStone& s : near) bodies.push_back(body_of(s));
    double sum = 0.0;
    std::size_t n = 0;
    for (std::size_t i = 0; i < beyond.size(); ++i) {
      const Vec3 p = seen_.points[i];
      if (std::none_of(bodies.begin(), bodies.end(),
                       [&](const Body& b) { return norm(p - b.middle) < 1.2 * b.around_mm; }))
        continue;
      const double off = std::fmin(std::abs(beyond[i]), kCut * noise_);
      sum += off * off;
      ++n;
    }
    if (count != nullptr) *count = n;
    return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, n)));
  }
  /// The points as rays would measure them of the plan, with noise; by view.
  [[nodiscard]] Result<std::vector<std::vector<Vec3>>> simulated(
      const std::vector<PlacedStone>& plan, std::uint64_t seed) const {
    MAQUETTE_TRY(const auto beyond, scan::beyond_stones(seen_.points, seen_.views, ground_, plan));
    std::vector<std::vector<Vec3>> all;
    std::size_t i = 0;
    for (const scan::Viewpoint& view : seen_.views) {
      auto& points = all.emplace_back();
      for (const std::size_t end = i + view.points; i < end; ++i) {
        const Vec3 p = seen_.points[i];
        const Vec3 sight = view.station_mm ? normalized(p - *view.station_mm) : Vec3{0, 0, -1};
        if (std::isfinite(beyond[i]))
          points.push_back(p + (noise_ * random_normal(seed, i) - beyond[i]) * sight);
      }
    }
    return all;
  }

 private:
  static constexpr double kCut = 6.0;
  Sighted seen_;
  const heightmap::ModelField& ground_;
  double noise_;
};

/// Whether there is a coat that stones may have or not have, or stand on.
double coat_of(const Diagnosis& d, double declared_mm) {
  double coat = declared_mm;
  for (const Cause& c : d.causes)
    if (c.effect == "coating.thickness")
      for (const Estimate& e : c.parameters) coat += e.value;
  return coat;
}

Cause missing_cause(int number) {
  Cause c;
  c.effect = "stone.missing";
  c.law = fmt::format("stone {}", number);
  c.fixed = {{"stone", number}};
  c.separate_by = find_effect(c.effect)->separate_by;
  c.p_value = 0.0;
  return c;
}

Cause pose_cause(const scan::StoneFinding& f) {
  Cause c;
  c.effect = "stone.pose";
  c.law = fmt::format("stone {}", f.number);
  c.fixed = {{"stone", f.number}};
  c.separate_by = find_effect(c.effect)->separate_by;
  c.p_value = f.chance;
  const Vec3 turn = turn_of(f.actual_from_planned);
  const double tilt = 1e3 * f.sigma_tilt_rad;
  c.parameters = {{"dx_mm", f.shift_mm.x, f.sigma_shift_mm.x},
                  {"dy_mm", f.shift_mm.y, f.sigma_shift_mm.y},
                  {"dz_mm", f.shift_mm.z, f.sigma_shift_mm.z},
                  {"turn_x_mrad", turn.x, tilt},
                  {"turn_y_mrad", turn.y, tilt},
                  {"turn_z_mrad", turn.z, 1e3 * f.sigma_turn_rad}};
  return c;
}

/// The mean by which stones stand higher than `plan`, weighted, and its standard deviation; as a
/// multiple of `per`.
Size mean_rise(const std::vector<scan::StoneFinding>& found, const std::vector<double>& per) {
  double a = 0.0, b = 0.0;
  for (std::size_t k = 0; k < found.size(); ++k) {
    if (!has_pose(found[k])) continue;
    const double w = 1.0 / (found[k].sigma_shift_mm.z * found[k].sigma_shift_mm.z);
    a += w * per[k] * per[k];
    b += w * per[k] * found[k].shift_mm.z;
  }
  if (!(a > 0.0)) return {};
  return {b / a, 1.0 / std::sqrt(a), chi_squared_tail(b * b / a, 1)};
}

/// Stones brought to a common size by one law.
struct Resized {
  Resize by;
  double sigma = 0.0;
  double left = 0.0;    ///< what the other law would still gain
  bool either = false;  ///< the other law does as well: stones of one size
};

/// From a first guess, which is not linear, until the size comes to rest; then what they stand on.
/// none: they would be other stones.
Result<std::optional<Resized>> settle_size(const Against& all, const std::vector<PlacedStone>& plan,
                                           std::size_t law, double guess) {
  Resized r{{law == 0 ? kShare : kLength, guess}};
  std::vector<scan::StoneFinding> found;
  for (int round = 0; round < kRounds; ++round) {
    for (const PlacedStone& s : plan)
      if (!(std::abs(r.by.size(s)) < kLargestShare)) return std::nullopt;
    MAQUETTE_TRY(found, all.find(r.by.of_all(plan)));
    const Sizes sizes = sizes_of(found);
    const Size more = sizes.of(law);
    r.by.value += more.value;
    r.sigma = more.sigma;
    r.left = sizes.beside(law);
    if (!(std::abs(more.value) > 0.1 * more.sigma)) break;
  }
  std::vector<double> sinks;
  for (const PlacedStone& s : plan) sinks.push_back(r.by.sink_mm(s));
  r.by.rests = std::clamp(mean_rise(found, sinks).value, -1.0, 2.0);
  return r;
}

Cause shrink_cause(const Resized& resized, const Sizes& sizes, bool coat) {
  const bool share = resized.by.by == kShare;
  Cause c;
  c.effect = "stone.shrink";
  c.law = share ? "a share of all lengths" : "a length all over";
  c.parameters = {{resized.by.by, resized.by.value, resized.sigma}};
  c.fixed = {{"rests", resized.by.rests}};
  c.p_value = sizes.of(share ? 0 : 1).chance;
  // A film thickens all alike.
  if (!coat && resized.by.value > 0.0 && (!share || resized.either))
    c.equivalent = {"coating.thickness"};
  c.separate_by = find_effect(c.effect)->separate_by;
  return c;
}

}  // namespace

Result<void> apply_known(const std::vector<KnownCause>& known, StonePlan& plan) {
  for (const KnownCause& k : known) {
    const Effect* effect = find_effect(k.effect);
    if (effect == nullptr || effect->needs != Needs::stones) continue;
    if (k.effect == "stone.shrink") {
      if (k.parameters.empty()) continue;
      const Resize by{k.parameters[0].first, k.parameters[0].second, value_of(k.fixed, "rests")};
      plan.stones = by.of_all(plan.stones);
      continue;
    }
    const int number = static_cast<int>(std::lround(value_of(k.fixed, "stone")));
    const auto stone = std::find_if(plan.stones.begin(), plan.stones.end(),
                                    [&](const PlacedStone& s) { return s.number == number; });
    if (stone == plan.stones.end())
      return fail(kUnknownCause, fmt::format("[[cause]] {}: the plan has no stone {}; fixed_names "
                                             "= [\"stone\"], fixed_values = [its number]",
                                             k.effect, number));
    if (k.effect == "stone.missing") {
      plan.seats.erase(plan.seats.begin() + (stone - plan.stones.begin()));
      plan.stones.erase(stone);
      continue;
    }
    const auto value = [&](const char* name) { return value_of(k.parameters, name); };
    *stone = moved_stone(*stone, {value("dx_mm"), value("dy_mm"), value("dz_mm")},
                         {value("turn_x_mrad"), value("turn_y_mrad"), value("turn_z_mrad")});
  }
  return {};
}

Result<void> add_stone_causes(const Measurements& m, Diagnosis& d, const RunContext& run) {
  if (!m.stones || m.stones->points_mm.empty()) {
    for (const Effect& e : library())
      if (e.needs == Needs::stones) d.untestable.push_back(e.name);
    return {};
  }
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  const StonesSeen& stones = *m.stones;
  StonePlan expected = stones.plan;
  MAQUETTE_TRY_VOID(shift_seats(known_of(d.causes), m, expected));
  const double noise = std::sqrt(d.noise.point_mm2);
  const Against all(sighted(m, d, stones), stones, noise);
  std::vector<PlacedStone> plan = expected.stones;
  MAQUETTE_TRY(auto found, all.find(plan));
  std::vector<Cause> causes;

  const Sizes sizes = sizes_of(found);
  const double coat = coat_of(d, stones.coat_mm);
  if (sizes.stones > 0 && std::fmin(sizes.of(0).chance, sizes.of(1).chance) < kClaimLevel) {
    std::optional<Resized> best;
    for (const std::size_t law : {0U, 1U}) {
      MAQUETTE_TRY(auto resized, settle_size(all, expected.stones, law, sizes.of(law).value));
      if (!resized) continue;
      const bool as_good = best && std::abs(resized->left - best->left) < kAsGood;
      if (!best || resized->left < best->left) best = std::move(resized);
      best->either = as_good;
    }
    if (best) {
      const double value = best->by.value, sigma = best->sigma;
      const bool film = coat > 0.0 && best->by.by == kLength && value > -3.0 * sigma &&
                        value < coat + 3.0 * sigma;
      if (film)
        d.notes.push_back(fmt::format(
            "stones have a film of {:.3g} mm, within the coat of {:.3g} mm", value, coat));
      else
        causes.push_back(shrink_cause(*best, sizes, coat > 0.0));
      plan = best->by.of_all(expected.stones);
      MAQUETTE_TRY(found, all.find(plan));
    }
  }
  if (coat > 0.0) {
    const Size rise = mean_rise(found, std::vector<double>(found.size(), 1.0));
    if (rise.value > -3.0 * rise.sigma && rise.value < coat + 3.0 * rise.sigma) {
      for (PlacedStone& s : plan) s.model_from_stone.translation_mm.z += rise.value;
      MAQUETTE_TRY(found, all.find(plan));
    }
  }

  // No wider than a beam, a stone shows no shape.
  const double blur_mm =
      kBlurred * *std::min_element(stones.beams_mm.begin(), stones.beams_mm.end());
  std::vector<PlacedStone> as_found;
  StoneReport& report = d.stones.emplace();
  for (std::size_t k = 0; k < found.size(); ++k) {
    const scan::StoneFinding& f = found[k];
    std::string state(scan::name_of(f.state));
    if (f.state == scan::StoneState::missing) {
      causes.push_back(missing_cause(f.number));
    } else if (f.state == scan::StoneState::moved &&
               f.chance < kClaimLevel / static_cast<double>(found.size())) {
      causes.push_back(pose_cause(f));
    } else if (f.state == scan::StoneState::moved) {
      state = scan::name_of(scan::StoneState::as_planned);
    } else if (f.state == scan::StoneState::swapped) {
      report.unexplained.push_back(
          fmt::format("stone {} stands in the place of stone {}", f.carries, f.number));
    } else if (f.state == scan::StoneState::unclear && !(f.width_mm > blur_mm)) {
      state = "narrower than the scanner's beam";
    } else if (f.state == scan::StoneState::unclear) {
      report.unexplained.push_back(
          fmt::format("what stands in the place of stone {} is no stone of the plan", f.number));
    }
    report.states.emplace_back(f.number, state);
  }
  // Fitted to one half of the patches, measured on the other.
  if (!causes.empty()) {
    const Against fitted = all.half(false), rest = all.half(true);
    MAQUETTE_TRY(const auto again, fitted.find(plan));
    for (std::size_t k = 0; k < again.size(); ++k) {
      if (found[k].state == scan::StoneState::missing) continue;
      PlacedStone s = plan[k];
      const bool moved = std::any_of(causes.begin(), causes.end(), [&](const Cause& c) {
        return c.effect == "stone.pose" && c.fixed[0].second == s.number;
      });
      if (moved && has_pose(again[k]))
        s.model_from_stone = again[k].actual_from_planned * s.model_from_stone;
      as_found.push_back(std::move(s));
    }
    MAQUETTE_TRY(report.rms_before, rest.rms(expected.stones, expected.stones, &report.points));
    MAQUETTE_TRY(report.rms_after, rest.rms(as_found, expected.stones, nullptr));
    report.rms_noise = noise;
    const double excess = std::fmax(1e-12, report.rms_before * report.rms_before - noise * noise);
    const double left = std::fmax(0.0, report.rms_after * report.rms_after - noise * noise);
    for (Cause& c : causes)
      c.share = std::clamp(1.0 - left / excess, 0.0, 1.0) / static_cast<double>(causes.size());
  }
  for (const std::string& what : report.unexplained) d.notes.push_back(what);
  d.causes.insert(d.causes.end(), causes.begin(), causes.end());
  return {};
}

Result<StonesSeen> simulated_stones(const Measurements& m, const Diagnosis& d, bool causes,
                                    std::uint64_t seed) {
  StonesSeen stones = *m.stones;
  const Against all(sighted(m, d, stones), *m.stones, std::sqrt(d.noise.point_mm2));
  StonePlan standing = stones.plan;
  if (causes) {
    const std::vector<KnownCause> known = known_of(d.causes);
    MAQUETTE_TRY_VOID(shift_seats(known, m, standing));
    MAQUETTE_TRY_VOID(apply_known(known, standing));
  }
  MAQUETTE_TRY(auto points, all.simulated(standing.stones, seed));
  // Back into the frame of each file, as wrong as its pose was found to be.
  for (std::size_t u = 0; u < points.size(); ++u) {
    const SetUp& set_up = m.set_ups[u];
    const RigidTransform back = set_up.model_from_file.inverse();
    for (Vec3& p : points[u]) p = back.point(p + pose_error(p, d.poses[u], set_up));
  }
  stones.points_mm = std::move(points);
  std::fill(stones.beams_mm.begin(), stones.beams_mm.end(), 0.0);
  return stones;
}

}  // namespace detail
}  // namespace maquette::diagnosis
