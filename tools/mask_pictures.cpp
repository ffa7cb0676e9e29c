// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "heightmap/artefacts.hpp"
#include "tools/pictures.hpp"

namespace maquette::tools {
namespace {

using camera::Rgb8;

/// Okabe and Ito's colours, told apart with any colour vision.
constexpr std::array<Rgb8, 6> kColours{
    {{230, 159, 0}, {86, 180, 233}, {0, 158, 115}, {240, 228, 66}, {0, 114, 178}, {204, 121, 167}}};
constexpr Rgb8 kRed{213, 0, 40}, kOrange{230, 159, 0}, kViolet{170, 60, 200}, kBlue{0, 114, 178};
constexpr Rgb8 kGrey{90, 90, 90};

Rgb8 shaded(const Rgb8& colour, std::uint8_t shade) {
  constexpr double kDarkest = 0.5;
  Rgb8 out{};
  for (std::size_t i = 0; i < 3; ++i)
    out[i] = static_cast<std::uint8_t>(
        std::lround(colour[i] * (kDarkest + (1.0 - kDarkest) * shade / 255.0)));
  return out;
}

std::ptrdiff_t step_of(std::ptrdiff_t rows, std::ptrdiff_t cols, int longest_px) {
  const std::ptrdiff_t longest = std::max(rows, cols);
  return std::max<std::ptrdiff_t>(1, (longest + longest_px - 1) / longest_px);
}

Grid<Rgb8> grey_relief(const heightmap::ModelField& relief, int longest_px) {
  const Grid<std::uint8_t> shade = hillshade_picture(relief, longest_px);
  Grid<Rgb8> out(shade.rows(), shade.cols());
  for (std::size_t i = 0; i < shade.cells().size(); ++i)
    out.cells()[i] = {shade.cells()[i], shade.cells()[i], shade.cells()[i]};
  return out;
}

}  // namespace

Rgb8 source_colour(std::size_t source) {
  return source == 255 ? kGrey : kColours[source % kColours.size()];
}

Grid<Rgb8> artefact_picture(const Grid<std::uint8_t>& artefacts,
                            const heightmap::ModelField& relief, int longest_px) {
  Grid<Rgb8> picture = grey_relief(relief, longest_px);
  const std::ptrdiff_t step = step_of(artefacts.rows(), artefacts.cols(), longest_px);
  // The rarest last, so that it is not hidden.
  for (const auto& [bit, colour, wide] : {std::tuple{heightmap::kWaves, kBlue, 0},
                                          {heightmap::kSeam, kViolet, 0},
                                          {heightmap::kBox, kOrange, 1},
                                          {heightmap::kSpike, kRed, 1}})
    for (std::ptrdiff_t r = 0; r < artefacts.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < artefacts.cols(); ++c) {
        if ((artefacts(r, c) & bit) == 0) continue;
        const std::ptrdiff_t y = picture.rows() - 1 - r / step, x = c / step;
        for (std::ptrdiff_t i = y - wide; i <= y + wide; ++i)
          for (std::ptrdiff_t j = x - wide; j <= x + wide; ++j)
            if (picture.contains(i, j)) {
              Rgb8& p = picture(i, j);
              // Relief shows through what covers much.
              for (std::size_t k = 0; k < 3; ++k)
                p[k] = wide > 0 ? colour[k] : static_cast<std::uint8_t>((p[k] + 2 * colour[k]) / 3);
            }
      }
  return picture;
}

Grid<Rgb8> source_picture(const Grid<std::uint8_t>& source, const heightmap::ModelField& relief,
                          int longest_px) {
  const Grid<std::uint8_t> shade = hillshade_picture(relief, longest_px);
  const std::ptrdiff_t step = step_of(source.rows(), source.cols(), longest_px);
  Grid<Rgb8> picture(shade.rows(), shade.cols());
  for (std::ptrdiff_t r = 0; r < picture.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < picture.cols(); ++c) {
      const std::uint8_t which = source((picture.rows() - 1 - r) * step, c * step);
      picture(r, c) = shaded(source_colour(which), shade(r, c));
    }
  return picture;
}

}  // namespace maquette::tools
