// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/pdf_table.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <vector>

namespace maquette::tools {
namespace {

constexpr double kMargin = PdfPage::kMargin, kText = PdfPage::kText, kLine = PdfPage::kLine;
constexpr double kColumn = PdfPage::kColumn;

using Lines = std::vector<std::vector<std::string>>;  // of each cell of a row
/// Some columns of a table, broken to their widths.
struct TableLayout {
  double size = kText;
  std::vector<double> widths;
  std::vector<bool> numbers;  ///< of the rows' cells
  Lines head;
  std::vector<Lines> rows;
};

double high_of(const Lines& row) {
  std::size_t lines = 1;
  for (const auto& cell : row) lines = std::max(lines, cell.size());
  return static_cast<double>(lines);
}

/// The head and two rows.
double high_of_start(const TableLayout& t) {
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
Widths widths_of(PdfPage& page, const Table& t, std::size_t columns, double size) {
  constexpr double kLongestWord = 0.3 * kColumn;  // longer ones are broken
  Widths w{std::vector<double>(columns, 0.0), std::vector<double>(columns, 0.0)};
  const auto add = [&](std::size_t k, const std::string& text) {
    w.most[k] = std::fmax(w.most[k], page.width(text));
    for (std::size_t i = 0; i < text.size();) {
      const std::size_t end = std::min(text.find(' ', i), text.size());
      w.least[k] =
          std::fmax(w.least[k], std::fmin(kLongestWord, page.width(text.substr(i, end - i))));
      i = end + 1;
    }
  };
  page.font(size, true);
  for (std::size_t k = 0; k < std::min(columns, t.head.size()); ++k) add(k, t.head[k]);
  page.font(size, false);
  for (const auto& row : t.rows)
    for (std::size_t k = 0; k < std::min(columns, row.size()); ++k) add(k, row[k].text);
  for (std::size_t k = 0; k < columns; ++k) w.most[k] += size, w.least[k] += size;
  return w;
}

TableLayout layout(PdfPage& page, const Table& t, const Widths& w,
                   const std::vector<std::size_t>& chosen, double size) {
  TableLayout part;
  part.size = size;
  double least = 0.0, most = 0.0;
  for (const std::size_t k : chosen) least += w.least[k], most += w.most[k];
  // What is left beyond whole words goes to the columns in proportion to what they ask for.
  const double share =
      most > kColumn && most > least ? std::fmax(0.0, kColumn - least) / (most - least) : 1.0;
  for (const std::size_t k : chosen)
    part.widths.push_back(w.least[k] + share * (w.most[k] - w.least[k]));
  page.font(size, true);
  for (std::size_t i = 0; i < chosen.size() && !t.head.empty(); ++i)
    part.head.push_back(page.wrapped(t.head[chosen[i]], part.widths[i] - 0.5 * size));
  page.font(size, false);
  part.numbers.assign(chosen.size(), false);
  for (const auto& row : t.rows) {
    Lines& to = part.rows.emplace_back();
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      if (chosen[i] >= row.size()) {
        to.push_back({""});
        continue;
      }
      to.push_back(page.wrapped(row[chosen[i]].text, part.widths[i] - 0.5 * size));
      part.numbers[i] = part.numbers[i] || row[chosen[i]].number;
    }
  }
  return part;
}

/// As wide as its widest cells; where that is too much, smaller letters, then broken lines, then
/// several tables that begin with the same column.
std::vector<TableLayout> layouts_of(PdfPage& page, const Table& t) {
  const std::size_t columns = !t.head.empty()  ? t.head.size()
                              : t.rows.empty() ? 0
                                               : t.rows.front().size();
  std::vector<TableLayout> parts;
  if (columns == 0) return parts;
  double size = kText;
  Widths w = widths_of(page, t, columns, size);
  while (Widths::sum(w.most) > kColumn && size > PdfPage::kSmallest)
    w = widths_of(page, t, columns, size -= 0.5);
  for (std::size_t next = 0; next < columns;) {
    std::vector<std::size_t> chosen;
    double least = 0.0;
    if (next > 0) chosen.push_back(0), least = w.least[0];
    const std::size_t begun = next;
    while (next < columns && (next == begun || least + w.least[next] <= kColumn)) {
      chosen.push_back(next);
      least += w.least[next++];
    }
    parts.push_back(layout(page, t, w, chosen, size));
  }
  return parts;
}

void print_row(PdfPage& page, const TableLayout& part, const Lines& row, bool head) {
  const double line = part.size / kText * kLine;
  page.font(part.size, head);
  double x = kMargin;
  const double top = page.y;
  for (std::size_t k = 0; k < row.size(); ++k) {
    page.y = top;
    for (const std::string& text : row[k]) {
      page.put(part.numbers[k] ? x + part.widths[k] - 0.5 * part.size - page.width(text) : x, text);
      page.y += line;
    }
    x += part.widths[k];
  }
  page.y = top + high_of(row) * line;
  cairo_set_source_rgb(page.cairo, 0.8, 0.8, 0.8);
  cairo_set_line_width(page.cairo, 0.3);
  cairo_move_to(page.cairo, kMargin, page.y - 0.75 * line);
  cairo_line_to(page.cairo, x, page.y - 0.75 * line);
  cairo_stroke(page.cairo);
}

}  // namespace

void print_table(PdfPage& page, const Table& t) {
  for (const TableLayout& part : layouts_of(page, t)) {
    const double line = part.size / kText * kLine;
    page.y += 0.4 * kLine;
    page.room(high_of_start(part));
    if (!part.head.empty()) print_row(page, part, part.head, true);
    for (const auto& row : part.rows) {
      if (page.y + high_of(row) * line > PdfPage::kHeight - PdfPage::kFoot) {
        page.next_page();
        if (!part.head.empty()) print_row(page, part, part.head, true);
      }
      print_row(page, part, row, false);
    }
    page.y += 0.6 * kLine;
  }
}

double high_of_start(PdfPage& page, const Table& t) {
  const auto parts = layouts_of(page, t);
  return parts.empty() ? 0.0 : high_of_start(parts[0]);
}

}  // namespace maquette::tools
