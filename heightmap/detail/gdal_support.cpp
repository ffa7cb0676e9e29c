// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/gdal_support.hpp"

#include <algorithm>
#include <mutex>
#include <system_error>

#include <fmt/format.h>

#include "core/files.hpp"
#include "heightmap/detail/raster_label.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::heightmap::detail {

ErrorCapture::ErrorCapture() {
  CPLPushErrorHandlerEx(&ErrorCapture::handle, this);
}

ErrorCapture::~ErrorCapture() {
  CPLPopErrorHandler();
}

void CPL_STDCALL ErrorCapture::handle(CPLErr severity, CPLErrorNum, const char* message) {
  auto* self = static_cast<ErrorCapture*>(CPLGetErrorHandlerUserData());
  if (self == nullptr || severity < CE_Warning) return;
  if (severity >= CE_Failure) self->failed_ = true;
  if (self->text_.size() > 500) return;  // a broken file repeats itself for every block
  if (!self->text_.empty()) self->text_ += "; ";
  self->text_ += message;
}

std::string ErrorCapture::text() const {
  return text_.empty() ? "no reason given" : text_;
}

void DatasetCloser::operator()(GDALDataset* dataset) const {
  const ErrorCapture capture;
  GDALClose(dataset);
}

void register_gdal_drivers() {
  static std::once_flag once;
  std::call_once(once, [] {
    const ErrorCapture capture;
    GDALAllRegister();
    // Lines are read once and in order. GDAL's own limit, a twentieth of the memory, would let a
    // wide raster fill gigabytes.
    constexpr GIntBig kCacheBytes = GIntBig{192} << 20;
    if (CPLGetConfigOption("GDAL_CACHEMAX", nullptr) == nullptr)
      GDALSetCacheMax64(std::min(GDALGetCacheMax64(), kCacheBytes));
  });
}

Result<DatasetPtr> open_raster(const std::filesystem::path& given) {
  std::error_code ignored;
  if (!std::filesystem::exists(given, ignored))
    return fail(kFileNotFound, fmt::format("{}: no such file", given.string()));
  const std::filesystem::path path = openable_path(given);
  register_gdal_drivers();
  MAQUETTE_TRY_VOID(check_pixels_complete(path));
  const ErrorCapture capture;
  // A list, so that no driver with surprises (web services, databases) has a say.
  static const char* const drivers[] = {"GTiff", "VRT",         "PDS",  "PDS4",
                                        "ISIS3", "JP2OpenJPEG", nullptr};
  DatasetPtr dataset(GDALDataset::Open(
      path.string().c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR, drivers));
  if (!dataset)
    return fail(
        kRasterNotReadable,
        fmt::format("{}: not a GeoTIFF, VRT, PDS3, PDS4, ISIS3 or JPEG 2000 raster that can be "
                    "read: {}",
                    given.string(), capture.text()));
  // A GeoTIFF cut short inside its tags opens with warnings, its pixels then being zero.
  if (capture.text().find("IO error") != std::string::npos)
    return fail(kRasterNotReadable,
                fmt::format("{}: truncated: {}", given.string(), capture.text()));
  if (dataset->GetRasterCount() < 1)
    return fail(kRasterNotReadable, fmt::format("{}: has no raster band", given.string()));
  return dataset;
}

}  // namespace maquette::heightmap::detail
