// SPDX-License-Identifier: GPL-3.0-or-later

// Hides effects, has them found, counts. challenge --photo ...: in photographs, see photo_run.hpp.
//   challenge MAQUETTE [--null N] [--single N] [--double N] [--triple N] [--outside N] [--full]
//             [--seed S] [--from N] [--only I] [--effect NAME] [--points N] [--over X]
//             [--noise X] [--fade K] [--jobs N] [--keep FOLDER] [--controls] [--picture FILE]
//             [--strict]
//             [--all-right]
// --full: 200 null, 600 single, 300 double, 150 triple, 150 outside. Prints a line a case and the
// table; --picture draws the confusion matrix. --strict: exit 1 if a null case is claimed, a name
// is wrong, or something outside the library is not called unexplained; --all-right: or if any case
// is not right.
// Each effect is at least 5 times its detection limit (challenge_case.hpp) where twice its
// usual size is enough for that; cases that hold a smaller one are counted apart. --over X: every
// effect X times its limit.
// --noise: of ranges, coat and block, times what is usual: with little of it a cause shows what of
// it is not explained by its own name.
// --fade: of effect K (from 0) only a millionth is hidden, all else stays: what the others do
// alone.
// --from: the first cases of each kind are passed over; --only: all but one, to see it again.
// --keep: cases stay, with their reports. --jobs: cases at a time, each on one thread if several.

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <string_view>
#include <thread>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "challenge/challenge_case.hpp"
#include "challenge/challenge_score.hpp"
#include "challenge/photo_run.hpp"

