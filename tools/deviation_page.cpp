// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/deviation_page.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/markup.hpp"
#include "tools/deviation_view_text.hpp"
#include "tools/pictures.hpp"
#include "tools/report.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr std::ptrdiff_t kViewNodes = 420;  // a side, at most

std::string cell(const json& v) {
  if (v.is_null()) return "<td class='n'>&ndash;</td>";
  if (v.is_number_float()) return fmt::format("<td class='n'>{:.4g}</td>", v.get<double>());
  if (v.is_number()) return fmt::format("<td class='n'>{}</td>", v.dump());
  if (v.is_string()) return fmt::format("<td>{}</td>", markup_escaped(v.get<std::string>()));
  if (v.is_array()) {
    std::string text;
    for (const json& e : v)
      text += (text.empty() ? "" : ", ") + (e.is_string() ? markup_escaped(e.get<std::string>())
                                            : e.is_number_float()
                                                ? fmt::format("{:.4g}", e.get<double>())
                                                : e.dump());
    return fmt::format("<td>{}</td>", text.empty() ? "nothing" : text);
  }
  return fmt::format("<td>{}</td>", markup_escaped(v.dump()));
}

using Columns = std::vector<std::pair<const char*, const char*>>;  // key, heading

std::string table(const json& rows, const Columns& columns, std::size_t most = 40) {
  std::string html = "<table><tr>";
  for (const auto& [key, heading] : columns) html += fmt::format("<th>{}</th>", heading);
  html += "</tr>";
  std::size_t shown = 0;
  for (const json& row : rows) {
    if (shown++ == most) break;
    html += "<tr>";
    for (const auto& [key, heading] : columns) html += cell(row.contains(key) ? row[key] : json());
    html += "</tr>";
  }
  html += "</table>\n";
  if (rows.size() > most)
    html += fmt::format("<p>{} more are in summary.json.</p>\n", rows.size() - most);
  return html;
}

std::string figures(const json& from, const Columns& rows) {
  std::string html = "<table>";
  for (const auto& [key, heading] : rows)
    if (from.contains(key)) html += fmt::format("<tr><td>{}</td>{}</tr>", heading, cell(from[key]));
  return html + "</table>\n";
}

std::string picture(const fs::path& png, const std::string& caption, int width) {
  const auto data = read_file(png);
  if (!data) return fmt::format("<p class='warn'>{} is missing</p>", markup_escaped(png.string()));
  return fmt::format(
      "<figure><img width='{}' alt='{}' src='data:image/png;base64,{}'><figcaption>{}</figcaption>"
      "</figure>\n",
      width, markup_escaped(caption), base64(*data), markup_escaped(caption));
}

/// 16 bit steps, -32768 for a void.
std::string steps(const std::vector<float>& values, double step) {
  std::string bytes;
  bytes.reserve(2 * values.size());
  for (const float v : values) {
    const long s = std::isnan(v)
                       ? -32768L
                       : std::clamp(std::lround(static_cast<double>(v) / step), -32767L, 32767L);
    const auto u = static_cast<std::uint16_t>(s);
    bytes.push_back(static_cast<char>(u & 0xff));
    bytes.push_back(static_cast<char>(u >> 8));
  }
  return base64(bytes);
}

/// Every k-th node, its deviation the mean over the nodes round it.
std::string view_data(const scan::Deviation& deviation, const heightmap::ModelField& design,
                      double limit_mm) {
  const std::ptrdiff_t rows = design.z_mm.rows(), cols = design.z_mm.cols();
  const std::ptrdiff_t k = (std::max(rows, cols) - 1 + kViewNodes - 1) / kViewNodes;
  std::vector<float> z, d;
  float largest = 1e-6F;
  std::ptrdiff_t view_rows = 0;
  for (std::ptrdiff_t r = 0; r < rows; r += k, ++view_rows)
    for (std::ptrdiff_t c = 0; c < cols; c += k) {
      z.push_back(design.z_mm(r, c));
      if (!std::isnan(z.back())) largest = std::fmax(largest, std::abs(z.back()));
      double sum = 0.0, n = 0.0;
      for (std::ptrdiff_t i = -(k / 2); i <= k / 2; ++i)
        for (std::ptrdiff_t j = -(k / 2); j <= k / 2; ++j)
          if (design.z_mm.contains(r + i, c + j))
            if (const float v = deviation.map_mm(r + i, c + j); !std::isnan(v))
              sum += static_cast<double>(v), n += 1.0;
      d.push_back(n > 0.0 ? static_cast<float>(sum / n) : NAN);
    }
  const double z_step = static_cast<double>(largest) / 32000.0, d_step = 8.0 * limit_mm / 32000.0;
  const double spacing = design.spacing.value() * static_cast<double>(k);
  return fmt::format(
      "{{rows:{},cols:{},x0:{},y0:{},dx:{},dy:{},zScale:{},dScale:{},limit:{},z:'{}',d:'{}'}}",
      view_rows, static_cast<std::ptrdiff_t>(z.size()) / view_rows, design.x0.value(),
      design.y0.value(), spacing, spacing, z_step, d_step, limit_mm, steps(z, z_step),
      steps(d, d_step));
}

