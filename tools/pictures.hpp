// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pictures.hpp
/// Pictures for people: small enough for a page, row 0 is the upper row.

#include <span>
#include <string>
#include <vector>

#include "camera/image_io.hpp"
#include "core/grid.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::tools {

/// Shaded relief, averaged down to at most `longest_px`.
[[nodiscard]] Grid<std::uint8_t> hillshade_picture(const heightmap::ModelField& field,
                                                   int longest_px = 1000);

/// Signed values on a field's nodes: blue below, white zero, red above, grey where
/// there is none; full colour at +-limit. Averaged down to at most `longest_px`.
/// @param relief  of the same nodes: its shading lies under the colours, and nothing is as dark as
///                what has no value
[[nodiscard]] Grid<camera::Rgb8> signed_picture(const Grid<float>& values, double limit,
                                                const heightmap::ModelField* relief = nullptr,
                                                int longest_px = 1000);

/// Artefacts (heightmap/artefacts.hpp) over shaded relief: spikes red, boxes orange, seams violet,
/// waves blue; of several kinds in a pixel the first of these. Spikes and boxes are drawn at least
/// three pixels wide.
[[nodiscard]] Grid<camera::Rgb8> artefact_picture(const Grid<std::uint8_t>& artefacts,
                                                  const heightmap::ModelField& relief,
                                                  int longest_px = 1000);

/// Which source is the most exact (source.tif) over shaded relief: a colour each, filled places
/// grey.
[[nodiscard]] Grid<camera::Rgb8> source_picture(const Grid<std::uint8_t>& source,
                                                const heightmap::ModelField& relief,
                                                int longest_px = 1000);

/// Colour of a source in that picture before shading; 255: filled.
[[nodiscard]] camera::Rgb8 source_colour(std::size_t source);

/// The scale of signed_picture as a bar with labels, as SVG.
[[nodiscard]] std::string signed_legend_svg(double limit, const std::string& unit);

/// Bars over [-limit, limit], with the normal curve of the same mean and deviation.
[[nodiscard]] std::string histogram_svg(std::span<const std::uint64_t> bins, double limit,
                                        double mean, double sigma, const std::string& unit);

/// Robust scale for a signed picture: the 98th percentile of the absolute values, at
/// least `least`.
[[nodiscard]] double colour_limit(const Grid<float>& values, double least);

[[nodiscard]] std::string base64(const std::string& data);

}  // namespace maquette::tools
