// SPDX-License-Identifier: GPL-3.0-or-later

// Bands, tools or programs that do not meet in height: a constant for each. The bands are those
// of the program, or those that the data show.
#include <algorithm>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr std::size_t kTimes = 4;  // that one is refined; the data show four borders at most
constexpr std::size_t kMostSigned = 3;
/// Of the program's time; borders closer than that only patch up what a single one, to first order,
/// is wrong by in the passes beside it.
constexpr double kLeastBand = 1.0 / 64.0;

/// Of each border whether the band behind it is deeper: a deeper ball reaches over the border.
using Deeper = std::vector<bool>;

/// All of them for so few borders, else none: to first order.
std::vector<Deeper> each_deeper(std::size_t borders) {
  if (borders > kMostSigned) return {{}};
  std::vector<Deeper> all;
  for (std::size_t bits = 0; bits < (std::size_t{1} << borders); ++bits) {
    Deeper& one = all.emplace_back();
    for (std::size_t k = 0; k < borders; ++k) one.push_back((bits >> k & 1U) != 0);
  }
  return all;
}

/// Borders whose moments are refined in turn: each once, and of two or three some twice.
struct MakeBands {
  double radius_mm, minutes;
  Deeper deeper;

  /// @param next   border that is refined next
  /// @param times  how often one is; 0: they are as they are
  Form operator()(const std::string& law, std::vector<double> borders, std::size_t next,
                  std::size_t times) const {
    Form f{law, {}};
    for (std::size_t k = 0; k < borders.size(); ++k) {
      const double size_mm = deeper.empty() ? 0.0 : deeper[k] ? -kStepUp_mm : kStepUp_mm;
      f.columns.push_back(
          step_after(2, borders[k], fmt::format("step_{}_mm", k + 1), size_mm, radius_mm));
      f.fixed.emplace_back(fmt::format("moment_{}_min", k + 1), borders[k] * minutes);
    }
    if (times > 0)
      f.finer = [make = *this, law, borders, next, times] {
        const double before = next > 0 ? borders[next - 1] + kLeastBand : 0.0,
                     after = next + 1 < borders.size() ? borders[next + 1] - kLeastBand : 1.0;
        std::vector<Form> near;
        // Passes are some thousandths of the program, and windows up to eight hundredths.
        for (const double off :
             {-32.0, -16.0, -8.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0}) {
          std::vector<double> moved = borders;
          moved[next] += off / 4096.0;
          if (moved[next] > before && moved[next] < after)
            near.push_back(make(law, moved, (next + 1) % borders.size(), times - 1));
        }
        return near;
      };
    return f;
  }
};

/// @param times  as of MakeBands
void add_bands(const Scene& scene, const std::string& law, std::vector<double> borders,
               std::size_t times, std::vector<Form>& forms) {
  std::sort(borders.begin(), borders.end());
  if (times > 0)
    for (std::size_t k = 1; k < borders.size(); ++k)
      if (borders[k] - borders[k - 1] < kLeastBand) return;
  for (Deeper& deeper : each_deeper(borders.size()))
    forms.push_back(MakeBands{scene.ball_radius_mm, scene.duration_min, std::move(deeper)}(
        law, borders, 0, times));
}
}  // namespace

void add_process_band_step(std::vector<Effect>& all) {
  Effect e;
  e.name = "process.band_step";
  e.says = "parts of the surface cut at different times do not meet in height";
  e.source = "tool change, new touch-off; 10 to 50 um";
  e.acts_on = "machine";
  e.depends_on = "band, tool or program";
  e.unknown_shift = std::string("z");
  e.never_beside = "machine.step_loss_z";  // a single border
  e.looks_like = {"machine.step_loss_z", "machine.thermal_growth_z"};
  e.separate_by = "touch-off log of each band";
  e.signature_error = 0.03;
  e.correction = "touch off each band on the same datum";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    if (!scene.section_starts.empty() && scene.section_starts.size() <= kMostSections)
      add_bands(scene, kBandsOfTheProgram, scene.section_starts, 0, forms);
    // Borders that the data show, the sharpest alone, then with the next.
    const auto& seen = scene.steps[2];
    for (std::size_t n = 2; n <= seen.size(); ++n)
      add_bands(scene, fmt::format("{} borders", n),
                {seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(n)}, kTimes, forms);
    for (Form& f : step_forms(2, scene)) forms.push_back(std::move(f));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
