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
#include "tools/curve_drawing.hpp"
#include "tools/document.hpp"

namespace maquette::tools {
namespace {

// Points of 1/72 inch.
constexpr double kWidth = 595.28, kHeight = 841.89, kMargin = 48.0, kFoot = 56.0;
constexpr double kText = 8.5, kLine = 11.5, kSmallest = 7.0;
constexpr double kColumn = kWidth - 2.0 * kMargin;

class Sheet {
 public:
  Sheet(cairo_t* cairo, std::string title) : c_(cairo), title_(std::move(title)) { begin(); }

  void operator()(const Heading& h) {
    const double size = h.level <= 1 ? 16.0 : h.level == 2 ? 12.0 : 10.0;
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
    for (const TableLayout& part : layouts_of(t)) {
      const double line = part.size / kText * kLine;
      y_ += 0.4 * kLine;
      room(high_of_start(part));
      if (!part.head.empty()) print_row(part, part.head, true);
      for (const auto& row : part.rows) {
        if (y_ + high_of(row) * line > kHeight - kFoot) {
          next_page();
          if (!part.head.empty()) print_row(part, part.head, true);
        }
        print_row(part, row, false);
      }
      y_ += 0.6 * kLine;
    }
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
    const bool legends =
        std::any_of(row.begin(), row.end(), [](const Picture* p) { return p->legend.has_value(); });
    const double legend_high = legends ? 2.6 * kLine : 0.0;
    room(highest + legend_high + static_cast<double>(lines) * kLine + 2.0 * kLine);
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
      if (row[k]->legend && shown[k].high > 0.0) colour_bar(*row[k]->legend, x, wide);
      y_ = top + highest + legend_high + 0.4 * kLine;
      font(0.9 * kText, false);
      const std::string text =
          shown[k].high > 0.0 ? row[k]->caption : row[k]->png.filename().string() + " is missing";
      for (const std::string& line : wrapped(text, wide)) {
        put(x, line);
        y_ += kLine;
      }
      cairo_surface_destroy(shown[k].image);
    }
    y_ = top + highest + legend_high + static_cast<double>(lines) * kLine + 0.8 * kLine;
  }
  void operator()(const Picture& p) { pictures({&p}); }

  void operator()(const SignedLegend& l) {
    room(4.0 * kLine);
    colour_bar(l, kMargin, 0.6 * kColumn);
  }

  void operator()(const Curve& c) {
    constexpr double kHigh = 120.0, kLabels = 34.0;
    room(kHigh + 4.0 * kLine);
    const CurveLayout layout = layout_of(c);
    const double left = kMargin + kLabels, wide = kColumn - kLabels, top = y_ - kText;
    const auto follow = [&](const CurveLayout::Line& line) {
      for (const auto& [u, v] : line) cairo_line_to(c_, left + wide * u, top + kHigh * (1.0 - v));
    };
    font(0.9 * kText, false);
    cairo_set_line_width(c_, 0.5);
    for (const auto& [at, value] : layout.y_ticks) {
      y_ = top + kHigh * (1.0 - at);
      cairo_set_source_rgb(c_, 0.7, 0.7, 0.7);
      cairo_move_to(c_, left, y_);
      cairo_line_to(c_, left + wide, y_);
      cairo_stroke(c_);
      const std::string text = fmt::format("{:.3g}", value);
      y_ += 0.35 * kText;
      put(left - 4.0 - width(text), text);
    }
    cairo_set_source_rgba(c_, 0.48, 0.61, 0.78, 0.5);
    for (const auto& shade : layout.shades) {
      follow(shade);
      cairo_fill(c_);
    }
    cairo_set_source_rgb(c_, 0.70, 0.09, 0.17);
    cairo_set_line_width(c_, 1.0);
    for (const auto& line : layout.lines) {
      follow(line);
      cairo_stroke(c_);
    }
    y_ = top + kHigh + kLine;
    for (const auto& [at, value] : layout.x_ticks) {
      const std::string text = fmt::format("{:g}", value);
      put(std::fmin(left + wide * at - 0.5 * width(text), kWidth - kMargin - width(text)), text);
    }
    y_ += kLine;
    const std::string under = c.y_label + ", against " + c.x_label;
    put(left + 0.5 * (wide - width(under)), under);
    y_ += 1.6 * kLine;
  }

