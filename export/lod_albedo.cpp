// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_albedo.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include <cpl_conv.h>
#include <cpl_string.h>
#include <fmt/format.h>
#include <gdal_utils.h>
#include <ogr_spatialref.h>

#include "export/cad.hpp"
#include "export/detail/gdal_memory.hpp"
#include "export/detail/place_reference.hpp"
#include "export/glb_file.hpp"
#include "export/lod_pictures.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using detail::GdalDataset;
using detail::GdalMessages;
using heightmap::ModelField;

/// IEC 61966-2-1, both ways; shares of the brightest.
double light_of(double srgb) {
  return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
}
double srgb_of(double light) {
  return light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1.0 / 2.4) - 0.055;
}
std::uint8_t byte_of(double share) {
  return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(share, 0.0, 1.0)));
}

/// Where the site lies, in the raster's or the place's plane, and how many pixels it gets.
struct Target {
  double west = 0.0, south = 0.0, east = 0.0, north = 0.0;
  std::ptrdiff_t width = 0, height = 0;
  std::string wkt;  ///< empty: the raster's own frame
};

class Source {
 public:
  Source(const fs::path& path, const ModelField& field, const LodSetOptions& options)
      : path_(path), field_(field), options_(options) {}

  Result<LodAlbedo> read() {
    GDALAllRegister();
    data_.reset(
        GDALOpenEx(path_.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, nullptr, nullptr, nullptr));
    if (!data_) return gdal_failed();
    MAQUETTE_TRY_VOID(check_bands());
    MAQUETTE_TRY(const Target target, place());
    return sample(target);
  }

 private:
  [[nodiscard]] tl::unexpected<Error> unusable(const std::string& why) const {
    return fail(kAlbedoUnusable, fmt::format("{}: {}", path_.string(), why));
  }

  [[nodiscard]] tl::unexpected<Error> gdal_failed() const {
    return fail(kAlbedoUnusable, messages_.failure(path_).value().message);
  }

  Result<void> check_bands() {
    const int count = GDALGetRasterCount(data_.get());
    bands_ = count;
    if (count > 0 &&
        GDALGetRasterColorInterpretation(GDALGetRasterBand(data_.get(), count)) == GCI_AlphaBand)
      --bands_;
    if (bands_ != 1 && bands_ != 3)
      return unusable(fmt::format("{} bands; 1 (grey) or 3 (red, green, blue) expected", bands_));
    if (GDALGetRasterColorTable(GDALGetRasterBand(data_.get(), 1)) != nullptr)
      return unusable("a palette; gdal_translate -expand rgb makes bands of it");
    for (int b = 1; b <= bands_; ++b) {
      type_ = GDALGetRasterDataType(GDALGetRasterBand(data_.get(), b));
      if (type_ != GDT_Byte && type_ != GDT_UInt16 && type_ != GDT_Float32 && type_ != GDT_Float64)
        return unusable(
            fmt::format("values of type {}; 8 or 16 bits without sign, or floats "
                        "expected",
                        GDALGetDataTypeName(type_)));
    }
    return {};
  }

