// SPDX-License-Identifier: GPL-3.0-or-later

// Cairo (1.16) sets text and pictures on pages; it puts subsets of the fonts into the file.

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <numeric>

#include <cairo-pdf.h>
#include <fmt/format.h>

#include "core/check.hpp"
#include "core/files.hpp"
#include "tools/document.hpp"

namespace maquette::tools {
namespace {

// Points of 1/72 inch.
constexpr double kWidth = 595.28, kHeight = 841.89, kMargin = 48.0, kFoot = 56.0;
constexpr double kText = 8.5, kLine = 11.5, kSmallest = 5.5;
constexpr double kColumn = kWidth - 2.0 * kMargin;

class Sheet {
 public:
  Sheet(cairo_t* cairo, std::string title) : c_(cairo), title_(std::move(title)) { begin(); }

  void operator()(const Heading& h) {
    const double size = h.level <= 1 ? 16.0 : h.level == 2 ? 12.0 : 10.0;
    room(4.0 * size + 3.0 * kLine);  // not alone at the foot of a page
    y_ += 0.9 * size;
    font(size, true);
    put(kMargin, h.text);
    y_ += 0.4 * size;
    if (h.level == 2) {
      cairo_set_source_rgb(c_, 0.6, 0.6, 0.6);
      cairo_set_line_width(c_, 0.5);
      cairo_move_to(c_, kMargin, y_);
      cairo_line_to(c_, kWidth - kMargin, y_);
      cairo_stroke(c_);
    }
    y_ += 0.8 * kLine;
  }

  void operator()(const Paragraph& p) {
    font(kText, false);
    for (const std::string& line : wrapped(p.text, kColumn)) {
      room(kLine);
      put(kMargin, line);
      y_ += kLine;
    }
    y_ += 0.4 * kLine;
  }

  void operator()(const Table& t) {
    const std::size_t columns = !t.head.empty()  ? t.head.size()
                                : t.rows.empty() ? 0
                                                 : t.rows.front().size();
    if (columns == 0) return;
    // As wide as its widest cell; where that is too much, smaller letters, then broken lines.
    double size = kText;
    std::vector<double> widths;
    const auto measure = [&] {
      widths.assign(columns, 0.0);
      font(size, true);
      for (std::size_t k = 0; k < t.head.size(); ++k) widths[k] = width(t.head[k]);
      font(size, false);
      for (const auto& row : t.rows)
        for (std::size_t k = 0; k < std::min(columns, row.size()); ++k)
          widths[k] = std::fmax(widths[k], width(row[k].text));
      for (double& w : widths) w += size;
      return std::accumulate(widths.begin(), widths.end(), 0.0);
    };
    while (measure() > kColumn && size > kSmallest) size -= 0.5;
    while (std::accumulate(widths.begin(), widths.end(), 0.0) > kColumn)
      *std::max_element(widths.begin(), widths.end()) *= 0.95;
    const double line = size / kText * kLine;
    const auto print_row = [&](const std::vector<Table::Cell>& row, bool bold) {
      font(size, bold);
      std::vector<std::vector<std::string>> cells;
      std::size_t lines = 1;
      for (std::size_t k = 0; k < std::min(columns, row.size()); ++k) {
        cells.push_back(wrapped(row[k].text, widths[k] - 0.5 * size));
        lines = std::max(lines, cells.back().size());
      }
      const double high = static_cast<double>(lines) * line;
      if (y_ + high > kHeight - kFoot) {
        next_page();
        if (!bold && !t.head.empty()) return false;  // the head first
        font(size, bold);
      }
      double x = kMargin;
      const double top = y_;
      for (std::size_t k = 0; k < cells.size(); ++k) {
        y_ = top;
        for (const std::string& text : cells[k]) {
          put(row[k].number ? x + widths[k] - 0.5 * size - width(text) : x, text);
          y_ += line;
        }
        x += widths[k];
      }
      y_ = top + high;
      cairo_set_source_rgb(c_, 0.8, 0.8, 0.8);
      cairo_set_line_width(c_, 0.3);
      cairo_move_to(c_, kMargin, y_ - 0.75 * line);
      cairo_line_to(c_, x, y_ - 0.75 * line);
      cairo_stroke(c_);
      return true;
    };
    std::vector<Table::Cell> head;
    for (const std::string& text : t.head) head.push_back({text, false});
    y_ += 0.4 * kLine;
    if (!head.empty()) print_row(head, true);
    for (const auto& row : t.rows)
      if (!print_row(row, false)) {
        print_row(head, true);
        print_row(row, false);
      }
    y_ += 0.6 * kLine;
  }

