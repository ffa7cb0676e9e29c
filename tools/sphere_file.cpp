// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/sphere_file.hpp"

#include <cmath>
#include <deque>

#include <fmt/format.h>

#include "tools/schema.hpp"

namespace maquette::tools {
namespace {

struct Entry {
  std::string name;
  Vec3 at_mm;
};

}  // namespace

Result<std::vector<ReferenceSphere>> read_spheres(const std::filesystem::path& file) {
  std::deque<Entry> entries;  // their addresses stay
  cnc::SphereSeat seat;
  std::string schema = "maquette.spheres/1";
  Schema t;
  t.add({"schema",
         &schema,
         "version of this file's keys",
         -INFINITY,
         INFINITY,
         {"maquette.spheres/1"}});
  t.add({"sphere_radius_mm", &seat.sphere_radius_mm, "", 1, 200});
  t.add({"hole_radius_mm", &seat.hole_radius_mm, "of the rim they rest on", 0.1, 200});
  t.add({"below_mm", &seat.below_mm, "room between sphere and floor", 0, 100});
  t.array("sphere", "", [&entries] {
    Entry& e = entries.emplace_back();
    Schema s;
    s.add({"name", &e.name, "for a person"});
    s.add({"at_mm", &e.at_mm, "middle of the rim", -1e5, 1e5, {}, true});
    return s;
  });
  MAQUETTE_TRY_VOID(t.read(file));
  if (entries.empty())
    return fail(kConfigInvalid, fmt::format("{}: no [[sphere]] is there", file.string()));
  if (!(seat.hole_radius_mm < seat.sphere_radius_mm))
    return fail(kConfigInvalid,
                fmt::format("{}: hole_radius_mm is {}; a sphere of radius {} mm falls through",
                            file.string(), seat.hole_radius_mm, seat.sphere_radius_mm));
  std::vector<ReferenceSphere> spheres;
  for (const Entry& e : entries) {
    seat.x_mm = e.at_mm.x;
    seat.y_mm = e.at_mm.y;
    seat.rim_mm = e.at_mm.z;
    spheres.push_back(
        {e.name.empty() ? fmt::format("sphere {}", spheres.size() + 1) : e.name, seat});
  }
  return spheres;
}

}  // namespace maquette::tools
