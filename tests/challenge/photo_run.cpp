// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/photo_run.hpp"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <mutex>
#include <sstream>

#include <fmt/format.h>

#include "challenge/challenge_score.hpp"
#include "challenge/challenge_settings.hpp"
#include "challenge/photo_case.hpp"

namespace challenge {
namespace {

constexpr double kHeldOut_255 = 3.0;  // mean absolute difference that a photograph may keep
constexpr double kOver = 5.0;         // limits that a cause has to be found at

struct Settings : CommonSettings {
  bool write_only = false;
  int width = 1024, held_out = 0;
  std::vector<double> sizes;
  double size = 1.0;
  Relief::Between between = Relief::Between::bilinear;
};

struct Tally {
  std::mutex guard;
  std::map<std::string, Count> result;
  Confusion confusion;
  Sizes sizes;
  double slowest_cpu_s = 0, making_cpu_s = 0;
};

PhotoOptions options_of(const Settings& settings, const std::string& kind, int i) {
  PhotoOptions o;
  o.seed = seed_of(settings, kind, i);
  o.size = settings.size;
  o.held_out = settings.held_out;
  o.sizes = settings.sizes;
  o.between = settings.between;
  o.width = settings.width;
  o.height = settings.width * 3 / 4;
  o.effects = kind == "outside" ? effects_of(settings, kind, i, photo_nameless(), true)
                                : effects_of(settings, kind, i, photo_hideable(), kind == "single");
  return o;
}

struct Ran {
  int exit_code = -1;
  double cpu_s = 0;
};
/// Runs a line of the shell. @return its exit code and what it and its children took
Ran run(const std::string& line) {
  const pid_t child = fork();
  if (child == 0) {
    execl("/bin/sh", "sh", "-c", line.c_str(), static_cast<char*>(nullptr));
    _exit(127);
  }
  int status = 0;
  rusage used{};
  if (child < 0 || wait4(child, &status, 0, &used) != child) return {};
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1,
          seconds(used.ru_utime) + seconds(used.ru_stime)};
}

double thread_cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// How often an effect exceeds its detection limit in its case.
double over_limit(const PhotoHidden& h) {
  const double noise = h.over_noise / kPhotoLimitSigma;
  // More noise changes no mean.
  return h.effect == "photo.noise" ? noise : std::min(noise, h.rms_255 / kPhotoLimitRms_255);
}

void one(const Settings& settings, const std::string& kind, int i, Tally& tally) {
  const PhotoOptions o = options_of(settings, kind, i);
  const std::filesystem::path folder =
      settings.keep.empty()
          ? std::filesystem::temp_directory_path() / fmt::format("photo_challenge_{}", o.seed)
          : std::filesystem::path(settings.keep) / fmt::format("{}_{:02}{}{}", kind, i,
                                                               o.effects.empty() ? "" : "_",
                                                               fmt::join(o.effects, "+"));
  const double begin = thread_cpu_s();
  const auto hidden = make_photo_case(o, folder);
  const double making = thread_cpu_s() - begin;
  std::string words;
  std::vector<std::string> names;
  bool small = false;
  for (const PhotoHidden& h : hidden) {
    names.push_back(h.effect);
    words += fmt::format(" {} x{:.1f} ({:.2f}/255, {:.0f} sigma; {}:", h.effect, over_limit(h),
                         h.rms_255, h.over_noise, h.photographs);
    for (const auto& [name, value] : h.parameters) words += fmt::format(" {}={:.4g}", name, value);
    words += ")";
    small |= over_limit(h) < kOver;
  }
  if (settings.write_only) {
    const std::scoped_lock lock(tally.guard);
    tally.making_cpu_s = std::max(tally.making_cpu_s, making);
    fmt::print("{} {} seed {}{} [made in {:.1f} CPU s]\n", kind, i, o.seed, words, making);
    std::fflush(stdout);
    return;
  }
  const Ran ran =
      run(fmt::format("'{}' diagnose '{}' --out '{}' --json --quiet --no-controls{} > '{}' 2> '{}'",
                      settings.program, (folder / "case.toml").string(), (folder / "out").string(),
                      settings.jobs > 1 ? " --threads 1" : "", (folder / "said.json").string(),
                      (folder / "log").string()));
  const std::scoped_lock lock(tally.guard);
  tally.making_cpu_s = std::max(tally.making_cpu_s, making);
  tally.slowest_cpu_s = std::max(tally.slowest_cpu_s, ran.cpu_s);
  const std::string row = small && kind != "outside" ? kind + ", small" : kind;
  nlohmann::json j;
  try {
    std::ifstream(folder / "out" / "diagnosis.json") >> j;
  } catch (const std::exception&) {
    fmt::print("{} {} seed {}: no diagnosis (exit {})\n", kind, i, o.seed, ran.exit_code);
    std::fflush(stdout);
    ++tally.result[row].cases;
    return;
  }
  Verdict v = judge(kind, names, j, tally.confusion);
  std::string sizes;
  if (j.contains("held_out"))
    for (const auto& h : j["held_out"]) {
      const double after = h.at("mean_absolute_difference_after_255");
      sizes += fmt::format(" {}: {:.2f} -> {:.2f}/255", h.at("image").get<std::string>(),
                           h.at("mean_absolute_difference_before_255").get<double>(), after);
      v.right &= after <= kHeldOut_255;
    }
  for (const PhotoHidden& h : hidden)
    for (const auto& [name, value] : h.parameters)
      sizes += compare_size(j, h.effect, name, value, tally.sizes);
  tally.result[row].add(v);
  fmt::print("{} {} seed {} {}:{} -> {}{} [{:.1f} CPU s]\n", kind, i, o.seed, v.word(), words,
             v.said, sizes, ran.cpu_s);
  std::fflush(stdout);
  if (settings.keep.empty()) std::filesystem::remove_all(folder);
}

/// False: not understood.
bool read(const std::vector<std::string>& words, Settings& s) {
  const auto flag = [&](const std::string& a, const std::string&) {
    return a == "--write-only" && (s.write_only = true);
  };
  const auto valued = [&](const std::string& a, const std::string& v) {
    if (a == "--size-factor")
      s.size = std::stod(v);
    else if (a == "--width")
      s.width = std::max(64, std::stoi(v));
    else if (a == "--sizes") {  // of each effect: 3+1
      std::istringstream list(v);
      for (std::string size; std::getline(list, size, '+');) s.sizes.push_back(std::stod(size));
    } else if (a == "--held-out")
      s.held_out = std::clamp(std::stoi(v), 0, kPhotos - 1);
    else if (a == "--between" && v == "bilinear")
      s.between = Relief::Between::bilinear;
    else if (a == "--between" && v == "triangles")
      s.between = Relief::Between::triangles;
    else if (a == "--between" && v == "smooth")
      s.between = Relief::Between::smooth;
    else
      return false;
    return true;
  };
  return read_settings(
             words,
             {{"null", 200}, {"single", 440}, {"double", 200}, {"triple", 100}, {"outside", 120}},
             flag, valued, s) &&
         (!s.write_only || !s.keep.empty());
}

}  // namespace

