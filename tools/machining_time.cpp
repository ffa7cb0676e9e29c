// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/machining_time.hpp"

#include <map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace maquette::tools {
namespace {

struct Sum {
  double cutting_min = 0.0, rapid_min = 0.0, total_min = 0.0, length_m = 0.0;
};

std::string line(const std::string& what, const std::string& tool, const Sum& s) {
  return fmt::format("\n{:<32} {:>5} {:>9.1f} {:>9.1f} {:>9.1f} {:>9.1f}", what, tool,
                     s.cutting_min, s.rapid_min, s.total_min, s.length_m);
}

}  // namespace

std::string machining_time_table(const nlohmann::json& figures) {
  if (!figures.is_object() || !figures.contains("machining_time")) return "";
  const nlohmann::json& rows = figures["machining_time"];
  if (rows.empty()) return "";
  std::string text = fmt::format("{:<32} {:>5} {:>9} {:>9} {:>9} {:>9}", "machining time", "tool",
                                 "cut, min", "rapid", "all", "path, m");
  Sum all;
  std::map<int, Sum> tools;
  for (const nlohmann::json& row : rows) {
    const Sum one{row.value("cutting_min", 0.0), row.value("rapid_min", 0.0),
                  row.value("total_min", 0.0), row.value("length_m", 0.0)};
    const int tool = row.value("tool", 0);
    const std::string operation = row.value("operation", "");
    text += line(row.value("program", "") + (operation.empty() ? "" : " " + operation),
                 fmt::format("{}", tool), one);
    for (Sum* sum : {&all, &tools[tool]}) {
      sum->cutting_min += one.cutting_min;
      sum->rapid_min += one.rapid_min;
      sum->total_min += one.total_min;
      sum->length_m += one.length_m;
    }
  }
  if (rows.size() == 1) return text;
  if (tools.size() > 1)
    for (const auto& [tool, sum] : tools) text += line("", fmt::format("{}", tool), sum);
  return text + line("all", "", all);
}

}  // namespace maquette::tools
