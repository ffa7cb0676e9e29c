// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/stone_clearance.hpp"

#include <algorithm>

#include "cnc/tool_moves.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kListed = 10;
constexpr double kStands_mm = 1e-3;   // higher than the design by this: a stone
constexpr float kNoStone_mm = -1e6F;  // below anything a tool could reach

/// Heights of stones as far as they must not be met; nothing where none stands.
Grid<float> heights_of_stones(const heightmap::ModelField& design,
                              const heightmap::ModelField& with_stones) {
  Grid<float> z(design.z_mm.rows(), design.z_mm.cols(), kNoStone_mm);
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      if (static_cast<double>(with_stones.z_mm(r, c)) >
          static_cast<double>(design.z_mm(r, c)) + kStands_mm)
        z(r, c) = with_stones.z_mm(r, c) - static_cast<float>(kStoneDepth_mm);
  return z;
}

}  // namespace

StoneClearance::StoneClearance(const heightmap::ModelField& design,
                               const heightmap::ModelField& with_stones,
                               std::vector<Cutter> cutters)
    : with_stones_(with_stones),
      cutters_(std::move(cutters)),
      stones_({design.x0.value(), design.y0.value(), design.spacing.value(), 0, 0}, cutters_,
              heights_of_stones(design, with_stones)) {}

void StoneClearance::add(std::span<const Motion> motions, std::uint16_t cutter,
                         std::size_t program) {
  const Cutter& shape = cutters_[cutter];
  if (shape.is_ball()) {
    auto& ball = balls_[cutter];
    if (!ball)
      ball = std::make_unique<PathProof>(with_stones_, BallNose{shape.radius_mm},
                                         PathProofOptions{.limit_mm = kStoneDepth_mm});
    ball->add(motions, program);
    if (shape.holder.empty() && shape.flute_length_mm == 0.0) return;
  }
  sweep(motions, cutter, program);
}

void StoneClearance::sweep(std::span<const Motion> motions, std::uint16_t cutter,
                           std::size_t program) {
  std::vector<ToolMove> moves;
  for (std::size_t i = 0; i < motions.size(); ++i)
    append_tool_moves(motions[i], cutters_[cutter], cutter, static_cast<std::uint32_t>(i), moves);
  MoveEffects effects(motions.size());
  stones_.cut(moves, effects);
  const auto note = [&](bool met, const Motion& m, std::uint64_t& count,
                        std::vector<MotionPlace>& list) {
    if (!met) return;
    ++count;
    if (list.size() < kListed) list.push_back({program, m.line, m.to_mm});
  };
  for (std::size_t i = 0; i < motions.size(); ++i) {
    note(effects.removed[i] > 0 && !cutters_[cutter].is_ball(), motions[i], found_.cutters,
         found_.first_cutters);
    note((effects.touched[i] & MoveEffects::kHolder) != 0, motions[i], found_.holders,
         found_.first_holders);
  }
}

StoneMeetings StoneClearance::finish() {
  for (auto& [cutter, ball] : balls_) {
    const PathCertificate proof = ball->finish();
    found_.cutters += proof.gouging_motions;
    std::vector<PathGouge> places = proof.places;
    std::stable_sort(places.begin(), places.end(), [](const PathGouge& a, const PathGouge& b) {
      return a.program != b.program ? a.program < b.program : a.line < b.line;
    });
    for (const PathGouge& g : places)
      if (found_.first_cutters.size() < kListed)
        found_.first_cutters.push_back(
            {g.program,
             g.line,
             {g.x_mm, g.y_mm, heightmap::height_at(with_stones_, g.x_mm, g.y_mm)}});
  }
  balls_.clear();
  return std::move(found_);
}

}  // namespace maquette::cnc
