// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/data_file.hpp"

#include <algorithm>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "cnc/built_in_data.hpp"
#include "core/nearest_name.hpp"

namespace maquette::cnc {
namespace {

std::string allowed(const DataKey& key) {
  constexpr const char* kinds[] = {"a number", "a whole number", "three numbers (x, y, z)",
                                   "a string", "a list of numbers"};
  std::string text = kinds[key.to.index()];
  if (std::isfinite(key.min) && std::isfinite(key.max))
    return text + fmt::format(", {} to {}", key.min, key.max);
  if (std::isfinite(key.min)) return text + fmt::format(", at least {}", key.min);
  return text;
}

bool number(const toml::node& node, const DataKey& key, double& to) {
  const auto v = node.is_number() ? node.value<double>() : std::nullopt;
  if (!v || !(*v >= key.min && *v <= key.max) || !std::isfinite(*v)) return false;
  to = *v;
  return true;
}

bool numbers(const toml::node& node, const DataKey& key, std::vector<double>& to) {
  const toml::array* list = node.as_array();
  if (list == nullptr || list->empty()) return false;
  to.clear();
  for (const toml::node& e : *list) {
    to.push_back(0.0);
    if (!number(e, key, to.back())) return false;
  }
  return true;
}

struct Assign {
  const toml::node& node;
  const DataKey& key;

  bool operator()(double* to) const { return number(node, key, *to); }
  bool operator()(int* to) const {
    double v = 0.0;
    if (!node.is_integer() || !number(node, key, v)) return false;
    *to = static_cast<int>(v);
    return true;
  }
  bool operator()(std::vector<double>* to) const { return numbers(node, key, *to); }
  bool operator()(Vec3* to) const {
    std::vector<double> v;
    if (!numbers(node, key, v) || v.size() != 3) return false;
    *to = {v[0], v[1], v[2]};
    return true;
  }
  bool operator()(std::string* to) const {
    const auto v = node.is_string() ? node.value<std::string>() : std::nullopt;
    if (v) *to = *v;
    return v.has_value();
  }
};

}  // namespace

Result<void> read_data(std::string_view text, std::string_view place,
                       std::span<const DataKey> keys) {
  toml::table table;
  try {
    table = toml::parse(text, place);
  } catch (const toml::parse_error& e) {
    return fail(kDataFile, fmt::format("{}:{}:{}: not valid TOML: {}", place, e.source().begin.line,
                                       e.source().begin.column, e.description()));
  }
  std::vector<std::string> names;
  for (const DataKey& k : keys) names.push_back(k.name);
  // The table is sorted by key; findings go by line.
  std::vector<std::pair<unsigned, std::string>> findings;
  for (const auto& [name, node] : table) {
    const unsigned line = name.source().begin.line;
    const auto key = std::find(names.begin(), names.end(), name.str());
    if (key == names.end()) {
      const std::string near = nearest_name(name.str(), names);
      findings.emplace_back(
          line, fmt::format("unknown key '{}'{}", name.str(),
                            near.empty() ? fmt::format("; known are {}", fmt::join(names, ", "))
                                         : fmt::format("; did you mean '{}'?", near)));
      continue;
    }
    const DataKey& k = keys[static_cast<std::size_t>(key - names.begin())];
    if (!std::visit(Assign{node, k}, k.to))
      findings.emplace_back(line, fmt::format("key '{}' must be {}", k.name, allowed(k)));
  }
  std::sort(findings.begin(), findings.end());
  std::vector<std::string> lines;
  for (const auto& [line, what] : findings)
    lines.push_back(fmt::format("{}:{}: {}", place, line, what));
  for (const DataKey& k : keys)
    if (k.required && !table.contains(k.name))
      lines.push_back(fmt::format("{}: key '{}' is missing ({})", place, k.name, allowed(k)));
  if (!lines.empty()) return fail(kDataFile, fmt::format("{}", fmt::join(lines, "\n")));
  return {};
}

std::string_view built_in_data(std::string_view kind, std::string_view name) {
  for (const BuiltInFile& f : kBuiltInFiles)
    if (f.kind == kind && f.name == name) return f.text;
  return {};
}

std::vector<std::string> built_in_names(std::string_view kind) {
  std::vector<std::string> names;
  for (const BuiltInFile& f : kBuiltInFiles)
    if (f.kind == kind) names.emplace_back(f.name);
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace maquette::cnc
