// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/measured_part.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

#include <fmt/format.h>

#include "meshing/stones.hpp"
#include "scan/beam_shift.hpp"
#include "scan/check_stations.hpp"
#include "scan/clean.hpp"
#include "scan/datums.hpp"
#include "scan/find_spheres.hpp"
#include "scan/overhangs.hpp"
#include "scan/register_mesh.hpp"

namespace maquette::tools {
using heightmap::ModelField;
namespace {

constexpr double kOfSphere = 1.1;  // radii: points of a reference sphere, not of the part
constexpr double kDegrees = 180.0 / std::numbers::pi;

std::vector<scan::Datum> datums_of(const Case& input) {
  std::vector<scan::Datum> datums;
  for (const CaseDatum& d : input.datums) {
    const auto kind = d.kind == "pad"      ? scan::Datum::Kind::pad
                      : d.kind == "sphere" ? scan::Datum::Kind::sphere
                                           : scan::Datum::Kind::dowel;
    datums.push_back({kind,
                      d.name.empty() ? fmt::format("{} {}", d.kind, datums.size() + 1) : d.name,
                      d.at_mm, d.radius_mm, d.half_x_mm, d.half_y_mm, d.axis, d.length_mm});
  }
  return datums;
}

/// A beam that passes the rim meets the part with what is left of it: its range is that of this
/// rest, its direction still that of the whole, so the point stands in the air. Along the line of
/// sight the beam is longer by the angle of incidence on the ground plane.
bool crosses_rim(Vec3 p, const ModelField& design, double beam_mm, std::optional<Vec3> station) {
  double reach_x = 0.5 * beam_mm, reach_y = reach_x;
  if (station) {
    const Vec3 look = *station - p;
    const double longer = norm(look) / std::fmax(1e-9, std::abs(look.z));
    const double flat = std::fmax(1e-9, std::hypot(look.x, look.y));
    reach_x = 0.5 * beam_mm * std::hypot(longer * look.x / flat, look.y / flat);
    reach_y = 0.5 * beam_mm * std::hypot(longer * look.y / flat, look.x / flat);
  }
  return p.x - design.x0.value() < reach_x || p.y - design.y0.value() < reach_y ||
         design.x_mm(design.z_mm.cols() - 1) - p.x < reach_x ||
         design.y_mm(design.z_mm.rows() - 1) - p.y < reach_y;
}

void add_angles(MeasuredPart& all, Vec3 p, const ModelField& design, std::optional<Vec3> station) {
  const double s = design.spacing.value();
  const double h = heightmap::height_at(design, p.x, p.y);
  // Beside the rim or a void: from the other side, and level where both sides are bare.
  const auto rise = [&](double dx, double dy) {
    const double ahead = heightmap::height_at(design, p.x + dx, p.y + dy) - h;
    const double behind = h - heightmap::height_at(design, p.x - dx, p.y - dy);
    return !std::isnan(ahead) ? ahead : std::isnan(behind) && !std::isnan(h) ? 0.0 : behind;
  };
  const double rise_x = rise(s, 0.0), rise_y = rise(0.0, s);
  const Vec3 normal = normalized(Vec3{-rise_x / s, -rise_y / s, 1.0});
  all.slope_deg.push_back(static_cast<float>(kDegrees * std::acos(normal.z)));
  if (!station) {
    all.range_mm.push_back(NAN);
    all.incidence_deg.push_back(NAN);
    return;
  }
  const Vec3 look = *station - p;
  const double range = norm(look);
  all.range_mm.push_back(static_cast<float>(range));
  all.incidence_deg.push_back(
      static_cast<float>(kDegrees * std::acos(std::clamp(dot(look, normal) / range, -1.0, 1.0))));
}

/// The scanner's places in the model frame, in the order of the points.
std::vector<scan::Viewpoint> views_of(const scan::Cloud& cloud,
                                      const RigidTransform& model_from_scan,
                                      const CaseScan& entry) {
  const auto in_model = [&](const std::optional<Vec3>& station) -> std::optional<Vec3> {
    if (!station) return std::nullopt;
    return model_from_scan.point(*station);
  };
  if (cloud.station_mm || cloud.stations.empty())
    return {{in_model(cloud.station_mm), entry.beam_diameter_mm, cloud.points_mm.size()}};
  std::vector<scan::Viewpoint> views;
  for (const scan::ScanStation& s : cloud.stations)
    views.push_back({in_model(s.position_mm), entry.beam_diameter_mm, s.points});
  return views;
}

/// Where the spheres among the datums are found and matched, the pose that they give.
std::optional<scan::SphereMatch> look_for_spheres(ScanFigures& figures, const scan::Cloud& cloud,
                                                  const std::vector<scan::Datum>& datums,
                                                  const std::string& name, const RunContext& run) {
  std::vector<double> radii;
  for (const scan::Datum& d : datums)
    if (d.kind == scan::Datum::Kind::sphere) radii.push_back(d.radius_mm);
  if (radii.size() < 3) return std::nullopt;
  const auto found = scan::find_spheres(cloud, radii, run);
  const auto match = found ? scan::match_spheres(*found, datums)
                           : Result<scan::SphereMatch>(tl::unexpected(found.error()));
  if (!match) {
    run.warn(fmt::format("{}: no pose from reference spheres: {}", name, match.error().message));
    return std::nullopt;
  }
  figures.spheres = *match;
  figures.spheres_found = found->size();
  return *match;
}

/// The cloud of one scan without what floats between two surfaces, for that belongs to neither; and
/// this apart.
struct ReadScan {
  scan::Cloud cloud, mixed;
};

Result<ReadScan> read_scan(const CaseScan& entry, std::uint64_t most_points, ScanFigures& figures,
                           const RunContext& run) {
  ReadScan read;
  scan::Cloud& cloud = read.cloud;
  MAQUETTE_TRY(cloud, scan::read_cloud(entry.points, run, most_points));
  if (!std::isnan(entry.scanner_position_mm.x)) cloud.station_mm = entry.scanner_position_mm;
  figures.passed_over = cloud.passed_over;
  // Rays meet one surface: of their points only noise would be taken for mixed, beside steep
  // stones and to one side.
  if (entry.beam_diameter_mm > 0.0) {
    scan::CleanOptions edges;
    edges.least_neighbours = 0;
    edges.beam_diameter_mm = entry.beam_diameter_mm;
    edges.beam_divergence_mrad = 0.0;  // the diameter is that at the part
    MAQUETTE_TRY(const scan::CleanFigures cleaned,
                 scan::clean_cloud(cloud, edges, run, &read.mixed));
    figures.mixed = cleaned.mixed;
  }
  figures.used = cloud.points_mm.size();
  return read;
}

/// Stations of one file have the poses that it states; nobody else would say that one is wrong.
void warn_of_strays(const std::vector<scan::StrayStation>& strays, const std::string& name,
                    const RunContext& run) {
  for (const scan::StrayStation& s : strays)
    run.warn(std::isnan(s.off_mm)
                 ? fmt::format("{}: {} is not on the part where its pose in the file puts it; "
                               "`maquette merge` brings stations together",
                               name, s.name)
                 : fmt::format("{}: {} would lie {:.3f} mm (+- {:.3f}) elsewhere by itself: is its "
                               "pose in the file right? `maquette merge` brings stations together",
                               name, s.name, s.off_mm, s.sigma_mm));
}

void scale_by(double factor, scan::Cloud& cloud) {
  for (Vec3& p : cloud.points_mm) p = factor * p;
  if (cloud.station_mm) *cloud.station_mm = factor * *cloud.station_mm;
  for (scan::ScanStation& s : cloud.stations)
    if (s.position_mm) *s.position_mm = factor * *s.position_mm;
}

bool is_of_sphere(Vec3 p, const std::vector<scan::Datum>& datums) {
  return std::any_of(datums.begin(), datums.end(), [&](const scan::Datum& d) {
    return d.kind == scan::Datum::Kind::sphere && norm(p - d.at_mm) < kOfSphere * d.radius_mm;
  });
}

/// The points that are compared: not of spheres, not across the rim.
void append(MeasuredPart& all, const scan::Cloud& cloud, const scan::Registration& used,
            const std::vector<scan::Datum>& datums, const CaseScan& entry,
            const ModelField& design) {
  const bool bright = cloud.intensity.size() == cloud.points_mm.size();
  const std::size_t before = all.cloud.points_mm.size();
  all.make_room(before + cloud.points_mm.size());
  std::size_t i = 0;
  for (const scan::Viewpoint& view : views_of(cloud, used.model_from_scan, entry)) {
    const std::size_t first = all.cloud.points_mm.size();
    for (const std::size_t end = i + view.points; i < end; ++i) {
      const Vec3 p = used.model_from_scan.point(cloud.points_mm[i]);
      if (entry.beam_diameter_mm > 0.0 &&
          crosses_rim(p, design, entry.beam_diameter_mm, view.station_mm)) {
        ++all.at_rim;
        continue;
      }
      if (is_of_sphere(p, datums)) continue;
      all.cloud.points_mm.push_back(p);
      all.cloud.intensity.push_back(bright ? cloud.intensity[i] : NAN);
      add_angles(all, p, design, view.station_mm);
    }
    all.views.push_back(
        {view.station_mm, view.beam_diameter_mm, all.cloud.points_mm.size() - first});
  }
  all.scans.push_back({used, all.cloud.points_mm.size() - before});
}

/// The mixed points of the scan that is appended next.
void append_mixed(MeasuredPart& all, const scan::Cloud& mixed, const scan::Registration& used,
                  const std::vector<scan::Datum>& datums, const CaseScan& entry,
                  const ModelField& design) {
  MixedPoints& to = all.mixed;
  std::size_t i = 0;
  for (scan::Viewpoint view : views_of(mixed, used.model_from_scan, entry)) {
    const std::size_t first = to.points_mm.size();
    for (const std::size_t end = i + view.points; i < end; ++i) {
      const Vec3 p = used.model_from_scan.point(mixed.points_mm[i]);
      if (crosses_rim(p, design, entry.beam_diameter_mm, view.station_mm) ||
          is_of_sphere(p, datums))
        continue;
      to.points_mm.push_back(p);
    }
    view.points = to.points_mm.size() - first;
    to.views.push_back(view);
    to.scan_of_view.push_back(all.scans.size());
  }
}

/// Takes points out of all that is known of them.
/// @return how many
template <class Unwanted>
std::size_t leave_out(MeasuredPart& all, const Unwanted& unwanted) {
  auto& points = all.cloud.points_mm;
  const std::array columns{&all.cloud.intensity, &all.range_mm, &all.incidence_deg, &all.slope_deg};
  std::vector<std::size_t> left(all.scans.size(), 0);
  std::size_t to = 0, i = 0, scan = 0;
  std::size_t scan_end = all.scans.front().points;
  for (scan::Viewpoint& v : all.views) {
    const std::size_t first = to;
    for (const std::size_t end = i + v.points; i < end; ++i) {
      while (i >= scan_end) scan_end += all.scans[++scan].points;
      if (unwanted(i)) continue;
      points[to] = points[i];
      for (std::vector<float>* of : columns) (*of)[to] = (*of)[i];
      ++left[scan];
      ++to;
    }
    v.points = to - first;
  }
  const std::size_t out = points.size() - to;
  points.resize(to);
  for (std::vector<float>* of : columns) of->resize(to);
  for (std::size_t k = 0; k < left.size(); ++k) all.scans[k].points = left[k];
  return out;
}

/// What is expected without stones.
const ModelField& ground_of(const NominalPart& nominal) {
  return nominal.expected_ground ? *nominal.expected_ground : *nominal.ground;
}

/// Those of the plan, where there is a ground that they stand on.
std::vector<TriMesh> stones_of(const NominalPart& nominal) {
  std::vector<TriMesh> stones;
  if (nominal.ground)
    for (const meshing::PlacedStone& stone : nominal.stone_plan)
      stones.push_back(meshing::stone_mesh(stone));
  return stones;
}

/// Of each scan; nothing where there are several.
std::vector<std::optional<Vec3>> stations_of_scans(const MeasuredPart& all) {
  const std::vector<std::size_t> of_view = scans_of_views(all);
  std::vector<std::optional<Vec3>> stations(all.scans.size());
  std::vector<int> views(all.scans.size(), 0);
  for (std::size_t v = 0; v < all.views.size(); ++v) {
    // Noise by range and incidence is that of one place.
    stations[of_view[v]] = views[of_view[v]]++ == 0 ? all.views[v].station_mm : std::nullopt;
  }
  return stations;
}

/// What is known of the scans beside their points and poses follows these.
void follow(MeasuredPart& all, std::span<const RigidTransform> steps) {
  const std::vector<std::size_t> of_view = scans_of_views(all);
  for (std::size_t v = 0; v < all.views.size(); ++v)
    if (all.views[v].station_mm)
      all.views[v].station_mm = steps[of_view[v]].point(*all.views[v].station_mm);
  for (std::size_t k = 0; k < all.scans.size(); ++k)
    all.figures[k].best = all.scans[k].registration;
}

}  // namespace

std::vector<std::size_t> scans_of_views(const MeasuredPart& all) {
  std::vector<std::size_t> scans;
  std::size_t scan = 0, left = all.scans.front().points;
  for (const scan::Viewpoint& v : all.views) {
    while (left == 0 && scan + 1 < all.scans.size()) left = all.scans[++scan].points;
    left -= v.points;
    scans.push_back(scan);
  }
  return scans;
}

Result<void> add_scan(MeasuredPart& all, const CaseScan& entry, const Case& input,
                      const NominalPart& nominal, const RunContext& run) {
  ScanFigures figures;
  figures.name = entry.points.filename().string();
  const auto within = [&](Error error) {
    return tl::unexpected(std::move(error).within(entry.points.string()));
  };
  MAQUETTE_TRY(auto read, read_scan(entry, kMostPoints / input.scans.size(), figures, run));
  scan::Cloud& cloud = read.cloud;
  all.passed_over += cloud.passed_over;
  scan::RegisterOptions options;
  options.scale = input.scale;
  std::vector<scan::Datum> datums = datums_of(input);
  const auto spheres = look_for_spheres(figures, cloud, datums, figures.name, run);
  if (spheres) {
    options.model_from_scan = spheres->model_from_scan;
    std::erase_if(datums, [&](const scan::Datum& d) {  // what was not scanned ties nothing
      return d.kind == scan::Datum::Kind::sphere &&
             std::find(spheres->missing.begin(), spheres->missing.end(), d.name) !=
                 spheres->missing.end();
    });
  }
  if (auto seen = scan::check_sight_planes(cloud); !seen) return within(std::move(seen.error()));
  auto best = nominal.mesh
                  ? scan::register_mesh(cloud, *nominal.to_mesh, nominal.design, options, run)
                  : scan::register_scan(cloud, nominal.to_meet(), options, run);
  // A flat part, or one that came out quite different, is no hindrance where spheres tie the pose.
  if (!best && spheres && best.error().code != kCancelled) best = spheres->registration;
  if (!best) return within(std::move(best.error()));
  figures.best = *best;
  if (input.scale) {
    scale_by(best->scale, cloud);
    scale_by(best->scale, read.mixed);
  }
  auto viewed = nominal.mesh
                    ? scan::check_viewpoints(cloud, best->model_from_scan, *nominal.to_mesh)
                    : scan::check_viewpoints(cloud, best->model_from_scan, nominal.to_meet());
  if (viewed && !nominal.mesh)
    viewed = scan::check_density(cloud, best->model_from_scan, nominal.to_meet());
  if (!viewed) return within(std::move(viewed.error()));
  if (!input.scale && !nominal.mesh)
    warn_of_strays(scan::stray_stations(cloud, *best, nominal.to_meet(), run), figures.name, run);
  scan::Registration used = *best;
  if (!datums.empty()) {
    // Spheres are nearer to where they were matched than to where a best fit brings them.
    auto on =
        scan::register_datums(cloud, nominal.design, datums,
                              spheres ? spheres->model_from_scan : best->model_from_scan, 2.0, run);
    if (!on) return within(std::move(on.error()));
    figures.on_datums = *on;
    figures.absorbed = scan::absorbed_by(*best, on->registration, nominal.design);
    used = on->registration;
    all.part.push_back({used.model_from_scan * best->model_from_scan.inverse(),
                        std::hypot(used.sigma_translation_mm, best->sigma_translation_mm),
                        std::hypot(used.sigma_rotation_rad, best->sigma_rotation_rad),
                        static_cast<double>(cloud.points_mm.size())});
  }
  append_mixed(all, read.mixed, used, datums, entry, nominal.design);
  append(all, cloud, used, datums, entry, nominal.design);
  all.figures.push_back(std::move(figures));
  return {};
}

Result<std::vector<RigidTransform>> fit_without_findings(MeasuredPart& all,
                                                         const ModelField& surface,
                                                         const scan::Significance& found,
                                                         const scan::Search& search,
                                                         const RunContext& run) {
  MAQUETTE_TRY(auto steps, scan::refit(all.cloud.points_mm, all.scans, stations_of_scans(all),
                                       surface, found, search, run));
  follow(all, steps);
  return steps;
}

Result<std::vector<RigidTransform>> fit_without_beams(MeasuredPart& all, const ModelField& surface,
                                                      const RunContext& run) {
  MAQUETTE_TRY(auto steps, scan::refit_corrected(all.cloud.points_mm, all.scans,
                                                 stations_of_scans(all), surface, run));
  follow(all, steps);
  return steps;
}

Result<void> leave_out_overhung(MeasuredPart& all, const NominalPart& nominal, const Case& input,
                                double noise_mm) {
  if (!nominal.ground || nominal.stone_plan.empty()) return {};
  MAQUETTE_TRY(
      auto judged,
      scan::judge_by_heights(all.cloud.points_mm, nominal.to_meet(), ground_of(nominal),
                             stones_of(nominal), input.coating_thickness_mm, noise_mm, all.views));
  all.overhung = leave_out(all, [&](std::size_t i) { return judged.beyond[i] != 0; });
  std::size_t gone = 0, i = 0;
  for (scan::SeenAt& seen : judged.seen_at) {
    for (; i < seen.point; ++i) gone += judged.beyond[i];
    seen.point -= gone;
  }
  all.seen_at = std::move(judged.seen_at);
  return {};
}

std::vector<Vec3> places_of(const MeasuredPart& all) {
  std::vector<Vec3> places = all.cloud.points_mm;
  for (const scan::SeenAt& seen : all.seen_at) places[seen.point] = seen.place_mm;
  return places;
}

Result<std::optional<BeamFigures>> take_out_beams(MeasuredPart& all, const NominalPart& nominal,
                                                  double noise_mm, const RunContext& run) {
  if (std::none_of(all.views.begin(), all.views.end(),
                   [](const scan::Viewpoint& v) { return v.beam_diameter_mm > 0.0; }))
    return std::nullopt;
  auto& points = all.cloud.points_mm;
  const std::vector<TriMesh> stones = stones_of(nominal);
  const ModelField& surface = stones.empty() ? nominal.to_meet() : ground_of(nominal);
  MAQUETTE_TRY(const auto shifts,
               scan::beam_shifts_mm(points, all.views, surface, stones, noise_mm, run));
  double square = 0.0, largest = 0.0;
  std::size_t i = 0;
  for (const scan::Viewpoint& v : all.views)
    for (const std::size_t end = i + v.points; i < end; ++i) {
      if (std::isnan(shifts[i])) continue;
      const auto shift = static_cast<double>(shifts[i]);
      const Vec3 look = v.station_mm ? normalized(points[i] - *v.station_mm) : Vec3{0.0, 0.0, -1.0};
      points[i] = points[i] - shift * look;
      square += shift * shift;
      largest = std::fmax(largest, std::abs(shift));
    }
  const std::size_t edges =
      leave_out(all, [&](std::size_t point) { return std::isnan(shifts[point]); });
  const std::size_t to = points.size();
  if (to == 0)
    return fail(scan::kTooFewPoints,
                "every point lies beside an edge within its beam: is beam_diameter_mm in mm?");
  return BeamFigures{std::sqrt(square / static_cast<double>(to)), largest, edges};
}

Corrections corrections_of(const MeasuredPart& all, const ModelField& design) {
  Corrections c;
  double points = 0.0;
  for (const auto& w : all.part) points += w.points;
  const Vec3 middle{0.5 * (design.x0.value() + design.x_mm(design.z_mm.cols() - 1)),
                    0.5 * (design.y0.value() + design.y_mm(design.z_mm.rows() - 1)),
                    all.scans.front().registration.centre_mm.z};
  Vec3 shift, turn;
  double of_shift = 0.0, of_turn = 0.0;
  for (const auto& w : all.part) {
    const double share = w.points / points;
    const Quaternion q = w.actual_from_planned.rotation;
    shift += share * (w.actual_from_planned.point(middle) - middle);
    turn += (q.w < 0.0 ? -2.0 : 2.0) * share * Vec3{q.x, q.y, q.z};
    of_shift += share * share * w.sigma_translation_mm * w.sigma_translation_mm;
    of_turn += share * share * w.sigma_rotation_rad * w.sigma_rotation_rad;
  }
  const double angle = norm(turn);
  Quaternion rotation;
  if (angle > 0.0) rotation = rotation_about((1.0 / angle) * turn, angle);
  c.actual_from_planned = {rotation, middle + shift - rotate(rotation, middle)};
  c.sigma_translation_mm = std::sqrt(of_shift);
  c.sigma_rotation_rad = std::sqrt(of_turn);
  return c;
}

}  // namespace maquette::tools