  /// Two side by side.
  void pictures(const std::vector<const Picture*>& row) {
    constexpr double kGap = 14.0;
    const double wide = 0.5 * (kColumn - kGap);
    struct Shown {
      cairo_surface_t* image;
      double high;
    };
    std::vector<Shown> shown;
    double highest = 0.0;
    font(0.9 * kText, false);
    std::size_t lines = 0;
    for (const Picture* p : row) {
      cairo_surface_t* image = cairo_image_surface_create_from_png(p->png.c_str());
      const bool good = cairo_surface_status(image) == CAIRO_STATUS_SUCCESS;
      const double high = good
                              ? std::fmin(1.4 * wide, wide * cairo_image_surface_get_height(image) /
                                                          cairo_image_surface_get_width(image))
                              : 0.0;
      shown.push_back({image, high});
      highest = std::fmax(highest, high);
      lines = std::max(lines, wrapped(p->caption, wide).size());
    }
    room(highest + static_cast<double>(lines) * kLine + 2.0 * kLine);
    const double top = y_ + 0.6 * kLine;
    double x = kMargin;
    for (std::size_t k = 0; k < row.size(); ++k, x += wide + kGap) {
      y_ = top;
      if (shown[k].high > 0.0) {
        const double scale =
            std::fmin(wide / cairo_image_surface_get_width(shown[k].image),
                      shown[k].high / cairo_image_surface_get_height(shown[k].image));
        cairo_save(c_);
        cairo_translate(c_, x, top - kText);
        cairo_scale(c_, scale, scale);
        cairo_set_source_surface(c_, shown[k].image, 0.0, 0.0);
        cairo_paint(c_);
        cairo_restore(c_);
      }
      y_ = top + highest + 0.4 * kLine;
      font(0.9 * kText, false);
      const std::string text =
          shown[k].high > 0.0 ? row[k]->caption : row[k]->png.filename().string() + " is missing";
      for (const std::string& line : wrapped(text, wide)) {
        put(x, line);
        y_ += kLine;
      }
      cairo_surface_destroy(shown[k].image);
    }
    y_ = top + highest + static_cast<double>(lines) * kLine + 0.8 * kLine;
  }
  void operator()(const Picture& p) { pictures({&p}); }

  void operator()(const SignedLegend& l) {
    room(4.0 * kLine);
    cairo_pattern_t* colours =
        cairo_pattern_create_linear(kMargin, 0.0, kMargin + 0.6 * kColumn, 0);
    cairo_pattern_add_color_stop_rgb(colours, 0.0, 0.13, 0.40, 0.67);
    cairo_pattern_add_color_stop_rgb(colours, 0.5, 0.97, 0.97, 0.97);
    cairo_pattern_add_color_stop_rgb(colours, 1.0, 0.70, 0.09, 0.17);
    cairo_set_source(c_, colours);
    cairo_rectangle(c_, kMargin, y_ - kText, 0.6 * kColumn, kText);
    cairo_fill(c_);
    cairo_pattern_destroy(colours);
    y_ += kLine;
    scale(l.limit, l.unit, 0.6 * kColumn);
  }

  void operator()(const Histogram& h) {
    if (h.bins.empty()) return;
    constexpr double kHigh = 130.0;
    room(kHigh + 3.0 * kLine);
    const double wide = kColumn, top = y_ - kText;
    const double most =
        std::fmax(1.0, static_cast<double>(*std::max_element(h.bins.begin(), h.bins.end())));
    const double bar = wide / static_cast<double>(h.bins.size());
    cairo_set_source_rgb(c_, 0.48, 0.61, 0.78);
    double total = 0.0;
    for (std::size_t i = 0; i < h.bins.size(); ++i) {
      const double high = kHigh * static_cast<double>(h.bins[i]) / most;
      total += static_cast<double>(h.bins[i]);
      cairo_rectangle(c_, kMargin + bar * static_cast<double>(i), top + kHigh - high, bar, high);
    }
    cairo_fill(c_);
    if (h.sigma > 0.0) {
      cairo_set_source_rgb(c_, 0.70, 0.09, 0.17);
      cairo_set_line_width(c_, 1.0);
      const double bin = 2.0 * h.limit / static_cast<double>(h.bins.size());
      for (int i = 0; i <= 200; ++i) {
        const double v = h.limit * (i / 100.0 - 1.0), z = (v - h.mean) / h.sigma;
        const double count =
            std::exp(-0.5 * z * z) / (h.sigma * std::sqrt(2.0 * std::numbers::pi)) * total * bin;
        cairo_line_to(c_, kMargin + wide * i / 200.0,
                      top + kHigh * (1.0 - std::fmin(1.0, count / most)));
      }
      cairo_stroke(c_);
    }
    y_ = top + kHigh + kLine;
    scale(h.limit, h.unit, wide);
  }

