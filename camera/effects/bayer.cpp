// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/bayer.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace maquette::camera {

std::optional<BayerPattern> bayer_pattern(std::string_view letters) {
  for (const std::string_view known : {"rggb", "bggr", "grbg", "gbrg"}) {
    if (letters != known) continue;
    BayerPattern p;
    for (std::size_t i = 0; i < 4; ++i)
      p.band[i] = letters[i] == 'r' ? 0 : letters[i] == 'g' ? 1 : 2;
    return p;
  }
  return std::nullopt;
}

Result<void> check(const Bayer& e, const Shot&) {
  if (bayer_pattern(e.pattern)) return {};
  return fail(kEffectOutOfRange, fmt::format("bayer.pattern is \"{}\"; rggb, bggr, grbg or gbrg is "
                                             "possible",
                                             e.pattern));
}

void apply(const Bayer& e, const Shot&, Frame& frame) {
  if (frame.bands.size() != 3) return;
  const BayerPattern pattern = *bayer_pattern(e.pattern);
  Grid<float>& mosaic = frame.bands[0];
  tbb::parallel_for(std::ptrdiff_t{0}, mosaic.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t first = 0; first < 2; ++first) {
      const auto band = static_cast<std::size_t>(pattern.at(r, first));
      if (band == 0) continue;
      const auto from = frame.bands[band].row(r);
      const auto to = mosaic.row(r);
      for (auto c = static_cast<std::size_t>(first); c < to.size(); c += 2) to[c] = from[c];
    }
  });
  frame.bands.resize(1);
  frame.mosaic = pattern;
}

}  // namespace maquette::camera
