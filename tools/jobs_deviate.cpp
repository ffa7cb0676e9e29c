// SPDX-License-Identifier: GPL-3.0-or-later

// Scans against the design: poses, deviations, what of them is more than noise, and the report.

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "scan/beam_shift.hpp"
#include "scan/clean.hpp"
#include "scan/deviate.hpp"
#include "scan/expected_surface.hpp"
#include "scan/find_objects.hpp"
#include "scan/find_spheres.hpp"
#include "scan/register_mesh.hpp"
#include "scan/statistics.hpp"
#include "scan/upper_envelope.hpp"
#include "tools/corrections_file.hpp"
#include "tools/deviation_page.hpp"
#include "tools/deviation_rows.hpp"
#include "tools/jobs.hpp"
#include "tools/path_under.hpp"
#include "tools/pictures.hpp"
#include "tools/scene_file.hpp"

namespace maquette::tools {
using heightmap::ModelField;
using nlohmann::json;
namespace {

constexpr double kOfSphere = 1.1;  // radii: points of a reference sphere, not of the part
// Of all scans together, some 4 GB here. Of larger files an even share is compared.
constexpr std::uint64_t kMostPoints = 30'000'000;
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

/// What the part should be: as designed, and as it must come out when nothing goes wrong.
struct Nominal {
  ModelField design;                             ///< with stones
  std::optional<ModelField> ground;              ///< without
  std::vector<meshing::PlacedStone> stone_plan;  ///< only beside a ground
  std::optional<ModelField> expected;            ///< with what the program leaves and the coat
  std::optional<TriMesh> mesh;  ///< the design as triangles; `design` is then its upper envelope
  std::unique_ptr<scan::MeshDistance> to_mesh;
  [[nodiscard]] const ModelField& to_meet() const { return expected ? *expected : design; }
};

bool is_field(const fs::path& path) {
  return path.extension() == ".tif" || path.extension() == ".tiff";
}

/// A part of any shape: STL, PLY, OBJ.
Result<void> read_mesh_design(Nominal& n, const Case& input, const RunContext& run) {
  if (!input.ground.empty() || !input.as_milled.empty() || input.coating_thickness_mm != 0.0)
    return fail(
        kConfigInvalid,
        fmt::format("{}: ground, as_milled and coating.thickness_mm need a design that is a "
                    "model field (.tif), not a mesh",
                    input.design.string()));
  MAQUETTE_TRY(auto mesh, meshing::read_mesh(input.design, run));
  n.mesh = scan::welded(std::move(mesh));
  n.to_mesh = std::make_unique<scan::MeshDistance>(*n.mesh);
  auto top = scan::upper_envelope(*n.mesh);
  if (!top) return tl::unexpected(std::move(top.error()).within(input.design.string()));
  n.design = std::move(*top);
  return {};
}

Result<void> read_nominal(Nominal& n, const Case& input, const RunContext& run) {
  if (!is_field(input.design)) return read_mesh_design(n, input, run);
  MAQUETTE_TRY(n.design, heightmap::read_model_field(input.design));
  if (!input.ground.empty()) {
    MAQUETTE_TRY(n.ground, heightmap::read_model_field(input.ground));
    if (n.ground->z_mm.rows() != n.design.z_mm.rows() ||
        n.ground->z_mm.cols() != n.design.z_mm.cols())
      return fail(kConfigInvalid,
                  fmt::format("{}: ground must have the nodes of the design, {} x {}",
                              input.ground.string(), n.design.z_mm.cols(), n.design.z_mm.rows()));
    if (!input.stones.empty()) {
      MAQUETTE_TRY(n.stone_plan, meshing::read_stone_plan(input.stones));
    }
  }
  if (input.as_milled.empty() && input.coating_thickness_mm == 0.0) return {};
  std::optional<ModelField> as_milled;
  if (!input.as_milled.empty()) {
    MAQUETTE_TRY(as_milled, heightmap::read_model_field(input.as_milled));
  }
  n.expected = scan::expected_surface(n.design, n.ground ? *n.ground : n.design,
                                      as_milled ? &*as_milled : nullptr,
                                      Millimetres{input.coating_thickness_mm});
  return {};
}

/// All scans in the model frame, and what is known of each point beside its place.
struct Measured {
  scan::Cloud cloud;
  std::vector<float> range_mm, incidence_deg, slope_deg;
  std::vector<scan::ScanPose> scans;
  std::vector<scan::Viewpoint> views;
  /// Where the part really is in the frame of the datums, by each scan.
  struct Where {
    RigidTransform actual_from_planned;
    double sigma_translation_mm, sigma_rotation_rad, points;
  };
  std::vector<Where> part;
  std::size_t at_rim = 0;  ///< left out: part of their beam passed the rim
  void make_room(std::size_t points) {
    cloud.points_mm.reserve(points);
    for (std::vector<float>* of : {&cloud.intensity, &range_mm, &incidence_deg, &slope_deg})
      of->reserve(points);
  }
  json registrations = json::array(), datums = json::array(), spheres = json::array();
};

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

void add_angles(Measured& all, Vec3 p, const ModelField& design, std::optional<Vec3> station) {
  const double s = design.spacing.value();
  const double h = heightmap::height_at(design, p.x, p.y);
  const double rise_x = heightmap::height_at(design, p.x + s, p.y) - h;
  const double rise_y = heightmap::height_at(design, p.x, p.y + s) - h;
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
std::optional<scan::SphereMatch> look_for_spheres(Measured& all, const scan::Cloud& cloud,
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
  all.spheres.push_back(sphere_row(*match, found->size(), name));
  return *match;
}

Result<void> add_scan(Measured& all, const CaseScan& entry, const Case& input,
                      const Nominal& nominal, const RunContext& run) {
  const std::string name = entry.points.filename().string();
  const auto within = [&](Error error) {
    return tl::unexpected(std::move(error).within(entry.points.string()));
  };
  MAQUETTE_TRY(auto cloud, scan::read_cloud(entry.points, run, kMostPoints / input.scans.size()));
  if (!std::isnan(entry.scanner_position_mm.x)) cloud.station_mm = entry.scanner_position_mm;
  // What floats between two surfaces belongs to neither. Rays meet one surface: of their points
  // only noise would be taken for mixed, beside steep stones and to one side.
  scan::CleanFigures cleaned;
  if (entry.beam_diameter_mm > 0.0) {
    scan::CleanOptions edges;
    edges.least_neighbours = 0;
    edges.beam_diameter_mm = entry.beam_diameter_mm;
    edges.beam_divergence_mrad = 0.0;  // the diameter is that at the part
    MAQUETTE_TRY(cleaned, scan::clean_cloud(cloud, edges, run));
  }
  scan::RegisterOptions options;
  options.scale = input.scale;
  std::vector<scan::Datum> datums = datums_of(input);
  const auto spheres = look_for_spheres(all, cloud, datums, name, run);
  if (spheres) {
    options.model_from_scan = spheres->model_from_scan;
    std::erase_if(datums, [&](const scan::Datum& d) {  // what was not scanned ties nothing
      return d.kind == scan::Datum::Kind::sphere &&
             std::find(spheres->missing.begin(), spheres->missing.end(), d.name) !=
                 spheres->missing.end();
    });
  }
  auto best = nominal.mesh
                  ? scan::register_mesh(cloud, *nominal.to_mesh, nominal.design, options, run)
                  : scan::register_scan(cloud, nominal.to_meet(), options, run);
  // A flat part, or one that came out quite different, is no hindrance where spheres tie the pose.
  if (!best && spheres && best.error().code != kCancelled) best = spheres->registration;
  if (!best) return within(std::move(best.error()));
  all.registrations.push_back(registration_row(*best, name));
  all.registrations.back()["mixed_points_taken_out"] = cleaned.mixed;
  all.registrations.back()["points_used"] = cloud.points_mm.size();
  if (input.scale) {
    for (Vec3& p : cloud.points_mm) p = best->scale * p;
    if (cloud.station_mm) *cloud.station_mm = best->scale * *cloud.station_mm;
    for (scan::ScanStation& s : cloud.stations)
      if (s.position_mm) *s.position_mm = best->scale * *s.position_mm;
  }
  scan::Registration used = *best;
  if (!datums.empty()) {
    // Spheres are nearer to where they were matched than to where a best fit brings them.
    auto on =
        scan::register_datums(cloud, nominal.design, datums,
                              spheres ? spheres->model_from_scan : best->model_from_scan, 2.0, run);
    if (!on) return within(std::move(on.error()));
    all.datums.push_back(
        datum_row(*on, scan::absorbed_by(*best, on->registration, nominal.design), name));
    used = on->registration;
    all.part.push_back({used.model_from_scan * best->model_from_scan.inverse(),
                        std::hypot(used.sigma_translation_mm, best->sigma_translation_mm),
                        std::hypot(used.sigma_rotation_rad, best->sigma_rotation_rad),
                        static_cast<double>(cloud.points_mm.size())});
  }
  const bool bright = cloud.intensity.size() == cloud.points_mm.size();
  const std::size_t before = all.cloud.points_mm.size();
  all.make_room(before + cloud.points_mm.size());
  std::size_t i = 0;
  for (const scan::Viewpoint& view : views_of(cloud, used.model_from_scan, entry)) {
    const std::size_t first = all.cloud.points_mm.size();
    for (const std::size_t end = i + view.points; i < end; ++i) {
      const Vec3 p = used.model_from_scan.point(cloud.points_mm[i]);
      if (entry.beam_diameter_mm > 0.0 &&
          crosses_rim(p, nominal.design, entry.beam_diameter_mm, view.station_mm)) {
        ++all.at_rim;
        continue;
      }
      if (std::any_of(datums.begin(), datums.end(), [&](const scan::Datum& d) {
            return d.kind == scan::Datum::Kind::sphere &&
                   norm(p - d.at_mm) < kOfSphere * d.radius_mm;
          }))
        continue;
      all.cloud.points_mm.push_back(p);
      all.cloud.intensity.push_back(bright ? cloud.intensity[i] : NAN);
      add_angles(all, p, nominal.design, view.station_mm);
    }
    all.views.push_back(
        {view.station_mm, view.beam_diameter_mm, all.cloud.points_mm.size() - first});
  }
  all.scans.push_back({used, all.cloud.points_mm.size() - before});
  return {};
}

/// Every point as a ray in the middle of its beam would have measured it on what is expected; what
/// lies beside an edge is left out.
/// @return how far points were moved, or null where all were rays
Result<json> take_out_beams(Measured& all, const ModelField& surface, double noise_mm,
                            const RunContext& run) {
  if (std::none_of(all.views.begin(), all.views.end(),
                   [](const scan::Viewpoint& v) { return v.beam_diameter_mm > 0.0; }))
    return json();
  auto& points = all.cloud.points_mm;
  MAQUETTE_TRY(const auto shifts, scan::beam_shifts_mm(points, all.views, surface, noise_mm, run));
  const std::array columns{&all.cloud.intensity, &all.range_mm, &all.incidence_deg, &all.slope_deg};
  double square = 0.0, largest = 0.0;
  std::size_t to = 0, i = 0, scan = 0;
  std::size_t scan_end = all.scans.front().points;
  std::vector<std::size_t> left(all.scans.size(), 0);
  for (scan::Viewpoint& v : all.views) {
    const std::size_t first = to;
    for (const std::size_t end = i + v.points; i < end; ++i) {
      while (i >= scan_end) scan_end += all.scans[++scan].points;
      if (std::isnan(shifts[i])) continue;
      const auto shift = static_cast<double>(shifts[i]);
      const Vec3 look = v.station_mm ? normalized(points[i] - *v.station_mm) : Vec3{0.0, 0.0, -1.0};
      points[to] = points[i] - shift * look;
      for (std::vector<float>* of : columns) (*of)[to] = (*of)[i];
      square += shift * shift;
      largest = std::fmax(largest, std::abs(shift));
      ++left[scan];
      ++to;
    }
    v.points = to - first;
  }
  const std::size_t edges = points.size() - to;
  points.resize(to);
  for (std::vector<float>* of : columns) of->resize(to);
  for (std::size_t k = 0; k < left.size(); ++k) all.scans[k].points = left[k];
  if (to == 0)
    return fail(scan::kTooFewPoints,
                "every point lies beside an edge within its beam: is beam_diameter_mm in mm?");
  return json{{"rms_mm", std::sqrt(square / static_cast<double>(to))},
              {"largest_mm", largest},
              {"at_edges", edges}};
}

/// The deviation where its cell is significant, zero where it is not, on the design's nodes.
Grid<float> significant_map(const scan::Significance& s, const ModelField& design) {
  Grid<float> map(design.z_mm.rows(), design.z_mm.cols(), NAN);
  if (s.maps.empty()) return map;
  for (std::ptrdiff_t r = 0; r < map.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < map.cols(); ++c)
      for (const scan::CellMap& m : s.maps) {
        const auto i = static_cast<std::ptrdiff_t>((design.y_mm(r) - m.y0_mm) / m.cell_mm);
        const auto j = static_cast<std::ptrdiff_t>((design.x_mm(c) - m.x0_mm) / m.cell_mm);
        if (!m.mean_mm.contains(i, j) || std::isnan(m.mean_mm(i, j))) continue;
        if (std::isnan(map(r, c))) map(r, c) = 0.0F;
        if (m.significant(i, j) == 0) continue;
        map(r, c) = m.mean_mm(i, j);
        break;
      }
  return map;
}

/// Figures of the deviation from what the part must come out as, and of what that is.
json expected_json(const scan::DeviationStatistics& s, const Nominal& nominal, const Case& input) {
  Grid<float> known(nominal.design.z_mm.rows(), nominal.design.z_mm.cols());
  for (std::ptrdiff_t r = 0; r < known.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < known.cols(); ++c)
      known(r, c) = nominal.expected->z_mm(r, c) - nominal.design.z_mm(r, c);
  const scan::DeviationStatistics k = scan::summarize(known.cells());
  return {{"as_milled", input.as_milled.filename().string()},
          {"coating_mm", input.coating_thickness_mm},
          {"known_mean_mm", k.mean_mm},
          {"known_max_mm", k.max_mm},
          {"mean_mm", s.mean_mm},
          {"rms_mm", s.rms_mm},
          {"sigma_mm", s.sigma_mm},
          {"nmad_mm", s.nmad_mm},
          {"p05_mm", s.p05_mm},
          {"p95_mm", s.p95_mm}};
}

/// The scans' mean by points, turned about the part's middle: rotations are small.
Corrections corrections_of(const Measured& all, const ModelField& design) {
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

json corrections_json(const Corrections& c) {
  const RigidTransform& t = c.actual_from_planned;
  json axes = json::array();
  for (const AxisCorrection& a : c.axes)
    axes.push_back({{"name", a.name},
                    {"origin_mm", {a.fit.origin_mm.x, a.fit.origin_mm.y, a.fit.origin_mm.z}},
                    {"direction", {a.fit.direction.x, a.fit.direction.y, a.fit.direction.z}},
                    {"scale", a.fit.scale},
                    {"sigma_scale", a.fit.sigma_scale},
                    {"sigma_direction_deg", kDegrees * a.fit.sigma_direction_rad},
                    {"straightness_mm", a.fit.straightness_mm}});
  return {{"translation_mm", {t.translation_mm.x, t.translation_mm.y, t.translation_mm.z}},
          {"rotation_deg",
           {2.0 * kDegrees * t.rotation.x, 2.0 * kDegrees * t.rotation.y,
            2.0 * kDegrees * t.rotation.z}},
          {"sigma_translation_mm", c.sigma_translation_mm},
          {"sigma_rotation_deg", kDegrees * c.sigma_rotation_rad},
          {"axes", axes}};
}

}  // namespace

Result<JobResult> deviate_job(const fs::path& case_path, const fs::path& folder,
                              const RunContext& run) {
  MAQUETTE_TRY(const auto input, read_case(case_path));
  if (input->scans.empty())
    return fail(
        kConfigInvalid,
        fmt::format("{}: deviate compares scans; add a [[scan]] table with points = \"FILE\"",
                    case_path.string()));
  Nominal nominal;  // its search tree points at its mesh: it stays where it is
  MAQUETTE_TRY_VOID(read_nominal(nominal, *input, run));
  const ModelField& design = nominal.design;
  std::vector<scan::Region> regions;
  if (!input->regions.empty()) {
    MAQUETTE_TRY(regions, scan::read_regions(input->regions));
  }
  if (input->band_width_mm > 0.0)
    for (scan::Region& band : scan::band_regions(design, input->band_width_mm))
      regions.push_back(std::move(band));
  Measured all;
  for (const CaseScan& entry : input->scans)
    MAQUETTE_TRY_VOID(add_scan(all, entry, *input, nominal, run));
  if (all.cloud.points_mm.empty())
    return fail(scan::kTooFewPoints,
                "every point lies within half a beam of the part's rim: is "
                "beam_diameter_mm in mm?");
  const scan::Registration joint = scan::joint_pose(all.scans);
  // Of stones before what the beam does to the surface as it is expected is taken out: one that has
  // moved is not where it is expected.
  std::vector<scan::StoneFinding> stones;
  if (nominal.ground) {
    MAQUETTE_TRY(stones, scan::find_stones(all.cloud.points_mm, all.views, *nominal.ground,
                                           nominal.stone_plan, joint.noise_mm, &joint));
  }
  json beam;
  if (!nominal.mesh) {  // of any shape: its upper side does not say what a beam meets
    MAQUETTE_TRY(beam, take_out_beams(all, nominal.to_meet(), joint.noise_mm, run));
  }
  const RigidTransform in_model;  // every cloud has been brought there above
  const Millimetres reach{input->reach_mm};
  scan::MeshDeviation deviation;
  if (nominal.mesh) {
    MAQUETTE_TRY(deviation,
                 scan::deviate(all.cloud, in_model, *nominal.to_mesh, design, reach, run));
  } else {
    MAQUETTE_TRY(static_cast<scan::Deviation&>(deviation),
                 scan::deviate(all.cloud, in_model, design, reach, run));
  }
  const auto& points = all.cloud.points_mm;
  const auto& d = deviation.per_point_mm;
  // Regions are judged by the design, as a customer draws them; findings are what nobody expected.
  const scan::Significance by_design = scan::significance(points, d, all.scans);
  std::optional<scan::Significance> by_expected;
  json expected;
  if (nominal.expected) {
    MAQUETTE_TRY(const auto from_expected,
                 scan::deviate(all.cloud, in_model, *nominal.expected, reach, run));
    by_expected = scan::significance(points, from_expected.per_point_mm, all.scans);
    expected = expected_json(from_expected.statistics, nominal, *input);
  }
  const scan::Significance& significance = by_expected ? *by_expected : by_design;
  // Beside planned stones, or where one of them is missing.
  std::vector<int> missing;
  for (const scan::StoneFinding& f : stones)
    if (f.state == scan::StoneState::missing) missing.push_back(f.number);
  const auto objects =
      scan::find_objects(points,
                         nominal.ground && nominal.stone_plan.empty() ? nominal.to_meet()
                         : nominal.ground                             ? *nominal.ground
                                                                      : nominal.to_meet(),
                         nominal.stone_plan, missing, deviation.statistics.nmad_mm);

  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  const fs::path significant_png = folder / "significant.png";
  result.outputs = {folder / "summary.json",  folder / "deviation.tif", folder / "deviation.ply",
                    folder / "deviation.png", folder / "report.html",   significant_png};
  json summary = json::parse(scan::to_json(deviation.statistics, &all.scans.front().registration));
  if (!expected.is_null()) summary["expected"] = expected;
  summary["at_rim"] = all.at_rim;
  if (!beam.is_null()) summary["beam"] = beam;
  summary["registrations"] = all.registrations;
  summary["datums"] = all.datums;
  summary["spheres"] = all.spheres;
  summary["findings"] = findings_json(significance);
  summary["stones"] = stones_json(stones);
  summary["objects"] = objects_json(objects);
  summary["regions"] = regions_json(scan::judge_regions(points, d, regions, by_design, &joint));
  summary["budget"] = budget_json({});
  if (!significance.maps.empty()) {
    const scan::CellMap& cells = significance.maps.front();
    summary["budget"] = budget_json(scan::budget_of(cells, &joint, design));
    summary["cell_mm"] = cells.cell_mm;
    summary["correlation_inflation"] = cells.inflation;
    summary["significant_share"] = cells.significant_share;
  }
  summary["texture"] = texture_json(scan::texture_of(deviation.map_mm, design.spacing.value()));
  summary["dependences"] = json::array();
  PathUnder path;
  if (!input->gcode.empty() && !nominal.mesh) {
    const double radius = 0.5 * input->ball_diameter_mm;
    MAQUETTE_TRY(path, path_under(input->gcode, nominal.ground ? *nominal.ground : design, radius,
                                  points, run));
  }
  for (const auto& [name, values] : {std::pair{"slope of the design, degrees", &all.slope_deg},
                                     {"angle of incidence, degrees", &all.incidence_deg},
                                     {"range, mm", &all.range_mm},
                                     {"intensity", &all.cloud.intensity},
                                     {"order of the path, m", &path.order_m},
                                     {"direction of feed, degrees", &path.direction_deg},
                                     {"feed, mm/min", &path.feed_mm_min}})
    if (values->size() != d.size())
      continue;
    else if (const scan::Dependence on = scan::depend_on(name, *values, d); on.points.size() > 1)
      summary["dependences"].push_back(dependence_json(on));
  if (!all.part.empty() || !input->axes.empty()) {
    Corrections corrections;
    if (!all.part.empty()) corrections = corrections_of(all, design);
    for (const CaseAxis& axis : input->axes) {
      MAQUETTE_TRY(const auto fit, read_axis_stops(axis.stops));
      corrections.axes.push_back({axis.name, fit});
    }
    summary["corrections"] = corrections_json(corrections);
    result.outputs.push_back(folder / "corrections.toml");
    MAQUETTE_TRY_VOID(write_file(result.outputs.back(), corrections_text(corrections)));
  }
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], summary.dump(1)));
  MAQUETTE_TRY_VOID(heightmap::write_model_grid(deviation.map_mm, design, "mm", result.outputs[1]));
  all.cloud.intensity.clear();
  MAQUETTE_TRY_VOID(scan::write_deviation_ply(all.cloud, in_model, deviation, result.outputs[2]));
  if (nominal.mesh) {
    result.outputs.push_back(folder / "deviation_mesh.ply");
    MAQUETTE_TRY_VOID(scan::write_deviation_mesh(*nominal.mesh, deviation, result.outputs.back()));
  }
  const double limit = colour_limit(deviation.map_mm, 0.05);
  MAQUETTE_TRY_VOID(
      camera::write_png(signed_picture(deviation.map_mm, limit, &design), result.outputs[3]));
  MAQUETTE_TRY_VOID(camera::write_png(
      signed_picture(significant_map(significance, design), limit, &design), significant_png));
  result.outputs.push_back(folder / "report.pdf");
  MAQUETTE_TRY_VOID(write_deviation_report(deviation, design, summary.dump(), limit,
                                           result.outputs[3], significant_png, result.outputs[4],
                                           result.outputs.back()));
  // The histogram belongs to the figures: the run's own report draws it again.
  summary["histogram"] = deviation.histogram;
  summary["histogram_limit_mm"] = deviation.histogram_limit_mm;
  summary["colour_limit_mm"] = limit;
  result.figures_json = summary.dump();
  const auto& s = deviation.statistics;
  const auto off = std::count_if(stones.begin(), stones.end(), [](const scan::StoneFinding& f) {
    return f.state != scan::StoneState::as_planned && f.state != scan::StoneState::present &&
           f.state != scan::StoneState::unseen;
  });
  result.note =
      fmt::format("mean {:+.3f} mm, rms {:.3f} mm over {} points; {} significant patches{}",
                  s.mean_mm, s.rms_mm, s.points, significance.findings.size(),
                  stones.empty() ? "" : fmt::format(", {} stones not as planned", off));
  return result;
}

}  // namespace maquette::tools
