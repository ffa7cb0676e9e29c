// SPDX-License-Identifier: GPL-3.0-or-later

// Stones are measured one by one (stones.cpp): each has a pose of its own, which no column that all
// points share could have. So these causes have no forms.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_stones(std::vector<Effect>& all) {
  Effect pose;
  pose.name = "stone.pose";
  pose.says = "a stone stands elsewhere than planned";
  pose.source = "placing by hand or template 0.5 to 2 mm; glue gap 0.1 to 0.5 mm";
  pose.acts_on = "stones";
  pose.depends_on = "the stone";
  pose.looks_like = {"stone.shrink"};
  pose.separate_by = "touch the stone's highest point and two of its sides with a probe";
  pose.correction = "take the measured pose into the digital model (extended.toml), or set it anew";
  pose.needs = Needs::stones;
  all.push_back(pose);

  Effect shrink;
  shrink.name = "stone.shrink";
  shrink.says = "stones came out smaller or larger than they were ordered";
  shrink.source =
      "laser sintering: 0.127 mm or 0.2 %, whichever is more; shrinkage 2 to 4 % left in";
  shrink.acts_on = "stones";
  shrink.depends_on = "size of the stone";
  shrink.looks_like = {"coating.thickness", "stone.pose"};
  shrink.separate_by = "a caliper over stones of two sizes";
  shrink.correction = "order them by that much larger";
  shrink.needs = Needs::stones;
  all.push_back(shrink);

  Effect missing;
  missing.name = "stone.missing";
  missing.says = "a stone of the plan is not there";
  missing.source = "left out or broken off";
  missing.acts_on = "stones";
  missing.depends_on = "the stone";
  missing.separate_by = "look";
  missing.correction = "glue it on";
  missing.needs = Needs::stones;
  all.push_back(missing);
}

}  // namespace maquette::diagnosis::detail
