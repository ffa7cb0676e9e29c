// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pdf_page.hpp
/// The sheet that a document is printed on: where the next line stands, letters, broken lines, page
/// breaks. Lengths are points of 1/72 inch, y is down.

#include <string>
#include <vector>

#include <cairo.h>

namespace maquette::tools {

class PdfPage {
 public:
  static constexpr double kWidth = 595.28, kHeight = 841.89, kMargin = 48.0, kFoot = 56.0;  // A4
  static constexpr double kText = 8.5, kLine = 11.5, kSmallest = 7.0;  ///< letters, lines
  static constexpr double kColumn = kWidth - 2.0 * kMargin;

  /// @param on     stays the caller's
  /// @param title  at the foot of each page
  PdfPage(cairo_t* on, std::string title);

  cairo_t* cairo;
  double y = 0.0;  ///< foot of the next line's letters

  void next_page();
  /// A new page unless there is so much room.
  void room(double high);
  void font(double size, bool bold);
  [[nodiscard]] double width(const std::string& text) const;
  /// Black letters from x on.
  void put(double x, const std::string& text);
  /// At blanks; a word that is too long is broken.
  [[nodiscard]] std::vector<std::string> wrapped(const std::string& text, double wide) const;

 private:
  void begin();
  [[nodiscard]] std::string first_of(const std::string& word, double wide) const;

  std::string title_;
  int page_ = 0;
};

}  // namespace maquette::tools
