// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/heightmap_pyramid.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

#include <cpl_string.h>
#include <fmt/format.h>
#include <ogr_spatialref.h>
#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/detail/gdal_memory.hpp"
#include "export/detail/place_reference.hpp"
#include "export/glb_file.hpp"
#include "heightmap/model_frame.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using detail::gdal_memory;
using detail::GdalDataset;
using detail::GdalMessages;
using detail::put_row;
using detail::set_place;
using heightmap::ModelField;

constexpr double kMostNumber = 65535.0;
/// Of a surface without relief, so that a number still means something.
constexpr double kFlatStep_mm = 1e-3;

Result<std::uint64_t> save(const GdalDataset& dataset, const char* format,
                           const char* const* options, const fs::path& path,
                           const GdalMessages& messages) {
  AtomicPath file(path);
  MAQUETTE_TRY_VOID(file.prepare());
  GDALDriverH driver = GDALGetDriverByName(format);
  if (driver == nullptr) return fail(kLibraryFailed, fmt::format("GDAL has no driver {}", format));
  GdalDataset copy(
      GDALCreateCopy(driver, file.path().c_str(), dataset.get(), FALSE, options, nullptr, nullptr));
  const bool made = copy != nullptr;
  copy.reset();  // some of it is written now
  if (!made || messages.failed()) return messages.failure(path);
  MAQUETTE_TRY_VOID(file.commit());
  std::error_code ec;
  return fs::file_size(path, ec);
}

Result<void> make_folder(const fs::path& folder) {
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  return {};
}

/// height (mm of the model) = low + step * number
struct Numbers {
  double low_mm = 0.0, step_mm = kFlatStep_mm;
  [[nodiscard]] std::uint16_t of(float z_mm) const {
    const double n = std::round((static_cast<double>(z_mm) - low_mm) / step_mm);
    return static_cast<std::uint16_t>(std::clamp(n, 0.0, kMostNumber));
  }
  [[nodiscard]] double height_mm(std::uint16_t number) const { return low_mm + step_mm * number; }
};

Numbers numbers_for(const LodPyramid& pyramid) {
  Numbers n;
  double high = -INFINITY;
  n.low_mm = INFINITY;
  for (int level = 0; level < pyramid.levels(); ++level) {
    const auto range = heightmap::height_range(pyramid.heights_mm(level));
    n.low_mm = std::min(n.low_mm, static_cast<double>(range.min));
    high = std::max(high, static_cast<double>(range.max));
  }
  if (high > n.low_mm) n.step_mm = (high - n.low_mm) / kMostNumber;
  return n;
}

Grid<std::uint16_t> numbered(const Grid<float>& z_mm, const Numbers& numbers) {
  Grid<std::uint16_t> out(z_mm.rows(), z_mm.cols());
  tbb::parallel_for(std::ptrdiff_t{0}, z_mm.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < z_mm.cols(); ++c) out(r, c) = numbers.of(z_mm(r, c));
  });
  return out;
}

/// Fills rounding and errors of a level, in mm of the model; rows apart, summed in their order.
void measure(const LodPyramid& pyramid, int level, const Grid<std::uint16_t>& coded,
             const Numbers& numbers, HeightmapLevel& report) {
  const Grid<float>&own = pyramid.heights_mm(level), &full = pyramid.field().z_mm;
  std::vector<double> rounding(static_cast<std::size_t>(own.rows())),
      largest(static_cast<std::size_t>(full.rows())), squares(largest.size());
  tbb::parallel_for(std::ptrdiff_t{0}, own.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < own.cols(); ++c) {
      double& most = rounding[static_cast<std::size_t>(r)];
      most = std::max(most,
                      std::fabs(numbers.height_mm(coded(r, c)) - static_cast<double>(own(r, c))));
    }
  });
  const double stride = std::ldexp(1.0, level);
  tbb::parallel_for(std::ptrdiff_t{0}, full.rows(), [&](std::ptrdiff_t r) {
    const std::ptrdiff_t r0 = r >> level, r1 = std::min(r0 + 1, own.rows() - 1);
    const double v = static_cast<double>(r - (r0 << level)) / stride;
    const auto i = static_cast<std::size_t>(r);
    for (std::ptrdiff_t c = 0; c < full.cols(); ++c) {
      const std::ptrdiff_t c0 = c >> level, c1 = std::min(c0 + 1, own.cols() - 1);
      const double u = static_cast<double>(c - (c0 << level)) / stride;
      const auto at = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
        return numbers.height_mm(coded(row, col));
      };
      const double z = (1.0 - v) * ((1.0 - u) * at(r0, c0) + u * at(r0, c1)) +
                       v * ((1.0 - u) * at(r1, c0) + u * at(r1, c1));
      const double off = std::fabs(z - static_cast<double>(full(r, c)));
      largest[i] = std::max(largest[i], off);
      squares[i] += off * off;
    }
  });
  report.rounding_m = *std::max_element(rounding.begin(), rounding.end());
  report.largest_m = *std::max_element(largest.begin(), largest.end());
  double sum = 0.0;
  for (const double s : squares) sum += s;
  report.rms_m = std::sqrt(sum / static_cast<double>(full.rows() * full.cols()));
}

