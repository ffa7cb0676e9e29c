// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_sheet.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <new>

#include <cairo.h>
#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "camera/srgb.hpp"
#include "core/check.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

using camera::Rgb8;

constexpr double kMostPixels = 268'435'456.0;
constexpr std::uint8_t kPaper = 255;
/// Height of a caption's strip and of its letters, as shares of a picture's width; letters below
/// the least are not read.
constexpr double kStrip = 0.075, kLetters = 0.05, kLeastStripPx = 18.0, kLeastLettersPx = 11.0;

/// R, G, B, or three times the one band there is.
std::array<const Grid<float>*, 3> colours_of(const camera::LoadedImage& image) {
  std::array<const Grid<float>*, 3> bands{camera::channel_of(image, "R"),
                                          camera::channel_of(image, "G"),
                                          camera::channel_of(image, "B")};
  if (std::find(bands.begin(), bands.end(), nullptr) == bands.end()) return bands;
  const Grid<float>* y = camera::channel_of(image, "Y");
  bands.fill(y != nullptr ? y : &image.channels[0]);
  return bands;
}

/// What each new pixel covers of the old ones along one side: first one and weights.
struct Cover {
  std::ptrdiff_t first = 0;
  std::vector<double> weight;
};
std::vector<Cover> covers(std::ptrdiff_t from, std::ptrdiff_t to) {
  std::vector<Cover> all(static_cast<std::size_t>(to));
  const double step = static_cast<double>(from) / static_cast<double>(to);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double begin = step * static_cast<double>(i), end = begin + step;
    all[i].first = std::min(static_cast<std::ptrdiff_t>(begin), from - 1);
    for (auto k = all[i].first; k < from; ++k) {
      const double share =
          std::min(end, static_cast<double>(k + 1)) - std::max(begin, static_cast<double>(k));
      if (share <= 0.0) break;
      all[i].weight.push_back(share / step);
    }
  }
  return all;
}

/// Mean light of what each pixel covers, for a screen.
Grid<Rgb8> shrunk(const camera::LoadedImage& image, int width_px, double exposure) {
  const auto bands = colours_of(image);
  const std::ptrdiff_t rows = bands[0]->rows(), cols = bands[0]->cols();
  const auto high = std::max<std::ptrdiff_t>(
      1, std::llround(static_cast<double>(rows) * width_px / static_cast<double>(cols)));
  const bool linear = image.highest == 0.0;
  const auto across = covers(cols, width_px), down = covers(rows, high);
  Grid<Rgb8> small(high, width_px);
  tbb::parallel_for(std::ptrdiff_t{0}, high, [&](std::ptrdiff_t r) {
    const Cover& y = down[static_cast<std::size_t>(r)];
    for (std::size_t c = 0; c < across.size(); ++c) {
      const Cover& x = across[c];
      for (std::size_t b = 0; b < 3; ++b) {
        double sum = 0.0;
        for (std::size_t i = 0; i < y.weight.size(); ++i)
          for (std::size_t j = 0; j < x.weight.size(); ++j) {
            const auto v =
                static_cast<double>((*bands[b])(y.first + static_cast<std::ptrdiff_t>(i),
                                                x.first + static_cast<std::ptrdiff_t>(j)));
            sum += y.weight[i] * x.weight[j] *
                   (linear ? (std::isfinite(v) ? exposure * v : 0.0) : camera::linear_of_srgb(v));
          }
        small(r, static_cast<std::ptrdiff_t>(c))[b] = camera::srgb8(sum);
      }
    }
  });
  return small;
}

