// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pdf_plots.hpp
/// What is drawn on a page: pictures with their colour bars, curves, histograms.

#include <vector>

#include "tools/document.hpp"
#include "tools/pdf_page.hpp"

namespace maquette::tools {

/// One, or two side by side.
void print_pictures(PdfPage& page, const std::vector<const Picture*>& row);
void print_legend(PdfPage& page, const SignedLegend& legend);
void print_curve(PdfPage& page, const Curve& curve);
void print_histogram(PdfPage& page, const Histogram& histogram);

}  // namespace maquette::tools