  void operator()(const Interactive&) {}

  void sign() {
    room(7.0 * kLine);
    y_ += 4.0 * kLine;
    cairo_set_source_rgb(c_, 0.0, 0.0, 0.0);
    cairo_set_line_width(c_, 0.5);
    font(kText, false);
    double x = kMargin;
    for (const char* what : {"measured by, date", "checked by, date", "accepted by, date"}) {
      cairo_move_to(c_, x, y_);
      cairo_line_to(c_, x + 0.3 * kColumn, y_);
      cairo_stroke(c_);
      y_ += kLine;
      put(x, what);
      y_ -= kLine;
      x += 0.35 * kColumn;
    }
  }

 private:
  void begin() {
    ++page_;
    y_ = kMargin + kText;
    font(7.0, false);
    const double keep = y_;
    y_ = kHeight - 30.0;
    put(kMargin, title_);
    const std::string number = fmt::format("{}", page_);
    put(kWidth - kMargin - width(number), number);
    y_ = keep;
  }
  void next_page() {
    cairo_show_page(c_);
    begin();
  }
  void room(double high) {
    if (y_ + high > kHeight - kFoot && y_ > kMargin + 2.0 * kLine) next_page();
  }
  void font(double size, bool bold) {
    cairo_select_font_face(c_, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                           bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(c_, size);
  }
  [[nodiscard]] double width(const std::string& text) const {
    cairo_text_extents_t extents;
    cairo_text_extents(c_, text.c_str(), &extents);
    return extents.x_advance;
  }
  void put(double x, const std::string& text) {
    cairo_set_source_rgb(c_, 0.0, 0.0, 0.0);
    cairo_move_to(c_, x, y_);
    cairo_show_text(c_, text.c_str());
  }
  /// At blanks; a word that is too long stays whole.
  [[nodiscard]] std::vector<std::string> wrapped(const std::string& text, double wide) const {
    std::vector<std::string> lines{""};
    for (std::size_t i = 0; i < text.size();) {
      const std::size_t end = std::min(text.find(' ', i), text.size());
      const std::string word = text.substr(i, end - i);
      const std::string longer = lines.back().empty() ? word : lines.back() + " " + word;
      if (!lines.back().empty() && width(longer) > wide)
        lines.push_back(word);
      else
        lines.back() = longer;
      i = end + 1;
    }
    return lines;
  }
  void scale(double limit, const std::string& unit, double wide) {
    font(0.9 * kText, false);
    for (const double share : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
      const std::string text = fmt::format("{:+.3g} {}", share * limit, unit);
      const double at = kMargin + 0.5 * (share + 1.0) * wide;
      put(std::clamp(at - 0.5 * width(text), kMargin, kWidth - kMargin - width(text)), text);
    }
    y_ += 1.6 * kLine;
  }

  cairo_t* c_;
  std::string title_;
  double y_ = 0.0;
  int page_ = 0;
};

cairo_status_t append_bytes(void* to, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(to)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

}  // namespace

Result<void> write_pdf(const Document& document, const std::string& title,
                       const std::filesystem::path& out) {
  std::string bytes;
  const auto drop = [](cairo_surface_t* surface) { cairo_surface_destroy(surface); };
  const std::unique_ptr<cairo_surface_t, decltype(drop)> surface(
      cairo_pdf_surface_create_for_stream(append_bytes, &bytes, kWidth, kHeight), drop);
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_TITLE, title.c_str());
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_CREATE_DATE, "");
  cairo_t* cairo = cairo_create(surface.get());
  {
    Sheet sheet(cairo, title);
    sheet(Heading{1, title});
    for (std::size_t i = 0; i < document.size(); ++i) {
      const auto* first = std::get_if<Picture>(&document[i]);
      const auto* second =
          i + 1 < document.size() ? std::get_if<Picture>(&document[i + 1]) : nullptr;
      if (first != nullptr && second != nullptr) {
        sheet.pictures({first, second});
        ++i;
      } else {
        std::visit([&](const auto& block) { sheet(block); }, document[i]);
      }
    }
    sheet.sign();
  }
  cairo_destroy(cairo);
  cairo_surface_finish(surface.get());
  MAQUETTE_CHECK(cairo_surface_status(surface.get()) == CAIRO_STATUS_SUCCESS, "cairo: {}",
                 cairo_status_to_string(cairo_surface_status(surface.get())));
  return write_file(out, bytes);
}

}  // namespace maquette::tools
