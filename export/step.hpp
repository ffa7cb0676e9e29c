// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file step.hpp
/// The terrain as a solid of smooth patches, for CAD programs.
///
/// Takes   ModelField, millimetres, no voids, 4 x 4 nodes or more
/// Gives   STEP (ISO 10303-21, AP214 or AP242): one manifold solid; its top are bicubic B-spline
///         patches of one C2 function (meshing/height_spline.hpp), walls and base are planes
/// By      OpenCASCADE 7.6
///
/// Neighbouring patches are pieces of the same function, so their borders are the same curves; they
/// are sewn to 1e-5 mm, the solid is checked by BRepCheck, written, read back from the file,
/// checked again, and its patches are compared with the heightmap at every node. Only then it gets
/// its name. Same field, same bytes: the header's time is fixed.
///
/// Measured: a million poles take 17 CPU seconds, 0.75 GB and 73 MB of file.
///
/// Errors  CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL, CORE_CANCELLED, MESHING_SURFACE_HAS_VOIDS,
///         EXPORT_EMPTY_MESH (fewer nodes), EXPORT_OPTION_OUT_OF_RANGE (tolerance),
///         EXPORT_TOO_MANY_PATCH_POLES before OpenCASCADE allocates, with what would do,
///         EXPORT_LIBRARY_FAILED (OpenCASCADE refuses, or what was read back is not what was meant)

#include <cstdint>
#include <filesystem>
#include <string>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::exporting {

inline constexpr ErrorCode kTooManyPatchPoles{"EXPORT_TOO_MANY_PATCH_POLES"};

enum class StepSchema : std::uint8_t { ap214, ap242 };

struct StepOptions {
  Millimetres tolerance{0.02};  ///< of the patches at the nodes
  Millimetres base_z{-10.0};    ///< below the lowest node
  StepSchema schema = StepSchema::ap242;
  std::string name = "terrain";
  std::uint64_t most_poles = 6'000'000;  ///< 4.5 GB in OpenCASCADE
};

/// What was read back from the file.
struct StepReport {
  std::uint64_t poles = 0, patches = 0, faces = 0, solids = 0;
  bool valid = false;       ///< BRepCheck
  double volume_mm3 = 0.0;  ///< BRepGProp
  double knot_spacing_mm = 0.0;
  double max_error_mm = 0.0, rms_error_mm = 0.0;  ///< of the heights at the nodes
  std::uint64_t nodes_compared = 0;               ///< all of them
  double max_between_mm = 0.0;       ///< from the triangulated surface at the middles of cells
  double sewing_tolerance_mm = 0.0;  ///< largest one of an edge or a corner
};

[[nodiscard]] Result<StepReport> write_step(const heightmap::ModelField& surface,
                                            const StepOptions& options,
                                            const std::filesystem::path& path,
                                            const RunContext& run = {});
[[nodiscard]] std::string to_json(const StepReport& report);

}  // namespace maquette::exporting
