// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gdal_memory.hpp
/// Rasters in GDAL's memory on their way into a file, and what GDAL says when that fails.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <cpl_error.h>
#include <gdal.h>

#include "core/result.hpp"

namespace maquette::exporting::detail {

/// While it lives, GDAL's messages of this thread end here.
class GdalMessages {
 public:
  GdalMessages() { CPLPushErrorHandlerEx(&GdalMessages::take, this); }
  GdalMessages(const GdalMessages&) = delete;
  GdalMessages& operator=(const GdalMessages&) = delete;
  ~GdalMessages() { CPLPopErrorHandler(); }
  /// EXPORT_LIBRARY_FAILED
  [[nodiscard]] tl::unexpected<Error> failure(const std::filesystem::path& path) const;
  [[nodiscard]] bool failed() const { return failed_; }

 private:
  static void CPL_STDCALL take(CPLErr severity, CPLErrorNum, const char* message);
  std::string text_;
  bool failed_ = false;
};

struct GdalCloser {
  void operator()(void* dataset) const { GDALClose(dataset); }
};
using GdalDataset = std::unique_ptr<void, GdalCloser>;

/// In memory, not filled.
[[nodiscard]] GdalDataset gdal_memory(std::ptrdiff_t cols, std::ptrdiff_t rows, GDALDataType type,
                                      int bands = 1);
/// One line of a band (from 1).
[[nodiscard]] bool put_row(const GdalDataset& dataset, std::ptrdiff_t line, const void* row,
                           std::ptrdiff_t cols, GDALDataType type, int band = 1);

/// A picture of 8 bits as a PNG file in memory. EXPORT_LIBRARY_FAILED
/// @param bands  one after the other, each width * height from the upper left
[[nodiscard]] Result<std::vector<char>> png_bytes(std::ptrdiff_t width, std::ptrdiff_t height,
                                                  std::span<const std::vector<std::uint8_t>> bands);

}  // namespace maquette::exporting::detail
