// SPDX-License-Identifier: GPL-3.0-or-later

// Hides effects, has them found, counts. challenge --photo ...: in photographs, see photo_run.hpp.
//   challenge MAQUETTE [--null N] [--single N] [--double N] [--triple N] [--outside N] [--full]
//             [--seed S] [--from N] [--only I] [--effect NAME] [--points N] [--over X]
//             [--noise X] [--fade K] [--smooth] [--rms MM] [--wavy MM] [--wavy-length MM]
//             [--jobs N] [--results FOLDER] [--keep FOLDER] [--controls] [--oracle]
//             [--picture FILE] [--strict] [--all-right]
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
// --smooth: of the effects those that vary slowly over the part. --rms: every effect moves that
// much (root mean square along the normal that poses do not take). --wavy, --wavy-length: the
// block's smooth random part in the place of what is drawn, and no rough coat. With these three: is
// something of a size found?
// --oracle: the same once more with nothing hidden; what the report blocks gain over what one gains
// who knows the causes.
// --from: the first cases of each kind are passed over; --only: all but one, to see it again.
// --keep: cases stay, with their reports. --jobs: cases at a time, each on one thread if several.
// --results: a folder of what each case was and what was said of it; cases that are there are not
// made again, so that a long table can be made in parts or go on after an interruption (of one
// program and one set of options: not checked but for the seed).

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "challenge/challenge_case.hpp"
#include "challenge/challenge_score.hpp"
#include "challenge/challenge_settings.hpp"
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

struct Settings : challenge::CommonSettings {
  bool controls = false, smooth = false, oracle = false;
  int points = 300'000, fade = -1;
  double over = 0.0, noise = 1.0, rms_mm = 0.0, wavy_mm = -1.0, wavy_length_mm = 100.0;
  std::string results;
};

struct Tally {
  std::mutex guard;
  std::map<std::string, challenge::Count> result;
  challenge::Confusion confusion;
  challenge::Sizes sizes;
  challenge::Gains gains;
  std::vector<double> seconds;
};

challenge::Options options_of(const Settings& settings, const std::string& kind, int i) {
  challenge::Options o;
  o.seed = challenge::seed_of(settings, kind, i);
  o.points = settings.points;
  o.noise = settings.noise;
  o.wavy_mm = settings.wavy_mm;
  o.wavy_length_mm = settings.wavy_length_mm;
  o.effects = challenge::effects_of(settings, kind, i,
                                    kind == "outside" ? challenge::nameless()
                                    : settings.smooth ? challenge::smooth_ones()
                                                      : challenge::hideable(),
                                    kind == "single");
  return o;
}

/// Runs diagnose on a case. @return its report, null if there is none
nlohmann::json diagnosed(const Settings& settings, const std::filesystem::path& folder) {
  const std::string command =
      fmt::format("'{}' diagnose '{}' --out '{}' --quiet{}{} > '{}' 2>&1", settings.program,
                  (folder / "case.toml").string(), (folder / "out").string(),
                  settings.controls ? "" : " --no-controls",
                  settings.jobs > 1 ? " --threads 1" : "", (folder / "log").string());
  const int rc = std::system(command.c_str());
  nlohmann::json j;
  std::ifstream in(folder / "out" / "diagnosis.json");
  if (!in) {
    fmt::print("{}: no diagnosis (exit {})\n", folder.string(), rc);
    return j;
  }
  in >> j;
  return j;
}

/// A case made and diagnosed: the truth, the report, that of the twin where nothing is hidden (null
/// without --oracle), seconds; "diagnosis" is null where there is none.
nlohmann::json made_and_diagnosed(const Settings& settings, const std::string& kind, int i) {
  challenge::Options o = options_of(settings, kind, i);
  bool small = false;
  std::string limits;
  for (const challenge::Shown& usual : challenge::over_limit(o)) {
    const double growth = settings.rms_mm > 0.0 ? settings.rms_mm / usual.rms_mm
                          : settings.over > 0.0 ? std::min(kMostGrowth, settings.over / usual.over)
                          : usual.over < kOver  ? std::min(kMostGrowth, 1.1 * kOver / usual.over)
                                                : 1.0;
    o.sizes.push_back(growth);
    const double over = usual.over * growth;
    small |= over < kOver;
    limits += fmt::format(" x{:.1f}", over);
  }
  if (settings.fade >= 0 && settings.fade < static_cast<int>(o.sizes.size()))
    o.sizes[static_cast<std::size_t>(settings.fade)] *= 1e-6;
  const std::filesystem::path folder =
      settings.keep.empty() ? std::filesystem::temp_directory_path() /
                                  fmt::format("challenge_{}", static_cast<long>(o.seed))
                            : std::filesystem::path(settings.keep) / fmt::format("{}_{}", kind, i);
  const auto truth = challenge::make_case(o, folder);
  const auto begin = std::chrono::steady_clock::now();
  nlohmann::json j = diagnosed(settings, folder);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  nlohmann::json twin;
  if (settings.oracle && !o.effects.empty() && !j.is_null()) {
    challenge::Options nothing = o;
    for (double& size : nothing.sizes) size *= 1e-6;
    challenge::make_case(nothing, folder / "twin");
    twin = diagnosed(settings, folder / "twin");
  }
  if (settings.keep.empty()) std::filesystem::remove_all(folder);
  return {{"seed", o.seed},         {"small", small},
          {"limits", limits},       {"effects", truth.effects},
          {"sizes", truth.sizes},   {"summary", truth.summary},
          {"seconds", seconds},     {"diagnosis", std::move(j)},
          {"twin", std::move(twin)}};
}

