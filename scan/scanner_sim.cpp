// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/scanner_sim.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>

#include "core/random.hpp"
#include "scan/detail/beam.hpp"
#include "scan/detail/scan_scene.hpp"
#include "scan/detail/sight.hpp"
#include "scan/detail/stone_scene.hpp"
#include "scan/phase_range.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr double kReferenceRangeMm = 3000.0;
constexpr double kGrey = 0.5;
// Grey at a cosine of 0.01 and 3 m: what is darker is no noisier.
constexpr double kLeastNoiseSignal = 0.01 * kGrey;
constexpr std::int64_t kMostTogether = 8;
// Farther out than that, in 1/e^2 radii, is a thousandth of a beam.
constexpr double kOuterRing = 1.5;
// Depth within a beam, beyond a plane's, that is no edge even if ranges had no noise. Otherwise the
// noise is the limit: few rays err by a twentieth of the depth, with either sign.
constexpr double kLeastEdgeMm = 0.02;
// Of a line of sight that all directions of a column share: nearer to the vertical each goes alone.
constexpr double kLeastSine = 0.02;
// A cell of the terrain's profile costs as much as a sixteenth of a ray that goes alone.
constexpr std::int64_t kCellsOfRay = 16;
// Streams of random numbers beside that of the range noise.
constexpr std::uint64_t kTurnStream = 0x7475726e, kAzimuthStream = 0x617a696d,
                        kZenithStream = 0x7a656e69;

