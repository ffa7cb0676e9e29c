// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scan_scene.hpp
/// What a simulated scanner looks at: terrain with its four walls, and stones.

#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/field_tracer.hpp"
#include "scan/cloud_stream.hpp"
#include "scan/detail/stone_scene.hpp"

namespace maquette::scan::detail {

struct Echo {
  double range_mm = 0.0;
  Vec3 normal;  ///< unit, towards the viewer
  double cos_incidence = 0.0;
  bool stone = false;
};

/// Keeps references to surface and stones. Thread-safe.
class ScanScene {
 public:
  [[nodiscard]] static Result<ScanScene> build(const heightmap::ModelField& surface,
                                               std::span<const TriMesh> stones);
  /// Of terrain and stones; empty if there is nothing.
  [[nodiscard]] const Box3& bounds() const { return bounds_; }

  /// SCAN_STATION_UNDER_SURFACE if a point is inside the part or inside a stone.
  [[nodiscard]] Result<void> check_outside(Vec3 place_mm, std::string_view what) const;

  /// What answers in a direction: nothing beyond a wall, nothing from below the terrain.
  [[nodiscard]] std::optional<Echo> look(Vec3 origin_mm, Vec3 direction) const;

  /// look() of rays that lie close together.
  void look(std::span<const heightmap::FieldTracer::Ray> rays,
            std::span<std::optional<heightmap::FieldHit>> ground,
            std::span<std::optional<Echo>> echoes) const;

  /// look() in directions of one vertical plane, in one walk over the terrain.
  /// @param horizontal  unit, z = 0; every direction is a positive part of it and some height
  /// @param directions  unit, none higher than the one before
  /// @pre whole()
  void look_across(Vec3 origin_mm, Vec3 horizontal, std::span<const Vec3> directions,
                   std::span<std::optional<Echo>> echoes) const;
  /// Has the terrain no voids?
  [[nodiscard]] bool whole() const { return whole_; }

  /// Is a point of the surface seen from `from_mm`? Walls hide, too.
  [[nodiscard]] bool sees(Vec3 from_mm, Vec3 point_mm) const;

 private:
  [[nodiscard]] std::optional<Echo> answer(Vec3 origin_mm, Vec3 direction,
                                           const std::optional<heightmap::FieldHit>& ground) const;
  /// @param nearest  a wall or the ground
  [[nodiscard]] std::optional<Echo> answer(Vec3 origin_mm, Vec3 direction,
                                           const std::optional<heightmap::FieldHit>& ground,
                                           double nearest_mm) const;
  ScanScene(const heightmap::ModelField& surface, std::span<const TriMesh> stones,
            StoneScene scene);
  const heightmap::ModelField* surface_;
  std::span<const TriMesh> stones_;
  StoneScene stone_scene_;
  heightmap::FieldTracer tracer_;
  Box3 bounds_;
  double top_mm_ = -INFINITY;  // of the surface
  bool whole_ = false;
};

/// Takes the batches of a station in order; the first one has begins_station set.
using StationSink = std::function<Result<void>(const ScanStation&, const PointBatch&)>;

/// Into a cloud in the model frame.
[[nodiscard]] StationSink into(Cloud& cloud);
/// Into a file.
[[nodiscard]] StationSink into(CloudWriter& writer);

}  // namespace maquette::scan::detail
