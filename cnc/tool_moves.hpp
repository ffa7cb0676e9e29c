// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file tool_moves.hpp
/// Motions of a program -> moves that the simulation sweeps in closed form: arcs in pieces flat
/// enough to be bounded by their chords, arcs that a cutter has no closed form for as chords
/// within kPieceDeviation_mm.

#include <vector>

#include "cnc/gcode_reader.hpp"
#include "cnc/milling_sim.hpp"

namespace maquette::cnc {

/// Largest distance of an arc's piece from its chord; only speed depends on it.
inline constexpr double kPieceSag_mm = 0.05;
/// What the simulation's underside of a bull nose on a slope may be too high by.
inline constexpr double kSolvedHeight_mm = 1e-6;

void append_tool_moves(const Motion& motion, const Cutter& cutter, std::uint16_t cutter_index,
                       std::uint32_t motion_index, std::vector<ToolMove>& moves);

/// Largest radius of cutter, shank and holder.
[[nodiscard]] double widest_mm(const Cutter& cutter);

}  // namespace maquette::cnc
