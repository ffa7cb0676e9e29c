// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/motion_store.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cnc/arc_geometry.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kChunk = 4096;
constexpr std::uint8_t kJump = 255;  // no motion: the next one starts here

}  // namespace

MotionStore::Chunk& MotionStore::open_chunk(Vec3 from) {
  if (chunks_.empty() || chunks_.back().motions.size() >= kChunk) {
    chunks_.push_back({from, from.y, from.y, static_cast<std::uint32_t>(size_), {}});
    chunks_.back().motions.reserve(kChunk + 1);
  }
  return chunks_.back();
}

void MotionStore::add(const Motion& m, std::uint16_t cutter) {
  Chunk& chunk = open_chunk(m.from_mm);
  const bool first = chunk.motions.empty();
  if (!first && at_ != m.from_mm) chunk.motions.push_back({m.from_mm, 0, 0, 0, kJump, 0, 0});
  Packed packed{m.to_mm, static_cast<float>(m.feed_mm_min), static_cast<std::uint32_t>(m.line),
                0,       static_cast<std::uint8_t>(m.kind), static_cast<std::uint8_t>(m.plane),
                cutter};
  double y_min = std::fmin(m.from_mm.y, m.to_mm.y), y_max = std::fmax(m.from_mm.y, m.to_mm.y);
  if (m.kind == Motion::Kind::arc) {
    const PlaneAxes axes = axes_of(m.plane);
    const std::array<double, 3> c{m.centre_mm.x, m.centre_mm.y, m.centre_mm.z};
    packed.arc = static_cast<std::uint32_t>(arcs_.size());
    arcs_.push_back({c[axes.first], c[axes.second], m.sweep_rad});
    if (m.plane != ArcPlane::zx) {
      const double r = std::fmax(norm(m.from_mm - m.centre_mm), norm(m.to_mm - m.centre_mm));
      y_min = std::fmin(y_min, m.centre_mm.y - r);
      y_max = std::fmax(y_max, m.centre_mm.y + r);
    }
  }
  chunk.motions.push_back(packed);
  chunk.y_min = std::fmin(chunk.y_min, y_min);
  chunk.y_max = std::fmax(chunk.y_max, y_max);
  at_ = m.to_mm;
  ++size_;
}

void MotionStore::for_each(double y_min, double y_max, double reach_mm,
                           const std::function<void(const Stored&)>& visit) const {
  Stored stored{};
  for (const Chunk& chunk : chunks_) {
    if (chunk.y_max + reach_mm < y_min || chunk.y_min - reach_mm > y_max) continue;
    Vec3 at = chunk.start;
    std::uint32_t index = chunk.first_index;
    for (const Packed& p : chunk.motions) {
      if (p.kind != kJump) {
        Motion& m = stored.motion;
        m.kind = static_cast<Motion::Kind>(p.kind);
        m.plane = static_cast<ArcPlane>(p.plane);
        m.from_mm = at;
        m.to_mm = p.to;
        m.centre_mm = {};
        m.sweep_rad = 0.0;
        if (m.kind == Motion::Kind::arc) {
          const PlaneAxes axes = axes_of(m.plane);
          const Arc& arc = arcs_[p.arc];
          std::array<double, 3> c{at.x, at.y, at.z};
          c[axes.first] = arc.first;
          c[axes.second] = arc.second;
          m.centre_mm = {c[0], c[1], c[2]};
          m.sweep_rad = arc.sweep;
        }
        m.feed_mm_min = static_cast<double>(p.feed);
        m.line = p.line;
        stored.index = index++;
        stored.cutter = p.cutter;
        visit(stored);
      }
      at = p.to;
    }
  }
}

}  // namespace maquette::cnc
