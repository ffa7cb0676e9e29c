// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/image_io.hpp"

#include <cmath>
#include <set>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include "camera/detail/metadata_text.hpp"
#include "camera/srgb.hpp"
#include "core/check.hpp"
#include "core/files.hpp"

namespace maquette::camera {
namespace fs = std::filesystem;
namespace {

/// 1 Gpixel is 4 GB a channel; what is larger is a damaged header.
constexpr std::int64_t kMaxPixels = std::int64_t{1} << 30;
constexpr int kRowsAtOnce = 64;
constexpr std::string_view kOurs = "maquette:";

std::string lower_extension(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}
bool is_jpeg(const std::string& extension) {
  return extension == ".jpg" || extension == ".jpeg";
}
bool is_tiff(const std::string& extension) {
  return extension == ".tif" || extension == ".tiff";
}

Result<void> write_file(OIIO::ImageSpec spec, const void* pixels, OIIO::TypeDesc type,
                        const fs::path& path, const Metadata& metadata) {
  const bool jpeg = is_jpeg(lower_extension(path));
  if (jpeg || is_tiff(lower_extension(path))) {
    // OpenImageIO leaves out keys that these formats do not know.
    if (!jpeg && !metadata.empty()) spec.attribute("ImageDescription", detail::text_of(metadata));
  } else {
    for (const auto& [key, value] : metadata) spec.attribute(key, value);
  }
  // OpenImageIO would write the present time: the same job must give the same bytes.
  if (spec.find_attribute("DateTime") == nullptr) spec.attribute("DateTime", "1970:01:01 00:00:00");
  AtomicPath partial(path);
  MAQUETTE_TRY_VOID(partial.prepare());
  const auto because = [&](const std::string& reason) {
    return fail(kFileNotWritable, fmt::format("{}: OpenImageIO: {}; check the file's extension and "
                                              "the free space",
                                              path.string(), reason));
  };
  auto out = OIIO::ImageOutput::create(partial.path().string());
  if (!out) return because(OIIO::geterror());
  // Some of its writers say nothing when the disk is full: the file is made in memory.
  OIIO::Filesystem::IOVecOutput memory;
  if (out->supports("ioproxy") && out->set_ioproxy(&memory)) {
    const bool made = out->open(partial.path().string(), spec) && out->write_image(type, pixels);
    if (!out->close() || !made) return because(out->geterror());
    const auto& bytes = memory.buffer();
    const std::string_view file(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    if (jpeg && !metadata.empty())
      return ::maquette::write_file(path,
                                    detail::with_jpeg_comment(file, detail::text_of(metadata)));
    return ::maquette::write_file(path, file);
  }
  if (!out->open(partial.path().string(), spec)) return because(out->geterror());
  const bool written = out->write_image(type, pixels);
  if (!out->close() || !written) return because(out->geterror());
  return partial.commit();
}

Result<void> check_size(std::ptrdiff_t rows, std::ptrdiff_t cols, const fs::path& path) {
  if (rows < 1 || cols < 1 || rows > kMaxPixels / cols)
    return fail(kImageFormat, fmt::format("{}: an image of {} x {} pixels cannot be written",
                                          path.string(), cols, rows));
  return {};
}

Result<void> check_extension(const fs::path& path, std::string_view expected) {
  if (lower_extension(path) != expected)
    return fail(kImageFormat, fmt::format("{}: the name must end in {}", path.string(), expected));
  return {};
}

template <class Pixel>
Result<void> write_png_grid(const Grid<Pixel>& image, const fs::path& path,
                            const Metadata& metadata) {
  MAQUETTE_TRY_VOID(check_extension(path, ".png"));
  MAQUETTE_TRY_VOID(check_size(image.rows(), image.cols(), path));
  const OIIO::ImageSpec spec(static_cast<int>(image.cols()), static_cast<int>(image.rows()),
                             static_cast<int>(sizeof(Pixel)), OIIO::TypeDesc::UINT8);
  return write_file(spec, image.cells().data(), OIIO::TypeDesc::UINT8, path, metadata);
}

/// What our own writers have put into it.
Metadata metadata_in(const OIIO::ImageSpec& spec, std::string_view format, const fs::path& path) {
  if (format == "jpeg") return detail::metadata_of_text(detail::jpeg_comment(path));
  if (format == "tiff") return detail::metadata_of_text(detail::tiff_description(path));
  Metadata metadata;
  for (const auto& attribute : spec.extra_attribs) {
    const std::string& name = attribute.name().string();
    if (name.starts_with(kOurs) && attribute.type() == OIIO::TypeDesc::STRING)
      metadata.emplace_back(name, attribute.get_string());
  }
  return metadata;
}

/// Has OpenImageIO its reader of cameras' raw files?
bool reads_raw() {
  const std::string formats(OIIO::get_string_attribute("format_list"));
  return ("," + formats + ",").find(",raw,") != std::string::npos;
}

}  // namespace

Result<void> write_exr(const std::vector<std::pair<std::string, const Grid<float>*>>& channels,
                       const fs::path& path, const Metadata& metadata) {
  MAQUETTE_TRY_VOID(check_extension(path, ".exr"));
  if (channels.empty())
    return fail(kImageFormat, fmt::format("{}: an image without a channel", path.string()));
  const Grid<float>& first = *channels.front().second;
  MAQUETTE_TRY_VOID(check_size(first.rows(), first.cols(), path));
  std::set<std::string> names;
  for (const auto& [name, grid] : channels) {
    if (name.empty() || !names.insert(name).second)
      return fail(kImageFormat, fmt::format("{}: channel '{}': every channel needs a name of its "
                                            "own",
                                            path.string(), name));
    if (grid->rows() != first.rows() || grid->cols() != first.cols())
      return fail(kImageFormat,
                  fmt::format("{}: channel {} has {} x {} pixels, channel {} has {} x {}",
                              path.string(), name, grid->cols(), grid->rows(),
                              channels.front().first, first.cols(), first.rows()));
  }

  const auto count = channels.size();
  OIIO::ImageSpec spec(static_cast<int>(first.cols()), static_cast<int>(first.rows()),
                       static_cast<int>(count), OIIO::TypeDesc::FLOAT);
  spec.channelnames.clear();
  for (const auto& channel : channels) spec.channelnames.push_back(channel.first);
  spec.attribute("compression", "zip");
  std::vector<float> pixels(first.cells().size() * count);
  for (std::size_t k = 0; k < count; ++k) {
    const auto cells = channels[k].second->cells();
    for (std::size_t i = 0; i < cells.size(); ++i) pixels[i * count + k] = cells[i];
  }
  return write_file(spec, pixels.data(), OIIO::TypeDesc::FLOAT, path, metadata);
}

Result<void> write_whole_numbers(
    const std::vector<std::pair<std::string, const Grid<float>*>>& channels, double white, int bits,
    const fs::path& path, const Metadata& metadata) {
  const std::string extension = lower_extension(path);
  const bool jpeg = is_jpeg(extension);
  if (!jpeg && extension != ".png" && !is_tiff(extension))
    return fail(kImageFormat,
                fmt::format("{}: the name must end in .png, .tif, .jpg or .exr", path.string()));
  if (jpeg && bits != 8)
    return fail(kImageFormat,
                fmt::format("{}: JPEG has 8 bits only; take .png or .tif", path.string()));
  if (channels.size() != 1 && channels.size() != 3)
    return fail(kImageFormat, fmt::format("{}: {} bands; one or three are possible", path.string(),
                                          channels.size()));
  const Grid<float>& first = *channels.front().second;
  MAQUETTE_TRY_VOID(check_size(first.rows(), first.cols(), path));
  constexpr std::ptrdiff_t kLongestJpeg = 65500;  // beyond it the library ends the program
  if (jpeg && (first.rows() > kLongestJpeg || first.cols() > kLongestJpeg))
    return fail(kImageFormat,
                fmt::format("{}: JPEG has at most {} pixels a side", path.string(), kLongestJpeg));
  const std::size_t count = channels.size();
  std::vector<std::uint16_t> numbers(first.cells().size() * count);
  const double scale = (bits == 8 ? 255.0 : 65535.0) / white;
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t i = 0; i < first.cells().size(); ++i)
      numbers[i * count + k] = static_cast<std::uint16_t>(
          std::clamp(scale * static_cast<double>(channels[k].second->cells()[i]) + 0.5, 0.0,
                     bits == 8 ? 255.0 : 65535.0));
  OIIO::ImageSpec spec(static_cast<int>(first.cols()), static_cast<int>(first.rows()),
                       static_cast<int>(count),
                       bits == 8 ? OIIO::TypeDesc::UINT8 : OIIO::TypeDesc::UINT16);
  if (jpeg) spec.attribute("Compression", "jpeg:95");
  // Runs of filtered bytes only (Z_RLE): photographs are noise, in which there is nothing to search
  // for. A third of the time, nine tenths of the size.
  if (extension == ".png") spec.attribute("compression", "rle");
  if (bits == 16) return write_file(spec, numbers.data(), OIIO::TypeDesc::UINT16, path, metadata);
  std::vector<std::uint8_t> bytes(numbers.size());
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(numbers[i]);
  return write_file(spec, bytes.data(), OIIO::TypeDesc::UINT8, path, metadata);
}

Result<void> write_png(const Grid<std::uint8_t>& grey, const fs::path& path,
                       const Metadata& metadata) {
  return write_png_grid(grey, path, metadata);
}

Result<void> write_png(const Grid<Rgb8>& colour, const fs::path& path, const Metadata& metadata) {
  return write_png_grid(colour, path, metadata);
}

std::string encode_png(const Grid<Rgb8>& colour) {
  OIIO::ImageSpec spec(static_cast<int>(colour.cols()), static_cast<int>(colour.rows()), 3,
                       OIIO::TypeDesc::UINT8);
  spec.attribute("DateTime", "1970:01:01 00:00:00");
  OIIO::Filesystem::IOVecOutput memory;
  const auto out = OIIO::ImageOutput::create("png");
  MAQUETTE_CHECK(out != nullptr, "OpenImageIO writes no PNG: {}", OIIO::geterror());
  out->set_ioproxy(&memory);
  const bool written = out->open("png", spec) &&
                       out->write_image(OIIO::TypeDesc::UINT8, colour.cells().data()) &&
                       out->close();
  MAQUETTE_CHECK(written, "{} x {} pixels: {}", colour.cols(), colour.rows(), out->geterror());
  const auto& bytes = memory.buffer();
  return {bytes.begin(), bytes.end()};
}

std::uint8_t srgb8(double linear) {
  if (!(linear > 0.0)) return 0;
  if (linear >= 1.0) return 255;
  return static_cast<std::uint8_t>(std::lround(255.0 * srgb_of_linear(linear)));
}

const Grid<float>* channel_of(const LoadedImage& image, std::string_view name) {
  for (std::size_t k = 0; k < image.names.size(); ++k)
    if (image.names[k] == name) return &image.channels[k];
  return nullptr;
}

Grid<float>* channel_of(LoadedImage& image, std::string_view name) {
  return const_cast<Grid<float>*>(channel_of(std::as_const(image), name));
}

std::string_view text_in(const Metadata& metadata, std::string_view key) {
  for (const auto& [name, value] : metadata)
    if (name == key) return value;
  return {};
}

namespace {

tl::unexpected<Error> no_image(const std::string& name, const std::string& reason) {
  return fail(kImageNotReadable,
              fmt::format("{}: OpenImageIO: {}; a PNG, TIFF, OpenEXR or raw image was expected",
                          name, reason));
}

/// Without metadata.
Result<LoadedImage> read_opened(OIIO::ImageInput& in, const std::string& name) {
  const OIIO::ImageSpec spec = in.spec();
  if (spec.width < 1 || spec.height < 1 || spec.depth > 1 || spec.deep || spec.nchannels < 1 ||
      std::int64_t{spec.width} * spec.height > kMaxPixels)
    return fail(kImageFormat, fmt::format("{}: {} x {} x {} pixels with {} channels{}: a flat "
                                          "image of at most {} pixels was expected",
                                          name, spec.width, spec.height, spec.depth, spec.nchannels,
                                          spec.deep ? ", deep" : "", kMaxPixels));
  const auto count = static_cast<std::size_t>(spec.nchannels);
  LoadedImage image;
  image.eight_bit = spec.format == OIIO::TypeDesc::UINT8;
  if (!spec.format.is_floating_point())
    image.highest = std::ldexp(1.0, 8 * static_cast<int>(spec.format.size())) - 1.0;
  for (std::size_t k = 0; k < count; ++k) {
    image.names.push_back(spec.channelnames[k]);
    image.channels.emplace_back(spec.height, spec.width);
  }
  // Some rows at a time, so that they are taken apart while they are in the cache; tiles whole.
  const int step = spec.tile_width > 0 ? spec.height : kRowsAtOnce;
  std::vector<float> pixels(static_cast<std::size_t>(std::min(step, spec.height)) *
                            static_cast<std::size_t>(spec.width) * count);
  for (int top = 0; top < spec.height; top += step) {
    const int end = std::min(top + step, spec.height);
    const bool read =
        spec.tile_width > 0
            ? in.read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, pixels.data())
            : in.read_scanlines(0, 0, spec.y + top, spec.y + end, 0, 0, spec.nchannels,
                                OIIO::TypeDesc::FLOAT, pixels.data());
    if (!read) return no_image(name, in.geterror());
    const std::size_t first = static_cast<std::size_t>(top) * static_cast<std::size_t>(spec.width);
    const std::size_t n =
        static_cast<std::size_t>(end - top) * static_cast<std::size_t>(spec.width);
    for (std::size_t k = 0; k < count; ++k) {
      float* to = image.channels[k].cells().data() + first;
      const float* from = pixels.data() + k;
      for (std::size_t i = 0; i < n; ++i) to[i] = from[i * count];
    }
  }
  return image;
}

}  // namespace

