// SPDX-License-Identifier: GPL-3.0-or-later
#include "assets/synthetic_products.hpp"

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "assets/detail/pds3_map.hpp"
#include "assets/synthetic_terrain.hpp"
#include "core/files.hpp"
#include "core/random.hpp"

namespace maquette::assets {
namespace {

static_assert(std::endian::native == std::endian::little, "PC_REAL and LSB_INTEGER are memcpied");

using detail::kDegree;
using detail::MapGrid;
using detail::SiteFrame;
constexpr double kLdemScale_m = 0.5;  // per DN, as LOLA's LDEM has it
constexpr std::int64_t kMarginPixels = 10;
constexpr std::int64_t kCornerPixels = 8;  // voids: row + column below this, in each corner
// ISIS Null as HiRISE DTMs carry it.
constexpr std::uint32_t kNullBits = 0xFF7FFFFBU;

/// Heights of the truth at the pixel centres, moved by the shift, with noise.
/// values[line * samples + sample]; the noise depends on stream and pixel alone.
Result<std::vector<float>> sample_truth(const SyntheticSite& site, const SiteFrame& frame,
                                        const MapGrid& grid, double shift_east, double shift_north,
                                        double shift_up, double noise, std::uint64_t stream,
                                        double progress_from, double progress_to,
                                        const RunContext& run) {
  std::vector<float> values(static_cast<std::size_t>(grid.lines * grid.samples));
  constexpr std::int64_t kBlock = 64;  // lines between two looks at the stop token
  for (std::int64_t first = 0; first < grid.lines; first += kBlock) {
    if (run.stopped()) return fail(kCancelled, "writing the synthetic products was stopped");
    const std::int64_t last = std::min(first + kBlock, grid.lines);
    tbb::parallel_for(tbb::blocked_range<std::int64_t>(first, last), [&](const auto& lines) {
      for (std::int64_t line = lines.begin(); line != lines.end(); ++line) {
        const double latitude = grid.latitude_deg(static_cast<double>(line));
        for (std::int64_t sample = 0; sample < grid.samples; ++sample) {
          const SiteFrame::Plane p =
              frame.plane(latitude, grid.longitude_deg(static_cast<double>(sample)));
          const std::int64_t pixel = line * grid.samples + sample;
          const double z = synthetic_height_m(site, p.east - shift_east, p.north - shift_north) +
                           shift_up +
                           noise * random_normal(stream, static_cast<std::uint64_t>(pixel));
          values[static_cast<std::size_t>(pixel)] = static_cast<float>(z);
        }
      }
    });
    run.progress(progress_from + (progress_to - progress_from) * static_cast<double>(last) /
                                     static_cast<double>(grid.lines));
  }
  return values;
}

std::string upper(std::string s) {
  for (char& c : s) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return s;
}

Result<void> write_fine(const SyntheticSite& site, const SiteFrame& frame,
                        const std::string& product, const std::filesystem::path& path,
                        const RunContext& run) {
  MapGrid grid;
  // HiRISE: standard parallel at a multiple of 5 degrees, sphere of the local radius there.
  grid.standard_latitude_deg = 5.0 * std::round(site.centre_latitude_deg / 5.0);
  grid.radius_m = detail::local_radius_m(site.body, grid.standard_latitude_deg);
  grid.scale_m = site.fine_pixel.value();
  const double shift = std::max(std::abs(site.planted_shift_east.value()),
                                std::abs(site.planted_shift_north.value()));
  grid =
      cover(frame, site.centre_longitude_deg, grid, site.half_width.value() + shift, kMarginPixels);
  MAQUETTE_TRY(std::vector<float> z,
               sample_truth(site, frame, grid, site.planted_shift_east.value(),
                            site.planted_shift_north.value(), site.planted_shift_up.value(),
                            site.fine_noise_m, mix64(site.seed + 1), 0.0, 0.9, run));
  const auto [low, high] = std::minmax_element(z.begin(), z.end());
  const double lowest = *low, highest = *high;
  // The footprint of a real DTM is turned in its map: the corners are void.
  for (std::int64_t r = 0; r < kCornerPixels; ++r)
    for (std::int64_t c = 0; r + c < kCornerPixels; ++c)
      for (const std::int64_t line : {r, grid.lines - 1 - r})
        for (const std::int64_t sample : {c, grid.samples - 1 - c})
          z[static_cast<std::size_t>(line * grid.samples + sample)] =
              std::bit_cast<float>(kNullBits);

  const std::int64_t record = 4 * grid.samples;
  // The label says how many records it fills; their number has its own width.
  const auto label = [&](std::int64_t records) {
    std::string t = "PDS_VERSION_ID = PDS3\r\n\r\n";
    t += fmt::format("RECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = {}\r\nFILE_RECORDS = {}\r\n",
                     record, records + grid.lines);
    t += fmt::format("LABEL_RECORDS = {}\r\n^IMAGE = {}\r\n\r\n", records, records + 1);
    t += fmt::format("DATA_SET_ID = \"MAQUETTE-SYNTHETIC-DTM-V1.0\"\r\nPRODUCT_ID = \"{}\"\r\n",
                     product);
    t += fmt::format("TARGET_NAME = {}\r\nINSTRUMENT_NAME = \"SYNTHETIC STEREO CAMERA\"\r\n",
                     upper(site.body.name));
    t += "NOTE = \"Heights of a synthetic surface. The truth is in the file _truth.json.\"\r\n\r\n";
    t += fmt::format("OBJECT = IMAGE\r\n  LINES = {}\r\n  LINE_SAMPLES = {}\r\n  BANDS = 1\r\n",
                     grid.lines, grid.samples);
    t += "  SAMPLE_TYPE = PC_REAL\r\n  SAMPLE_BITS = 32\r\n  UNIT = METER\r\n";
    t += "  SCALING_FACTOR = 1.0\r\n  OFFSET = 0.0\r\n";
    t += fmt::format("  VALID_MINIMUM = {:.6f}\r\n  VALID_MAXIMUM = {:.6f}\r\n", lowest, highest);
    t += fmt::format("  MISSING_CONSTANT = 16#{:08X}#\r\nEND_OBJECT = IMAGE\r\n\r\n", kNullBits);
    return t + detail::projection_object(grid, "EQUIRECTANGULAR") + "END\r\n";
  };
  std::int64_t records = 1;
  while (static_cast<std::int64_t>(label(records).size()) > records * record) ++records;
  std::string head = label(records);
  head.resize(static_cast<std::size_t>(records * record), ' ');

  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  file.write(head);
  file.write(z.data(), z.size() * sizeof(float));
  return file.commit();
}

Result<void> write_coarse(const SyntheticSite& site, const SiteFrame& frame,
                          const std::string& product, const std::filesystem::path& img,
                          const std::filesystem::path& lbl, const RunContext& run) {
  MapGrid grid;
  grid.radius_m = site.body.equatorial_radius_m;
  // LOLA's grids have a whole number of pixels per degree.
  const double per_degree = grid.radius_m * kDegree / site.coarse_pixel.value();
  grid.scale_m = per_degree < 10.0 ? site.coarse_pixel.value()
                                   : grid.radius_m * kDegree / std::round(per_degree);
  grid = cover(frame, site.centre_longitude_deg, grid, 4.0 * site.half_width.value(), 2);
  MAQUETTE_TRY(const std::vector<float> z,
               sample_truth(site, frame, grid, 0.0, 0.0, 0.0, site.coarse_noise_m,
                            mix64(site.seed + 2), 0.9, 1.0, run));
  std::vector<std::int16_t> dn(z.size());
  std::transform(z.begin(), z.end(), dn.begin(), [](float height) {
    return static_cast<std::int16_t>(std::lround(static_cast<double>(height) / kLdemScale_m));
  });
  const auto [low, high] = std::minmax_element(dn.begin(), dn.end());

  std::string t = "PDS_VERSION_ID = \"PDS3\"\r\n\r\n";
  t += "DATA_SET_ID = \"MAQUETTE-SYNTHETIC-GDR-V1.0\"\r\n";
  t += fmt::format("PRODUCT_ID = \"{}\"\r\nTARGET_NAME = {}\r\n", product, upper(site.body.name));
  t += "INSTRUMENT_NAME = \"SYNTHETIC LASER ALTIMETER\"\r\n\r\n";
  t += fmt::format("OBJECT = UNCOMPRESSED_FILE\r\n  FILE_NAME = \"{}\"\r\n",
                   img.filename().string());
  t += fmt::format("  RECORD_TYPE = FIXED_LENGTH\r\n  FILE_RECORDS = {}\r\n  RECORD_BYTES = {}\r\n",
                   grid.lines, 2 * grid.samples);
  t += fmt::format("  ^IMAGE = \"{}\"\r\n\r\n  OBJECT = IMAGE\r\n    NAME = HEIGHT\r\n",
                   img.filename().string());
  t += fmt::format("    LINES = {}\r\n    LINE_SAMPLES = {}\r\n", grid.lines, grid.samples);
  t += fmt::format("    MAXIMUM = {}\r\n    MINIMUM = {}\r\n", *high, *low);
  t += "    SAMPLE_TYPE = LSB_INTEGER\r\n    SAMPLE_BITS = 16\r\n    UNIT = METER\r\n";
  t += fmt::format("    SCALING_FACTOR = {}\r\n    OFFSET = {:.10g}\r\n", kLdemScale_m,
                   grid.radius_m);
  t += "/* HEIGHT = DN * SCALING_FACTOR, above the sphere of radius OFFSET;        */\r\n";
  t += "/* PLANETARY_RADIUS = HEIGHT + OFFSET.                                    */\r\n";
  t += "  END_OBJECT = IMAGE\r\nEND_OBJECT = UNCOMPRESSED_FILE\r\n\r\n";
  t += detail::projection_object(grid, "SIMPLE CYLINDRICAL") + "END\r\n";

  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(img));
  file.write(dn.data(), dn.size() * sizeof(std::int16_t));
  MAQUETTE_TRY_VOID(file.commit());
  return write_file(lbl, t);
}

Result<void> check_site(const SyntheticSite& s) {
  const auto refuse = [](const std::string& what) { return fail(kSiteOutOfRange, what); };
  const double a = s.body.equatorial_radius_m, b = s.body.polar_radius_m;
  if (!(b > 0.0 && a >= b && std::isfinite(a) && a / b < 1.1))
    return refuse(
        fmt::format("body \"{}\": radii {} and {} m are not those of a planet", s.body.name, a, b));
  if (s.body.name.empty() ||
      !std::all_of(s.body.name.begin(), s.body.name.end(),
                   [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; }))
    return refuse(fmt::format("body name \"{}\": expected letters, digits or _", s.body.name));
  // Beyond that the cylindrical maps are too stretched for a sensible pixel.
  if (!(std::abs(s.centre_latitude_deg) <= 80.0))
    return refuse(
        fmt::format("centre latitude {} degrees: expected -80 to 80", s.centre_latitude_deg));
  if (!(std::abs(s.centre_longitude_deg) <= 360.0))
    return refuse(
        fmt::format("centre longitude {} degrees: expected -360 to 360", s.centre_longitude_deg));
  const double half = s.half_width.value();
  const double fine = s.fine_pixel.value(), coarse = s.coarse_pixel.value();
  // Four half-widths must stay well within the hemisphere of the tangent plane.
  if (!(half > 0.0 && half < 0.02 * a))
    return refuse(
        fmt::format("half width {} m: expected more than 0 and less than {} m", half, 0.02 * a));
  if (!(fine > 0.0 && fine <= half && coarse > 0.0 && coarse <= half))
    return refuse(
        fmt::format("pixels of {} and {} m: expected more than 0, at most the half width {} m",
                    fine, coarse, half));
  // Both products are held in memory once: 2^28 pixels are 1 GiB.
  if (std::pow(2.0 * half / fine, 2) > 0x1p28 || std::pow(8.0 * half / coarse, 2) > 0x1p28)
    return refuse(
        fmt::format("pixels of {} and {} m over +-{} m make more than 268 million; "
                    "use larger pixels or a smaller site",
                    fine, coarse, half));
  for (const double shift :
       {s.planted_shift_east.value(), s.planted_shift_north.value(), s.planted_shift_up.value()})
    if (!(std::abs(shift) <= 1000.0))
      return refuse(fmt::format("planted shift {} m: expected at most 1000 m", shift));
  for (const double noise : {s.fine_noise_m, s.coarse_noise_m})
    if (!(noise >= 0.0 && noise <= 100.0))
      return refuse(fmt::format("noise {} m: expected 0 to 100 m", noise));
  return {};
}

std::string truth_text(const SyntheticSite& s, const SyntheticProducts& p) {
  nlohmann::ordered_json j;
  j["schema"] = "maquette.synthetic_site/1";
  j["body"] = {{"name", s.body.name},
               {"equatorial_radius_m", s.body.equatorial_radius_m},
               {"polar_radius_m", s.body.polar_radius_m}};
  j["centre_latitude_deg"] = s.centre_latitude_deg;
  j["centre_longitude_deg"] = s.centre_longitude_deg;
  j["half_width_m"] = s.half_width.value();
  j["seed"] = s.seed;
  j["fine"] = {{"image", p.fine_img.filename().string()},
               {"pixel_m", s.fine_pixel.value()},
               {"shift_east_m", s.planted_shift_east.value()},
               {"shift_north_m", s.planted_shift_north.value()},
               {"shift_up_m", s.planted_shift_up.value()},
               {"noise_m", s.fine_noise_m}};
  j["coarse"] = {{"label", p.coarse_lbl.filename().string()},
                 {"image", p.coarse_img.filename().string()},
                 {"pixel_m", s.coarse_pixel.value()},
                 {"noise_m", s.coarse_noise_m},
                 {"height_step_m", kLdemScale_m}};
  j["truth"] = {{"base_m", kSyntheticBase_m},
                {"hurst_exponent", kHurst},
                {"smallest_crater_m", kSmallestCrater_m},
                {"equilibrium_crater_m", kEquilibriumCrater_m},
                {"largest_crater_m", kLargestCrater_m}};
  return j.dump(2) + '\n';
}

}  // namespace

Result<SyntheticProducts> write_synthetic_products(const SyntheticSite& site,
                                                   const std::filesystem::path& folder,
                                                   const RunContext& run) {
  MAQUETTE_TRY_VOID(check_site(site));
  const std::string name = "synthetic_" + site.body.name;
  const SyntheticProducts products{folder / (name + "_dtm.img"), folder / (name + "_ldem.lbl"),
                                   folder / (name + "_ldem.img"), folder / (name + "_truth.json")};
  const SiteFrame frame(site.body, site.centre_latitude_deg, site.centre_longitude_deg);
  MAQUETTE_TRY_VOID(
      write_fine(site, frame, upper(products.fine_img.stem().string()), products.fine_img, run));
  MAQUETTE_TRY_VOID(write_coarse(site, frame, upper(products.coarse_img.stem().string()),
                                 products.coarse_img, products.coarse_lbl, run));
  MAQUETTE_TRY_VOID(write_file(products.truth_json, truth_text(site, products)));
  return products;
}

}  // namespace maquette::assets
