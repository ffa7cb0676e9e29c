// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/structured_light.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/random.hpp"
#include "scan/detail/scan_scene.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;

constexpr double kDegree = std::numbers::pi / 180.0;

Result<void> check_options(const StructuredLightOptions& o) {
  const assets::StructuredLightPreset& s = o.scanner;
  struct Limit {
    const char* what;
    double value, least, most;
  };
  const Quaternion& q = o.model_from_station.rotation;
  const Vec3& t = o.model_from_station.translation_mm;
  const Limit limits[] = {
      {"width_px", static_cast<double>(s.width_px), 1.0, 1e5},
      {"height_px", static_cast<double>(s.height_px), 1.0, 1e5},
      {"focal_length_px", s.focal_length_px, 1.0, 1e7},
      {"baseline_mm", s.baseline_mm, 1e-3, 1e5},
      {"working_distance_mm", s.working_distance_mm, 1.0, 1e6},
      {"projector_width_deg", s.projector_width_deg, 0.01, 170.0},
      {"projector_height_deg", s.projector_height_deg, 0.01, 170.0},
      {"stripe_sigma_px", s.stripe_sigma_px, 0.0, 100.0},
      {"noise_exponent", s.noise_exponent, 0.0, 4.0},
      {"exposure", s.exposure, 1e-9, 1e9},
      {"least_value", s.least_value, 0.0, 1.0},
      {"steepest_deg", s.steepest_deg, 0.0, 90.0},
      {"gloss", s.gloss, 0.0, 1e9},
      {"gloss_exponent", s.gloss_exponent, 0.0, 1e6},
      {"max_points", static_cast<double>(o.max_points), 16.0, 1e12},
      {"norm of the station's rotation", std::hypot(std::hypot(q.w, q.x), std::hypot(q.y, q.z)),
       1.0 - 1e-9, 1.0 + 1e-9},
      {"station x", t.x, -kLargestCoordinateMm, kLargestCoordinateMm},
      {"station y", t.y, -kLargestCoordinateMm, kLargestCoordinateMm},
      {"station z", t.z, -kLargestCoordinateMm, kLargestCoordinateMm},
  };
  for (const Limit& l : limits)
    if (!(l.value >= l.least && l.value <= l.most))
      return fail(kScanOptions, fmt::format("scanner: {} must be between {} and {} but is {}",
                                            l.what, l.least, l.most, l.value));
  return {};
}

enum class Outcome { nothing, lost, point };

class Head {
 public:
  Head(const StructuredLightOptions& options, const detail::ScanScene& scene)
      : o_(options),
        scene_(scene),
        camera_(options.model_from_station.translation_mm),
        projector_(options.model_from_station.point({options.scanner.baseline_mm, 0.0, 0.0})),
        toe_in_rad_(std::atan(options.scanner.baseline_mm / options.scanner.working_distance_mm)) {}

  /// @param right, up  place in the image plane at depth 1
  Outcome measure(double right, double up, std::uint64_t pixel, Vec3& place, float& intensity,
                  Colour& colour) const {
    const assets::StructuredLightPreset& s = o_.scanner;
    const Vec3 ray{right, up, -1.0};
    const Vec3 d = o_.model_from_station.direction(normalized(ray));
    const auto echo = scene_.look(camera_, d);
    if (!echo) return Outcome::nothing;
    const double depth = echo->range_mm / norm(ray);
    const Vec3 local = depth * ray;
    const Vec3 point = camera_ + echo->range_mm * d;

    // Is it in the projector's cone, and lit?
    const double stripe = (s.baseline_mm - local.x) / depth;
    const double across = std::atan(stripe) - toe_in_rad_;
    const double from_projector = std::hypot(s.baseline_mm - local.x, depth);
    if (std::abs(across) > 0.5 * s.projector_width_deg * kDegree ||
        std::abs(std::atan2(local.y, from_projector)) > 0.5 * s.projector_height_deg * kDegree)
      return Outcome::lost;
    if (echo->cos_incidence < std::cos(s.steepest_deg * kDegree)) return Outcome::lost;
    const Vec3 to_light = projector_ - point;
    const double distance = norm(to_light);
    const double cos_light = dot(to_light, echo->normal) / distance;
    if (!(cos_light > 0.0) || !scene_.sees(projector_, point)) return Outcome::lost;

    SurfaceLook look;
    if (o_.paint) look = o_.paint(point, echo->stone);
    const double nearness = s.working_distance_mm / distance;
    const double matt = s.exposure * look.reflectance * cos_light * nearness * nearness;
    double value = matt;
    if (s.gloss > 0.0) {
      const Vec3 half = normalized((1.0 / distance) * to_light - d);
      value += s.gloss * std::pow(std::fmax(0.0, dot(half, echo->normal)), s.gloss_exponent);
    }
    if (value > 1.0 || matt < s.least_value || !(matt > 0.0)) return Outcome::lost;

    const double sigma =
        s.stripe_sigma_px / s.focal_length_px * std::pow(matt / s.exposure, -s.noise_exponent);
    // In angle about the projector: d(tan) = (1 + tan^2) d(angle).
    const double measured =
        stripe + (1.0 + stripe * stripe) * sigma * random_normal(o_.seed, pixel);
    const double found = s.baseline_mm / (right + measured);
    if (!(found > 0.0) || !std::isfinite(found)) return Outcome::lost;
    place = found * ray;
    intensity = static_cast<float>(value);
    colour = look.colour;
    return Outcome::point;
  }

