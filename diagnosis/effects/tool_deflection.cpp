// SPDX-License-Identifier: GPL-3.0-or-later

// The cutter bends away from the wall it cuts, sideways only: n . d = (F / k)(n_x^2 + n_y^2). The
// force differs going up or down a ramp, feed_z, and with the wall on the left or on the right of
// the feed, (feed x n)_z, climb or conventional: two passes of a zigzag do not bend alike; or it
// grows where the cutter plunges and is the same on all that it climbs. A force that depends on the
// ramp alone is n . feed_z. What is drawn behind the feed, up a ramp more than down, is lost motion
// but for the way on which that is taken up (drawn_behind.hpp).
#include "diagnosis/detail/drawn_behind.hpp"
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kSizes_mm[] = {0.03, 0.1, 0.3};

/// A column of tips that bend by towards(feed, slope's normal), mm, for one unit.
template <class Towards>
Column bent(const Scene& scene, const char* name, const char* parameter, double size,
            Towards towards) {
  return cut_column(fmt::format("deflect_{}{}", name, size), {parameter, 1.0, 1.0}, size,
                    scene.ball_radius_mm, [towards](const Observation& o, const CutState& s, Vec3) {
                      return CutChange{towards(s.feed, o.slope_normal)};
                    });
}

Vec3 in_plan(Vec3 v) {
  return {v.x, v.y, 0.0};
}

Form away(const Scene& scene, double size) {
  Form f{fmt::format("away from the wall, about {} mm", size),
         {bent(scene, "side", "sideways_mm", size, [](Vec3, Vec3 n) { return in_plan(n); })}};
  f.sign = 1;
  return f;
}

Form by_ramp_and_side(const Scene& scene, double size) {
  Form f = away(scene, size);
  f.law = fmt::format("away from the wall by ramp and side, about {} mm", size);
  f.columns.push_back(bent(scene, "up", "sideways_up_against_down_mm", 0.3 * size,
                           [](Vec3 feed, Vec3 n) { return feed.z * in_plan(n); }));
  f.columns.push_back(
      bent(scene, "climb", "sideways_left_against_right_mm", 0.3 * size,
           [](Vec3 feed, Vec3 n) { return (feed.x * n.y - feed.y * n.x) * in_plan(n); }));
  return f;
}

/// A flank that it plunges down it cuts with its belly, one that it climbs not less than a level
/// one.
Form away_plunging(const Scene& scene, double size) {
  Form f = away(scene, size);
  f.law = fmt::format("away from the wall, more where it plunges, about {} mm", size);
  f.columns.push_back(bent(scene, "plunge", "sideways_plunging_mm", size,
                           [](Vec3 feed, Vec3 n) { return std::fmax(0.0, -feed.z) * in_plan(n); }));
  return f;
}

}  // namespace

bool is_drawn_behind(const Form& form) {
  return form.columns.size() == 5 && form.columns[3].key.starts_with("deflect_behind");
}

std::vector<Form> drawn_behind(const Scene& scene) {
  std::vector<Form> forms;
  for (const double size : kSizes_mm) {
    Form f = by_ramp_and_side(scene, size);
    f.law = fmt::format("away from the wall and behind the feed, about {} mm", size);
    f.columns.push_back(bent(scene, "behind", "behind_mm", size,
                             [](Vec3 feed, Vec3) { return -1.0 * in_plan(feed); }));
    f.columns.push_back(bent(scene, "behind_up", "behind_up_against_down_mm", size,
                             [](Vec3 feed, Vec3) { return -feed.z * in_plan(feed); }));
    forms.push_back(std::move(f));
  }
  return forms;
}

void add_tool_deflection(std::vector<Effect>& all) {
  Effect e;
  e.name = "tool.deflection";
  e.says = "the cutter bends away from what it cuts";
  e.source = "F / k of a slender cutter; 1 to 20 um in foam, more in wood";
  e.acts_on = "cutter";
  e.depends_on = "slope, engagement, up or down the slope";
  e.unknown_shift = std::string("z");
  e.looks_like = {"tool.radius_error", "machine.backlash_x", "tool.runout"};
  e.separate_by = "a spring pass over one patch";
  e.correction = "shorter tool, lower feed, or a spring pass";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    for (const double size : kSizes_mm) {
      forms.push_back(away(scene, size));
      forms.push_back(away_plunging(scene, size));
      forms.push_back(by_ramp_and_side(scene, size));
    }
    const auto ramp = column("deflect_ramp", {"ramp_mm", 1.0, 1.0}, [](const Observation& o) {
      return o.on_surface ? dot(o.along, o.normal) * o.feed.z : 0.0;
    });
    forms.push_back({"up against down", {ramp}});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
