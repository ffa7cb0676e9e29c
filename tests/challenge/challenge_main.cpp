// SPDX-License-Identifier: GPL-3.0-or-later

// Hides effects, has them found, counts.
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
#include <set>
#include <string>
#include <thread>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "challenge/challenge_case.hpp"

namespace {

constexpr double kOver = 5.0;        // limits that a cause has to be found at
constexpr double kMostGrowth = 2.0;  // of a usual size

struct Count {
  int cases = 0, right = 0, wrong = 0, missed = 0, claimed = 0, unexplained = 0;
};

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

/// Sizes that were found against those that were hidden, over the stated standard errors.
struct Sizes {
  int all = 0, covered = 0;  ///< by 95 % intervals
  double squares = 0.0, shares = 0.0;
};

/// Counts the size of a cause that was named as it was hidden. @return words for the log
std::string compare_size(const nlohmann::json& cause, const challenge::Truth& truth, Sizes& sizes) {
  const std::string name = cause["effect"];
  for (std::size_t k = 0; k < truth.effects.size(); ++k) {
    const Reported is = reported(truth.effects[k], truth.sizes[k]);
    if (name != truth.effects[k] || !cause["parameters"].contains(is.parameter)) continue;
    const auto& found = cause["parameters"][is.parameter];
    if (!found["sigma"].is_number() || !(found["sigma"].get<double>() > 0.0)) continue;
    const double off = found["value"].get<double>() - is.value,
                 z = off / found["sigma"].get<double>();
    ++sizes.all;
    sizes.covered += std::abs(z) <= 1.96;
    sizes.squares += z * z;
    sizes.shares += off * off / (is.value * is.value);
    return fmt::format(" [{} off by {:.2f} %, {:+.1f} sigma]", name, 100.0 * off / is.value, z);
  }
  return {};
}

using Confusion = std::map<std::pair<std::string, std::string>, int>;

void write_confusion(const Confusion& table, const std::string& file) {
  std::set<std::string> truths, named;
  for (const auto& [key, n] : table) truths.insert(key.first), named.insert(key.second);
  std::ofstream out(file);
  const double s = 18, left = 230, top = 230;
  out << fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" "
      "font-family=\"sans-serif\" font-size=\"11\">",
      left + s * static_cast<double>(named.size()) + 20,
      top + s * static_cast<double>(truths.size()) + 20);
  int r = 0;
  for (const auto& t : truths) {
    int total = 0, c = 0;
    for (const auto& n : named)
      if (const auto at = table.find({t, n}); at != table.end()) total += at->second;
    out << fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{} ({})</text>", left - 6,
                       top + s * r + 13, t, total);
    for (const auto& n : named) {
      const auto at = table.find({t, n});
      const double share = at == table.end() ? 0.0 : static_cast<double>(at->second) / total;
      out << fmt::format(
          "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"rgb({:.0f},{:.0f},255)\" "
          "stroke=\"#ddd\"/>",
          left + s * c, top + s * r, s, s, 255 - 222 * share, 255 - 150 * share);
      if (at != table.end())
        out << fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                           left + s * c + s / 2, top + s * r + 13, at->second);
      ++c;
    }
    ++r;
  }
  int c = 0;
  for (const auto& n : named) {
    out << fmt::format("<text transform=\"translate({},{}) rotate(-60)\">{}</text>",
                       left + s * c + 12, top - 6, n);
    ++c;
  }
  out << "</svg>\n";
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
  std::map<std::string, Count> result;
  Confusion confusion;
  Sizes sizes;
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
  Count& c = tally.result[small && kind != "outside" ? kind + ", small" : kind];
  ++c.cases;
  std::string said = j["verdict"];
  std::set<std::string> left(truth.effects.begin(), truth.effects.end());
  if (kind == "outside") left.clear();
  int wrong = 0;
  for (const auto& cause : j["causes"]) {
    const std::string name = cause["effect"];
    std::set<std::string> class_of{name};
    for (const auto& e : cause["equivalent"]) class_of.insert(e.get<std::string>());
    std::string matched;
    if (left.count(name)) matched = name;
    for (const auto& e : class_of)
      if (matched.empty() && left.count(e)) matched = e;
    if (matched.empty())
      ++wrong;
    else
      left.erase(matched);
    sizes += compare_size(cause, truth, tally.sizes);
    tally
        .confusion[{matched.empty() ? (truth.effects.empty() ? "null" : truth.effects[0]) : matched,
                    matched.empty() ? name : matched}]++;
    said += " " + name;
    if (cause["equivalent"].size()) {
      said += "{";
      for (const auto& e : cause["equivalent"]) said += e.get<std::string>() + " ";
      said += "}";
    }
    said += fmt::format("({:.2f})", cause["share_of_excess_variance"].get<double>());
  }
  for (const auto& e : left) tally.confusion[{e, "nothing"}]++;
  const bool none = j["causes"].empty();
  const bool remainder = j["verdict"] == "unexplained" || j["verdict"] == "partly_explained";
  if (kind == "outside" && none) tally.confusion[{truth.effects[0], "nothing"}]++;
  if (kind == "null" && none) tally.confusion[{"null", "nothing"}]++;
  const bool right = kind == "null"      ? none && !remainder
                     : kind == "outside" ? none && remainder
                                         : wrong == 0 && left.empty();
  c.right += right;
  c.wrong += wrong > 0;
  c.missed += !left.empty();
  c.claimed += !none;
  c.unexplained += remainder;
  fmt::print("{} {} seed {} {}:{} {} ->{} [{:.1f} s]\n", kind, i, o.seed,
             wrong > 0 ? "WRONG"
             : right   ? "right"
                       : "missed",
             sizes, truth.summary, " " + said, seconds);
  if (remainder)
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
  fmt::print("\n{:14} {:>6} {:>7} {:>7} {:>8} {:>12}\n", "", "cases", "right", "wrong", "claimed",
             "unexplained");
  bool fell = false, all_right = true;
  for (const auto& [kind, c] : tally.result) {
    fmt::print("{:14} {:6} {:6.1f}% {:6.1f}% {:7.1f}% {:11.1f}%\n", kind, c.cases,
               100.0 * c.right / c.cases, 100.0 * c.wrong / c.cases, 100.0 * c.claimed / c.cases,
               100.0 * c.unexplained / c.cases);
    all_right &= c.right == c.cases;
    fell |= c.wrong > 0 || (kind == "null" && c.claimed > 0) ||
            (kind == "outside" && c.right < c.cases);
  }
  if (const Sizes& s = tally.sizes; s.all > 0)
    fmt::print(
        "{} sizes: 95 % intervals cover {:.0f} %, errors over standard errors {:.2f} rms, over "
        "the size {:.1f} % rms\n",
        s.all, 100.0 * s.covered / s.all, std::sqrt(s.squares / s.all),
        100.0 * std::sqrt(s.shares / s.all));
  fmt::print("slowest case {:.1f} s, {} at a time\n", tally.slowest, settings.jobs);
  if (!settings.picture.empty()) write_confusion(tally.confusion, settings.picture);
  return (settings.strict && fell) || (settings.all_right && !all_right) ? 1 : 0;
}