 private:
  const StructuredLightOptions& o_;
  const detail::ScanScene& scene_;
  Vec3 camera_, projector_;
  double toe_in_rad_;
};

struct Line {
  std::vector<Vec3> places;
  std::vector<float> intensity;
  std::vector<Colour> colours;
  std::vector<std::uint32_t> rows;
  std::uint64_t lost = 0;
};

Result<ScanFigures> scan_into(const detail::StationSink& sink, const ModelField& surface,
                              std::span<const TriMesh> stones,
                              const StructuredLightOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_options(options));
  const assets::StructuredLightPreset& s = options.scanner;
  MAQUETTE_TRY(const detail::ScanScene scene, detail::ScanScene::build(surface, stones));
  const Vec3 camera = options.model_from_station.translation_mm;
  MAQUETTE_TRY_VOID(scene.check_outside(camera, "camera"));
  MAQUETTE_TRY_VOID(scene.check_outside(options.model_from_station.point({s.baseline_mm, 0.0, 0.0}),
                                        "projector"));

  ScanFigures figures;
  std::uint32_t every = 1;
  const auto sites = [&] {
    const std::uint64_t rows = (static_cast<std::uint64_t>(s.height_px) + every - 1) / every;
    return rows * ((static_cast<std::uint64_t>(s.width_px) + every - 1) / every);
  };
  while (sites() > options.max_points) ++every;
  figures.widened = every;
  if (every > 1)
    run.warn(fmt::format("one pixel of {0} x {0} is kept, to stay below {1} points", every,
                         options.max_points));
  const auto columns = (static_cast<std::uint32_t>(s.width_px) + every - 1) / every;
  const auto rows = (static_cast<std::uint32_t>(s.height_px) + every - 1) / every;
  figures.directions = std::uint64_t{columns} * rows;

  ScanStation station;
  station.name = options.name;
  station.sensor_vendor = s.vendor;
  station.sensor_model = s.model;
  station.model_from_station = options.model_from_station;
  station.position_mm = camera;
  station.rows = rows;
  station.columns = columns;
  station.fields.intensity = station.fields.grid = true;
  station.fields.colour = options.colour && options.paint;
  station.intensity_limits = {0.0, 1.0};

  const Head head(options, scene);
  // Columns one after the other, as the formats with grids want them.
  constexpr std::uint32_t kBatch = 128;
  std::vector<Line> lines(kBatch);
  PointBatch batch;
  for (std::uint32_t first = 0; first < columns; first += kBatch) {
    if (run.stopped()) return fail(kCancelled, "the simulated scan was cancelled");
    run.progress(static_cast<double>(first) / columns);
    const std::uint32_t count = std::min(kBatch, columns - first);
    oneapi::tbb::parallel_for(std::uint32_t{0}, count, [&](std::uint32_t k) {
      Line& line = lines[k];
      line = {};
      const std::uint32_t px = (first + k) * every;
      const double right = (px + 0.5 - 0.5 * s.width_px) / s.focal_length_px;
      for (std::uint32_t row = 0; row < rows; ++row) {
        const std::uint32_t py = row * every;
        const double up = (0.5 * s.height_px - py - 0.5) / s.focal_length_px;
        const std::uint64_t pixel = std::uint64_t{py} * static_cast<std::uint64_t>(s.width_px) + px;
        Vec3 place;
        float intensity = 0.0F;
        Colour colour;
        const Outcome outcome = head.measure(right, up, pixel, place, intensity, colour);
        if (outcome == Outcome::lost) ++line.lost;
        if (outcome != Outcome::point) continue;
        line.places.push_back(place);
        line.intensity.push_back(intensity);
        line.colours.push_back(colour);
        line.rows.push_back(row);
      }
    });
    batch.clear();
    for (std::uint32_t k = 0; k < count; ++k) {
      const Line& line = lines[k];
      figures.lost += line.lost;
      for (std::size_t i = 0; i < line.places.size(); ++i) {
        batch.points_mm.push_back(line.places[i]);
        batch.intensity.push_back(line.intensity[i]);
        batch.grid.push_back({line.rows[i], first + k});
        if (station.fields.colour) batch.colours.push_back(line.colours[i]);
      }
    }
    if (batch.size() == 0) continue;
    batch.begins_station = figures.points == 0;
    figures.points += batch.size();
    MAQUETTE_TRY_VOID(sink(station, batch));
  }
  if (figures.points == 0)
    return fail(kNothingHit,
                fmt::format("none of {} x {} pixels from ({}, {}, {}) mm gives a point ({} met "
                            "something dark, saturated, steep or unlit); move the scanner",
                            columns, rows, camera.x, camera.y, camera.z, figures.lost));
  run.progress(1.0);
  return figures;
}

}  // namespace

