// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/challenge_settings.hpp"

#include <algorithm>
#include <atomic>
#include <random>
#include <sstream>
#include <thread>
#include <utility>

namespace challenge {
namespace {

const std::vector<std::string> kKinds{"null", "single", "double", "triple", "outside"};

bool take(const std::string& a, const std::string& v, CommonSettings& s) {
  const auto kind = a.starts_with("--") ? a.substr(2) : a;
  if (std::find(kKinds.begin(), kKinds.end(), kind) != kKinds.end())
    s.counts[kind] = std::stoi(v);
  else if (a == "--seed")
    s.seed = std::stoull(v);
  else if (a == "--from")
    s.from = std::stoi(v);
  else if (a == "--only")
    s.only = std::stoi(v);
  else if (a == "--effect")
    s.effect = v;
  else if (a == "--keep")
    s.keep = v;
  else if (a == "--picture")
    s.picture = v;
  else if (a == "--jobs")
    s.jobs = static_cast<unsigned>(std::max(1, std::stoi(v)));
  else
    return false;
  return true;
}

}  // namespace

bool read_settings(const std::vector<std::string>& words, const std::map<std::string, int>& full,
                   const OwnOption& flag, const OwnOption& valued, CommonSettings& s) {
  if (words.empty()) return false;
  s.program = words[0];
  for (std::size_t i = 1; i < words.size(); ++i) {
    const std::string& a = words[i];
    if (a == "--full") {
      s.counts = full;
    } else if (a == "--strict") {
      s.strict = true;
    } else if (a == "--all-right") {
      s.all_right = true;
    } else if (!flag(a, {})) {
      if (i + 1 >= words.size()) return false;
      const std::string& v = words[++i];
      if (!take(a, v, s) && !valued(a, v)) return false;
    }
  }
  return true;
}

std::uint64_t seed_of(const CommonSettings& s, const std::string& kind, int i) {
  return s.seed * 1'000'003 + static_cast<std::uint64_t>(i) * 17 +
         static_cast<std::uint64_t>(kind[0]);
}

std::vector<std::string> effects_of(const CommonSettings& s, const std::string& kind, int i,
                                    const std::vector<std::string>& names, bool in_turn) {
  std::mt19937_64 draw(seed_of(s, kind, i));
  const std::size_t hide = kind == "null" ? 0 : kind == "double" ? 2 : kind == "triple" ? 3 : 1;
  std::vector<std::string> effects;
  std::istringstream list(s.effect);  // a + b
  while (effects.size() < hide) {
    std::string name =
        names[in_turn ? static_cast<std::size_t>(i) % names.size() : draw() % names.size()];
    std::string given;
    std::getline(list, given, '+');
    if (!given.empty()) name = given;
    if (std::find(effects.begin(), effects.end(), name) == effects.end())
      effects.push_back(std::move(name));
  }
  return effects;
}

void run_cases(const CommonSettings& s,
               const std::function<void(const std::string& kind, int i)>& one) {
  std::vector<std::pair<std::string, int>> cases;
  for (const std::string& kind : kKinds) {
    const auto count = s.counts.find(kind);
    for (int i = s.from; count != s.counts.end() && i < count->second; ++i)
      if (s.only < 0 || i == s.only) cases.emplace_back(kind, i);
  }
  std::atomic<std::size_t> next{0};
  std::vector<std::jthread> workers;
  for (unsigned w = 0; w < s.jobs; ++w)
    workers.emplace_back([&] {
      for (std::size_t k; (k = next++) < cases.size();) one(cases[k].first, cases[k].second);
    });
}

}  // namespace challenge
