// SPDX-License-Identifier: GPL-3.0-or-later

// Bands, tools or programs that do not meet in height: a constant for each. The bands are those
// of the program; where it shows none, equal ones or two with an unknown border are tried.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_process_band_step(std::vector<Effect>& all) {
  Effect e;
  e.name = "process.band_step";
  e.says = "parts of the surface cut at different times do not meet in height";
  e.source = "tool change, new touch-off; 10 to 50 um";
  e.acts_on = "machine";
  e.depends_on = "band, tool or program";
  e.looks_like = {"machine.step_loss_z", "machine.thermal_growth_z"};
  e.separate_by = "touch-off log of each band";
  e.correction = "touch off each band on the same datum";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    const auto after = [](double share, const std::string& name) {
      return column(
          fmt::format("steploss_z{:.6f}", share), {name, 1.0, 5.0},
          [share](const Observation& o) { return o.path_share > share ? o.along.z : 0.0; });
    };
    if (!scene.section_starts.empty() && scene.section_starts.size() <= 12) {
      Form f{"bands of the program", {}};
      for (std::size_t k = 0; k < scene.section_starts.size(); ++k)
        f.columns.push_back(after(scene.section_starts[k], fmt::format("step_{}_mm", k + 1)));
      forms.push_back(std::move(f));
    }
    for (const int bands : {2, 3, 4, 5, 6}) {
      Form f{fmt::format("{} equal bands", bands), {}};
      for (int k = 1; k < bands; ++k)
        f.columns.push_back(after(static_cast<double>(k) / bands, fmt::format("step_{}_mm", k)));
      forms.push_back(std::move(f));
    }
    struct Make {
      double minutes;
      Form operator()(double share, double step) const {
        Form f{fmt::format("border at {:.4f} of the program", share),
               {column(fmt::format("steploss_z{:.6f}", share), {"step_mm", 1.0, 5.0},
                       [share](const Observation& o) {
                         return o.path_share > share ? o.along.z : 0.0;
                       })}};
        f.fixed = {{"moment_min", share * minutes}};
        if (step > 1e-3)
          f.finer = [make = *this, share, step] {
            std::vector<Form> near;
            for (int k = -6; k <= 6; ++k)
              if (share + k * step / 7.0 > 0.0)
                near.push_back(make(share + k * step / 7.0, step / 7.0));
            return near;
          };
        return f;
      }
    };
    for (int k = 1; k < 16; ++k) forms.push_back(Make{scene.duration_min}(k / 16.0, 1.0 / 16.0));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
