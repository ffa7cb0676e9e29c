// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/extended_model.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/surface.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::diagnosis {

struct ExtendedModel::Parts {
  heightmap::ModelField ground;
  std::optional<CutPath> path;
  std::optional<SimulatedSurface> surface;
  Scene scene;
  double coat_mm = 0.0;
  bool by_tips = false;
  std::vector<KnownTerm> built, seen;
  std::vector<std::string> names;
  bool blurs = false;
  std::mutex guard;
  std::vector<std::unique_ptr<SpotView>> views;  ///< of the stations asked for so far

  const SpotView& view(Vec3 station) {
    const std::scoped_lock lock(guard);
    for (const auto& v : views)
      if (v->station() == station) return *v;
    views.push_back(std::make_unique<SpotView>(surface->spots(station)));
    return *views.back();
  }
};

ExtendedModel::ExtendedModel(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
ExtendedModel::ExtendedModel(ExtendedModel&&) noexcept = default;
ExtendedModel::~ExtendedModel() = default;

Result<ExtendedModel> ExtendedModel::make(const CaseInput& input, const RunContext& run) {
  auto parts = std::make_unique<Parts>();
  Parts& p = *parts;
  MAQUETTE_TRY(p.ground, heightmap::read_model_field(input.design));
  const double ball = 0.5 * input.ball_diameter_mm;
  if (!input.programs.empty()) {
    MAQUETTE_TRY(auto path, CutPath::read(input.programs, ball, run));
    p.path.emplace(std::move(path));
  }
  // Centre and size are the design's, as in diagnose; contacts are with what was milled.
  p.scene = scene_of(p.ground, p.path ? &*p.path : nullptr, ball);
  if (!input.ground.empty()) {
    MAQUETTE_TRY(p.ground, heightmap::read_model_field(input.ground));
  }
  for (const ScanInput& s : input.scans) {
    p.scene.has_station.push_back(s.station_mm.has_value());
    p.scene.stations.push_back(s.station_mm.value_or(Vec3{}));
  }
  p.surface.emplace(p.ground, p.path ? &*p.path : nullptr, run);
  p.coat_mm = input.coat_mm;
  p.by_tips = p.path && input.contact == MadeBy::tip;
  const std::vector<Vec3> centres(input.scans.size() + input.probes.size(), p.scene.centre());
  MAQUETTE_TRY(auto terms, restore(input.known, p.scene, centres));
  for (KnownTerm& t : terms) (t.scanner ? p.seen : p.built).push_back(std::move(t));
  for (const KnownCause& k : input.known) {
    p.names.push_back(k.effect);
    p.blurs |= k.effect == "scanner.spot_blur";
  }
  return ExtendedModel(std::move(parts));
}

std::optional<Observation> ExtendedModel::place(double x, double y) const {
  auto o = parts_->surface->observe(x, y);
  if (!o) return std::nullopt;
  if (parts_->by_tips) (void)cut_by_tip(*o, parts_->scene);
  o->residual_mm = parts_->coat_mm + moved_mm(*o, parts_->built, parts_->scene.ball_radius_mm);
  return o;
}

const heightmap::ModelField& ExtendedModel::cut() const {
  return parts_->surface->field();
}

std::optional<double> ExtendedModel::raised_mm(double x, double y) const {
  const auto o = place(x, y);
  return o ? std::optional(o->residual_mm / o->normal.z) : std::nullopt;
}

std::optional<double> ExtendedModel::height_mm(double x, double y) const {
  const auto o = place(x, y);
  return o ? std::optional(o->place.z + o->residual_mm / o->normal.z) : std::nullopt;
}

void ExtendedModel::build(heightmap::ModelField& surface) const {
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, surface.z_mm.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < surface.z_mm.cols(); ++c) {
      float& z = surface.z_mm(r, c);
      if (std::isnan(z)) continue;
      if (const auto by = raised_mm(surface.x_mm(c), surface.y_mm(r)))
        z = static_cast<float>(static_cast<double>(z) + *by);
    }
  });
}

Vec3 ExtendedModel::seen(Vec3 p, Vec3 station, std::size_t scan) const {
  auto o = parts_->surface->observe(p.x, p.y);
  if (!o) return p;
  o->set_up = static_cast<std::uint32_t>(scan);
  o->has_station = true;
  o->range_mm = norm(p - station);
  o->beam = (1.0 / o->range_mm) * (p - station);
  if (parts_->blurs) o->spot = parts_->view(station).further(o->place);
  o->place = p;
  const auto moved = [&](Vec3 along) {
    o->along = along;
    return moved_mm(*o, parts_->seen, parts_->scene.ball_radius_mm);
  };
  return p + Vec3{moved({1, 0, 0}), moved({0, 1, 0}), moved({0, 0, 1})};
}

bool ExtendedModel::moves_points() const {
  return !parts_->seen.empty();
}

const Scene& ExtendedModel::scene() const {
  return parts_->scene;
}

const std::vector<std::string>& ExtendedModel::names() const {
  return parts_->names;
}

}  // namespace maquette::diagnosis
