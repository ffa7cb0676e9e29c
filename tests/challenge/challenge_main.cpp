// SPDX-License-Identifier: GPL-3.0-or-later

// Hides effects, has them found, counts.
//   challenge MAQUETTE [--null N] [--single N] [--double N] [--triple N] [--outside N] [--seed S]
//             [--from N] [--effect NAME] [--size K] [--keep FOLDER] [--full]
// --keep: cases stay, with their reports and controls.
// --from: the first cases of each kind are passed over, to see a later one again.
//             [--points N] [--picture FILE] [--strict]
// --full: 200 null, 600 single, 300 double, 150 triple, 150 outside. Prints a line a case and the
// table; --picture draws the confusion matrix. --strict: exit 1 if a null case is claimed, a name
// is wrong, or something outside the library is not called unexplained.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <random>
#include <set>
#include <string>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "challenge/challenge_case.hpp"

namespace {

struct Count {
  int cases = 0, right = 0, wrong = 0, missed = 0, claimed = 0, unexplained = 0;
};

void write_confusion(const std::map<std::pair<std::string, std::string>, int>& table,
                     const std::string& file) {
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

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::puts(
        "usage: challenge MAQUETTE [--null N] [--single N] [--double N] [--triple N] [--outside N] "
        "[--seed S] [--from N] [--effect NAME] [--size K] [--keep FOLDER] [--full]");
    return 2;
  }
  std::map<std::string, int> counts;
  std::uint64_t seed = 1;
  std::string only, keep, picture;
  bool strict = false;
  int points = 300'000;
  int from = 0;
  double size = 1.0;
  for (int i = 2; i < argc; ++i) {
    const std::string a = argv[i];
    if (a == "--full") {
      counts = {{"null", 200}, {"single", 600}, {"double", 300}, {"triple", 150}, {"outside", 150}};
      continue;
    }
    if (a == "--strict") {
      strict = true;
      continue;
    }
    if (i + 1 >= argc) return 2;
    const std::string v = argv[++i];
    if (a == "--seed")
      seed = std::stoull(v);
    else if (a == "--from")
      from = std::stoi(v);
    else if (a == "--effect")
      only = v;
    else if (a == "--keep")
      keep = v;
    else if (a == "--picture")
      picture = v;
    else if (a == "--points")
      points = std::stoi(v);
    else if (a == "--size")
      size = std::stod(v);
    else
      counts[a.substr(2)] = std::stoi(v);
  }
  std::map<std::string, Count> result;
  std::map<std::pair<std::string, std::string>, int> confusion;
  double slowest = 0;
  for (const char* kind : {"null", "single", "double", "triple", "outside"}) {
    for (int i = from; i < counts[kind]; ++i) {
      challenge::Options o;
      o.seed = seed * 1'000'003 + static_cast<std::uint64_t>(i) * 17 +
               static_cast<std::uint64_t>(kind[0]);
      o.size = size;
      o.points = points;
      std::mt19937_64 draw(o.seed);
      const std::string k = kind;
      const int hide = k == "null" ? 0 : k == "double" ? 2 : k == "triple" ? 3 : 1;
      const auto& names = k == "outside" ? challenge::nameless() : challenge::hideable();
      while (static_cast<int>(o.effects.size()) < hide) {
        std::string name = names[k == "single" ? static_cast<std::size_t>(i) % names.size()
                                               : draw() % names.size()];
        if (!only.empty()) name = only;
        if (std::find(o.effects.begin(), o.effects.end(), name) == o.effects.end())
          o.effects.push_back(name);
      }
      const std::filesystem::path folder =
          keep.empty() ? std::filesystem::temp_directory_path() /
                             fmt::format("challenge_{}", static_cast<long>(o.seed))
                       : std::filesystem::path(keep) / fmt::format("{}_{}", kind, i);
      const auto truth = challenge::make_case(o, folder);
      const auto begin = std::chrono::steady_clock::now();
      const std::string command =
          fmt::format("'{}' diagnose '{}' --out '{}' --quiet{} > '{}' 2>&1", argv[1],
                      (folder / "case.toml").string(), (folder / "out").string(),
                      keep.empty() ? " --no-controls" : "", (folder / "log").string());
      const int rc = std::system(command.c_str());
      const double seconds =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      slowest = std::max(slowest, seconds);
      nlohmann::json j;
      try {
        std::ifstream(folder / "out" / "diagnosis.json") >> j;
      } catch (const std::exception&) {
        fmt::print("{} {} seed {}: no diagnosis (exit {})\n", kind, i, o.seed, rc);
        continue;
      }
      Count& c = result[kind];
      ++c.cases;
      std::string said = j["verdict"];
      std::set<std::string> left(truth.effects.begin(), truth.effects.end());
      if (k == "outside") left.clear();
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
        confusion[{matched.empty() ? (truth.effects.empty() ? "null" : truth.effects[0]) : matched,
                   matched.empty() ? name : matched}]++;
        said += " " + name;
        if (cause["equivalent"].size()) {
          said += "{";
          for (const auto& e : cause["equivalent"]) said += e.get<std::string>() + " ";
          said += "}";
        }
        said += fmt::format("({:.2f})", cause["share_of_excess_variance"].get<double>());
      }
      for (const auto& e : left) confusion[{e, "nothing"}]++;
      const bool none = j["causes"].empty();
      const bool remainder = j["verdict"] == "unexplained" || j["verdict"] == "partly_explained";
      const bool right = wrong == 0 && left.empty();
      c.right += k == "null" ? none && !remainder : k == "outside" ? none && remainder : right;
      c.wrong += wrong > 0;
      c.missed += !left.empty();
      c.claimed += !none;
      c.unexplained += remainder;
      fmt::print("{} {} seed {} {}: {} ->{} [{:.1f} s]\n", kind, i, o.seed,
                 wrong > 0 ? "WRONG"
                 : right   ? "right"
                           : "missed",
                 truth.summary, " " + said, seconds);
      if (remainder)
        fmt::print("      remains: {} {:.4f} mm\n", j["residual_after"]["unexplained_kinds"].dump(),
                   j["residual_after"]["unexplained_rms_mm"].get<double>());
      std::fflush(stdout);
      if (keep.empty()) std::filesystem::remove_all(folder);
    }
  }
  fmt::print("\n{:8} {:>6} {:>7} {:>7} {:>8} {:>12}\n", "", "cases", "right", "wrong", "claimed",
             "unexplained");
  for (const auto& [kind, c] : result)
    fmt::print("{:8} {:6} {:6.1f}% {:6.1f}% {:7.1f}% {:11.1f}%\n", kind, c.cases,
               100.0 * c.right / c.cases, 100.0 * c.wrong / c.cases, 100.0 * c.claimed / c.cases,
               100.0 * c.unexplained / c.cases);
  fmt::print("slowest case {:.1f} s\n", slowest);
  if (!picture.empty()) write_confusion(confusion, picture);
  bool fell = false;
  for (const auto& [kind, c] : result)
    fell |= c.wrong > 0 || (kind == "null" && c.claimed > 0) ||
            (kind == "outside" && c.right < c.cases);
  return strict && fell ? 1 : 0;
}
