// SPDX-License-Identifier: GPL-3.0-or-later

// What extended.toml has added to the model, taken off the residuals again.

#include <cmath>
#include <optional>

#include <fmt/format.h>

#include "diagnosis/case_input.hpp"
#include "diagnosis/effect.hpp"

namespace maquette::diagnosis {
namespace {

double distance(const Form& f, const KnownCause& k) {
  double sum = 0.0;
  for (const auto& [name, value] : f.fixed)
    for (const auto& [other, wanted] : k.fixed)
      if (name == other) sum += std::abs(value - wanted);
  return sum;
}

/// The form of that law; a refined one is reached through its neighbours, closest first.
std::optional<Form> restore(const Effect& effect, const Scene& scene, const KnownCause& k) {
  if (!effect.forms) return std::nullopt;
  auto forms = effect.forms(scene);
  for (int depth = 0; depth < 8 && !forms.empty(); ++depth) {
    const Form* best = nullptr;
    for (const Form& f : forms) {
      if (f.law == k.law) return f;
      if (f.columns.size() != k.parameters.size() || f.fixed.empty()) continue;
      if (best == nullptr || distance(f, k) < distance(*best, k)) best = &f;
    }
    if (best == nullptr) return std::nullopt;
    if (!best->finer) return *best;
    forms = best->finer();
  }
  return std::nullopt;
}

}  // namespace

Result<void> take_off(const std::vector<KnownCause>& known, Measurements& m) {
  for (const KnownCause& k : known) {
    const Effect* effect = find_effect(k.effect);
    if (effect == nullptr)
      return fail(kUnknownCause, fmt::format("[[cause]] effect = \"{}\": the library has no such "
                                             "cause; names are those of diagnosis.json",
                                             k.effect));
    const auto value = [&](const std::string& name) {
      for (const auto& [n, v] : k.parameters)
        if (n == name) return v;
      return 0.0;
    };
    if (k.effect == "tool.length_offset") {
      for (Observation& o : m.observations) o.residual_mm -= value("offset_mm") * o.along.z;
      continue;
    }
    if (k.effect == "scanner.registration") {
      const auto scan = static_cast<std::uint32_t>(k.fixed.empty() ? 0.0 : k.fixed[0].second - 1.0);
      if (scan >= m.set_ups.size())
        return fail(kUnknownCause, "[[cause]] scanner.registration names a scan that is not there");
      const Vec3 shift{value("shift_x_mm"), value("shift_y_mm"), value("shift_z_mm")};
      const Vec3 turn{value("turn_x_urad"), value("turn_y_urad"), value("turn_z_urad")};
      for (Observation& o : m.observations)
        if (o.set_up == scan)
          o.residual_mm -=
              dot(o.along, shift + cross(1e-6 * turn, o.place - m.set_ups[scan].centre_mm));
      continue;
    }
    Scene scene = m.scene;
    for (const auto& [name, v] : k.fixed)
      if (name.starts_with("moment_") && scene.duration_min > 0.0) {
        for (auto& steps : scene.steps) steps.push_back(v / scene.duration_min);
      } else if (name == "wavelength_mm" && v > 0.0) {
        // Waves are candidates where the data show them; here the file does.
        scene.waves_x.push_back(2.0 * scene.half_mm() / v);
        scene.waves_y.push_back(2.0 * scene.half_mm() / v);
        scene.waves_path.push_back(scene.cut_mm / v);
      }
    KnownCause wanted = k;
    if (k.effect == "scanner.range_bias") wanted.law = "constant";
    const auto form = restore(*effect, scene, wanted);
    if (!form)
      return fail(kUnknownCause, fmt::format("[[cause]] {}: no law \"{}\" with {} parameters",
                                             k.effect, k.law, k.parameters.size()));
    for (std::size_t c = 0; c < form->columns.size(); ++c) {
      const Parameter& p = form->columns[c].parameter;
      const double coefficient =
          (c < k.parameters.size() ? k.parameters[c].second : 0.0) / p.per_column;
      for (Observation& o : m.observations)
        o.residual_mm -= coefficient * form->columns[c].value(o);
    }
  }
  return {};
}

}  // namespace maquette::diagnosis