int run_photos(int argc, char** argv) {
  Settings settings;
  if (!read({argv, argv + argc}, settings)) {
    std::puts(
        "usage: challenge --photo MAQUETTE [--null N] [--single N] [--double N] [--triple N] "
        "[--outside N] [--full] [--seed S] [--from N] [--only I] [--effect NAME] [--size-factor X] "
        "[--sizes X+X] "
        "[--between bilinear|triangles|smooth] [--width PX] [--held-out N] [--jobs N] [--keep "
        "FOLDER] "
        "[--write-only] [--picture FILE] [--strict] [--all-right]");
    return 2;
  }
  Tally tally;
  run_cases(settings, [&](const std::string& kind, int i) { one(settings, kind, i, tally); });
  fmt::print("slowest case made in {:.1f} CPU s\n", tally.making_cpu_s);
  if (settings.write_only) return 0;
  const Outcome outcome = print_table(tally.result, tally.sizes);
  fmt::print("slowest case diagnosed in {:.1f} CPU s, {} at a time, seed {}\n", tally.slowest_cpu_s,
             settings.jobs, settings.seed);
  if (!settings.picture.empty()) write_confusion(tally.confusion, settings.picture);
  return (settings.strict && outcome.fell) || (settings.all_right && !outcome.all_right) ? 1 : 0;
}

}  // namespace challenge