  Result<Target> place() {
    const double spacing = field_.spacing.value(),
                 wide = spacing * static_cast<double>(field_.z_mm.cols() - 1),
                 high = spacing * static_cast<double>(field_.z_mm.rows() - 1);
    // As many pixels as all pictures of the finest tiles have.
    const double texels = static_cast<double>(options_.texels) /
                          (spacing * static_cast<double>(options_.tile_quads));  // a mm
    const auto pixels = [&](double length_mm, double own) {
      return static_cast<std::ptrdiff_t>(
          std::clamp(std::ceil(std::min(texels * length_mm, own) - 1e-6), 1.0, 65535.0));
    };
    const double cols = GDALGetRasterXSize(data_.get()), rows = GDALGetRasterYSize(data_.get());
    std::array<double, 6> affine{};
    const bool placed = GDALGetGeoTransform(data_.get(), affine.data()) == CE_None;
    const OGRSpatialReference* crs =
        OGRSpatialReference::FromHandle(GDALGetSpatialRef(data_.get()));
    if (crs != nullptr && (crs->IsGeographic() || crs->IsProjected())) {
      if (!options_.place)
        return unusable(
            fmt::format("is georeferenced on a body ({}), and no place there is given "
                        "for the surface",
                        crs->GetName()));
      const double m = kMetresPerMillimetre * options_.asset.scale_denominator;
      OGRSpatialReference plane;
      detail::set_place(plane, *options_.place);
      char* text = nullptr;
      plane.exportToWkt(&text);
      const std::unique_ptr<char, decltype(&CPLFree)> wkt(text, &CPLFree);
      constexpr double kNoLimit = std::numeric_limits<double>::infinity();
      return Target{-0.5 * m * wide,
                    -0.5 * m * high,
                    0.5 * m * wide,
                    0.5 * m * high,
                    pixels(wide, kNoLimit),
                    pixels(high, kNoLimit),
                    text};
    }
    const double x0 = field_.x0.value(), y0 = field_.y0.value();
    if (!placed) {
      if (std::fabs(cols - rows * wide / high) > 1.0 && std::fabs(rows - cols * high / wide) > 1.0)
        return unusable(
            fmt::format("{} x {} pixels without georeference do not lie on a surface of "
                        "{:g} x {:g} mm: its proportions are others",
                        cols, rows, wide, high));
      MAQUETTE_TRY_VOID(lay_on({x0, y0 + high, x0 + wide, y0}));
      return Target{x0, y0, x0 + wide, y0 + high, pixels(wide, cols), pixels(high, rows), {}};
    }
    return Target{x0,
                  y0,
                  x0 + wide,
                  y0 + high,
                  pixels(wide, wide / std::hypot(affine[1], affine[4])),
                  pixels(high, high / std::hypot(affine[2], affine[5])),
                  {}};
  }

  /// @param corners  upper left, lower right
  Result<void> lay_on(const std::array<double, 4>& corners) {
    CPLStringList words;
    for (const char* word : {"-of", "VRT", "-a_ullr"}) words.AddString(word);
    for (const double x : corners) words.AddString(fmt::format("{:.17g}", x).c_str());
    const std::unique_ptr<GDALTranslateOptions, decltype(&GDALTranslateOptionsFree)> how(
        GDALTranslateOptionsNew(words.List(), nullptr), &GDALTranslateOptionsFree);
    int misused = 0;
    GdalDataset laid(how ? GDALTranslate("", data_.get(), how.get(), &misused) : nullptr);
    if (!laid) return gdal_failed();
    picture_ = std::move(data_);
    data_ = std::move(laid);
    return {};
  }

  Result<LodAlbedo> sample(const Target& target) {
    CPLStringList words;
    const auto add = [&](std::initializer_list<std::string> some) {
      for (const std::string& word : some) words.AddString(word.c_str());
    };
    add({"-of", "MEM", "-dstalpha", "-r", "bilinear", "-te", fmt::format("{:.17g}", target.west),
         fmt::format("{:.17g}", target.south), fmt::format("{:.17g}", target.east),
         fmt::format("{:.17g}", target.north), "-ts", fmt::format("{}", target.width),
         fmt::format("{}", target.height)});
    if (!target.wkt.empty()) add({"-t_srs", target.wkt});
    const std::unique_ptr<GDALWarpAppOptions, decltype(&GDALWarpAppOptionsFree)> how(
        GDALWarpAppOptionsNew(words.List(), nullptr), &GDALWarpAppOptionsFree);
    GDALDatasetH source = data_.get();
    int misused = 0;
    const GdalDataset on_site(how ? GDALWarp("", nullptr, 1, &source, how.get(), &misused)
                                  : nullptr);
    if (!on_site || messages_.failed()) return gdal_failed();

    LodAlbedo albedo{target.width, target.height, {}};
    const auto count = static_cast<std::size_t>(target.width * target.height);
    const int w = static_cast<int>(target.width), h = static_cast<int>(target.height);
    const bool floats = type_ == GDT_Float32 || type_ == GDT_Float64;
    std::vector<float> values(count);
    const auto band_of = [&](int b) {
      return GDALRasterIO(GDALGetRasterBand(on_site.get(), b), GF_Read, 0, 0, w, h, values.data(),
                          w, h, GDT_Float32, 0, 0) == CE_None;
    };
    if (!band_of(bands_ + 1)) return gdal_failed();
    const auto bare = std::count(values.begin(), values.end(), 0.0F);
    if (bare > 0)
      return unusable(fmt::format("does not cover the surface: {:.3g} % of it have no value",
                                  100.0 * static_cast<double>(bare) / static_cast<double>(count)));
    for (int b = 1; b <= bands_; ++b) {
      if (!band_of(b)) return gdal_failed();
      std::vector<std::uint8_t>& bytes = albedo.bands.emplace_back(count);
      for (std::size_t i = 0; i < count; ++i) {
        const auto value = static_cast<double>(values[i]);
        if (floats && !(value >= 0.0 && value <= 1.0))
          return unusable(fmt::format("a reflectance of {:g}; 0 to 1 expected", value));
        bytes[i] = byte_of(floats ? srgb_of(value) : value / (type_ == GDT_Byte ? 255.0 : 65535.0));
      }
    }
    return albedo;
  }

