// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/jpeg.hpp"

#include <algorithm>
#include <cmath>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include "camera/image_io.hpp"

namespace maquette::camera {
namespace {

constexpr std::ptrdiff_t kLongestSide = 65500;  ///< libjpeg's JPEG_MAX_DIMENSION

tl::unexpected<Error> refused(const std::string& reason) {
  return fail(kImageFormat, fmt::format("jpeg: the library says: {}", reason));
}

}  // namespace

Result<void> check(const Jpeg& e, const Shot&) {
  return in_range("jpeg", "quality", e.quality, 1, 100);
}

Result<void> apply(const Jpeg& e, const Shot&, Frame& frame) {
  const std::size_t bands = frame.bands.size();
  const Grid<float>& first = frame.bands.front();
  const std::size_t pixels = first.cells().size();
  // Beyond it the library ends the program.
  if (first.rows() > kLongestSide || first.cols() > kLongestSide)
    return refused(fmt::format("{} x {} pixels; at most {} a side are possible", first.cols(),
                               first.rows(), kLongestSide));
  std::vector<std::uint8_t> bytes(pixels * bands);
  for (std::size_t b = 0; b < bands; ++b)
    for (std::size_t i = 0; i < pixels; ++i)
      bytes[i * bands + b] = static_cast<std::uint8_t>(
          255.0F * std::clamp(frame.bands[b].cells()[i], 0.0F, 1.0F) + 0.5F);
  OIIO::ImageSpec spec(static_cast<int>(first.cols()), static_cast<int>(first.rows()),
                       static_cast<int>(bands), OIIO::TypeDesc::UINT8);
  spec.attribute("Compression", fmt::format("jpeg:{}", e.quality));
  OIIO::Filesystem::IOVecOutput memory;
  const auto out = OIIO::ImageOutput::create("jpeg");
  if (!out || !out->set_ioproxy(&memory)) return refused(OIIO::geterror());
  if (!out->open("memory.jpg", spec) || !out->write_image(OIIO::TypeDesc::UINT8, bytes.data()) ||
      !out->close())
    return refused(out->geterror());
  OIIO::Filesystem::IOMemReader reader(memory.buffer().data(), memory.buffer().size());
  const auto in = OIIO::ImageInput::open("memory.jpg", nullptr, &reader);
  if (!in) return refused(OIIO::geterror());
  if (!in->read_image(0, 0, 0, static_cast<int>(bands), OIIO::TypeDesc::UINT8, bytes.data()))
    return refused(in->geterror());
  for (std::size_t b = 0; b < bands; ++b)
    for (std::size_t i = 0; i < pixels; ++i)
      frame.bands[b].cells()[i] = static_cast<float>(bytes[i * bands + b]) * (1.0F / 255.0F);
  return {};
}

}  // namespace maquette::camera
