// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/case_input.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "core/mask.hpp"
#include "core/median.hpp"
#include "core/random.hpp"
#include "diagnosis/detail/incidence_laws.hpp"
#include "diagnosis/detail/stones.hpp"
#include "diagnosis/detail/sums.hpp"
#include "diagnosis/probe_table.hpp"
#include "diagnosis/surface.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/stones.hpp"
#include "scan/register.hpp"

namespace maquette::diagnosis {
namespace {

constexpr double kBorder_mm = 1.0;  // the outermost rim is edge, not surface
constexpr std::size_t kSettle = 20'000;
constexpr double kGrazing = 0.1;  // least cosine of incidence at which a beam's foot is looked for
// And at which a point is used: more obliquely, edges hide what is behind them, and small errors of
// the slope are large ones of the range.
constexpr double kOblique = 0.25;
constexpr double kOtherPart_mm = 0.75;    // robust spread of residuals after settling
constexpr double kProbeSigma_mm = 0.005;  // where the table does not say
constexpr double kBesideStone_mm = 3.0;   // a beam's width and what stones hide
constexpr double kOtherProgram_mm = 0.5;  // robust spread of cut minus design

struct Loaded {
  SetUp set_up;
  std::vector<Vec3> points;
  std::optional<Vec3> station;
  double sigma = 0.05, beam_mm = 0.0;
};

/// Share of the surface over which passes of quite other times lie no higher than that above those
/// that made it.
double share_beside_other_times(const std::vector<Observation>& all, double above_mm) {
  constexpr double kOtherTime = 0.1;
  std::size_t with_passes = 0, beside = 0;
  for (const Observation& o : all) {
    if (!o.rivals || !(o.path_share >= 0.0)) continue;
    ++with_passes;
    beside += std::any_of(o.rivals->begin(), o.rivals->end(), [&](const Rival& r) {
      return r.above_mm < above_mm && std::abs(r.state.path_share - o.path_share) > kOtherTime;
    });
  }
  return with_passes == 0 ? 0.0 : static_cast<double>(beside) / static_cast<double>(with_passes);
}

/// Whether over much of the surface a few hundredths up or down make other passes the surface.
bool do_passes_cross(const std::vector<Observation>& all) {
  constexpr double kClose_mm = 0.03, kShare = 0.2;
  return share_beside_other_times(all, kClose_mm) > kShare;
}

/// Whether there is a border along which they would, two or three passes wide.
bool do_passes_meet(const std::vector<Observation>& all) {
  constexpr double kShare = 0.003;
  return share_beside_other_times(all, kRivalHeight_mm) > kShare;
}

/// Offset of a point along the simulated surface's normal, coat taken off.
std::optional<double> offset(const SimulatedSurface& surface, const Box3& box, Vec3 p, double coat,
                             Vec3* normal) {
  if (p.x < box.min.x + kBorder_mm || p.x > box.max.x - kBorder_mm ||
      p.y < box.min.y + kBorder_mm || p.y > box.max.y - kBorder_mm)
    return std::nullopt;
  const auto place = surface.at(p.x, p.y);
  if (!place) return std::nullopt;
  if (normal != nullptr) *normal = place->normal;
  return (p.z - place->height_mm) * place->normal.z - coat;
}

/// Robust point-to-plane on the simulated surface, from the pose that it has.
/// @param long_beams  beside a range error that grows by it; null: none
double settle(Loaded& scan, const SimulatedSurface& surface, const Box3& box, double coat,
              std::uint64_t seed, const detail::IncidenceLaw* long_beams = nullptr) {
  std::vector<Vec3> some;
  const std::size_t n = scan.points.size(), m = std::min(n, kSettle);
  for (std::size_t k = 0; k < m; ++k)
    some.push_back(scan.points[n <= kSettle ? k : random_bits(seed, k) % n]);
  RigidTransform& pose = scan.set_up.model_from_file;
  // Where beams are bent aside by a millimetre the places move, and what they say of the beams.
  const int rounds = long_beams != nullptr ? 24 : 8;
  std::vector<double> law(some.size(), 0.0);
  double long_mm = 0.0, spread = INFINITY;
  for (int round = 0; round < rounds; ++round) {
    std::vector<double> e(some.size(), NAN), by_law(some.size(), 0.0);
    std::vector<Vec3> normal(some.size()), place(some.size());
    oneapi::tbb::parallel_for(std::size_t{0}, some.size(), [&](std::size_t i) {
      place[i] = pose.point(some[i]);
      Vec3 beam;
      if (long_beams != nullptr) {
        beam = normalized(place[i] - pose.point(*scan.station));
        place[i] = place[i] - long_mm * law[i] * beam;
      }
      const auto d = offset(surface, box, place[i], coat, &normal[i]);
      if (!d || !(std::abs(*d) < 20.0)) return;
      e[i] = *d;
      if (long_beams == nullptr) return;
      const Vec3 slope = surface.slope_normal(place[i].x, place[i].y).value_or(normal[i]);
      law[i] = long_beams->of(std::fmax(kOblique, -dot(beam, slope)));
      by_law[i] = -law[i] * dot(beam, normal[i]);
    });
    std::vector<double> known;
    Vec3 centre;
    for (std::size_t i = 0; i < e.size(); ++i)
      if (!std::isnan(e[i])) {
        known.push_back(e[i]);
        centre += place[i];
      }
    if (known.size() < 30) return INFINITY;
    centre = (1.0 / static_cast<double>(known.size())) * centre;
    spread = nmad(known);
    const double middle = median(known), cut = std::fmax(1e-4, 2.0 * spread);
    using Vector7 = Eigen::Matrix<double, 7, 1>;
    Eigen::Matrix<double, 7, 7> a = Eigen::Matrix<double, 7, 7>::Zero();
    Vector7 b = Vector7::Zero();
    const double arm = 0.3 * norm(box.max - box.min);
    for (std::size_t i = 0; i < e.size(); ++i) {
      if (std::isnan(e[i])) continue;
      const double w = std::fmin(1.0, cut / std::fmax(1e-12, std::abs(e[i] - middle)));
      const Vec3 turn = (1.0 / arm) * cross(place[i] - centre, normal[i]);
      Vector7 j;
      j << normal[i].x, normal[i].y, normal[i].z, turn.x, turn.y, turn.z, by_law[i];
      a += w * j * j.transpose();
      b += w * j * e[i];
    }
    // What the relief hardly determines stays where it is.
    a.diagonal().array() += 1e-5 * a.trace();
    const Vector7 step = -a.ldlt().solve(b);
    const Vec3 turn{step(3) / arm, step(4) / arm, step(5) / arm};
    RigidTransform update;
    if (norm(turn) > 0.0) update.rotation = rotation_about(normalized(turn), norm(turn));
    update.translation_mm =
        centre - rotate(update.rotation, centre) + Vec3{step(0), step(1), step(2)};
    pose = update * pose;
    pose.rotation = normalized(pose.rotation);
    long_mm += step(6);
    if (step.norm() < 1e-4) break;
  }
  return spread;
}

/// A model that has them already is read as it was found.
bool reads_long(const std::vector<KnownCause>& known) {
  return std::any_of(known.begin(), known.end(),
                     [](const KnownCause& k) { return k.effect == "scanner.incidence_bias"; });
}

/// Settles a scan beside the law of long beams that brings its points closest to the surface.
/// @return their spread (mm) where that is much closer than without one
std::optional<double> settle_beside_long_beams(Loaded& scan, double spread,
                                               const SimulatedSurface& surface, const Box3& box,
                                               double coat, std::uint64_t seed) {
  constexpr double kCloser = 0.95;
  double best = kCloser * spread;
  const Loaded as_it_is = scan;
  for (const detail::IncidenceLaw& law : detail::kIncidenceLaws) {
    Loaded with = as_it_is;
    const double its = settle(with, surface, box, coat, seed, &law);
    if (!(its < best)) continue;
    best = its;
    scan = std::move(with);
  }
  return best < kCloser * spread ? std::optional(best) : std::nullopt;
}

/// Points that stand alone far from their neighbours: mixed pixels, dust.
/// @return their places
std::vector<Vec3> drop_lonely(std::vector<Observation>& all, std::size_t from) {
  constexpr double kSquare_mm = 2.0;
  std::vector<std::pair<std::uint64_t, std::size_t>> order;
  for (std::size_t i = from; i < all.size(); ++i)
    order.emplace_back((static_cast<std::uint64_t>((all[i].place.y + 1e6) / kSquare_mm) << 32) |
                           static_cast<std::uint64_t>((all[i].place.x + 1e6) / kSquare_mm),
                       i);
  std::sort(order.begin(), order.end());
  std::vector<double> about(all.size(), 0.0), spread;
  for (std::size_t i = 0; i < order.size();) {
    std::size_t j = i;
    std::vector<double> here;
    for (; j < order.size() && order[j].first == order[i].first; ++j)
      here.push_back(all[order[j].second].residual_mm);
    const double m = median(std::move(here));
    for (; i < j; ++i) about[order[i].second] = all[order[i].second].residual_mm - m;
  }
  for (std::size_t i = from; i < all.size(); ++i) spread.push_back(about[i]);
  const double limit = 6.0 * std::fmax(1e-4, nmad(spread));
  std::size_t kept = from;
  std::vector<Vec3> dropped;
  for (std::size_t i = from; i < all.size(); ++i)
    if (std::abs(about[i]) <= limit)
      all[kept++] = all[i];
    else
      dropped.push_back(all[i].place);
  all.resize(kept);
  return dropped;
}

/// Squares of the part where many points of a scan stray, unlike the rest.
struct Gathered {
  Vec3 place;
  double share = 0.0, elsewhere = 0.0;  ///< of the points there; in the typical square
};
/// Dust and mixed pixels are a few in a thousand, and as many everywhere; a smudge, a wet place or
/// a reflex makes many in one.
std::optional<Gathered> where_strays_gather(const std::vector<Observation>& all, std::size_t from,
                                            const std::vector<Vec3>& strays, const Box3& box) {
  constexpr double kSquares = 16.0;  // along the longer side
  constexpr double kFewest = 100.0, kShare = 0.04, kOverTypical = 8.0;
  constexpr std::size_t kSquaresWanted = 3;
  const double side = std::fmax(box.max.x - box.min.x, box.max.y - box.min.y) / kSquares;
  struct Square {
    double points = 0.0, strays = 0.0;
    Vec3 sum;
  };
  std::map<std::pair<int, int>, Square> squares;
  const auto at = [&](Vec3 p) -> Square& {
    return squares[{static_cast<int>((p.y - box.min.y) / side),
                    static_cast<int>((p.x - box.min.x) / side)}];
  };
  for (std::size_t i = from; i < all.size(); ++i) at(all[i].place).points += 1.0;
  for (const Vec3& p : strays) {
    Square& s = at(p);
    s.points += 1.0;
    s.strays += 1.0;
    s.sum += p;
  }
  std::vector<double> shares;
  for (const auto& [key, s] : squares)
    if (s.points >= kFewest) shares.push_back(s.strays / s.points);
  if (shares.size() < 30) return std::nullopt;
  Gathered out{{}, 0.0, median(shares)};
  const double limit = std::fmax(kShare, kOverTypical * out.elsewhere);
  Square all_of_it;
  std::size_t many = 0;
  for (const auto& [key, s] : squares) {
    if (s.points < kFewest || s.strays < limit * s.points) continue;
    ++many;
    all_of_it.points += s.points;
    all_of_it.strays += s.strays;
    all_of_it.sum += s.sum;
  }
  if (many < kSquaresWanted) return std::nullopt;
  out.share = all_of_it.strays / all_of_it.points;
  out.place = (1.0 / all_of_it.strays) * all_of_it.sum;
  return out;
}

/// Two directions along a surface, in the planes of x and of y.
std::array<Vec3, 2> sides_of(Vec3 normal) {
  return {normalized(cross(normal, Vec3{0.0, 1.0, 0.0})),
          normalized(cross(normal, Vec3{-1.0, 0.0, 0.0}))};
}

/// Have rows with heights been measured along the surface, too? A touched point whose ball has been
/// taken off lies on the normal through its nominal place; along the surface it says nothing, or
/// how well that place was approached. One touched from above has its nominal x and y, and what it
/// is off in z is partly along a slope. Marks move along the surface as they do along its normal,
/// all of them together; where nothing shows that, points were touched: taken for marks that stayed
/// where they were, they forbid that the part is lower.
bool are_marks(const std::vector<ProbeRow>& rows, const SimulatedSurface& surface) {
  constexpr double kLeast = 0.3, kMost = 20.0;  // of the stated standard deviation
  constexpr double kMove = 5.0;                 // F: by chance 3 % of 9 rows, 0.02 % of 20
  constexpr double kAlike = 0.5, kNoise = 4.0;  // of squares along the normal; of noise
  constexpr Eigen::Index kUnknowns = 12, kDirections = 3;
  // A shift that changes with place, seen along two directions of the surface and its normal; and
  // what is found, over its standard deviation.
  Eigen::MatrixXd all(kDirections * static_cast<Eigen::Index>(rows.size()), kUnknowns + 1);
  std::vector<double> in_plan;
  Eigen::Index n = 0;
  for (const ProbeRow& row : rows) {
    const auto place = surface.at(row.x_nominal_mm, row.y_nominal_mm);
    const auto normal = surface.slope_normal(row.x_nominal_mm, row.y_nominal_mm);
    if (!place || !normal || !row.z_mm) continue;
    const double z = row.z_nominal_mm.value_or(place->height_mm);
    const Vec3 d{row.x_mm - row.x_nominal_mm, row.y_mm - row.y_nominal_mm, *row.z_mm - z};
    const double sigma = row.sigma_mm.value_or(kProbeSigma_mm);
    in_plan.push_back(std::hypot(d.x, d.y) / sigma);
    const auto sides = sides_of(*normal);
    for (const Vec3 v : {sides[0], sides[1], *normal}) {
      const double at[4] = {1.0, row.x_nominal_mm, row.y_nominal_mm, z}, along[3] = {v.x, v.y, v.z};
      for (Eigen::Index i = 0; i < kUnknowns; ++i) all(n, i) = along[i / 4] * at[i % 4] / sigma;
      all(n++, kUnknowns) = dot(v, d) / sigma;
    }
  }
  const auto points = n / kDirections;
  if (2 * points <= kUnknowns + 5 || !(median(std::move(in_plan)) > kLeast)) return false;
  std::vector<Eigen::Index> along, across;
  for (Eigen::Index i = 0; i < n; ++i) (i % kDirections == 2 ? along : across).push_back(i);
  const Eigen::VectorXd y = all.col(kUnknowns)(across);
  const Eigen::VectorXd move =
      all.leftCols(kUnknowns)(across, Eigen::all).completeOrthogonalDecomposition().solve(y);
  const Eigen::VectorXd rest =
      all.col(kUnknowns).head(n) - all.leftCols(kUnknowns).topRows(n) * move;
  const double noise = rest(across).squaredNorm() / static_cast<double>(2 * points - kUnknowns);
  std::vector<double> spread;
  for (Eigen::Index i = 0; i < n; i += kDirections) spread.push_back(rest.segment(i, 2).norm());
  const double middle = median(std::move(spread));
  if (!(middle > kLeast && middle < kMost)) return false;
  const double moved = (y.squaredNorm() - rest(across).squaredNorm()) / kUnknowns,
               off = all.col(kUnknowns)(along).squaredNorm();
  return moved > kMove * noise &&
         rest(along).squaredNorm() <
             std::fmax(kAlike * off, kNoise * noise * static_cast<double>(points));
}

/// Nodes of the design that have a stone within reach of a beam that grazes it.
Grid<std::uint8_t> beside_stones(const heightmap::ModelField& design,
                                 const heightmap::ModelField& ground) {
  const std::ptrdiff_t rows = design.z_mm.rows(), cols = design.z_mm.cols();
  const auto reach =
      static_cast<std::ptrdiff_t>(std::ceil(kBesideStone_mm / design.spacing.value()));
  Grid<std::uint8_t> beside(rows, cols, 0);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      beside(r, c) = design.z_mm(r, c) - ground.z_mm(r, c) > kStone_mm;
  widen(beside, reach);
  return beside;
}

/// What is about each stone of the plan, as far as points there may say something of it.
Grid<std::uint8_t> about_stones(const heightmap::ModelField& ground,
                                const std::vector<meshing::PlacedStone>& plan) {
  Grid<std::uint8_t> about(ground.z_mm.rows(), ground.z_mm.cols(), 0);
  const double spacing = ground.spacing.value();
  for (const auto& stone : plan) {
    const Box3 box = meshing::stone_mesh(stone).bounds();
    const Vec3 middle = 0.5 * (box.min + box.max);
    const double reach = kAboutStone * 0.5 * norm(box.max - box.min);
    const auto node = [&](double mm, double from, std::ptrdiff_t count) {
      return std::clamp<std::ptrdiff_t>(std::lround((mm - from) / spacing), 0, count - 1);
    };
    for (auto r = node(middle.y - reach, ground.y0.value(), about.rows());
         r <= node(middle.y + reach, ground.y0.value(), about.rows()); ++r)
      for (auto c = node(middle.x - reach, ground.x0.value(), about.cols());
           c <= node(middle.x + reach, ground.x0.value(), about.cols()); ++c)
        about(r, c) = 1;
  }
  return about;
}

/// The plan with what is known of it, and the ground about it; points are added by set-up.
/// @param about  becomes what is about the stones
Result<StonesSeen> read_stones(const CaseInput& input, const heightmap::ModelField& ground,
                               const SimulatedSurface& surface, Grid<std::uint8_t>& about) {
  StonesSeen seen;
  MAQUETTE_TRY(seen.plan.stones, meshing::read_stone_plan(input.stones));
  for (const auto& stone : seen.plan.stones) {
    const Vec3 at = stone.model_from_stone.translation_mm;
    seen.plan.seats.push_back(surface.observe(at.x, at.y));
  }
  MAQUETTE_TRY_VOID(detail::apply_known(input.known, seen.plan));
  seen.ground = ground;
  seen.coat_mm = input.coat_mm;
  about = about_stones(ground, seen.plan.stones);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, about.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < about.cols(); ++c)
      if (about(r, c) != 0)
        if (const auto at = surface.at(ground.x_mm(c), ground.y_mm(r)))
          seen.ground.z_mm(r, c) = static_cast<float>(at->height_mm + input.coat_mm / at->normal.z);
  });
  return seen;
}

}  // namespace

