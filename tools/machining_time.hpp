// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file machining_time.hpp
/// The machining-time table, for a person. Figures and certificates carry it as `machining_time`, a
/// list of {program, tool, band, cutting_min, rapid_min, waiting_min, total_min, length_m}.

#include <string>

#include <nlohmann/json_fwd.hpp>

namespace maquette::tools {

/// One line a row, the sums of each tool and of all below; "" where there are no rows.
[[nodiscard]] std::string machining_time_table(const nlohmann::json& figures);

}  // namespace maquette::tools