RigidTransform look_at(Vec3 eye, Vec3 target) {
  const Vec3 back = normalized(eye - target);  // the camera's z axis
  Vec3 right = cross(Vec3{0.0, 0.0, 1.0}, back);
  right = norm(right) > 1e-9 ? normalized(right) : Vec3{1.0, 0.0, 0.0};
  const Vec3 up = cross(back, right);
  // Rotation matrix with columns right, up, back to a quaternion (Shepperd 1978,
  // doi:10.2514/3.55767b): the largest component first.
  const double m[3][3] = {
      {right.x, up.x, back.x}, {right.y, up.y, back.y}, {right.z, up.z, back.z}};
  const double trace = m[0][0] + m[1][1] + m[2][2];
  Quaternion q;
  if (trace >= m[0][0] && trace >= m[1][1] && trace >= m[2][2]) {
    q = {1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]};
  } else if (m[0][0] >= m[1][1] && m[0][0] >= m[2][2]) {
    q = {m[2][1] - m[1][2], 1.0 + 2.0 * m[0][0] - trace, m[0][1] + m[1][0], m[0][2] + m[2][0]};
  } else if (m[1][1] >= m[2][2]) {
    q = {m[0][2] - m[2][0], m[0][1] + m[1][0], 1.0 + 2.0 * m[1][1] - trace, m[1][2] + m[2][1]};
  } else {
    q = {m[1][0] - m[0][1], m[0][2] + m[2][0], m[1][2] + m[2][1], 1.0 + 2.0 * m[2][2] - trace};
  }
  return {normalized(q), eye};
}

double depth_sigma_mm(const assets::StructuredLightPreset& s, Vec3 point, double value) {
  const double depth = -point.z;
  const double stripe = (s.baseline_mm - point.x) / depth;
  return depth * depth / s.baseline_mm * (1.0 + stripe * stripe) * s.stripe_sigma_px /
         s.focal_length_px * std::pow(value / s.exposure, -s.noise_exponent);
}

Result<Cloud> simulate_structured_light(const ModelField& surface, std::span<const TriMesh> stones,
                                        const StructuredLightOptions& options,
                                        const RunContext& run) {
  Cloud cloud;
  MAQUETTE_TRY_VOID(scan_into(detail::into(cloud), surface, stones, options, run));
  return cloud;
}

Result<ScanFigures> simulate_structured_light(const ModelField& surface,
                                              std::span<const TriMesh> stones,
                                              const StructuredLightOptions& options,
                                              CloudWriter& writer, const RunContext& run) {
  return scan_into(detail::into(writer), surface, stones, options, run);
}

}  // namespace maquette::scan