/// A tile's numbers, rows from the south; beyond the level's last node that one's.
std::vector<std::uint16_t> tile_of(const Grid<std::uint16_t>& level, std::ptrdiff_t quads,
                                   std::ptrdiff_t x, std::ptrdiff_t y) {
  std::vector<std::uint16_t> tile;
  tile.reserve(static_cast<std::size_t>((quads + 1) * (quads + 1)));
  for (std::ptrdiff_t r = y * quads; r <= (y + 1) * quads; ++r)
    for (std::ptrdiff_t c = x * quads; c <= (x + 1) * quads; ++c)
      tile.push_back(level(std::min(r, level.rows() - 1), std::min(c, level.cols() - 1)));
  return tile;
}

Result<std::uint64_t> write_raw(const std::vector<std::uint16_t>& tile, const fs::path& path) {
  std::string bytes(2 * tile.size(), '\0');
  for (std::size_t i = 0; i < tile.size(); ++i) {
    bytes[2 * i] = static_cast<char>(tile[i] & 0xFF);
    bytes[2 * i + 1] = static_cast<char>(tile[i] >> 8);
  }
  MAQUETTE_TRY_VOID(write_file(path, bytes));
  return bytes.size();
}

Result<std::uint64_t> write_png(const std::vector<std::uint16_t>& tile, std::ptrdiff_t nodes,
                                const fs::path& path) {
  const GdalMessages messages;
  const GdalDataset dataset = gdal_memory(nodes, nodes, GDT_UInt16);
  if (!dataset) return messages.failure(path);
  for (std::ptrdiff_t r = 0; r < nodes; ++r)
    if (!put_row(dataset, nodes - 1 - r, tile.data() + r * nodes, nodes, GDT_UInt16))
      return messages.failure(path);
  return save(dataset, "PNG", nullptr, path, messages);
}

/// Level by level, coarsest first; how large all files are.
Result<std::uint64_t> write_tiles(const std::vector<Grid<std::uint16_t>>& levels,
                                  HeightmapReport& report, const HeightmapOptions& options,
                                  const fs::path& folder, const RunContext& run) {
  struct Tile {
    std::size_t level;
    std::ptrdiff_t x, y;
    fs::path stem;
  };
  std::vector<Tile> tiles;
  for (std::size_t level = levels.size(); level-- > 0;)
    for (std::ptrdiff_t x = 0; x < report.levels[level].tiles[0]; ++x) {
      const fs::path column = folder / fmt::format("{}/{}", levels.size() - 1 - level, x);
      MAQUETTE_TRY_VOID(make_folder(column));
      for (std::ptrdiff_t y = 0; y < report.levels[level].tiles[1]; ++y)
        tiles.push_back({level, x, y, column / std::to_string(y)});
    }
  std::vector<std::optional<Result<std::uint64_t>>> made(tiles.size());
  std::atomic<std::size_t> done{0};
  tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
    if (run.stopped()) return;
    const Tile& t = tiles[i];
    const auto tile = tile_of(levels[t.level], options.tile_quads, t.x, t.y);
    auto png = write_png(tile, options.tile_quads + 1, fs::path(t.stem).concat(".png"));
    auto raw = write_raw(tile, fs::path(t.stem).concat(".raw"));
    made[i] = png && raw ? Result<std::uint64_t>(*png + *raw)
              : png      ? std::move(raw)
                         : std::move(png);
    run.progress(0.3 + 0.6 * static_cast<double>(++done) / static_cast<double>(tiles.size()));
  });
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    if (!made[i])
      return fail(kCancelled, fmt::format("{}: stopped after {} of {} tiles", folder.string(),
                                          done.load(), tiles.size()));
    if (!*made[i]) return tl::unexpected(std::move(made[i]->error()));
    bytes += **made[i];
    for (const char* ending : {".png", ".raw"})
      report.outputs.push_back(fs::path(tiles[i].stem).concat(ending));
  }
  return bytes;
}

