// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file document.hpp
/// A report as a list of blocks, written as a page for a browser and as a PDF to be printed and
/// signed: both say the same.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "core/result.hpp"

namespace maquette::tools {

/// All text is plain UTF-8.
struct Heading {
  int level = 2;
  std::string text;
};
struct Paragraph {
  std::string text;
};
struct Table {
  struct Cell {
    std::string text;
    bool number = false;  ///< to the right
  };
  std::vector<std::string> head;  ///< may be empty
  std::vector<std::vector<Cell>> rows;
};
/// The colours of signed pictures, blue below, red above.
struct SignedLegend {
  double limit = 1.0;
  std::string unit;
};
struct Picture {
  std::filesystem::path png;
  std::string caption;
  std::optional<SignedLegend> legend = std::nullopt;  ///< between picture and caption
};
/// A curve with what it is known to: y with +- half_width about it. NaN leaves a gap.
struct Curve {
  std::vector<double> x, y, half_width;
  std::string x_label, y_label;
};
/// With the normal distribution of the same mean and standard deviation.
struct Histogram {
  std::vector<std::uint64_t> bins;
  double limit = 1.0, mean = 0.0, sigma = 0.0;
  std::string unit;
};
/// What only a browser can show.
struct Interactive {
  std::string html;
};
using Block =
    std::variant<Heading, Paragraph, Table, Picture, SignedLegend, Histogram, Curve, Interactive>;
using Document = std::vector<Block>;

/// Body of a page; pictures inside.
[[nodiscard]] std::string to_html(const Document& document);

/// A4, self-contained (fonts and pictures inside), page numbers, a place to sign at the end. Same
/// document, same bytes: no date is in the file.
/// @return CORE_FILE_NOT_WRITABLE, CORE_DISK_FULL
[[nodiscard]] Result<void> write_pdf(const Document& document, const std::string& title,
                                     const std::filesystem::path& out);

}  // namespace maquette::tools
