// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/cutter_proof.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <tbb/parallel_for.h>

#include "cnc/cutter_shape.hpp"

namespace maquette::cnc {
namespace {

constexpr double kChord_mm = 0.001;  // of arcs; the wide cutters are wider by it

double half_mm(int level) {
  return std::ldexp(1.0, -2 * level);
}

struct Piece {
  Vec3 from, to;
};

/// Equal parts of a piece, none longer than twice `half` in plan.
void part(const Piece& piece, double half, std::vector<Piece>& parts) {
  const Vec3 way = piece.to - piece.from;
  const double n = std::fmax(1.0, std::ceil(std::hypot(way.x, way.y) / (2.0 * half) - 1e-9));
  for (double i = 0.0; i < n; ++i)
    parts.push_back({piece.from + (i / n) * way, piece.from + ((i + 1.0) / n) * way});
}

}  // namespace

CutterProof::CutterProof(const heightmap::ModelField& surface, const Cutter& cutter,
                         double limit_mm)
    : surface_(surface), cutter_(cutter), limit_mm_(limit_mm) {
  cutter_.holder.clear();
}

const DropCutter& CutterProof::at_level(int level) {
  auto& wide = wide_[static_cast<std::size_t>(level)];
  if (!wide) wide.emplace(surface_, moved_sideways(cutter_, half_mm(level) + kChord_mm));
  return *wide;
}

double CutterProof::bound(Vec3 from, Vec3 to, int level) const {
  const Vec3 middle = 0.5 * (from + to);
  return wide_[static_cast<std::size_t>(level)]->drop(middle.x, middle.y).tip_mm -
         (std::fmin(from.z, to.z) - kChord_mm);
}

void CutterProof::add(std::span<const Motion> motions) {
  std::vector<Piece> open;
  for (const Motion& m : motions)
    for_each_chord(m, kChord_mm, [&](Vec3 from, Vec3 to) { part({from, to}, half_mm(0), open); });
  for (int level = 0; level < kLevels && !open.empty(); ++level) {
    static_cast<void>(at_level(level));
    std::vector<double> bounds(open.size());
    tbb::parallel_for(std::size_t{0}, open.size(),
                      [&](std::size_t i) { bounds[i] = bound(open[i].from, open[i].to, level); });
    std::vector<Piece> next;
    for (std::size_t i = 0; i < open.size(); ++i) {
      const bool last = level + 1 == kLevels;
      if (bounds[i] <= limit_mm_ || last)
        proven_mm_ = std::fmax(proven_mm_, bounds[i]);
      else
        part(open[i], half_mm(level + 1), next);
    }
    open = std::move(next);
  }
}

}  // namespace maquette::cnc
