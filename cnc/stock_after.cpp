// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/stock_after.hpp"

#include <cmath>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "cnc/gcode_reader.hpp"
#include "cnc/milling_sim.hpp"
#include "cnc/tool_moves.hpp"
#include "cnc/verify.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kMovesPerCut = std::size_t{1} << 18;

}  // namespace

Grid<float> block_heights(const Block& block, Millimetres x0, Millimetres y0, Millimetres spacing,
                          std::ptrdiff_t first_row, std::ptrdiff_t end_row, std::ptrdiff_t cols) {
  Grid<float> z(end_row - first_row, cols, static_cast<float>(block.top.value()));
  if (block.stock == nullptr) return z;
  tbb::parallel_for(first_row, end_row, [&](std::ptrdiff_t r) {
    const double y = y0.value() + spacing.value() * static_cast<double>(r);
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const double x = x0.value() + spacing.value() * static_cast<double>(c);
      const double h = heightmap::height_at(*block.stock, x, y);
      if (std::isfinite(h)) z(r - first_row, c) = static_cast<float>(h);
    }
  });
  return z;
}

Result<heightmap::ModelField> stock_after(std::span<const std::filesystem::path> programs,
                                          std::span<const Tool> tools,
                                          const heightmap::ModelField& like, const Block& block,
                                          const RunContext& run) {
  MAQUETTE_CHECK(!tools.empty(), "no tool");
  std::vector<Cutter> cutters;
  for (const Tool& tool : tools) {
    // What is above the flutes does not cut, and is looked at elsewhere.
    Cutter cutter = tool.cutter;
    cutter.holder.clear();
    cutter.flute_length_mm = 0.0;
    cutters.push_back(cutter);
  }
  MillingSim sim(
      {like.x0.value(), like.y0.value(), like.spacing.value(), 0, 0}, cutters,
      block_heights(block, like.x0, like.y0, like.spacing, 0, like.z_mm.rows(), like.z_mm.cols()));
  std::vector<ToolMove> moves;
  std::uint32_t motions = 0;  // of the batch
  const auto flush = [&] {
    MoveEffects effects(motions);
    sim.cut(moves, effects);
    moves.clear();
    motions = 0;
  };
  for (std::size_t i = 0; i < programs.size(); ++i) {
    const MotionSink sink = [&](std::span<const Motion> some) -> Result<void> {
      for (const Motion& m : some) {
        std::size_t cutter = 0;
        if (tools.size() > 1)
          while (cutter < tools.size() && tools[cutter].number != m.tool) ++cutter;
        if (cutter == tools.size())
          return fail(kToolNotInTable,
                      fmt::format("{}:{}: cuts with tool {}, which is not in the tool table of {} "
                                  "tools",
                                  programs[i].string(), m.line, m.tool, tools.size()));
        append_tool_moves(m, cutters[cutter], static_cast<std::uint16_t>(cutter), motions++, moves);
      }
      if (moves.size() >= kMovesPerCut) flush();
      if (run.stopped()) return fail(kCancelled, "cutting the stock was stopped");
      return {};
    };
    MAQUETTE_TRY_VOID(read_gcode(programs[i], sink, run));
  }
  flush();
  heightmap::ModelField after = like;
  after.z_mm = sim.take_stock();
  return after;
}

}  // namespace maquette::cnc