namespace {

constexpr double kOver = 5.0;        // limits that a cause has to be found at
constexpr double kMostGrowth = 2.0;  // of a usual size

/// What the report calls a hidden size, where it is one number; empty: not compared.
struct Reported {
  std::string parameter;
  double value = 0.0;
};
Reported reported(const std::string& effect, double size) {
  if (effect.starts_with("machine.scale_")) return {"error_um_per_m", 1e6 * size};
  if (effect.starts_with("machine.squareness_")) return {"angle_urad", 1e6 * size};
  if (effect.starts_with("machine.backlash_")) return {"width_mm", size};
  if (effect.starts_with("machine.step_loss_")) return {"step_mm", size};
  if (effect == "machine.servo_lag") return {"half_square_lag_mm2", 0.5 * size * size};
  if (effect == "machine.thermal_growth_z") return {"growth_mm", size};
  if (effect == "tool.wear") return {"radius_loss_mm", size};
  if (effect == "tool.runout") return {"eccentricity_mm", size};
  if (effect == "tool.deflection") return {"sideways_mm", size};
  if (effect == "coating.thickness") return {"excess_mm", size};
  if (effect == "stock.swelling") return {"growth_um_per_m", 1e6 * size};
  if (effect == "scanner.incidence_bias") return {"coefficient_mm", size};
  return {};
}

struct Settings {
  std::map<std::string, int> counts;
  std::uint64_t seed = 1;
  std::string program, effect, keep, picture;
  bool strict = false, all_right = false, controls = false;
  int points = 300'000, from = 0, only = -1, fade = -1;
  unsigned jobs = 1;
  double over = 0.0, noise = 1.0;
};

struct Tally {
  std::mutex guard;
  std::map<std::string, challenge::Count> result;
  challenge::Confusion confusion;
  challenge::Sizes sizes;
  double slowest = 0;
};

challenge::Options options_of(const Settings& settings, const std::string& kind, int i) {
  challenge::Options o;
  o.seed = settings.seed * 1'000'003 + static_cast<std::uint64_t>(i) * 17 +
           static_cast<std::uint64_t>(kind[0]);
  o.points = settings.points;
  o.noise = settings.noise;
  std::mt19937_64 draw(o.seed);
  const int hide = kind == "null" ? 0 : kind == "double" ? 2 : kind == "triple" ? 3 : 1;
  const auto& names = kind == "outside" ? challenge::nameless() : challenge::hideable();
  while (static_cast<int>(o.effects.size()) < hide) {
    std::string name = names[kind == "single" ? static_cast<std::size_t>(i) % names.size()
                                              : draw() % names.size()];
    if (!settings.effect.empty() && o.effects.empty()) name = settings.effect;
    if (std::find(o.effects.begin(), o.effects.end(), name) == o.effects.end())
      o.effects.push_back(name);
  }
  return o;
}

void one(const Settings& settings, const std::string& kind, int i, Tally& tally) {
  challenge::Options o = options_of(settings, kind, i);
  auto over = challenge::over_limit(o);
  bool small = false;
  std::string sizes;
  for (double& v : over) {
    const double growth = settings.over > 0.0 ? std::min(kMostGrowth, settings.over / v)
                          : v < kOver         ? std::min(kMostGrowth, 1.1 * kOver / v)
                                              : 1.0;
    o.sizes.push_back(growth);
    v *= growth;
    small |= v < kOver;
    sizes += fmt::format(" x{:.1f}", v);
  }
  if (settings.fade >= 0 && settings.fade < static_cast<int>(o.sizes.size()))
    o.sizes[static_cast<std::size_t>(settings.fade)] *= 1e-6;
  const std::filesystem::path folder =
      settings.keep.empty() ? std::filesystem::temp_directory_path() /
                                  fmt::format("challenge_{}", static_cast<long>(o.seed))
                            : std::filesystem::path(settings.keep) / fmt::format("{}_{}", kind, i);
  const auto truth = challenge::make_case(o, folder);
  const auto begin = std::chrono::steady_clock::now();
  const std::string command =
      fmt::format("'{}' diagnose '{}' --out '{}' --quiet{}{} > '{}' 2>&1", settings.program,
                  (folder / "case.toml").string(), (folder / "out").string(),
                  settings.controls ? "" : " --no-controls",
                  settings.jobs > 1 ? " --threads 1" : "", (folder / "log").string());
  const int rc = std::system(command.c_str());
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  nlohmann::json j;
  const std::scoped_lock lock(tally.guard);
  tally.slowest = std::max(tally.slowest, seconds);
  try {
    std::ifstream(folder / "out" / "diagnosis.json") >> j;
  } catch (const std::exception&) {
    fmt::print("{} {} seed {}: no diagnosis (exit {})\n", kind, i, o.seed, rc);
    ++tally.result[kind].cases;
    return;
  }
  const challenge::Verdict v = challenge::judge(kind, truth.effects, j, tally.confusion);
  for (std::size_t k = 0; k < truth.effects.size(); ++k) {
    const Reported is = reported(truth.effects[k], truth.sizes[k]);
    sizes += challenge::compare_size(j, truth.effects[k], is.parameter, is.value, tally.sizes);
  }
  tally.result[small && kind != "outside" ? kind + ", small" : kind].add(v);
  fmt::print("{} {} seed {} {}:{} {} ->{} [{:.1f} s]\n", kind, i, o.seed, v.word(), sizes,
             truth.summary, " " + v.said, seconds);
  if (v.remainder)
    fmt::print("      remains: {} {:.4f} mm\n", j["residual_after"]["unexplained_kinds"].dump(),
               j["residual_after"]["unexplained_rms_mm"].get<double>());
  std::fflush(stdout);
  if (settings.keep.empty()) std::filesystem::remove_all(folder);
}

/// False: not understood.
bool read(int argc, char** argv, Settings& s) {
  if (argc < 2) return false;
  s.program = argv[1];
  for (int i = 2; i < argc; ++i) {
    const std::string a = argv[i];
    if (a == "--full") {
      s.counts = {
          {"null", 200}, {"single", 600}, {"double", 300}, {"triple", 150}, {"outside", 150}};
      continue;
    }
    if (a == "--strict" || a == "--controls" || a == "--all-right") {
      (a == "--strict" ? s.strict : a == "--controls" ? s.controls : s.all_right) = true;
      continue;
    }
    if (i + 1 >= argc) return false;
    const std::string v = argv[++i];
    if (a == "--seed")
      s.seed = std::stoull(v);
    else if (a == "--from")
      s.from = std::stoi(v);
    else if (a == "--only")
      s.only = std::stoi(v);
    else if (a == "--fade")
      s.fade = std::stoi(v);
    else if (a == "--effect")
      s.effect = v;
    else if (a == "--keep")
      s.keep = v;
    else if (a == "--picture")
      s.picture = v;
    else if (a == "--points")
      s.points = std::stoi(v);
    else if (a == "--over")
      s.over = std::stod(v);
    else if (a == "--noise")
      s.noise = std::stod(v);
    else if (a == "--jobs")
      s.jobs = static_cast<unsigned>(std::max(1, std::stoi(v)));
    else if (a == "--null" || a == "--single" || a == "--double" || a == "--triple" ||
             a == "--outside")
      s.counts[a.substr(2)] = std::stoi(v);
    else
      return false;
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "--photo")
    return challenge::run_photos(argc - 2, argv + 2);
  Settings settings;
  if (!read(argc, argv, settings)) {
    std::puts(
        "usage: challenge MAQUETTE [--null N] [--single N] [--double N] [--triple N] [--outside N] "
        "[--full] [--seed S] [--from N] [--only I] [--effect NAME] [--points N] [--over X] "
        "[--noise X] [--fade K] [--jobs N] [--keep FOLDER] [--controls] [--picture FILE] "
        "[--strict] "
        "[--all-right]");
    return 2;
  }
  std::vector<std::pair<std::string, int>> cases;
  for (const char* kind : {"null", "single", "double", "triple", "outside"})
    for (int i = settings.from; i < settings.counts[kind]; ++i)
      if (settings.only < 0 || i == settings.only) cases.emplace_back(kind, i);
  Tally tally;
  std::atomic<std::size_t> next{0};
  {
    std::vector<std::jthread> workers;
    for (unsigned w = 0; w < settings.jobs; ++w)
      workers.emplace_back([&] {
        for (std::size_t k; (k = next++) < cases.size();)
          one(settings, cases[k].first, cases[k].second, tally);
      });
  }
  const challenge::Outcome outcome = challenge::print_table(tally.result, tally.sizes);
  fmt::print("slowest case {:.1f} s, {} at a time\n", tally.slowest, settings.jobs);
  if (!settings.picture.empty()) challenge::write_confusion(tally.confusion, settings.picture);
  return (settings.strict && outcome.fell) || (settings.all_right && !outcome.all_right) ? 1 : 0;
}