Result<std::uint64_t> write_geotiff(const ModelField& field, const HeightmapOptions& options,
                                    const fs::path& path, double& rounding_m) {
  const GdalMessages messages;
  const std::ptrdiff_t rows = field.z_mm.rows(), cols = field.z_mm.cols();
  const GdalDataset dataset = gdal_memory(cols, rows, GDT_Float32);
  if (!dataset) return messages.failure(path);
  const LodContentScale content = content_scale(options.place, options.scale_denominator);
  std::vector<float> row(static_cast<std::size_t>(cols));
  for (std::ptrdiff_t r = 0; r < rows; ++r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      float& z = row[static_cast<std::size_t>(c)] = field.z_mm(r, c);
      if (!options.place) continue;
      const double metres = content.vertical * kMetresPerMillimetre * static_cast<double>(z);
      z = static_cast<float>(metres);
      rounding_m = std::max(rounding_m, std::fabs(static_cast<double>(z) - metres));
    }
    if (!put_row(dataset, rows - 1 - r, row.data(), cols, GDT_Float32))
      return messages.failure(path);
  }
  double s = field.spacing.value(), x0 = field.x0.value(), y0 = field.y0.value();
  OGRSpatialReference frame;
  if (options.place) {
    s *= kMetresPerMillimetre * content.horizontal;
    x0 = -0.5 * s * static_cast<double>(cols - 1);
    y0 = -0.5 * s * static_cast<double>(rows - 1);
    set_place(frame, *options.place);
  } else {
    frame.importFromWkt(heightmap::kModelFrameWkt);
  }
  std::array<double, 6> corner{x0 - 0.5 * s, s, 0.0, y0 + (static_cast<double>(rows) - 0.5) * s,
                               0.0,          -s};
  GDALSetGeoTransform(dataset.get(), corner.data());
  GDALSetSpatialRef(dataset.get(), OGRSpatialReference::ToHandle(&frame));
  GDALSetMetadataItem(dataset.get(), GDALMD_AREA_OR_POINT, GDALMD_AOP_POINT, nullptr);
  GDALRasterBandH band = GDALGetRasterBand(dataset.get(), 1);
  GDALSetRasterUnitType(band, options.place ? "m" : "mm");
  GDALSetDescription(
      band, options.place ? "height above the plane that touches the ellipsoid" : "height");
  CPLStringList to;
  to.SetNameValue("COMPRESS", "DEFLATE");
  to.SetNameValue("PREDICTOR", "YES");
  to.SetNameValue("OVERVIEW_RESAMPLING", "AVERAGE");
  to.SetNameValue("BIGTIFF", "IF_SAFER");
  return save(dataset, "COG", to.List(), path, messages);
}

Result<void> check_options(const HeightmapOptions& o) {
  const auto quads = static_cast<std::uint64_t>(o.tile_quads);
  if (o.tile_quads < 16 || o.tile_quads > 4096 || !std::has_single_bit(quads))
    return fail(kOptionOutOfRange,
                fmt::format("heightmaps of {} quads: a power of two from 16 to 4096 expected",
                            o.tile_quads));
  return check_place(o.place, o.scale_denominator);
}

}  // namespace