bool cut_by_tip(Observation& o, const Scene& scene) {
  const auto above = scene.above(o.place.x, o.place.y);
  if (!above) return false;
  static_cast<CutState&>(o) = *above;
  o.tip = o.level_tip = o.place;
  o.by_tip = true;
  o.rivals.reset();
  o.pass.reset();
  if (!o.on_surface) return true;
  // Without the slopes of ridges. A point is off along its beam, or upright.
  const Vec3 way = o.has_station ? o.beam : Vec3{0.0, 0.0, 1.0};
  const double flatter = dot(way, o.slope_normal) / dot(way, o.normal);
  o.residual_mm = flatter * (o.residual_mm + scene.coat_mm) - scene.coat_mm;
  o.milled_minus_design_mm *= o.slope_normal.z / o.normal.z;
  o.normal = o.along = o.slope_normal;
  return true;
}

void cut_by_tips(Measurements& m) {
  oneapi::tbb::parallel_for(std::size_t{0}, m.observations.size(),
                            [&](std::size_t i) { (void)cut_by_tip(m.observations[i], m.scene); });
  m.scene.passes_cross = m.scene.passes_meet = false;
  m.contact = MadeBy::tip;
}

Result<std::optional<heightmap::ModelField>> read_ground(const CaseInput& input,
                                                         const heightmap::ModelField& design) {
  if (input.ground.empty()) return std::nullopt;
  MAQUETTE_TRY(auto ground, heightmap::read_model_field(input.ground));
  if (ground.z_mm.rows() != design.z_mm.rows() || ground.z_mm.cols() != design.z_mm.cols())
    return fail(kOtherPart,
                fmt::format("{} has {} x {} nodes, {} has {} x {}; expected the same surface "
                            "without its stones",
                            input.ground.string(), ground.z_mm.cols(), ground.z_mm.rows(),
                            input.design.string(), design.z_mm.cols(), design.z_mm.rows()));
  return std::optional(std::move(ground));
}

