// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/pdf_page.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace maquette::tools {

PdfPage::PdfPage(cairo_t* on, std::string title) : cairo(on), title_(std::move(title)) {
  begin();
}

void PdfPage::begin() {
  ++page_;
  y = kMargin + kText;
  font(7.0, false);
  const double keep = y;
  y = kHeight - 30.0;
  put(kMargin, title_);
  const std::string number = fmt::format("{}", page_);
  put(kWidth - kMargin - width(number), number);
  y = keep;
}

void PdfPage::next_page() {
  cairo_show_page(cairo);
  begin();
}

void PdfPage::room(double high) {
  if (y + high > kHeight - kFoot && y > kMargin + 2.0 * kLine) next_page();
}

void PdfPage::font(double size, bool bold) {
  cairo_select_font_face(cairo, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                         bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(cairo, size);
}

double PdfPage::width(const std::string& text) const {
  cairo_text_extents_t extents;
  cairo_text_extents(cairo, text.c_str(), &extents);
  return extents.x_advance;
}

void PdfPage::put(double x, const std::string& text) {
  cairo_set_source_rgb(cairo, 0.0, 0.0, 0.0);
  cairo_move_to(cairo, x, y);
  cairo_show_text(cairo, text.c_str());
}

std::vector<std::string> PdfPage::wrapped(const std::string& text, double wide) const {
  std::vector<std::string> lines{""};
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t end = std::min(text.find(' ', i), text.size());
    std::string word = text.substr(i, end - i);
    const std::string longer = lines.back().empty() ? word : lines.back() + " " + word;
    if (lines.back().empty() || width(longer) <= wide)
      lines.back() = longer;
    else
      lines.push_back(word);
    while (width(lines.back()) > wide + 1e-6 && lines.back() != first_of(lines.back(), wide)) {
      const std::string part = first_of(lines.back(), wide);
      word = lines.back().substr(part.size());
      lines.back() = part;
      lines.push_back(word);
    }
    i = end + 1;
  }
  return lines;
}

/// As many characters of a word as fit, one at least.
std::string PdfPage::first_of(const std::string& word, double wide) const {
  std::string part;
  for (std::size_t i = 0; i < word.size();) {
    std::size_t end = i + 1;
    while (end < word.size() && (static_cast<unsigned char>(word[end]) & 0xc0U) == 0x80U) ++end;
    const std::string longer = word.substr(0, end);
    if (!part.empty() && width(longer) > wide) break;
    part = longer;
    i = end;
  }
  return part;
}

}  // namespace maquette::tools