  /// @param left, wide  of the bar, points
  void colour_bar(const SignedLegend& l, double left, double wide) {
    cairo_pattern_t* colours = cairo_pattern_create_linear(left, 0.0, left + wide, 0);
    cairo_pattern_add_color_stop_rgb(colours, 0.0, 0.13, 0.40, 0.67);
    cairo_pattern_add_color_stop_rgb(colours, 0.5, 0.97, 0.97, 0.97);
    cairo_pattern_add_color_stop_rgb(colours, 1.0, 0.70, 0.09, 0.17);
    cairo_set_source(c_, colours);
    cairo_rectangle(c_, left, y_ - kText, wide, kText);
    cairo_fill(c_);
    cairo_pattern_destroy(colours);
    y_ += kLine;
    scale(l.limit, l.unit, left, wide);
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
    scale(h.limit, h.unit, kMargin, wide);
  }

  void operator()(const Interactive&) {}

  /// A heading is not alone at the foot of a page, nor is what leads to a table or a picture.
  void keep_together(const Document& document, std::size_t first) {
    double high = 0.0;
    for (std::size_t i = first; i < document.size(); ++i) {
      if (std::holds_alternative<Heading>(document[i])) {
        high += 4.0 * kLine;
      } else if (const auto* p = std::get_if<Paragraph>(&document[i]); p != nullptr) {
        font(kText, false);
        high +=
            kLine * static_cast<double>(std::min<std::size_t>(6, wrapped(p->text, kColumn).size()));
      } else {
        if (const auto* t = std::get_if<Table>(&document[i]); t != nullptr) {
          if (const auto parts = layouts_of(*t); !parts.empty()) high += high_of_start(parts[0]);
        } else {
          high += 3.0 * kLine;
        }
        break;
      }
    }
    room(std::fmin(high, 0.5 * kHeight));
  }

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
  using Lines = std::vector<std::vector<std::string>>;  // of each cell of a row
  /// Some columns of a table, broken to their widths.
  struct TableLayout {
    double size = kText;
    std::vector<double> widths;
    std::vector<bool> numbers;  ///< of the rows' cells
    Lines head;
    std::vector<Lines> rows;
  };

  static double high_of(const Lines& row) {
    std::size_t lines = 1;
    for (const auto& cell : row) lines = std::max(lines, cell.size());
    return static_cast<double>(lines);
  }
  /// The head and two rows.
  static double high_of_start(const TableLayout& t) {
    double lines = t.head.empty() ? 0.0 : high_of(t.head);
    for (std::size_t i = 0; i < std::min<std::size_t>(2, t.rows.size()); ++i)
      lines += high_of(t.rows[i]);
    return lines * t.size / kText * kLine;
  }

  /// How wide each column is at most (whole cells) and at least (whole words), at one size of
  /// letters.
  struct Widths {
    std::vector<double> most, least;
    static double sum(const std::vector<double>& w) {
      return std::accumulate(w.begin(), w.end(), 0.0);
    }
  };
  Widths widths_of(const Table& t, std::size_t columns, double size) {
    constexpr double kLongestWord = 0.3 * kColumn;  // longer ones are broken
    Widths w{std::vector<double>(columns, 0.0), std::vector<double>(columns, 0.0)};
    const auto add = [&](std::size_t k, const std::string& text) {
      w.most[k] = std::fmax(w.most[k], width(text));
      for (std::size_t i = 0; i < text.size();) {
        const std::size_t end = std::min(text.find(' ', i), text.size());
        w.least[k] = std::fmax(w.least[k], std::fmin(kLongestWord, width(text.substr(i, end - i))));
        i = end + 1;
      }
    };
    font(size, true);
    for (std::size_t k = 0; k < std::min(columns, t.head.size()); ++k) add(k, t.head[k]);
    font(size, false);
    for (const auto& row : t.rows)
      for (std::size_t k = 0; k < std::min(columns, row.size()); ++k) add(k, row[k].text);
    for (std::size_t k = 0; k < columns; ++k) w.most[k] += size, w.least[k] += size;
    return w;
  }

