// SPDX-License-Identifier: GPL-3.0-or-later

// Cairo sets text and pictures on pages.

#include <algorithm>
#include <cmath>

#include <cairo-pdf.h>

#include "export/pdf_file.hpp"
#include "tools/document.hpp"
#include "tools/pdf_plots.hpp"
#include "tools/pdf_table.hpp"

namespace maquette::tools {
namespace {

constexpr double kMargin = PdfPage::kMargin, kText = PdfPage::kText, kLine = PdfPage::kLine;
constexpr double kColumn = PdfPage::kColumn;

void print(PdfPage& page, const Heading& h) {
  const double size = h.level <= 1 ? 16.0 : h.level == 2 ? 12.0 : 10.0;
  page.y += 0.9 * size;
  page.font(size, true);
  page.put(kMargin, h.text);
  page.y += 0.4 * size;
  if (h.level == 2) {
    cairo_set_source_rgb(page.cairo, 0.6, 0.6, 0.6);
    cairo_set_line_width(page.cairo, 0.5);
    cairo_move_to(page.cairo, kMargin, page.y);
    cairo_line_to(page.cairo, PdfPage::kWidth - kMargin, page.y);
    cairo_stroke(page.cairo);
  }
  page.y += 0.8 * kLine;
}

void print(PdfPage& page, const Paragraph& p) {
  page.font(kText, false);
  for (const std::string& line : page.wrapped(p.text, kColumn)) {
    page.room(kLine);
    page.put(kMargin, line);
    page.y += kLine;
  }
  page.y += 0.4 * kLine;
}

void print(PdfPage& page, const Table& t) {
  print_table(page, t);
}
void print(PdfPage& page, const Picture& p) {
  print_pictures(page, {&p});
}
void print(PdfPage& page, const SignedLegend& l) {
  print_legend(page, l);
}
void print(PdfPage& page, const Curve& c) {
  print_curve(page, c);
}
void print(PdfPage& page, const Histogram& h) {
  print_histogram(page, h);
}
void print(PdfPage&, const Interactive&) {}

/// A heading is not alone at the foot of a page, nor is what leads to a table or a picture.
void keep_together(PdfPage& page, const Document& document, std::size_t first) {
  double high = 0.0;
  for (std::size_t i = first; i < document.size(); ++i) {
    if (std::holds_alternative<Heading>(document[i])) {
      high += 4.0 * kLine;
    } else if (const auto* p = std::get_if<Paragraph>(&document[i]); p != nullptr) {
      page.font(kText, false);
      high += kLine *
              static_cast<double>(std::min<std::size_t>(6, page.wrapped(p->text, kColumn).size()));
    } else {
      if (const auto* t = std::get_if<Table>(&document[i]); t != nullptr) {
        high += high_of_start(page, *t);
      } else {
        high += 3.0 * kLine;
      }
      break;
    }
  }
  page.room(std::fmin(high, 0.5 * PdfPage::kHeight));
}

void sign(PdfPage& page) {
  page.room(7.0 * kLine);
  page.y += 4.0 * kLine;
  cairo_set_source_rgb(page.cairo, 0.0, 0.0, 0.0);
  cairo_set_line_width(page.cairo, 0.5);
  page.font(kText, false);
  double x = kMargin;
  for (const char* what : {"measured by, date", "checked by, date", "accepted by, date"}) {
    cairo_move_to(page.cairo, x, page.y);
    cairo_line_to(page.cairo, x + 0.3 * kColumn, page.y);
    cairo_stroke(page.cairo);
    page.y += kLine;
    page.put(x, what);
    page.y -= kLine;
    x += 0.35 * kColumn;
  }
}

}  // namespace

Result<void> write_pdf(const Document& document, const std::string& title,
                       const std::filesystem::path& out) {
  const auto draw = [&](cairo_t* cairo) {
    PdfPage page(cairo, title);
    print(page, Heading{1, title});
    for (std::size_t i = 0; i < document.size(); ++i) {
      if (std::holds_alternative<Heading>(document[i]) ||
          std::holds_alternative<Paragraph>(document[i]))
        keep_together(page, document, i);
      const auto* first = std::get_if<Picture>(&document[i]);
      const auto* second =
          i + 1 < document.size() ? std::get_if<Picture>(&document[i + 1]) : nullptr;
      if (first != nullptr && second != nullptr) {
        print_pictures(page, {first, second});
        ++i;
      } else {
        std::visit([&](const auto& block) { print(page, block); }, document[i]);
      }
    }
    sign(page);
  };
  return exporting::write_pdf_file(out, title, PdfPage::kWidth, PdfPage::kHeight, draw);
}

}  // namespace maquette::tools
