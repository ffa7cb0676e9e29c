// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/view_picture.hpp"

#include <algorithm>
#include <cmath>

#include "camera/image_io.hpp"
#include "camera/srgb.hpp"

namespace maquette::tools {

Result<std::string> picture_png(const std::filesystem::path& file, bool linear, int most_px) {
  MAQUETTE_TRY(const auto image, camera::read_image(file));
  const auto channel = [&](const char* name) -> const Grid<float>* {
    const auto at = std::find(image.names.begin(), image.names.end(), name);
    return at == image.names.end()
               ? nullptr
               : &image.channels[static_cast<std::size_t>(at - image.names.begin())];
  };
  std::array<const Grid<float>*, 3> rgb{channel("R"), channel("G"), channel("B")};
  if (std::find(rgb.begin(), rgb.end(), nullptr) != rgb.end()) {
    const Grid<float>* grey = channel("Y");
    rgb.fill(grey != nullptr ? grey : &image.channels.front());
  }
  const std::ptrdiff_t rows = rgb[0]->rows(), cols = rgb[0]->cols(),
                       step = (std::max(rows, cols) - 1) / most_px + 1;
  Grid<camera::Rgb8> out((rows + step - 1) / step, (cols + step - 1) / step);
  for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c)
      for (std::size_t k = 0; k < 3; ++k) {
        double sum = 0.0, n = 0.0;  // light is averaged, not its code
        for (std::ptrdiff_t y = r * step; y < std::min(rows, (r + 1) * step); ++y)
          for (std::ptrdiff_t x = c * step; x < std::min(cols, (c + 1) * step); ++x) {
            const auto v = static_cast<double>((*rgb[k])(y, x));
            if (!std::isfinite(v)) continue;
            sum += linear ? v : static_cast<double>(camera::linear_of_srgb(static_cast<float>(v)));
            n += 1.0;
          }
        out(r, c)[k] = camera::srgb8(n > 0.0 ? sum / n : 0.0);
      }
  return camera::encode_png(out);
}

}  // namespace maquette::tools