  /// As wide as its widest cells; where that is too much, smaller letters, then broken lines, then
  /// several tables that begin with the same column.
  std::vector<TableLayout> layouts_of(const Table& t) {
    const std::size_t columns = !t.head.empty()  ? t.head.size()
                                : t.rows.empty() ? 0
                                                 : t.rows.front().size();
    std::vector<TableLayout> parts;
    if (columns == 0) return parts;
    double size = kText;
    Widths w = widths_of(t, columns, size);
    while (Widths::sum(w.most) > kColumn && size > kSmallest)
      w = widths_of(t, columns, size -= 0.5);
    for (std::size_t next = 0; next < columns;) {
      std::vector<std::size_t> chosen;
      double least = 0.0;
      if (next > 0) chosen.push_back(0), least = w.least[0];
      const std::size_t begun = next;
      while (next < columns && (next == begun || least + w.least[next] <= kColumn)) {
        chosen.push_back(next);
        least += w.least[next++];
      }
      parts.push_back(layout(t, w, chosen, size));
    }
    return parts;
  }

  TableLayout layout(const Table& t, const Widths& w, const std::vector<std::size_t>& chosen,
                     double size) {
    TableLayout part;
    part.size = size;
    double least = 0.0, most = 0.0;
    for (const std::size_t k : chosen) least += w.least[k], most += w.most[k];
    // What is left beyond whole words goes to the columns in proportion to what they ask for.
    const double share =
        most > kColumn && most > least ? std::fmax(0.0, kColumn - least) / (most - least) : 1.0;
    for (const std::size_t k : chosen)
      part.widths.push_back(w.least[k] + share * (w.most[k] - w.least[k]));
    font(size, true);
    for (std::size_t i = 0; i < chosen.size() && !t.head.empty(); ++i)
      part.head.push_back(wrapped(t.head[chosen[i]], part.widths[i] - 0.5 * size));
    font(size, false);
    part.numbers.assign(chosen.size(), false);
    for (const auto& row : t.rows) {
      Lines& to = part.rows.emplace_back();
      for (std::size_t i = 0; i < chosen.size(); ++i) {
        if (chosen[i] >= row.size()) {
          to.push_back({""});
          continue;
        }
        to.push_back(wrapped(row[chosen[i]].text, part.widths[i] - 0.5 * size));
        part.numbers[i] = part.numbers[i] || row[chosen[i]].number;
      }
    }
    return part;
  }

  void print_row(const TableLayout& part, const Lines& row, bool head) {
    const double line = part.size / kText * kLine;
    font(part.size, head);
    double x = kMargin;
    const double top = y_;
    for (std::size_t k = 0; k < row.size(); ++k) {
      y_ = top;
      for (const std::string& text : row[k]) {
        put(part.numbers[k] ? x + part.widths[k] - 0.5 * part.size - width(text) : x, text);
        y_ += line;
      }
      x += part.widths[k];
    }
    y_ = top + high_of(row) * line;
    cairo_set_source_rgb(c_, 0.8, 0.8, 0.8);
    cairo_set_line_width(c_, 0.3);
    cairo_move_to(c_, kMargin, y_ - 0.75 * line);
    cairo_line_to(c_, x, y_ - 0.75 * line);
    cairo_stroke(c_);
  }

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
  /// At blanks; a word that is too long is broken.
  [[nodiscard]] std::vector<std::string> wrapped(const std::string& text, double wide) const {
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
  [[nodiscard]] std::string first_of(const std::string& word, double wide) const {
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
  void scale(double limit, const std::string& unit, double left, double wide) {
    font(0.9 * kText, false);
    const double apart = wide < 0.5 * kColumn ? 1.0 : 0.5;  // halves only where there is room
    for (double share = -1.0; share <= 1.0; share += apart) {
      const std::string text = fmt::format("{:+.3g} {}", share * limit, unit);
      const double at = left + 0.5 * (share + 1.0) * wide;
      put(std::clamp(at - 0.5 * width(text), left, left + wide - width(text)), text);
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
      if (std::holds_alternative<Heading>(document[i]) ||
          std::holds_alternative<Paragraph>(document[i]))
        sheet.keep_together(document, i);
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
