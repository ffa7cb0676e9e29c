// SPDX-License-Identifier: GPL-3.0-or-later

// From moments of the program on an axis is off by constants: one that the data show or an even
// one, two that the data show, and of bands as many as stand out.

#include <algorithm>

#include <fmt/ranges.h>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kStepAside_mm = 0.2;
constexpr double kNearby =
    1.0 / 64;  // of the program: as far as a moment that the data show is off
/// Of several moments; closer ones only patch up what a single one, to first order, is wrong by in
/// the passes beside it.
constexpr double kLeastApart = 1.0 / 64;
constexpr std::size_t kTimes = 4;  // that one of several is refined; the data show four at most
constexpr std::size_t kMostSigned = 3;

/// A step whose moment is refined; `step`: distance to the next such form.
struct MakeStep {
  int axis;
  double size_mm, radius_mm, minutes;
  bool tangent = false;
  Form operator()(double share, double step) const {
    Form f{fmt::format("after {:.4f} of the program", share),
           {step_after(axis, share, "step_mm", size_mm, radius_mm, tangent)}};
    // Upright, between passes that were cut before it and after (every other one), a step leaves
    // none of those that it lifts: larger ones do no more there.
    if (axis == 2) {
      f.made_of_mm = size_mm;
      f.at_size = [make = *this, share, step](double size) {
        MakeStep at = make;
        at.size_mm = size;
        at.tangent = true;
        return at(share, step);
      };
    }
    f.fixed = {{"moment_min", share * minutes}};
    f.sign = sign_of(size_mm);
    f.at_moment = [make = *this](double at) { return make(at, kNearby); };
    f.move_moment = [make = *this, share](std::size_t, double later) -> std::optional<Form> {
      const double at = share + later;
      return at > 0.0 && at < 1.0 ? std::optional(make(at, kNearby)) : std::nullopt;
    };
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

/// Moments that are refined in turn: each once, and of two or three some twice.
struct MakeSteps {
  int axis;
  double radius_mm, minutes;
  std::vector<double> sizes_mm;  ///< of the secants, by moment
  const char* law;               ///< nullptr: by the moments

  /// @param next   moment that is refined next
  /// @param times  how often one is; 0: they are as they are
  Form operator()(std::vector<double> moments, std::size_t next, std::size_t times) const {
    Form f{law != nullptr ? law
                          : fmt::format("after {:.4f} of the program", fmt::join(moments, " and ")),
           {}};
    for (std::size_t k = 0; k < moments.size(); ++k) {
      f.columns.push_back(
          step_after(axis, moments[k], fmt::format("step_{}_mm", k + 1), sizes_mm[k], radius_mm));
      f.fixed.emplace_back(fmt::format("moment_{}_min", k + 1), moments[k] * minutes);
    }
    if (law != nullptr) return f;
    f.move_moment = [make = *this, moments](std::size_t which,
                                            double later) -> std::optional<Form> {
      const auto moved = MakeSteps::moved(moments, which, later);
      return moved ? std::optional(make(*moved, 0, 0)) : std::nullopt;
    };
    if (times > 0)
      f.finer = [make = *this, moments, next, times] {
        std::vector<Form> near;
        // Passes are some thousandths of the program, and windows up to eight hundredths.
        for (const double off :
             {-32.0, -16.0, -8.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0})
          if (const auto moved = MakeSteps::moved(moments, next, off / 4096.0))
            near.push_back(make(*moved, (next + 1) % moments.size(), times - 1));
        return near;
      };
    return f;
  }

 private:
  static std::optional<std::vector<double>> moved(std::vector<double> moments, std::size_t which,
                                                  double later) {
    const double before = which > 0 ? moments[which - 1] + kLeastApart : 0.0,
                 after = which + 1 < moments.size() ? moments[which + 1] - kLeastApart : 1.0;
    moments[which] += later;
    return moments[which] > before && moments[which] < after ? std::optional(std::move(moments))
                                                             : std::nullopt;
  }
};

/// Sizes of the secants of so many steps. Of each in height whether the surface behind it is
/// deeper (a deeper ball reaches over the border): all of these for a few, else first order.
std::vector<std::vector<double>> sizes_of_steps(int axis, const Scene& scene, std::size_t count) {
  std::vector<std::vector<double>> all;
  if (axis != 2) {
    for (const double size : sizes_of_drifts(scene, kStepAside_mm)) all.emplace_back(count, size);
    return all;
  }
  if (count > kMostSigned) return {std::vector(count, 0.0)};
  for (std::size_t bits = 0; bits < (std::size_t{1} << count); ++bits) {
    auto& one = all.emplace_back();
    for (std::size_t k = 0; k < count; ++k)
      one.push_back((bits >> k & 1U) != 0 ? -kStepUp_mm : kStepUp_mm);
  }
  return all;
}

}  // namespace

std::vector<Form> refined_steps(int axis, const Scene& scene, std::vector<double> moments) {
  std::sort(moments.begin(), moments.end());
  for (std::size_t k = 1; k < moments.size(); ++k)
    if (moments[k] - moments[k - 1] < kLeastApart) return {};
  std::vector<Form> forms;
  for (auto& sizes : sizes_of_steps(axis, scene, moments.size()))
    forms.push_back(MakeSteps{axis, scene.ball_radius_mm, scene.duration_min, std::move(sizes),
                              nullptr}(moments, 0, kTimes));
  return forms;
}

std::vector<Form> steps_of_sections(const Scene& scene) {
  std::vector<double> moments = scene.section_starts;
  std::sort(moments.begin(), moments.end());
  std::vector<Form> forms;
  if (moments.empty() || moments.size() > kMostSections) return forms;
  for (auto& sizes : sizes_of_steps(2, scene, moments.size()))
    forms.push_back(MakeSteps{2, scene.ball_radius_mm, scene.duration_min, std::move(sizes),
                              kBandsOfTheProgram}(moments, 0, 0));
  return forms;
}

std::vector<Form> step_forms(int axis, const Scene& scene, std::size_t most) {
  std::vector<Form> forms;
  const auto& seen = scene.steps[static_cast<std::size_t>(axis)];
  const auto add = [&](const std::vector<double>& moments) {
    for (Form& f : refined_steps(axis, scene, moments)) forms.push_back(std::move(f));
  };
  // Two of those that the data show, or the sharpest three or four.
  for (std::size_t j = 1; j < seen.size(); ++j)
    for (std::size_t k = 0; k < j; ++k) add({seen[k], seen[j]});
  for (std::size_t n = 3; n <= std::min(most, seen.size()); ++n)
    add({seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(n)});
  const auto sizes =
      axis == 2 ? std::vector{kStepUp_mm, -kStepUp_mm} : sizes_of_drifts(scene, kStepAside_mm);
  for (const double size : sizes) {
    const MakeStep make{axis, size, scene.ball_radius_mm, scene.duration_min};
    for (const double share : seen) forms.push_back(make(share, kNearby));
    for (int k = 1; k < 16; ++k) forms.push_back(make(k / 16.0, 1.0 / 16.0));
  }
  return forms;
}

}  // namespace maquette::diagnosis::detail