Result<LoadedImage> read_image(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored))
    return fail(kFileNotFound, fmt::format("{}: no such file", path.string()));
  OIIO::ImageSpec wish;
  wish.attribute("oiio:UnassociatedAlpha", 1);  // values as in the file, not multiplied by alpha
  // Raw files: light in proportion, white where the sensor ends, whatever the picture shows.
  wish.attribute("raw:ColorSpace", "linear");
  wish.attribute("raw:use_camera_wb", 1);
  wish.attribute("raw:auto_bright", 0);
  wish.attribute("raw:adjust_maximum_thr", 0.0F);
  auto in = OIIO::ImageInput::open(path.string(), &wish);
  if (!in) {
    const std::string reason = OIIO::geterror();
    return no_image(path.string(),
                    reads_raw() ? reason
                                : reason +
                                      " (it was built without libraw: raw files of cameras are "
                                      "not read; convert this to a linear TIFF if it is one)");
  }
  MAQUETTE_TRY(auto image, read_opened(*in, path.string()));
  image.metadata = metadata_in(in->spec(), in->format_name(), path);
  return image;
}

Result<LoadedImage> read_image(std::string_view bytes, const std::string& name) {
  OIIO::ImageSpec wish;
  wish.attribute("oiio:UnassociatedAlpha", 1);
  OIIO::Filesystem::IOMemReader memory(bytes.data(), bytes.size());
  const bool png = bytes.starts_with("\x89PNG");
  if (!png && !bytes.starts_with("\xff\xd8"))
    return fail(kImageFormat, fmt::format("{}: bytes of a PNG or JPEG expected", name));
  auto in = OIIO::ImageInput::open(png ? "picture.png" : "picture.jpg", &wish, &memory);
  if (!in) return no_image(name, OIIO::geterror());
  return read_opened(*in, name);
}

}  // namespace maquette::camera
