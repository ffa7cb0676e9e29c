// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "meshing/mesh_checks.hpp"
#include "meshing/shaped_solid.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"
#include "tools/joint_holes.hpp"

namespace maquette::tools {

/// Which of the bands that a design is split into, from 0.
struct BandOf {
  meshing::BandSplit split{};
  std::size_t index = 0;
};

/// What is not plain below or at the sides.
struct Shape {
  std::optional<meshing::HollowOptions> hollow{};
  std::string label{};             ///< engraved in a wall; empty: nothing
  double scale_denominator = 0.0;  ///< of a scale bar in the same wall; 0: none
  meshing::EngravingStyle engraving{};
  [[nodiscard]] bool plain() const { return !hollow && !engraves(); }
  [[nodiscard]] bool engraves() const { return !label.empty() || scale_denominator != 0.0; }
};

struct ShapedJob {
  fs::path design;
  std::optional<fs::path> stones{};  ///< united with the ground that they stand on
  Millimetres base_thickness{10.0};  ///< under the lowest point of the whole design
  std::optional<BandOf> band{};      ///< that band alone
  Shape shape{};
  InJoints in_joints{};  ///< of bands
  [[nodiscard]] bool plain() const { return shape.plain() && !in_joints.any(); }
};
/// The solid (PLY) and its certificate beside it, with what was shaped under "hollow",
/// "engraved", "dowels" and "magnets" (those of the band), of a band with stones their numbers
/// under "stones". A mesh that fails its checks is not written.
[[nodiscard]] Result<JobResult> shaped_job(const ShapedJob& job, const fs::path& out,
                                           const RunContext& run);

/// A part of a design, shaped, and what its certificate says of that: an object with "hollow" and
/// "engraved".
struct ShapedPart {
  meshing::Shaping shaping;
  std::string figures_json;
};
[[nodiscard]] Result<ShapedPart> shape_part(const heightmap::ModelField& design,
                                            const meshing::NodeWindow& window, Millimetres base_z,
                                            const Shape& shape, Holes holes, const RunContext& run);

/// Proves the part, with the stones that stand on it (part_with_stones), and then writes it.
/// Without stones it is streamed: what the construction proves, and where it is not too large
/// CGAL's word on it, too.
/// @param shaping  of the window (shape_part)
/// @param write  to `out`
[[nodiscard]] Result<meshing::MeshCertificate> write_part(
    const heightmap::ModelField& design, const meshing::NodeWindow& window,
    std::span<const meshing::PlacedStone> stones, const meshing::SolidOptions& options,
    const meshing::Shaping& shaping, const fs::path& out,
    const std::function<Result<void>(const MeshStream&)>& write, const RunContext& run);

}  // namespace maquette::tools
