// SPDX-License-Identifier: GPL-3.0-or-later

// The cutter or the work swings at a steady frequency: a wave along the path of wavelength feed
// over frequency, upright. Two phases: counted along the path (steady in time, also while the
// cutter is lifted or the machine turns round) or along the axis of the passes (locked to the
// machine's travel, as of a screw or a rack). 1 to 20 um. It may last for a while only
// (detail/a_while.hpp).
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_process_chatter(std::vector<Effect>& all) {
  Effect e;
  e.name = "process.chatter";
  e.says = "a wave along the passes: vibration at a steady frequency";
  e.source = "Altintas 2012, ch. 4; 1 to 20 um";
  e.acts_on = "cutter";
  e.depends_on = "way along the path";
  e.looks_like = {"tool.runout", "machine.straightness_x"};
  e.separate_by = "the same patch at another feed or speed: chatter changes its wavelength";
  e.correction = "another spindle speed, shorter tool";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    struct Make {
      int along;  // 0: x, 1: y, 2: path
      double span, duration_min;
      // Shares of the program's time: a spindle comes into resonance and out of it again.
      double from = 0.0, to = 1.0;
      Form operator()(PathWave wave, double step) const {
        constexpr double kTurn = 2.0 * 3.14159265358979323846;
        const double k = kTurn * wave.waves / span;
        const auto phase = [along = along, k, wave](const CutState& s) {
          if (along < 2) return k * (along == 0 ? s.tip.x : s.tip.y);
          const double way = s.path_mm + wave.rapid_share * static_cast<double>(s.rapid_mm);
          return k * way + kTurn * wave.at_stops * s.stops;
        };
        const auto per_mm = [along = along, k](const CutState& s) {
          return k * (along == 0 ? s.feed.x : along == 1 ? s.feed.y : 1.0);
        };
        const auto rises = [per_mm](const CutState& s, double height, double by_phase) {
          const double turn = per_mm(s);
          return Drift{{0, 0, height}, {0, 0, turn * by_phase}, {}, turn * turn};
        };
        const bool goes_on = wave.rapid_share != 0.0 || wave.at_stops != 0.0,
                   a_while = from > 0.0 || to < 1.0;
        const auto lasts = [from = from, to = to, a_while](const CutState& s) {
          return !a_while || (s.path_share >= from && s.path_share <= to);
        };
        std::string key = fmt::format("chatter{}{:.4f}", along, wave.waves);
        if (goes_on) key += fmt::format("r{:.6f}l{:.6f}", wave.rapid_share, wave.at_stops);
        if (a_while) key += fmt::format("from{:.6f}to{:.6f}", from, to);
        const char* where = along == 0 ? "x" : along == 1 ? "y" : "the path";
        Form f{fmt::format(
                   "wavelength {:.4f} mm along {}{}{}", span / wave.waves, where,
                   goes_on ? ", on while it stops" : "",
                   a_while ? fmt::format(", from {:.4f} to {:.4f} of the program", from, to) : ""),
               {drift_column(key + "s", {"sine_mm", 1.0, 1.0},
                             [=](const CutState& s) {
                               if (!lasts(s)) return Drift{};
                               const double p = phase(s);
                               return rises(s, std::sin(p), std::cos(p));
                             }),
                drift_column(key + "c", {"cosine_mm", 1.0, 1.0}, [=](const CutState& s) {
                  if (!lasts(s)) return Drift{};
                  const double p = phase(s);
                  return rises(s, std::cos(p), -std::sin(p));
                })}};
        f.fixed = {{"wavelength_mm", span / wave.waves}};
        if (goes_on) {
          f.fixed.emplace_back("rapid_share", wave.rapid_share);
          f.fixed.emplace_back("waves_a_stop", wave.at_stops);
        }
        f.during = [make = *this, wave, step](double begins, double ends) {
          Make some = make;
          some.from = begins;
          some.to = ends;
          return some(wave, step);
        };
        if (a_while) {
          f.fixed.emplace_back("from_min", from * duration_min);
          f.fixed.emplace_back("to_min", to * duration_min);
        } else if (!goes_on && step > 0.02) {
          f.finer = [make = *this, wave, step] {
            std::vector<Form> near;
            for (int i = -3; i <= 3; ++i)
              near.push_back(make({wave.waves + i * step / 4.0}, step / 4.0));
            return near;
          };
        }
        return f;
      }
    };
    std::vector<Form> forms;
    for (const double waves : scene.waves_x)
      forms.push_back(Make{0, 2.0 * scene.half_mm(), scene.duration_min}({waves}, 0.5));
    for (const double waves : scene.waves_y)
      forms.push_back(Make{1, 2.0 * scene.half_mm(), scene.duration_min}({waves}, 0.5));
    for (const PathWave& wave : scene.waves_path)
      forms.push_back(Make{2, scene.cut_mm, scene.duration_min}(wave, 0.5));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
