// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gdal_support.hpp
/// What every user of GDAL in this room needs: drivers registered once, messages
/// caught instead of printed, files opened with a Result.

#include <filesystem>
#include <memory>
#include <string>

#include <gdal_priv.h>

#include "core/result.hpp"

namespace maquette::heightmap::detail {

/// While it lives, GDAL's messages of this thread end here, not on the terminal.
class ErrorCapture {
 public:
  ErrorCapture();
  ErrorCapture(const ErrorCapture&) = delete;
  ErrorCapture& operator=(const ErrorCapture&) = delete;
  ~ErrorCapture();
  /// What GDAL complained about, "; " between; "no reason given" if it kept silent.
  [[nodiscard]] std::string text() const;
  [[nodiscard]] bool failed() const { return failed_; }

 private:
  static void CPL_STDCALL handle(CPLErr severity, CPLErrorNum number, const char* message);
  std::string text_;
  bool failed_ = false;
};

struct DatasetCloser {
  void operator()(GDALDataset* dataset) const;
};
using DatasetPtr = std::unique_ptr<GDALDataset, DatasetCloser>;

/// Thread-safe, cheap after the first call.
void register_gdal_drivers();

/// Opens a GeoTIFF, VRT, PDS3, PDS4, ISIS3 or JPEG 2000 raster for reading, after checking that it
/// is there and that its pixels are complete.
/// @return CORE_FILE_NOT_FOUND or HEIGHTMAP_RASTER_NOT_READABLE
[[nodiscard]] Result<DatasetPtr> open_raster(const std::filesystem::path& path);

}  // namespace maquette::heightmap::detail