Result<HeightmapReport> write_heightmaps(const ModelField& field, const HeightmapOptions& options,
                                         const fs::path& folder, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_options(options));
  if (field.z_mm.rows() < 2 || field.z_mm.cols() < 2)
    return fail(kEmptyMesh, "heightmaps need 2 x 2 nodes at least");
  const int count = lod_levels(field, options.tile_quads);
  MAQUETTE_TRY(const auto pyramid, LodPyramid::create(field, count, options.filter));
  run.progress(0.1);
  const LodContentScale content = content_scale(options.place, options.scale_denominator);
  const Numbers numbers = numbers_for(pyramid);
  const double high = content.vertical * kMetresPerMillimetre;
  HeightmapReport report;
  report.offset_m = high * numbers.low_mm;
  report.scale_m = high * numbers.step_mm;
  const LodLattice tiling{.tile_quads = options.tile_quads};
  std::vector<Grid<std::uint16_t>> coded;
  for (int level = 0; level < count; ++level) {
    coded.push_back(numbered(pyramid.heights_mm(level), numbers));
    HeightmapLevel& l = report.levels.emplace_back();
    l.nodes = {coded.back().cols(), coded.back().rows()};
    l.tiles = {lod_tiles(field.z_mm.cols(), tiling, level),
               lod_tiles(field.z_mm.rows(), tiling, level)};
    l.spacing_m =
        std::ldexp(content.horizontal * kMetresPerMillimetre * field.spacing.value(), level);
    measure(pyramid, level, coded.back(), numbers, l);
    for (double* mm : {&l.rounding_m, &l.largest_m, &l.rms_m}) *mm *= high;
  }
  run.progress(0.3);
  MAQUETTE_TRY_VOID(make_folder(folder));
  MAQUETTE_TRY(report.bytes, write_tiles(coded, report, options, folder, run));
  const auto add = [&](const fs::path& path, std::uint64_t bytes) {
    report.outputs.push_back(path);
    report.bytes += bytes;
  };
  MAQUETTE_TRY(const std::uint64_t geotiff,
               write_geotiff(field, options, folder / "heights.tif", report.geotiff_rounding_m));
  add(folder / "heights.tif", geotiff);
  const std::string json = to_json(report, options);
  MAQUETTE_TRY_VOID(write_file(folder / "heights.json", json));
  add(folder / "heights.json", json.size());
  run.progress(1.0);
  return report;
}

std::string to_json(const HeightmapReport& report, const HeightmapOptions& options) {
  const LodContentScale content = content_scale(options.place, options.scale_denominator);
  const double edge = static_cast<double>(options.tile_quads);
  Json json{
      {"schema", "maquette.heightmaps/1"},
      {"size", options.place ? "full" : "model"},
      {"scale_denominator", options.scale_denominator},
      {"metres_per_model_metre", {content.horizontal, content.vertical}},
      {"height", "offset_m + scale_m * number"},
      {"offset_m", report.offset_m},
      {"scale_m", report.scale_m},
      {"tile_nodes", options.tile_quads + 1},
      {"tiles", "DEPTH/X/Y, from the south-western corner; neighbours share their border's nodes"},
      {"png", {{"bits", 16}, {"rows", "from the north"}}},
      {"raw", {{"bits", 16}, {"bytes", "little endian"}, {"rows", "from the south"}}},
      {"geotiff",
       {{"file", "heights.tif"},
        {"unit", options.place ? "m" : "mm"},
        {"largest_rounding_m", report.geotiff_rounding_m}}},
      {"unreal_z_cm", 100.0 * (report.offset_m + 32768.0 * report.scale_m)}};
  for (std::size_t level = 0; level < report.levels.size(); ++level) {
    const HeightmapLevel& l = report.levels[level];
    json["levels"].push_back(
        {{"level", level},
         {"depth", report.levels.size() - 1 - level},
         {"tiles", l.tiles},
         {"nodes", l.nodes},
         {"spacing_m", l.spacing_m},
         {"largest_rounding_m", l.rounding_m},
         {"largest_error_m", l.largest_m},
         {"rms_error_m", l.rms_m},
         {"unity_terrain_size_m",
          {edge * l.spacing_m, kMostNumber * report.scale_m, edge * l.spacing_m}},
         // A number is 1/128 cm times the z scale.
         {"unreal_scale", {100.0 * l.spacing_m, 100.0 * l.spacing_m, 12800.0 * report.scale_m}}});
  }
  return json.dump(1);
}

}  // namespace maquette::exporting
