// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/deviation_page.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "tools/deviation_view_text.hpp"
#include "tools/document.hpp"
#include "tools/pictures.hpp"
#include "tools/report.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr std::ptrdiff_t kViewNodes = 420;  // a side, at most
constexpr std::size_t kMostRows = 40;       // of a table; summary.json has all

/// As a person reads it: no exponents of a computer.
std::string figure(double v, int digits) {
  const double size = std::abs(v);
  // Half a unit less: 999.7 is 1000, not 1e+03.
  if (size >= std::fmin(1e4, std::pow(10.0, digits)) - 0.5 && size < 1e15)
    return fmt::format("{:.0f}", v);
  if (size >= 1e-4 || size == 0.0 || !std::isfinite(v)) return fmt::format("{:.{}g}", v, digits);
  if (size < 1e-12) return v > 0.0 ? "< 10\u207b\u00b9\u00b2" : "0";
  constexpr std::array kDigits{"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                               "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
  const auto tens = static_cast<int>(-std::floor(std::log10(size)));
  std::string text = fmt::format("{:.1f}\u00b710\u207b", v * std::pow(10.0, tens));
  for (const char c : fmt::format("{}", tens)) text += kDigits[static_cast<std::size_t>(c - '0')];
  return text;
}

Table::Cell cell(const json& v) {
  if (v.is_null()) return {"\u2013", true};
  if (v.is_number_float()) return {figure(v.get<double>(), 4), true};
  if (v.is_number()) return {v.dump(), true};
  if (v.is_string()) return {v.get<std::string>(), false};
  if (v.is_array()) {
    std::string text;
    for (const json& e : v)
      text += (text.empty() ? "" : ", ") + (e.is_string()         ? e.get<std::string>()
                                            : e.is_number_float() ? figure(e.get<double>(), 3)
                                                                  : e.dump());
    return {text.empty() ? "nothing" : text, false};
  }
  return {v.dump(), false};
}

using Columns = std::vector<std::pair<const char*, const char*>>;  // key, heading

void add_table(Document& doc, const json& rows, const Columns& columns) {
  Table table;
  for (const auto& [key, heading] : columns) table.head.emplace_back(heading);
  for (const json& row : rows) {
    if (table.rows.size() == kMostRows) break;
    auto& to = table.rows.emplace_back();
    for (const auto& [key, heading] : columns)
      to.push_back(cell(row.contains(key) ? row[key] : json()));
  }
  doc.emplace_back(std::move(table));
  if (rows.size() > kMostRows)
    doc.emplace_back(
        Paragraph{fmt::format("{} more are in summary.json.", rows.size() - kMostRows)});
}

void add_figures(Document& doc, const json& from, const Columns& rows) {
  Table table;
  for (const auto& [key, heading] : rows)
    if (from.contains(key)) table.rows.push_back({{heading, false}, cell(from[key])});
  doc.emplace_back(std::move(table));
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
  return "<div><canvas id='part' style='width:100%;height:560px;"
         "touch-action:none;cursor:grab'></canvas>\n" +
         signed_legend_svg(limit_mm, "mm") +
         "\n"
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

void add_findings(Document& doc, const json& s) {
  doc.emplace_back(Heading{2, "What is significant"});
  if (s["findings"].empty()) {
    doc.emplace_back(Paragraph{"Nothing: no patch stands out of noise and registration."});
  } else {
    json patches = json::array();
    for (const json& f : s["findings"]) {
      if (!f["whole_part"].get<bool>()) {
        patches.push_back(f);
        continue;
      }
      doc.emplace_back(Paragraph{fmt::format(
          "The part as a whole lies {} mm off (\u00b1 {} mm, its middle, along the normal). What "
          "follows is against that level.",
          figure(f["height_mm"], 4), figure(f["sigma_height_mm"], 2))});
    }
    if (!patches.empty())
      doc.emplace_back(Paragraph{
          "Heights are steps against the surroundings, along the normal, and what they are "
          "if the place was moved along z; \u00b1 is one standard deviation. Most certain "
          "first."});
    add_table(doc, patches,
              {{"x_mm", "x, mm"},
               {"y_mm", "y, mm"},
               {"height_mm", "height, mm"},
               {"sigma_height_mm", "\u00b1"},
               {"along_z_mm", "along z, mm"},
               {"diameter_mm", "diameter, mm"},
               {"sigma_diameter_mm", "\u00b1"},
               {"length_mm", "length, mm"},
               {"width_mm", "width, mm"},
               {"volume_mm3", "volume, mm\u00b3"},
               {"certainty", "sigmas"}});
  }
  if (!s["detection_limits"].empty()) {
    doc.emplace_back(Heading{2, "The smallest that these scans would show"});
    doc.emplace_back(Paragraph{
        "A round patch of this width that stands so much out of its surroundings is found with "
        "95 %, wherever it lies; a lower one may be there and not be found. By noise, density and "
        "the number of places that are looked at; widths that are missing are not sure to be "
        "found at any height. More points (scans from more stations, or denser ones) lower it by "
        "the root of their number."});
    add_table(doc, s["detection_limits"],
              {{"width_mm", "width, mm"}, {"height_mm", "height, mm"}, {"points", "points in it"}});
  }
  if (!s["worst"].empty()) {
    doc.emplace_back(Heading{2, "Worst places"});
    doc.emplace_back(Paragraph{fmt::format(
        "Means of cells of {} mm that are farthest from the design beyond their own limit of "
        "detection (95 %), whatever was expected. Of that many cells some go beyond it by "
        "chance; the last column says which do not.",
        figure(s["worst"]["cell_mm"], 3))});
    json places = s["worst"]["places"];
    for (json& p : places) p["significant"] = p["significant"].get<bool>() ? "yes" : "no";
    add_table(doc, places,
              {{"x_mm", "x, mm"},
               {"y_mm", "y, mm"},
               {"mean_mm", "mean, mm"},
               {"detection_limit_mm", "limit of detection, mm"},
               {"significant", "significant"}});
  }
  if (!s["objects"].empty()) {
    doc.emplace_back(Heading{2, "Objects that are in no plan"});
    add_table(doc, s["objects"],
              {{"x_mm", "x, mm"},
               {"y_mm", "y, mm"},
               {"height_mm", "height, mm"},
               {"sigma_height_mm", "\u00b1"},
               {"length_mm", "length, mm"},
               {"width_mm", "width, mm"},
               {"volume_mm3", "volume, mm\u00b3"},
               {"points", "points"},
               {"resembles", "resembles missing stone"}});
  }
  if (!s["stones"].empty()) {
    doc.emplace_back(Heading{2, "Stones"});
    add_table(doc, s["stones"],
              {{"number", "stone"},
               {"state", "state"},
               {"carries", "in its place"},
               {"shift_mm", "shift x, y, z, mm"},
               {"sigma_shift_mm", "\u00b1"},
               {"turn_deg", "turn, \u00b0"},
               {"sigma_turn_deg", "\u00b1"},
               {"tilt_deg", "tilt, \u00b0"},
               {"sigma_tilt_deg", "\u00b1"},
               {"chance", "by chance"},
               {"points", "points"},
               {"reason", "why not more is said"}});
  }
  if (!s["regions"].empty()) {
    doc.emplace_back(Heading{2, "Regions"});
    doc.emplace_back(
        Paragraph{"Decided with the expanded uncertainty as guard band (ISO 14253-1)."});
    add_table(doc, s["regions"],
              {{"name", "region"},
               {"points", "points"},
               {"mean_mm", "mean, mm"},
               {"sigma_mean_mm", "\u00b1"},
               {"rms_mm", "RMS, mm"},
               {"nmad_mm", "NMAD, mm"},
               {"p05_mm", "5 %, mm"},
               {"p95_mm", "95 %, mm"},
               {"within", "in tolerance"},
               {"verdict", "verdict"},
               {"worst_mm", "worst, mm"}});
  }
}

void add_profiles(Document& doc, const json& profiles) {
  if (profiles.empty()) return;
  doc.emplace_back(Heading{2, "Profiles"});
  doc.emplace_back(
      Paragraph{"Measured minus design along the normal, mean of each stretch; the shade is two "
                "standard deviations of the mean. Gaps: fewer than three points."});
  for (const json& p : profiles) {
    doc.emplace_back(Heading{3, p["name"].get<std::string>()});
    Curve curve{{}, {}, {}, "way along the line, mm", "deviation, mm"};
    for (const json& v : p["values"]) {
      const auto number = [&](const char* key) {
        return v[key].is_number() ? v[key].get<double>() : NAN;
      };
      curve.x.push_back(number("along_mm"));
      curve.y.push_back(number("mean_mm"));
      curve.half_width.push_back(2.0 * number("sigma_mm"));
    }
    doc.emplace_back(std::move(curve));
    const json& first = p["values"].front();
    const json& last = p["values"].back();
    doc.emplace_back(Paragraph{fmt::format("From x {}, y {} to x {}, y {} mm, stretches of {} mm.",
                                           figure(first["x_mm"], 4), figure(first["y_mm"], 4),
                                           figure(last["x_mm"], 4), figure(last["y_mm"], 4),
                                           figure(p["step_mm"], 3))});
  }
}

void add_registration(Document& doc, const json& s) {
  doc.emplace_back(Heading{2, "Scans"});
  add_table(doc, s["stations"],
            {{"points", "scan"},
             {"points_compared", "points compared"},
             {"at_mm", "scanner at x, y, z, mm"},
             {"range_mm", "range, mm"},
             {"incidence_deg", "incidence, \u00b0"},
             {"beam_diameter_mm", "beam, mm"},
             {"mixed", "mixed points left out"}});
  doc.emplace_back(Heading{2, "Registration"});
  add_table(doc, s["registrations"],
            {{"points", "scan"},
             {"points_used", "points"},
             {"iterations", "iterations"},
             {"rms_before_mm", "RMS before, mm"},
             {"rms_after_mm", "RMS after, mm"},
             {"noise_mm", "noise, mm"},
             {"overlap", "overlap"},
             {"likeness", "relief shown"},
             {"scale", "scale"},
             {"sigma_translation_mm", "pose \u00b1, mm"},
             {"sigma_rotation_rad", "rad"},
             {"effective_points", "independent points"},
             {"free_directions", "not determined"}});
  if (s["fitted_without_findings"].get<bool>())
    doc.emplace_back(Paragraph{
        "The poses are best fits without the places that are significant: these would pull the "
        "scans along the slopes that they lie on."});
  if (s.contains("beam"))
    doc.emplace_back(Paragraph{fmt::format(
        "A beam measures a mean over its width. What that does on the expected surface was taken "
        "out of the ranges: {:.2g} mm RMS, {:.2g} mm at most; {} points beside edges within their "
        "beam are left out.",
        s["beam"]["rms_mm"].get<double>(), s["beam"]["largest_mm"].get<double>(),
        s["beam"]["at_edges"].get<std::uint64_t>())});
  if (!s["spheres"].empty()) {
    doc.emplace_back(Paragraph{"Reference spheres found in the clouds and matched to datums:"});
    add_table(doc, s["spheres"],
              {{"points", "scan"},
               {"found", "spheres found"},
               {"matched", "matched"},
               {"missing", "not found"},
               {"rms_mm", "RMS off, mm"},
               {"sigma_translation_mm", "pose \u00b1, mm"},
               {"sigma_rotation_rad", "rad"}});
  }
  if (!s["datums"].empty()) {
    doc.emplace_back(Paragraph{
        "The comparison uses the registration on datums. Beside it, what a best fit would "
        "have taken away:"});
    add_table(doc, s["datums"],
              {{"points", "scan"},
               {"absorbed_mean_mm", "absorbed, mean, mm"},
               {"absorbed_sigma_mm", "\u00b1"},
               {"absorbed_min_mm", "least, mm"},
               {"absorbed_max_mm", "most, mm"},
               {"sigma_translation_mm", "pose on datums \u00b1, mm"},
               {"free_directions", "not determined"}});
    for (const json& d : s["datums"]) {
      doc.emplace_back(Paragraph{fmt::format("Datums in {}:", d["points"].get<std::string>())});
      add_table(doc, d["fits"],
                {{"name", "datum"},
                 {"points", "points"},
                 {"mean_mm", "residual, mm"},
                 {"noise_mm", "noise, mm"}});
    }
  } else {
    doc.emplace_back(Paragraph{
        "Each scan was brought onto the part by best fit before this comparison. A best fit "
        "absorbs "
        "what looks like a shift or a tilt of the whole part, an even coat of paint for example: "
        "such a deviation does not appear here. Datums in the case file show it."});
  }
}

void add_corrections(Document& doc, const json& c) {
  doc.emplace_back(Heading{2, "Where the part and the axes are"});
  doc.emplace_back(
      Paragraph{"In the frame of the datums, against the plan. corrections.toml has the "
                "same for render, mill and run."});
  add_figures(doc, c,
              {{"translation_mm", "part moved by x, y, z, mm"},
               {"sigma_translation_mm", "\u00b1 of its middle, mm"},
               {"rotation_deg", "turned about x, y, z, \u00b0"},
               {"sigma_rotation_deg", "\u00b1, \u00b0"}});
  if (!c["axes"].empty())
    add_table(doc, c["axes"],
              {{"name", "axis"},
               {"origin_mm", "at position 0, mm"},
               {"direction", "direction"},
               {"sigma_direction_deg", "\u00b1, \u00b0"},
               {"scale", "scale"},
               {"sigma_scale", "\u00b1"},
               {"straightness_mm", "off straight, mm"}});
}

Document document_of(const scan::Deviation& deviation, const heightmap::ModelField& design,
                     const json& s, double limit_mm, const fs::path& map_png,
                     const fs::path& significant_png) {
  const bool expected = s.contains("expected");
  Document doc;
  add_figures(doc, s, {kDeviationFigures.begin(), kDeviationFigures.end()});
  if (s.contains("passed_over"))
    doc.emplace_back(Paragraph{fmt::format(
        "The scans hold more points than are compared at once: an even random share of them was "
        "taken, {} points were passed over. Every figure here is of that share.",
        s["passed_over"].get<std::uint64_t>())});
  doc.emplace_back(Heading{2, "Deviation"});
  doc.emplace_back(Picture{map_png,
                           "measured minus design along the normal, over the hillshade of the "
                           "design; dark grey: not measured",
                           SignedLegend{limit_mm, "mm"}});
  doc.emplace_back(Picture{significant_png,
                           fmt::format("{}, where it is more than noise (one scan in a hundred of "
                                       "a part as expected shows anything); "
                                       "without colour: not significant",
                                       expected ? "measured minus expected" : "the same"),
                           SignedLegend{limit_mm, "mm"}});
  if (expected) {
    doc.emplace_back(Heading{2, "Beside what was expected"});
    doc.emplace_back(Paragraph{
        "The design with what the program leaves on it and the coat that was declared. Poses were "
        "found on this surface, and what is significant is a deviation from it."});
    add_figures(doc, s["expected"],
                {{"as_milled", "simulated cut"},
                 {"coating_mm", "coat, mm"},
                 {"known_mean_mm", "expected deviation from the design, mean, mm"},
                 {"known_max_mm", "highest, mm"},
                 {"mean_mm", "measured minus expected, mean, mm"},
                 {"rms_mm", "RMS, mm"},
                 {"nmad_mm", "NMAD, mm"},
                 {"p05_mm", "5th percentile, mm"},
                 {"p95_mm", "95th percentile, mm"}});
  }
  doc.emplace_back(Interactive{"<h2>On the part</h2>\n" + view(deviation, design, limit_mm)});
  add_findings(doc, s);
  add_profiles(doc, s["profiles"]);
  add_registration(doc, s);
  if (s.contains("corrections")) add_corrections(doc, s["corrections"]);
  doc.emplace_back(Heading{2, "Uncertainty"});
  doc.emplace_back(Paragraph{"Of the mean of a cell, by the GUM."});
  add_table(doc, s["budget"]["contributions"],
            {{"source", "source"}, {"u_mm", "u, mm"}, {"evaluation", "evaluated from"}});
  add_figures(doc, s["budget"],
              {{"combined_mm", "combined, mm"}, {"expanded_mm", "expanded, k = 2, mm"}});
  doc.emplace_back(Heading{2, "Texture of what is left"});
  doc.emplace_back(Paragraph{"ISO 25178-2, after a form of second degree."});
  add_figures(doc, s["texture"],
              {{"sa_mm", "Sa, mm"},
               {"sq_mm", "Sq, mm"},
               {"sz_mm", "Sz, mm"},
               {"ssk", "Ssk"},
               {"sku", "Sku"},
               {"sdr", "Sdr"},
               {"form_mm", "form taken off, mm"}});
  if (!s["dependences"].empty()) doc.emplace_back(Heading{2, "What deviations go with"});
  for (const json& d : s["dependences"]) {
    doc.emplace_back(Heading{3, "By " + d["on"].get<std::string>()});
    add_table(doc, d["bins"],
              {{"from", "from"},
               {"to", "to"},
               {"mean_mm", "mean, mm"},
               {"nmad_mm", "NMAD, mm"},
               {"points", "points"}});
  }
  doc.emplace_back(Heading{2, "Distribution"});
  doc.emplace_back(Histogram{deviation.histogram, deviation.histogram_limit_mm,
                             deviation.statistics.mean_mm, deviation.statistics.sigma_mm, "mm"});
  doc.emplace_back(Paragraph{"Line: normal distribution of the same mean and standard deviation."});
  return doc;
}

}  // namespace

Result<void> write_deviation_report(const scan::Deviation& deviation,
                                    const heightmap::ModelField& design,
                                    const std::string& summary_json, double limit_mm,
                                    const fs::path& map_png, const fs::path& significant_png,
                                    const fs::path& html, const fs::path& pdf) {
  constexpr const char* kTitle = "Scan against design";
  const Document doc =
      document_of(deviation, design, json::parse(summary_json), limit_mm, map_png, significant_png);
  MAQUETTE_TRY_VOID(write_file(html, page(kTitle, to_html(doc))));
  return write_pdf(doc, kTitle, pdf);
}

}  // namespace maquette::tools