/// The case as it is kept in --results, or made now and kept there.
nlohmann::json record_of(const Settings& settings, const std::string& kind, int i) {
  if (settings.results.empty()) return made_and_diagnosed(settings, kind, i);
  const std::filesystem::path file =
      std::filesystem::path(settings.results) / fmt::format("{}_{}.json", kind, i);
  if (std::ifstream in(file); in) {
    nlohmann::json kept = nlohmann::json::parse(in);
    if (kept["seed"] != challenge::seed_of(settings, kind, i))
      throw std::runtime_error(
          fmt::format("{}: of another --seed; give a folder of its own", file.string()));
    return kept;
  }
  nlohmann::json record = made_and_diagnosed(settings, kind, i);
  std::filesystem::create_directories(settings.results);
  const std::filesystem::path beside = file.string() + ".part";
  std::ofstream(beside) << record;
  std::filesystem::rename(beside, file);
  return record;
}

void one(const Settings& settings, const std::string& kind, int i, Tally& tally) {
  const nlohmann::json record = record_of(settings, kind, i);
  const nlohmann::json &j = record["diagnosis"], &twin = record["twin"];
  const auto effects = record["effects"].get<std::vector<std::string>>();
  const auto seconds = record["seconds"].get<double>();
  const std::scoped_lock lock(tally.guard);
  tally.seconds.push_back(seconds);
  if (j.is_null()) {
    ++tally.result[kind].cases;
    return;
  }
  const challenge::Verdict v = challenge::judge(kind, effects, j, tally.confusion);
  std::string sizes = record["limits"];
  for (std::size_t k = 0; k < effects.size(); ++k) {
    const Reported is = reported(effects[k], record["sizes"][k]);
    sizes += challenge::compare_size(j, effects[k], is.parameter, is.value, tally.sizes);
  }
  if (!twin.is_null())
    sizes += fmt::format(" [gain {:.4f}]",
                         tally.gains.add(j["gain"]["rms_before"], j["gain"]["rms_after"],
                                         twin["gain"]["rms_before"]));
  tally.result[record["small"] && kind != "outside" ? kind + ", small" : kind].add(v);
  fmt::print("{} {} seed {} {}:{} {} ->{} [{:.1f} s]\n", kind, i,
             record["seed"].get<std::uint64_t>(), v.word(), sizes,
             record["summary"].get<std::string>(), " " + v.said, seconds);
  if (v.remainder)
    fmt::print("      remains: {} {:.4f} mm\n", j["residual_after"]["unexplained_kinds"].dump(),
               j["residual_after"]["unexplained_rms_mm"].get<double>());
  std::fflush(stdout);
}

/// False: not understood.
bool read(const std::vector<std::string>& words, Settings& s) {
  const auto flag = [&](const std::string& a, const std::string&) {
    for (const auto& [name, value] :
         {std::pair{"--controls", &s.controls}, {"--smooth", &s.smooth}, {"--oracle", &s.oracle}})
      if (a == name) return *value = true;
    return false;
  };
  const auto valued = [&](const std::string& a, const std::string& v) {
    if (a == "--fade")
      s.fade = std::stoi(v);
    else if (a == "--points")
      s.points = std::stoi(v);
    else if (a == "--over")
      s.over = std::stod(v);
    else if (a == "--noise")
      s.noise = std::stod(v);
    else if (a == "--rms")
      s.rms_mm = std::stod(v);
    else if (a == "--wavy")
      s.wavy_mm = std::stod(v);
    else if (a == "--wavy-length")
      s.wavy_length_mm = std::stod(v);
    else if (a == "--results")
      s.results = v;
    else
      return false;
    return true;
  };
  return challenge::read_settings(
      words, {{"null", 200}, {"single", 600}, {"double", 300}, {"triple", 150}, {"outside", 150}},
      flag, valued, s);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "--photo")
    return challenge::run_photos(argc - 2, argv + 2);
  Settings settings;
  if (!read({argv + 1, argv + argc}, settings)) {
    std::puts(
        "usage: challenge MAQUETTE [--null N] [--single N] [--double N] [--triple N] [--outside N] "
        "[--full] [--seed S] [--from N] [--only I] [--effect NAME] [--points N] [--over X] "
        "[--noise X] [--fade K] [--smooth] [--rms MM] [--wavy MM] [--wavy-length MM] [--jobs N] "
        "[--results FOLDER] [--keep FOLDER] [--controls] [--oracle] [--picture FILE] [--strict] "
        "[--all-right]");
    return 2;
  }
  Tally tally;
  challenge::run_cases(settings,
                       [&](const std::string& kind, int i) { one(settings, kind, i, tally); });
  const challenge::Outcome outcome = challenge::print_table(tally.result, tally.sizes, tally.gains);
  std::sort(tally.seconds.begin(), tally.seconds.end());
  const auto quantile = [&](double q) {
    return tally
        .seconds[static_cast<std::size_t>(q * static_cast<double>(tally.seconds.size() - 1))];
  };
  if (!tally.seconds.empty())
    fmt::print(
        "seconds a case: middle {:.1f}, nine of ten within {:.1f}, slowest {:.1f}; {} at a "
        "time\n",
        quantile(0.5), quantile(0.9), quantile(1.0), settings.jobs);
  if (!settings.picture.empty()) challenge::write_confusion(tally.confusion, settings.picture);
  return (settings.strict && outcome.fell) || (settings.all_right && !outcome.all_right) ? 1 : 0;
}