  const fs::path& path_;
  const ModelField& field_;
  const LodSetOptions& options_;
  GdalMessages messages_;
  GdalDataset picture_;  ///< what data_ refers to, if it has no georeference of its own
  GdalDataset data_;
  GDALDataType type_ = GDT_Unknown;
  int bands_ = 0;
};

/// Light between pixels' middles; beyond the outermost ones theirs.
double light_at(const LodAlbedo& albedo, const std::vector<std::uint8_t>& band, double x, double y,
                const std::array<double, 256>& light) {
  const auto along = [](double at, std::ptrdiff_t pixels) {
    const double middle = std::clamp(at - 0.5, 0.0, static_cast<double>(pixels - 1));
    const auto first =
        std::min(static_cast<std::ptrdiff_t>(middle), std::max<std::ptrdiff_t>(pixels - 2, 0));
    return std::pair{first, middle - static_cast<double>(first)};
  };
  const auto [c, u] = along(x, albedo.width);
  const auto [r, v] = along(y, albedo.height);
  const auto pixel = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
    return light[band[static_cast<std::size_t>(std::min(row, albedo.height - 1) * albedo.width +
                                               std::min(col, albedo.width - 1))]];
  };
  return (1.0 - v) * ((1.0 - u) * pixel(r, c) + u * pixel(r, c + 1)) +
         v * ((1.0 - u) * pixel(r + 1, c) + u * pixel(r + 1, c + 1));
}

}  // namespace

Result<LodAlbedo> read_lod_albedo(const fs::path& path, const ModelField& field,
                                  const LodSetOptions& options) {
  return Source(path, field, options).read();
}

Result<std::vector<char>> albedo_picture(const LodAlbedo& albedo, const ModelField& field,
                                         const LodTileMesh& tile, int texels) {
  const auto [north, south, west, east, side] = picture_square(tile);
  const double top = static_cast<double>(field.z_mm.rows() - 1);
  // Pixels a quad.
  const double across =
                   static_cast<double>(albedo.width) / static_cast<double>(field.z_mm.cols() - 1),
               down = static_cast<double>(albedo.height) / top;
  const int count = std::clamp(
      static_cast<int>(std::lround(std::ceil(side * std::fmax(across, down) - 1e-6))), 1, texels);
  const double texel = side / count;
  const int parts = std::max(
      1, static_cast<int>(std::lround(texel * std::fmax(across, down))));  // a texel's side
  std::array<double, 256> light{};
  for (std::size_t i = 0; i < light.size(); ++i)
    light[i] = light_of(static_cast<double>(i) / 255.0);
  std::vector<std::vector<std::uint8_t>> bands;
  for (const auto& band : albedo.bands) {
    std::vector<std::uint8_t>& bytes = bands.emplace_back();
    for (int y = 0; y < count; ++y)
      for (int x = 0; x < count; ++x) {
        double sum = 0.0;
        for (int i = 0; i < parts; ++i)
          for (int k = 0; k < parts; ++k) {
            const double row = std::fmax(north - (y + (i + 0.5) / parts) * texel, south),
                         col = std::fmin(west + (x + (k + 0.5) / parts) * texel, east);
            sum += light_at(albedo, band, across * col, down * (top - row), light);
          }
        bytes.push_back(byte_of(srgb_of(sum / (parts * parts))));
      }
  }
  return detail::png_bytes(count, count, bands);
}

}  // namespace maquette::exporting