Result<Measurements> measure(const CaseInput& input, const RunContext& run) {
  Measurements m;
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(input.design));
  MAQUETTE_TRY(const auto ground, read_ground(input, design));
  Grid<std::uint8_t> stones;
  if (ground) {
    stones = beside_stones(design, *ground);
    const auto marked = std::count(stones.cells().begin(), stones.cells().end(), 1);
    if (marked > 0)
      m.notes.push_back(fmt::format(
          "points within {} mm of a stone ({:.1f} % of the surface) say nothing of the ground; {}",
          kBesideStone_mm,
          100.0 * static_cast<double>(marked) / static_cast<double>(stones.cells().size()),
          input.stones.empty() ? "without the plan (stones = ...) the stones are not judged"
                               : "the stones are judged one by one"));
  }
  const heightmap::ModelField& milled = ground ? *ground : design;
  const auto on_stone = [&](double x, double y) {
    if (stones.rows() == 0) return false;
    const auto row = std::lround((y - design.y0.value()) / design.spacing.value());
    const auto col = std::lround((x - design.x0.value()) / design.spacing.value());
    return stones.contains(row, col) && stones(row, col) != 0;
  };
  const double ball_radius_mm = 0.5 * input.ball_diameter_mm;
  std::optional<CutPath> path;
  if (!input.programs.empty()) {
    MAQUETTE_TRY(auto read, CutPath::read(input.programs, ball_radius_mm, run));
    path.emplace(std::move(read));
  } else {
    m.notes.push_back(
        "no program given: causes that depend on direction, order or time of the cut cannot be "
        "tested");
  }
  m.scene = scene_of(design, path ? &*path : nullptr, ball_radius_mm);
  m.scene.coat_mm = input.coat_mm;
  const SimulatedSurface surface(milled, path ? &*path : nullptr, run);
  if (path && (surface.cut_share() < 0.3 || !(surface.program_misfit_mm() < kOtherProgram_mm)))
    return fail(
        kOtherProgram,
        fmt::format("{} does not belong to {}: cut in simulation it reaches {:.0f} % of the design "
                    "and differs from it by {:.3g} mm (robust spread; at most {} mm); give the "
                    "program that made the part",
                    input.programs[0].string(), input.design.string(), 100.0 * surface.cut_share(),
                    surface.program_misfit_mm(), kOtherProgram_mm));
  std::optional<StonesSeen> seen_stones;
  Grid<std::uint8_t> about;
  if (!input.stones.empty() && ground) {
    MAQUETTE_TRY(seen_stones, read_stones(input, *ground, surface, about));
  } else if (!input.stones.empty()) {
    m.notes.push_back("stones without ground (the design without them) cannot be judged");
  }
  run.progress(0.2);

  std::vector<Loaded> scans;
  for (const ScanInput& s : input.scans) {
    MAQUETTE_TRY(auto cloud, scan::read_cloud(s.points, run));
    MAQUETTE_TRY_VOID(scan::check_unit(cloud, design));
    Loaded l;
    l.set_up.name = s.points.filename().string();
    l.set_up.points = cloud.points_mm.size();
    l.station = s.station_mm ? s.station_mm : cloud.station_mm;
    if (!l.station)
      m.notes.push_back(
          fmt::format("{}: no scanner position: causes of the scanner cannot be tested with it",
                      l.set_up.name));
    l.sigma = s.range_sigma_mm;
    l.beam_mm = s.beam_mm;
    const std::size_t most = input.most_points / input.scans.size(), n = cloud.points_mm.size();
    if (n > most) {
      for (std::size_t k = 0; k < most; ++k) {
        const std::size_t first = k * n / most, end = (k + 1) * n / most;
        l.points.push_back(
            cloud.points_mm[first + random_bits(input.seed ^ 0x5ca9, k) % (end - first)]);
      }
    } else {
      l.points = std::move(cloud.points_mm);
    }
    double spread = settle(l, surface, m.scene.box, input.coat_mm, input.seed);
    if (!(spread < 0.3)) {  // too far for a local fit
      scan::Cloud some;
      some.points_mm = l.points;
      if (const auto alignment = scan::register_scan(some, design, {}, run)) {
        Loaded again = l;
        again.set_up.model_from_file = alignment->model_from_scan;
        const double better = settle(again, surface, m.scene.box, input.coat_mm, input.seed);
        if (better < spread) {
          l = std::move(again);
          spread = better;
        }
      }
    }
    if (!(spread < kOtherPart_mm))
      return fail(
          kOtherPart,
          fmt::format(
              "{} does not follow {}: after registration the points are {:.3g} mm off (robust "
              "spread; at most {} mm); is this the scan of another part, or in another frame?",
              s.points.string(), input.design.string(), spread, kOtherPart_mm));
    if (l.station && (input.beside_long_beams || reads_long(input.known))) {
      if (const auto closer = settle_beside_long_beams(l, spread, surface, m.scene.box,
                                                       input.coat_mm, input.seed)) {
        m.beside_long_beams = true;
        m.notes.push_back(fmt::format(
            "{}: settled beside beams that read long where they are oblique; its points "
            "come to {:.3g} mm of the surface so (robust spread), {:.3g} without",
            l.set_up.name, *closer, spread));
      }
    }
    scans.push_back(std::move(l));
    run.progress(0.2 +
                 0.4 * static_cast<double>(scans.size()) / static_cast<double>(input.scans.size()));
  }
  for (const Loaded& l : scans) {
    const auto index = static_cast<std::uint32_t>(m.set_ups.size());
    SetUp set_up = l.set_up;
    std::vector<Observation> made(l.points.size());
    std::vector<std::uint8_t> good(l.points.size(), 0);
    const std::optional<Vec3> station =
        l.station ? std::optional(set_up.model_from_file.point(*l.station)) : std::nullopt;
    std::optional<SpotView> spots;
    if (station) spots.emplace(surface.spots(*station));
    std::atomic<std::size_t> oblique{0}, ends{0};
    oneapi::tbb::parallel_for(std::size_t{0}, l.points.size(), [&](std::size_t i) {
      const Vec3 p = set_up.model_from_file.point(l.points[i]);
      if (p.x < m.scene.box.min.x + kBorder_mm || p.x > m.scene.box.max.x - kBorder_mm ||
          p.y < m.scene.box.min.y + kBorder_mm || p.y > m.scene.box.max.y - kBorder_mm)
        return;
      if (on_stone(p.x, p.y)) return;
      // The place is where the beam meets the simulated surface: seen from the point itself it
      // would carry the point's noise, and with it whatever is computed from it (two causes of
      // opposite sign can be sized so that they fit just that).
      Vec3 foot = p;
      double along_beam = 0.0;
      Vec3 beam;
      if (station) {
        beam = normalized(p - *station);
        // First where the beam meets the surface's nodes: over kinks and bends a long way is not
        // known by slopes at the point. Where it meets another flank, from the point.
        const double range = norm(p - *station);
        if (const auto way = surface.range_mm(*station, beam);
            way && std::abs(*way - range) <= input.reach_mm) {
          along_beam = *way - range;
          foot = p + along_beam * beam;
        }
        for (int step = 0; step < 2; ++step) {
          const auto near = surface.at(foot.x, foot.y);
          if (!near) return;
          const double e = (foot.z - near->height_mm) * near->normal.z - input.coat_mm;
          const double cosine = -dot(beam, near->normal);
          if (step == 0 && !(std::abs(e) <= input.reach_mm)) return;
          if (!(cosine > kGrazing)) break;
          along_beam += e / cosine;
          foot = p + along_beam * beam;
        }
      }
      auto seen = surface.observe(foot.x, foot.y);
      if (!seen) return;
      Observation& o = *seen;
      if (station && !(-dot(beam, o.slope_normal) > kOblique)) {
        ++oblique;
        return;
      }
      if (station && spots->at_an_end(o.place)) {
        ++ends;
        return;
      }
      o.residual_mm =
          (foot.z - o.place.z) * o.normal.z - input.coat_mm - along_beam * dot(beam, o.normal);
      if (!(std::abs(o.residual_mm) <= input.reach_mm)) return;
      o.sigma_mm = l.sigma;
      o.set_up = index;
      if (station) {
        o.has_station = true;
        o.range_mm = norm(foot - *station);
        o.beam = beam;
        o.spot = spots->further(o.place);
      }
      made[i] = std::move(o);
      good[i] = 1;
    });
    if (oblique > 0)
      m.notes.push_back(
          fmt::format("{}: {} points seen more obliquely than {:.0f} degrees are not used",
                      set_up.name, oblique.load(), std::acos(kOblique) * 57.29577951308232));
    if (ends > 0)
      m.notes.push_back(fmt::format(
          "{}: {} points within {:.3g} mm of where the surface ends or hides another are not used",
          set_up.name, ends.load(), spots->end_mm()));
    if (seen_stones) {
      auto& near = seen_stones->points_mm.emplace_back();
      for (const Vec3& q : l.points) {
        const Vec3 p = set_up.model_from_file.point(q);
        const auto row = std::lround((p.y - ground->y0.value()) / ground->spacing.value());
        const auto col = std::lround((p.x - ground->x0.value()) / ground->spacing.value());
        if (about.contains(row, col) && about(row, col) != 0) near.push_back(q);
      }
      seen_stones->stations_mm.push_back(l.station);
      seen_stones->beams_mm.push_back(l.beam_mm);
    }
    const std::size_t from = m.observations.size();
    Vec3 centre;
    for (std::size_t i = 0; i < made.size(); ++i)
      if (good[i]) {
        m.observations.push_back(made[i]);
        centre += made[i].place;
      }
    const std::size_t on_part = m.observations.size() - from;
    const auto strays = drop_lonely(m.observations, from);
    set_up.far = l.points.size() - on_part + strays.size();
    if (const auto there = where_strays_gather(m.observations, from, strays, m.scene.box)) {
      m.strays_gather = true;
      m.notes.push_back(
          fmt::format("{}: {:.0f} % of the points about ({:.0f}, {:.0f}) mm stray from the rest "
                      "there, elsewhere {:.1f} %: a smudge, a reflex or a wet place? They are not "
                      "used",
                      set_up.name, 100.0 * there->share, there->place.x, there->place.y,
                      100.0 * there->elsewhere));
    }
    set_up.used = m.observations.size() - from;
    set_up.centre_mm = (1.0 / static_cast<double>(std::max<std::size_t>(1, on_part))) * centre;
    m.scene.has_station.push_back(station.has_value());
    m.scene.stations.push_back(station.value_or(Vec3{}));
    m.set_ups.push_back(std::move(set_up));
  }
  for (const auto& file : input.probes) {
    MAQUETTE_TRY(const auto rows, read_probe_table(file));
    SetUp set_up;
    set_up.name = file.filename().string();
    set_up.scan = false;
    set_up.points = rows.size();
    const auto index = static_cast<std::uint32_t>(m.set_ups.size());
    const std::size_t from = m.observations.size();
    const bool marks = are_marks(rows, surface);
    if (marks)
      m.notes.push_back(
          fmt::format("{}: places are taken as measured along the surface, too: they have "
                      "moved there together, as they have along its normal",
                      set_up.name));
    // Nominal heights are the bare design's, or the coated part's: whichever they are nearer to.
    std::vector<double> over;
    for (const ProbeRow& row : rows)
      if (const auto place = surface.at(row.x_nominal_mm, row.y_nominal_mm);
          place && row.z_nominal_mm && row.z_mm)
        over.push_back((*row.z_nominal_mm - place->design_mm) * place->normal.z);
    const bool bare = !over.empty() && median(std::move(over)) < 0.5 * input.coat_mm;
    for (const ProbeRow& row : rows) {
      auto seen = surface.observe(row.x_nominal_mm, row.y_nominal_mm);
      if (!seen || on_stone(row.x_nominal_mm, row.y_nominal_mm)) continue;
      Observation& o = *seen;
      o.milled_minus_design_mm = 0.0;  // a nominal height is what it is
      o.set_up = index;
      const double coat_mm = bare || !row.z_nominal_mm ? input.coat_mm : 0.0;
      const double z = row.z_nominal_mm.value_or(o.place.z);
      o.sigma_mm = row.sigma_mm.value_or(kProbeSigma_mm);
      const Vec3 d{row.x_mm - row.x_nominal_mm, row.y_mm - row.y_nominal_mm,
                   row.z_mm ? *row.z_mm - z : 0.0};
      if (row.z_mm) {
        o.along = o.normal;
        o.residual_mm = dot(o.normal, d) - coat_mm;
        if (!(std::abs(o.residual_mm) <= input.reach_mm)) continue;
        m.observations.push_back(o);
        if (!marks) continue;
        o.on_surface = false;
        for (const Vec3 side : sides_of(o.normal)) {
          o.along = side;
          o.residual_mm = dot(side, d);
          m.observations.push_back(o);
        }
      } else if (std::hypot(d.x, d.y) <= input.reach_mm) {
        o.on_surface = false;
        o.along = {1.0, 0.0, 0.0};
        o.residual_mm = d.x;
        m.observations.push_back(o);
        o.along = {0.0, 1.0, 0.0};
        o.residual_mm = d.y;
        m.observations.push_back(o);
      }
    }
    set_up.used = m.observations.size() - from;
    set_up.centre_mm = m.scene.centre();
    m.scene.has_station.push_back(false);
    m.scene.stations.push_back({});
    m.set_ups.push_back(std::move(set_up));
  }
  if (m.observations.size() < kLeastMeasurements)
    return fail(
        kTooFewMeasurements,
        fmt::format("{} measurements lie on the part within {} mm of it; at least {} are needed",
                    m.observations.size(), input.reach_mm, kLeastMeasurements));
  const auto layout = detail::lay_out(m.scene.box, input.seed, !m.scene.section_starts.empty());
  std::set<int> blocks;
  for (const Observation& o : m.observations) blocks.insert(layout.block_of(o.place.x, o.place.y));
  if (blocks.size() < kLeastBlocks)
    return fail(kTooFewMeasurements,
                fmt::format("the measurements lie in {} of {} blocks of {:.3g} mm; at least {} are "
                            "needed, so that a cause can be confirmed where it was not chosen",
                            blocks.size(), layout.set_of_block.size(),
                            layout.cell_mm * static_cast<double>(layout.block), kLeastBlocks));
  m.scene.passes_cross = do_passes_cross(m.observations);
  m.scene.passes_meet = do_passes_meet(m.observations);
  m.contact = input.contact;
  if (path && m.contact == MadeBy::tip) cut_by_tips(m);
  MAQUETTE_TRY_VOID(take_off(input.known, m));
  if (seen_stones) {
    MAQUETTE_TRY_VOID(detail::shift_seats(input.known, m, seen_stones->plan));
    m.stones = std::make_shared<const StonesSeen>(std::move(*seen_stones));
  }
  const bool beams = std::any_of(scans.begin(), scans.end(),
                                 [](const Loaded& l) { return l.station.has_value(); });
  if (beams && !input.beside_long_beams && !m.beside_long_beams)
    m.settled_anew = [input](const RunContext& again) {
      CaseInput anew = input;
      anew.beside_long_beams = true;
      return measure(anew, again);
    };
  run.progress(0.7);
  return m;
}

}  // namespace maquette::diagnosis
