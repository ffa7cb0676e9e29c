// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/fuse_page.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/markup.hpp"
#include "tools/pictures.hpp"
#include "tools/report.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr int kWidth_px = 500;

std::string swatch(std::size_t source, const std::string& name) {
  const camera::Rgb8 c = source_colour(source);
  return fmt::format(
      "<span style='white-space:nowrap;margin-right:1em'><span style='display:inline-block;"
      "width:.9em;height:.9em;background:rgb({},{},{})'></span> {}</span>",
      c[0], c[1], c[2], markup_escaped(name));
}

/// Names of all sources with their colours.
std::string source_key(const json& fuse) {
  std::string html = "<div>";
  std::size_t i = 0;
  for (const json& s : fuse.value("sources", json::array()))
    html += swatch(i++, s.value("name", std::string()));
  return html + swatch(255, "filled") + "</div>";
}

std::string source_table(const json& fuse) {
  std::string html =
      "<div class='wide'><table><tr><th>source</th><th>pixel, m</th><th>coverage</th><th>shift "
      "east, m</th><th>&plusmn;</th><th>north, m</th><th>&plusmn;</th><th>up, m</th>"
      "<th>&plusmn;</th><th>tilt east, m/m</th><th>north, m/m</th><th>NMAD before, m</th>"
      "<th>after, m</th><th></th></tr>";
  for (const json& s : fuse.value("sources", json::array())) {
    html += "<tr>";
    for (const char* key : {"name", "pixel_m", "coverage", "shift_east_m", "sigma_east_m",
                            "shift_north_m", "sigma_north_m", "shift_up_m", "sigma_up_m",
                            "tilt_east", "tilt_north", "nmad_before_m", "nmad_after_m"})
      html += fmt::format("<td class='n'>{}</td>", number_html(s[key]));
    const auto why = s.value("height_only", std::string());
    html +=
        fmt::format("<td>{}</td></tr>", why.empty() ? "" : "height only: " + markup_escaped(why));
  }
  return html + "</table></div>\n";
}

/// What is left between each source and those before it.
std::string residuals(const json& fuse, const fs::path& folder) {
  std::string html;
  for (const json& s : fuse.value("sources", json::array())) {
    if (!s.contains("residual")) continue;
    const fs::path file = folder / s["residual"].get<std::string>();
    html += picture_html(
        fs::path(file).replace_extension(".png"),
        fmt::format("difference that alignment left: sources before {} less {}; median {:.3g} m, "
                    "NMAD {:.3g} m, in cells of {:.3g} m; dark grey: not both",
                    s.value("name", ""), s.value("name", ""), s.value("residual_median_m", 0.0),
                    s.value("residual_nmad_m", 0.0), s.value("residual_cell_m", 0.0)),
        kWidth_px, signed_legend_svg(s.value("residual_colour_m", 1.0), "m"));
  }
  return html;
}

}  // namespace

std::string surface_html(const json& fuse) {
  return "<h3>Surface</h3>\n" + figure_table_html(fuse, {{"nodes", "nodes"},
                                                         {"spacing_mm", "spacing, mm"},
                                                         {"relief_mm", "relief, mm"},
                                                         {"lowest_m", "lowest, m"},
                                                         {"highest_m", "highest, m"}});
}

std::string sources_html(const json& fuse, const fs::path& folder) {
  if (fuse.empty()) return "";
  std::string html = "<h3>Sources</h3>\n" + source_table(fuse) + residuals(fuse, folder);
  html += picture_html(
      folder / "sigma.png",
      fmt::format("standard uncertainty, doublings of its median {:.3g} mm: red larger, blue "
                  "smaller",
                  fuse.value("sigma_median_mm", 0.0)),
      kWidth_px, signed_legend_svg(fuse.value("sigma_colour_octaves", 1.0), "octaves"));
  const double synthetic_mm = fuse.value("synthetic_mm", 0.0);
  html += picture_html(folder / "source.png",
                       synthetic_mm > 0.0
                           ? fmt::format("most exact source; below its pixels synthetic detail, "
                                         "standard deviation {:.3g} mm (source.tif: + 100)",
                                         synthetic_mm)
                           : "most exact source",
                       kWidth_px, source_key(fuse));
  if (fs::exists(folder / "detail_source.png"))
    html += picture_html(folder / "detail_source.png",
                         "most exact source of waves shorter than the crossover", kWidth_px,
                         source_key(fuse));
  return html + picture_html(folder / "artefacts.png",
                             "artefacts: spikes red, boxes orange, seams violet, ripples and "
                             "stripes blue",
                             kWidth_px);
}

Result<void> write_fuse_page(const Site& site, const fs::path& out) {
  std::string html;
  for (const double scale : site.scales) {
    const fs::path here = out / scale_folder(scale);
    const auto text = read_file(here / "fuse.json");
    if (!text) continue;
    const json fuse = json::parse(*text);
    html += fmt::format("<h2>Scale 1:{:g}</h2>\n", scale) +
            picture_html(here / "hillshade.png", "hillshade of the design, sun from the north-west",
                         kWidth_px) +
            surface_html(fuse) + sources_html(fuse, here);
  }
  return write_file(out / "fuse.html", page("maquette fuse: " + site.name, html));
}

}  // namespace maquette::tools
