// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stock_after.hpp
/// What programs leave of a block: stock of the next operation.
///
/// Takes   programs in their order, the tools they name, the block before them
/// Gives   its heights at the nodes of the design. Between nodes a ridge may stand higher than they
///         say, by no more than cutters of at least a few spacings leave; what a narrower cutter
///         takes away between nodes is not seen, which errs on the high side.
/// Cost    about a third of verify() with cells of that size: nothing is compared or proven.

#include <filesystem>
#include <span>
#include <vector>

#include "cnc/tool.hpp"
#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct Block {
  Millimetres top{0.0};
  /// What an earlier operation left, instead of the flat top; beyond it and in its voids `top`.
  const heightmap::ModelField* stock = nullptr;
};

/// Heights of the block at nodes `spacing` apart, of a grid that begins at (x0, y0); the rows from
/// `first_row` to before `end_row`.
[[nodiscard]] Grid<float> block_heights(const Block& block, Millimetres x0, Millimetres y0,
                                        Millimetres spacing, std::ptrdiff_t first_row,
                                        std::ptrdiff_t end_row, std::ptrdiff_t cols);

/// @param like  a field over the part: its nodes
/// @return heights at those nodes; the errors of read_gcode(); CNC_TOOL_NOT_IN_TABLE with file and
///         line, where a motion is made with a tool that is not among `tools` (one tool: it cuts
///         all, whatever T says); CORE_CANCELLED
[[nodiscard]] Result<heightmap::ModelField> stock_after(
    std::span<const std::filesystem::path> programs, std::span<const Tool> tools,
    const heightmap::ModelField& like, const Block& block, const RunContext& run = {});

}  // namespace maquette::cnc