std::string view(const scan::Deviation& deviation, const heightmap::ModelField& design,
                 double limit_mm) {
  return "<h2>On the part</h2>\n<div><canvas id='part' style='width:100%;height:560px;"
         "touch-action:none;cursor:grab'></canvas>\n"
         "<p class='value'>Drag to turn, with shift to move, wheel to come nearer, click for a "
         "value.</p>\n"
         "<label>height &times; <input type='range' name='exaggeration' min='0' max='10' "
         "step='0.1' value='1'></label> "
         "<label>deviation as height <input type='range' name='bend' min='0' max='0.1' "
         "step='0.001' value='0'></label> "
         "<label>cut x <input type='range' name='cutX' min='0' max='1' step='0.002' "
         "value='1'></label> "
         "<label>cut y <input type='range' name='cutY' min='0' max='1' step='0.002' "
         "value='1'></label></div>\n<script>\n" +
         std::string(kDeviationViewScript) + "deviationView(document.getElementById('part'), " +
         view_data(deviation, design, limit_mm) + ");\n</script>\n";
}

}  // namespace

Result<void> write_deviation_page(const scan::Deviation& deviation,
                                  const heightmap::ModelField& design,
                                  const std::string& summary_json, double limit_mm,
                                  const fs::path& map_png, const fs::path& significant_png,
                                  const fs::path& out) {
  const json s = json::parse(summary_json);
  std::string html = figures(s, {kDeviationFigures.begin(), kDeviationFigures.end()});
  html += "<h2>Deviation</h2>\n" +
          picture(map_png, "measured minus design along the normal; grey: not measured", 520) +
          picture(significant_png,
                  s.contains("expected")
                      ? "measured minus expected, where it is more than noise (1 % false "
                        "discoveries); white: not significant"
                      : "the same where it is more than noise (1 % false discoveries); white: not "
                        "significant",
                  520) +
          signed_legend_svg(limit_mm, "mm");
  if (s.contains("expected"))
    html +=
        "<h2>Beside what was expected</h2>\n<p>The design with what the program leaves on it and "
        "the coat that was declared. Poses were found on this surface, and what is significant is "
        "a deviation from it.</p>\n" +
        figures(s["expected"], {{"as_milled", "simulated cut"},
                                {"coating_mm", "coat, mm"},
                                {"known_mean_mm", "expected deviation from the design, mean, mm"},
                                {"known_max_mm", "highest, mm"},
                                {"mean_mm", "measured minus expected, mean, mm"},
                                {"rms_mm", "RMS, mm"},
                                {"nmad_mm", "NMAD, mm"},
                                {"p05_mm", "5th percentile, mm"},
                                {"p95_mm", "95th percentile, mm"}});
  html += view(deviation, design, limit_mm);
  html += "<h2>What is significant</h2>\n";
  html +=
      s["findings"].empty()
          ? "<p>Nothing: no patch stands out of noise and registration.</p>\n"
          : "<p>Heights are steps against the surroundings; &plusmn; is one standard deviation. "
            "Most certain first.</p>\n" +
                table(s["findings"], {{"x_mm", "x, mm"},
                                      {"y_mm", "y, mm"},
                                      {"height_mm", "height, mm"},
                                      {"sigma_height_mm", "&plusmn;"},
                                      {"diameter_mm", "diameter, mm"},
                                      {"sigma_diameter_mm", "&plusmn;"},
                                      {"length_mm", "length, mm"},
                                      {"width_mm", "width, mm"},
                                      {"volume_mm3", "volume, mm&sup3;"},
                                      {"certainty", "sigmas"}});
  if (!s["stones"].empty())
    html += "<h2>Stones</h2>\n" + table(s["stones"], {{"number", "stone"},
                                                      {"state", "state"},
                                                      {"carries", "in its place"},
                                                      {"shift_mm", "shift x, y, z, mm"},
                                                      {"sigma_shift_mm", "&plusmn;"},
                                                      {"turn_deg", "turn, &deg;"},
                                                      {"sigma_turn_deg", "&plusmn;"},
                                                      {"points", "points"}});
  if (!s["regions"].empty())
    html +=
        "<h2>Regions</h2>\n<p>Decided with the expanded uncertainty as guard band (ISO "
        "14253-1).</p>\n" +
        table(s["regions"], {{"name", "region"},
                             {"points", "points"},
                             {"mean_mm", "mean, mm"},
                             {"sigma_mean_mm", "&plusmn;"},
                             {"rms_mm", "RMS, mm"},
                             {"nmad_mm", "NMAD, mm"},
                             {"p05_mm", "5 %, mm"},
                             {"p95_mm", "95 %, mm"},
                             {"within", "in tolerance"},
                             {"verdict", "verdict"},
                             {"worst_mm", "worst, mm"}});
  html += "<h2>Registration</h2>\n" +
          table(s["registrations"], {{"points", "scan"},
                                     {"iterations", "iterations"},
                                     {"rms_before_mm", "RMS before, mm"},
                                     {"rms_after_mm", "RMS after, mm"},
                                     {"noise_mm", "noise, mm"},
                                     {"overlap", "overlap"},
                                     {"likeness", "relief shown"},
                                     {"sigma_translation_mm", "pose &plusmn;, mm"},
                                     {"sigma_rotation_rad", "rad"},
                                     {"effective_points", "independent points"},
                                     {"free_directions", "not determined"}});
  if (s.contains("spheres") && !s["spheres"].empty())
    html += "<p>Reference spheres found in the clouds, and matched to datums:</p>\n" +
            table(s["spheres"], {{"points", "scan"},
                                 {"found", "spheres found"},
                                 {"matched", "matched"},
                                 {"missing", "not found"},
                                 {"rms_mm", "RMS off, mm"},
                                 {"sigma_translation_mm", "pose &plusmn;, mm"},
                                 {"sigma_rotation_rad", "rad"}});
  if (s.contains("datums") && !s["datums"].empty()) {
    html +=
        "<p>The comparison uses the registration on datums. Beside it, what a best fit would "
        "have taken away:</p>\n" +
        table(s["datums"], {{"points", "scan"},
                            {"absorbed_mean_mm", "absorbed, mean, mm"},
                            {"absorbed_sigma_mm", "&plusmn;"},
                            {"absorbed_min_mm", "least, mm"},
                            {"absorbed_max_mm", "most, mm"},
                            {"sigma_translation_mm", "pose on datums &plusmn;, mm"},
                            {"free_directions", "not determined"}});
    for (const json& d : s["datums"])
      html += table(d["fits"], {{"name", "datum"},
                                {"points", "points"},
                                {"mean_mm", "residual, mm"},
                                {"noise_mm", "noise, mm"}});
  } else {
    html +=
        "<p>Each scan was brought onto the design by best fit before this comparison. A best fit "
        "absorbs what looks like a shift or a tilt of the whole part, an even coat of paint for "
        "example: such a deviation does not appear here. Datums in the case file show it.</p>\n";
  }
  html += "<h2>Uncertainty</h2>\n<p>Of the mean of a cell, by the GUM.</p>\n" +
          table(s["budget"]["contributions"],
                {{"source", "source"}, {"u_mm", "u, mm"}, {"evaluation", "evaluated from"}}) +
          figures(s["budget"],
                  {{"combined_mm", "combined, mm"}, {"expanded_mm", "expanded, k = 2, mm"}});
  html += "<h2>Texture of what is left</h2>\n<p>ISO 25178-2, after a form of second degree.</p>\n" +
          figures(s["texture"], {{"sa_mm", "Sa, mm"},
                                 {"sq_mm", "Sq, mm"},
                                 {"sz_mm", "Sz, mm"},
                                 {"ssk", "Ssk"},
                                 {"sku", "Sku"},
                                 {"sdr", "Sdr"},
                                 {"form_mm", "form taken off, mm"}});
  for (const json& d : s["dependences"])
    html += fmt::format("<h3>By {}</h3>\n", markup_escaped(d["on"].get<std::string>())) +
            table(d["bins"], {{"from", "from"},
                              {"to", "to"},
                              {"mean_mm", "mean, mm"},
                              {"nmad_mm", "NMAD, mm"},
                              {"points", "points"}});
  html += "<h2>Distribution</h2>\n" +
          histogram_svg(deviation.histogram, deviation.histogram_limit_mm,
                        deviation.statistics.mean_mm, deviation.statistics.sigma_mm, "mm") +
          "<p>Line: normal distribution of the same mean and standard deviation.</p>\n";
  return write_file(out, page("Scan against design", html));
}

}  // namespace maquette::tools
