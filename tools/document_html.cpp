// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include "core/files.hpp"
#include "core/markup.hpp"
#include "tools/curve_drawing.hpp"
#include "tools/document.hpp"
#include "tools/pictures.hpp"

namespace maquette::tools {
namespace {

struct ToHtml {
  std::string operator()(const Heading& h) const {
    return fmt::format("<h{0}>{1}</h{0}>\n", h.level, markup_escaped(h.text));
  }
  std::string operator()(const Paragraph& p) const {
    return fmt::format("<p>{}</p>\n", markup_escaped(p.text));
  }
  std::string operator()(const Table& t) const {
    std::string html = "<div class='wide'><table>";
    if (!t.head.empty()) {
      html += "<tr>";
      for (const std::string& cell : t.head) html += "<th>" + markup_escaped(cell) + "</th>";
      html += "</tr>";
    }
    for (const auto& row : t.rows) {
      html += "<tr>";
      for (const Table::Cell& cell : row)
        html += fmt::format("<td{}>{}</td>", cell.number ? " class='n'" : "",
                            markup_escaped(cell.text));
      html += "</tr>";
    }
    return html + "</table></div>\n";
  }
  std::string operator()(const Picture& p) const {
    const auto data = read_file(p.png);
    if (!data)
      return fmt::format("<p class='warn'>{} is missing</p>", markup_escaped(p.png.string()));
    return fmt::format(
        "<figure style='width:480px'><img width='480' alt='{0}' "
        "src='data:image/png;base64,{1}'>{2}<figcaption>{0}"
        "</figcaption></figure>\n",
        markup_escaped(p.caption), base64(*data),
        p.legend ? signed_legend_svg(p.legend->limit, p.legend->unit) : "");
  }
  std::string operator()(const SignedLegend& l) const {
    return signed_legend_svg(l.limit, l.unit) + "\n";
  }
  std::string operator()(const Histogram& h) const {
    return histogram_svg(h.bins, h.limit, h.mean, h.sigma, h.unit) + "\n";
  }
  std::string operator()(const Curve& c) const { return curve_svg(c) + "\n"; }
  std::string operator()(const Interactive& i) const { return i.html; }
};

}  // namespace

std::string to_html(const Document& document) {
  std::string html;
  for (const Block& block : document) html += std::visit(ToHtml{}, block);
  return html;
}

}  // namespace maquette::tools
