// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file deviation_rows.hpp
/// What a comparison found, as rows of summary.json: the one place where its keys are named.

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "scan/datums.hpp"
#include "scan/find_objects.hpp"
#include "scan/find_spheres.hpp"
#include "scan/find_stones.hpp"
#include "scan/profiles.hpp"
#include "scan/regions.hpp"
#include "scan/significance.hpp"
#include "scan/worst_places.hpp"
#include "tools/corrections_file.hpp"

namespace maquette::tools {

[[nodiscard]] nlohmann::json registration_row(const scan::Registration& r, const std::string& name);
[[nodiscard]] nlohmann::json datum_row(const scan::DatumRegistration& on, const scan::Absorbed& a,
                                       const std::string& name);
[[nodiscard]] nlohmann::json sphere_row(const scan::SphereMatch& match, std::size_t found,
                                        const std::string& name);
[[nodiscard]] nlohmann::json findings_json(const scan::Significance& s);
/// The smallest that the scans could have shown, by width.
[[nodiscard]] nlohmann::json limits_json(const scan::Significance& s);
/// @param beam_mm  widest of the scans' beams; 0: rays
[[nodiscard]] nlohmann::json stones_json(const std::vector<scan::StoneFinding>& stones,
                                         double beam_mm);
[[nodiscard]] nlohmann::json objects_json(const std::vector<scan::ExtraObject>& objects);
[[nodiscard]] nlohmann::json regions_json(const std::vector<scan::RegionResult>& regions);
[[nodiscard]] nlohmann::json worst_places_json(const std::vector<scan::WorstPlace>& places);
[[nodiscard]] nlohmann::json profile_json(const scan::Profile& profile);
[[nodiscard]] nlohmann::json dependence_json(const scan::Dependence& d);
[[nodiscard]] nlohmann::json budget_json(const scan::Budget& budget);
[[nodiscard]] nlohmann::json corrections_json(const Corrections& corrections);
[[nodiscard]] nlohmann::json texture_json(const scan::Texture& texture);

}  // namespace maquette::tools
