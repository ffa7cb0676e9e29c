// SPDX-License-Identifier: GPL-3.0-or-later

// Bands, tools or programs that do not meet in height: a constant for each. The bands are those
// of the program, or those that the data show.
#include <algorithm>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr double kSize_mm = 0.05;
}

void add_process_band_step(std::vector<Effect>& all) {
  Effect e;
  e.name = "process.band_step";
  e.says = "parts of the surface cut at different times do not meet in height";
  e.source = "tool change, new touch-off; 10 to 50 um";
  e.acts_on = "machine";
  e.depends_on = "band, tool or program";
  e.unknown_shift = std::string("z");
  e.looks_like = {"machine.step_loss_z", "machine.thermal_growth_z"};
  e.separate_by = "touch-off log of each band";
  e.correction = "touch off each band on the same datum";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    const auto bands = [&](const std::string& law, std::vector<double> borders) {
      std::sort(borders.begin(), borders.end());
      Form f{law, {}};
      for (std::size_t k = 0; k < borders.size(); ++k) {
        f.columns.push_back(step_after(2, borders[k], fmt::format("step_{}_mm", k + 1),
                                       sizes_of_drifts(scene, kSize_mm).back(),
                                       scene.ball_radius_mm));
        f.fixed.emplace_back(fmt::format("moment_{}_min", k + 1), borders[k] * scene.duration_min);
      }
      forms.push_back(std::move(f));
    };
    if (!scene.section_starts.empty() && scene.section_starts.size() <= 12)
      bands("bands of the program", scene.section_starts);
    // Borders that the data show, the sharpest alone, then with the next.
    const auto& seen = scene.steps[2];
    for (std::size_t n = 2; n <= seen.size(); ++n)
      bands(fmt::format("{} borders", n),
            {seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(n)});
    for (Form& f : step_forms(2, scene)) forms.push_back(std::move(f));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