Result<void> check_options(const ScanOptions& o) {
  const assets::ScannerPreset& s = o.scanner;
  struct Limit {
    const char* what;
    double value, least, most;
  };
  const double turn = norm({o.station_rotation.x, o.station_rotation.y, o.station_rotation.z});
  const AngularErrors& a = o.angular;
  const RangeErrors& r = o.range;
  const Limit limits[] = {
      {"lines_per_turn", s.lines_per_turn, 4.0, 1e9},
      {"range_sigma_mm", s.range_sigma_mm, 0.0, 1e3},
      {"range_resolution_mm", s.range_resolution_mm, 0.0, 1e3},
      {"noise_exponent", s.noise_exponent, 0.0, 4.0},
      {"beam_diameter_mm", s.beam_diameter_mm, 0.0, 1e3},
      {"beam_divergence_mrad", s.beam_divergence_mrad, 0.0, 100.0},
      {"turns_per_s", s.turns_per_s, 1e-6, 1e6},
      {"largest_zenith_deg", s.largest_zenith_deg, 1.0, 180.0},
      {"least_signal", s.least_signal, 0.0, 1e6},
      {"footprint_rays", static_cast<double>(o.footprint_rays), 1.0, 10'000.0},
      {"edge_rays", static_cast<double>(o.edge_rays), 0.0, 10'000.0},
      {"max_points", static_cast<double>(o.max_points), 16.0, 1e12},
      {"station x", o.station_mm.x, -kLargestCoordinateMm, kLargestCoordinateMm},
      {"station y", o.station_mm.y, -kLargestCoordinateMm, kLargestCoordinateMm},
      {"station z", o.station_mm.z, -kLargestCoordinateMm, kLargestCoordinateMm},
      {"norm of the station's rotation", std::hypot(turn, o.station_rotation.w), 1.0 - 1e-9,
       1.0 + 1e-9},
      {"encoder_noise_rad", a.encoder_noise_rad, 0.0, 0.1},
      {"vertical_index_rad", a.vertical_index_rad, -0.1, 0.1},
      {"collimation_rad", a.collimation_rad, -0.1, 0.1},
      {"trunnion_rad", a.trunnion_rad, -0.1, 0.1},
      {"eccentricity_h_rad", a.eccentricity_h_rad, -0.1, 0.1},
      {"eccentricity_v_rad", a.eccentricity_v_rad, -0.1, 0.1},
      {"eccentricity_h_phase_rad", a.eccentricity_h_phase_rad, -1e3, 1e3},
      {"eccentricity_v_phase_rad", a.eccentricity_v_phase_rad, -1e3, 1e3},
      {"offset_mm", r.offset_mm, -1e3, 1e3},
      {"scale_ppm", r.scale_ppm, -1e5, 1e5},
      {"cyclic_mm", r.cyclic_mm, -1e3, 1e3},
      {"cyclic_phase_rad", r.cyclic_phase_rad, -1e3, 1e3},
      {"incidence_mm", r.incidence_mm, -1e3, 1e3},
  };
  for (const Limit& l : limits)
    if (!(l.value >= l.least && l.value <= l.most))
      return fail(kScanOptions, fmt::format("scanner: {} must be between {} and {} but is {}",
                                            l.what, l.least, l.most, l.value));
  double coarser = INFINITY;
  for (const double u : s.unambiguous_mm) {
    if (!(u > 0.0 && u < coarser))
      return fail(kScanOptions,
                  fmt::format("scanner: unambiguous_mm must fall from coarse to fine and be "
                              "positive but {} follows {}",
                              u, coarser));
    coarser = u;
  }
  if (s.unambiguous_mm.empty())
    return fail(kScanOptions, "scanner: unambiguous_mm needs at least one length");
  return {};
}

TriMesh box_around(const Box3& of, double margin) {
  const Vec3 out{margin, margin, margin}, a = of.min - out, b = of.max + out;
  TriMesh m;
  for (int i = 0; i < 8; ++i)
    m.vertices_mm.push_back(
        {(i & 1) != 0 ? b.x : a.x, (i & 2) != 0 ? b.y : a.y, (i & 4) != 0 ? b.z : a.z});
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

double sigma_of_signal(const assets::ScannerPreset& scanner, double signal) {
  return scanner.range_sigma_mm *
         std::pow(std::fmax(signal, kLeastNoiseSignal) / kGrey, -scanner.noise_exponent);
}

/// The scanner at its place: from a cell of the grid to a point.
class Instrument {
 public:
  Instrument(const ScanOptions& options, const detail::ScanScene& scene, double farthest_mm)
      : o_(options),
        scene_(scene),
        probes_(detail::beam_samples(options.footprint_rays)),
        waist_mm_(0.5 * options.scanner.beam_diameter_mm),
        divergence_rad_(1e-3 * options.scanner.beam_divergence_mrad),
        farthest_mm_(farthest_mm),
        exact_angles_(
            options.angular.encoder_noise_rad == 0.0 && options.angular.vertical_index_rad == 0.0 &&
            options.angular.collimation_rad == 0.0 && options.angular.trunnion_rad == 0.0 &&
            options.angular.eccentricity_h_rad == 0.0 &&
            options.angular.eccentricity_v_rad == 0.0) {
    if (waist_mm_ == 0.0 && divergence_rad_ == 0.0) probes_ = Samples(detail::beam_samples(1));
    if (probes_.rays.size() > 1 && options.edge_rays > options.footprint_rays) {
      outer_ = Samples(outer_ring());
      many_ = Samples(detail::beam_samples(options.edge_rays));
    }
    widest_mm_ = 1.01 * detail::beam_radius_mm(waist_mm_, divergence_rad_, farthest_mm);
  }

  /// No ray is farther from the beam's middle.
  [[nodiscard]] double beam_radius_mm() const { return probes_.outermost * widest_mm_; }

  /// To be called before measure().
  /// @param fan_rad  between a direction and the middle of those measured together, at most
  Result<void> find_stones(std::span<const TriMesh> stones, double fan_rad) {
    if (many_.rays.empty()) return {};
    const double margin = outer_.outermost * widest_mm_ + 1.01 * fan_rad * farthest_mm_;
    for (const TriMesh& stone : stones)
      if (!stone.triangles.empty()) around_stones_.push_back(box_around(stone.bounds(), margin));
    MAQUETTE_TRY(around_scene_, detail::StoneScene::build(around_stones_));
    return {};
  }

  struct Zenith {
    double angle, sine, cosine;
  };
  enum class Outcome { nothing, lost, point };
  /// Rays and what they meet.
  struct Rays {
    std::vector<detail::Ray> rays;
    std::vector<std::optional<heightmap::FieldHit>> ground;
    std::vector<std::optional<detail::Echo>> echoes;
  };
  /// What a few points need, kept for the next.
  struct Beam {
    std::vector<Vec3> shown, axes;
    Rays probes, more;
    std::vector<std::size_t> edges;
    std::vector<BeamReturn> returns;
  };
  struct Point {
    Vec3 place_mm;  // station's frame
    float intensity = 0.0F;
    Colour colour;
  };

  /// Directions one below the other in a column, in one walk over the terrain.
  /// @param ray  number of the first
  void measure(double azimuth, std::span<const Zenith> zenith, std::uint64_t ray, Beam& beam,
               std::span<Point> points, std::span<Outcome> outcomes) const {
    const std::size_t n = zenith.size(), each = probes_.rays.size();
    const double cos_azimuth = std::cos(azimuth), sin_azimuth = std::sin(azimuth);
    beam.shown.clear();
    beam.axes.clear();
    for (std::size_t j = 0; j < n; ++j) {
      const Zenith& z = zenith[j];
      beam.shown.push_back({z.sine * cos_azimuth, z.sine * sin_azimuth, z.cosine});
      beam.axes.push_back(rotate(o_.station_rotation,
                                 exact_angles_ ? beam.shown[j] : aim(azimuth, z.angle, ray + j)));
    }
    look(beam.axes, probes_, ray, beam.probes);
    for (std::size_t j = 0; j < n; ++j)
      outcomes[j] = answer(beam, beam.probes, probes_, j * each, beam.shown[j], ray + j, points[j]);
    if (!many_.rays.empty()) look_again(ray, beam, points, outcomes);
  }

  /// Do the directions of a column lie in one vertical plane, each one ray over whole terrain?
  [[nodiscard]] bool columns_are_planes() const {
    return probes_.rays.size() == 1 && exact_angles_ && o_.station_rotation.x == 0.0 &&
           o_.station_rotation.y == 0.0 && scene_.whole();
  }

  /// measure() of a whole column, in one walk along the terrain's profile.
  /// @pre columns_are_planes()
  void measure_plane(double azimuth, std::span<const Zenith> zenith, std::uint64_t ray, Beam& beam,
                     std::span<Point> points, std::span<Outcome> outcomes) const {
    const std::size_t n = zenith.size();
    const Vec3 horizontal{std::cos(azimuth), std::sin(azimuth), 0.0};
    const Vec3 across = rotate(o_.station_rotation, horizontal);
    beam.shown.resize(n);
    beam.axes.resize(n);
    beam.probes.rays.resize(n);
    beam.probes.echoes.resize(n);
    auto& echoes = beam.probes.echoes;
    for (std::size_t j = 0; j < n; ++j) {
      beam.shown[j] = zenith[j].sine * horizontal + Vec3{0.0, 0.0, zenith[j].cosine};
      beam.axes[j] = zenith[j].sine * across + Vec3{0.0, 0.0, zenith[j].cosine};
      beam.probes.rays[j] = {o_.station_mm, beam.axes[j]};
    }
    const auto steep = [](const Zenith& z) { return z.sine < kLeastSine; };
    const auto first = static_cast<std::size_t>(
        std::find_if_not(zenith.begin(), zenith.end(), steep) - zenith.begin());
    const auto last = static_cast<std::size_t>(
        std::find_if(zenith.begin() + static_cast<std::ptrdiff_t>(first), zenith.end(), steep) -
        zenith.begin());
    for (std::size_t j = 0; j < n; ++j)
      if (j < first || j >= last) echoes[j] = scene_.look(o_.station_mm, beam.axes[j]);
    scene_.look_across(o_.station_mm, across, std::span(beam.axes).subspan(first, last - first),
                       std::span(echoes).subspan(first, last - first));
    for (std::size_t j = 0; j < n; ++j)
      outcomes[j] = answer(beam, beam.probes, probes_, j, beam.shown[j], ray + j, points[j]);
  }

 private:
  /// Rays that stand for a beam.
  struct Samples {
    Samples() = default;
    explicit Samples(std::vector<detail::BeamSample> of) : rays(std::move(of)) {
      for (const detail::BeamSample& s : rays)
        outermost = std::max(outermost, std::hypot(s.x, s.y));
    }
    std::vector<detail::BeamSample> rays;
    double outermost = 0.0;  // in units of the 1/e^2 radius
  };

  /// Where a beam's last hundredth is, between the directions of seven rays.
  static std::vector<detail::BeamSample> outer_ring() {
    std::vector<detail::BeamSample> ring;
    for (int k = 0; k < 6; ++k)
      ring.push_back({kOuterRing * std::cos(kTurn * (k + 0.5) / 6.0),
                      kOuterRing * std::sin(kTurn * (k + 0.5) / 6.0), 0.0});
    return ring;
  }

  /// Follows the beams along `axes`, which lie close together.
  /// @param ray  number of the first; the next has the next
  void look(std::span<const Vec3> axes, const Samples& samples, std::uint64_t ray, Rays& to) const {
    const std::size_t n = axes.size(), all = n * samples.rays.size();
    to.rays.clear();
    for (std::size_t j = 0; j < n; ++j) add_rays(axes[j], samples, ray + j, to);
    to.ground.resize(all);
    to.echoes.resize(all);
    if (all == 1) {
      to.echoes[0] = scene_.look(o_.station_mm, axes[0]);
      return;
    }
    scene_.look(to.rays, to.ground, to.echoes);
  }

  void add_rays(Vec3 axis, const Samples& samples, std::uint64_t ray, Rays& to) const {
    if (samples.rays.size() == 1) {
      to.rays.push_back({o_.station_mm, axis});
      return;
    }
    const double turn = kTurn * random_uniform(o_.seed ^ kTurnStream, ray);
    const double cos_turn = std::cos(turn), sin_turn = std::sin(turn);
    for (const detail::BeamSample& sample : samples.rays)
      to.rays.push_back(detail::skew_ray(o_.station_mm, axis, waist_mm_, divergence_rad_, sample,
                                         cos_turn, sin_turn));
  }

  [[nodiscard]] bool near_stones(Vec3 axis) const {
    return around_scene_ && around_scene_->trace(o_.station_mm, axis, INFINITY).has_value();
  }

  /// Beams that pass an edge, with as many rays as that takes.
  /// @param beam  with what its probes have met; points and outcomes of these, which are replaced
  void look_again(std::uint64_t ray, Beam& beam, std::span<Point> points,
                  std::span<Outcome> outcomes) const {
    const std::size_t n = beam.axes.size();
    const auto edge = [&](std::size_t j, bool ring) {
      detail::BeamDepth depth;
      double first = 0.0;
      std::size_t met = 0, all = 0;
      const auto add = [&](const Samples& samples, const Rays& seen) {
        const std::size_t each = samples.rays.size();
        for (std::size_t i = 0; i < each; ++i, ++all) {
          const auto& echo = seen.echoes[j * each + i];
          if (!echo) continue;
          if (met++ == 0) first = echo->range_mm;
          depth.add(echo->range_mm - first, samples.rays[i].x, samples.rays[i].y);
        }
      };
      add(probes_, beam.probes);
      if (ring) add(outer_, beam.more);
      if (met == 0 || met < all) return met > 0;
      const double signal =
          outcomes[j] == Outcome::point ? static_cast<double>(points[j].intensity) : 0.0;
      return depth.beyond_plane_mm() > std::fmax(kLeastEdgeMm, sigma_of_signal(o_.scanner, signal));
    };
    bool some = false;
    for (std::size_t j = 0; j < n && !some; ++j) some = edge(j, false);
    if (!some && !near_stones(beam.axes[n / 2])) return;
    look(beam.axes, outer_, ray, beam.more);
    beam.edges.clear();
    for (std::size_t j = 0; j < n; ++j)
      if (edge(j, true)) beam.edges.push_back(j);
    for (const std::size_t j : beam.edges) {
      look(std::span(beam.axes).subspan(j, 1), many_, ray + j, beam.more);
      outcomes[j] = answer(beam, beam.more, many_, 0, beam.shown[j], ray + j, points[j]);
    }
  }
  /// What the detector makes of the echoes of one beam.
  Outcome answer(Beam& beam, const Rays& seen, const Samples& samples, std::size_t first,
                 Vec3 shown, std::uint64_t ray, Point& point) const {
    beam.returns.clear();
    double energy = 0.0, cos_mean = 0.0, strongest = 0.0;
    for (std::size_t i = 0; i < samples.rays.size(); ++i) {
      const auto& echo = seen.echoes[first + i];
      const detail::Ray& r = seen.rays[first + i];
      if (!echo) continue;
      SurfaceLook look;
      if (o_.paint) look = o_.paint(r.origin_mm + echo->range_mm * r.direction, echo->stone);
      const double nearness = kReferenceRangeMm / echo->range_mm;
      const double amplitude =
          samples.rays[i].weight * look.reflectance * echo->cos_incidence * nearness * nearness;
      beam.returns.push_back({echo->range_mm, amplitude});
      energy += amplitude;
      cos_mean += amplitude * echo->cos_incidence;
      if (amplitude > strongest) {
        strongest = amplitude;
        point.colour = look.colour;
      }
    }
    if (beam.returns.empty()) return Outcome::nothing;
    const assets::ScannerPreset& s = o_.scanner;
    const PhaseRange phase = phase_range(beam.returns, s.unambiguous_mm);
    if (!(phase.amplitude > 0.0) || phase.amplitude < s.least_signal) return Outcome::lost;
    double range = phase.range_mm + systematic_mm(phase.range_mm, cos_mean / energy);
    range += sigma_of_signal(s, phase.amplitude) * random_normal(o_.seed, ray);
    if (const double unit = s.range_resolution_mm; unit > 0.0)
      range = unit * std::round(range / unit);
    if (!(range > 0.0)) return Outcome::lost;
    point.place_mm = range * shown;
    point.intensity = static_cast<float>(phase.amplitude);
    return Outcome::point;
  }

  [[nodiscard]] Vec3 aim(double azimuth, double zenith, std::uint64_t ray) const {
    const AngularErrors& e = o_.angular;
    detail::Angles a = detail::true_angles(e, o_.second_face, azimuth, zenith);
    if (e.encoder_noise_rad > 0.0) {
      a.azimuth += e.encoder_noise_rad * random_normal(o_.seed ^ kAzimuthStream, ray);
      a.zenith += e.encoder_noise_rad * random_normal(o_.seed ^ kZenithStream, ray);
    }
    return detail::direction_of(a.azimuth, a.zenith);
  }

  [[nodiscard]] double systematic_mm(double range, double cos_incidence) const {
    const RangeErrors& e = o_.range;
    double sum = e.offset_mm + 1e-6 * e.scale_ppm * range;
    if (e.cyclic_mm != 0.0)
      sum += e.cyclic_mm *
             std::sin(kTurn * range / o_.scanner.unambiguous_mm.back() + e.cyclic_phase_rad);
    if (e.incidence_mm != 0.0)
      sum += e.incidence_mm * std::fmin(100.0, 1.0 / (cos_incidence * cos_incidence) - 1.0);
    return sum;
  }

  const ScanOptions& o_;
  const detail::ScanScene& scene_;
  // Boxes: whatever passes beside one is nowhere near its stone.
  std::vector<TriMesh> around_stones_;
  std::optional<detail::StoneScene> around_scene_;
  Samples probes_, outer_, many_;  // the last two where edges are looked at again
  double waist_mm_, divergence_rad_, farthest_mm_;
  double widest_mm_ = 0.0;  // 1/e^2 radius of the beam at the farthest
  bool exact_angles_;
};

/// The box as the station sees it, wide enough for a beam whose middle passes beside it.
Box3 seen_box(const Box3& box, const RigidTransform& station_from_model, double margin) {
  Box3 seen;
  for (const double x : {box.min.x, box.max.x})
    for (const double y : {box.min.y, box.max.y})
      for (const double z : {box.min.z, box.max.z}) seen.add(station_from_model.point({x, y, z}));
  seen.min = seen.min - Vec3{margin, margin, margin};
  seen.max = seen.max + Vec3{margin, margin, margin};
  return seen;
}

struct Column {
  std::vector<Instrument::Point> points;
  std::vector<std::uint32_t> rows;
  std::uint64_t lost = 0;
};

Result<ScanFigures> scan_into(const detail::StationSink& sink, const ModelField& surface,
                              std::span<const TriMesh> stones, const ScanOptions& options,
                              bool with_time, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_options(options));
  const assets::ScannerPreset& scanner = options.scanner;
  MAQUETTE_TRY(const detail::ScanScene scene, detail::ScanScene::build(surface, stones));
  MAQUETTE_TRY_VOID(scene.check_outside(options.station_mm, "scanner"));
  if (scene.bounds().empty())
    return fail(kNothingHit, "the surface is all void and there are no stones");

  const RigidTransform model_from_station{options.station_rotation, options.station_mm};
  const Box3 model_box = scene.bounds();
  const double farthest = norm(model_box.max - model_box.min) +
                          norm(0.5 * (model_box.min + model_box.max) - options.station_mm);
  Instrument instrument(options, scene, farthest);
  const AngularErrors& e = options.angular;
  const double strays = 5.0 * e.encoder_noise_rad + std::abs(e.vertical_index_rad) +
                        std::abs(e.eccentricity_v_rad) + std::abs(e.eccentricity_h_rad) +
                        std::abs(e.collimation_rad) + std::abs(e.trunnion_rad);
  const detail::AngularWindow window =
      detail::window_of(seen_box(model_box, model_from_station.inverse(),
                                 instrument.beam_radius_mm() + strays * farthest),
                        {});
  const double largest_zenith = scanner.largest_zenith_deg * std::numbers::pi / 180.0;

  double step = kTurn / scanner.lines_per_turn;
  detail::DirectionGrid grid = detail::grid_over(window, step, largest_zenith);
  const auto directions = [&] {
    return static_cast<double>(grid.columns) *
           static_cast<double>(std::max<std::int64_t>(0, grid.rows));
  };
  const auto limit = static_cast<double>(options.max_points);
  while (directions() > limit) {
    step *= std::fmax(1.001, std::sqrt(directions() / limit));
    grid = detail::grid_over(window, step, largest_zenith);
  }
  ScanFigures figures;
  figures.widened = step * scanner.lines_per_turn / kTurn;
  if (figures.widened > 1.0)
    run.warn(fmt::format("angular steps are {:.3g} times those of {}, to stay below {} points",
                         figures.widened, scanner.name, options.max_points));
  grid.rows = std::max<std::int64_t>(0, grid.rows);
  figures.directions = static_cast<std::uint64_t>(grid.rows * grid.columns);

  ScanStation station;
  station.name = options.name;
  station.sensor_vendor = scanner.vendor;
  station.sensor_model = scanner.model;
  station.model_from_station = model_from_station;
  station.position_mm = options.station_mm;
  station.rows = static_cast<std::uint32_t>(grid.rows);
  station.columns = static_cast<std::uint32_t>(grid.columns);
  station.fields.intensity = station.fields.grid = true;
  station.fields.colour = options.colour && options.paint;
  station.fields.time = with_time;
  const Box3 box = seen_box(model_box, {{}, -options.station_mm}, 0.0);
  const double nearest = std::fmax(1.0, norm({std::fmax(0.0, std::fmax(box.min.x, -box.max.x)),
                                              std::fmax(0.0, std::fmax(box.min.y, -box.max.y)),
                                              std::fmax(0.0, std::fmax(box.min.z, -box.max.z))}));
  station.intensity_limits = {0.0, std::pow(kReferenceRangeMm / nearest, 2)};

  const bool planes = instrument.columns_are_planes() &&
                      kCellsOfRay * grid.rows >= std::max(surface.z_mm.rows(), surface.z_mm.cols());
  // A whole column, or as many directions at a time as lie within a leaf of the tracer's pyramid:
  // eight cells.
  const auto together =
      planes ? std::max<std::int64_t>(1, grid.rows)
             : std::clamp<std::int64_t>(
                   static_cast<std::int64_t>(8.0 * surface.spacing.value() / (step * farthest)), 1,
                   kMostTogether);
  MAQUETTE_TRY_VOID(
      instrument.find_stones(stones, 0.5 * static_cast<double>(together) * step + 2.0 * strays));
  std::vector<Instrument::Zenith> zeniths;
  for (std::int64_t row = 0; row < grid.rows; ++row) {
    const double v = grid.zenith(row);
    zeniths.push_back({v, std::sin(v), std::cos(v)});
  }
  // Columns in batches of some 25 MB, one computed while the one before is handed over: memory does
  // not depend on the number of points.
  const std::int64_t per_batch =
      std::clamp<std::int64_t>(200'000 / std::max<std::int64_t>(1, grid.rows), 1, 1024);
  using Columns = std::vector<Column>;
  const auto look = [&](std::int64_t first, Columns& columns) {
    columns.resize(static_cast<std::size_t>(std::min(per_batch, grid.columns - first)));
    oneapi::tbb::parallel_for(std::size_t{0}, columns.size(), [&](std::size_t k) {
      Column& column = columns[k];
      column.points.clear();
      column.rows.clear();
      column.lost = 0;
      Instrument::Beam beam;
      std::vector<Instrument::Point> points(static_cast<std::size_t>(together));
      std::vector<Instrument::Outcome> outcomes(points.size());
      const std::int64_t at = first + static_cast<std::int64_t>(k);
      for (std::int64_t row = 0; row < grid.rows; row += together) {
        const auto n = static_cast<std::size_t>(std::min(together, grid.rows - row));
        const auto some = std::span(zeniths).subspan(static_cast<std::size_t>(row), n);
        const auto ray = static_cast<std::uint64_t>(at * grid.rows + row);
        if (planes)
          instrument.measure_plane(grid.azimuth(at), some, ray, beam, std::span(points).first(n),
                                   std::span(outcomes).first(n));
        else
          instrument.measure(grid.azimuth(at), some, ray, beam, std::span(points).first(n),
                             std::span(outcomes).first(n));
        for (std::size_t j = 0; j < n; ++j) {
          if (outcomes[j] == Instrument::Outcome::lost) ++column.lost;
          if (outcomes[j] != Instrument::Outcome::point) continue;
          column.points.push_back(points[j]);
          column.rows.push_back(static_cast<std::uint32_t>(row) + static_cast<std::uint32_t>(j));
        }
      }
    });
  };
  PointBatch batch;
  const auto hand_over = [&](std::int64_t first, const Columns& columns) -> Result<void> {
    batch.clear();
    for (std::size_t k = 0; k < columns.size(); ++k) {
      const Column& column = columns[k];
      const std::int64_t at = first + static_cast<std::int64_t>(k);
      figures.lost += column.lost;
      for (std::size_t i = 0; i < column.points.size(); ++i) {
        const Instrument::Point& p = column.points[i];
        batch.points_mm.push_back(p.place_mm);
        batch.intensity.push_back(p.intensity);
        batch.grid.push_back({column.rows[i], static_cast<std::uint32_t>(at)});
        if (station.fields.colour) batch.colours.push_back(p.colour);
        // A turn of the mirror takes lines_per_turn rows; the head turns by a column meanwhile.
        if (with_time)
          batch.time_s.push_back(
              (static_cast<double>(at) + static_cast<double>(column.rows[i]) * step / kTurn) /
              scanner.turns_per_s);
      }
    }
    if (batch.size() == 0) return {};
    batch.begins_station = figures.points == 0;
    figures.points += batch.size();
    return sink(station, batch);
  };
  std::array<Columns, 2> columns;
  if (figures.directions > 0) look(0, columns[0]);
  for (std::int64_t first = 0, now = 0; first < grid.columns && figures.directions > 0;
       first += per_batch, now = 1 - now) {
    if (run.stopped()) return fail(kCancelled, "the simulated scan was cancelled");
    run.progress(static_cast<double>(first) / static_cast<double>(grid.columns));
    Result<void> handed_over;
    oneapi::tbb::parallel_invoke(
        [&] {
          if (first + per_batch < grid.columns)
            look(first + per_batch, columns[static_cast<std::size_t>(1 - now)]);
        },
        [&] { handed_over = hand_over(first, columns[static_cast<std::size_t>(now)]); });
    MAQUETTE_TRY_VOID(handed_over);
  }
  if (figures.points == 0)
    return fail(
        kNothingHit,
        fmt::format("none of {} x {} directions from ({}, {}, {}) mm meets the surface from "
                    "above with enough signal; move the scanner",
                    grid.columns, grid.rows, options.station_mm.x, options.station_mm.y,
                    options.station_mm.z));
  run.progress(1.0);
  return figures;
}

}  // namespace

double range_sigma_mm(const assets::ScannerPreset& scanner, double range_mm, double cos_incidence,
                      double reflectance) {
  const double nearness = kReferenceRangeMm / range_mm;
  return sigma_of_signal(scanner, reflectance * cos_incidence * nearness * nearness);
}

Result<Cloud> simulate_scan(const ModelField& surface, std::span<const TriMesh> stones,
                            const ScanOptions& options, const RunContext& run) {
  Cloud cloud;
  MAQUETTE_TRY_VOID(scan_into(detail::into(cloud), surface, stones, options, false, run));
  return cloud;
}

Result<ScanFigures> simulate_scan(const ModelField& surface, std::span<const TriMesh> stones,
                                  const ScanOptions& options, CloudWriter& writer,
                                  const RunContext& run) {
  return scan_into(detail::into(writer), surface, stones, options, true, run);
}

}  // namespace maquette::scan
