// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/challenge_score.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>

#include <fmt/format.h>

namespace challenge {

Verdict judge(const std::string& kind, const std::vector<std::string>& hidden,
              const nlohmann::json& j, Confusion& confusion) {
  Verdict v;
  v.said = j["verdict"];
  std::set<std::string> left(hidden.begin(), hidden.end());
  if (kind == "outside") left.clear();
  for (const auto& cause : j["causes"]) {
    const std::string name = cause["effect"];
    std::set<std::string> class_of{name};
    for (const auto& e : cause["equivalent"]) class_of.insert(e.get<std::string>());
    std::string matched;
    if (left.count(name)) matched = name;
    for (const auto& e : class_of)
      if (matched.empty() && left.count(e)) matched = e;
    if (matched.empty())
      ++v.wrong;
    else
      left.erase(matched);
    confusion[{matched.empty() ? (hidden.empty() ? "null" : hidden[0]) : matched,
               matched.empty() ? name : matched}]++;
    v.said += " " + name;
    if (cause["equivalent"].size()) {
      v.said += "{";
      for (const auto& e : cause["equivalent"]) v.said += e.get<std::string>() + " ";
      v.said += "}";
    }
    v.said += fmt::format("({:.2f})", cause["share_of_excess_variance"].get<double>());
  }
  for (const auto& e : left) confusion[{e, "nothing"}]++;
  v.missed = static_cast<int>(left.size());
  v.none = j["causes"].empty();
  v.remainder = j["verdict"] == "unexplained" || j["verdict"] == "partly_explained";
  if (kind == "outside" && v.none) confusion[{hidden[0], "nothing"}]++;
  if (kind == "null" && v.none) confusion[{"null", "nothing"}]++;
  v.right = kind == "null"      ? v.none && !v.remainder
            : kind == "outside" ? v.none && v.remainder
                                : v.wrong == 0 && left.empty();
  return v;
}

void Count::add(const Verdict& v) {
  ++cases;
  right += v.right;
  wrong += v.wrong > 0;
  missed += v.missed > 0;
  claimed += !v.none;
  unexplained += v.remainder;
}

std::string compare_size(const nlohmann::json& j, const std::string& effect,
                         const std::string& parameter, double hidden, Sizes& sizes) {
  if (parameter.empty()) return {};
  for (const auto& cause : j["causes"]) {
    if (cause["effect"] != effect || !cause["parameters"].contains(parameter)) continue;
    const auto& found = cause["parameters"][parameter];
    if (!found["sigma"].is_number() || !(found["sigma"].get<double>() > 0.0)) continue;
    const double off = found["value"].get<double>() - hidden,
                 z = off / found["sigma"].get<double>();
    ++sizes.all;
    sizes.covered += std::abs(z) <= 1.96;
    sizes.squares += z * z;
    sizes.shares += off * off / (hidden * hidden);
    return fmt::format(" [{} off by {:.2f} %, {:+.1f} sigma]", effect, 100.0 * off / hidden, z);
  }
  return {};
}

double Gains::add(double before, double after, double without) {
  const double share = (before * before - after * after) / (before * before - without * without);
  ++all;
  sum += share;
  least = std::min(least, share);
  return share;
}

Outcome print_table(const std::map<std::string, Count>& counts, const Sizes& s,
                    const Gains& gains) {
  fmt::print("\n{:14} {:>6} {:>7} {:>7} {:>8} {:>12}\n", "", "cases", "right", "wrong", "claimed",
             "unexplained");
  Outcome o;
  for (const auto& [kind, c] : counts) {
    fmt::print("{:14} {:6} {:6.1f}% {:6.1f}% {:7.1f}% {:11.1f}%\n", kind, c.cases,
               100.0 * c.right / c.cases, 100.0 * c.wrong / c.cases, 100.0 * c.claimed / c.cases,
               100.0 * c.unexplained / c.cases);
    o.all_right &= c.right == c.cases;
    o.fell |= c.wrong > 0 || (kind == "null" && c.claimed > 0) ||
              (kind == "outside" && c.right < c.cases);
  }
  if (s.all > 0)
    fmt::print(
        "{} sizes: 95 % intervals cover {:.0f} %, errors over standard errors {:.2f} rms, over "
        "the size {:.1f} % rms\n",
        s.all, 100.0 * s.covered / s.all, std::sqrt(s.squares / s.all),
        100.0 * std::sqrt(s.shares / s.all));
  if (gains.all > 0)
    fmt::print("{} gains on report blocks over those of one who knows: mean {:.4f}, least {:.4f}\n",
               gains.all, gains.sum / gains.all, gains.least);
  return o;
}

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

}  // namespace challenge
