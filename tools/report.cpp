// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/report.hpp"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/markup.hpp"
#include "tools/deviation_page.hpp"
#include "tools/fuse_page.hpp"
#include "tools/path_view.hpp"
#include "tools/pictures.hpp"
#include "tools/version.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr const char* kPageStart = R"(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; }}
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; }}
h1 {{ font-size: 1.6em; }} h2 {{ margin-top: 2em; border-bottom: 1px solid #8886; }}
table {{ border-collapse: collapse; margin: 1em 0; }}
td, th {{ padding: .2em .8em; text-align: left; border-bottom: 1px solid #8884; }}
td.n {{ text-align: right; font-variant-numeric: tabular-nums; }}
figure {{ margin: 1em 0; display: inline-block; vertical-align: top; max-width: 100%; }}
figcaption {{ font-size: .85em; opacity: .8; }}
img, svg {{ max-width: 100%; height: auto; }}
svg text {{ fill: currentColor; }}
.wide {{ overflow-x: auto; }}
.warn {{ color: #b2182b; font-weight: 600; }}
</style></head><body><h1>{title}</h1>
)";
constexpr const char* kPageEnd = "</body></html>\n";

std::string head(const std::string& title) {
  return fmt::format(fmt::runtime(kPageStart), fmt::arg("title", markup_escaped(title)));
}

/// Machining time as the verified programs of one scale take it; nothing where there is none.
std::string machining_time(std::span<const UnitRecord> records, const std::string& scale) {
  std::string rows;
  double cutting = 0.0, rapid = 0.0, total = 0.0, length = 0.0;
  for (const UnitRecord& r : records) {
    if (!r.name.starts_with(scale + ".verify")) continue;
    const json figures = json::parse(r.figures_json);
    for (const json& t : figures.value("machining_time", json::array())) {
      rows += fmt::format(
          "<tr><td>{}</td><td>{}</td><td>{}</td><td class='n'>{:.1f}</td><td class='n'>{:.1f}</td>"
          "<td class='n'>{:.1f}</td><td class='n'>{:.1f}</td></tr>",
          number_html(t.value("program", json(""))), number_html(t.value("tool", json(""))),
          number_html(t.value("band", json(""))), t.value("cutting_min", 0.0),
          t.value("rapid_min", 0.0), t.value("total_min", 0.0), t.value("length_m", 0.0));
      cutting += t.value("cutting_min", 0.0);
      rapid += t.value("rapid_min", 0.0);
      total += t.value("total_min", 0.0);
      length += t.value("length_m", 0.0);
    }
  }
  if (rows.empty()) return "";
  return fmt::format(
      "<h3>Machining time</h3>\n<div class='wide'><table><tr><th>program</th><th>tool</th>"
      "<th>band</th><th>cutting, min</th><th>rapids, min</th><th>all, min</th><th>path, m</th></tr>"
      "{}<tr><th>all</th><td></td><td></td><td class='n'>{:.1f}</td><td class='n'>{:.1f}</td><td "
      "class='n'>{:.1f}</td><td class='n'>{:.1f}</td></tr></table></div>\n",
      rows, cutting, rapid, total, length);
}

/// What the simulated cut has drawn of its programs: the view, and where the pictures lie.
std::string paths(const fs::path& folder, const fs::path& page_folder, const std::string& title) {
  const auto scene = read_file(folder / "backplot" / "paths.json");
  if (!scene) return "";
  std::string html = fmt::format("<h3>{}</h3>\n{}", title, path_view_html(*scene));
  html += "<div class='wide'><table><tr><th>from above</th><th>feed</th><th>engagement</th></tr>";
  const json parsed = json::parse(*scene);
  for (const json& program : parsed["programs"]) {
    const auto name = program["name"].get<std::string>();
    html += fmt::format("<tr><td>{}</td>", markup_escaped(name));
    for (const char* colour : {"feed", "engagement"}) {
      html += "<td>";
      for (const char* format : {"svg", "png"}) {
        const fs::path file = folder / "backplot" / fmt::format("{}.{}.{}", name, colour, format);
        html += fmt::format("<a href='{}'>{}</a> ",
                            markup_escaped(file.lexically_relative(page_folder).generic_string()),
                            format);
      }
      html += "</td>";
    }
    html += "</tr>";
  }
  return html + "</table></div>\n";
}

/// What the design asks of cutter and block; nothing where it was not looked at.
std::string cutter_reach(const json& reach, const fs::path& folder) {
  if (reach.empty()) return "";
  const double most_mm = reach.value("reach_colour_mm", 0.0);
  return "<h3>For the cutter</h3>\n" +
         figure_table_html(reach,
                           {{"ball_diameter_mm", "ball, mm"},
                            {"threshold_mm", "not reached: it leaves more than, mm"},
                            {"unreached_percent", "not reached, % of the surface"},
                            {"unreached_volume_mm3", "left there, mm&sup3;"},
                            {"most_left_mm", "most left, mm"},
                            {"steepest_deg", "steepest, degrees"},
                            {"slope_limit_deg", "limit of slope, degrees; 90: none"},
                            {"above_slope_limit_percent", "steeper than that, % of the surface"},
                            {"relief_mm", "relief, mm"},
                            {"cutter_length_mm", "cutter below its holder, mm; 0: not given"},
                            {"stock_needed_mm", "block needed: base, relief, margin, mm"},
                            {"stock_height_mm", "block, mm; 0: not given"}}) +
         picture_html(
             folder / "reach.png",
             fmt::format("left by the ball where it does not fit; full red: {:.2g} mm", most_mm),
             500) +
         picture_html(
             folder / "slope.png",
             fmt::format("slope; full red: {:g} degrees", reach.value("slope_colour_deg", 0.0)),
             500);
}

/// Where the part is cut, what stands on it, and what the workshop gets of that.
std::string bands_and_stones(const json& bands, const json& stones, const json& parts,
                             const fs::path& here) {
  std::string html;
  if (bands.contains("bands")) {
    html += "<h3>Bands</h3>\n" + picture_html(here / "bands" / "exploded.png",
                                              "bands, moved apart, with the stones", 900);
    for (const json& warning : bands.value("warnings", json::array()))
      html += fmt::format("<p class='warn'>{}</p>\n", number_html(warning));
  }
  if (std::error_code ec; fs::exists(here / "stones_far.png", ec)) {
    html += "<h3>Stones</h3>\n" +
            figure_table_html(
                stones, {{"on_surface", "stones on this surface"}, {"largest_mm", "largest, mm"}}) +
            picture_html(here / "stones_far.png", "all stones, under the lamp", 500) +
            picture_html(here / "stones_close.png", "where most of them lie", 500);
  }
  if (!parts.empty())
    html += "<h3>Stones for the workshop</h3>\n" +
            figure_table_html(parts, {{"stones", "stones"},
                                      {"distinct_parts", "distinct parts"},
                                      {"builds", "build volumes"},
                                      {"material_mm3", "material, mm&sup3;"}}) +
            "<p><a href='" + markup_escaped(here.filename().string()) +
            "/stone_parts/placing.pdf'>placing plan at 1:1</a>, <a href='" +
            markup_escaped(here.filename().string()) +
            "/stone_parts/builds.csv'>which stone is where in the build volumes</a></p>\n";
  return html;
}

constexpr const char* kRegistrationRemark =
    "<p>Each scan was brought onto what the programs leave by best fit before this comparison. A "
    "best fit "
    "absorbs what looks like a shift or a tilt of the whole part, an even coat of paint for "
    "example: such a deviation does not appear here.</p>\n";

}  // namespace

std::string picture_html(const fs::path& png, const std::string& caption, int width,
                         const std::string& legend) {
  const auto data = read_file(png);
  if (!data) return fmt::format("<p class='warn'>{} is missing</p>", markup_escaped(png.string()));
  return fmt::format(
      "<figure style='width:{0}px'><img width='{0}' alt='{1}' src='data:image/png;base64,{2}'>{3}"
      "<figcaption>{1}</figcaption></figure>\n",
      width, markup_escaped(caption), base64(*data),
      legend.empty() ? "" : "<div>" + legend + "</div>");
}

std::string number_html(const json& v) {
  if (v.is_number_float()) return fmt::format("{:.6g}", v.get<double>());
  if (v.is_string()) return markup_escaped(v.get<std::string>());
  return markup_escaped(v.dump());
}

std::string figure_table_html(const json& figures,
                              const std::vector<std::pair<const char*, const char*>>& rows) {
  std::string html = "<table>";
  for (const auto& [key, label] : rows)
    if (figures.contains(key) && !figures[key].is_null())
      html += fmt::format("<tr><td>{}</td><td class='n'>{}</td></tr>", label,
                          number_html(figures[key]));
  return html + "</table>\n";
}

std::string scale_folder(double scale) {
  return fmt::format("s{:g}", scale);
}

std::string page(const std::string& title, const std::string& body) {
  return head(title) + body + kPageEnd;
}

Result<void> write_run_page(const Site& site, std::span<const UnitRecord> records,
                            const fs::path& folder, const fs::path& out, const std::string& view) {
  const auto figures_of = [&](const std::string& unit) {
    for (const UnitRecord& r : records)
      if (r.name == unit) return json::parse(r.figures_json);
    return json::object();
  };
  std::string html = head("maquette: " + site.name) + path_view_head();
  html += fmt::format(
      "<p>{}, {:.4f}&deg; latitude, {:.4f}&deg; longitude; {} mm x {} mm at {} mm; "
      "maquette {}.</p>\n",
      markup_escaped(site.body), site.centre_latitude_deg, site.centre_longitude_deg, site.size_mm,
      site.size_mm, site.spacing_mm, kVersion);
  if (!view.empty())
    html += fmt::format(
        "<p><a href='{}'>Surfaces, deviations and toolpaths to turn and click</a>, in one file "
        "that needs no network.</p>\n",
        view);
  for (const UnitRecord& r : records)
    if (!r.unmet.empty())
      html += fmt::format("<p class='warn'>{}: {}</p>\n", markup_escaped(r.name),
                          markup_escaped(r.unmet));

  for (const double scale : site.scales) {
    const std::string name = scale_folder(scale);
    const fs::path here = folder / name;
    html += fmt::format("<h2>Scale 1:{:g}</h2>\n", scale);
    html += picture_html(here / "hillshade.png", "hillshade of the design, sun from the north-west",
                         500);
    html += picture_html(here / "picture.png", "rendered: solid with stones under the lamp", 500);

    const json fuse = figures_of(name + ".fuse");
    html += surface_html(fuse);
    html += cutter_reach(figures_of(name + ".reach"), here);
    html += sources_html(fuse, here);
    html +=
        "<h3>Mesh</h3>\n" +
        figure_table_html(figures_of(name + ".mesh"),
                          {{"triangles", "triangles"},
                           {"closed", "closed"},
                           {"manifold", "2-manifold"},
                           {"oriented_outward", "oriented outward"},
                           {"euler_number", "Euler number"},
                           {"volume_mm3", "volume, mm&sup3;"},
                           {"rms_vertical_error_mm", "RMS vertical error against the design, mm"},
                           {"max_vertical_error_mm", "largest, mm"}});
    html += bands_and_stones(figures_of(name + ".stones.joints"), figures_of(name + ".stones"),
                             figures_of(name + ".stone-parts"), here);
    html +=
        "<h3>Toolpath</h3>\n<div "
        "class='wide'><table><tr><th>program</th><th>passes</th><th>blocks</th><th>bytes"
        "</th><th>path, m</th><th>time at feed, min</th><th>certified gouge, mm</th></tr>";
    for (const UnitRecord& r : records) {
      if (!r.name.starts_with(name + ".mill.")) continue;
      const json f = json::parse(r.figures_json);
      if (!f.contains("blocks")) continue;
      html += fmt::format(
          "<tr><td>{}</td><td class='n'>{}</td><td class='n'>{}</td><td class='n'>{}</td><td "
          "class='n'>{:.2f}</td><td class='n'>{:.1f}</td><td class='n'>{:.5f}</td></tr>",
          markup_escaped(r.name.substr(name.size() + 6)), number_html(f.value("passes", json(""))),
          number_html(f["blocks"]), number_html(f["bytes"]),
          f.value("path_length_mm", 0.0) / 1000.0, f.value("cutting_time_min", 0.0),
          f.value("certified_gouge_mm", 0.0));
    }
    html += "</table></div>\n" + machining_time(records, name) + paths(here, folder, "Paths");
    html +=
        "<h3>Simulated cut</h3>\n" +
        figure_table_html(figures_of(name + ".verify"),
                          {{"max_gouge_mm", "deepest gouge, mm"},
                           {"bound_mm", "that may be unseen between cells, mm"},
                           {"blending_mm", "that blending may add, in space, mm"},
                           {"max_gouge_against_mesh_mm", "deepest below the mesh, mm"},
                           {"max_excess_mm", "highest excess where the ball reaches, mm"},
                           {"max_excess_anywhere_mm", "highest excess anywhere, mm"},
                           {"rms_excess_mm", "RMS excess, mm"},
                           {"max_excess_over_scallop_mm",
                            "highest above the stated scallop where the ball has room, mm"},
                           {"max_tight_over_scallop_mm", "the same wherever the ball touches, mm"},
                           {"max_over_closing_mm",
                            "highest above that and the best any path of the ball leaves, mm"},
                           {"over_closing_area_mm2", "area where that is more than 10 um, mm2"},
                           {"rapid_collisions", "rapid moves that touch material"}});
    html += picture_html(here / "excess.png", "material left (red) and gouged (blue) after milling",
                         400);

    const json deviation = figures_of(name + ".deviate");
    html += "<h3>Scan against design</h3>\n" +
            figure_table_html(deviation, {kDeviationFigures.begin(), kDeviationFigures.end()}) +
            kRegistrationRemark +
            picture_html(here / "deviation.png",
                         "measured minus design along the normal; grey: not measured", 500);
    if (deviation.contains("histogram")) {
      const auto bins = deviation["histogram"].get<std::vector<std::uint64_t>>();
      html += signed_legend_svg(deviation["colour_limit_mm"], "mm") +
              histogram_svg(bins, deviation["histogram_limit_mm"], deviation.value("mean_mm", 0.0),
                            deviation.value("sigma_mm", 0.0), "mm");
    }
  }
  html +=
      "<h2>Stages</h2>\n<table><tr><th>unit</th><th>wall, s</th><th>CPU, s</th><th>peak "
      "memory, MiB</th><th></th></tr>";
  for (const UnitRecord& r : records)
    html += fmt::format(
        "<tr><td>{}</td><td class='n'>{:.2f}</td><td class='n'>{:.2f}</td><td "
        "class='n'>{:.0f}</td><td>{}</td></tr>",
        markup_escaped(r.name), r.wall_s, r.cpu_s, r.peak_mib, markup_escaped(r.note));
  return write_file(out, html + "</table>\n" + kPageEnd);
}

Result<void> write_manifest(const SiteFile& site, std::span<const UnitRecord> records,
                            const fs::path& site_path, const fs::path& out) {
  json manifest{
      {"schema", "maquette.manifest/1"}, {"maquette", kVersion},
      {"compiler", __VERSION__},         {"site", site.site->name},
      {"site_file", site_path.string()}, {"parameters", json::parse(site.schema.values_json())}};
  if (const auto digest = sha256_file(site_path)) manifest["site_sha256"] = *digest;
  const auto files = [](const std::vector<OutputRecord>& list) {
    json j = json::array();
    for (const OutputRecord& o : list)
      j.push_back({{"path", o.path}, {"sha256", o.sha256}, {"bytes", o.bytes}});
    return j;
  };
  for (const UnitRecord& r : records)
    manifest["stages"].push_back({{"name", r.name},
                                  {"wall_s", r.wall_s},
                                  {"cpu_s", r.cpu_s},
                                  {"peak_mib", r.peak_mib},
                                  {"note", r.note},
                                  {"unmet", r.unmet},
                                  {"figures", json::parse(r.figures_json)},
                                  {"parameters", json::parse(r.parameters_json)},
                                  {"inputs", files(r.inputs)},
                                  {"outputs", files(r.outputs)}});
  return write_file(out, manifest.dump(1) + "\n");
}

}  // namespace maquette::tools
