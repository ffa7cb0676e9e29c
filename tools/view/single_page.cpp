// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/single_page.hpp"

#include <fmt/format.h>

namespace maquette::tools {
namespace {

std::string replaced(std::string text, std::string_view what, std::string_view by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
    text.replace(at, what.size(), by);
  return text;
}

const PageFile* page_file(std::span<const PageFile> page, std::string_view begin,
                          std::string_view end) {
  for (const PageFile& f : page)
    if (f.name.starts_with(begin) && f.name.ends_with(end)) return &f;
  return nullptr;
}

std::string escaped(std::string_view text) {
  std::string out(text);
  out = replaced(std::move(out), "&", "&amp;");
  return replaced(std::move(out), "<", "&lt;");
}

/// Replaces an element that names a file by what `by` makes of the file.
template <typename By>
std::string with_inside(std::string html, std::string_view begin, std::string_view attribute,
                        std::string_view end, std::span<const PageFile> page, const By& by) {
  std::size_t from = 0;
  while ((from = html.find(begin, from)) != std::string::npos) {
    const std::size_t to = html.find(end, from);
    if (to == std::string::npos) break;
    const std::string element = html.substr(from, to + end.size() - from);
    const std::size_t name = element.find(attribute);
    std::string text = element;
    if (name != std::string::npos) {
      const std::size_t first = name + attribute.size(), last = element.find('"', first);
      std::string_view file = std::string_view(element).substr(first, last - first);
      if (file.starts_with("./")) file.remove_prefix(2);
      if (const PageFile* f = page_file(page, file, file)) text = by(f->bytes);
    }
    html.replace(from, element.size(), text);
    from += text.size();
  }
  return html;
}

}  // namespace

std::string single_page(std::span<const PageFile> page, std::string_view carried) {
  const PageFile* index = page_file(page, "index.html", "index.html");
  if (index == nullptr) return {};
  std::string html(index->bytes);
  html = with_inside(std::move(html), "<link rel=\"stylesheet\"", "href=\"", ">", page,
                     [](std::string_view text) { return fmt::format("<style>{}</style>", text); });
  html = with_inside(std::move(html), "<script type=\"module\"", "src=\"", "</script>", page,
                     [](std::string_view text) {
                       std::string script = replaced(std::string(text), "</script", "<\\/script");
                       return "<script type=\"module\">" +
                              replaced(std::move(script), "<!--", "<\\!--") + "</script>";
                     });
  // Licences have to travel with what they are of.
  if (const PageFile* licences = page_file(page, "licences.txt", "licences.txt")) {
    html = replaced(std::move(html), "<a href=\"licences.txt\">licences</a>", "licences below");
    html = replaced(std::move(html), "</aside>",
                    fmt::format("<details id=\"licences\"><summary>Licences</summary>"
                                "<pre>{}</pre></details>\n</aside>",
                                escaped(licences->bytes)));
  }
  html = replaced(
      std::move(html), "<meta charset=\"utf-8\">",
      "<meta charset=\"utf-8\">\n<meta http-equiv=\"Content-Security-Policy\" content=\""
      "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; "
      "style-src 'unsafe-inline'; img-src data: blob:; connect-src data: blob:\">");
  const std::size_t end = html.rfind("</body>");
  html.insert(end == std::string::npos ? html.size() : end, carried);
  return html;
}

}  // namespace maquette::tools
