// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/extended.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>
#include "tools/milling.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;

diagnosis::CaseInput diagnosis_input(const Case& c, std::uint64_t seed) {
  diagnosis::CaseInput input;
  input.design = c.design;
  input.ground = c.ground;
  input.stones = c.stones;
  for (const fs::path& program : c.gcode)
    for (fs::path& part : parts_of(program)) input.programs.push_back(std::move(part));
  input.ball_diameter_mm = c.ball_diameter_mm;
  const auto by_tip = [](const CaseCause& cause) { return cause.contact == "tip"; };
  if (!c.contact.empty() || !c.causes.empty())
    input.contact =
        c.contact == "tip" || (c.contact.empty() && std::ranges::any_of(c.causes, by_tip))
            ? diagnosis::MadeBy::tip
            : diagnosis::MadeBy::ball;
  input.coat_mm = c.coating_thickness_mm;
  input.coat_sigma_mm = c.coating_roughness_sigma_mm;
  input.coat_correlation_mm = c.coating_roughness_correlation_mm;
  for (const CaseScan& s : c.scans) {
    const bool known = std::isfinite(s.scanner_position_mm.x) &&
                       std::isfinite(s.scanner_position_mm.y) &&
                       std::isfinite(s.scanner_position_mm.z);
    input.scans.push_back({s.points, known ? std::optional(s.scanner_position_mm) : std::nullopt,
                           s.range_sigma_mm, s.beam_diameter_mm});
  }
  for (const CaseProbe& p : c.probes) input.probes.push_back(p.points);
  for (const CaseCause& cause : c.causes) {
    diagnosis::KnownCause known{cause.effect, cause.law, {}, {}};
    for (std::size_t k = 0; k < std::min(cause.names.size(), cause.values.size()); ++k)
      known.parameters.emplace_back(cause.names[k], cause.values[k]);
    for (std::size_t k = 0; k < std::min(cause.fixed_names.size(), cause.fixed_values.size()); ++k)
      known.fixed.emplace_back(cause.fixed_names[k], cause.fixed_values[k]);
    input.known.push_back(std::move(known));
  }
  input.seed = seed;
  return input;
}

Result<diagnosis::ExtendedModel> extended_model(const Extended& extended, const RunContext& run) {
  MAQUETTE_TRY(const auto c, read_case(extended.file));
  auto input = diagnosis_input(*c, 1);
  if (extended.design) {
    input.design = *extended.design;
    input.ground.clear();
  }
  if (!extended.programs.empty()) input.programs = extended.programs;
  auto model = diagnosis::ExtendedModel::make(input, run);
  if (!model) return tl::unexpected(std::move(model.error()).within(extended.file.string()));
  return model;
}

namespace {

class AsSeen : public scan::CloudWriter {
 public:
  AsSeen(const diagnosis::ExtendedModel& model, scan::CloudWriter& writer,
         std::span<const Vec3> stations, std::size_t first)
      : model_(model), writer_(writer), stations_(stations.begin(), stations.end()), next_(first) {}

  [[nodiscard]] bool keeps_poses() const override { return writer_.keeps_poses(); }
  Result<void> begin_station(const scan::ScanStation& station) override {
    model_from_station_ = station.model_from_station;
    scan_ = next_++;
    return writer_.begin_station(station);
  }
  Result<void> write(const scan::PointBatch& batch) override {
    moved_ = batch;
    const RigidTransform back = model_from_station_.inverse();
    const Vec3 station = stations_[scan_ % stations_.size()];
    oneapi::tbb::parallel_for(std::size_t{0}, batch.size(), [&](std::size_t i) {
      if (batch.has_position(i))
        moved_.points_mm[i] =
            back.point(model_.seen(model_from_station_.point(batch.points_mm[i]), station, scan_));
    });
    return writer_.write(moved_);
  }
  Result<void> finish() override { return writer_.finish(); }

 private:
  const diagnosis::ExtendedModel& model_;
  scan::CloudWriter& writer_;
  std::vector<Vec3> stations_;
  std::size_t next_, scan_ = 0;
  RigidTransform model_from_station_;
  scan::PointBatch moved_;
};

}  // namespace

std::unique_ptr<scan::CloudWriter> as_seen(const diagnosis::ExtendedModel& model,
                                           scan::CloudWriter& writer,
                                           std::span<const Vec3> stations, std::size_t first) {
  return std::make_unique<AsSeen>(model, writer, stations, first);
}

}  // namespace maquette::tools
