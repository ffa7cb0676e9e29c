// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/nominal_part.hpp"

#include <utility>

#include <fmt/format.h>

#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "scan/deviate.hpp"
#include "scan/expected_surface.hpp"
#include "scan/upper_envelope.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
using heightmap::ModelField;
namespace {

/// A part of any shape: STL, PLY, OBJ.
Result<void> read_mesh_design(NominalPart& n, const Case& input, const RunContext& run) {
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

}  // namespace

Result<void> read_nominal(NominalPart& n, const Case& input, const RunContext& run) {
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
  if (!n.stone_plan.empty())
    n.expected_ground =
        scan::expected_surface(*n.ground, *n.ground, as_milled ? &*as_milled : nullptr,
                               Millimetres{input.coating_thickness_mm});
  return {};
}

}  // namespace maquette::tools
