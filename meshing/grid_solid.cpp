// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/check.hpp"
#include "meshing/detail/shell.hpp"
#include "meshing/solid.hpp"

namespace maquette::meshing {

Result<TriMesh> grid_solid(const heightmap::ModelField& surface, const SolidOptions& options,
                           const RunContext& run) {
  MAQUETTE_TRY_VOID(detail::check_surface(surface, options));
  return detail::close_shell(surface, options.base_z.value(), {}, run);
}

}  // namespace maquette::meshing