/// Draws a caption into the middle of a strip; letters become smaller where it is too long.
class Writer {
 public:
  Writer(int width_px, int strip_px)
      : surface_(cairo_image_surface_create(CAIRO_FORMAT_RGB24, width_px, strip_px)),
        cairo_(cairo_create(surface_)),
        width_(width_px),
        strip_(strip_px) {
    if (cairo_status(cairo_) != CAIRO_STATUS_SUCCESS) throw std::bad_alloc();
    cairo_select_font_face(cairo_, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() {
    cairo_destroy(cairo_);
    cairo_surface_destroy(surface_);
  }

  void write(const std::string& text, Grid<Rgb8>& to, std::ptrdiff_t row, std::ptrdiff_t col) {
    cairo_set_source_rgb(cairo_, 1.0, 1.0, 1.0);
    cairo_paint(cairo_);
    cairo_set_source_rgb(cairo_, 0.1, 0.1, 0.1);
    double letters = std::max(kLeastLettersPx, kLetters * width_);
    cairo_text_extents_t size;
    cairo_set_font_size(cairo_, letters);
    cairo_text_extents(cairo_, text.c_str(), &size);
    if (const double room = 0.96 * width_; size.x_advance > room) {
      letters *= room / size.x_advance;
      cairo_set_font_size(cairo_, letters);
      cairo_text_extents(cairo_, text.c_str(), &size);
    }
    cairo_move_to(cairo_, 0.5 * (width_ - size.x_advance), 0.5 * (strip_ + 0.7 * letters));
    cairo_show_text(cairo_, text.c_str());
    cairo_surface_flush(surface_);
    const unsigned char* data = cairo_image_surface_get_data(surface_);
    const int stride = cairo_image_surface_get_stride(surface_);
    for (int r = 0; r < strip_; ++r)
      for (int c = 0; c < width_; ++c) {
        std::uint32_t pixel = 0;
        std::memcpy(&pixel, data + std::ptrdiff_t{r} * stride + std::ptrdiff_t{4} * c, 4);
        to(row + r, col + c) = {static_cast<std::uint8_t>(pixel >> 16U),
                                static_cast<std::uint8_t>(pixel >> 8U),
                                static_cast<std::uint8_t>(pixel)};
      }
  }

 private:
  cairo_surface_t* surface_;
  cairo_t* cairo_;
  int width_, strip_;
};

}  // namespace

Result<JobResult> sheet_job(const SheetJob& job, const fs::path& out, const RunContext& run) {
  const std::size_t count = job.pictures.size();
  MAQUETTE_CHECK(count > 0 && job.width_px > 0, "{} pictures of {} pixels", count, job.width_px);
  MAQUETTE_CHECK(job.captions.empty() || job.captions.size() == count,
                 "{} captions for {} pictures", job.captions.size(), count);
  const auto columns =
      job.columns > 0 ? std::min<std::size_t>(static_cast<std::size_t>(job.columns), count)
                      : static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(count))));
  std::vector<Grid<Rgb8>> small;
  double pixels = 0.0;
  for (const fs::path& picture : job.pictures) {
    if (run.stopped()) return fail(kCancelled, "stopped between two pictures of a sheet");
    MAQUETTE_TRY(const auto image, camera::read_image(picture));
    pixels += static_cast<double>(image.channels[0].rows()) * job.width_px /
              static_cast<double>(image.channels[0].cols()) * job.width_px;
    if (pixels > kMostPixels)
      return fail(camera::kImageFormat,
                  fmt::format("a sheet of {} pictures, each {} pixels wide, is too large", count,
                              job.width_px));
    small.push_back(shrunk(image, job.width_px, job.exposure));
    run.progress(static_cast<double>(small.size()) / static_cast<double>(count));
  }
  const auto gap = std::max<std::ptrdiff_t>(2, job.width_px / 40);
  const auto strip = static_cast<int>(std::max(kLeastStripPx, kStrip * job.width_px));
  const auto wide = static_cast<std::ptrdiff_t>(columns) * (job.width_px + gap) + gap;
  std::ptrdiff_t high = gap;
  std::vector<std::ptrdiff_t> top;
  for (std::size_t i = 0; i < count; i += columns) {
    top.push_back(high);
    std::ptrdiff_t highest = 0;
    for (std::size_t k = i; k < std::min(count, i + columns); ++k)
      highest = std::max(highest, small[k].rows());
    high += highest + strip + gap;
  }
  Grid<Rgb8> sheet(high, wide, Rgb8{kPaper, kPaper, kPaper});
  Writer writer(job.width_px, strip);
  for (std::size_t i = 0; i < count; ++i) {
    const Grid<Rgb8>& picture = small[i];
    const std::ptrdiff_t row = top[i / columns];
    const std::ptrdiff_t col =
        gap + static_cast<std::ptrdiff_t>(i % columns) * (job.width_px + gap);
    for (std::ptrdiff_t r = 0; r < picture.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < picture.cols(); ++c) sheet(row + r, col + c) = picture(r, c);
    writer.write(job.captions.empty() ? job.pictures[i].stem().string() : job.captions[i], sheet,
                 row + picture.rows(), col);
  }
  MAQUETTE_TRY_VOID(camera::write_png(sheet, out));
  JobResult result;
  result.outputs = {out};
  result.figures_json =
      nlohmann::json{{"pictures", count}, {"columns", columns}, {"size_px", {wide, high}}}.dump();
  result.note = fmt::format("{} pictures on {} x {} pixels", count, wide, high);
  return result;
}

}  // namespace maquette::tools
