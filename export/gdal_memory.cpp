// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/detail/gdal_memory.hpp"

#include <atomic>
#include <mutex>

#include <cpl_conv.h>
#include <cpl_vsi.h>
#include <fmt/format.h>

#include "export/cad.hpp"

namespace maquette::exporting::detail {

tl::unexpected<Error> GdalMessages::failure(const std::filesystem::path& path) const {
  return fail(kLibraryFailed, fmt::format("{}: GDAL: {}", path.string(),
                                          text_.empty() ? "no reason given" : text_));
}

void CPL_STDCALL GdalMessages::take(CPLErr severity, CPLErrorNum, const char* message) {
  auto* self = static_cast<GdalMessages*>(CPLGetErrorHandlerUserData());
  if (severity < CE_Warning || self->text_.size() > 500) return;
  self->failed_ |= severity >= CE_Failure;
  self->text_ += (self->text_.empty() ? "" : "; ") + std::string(message);
}

GdalDataset gdal_memory(std::ptrdiff_t cols, std::ptrdiff_t rows, GDALDataType type, int bands) {
  static std::once_flag once;
  std::call_once(once, [] { GDALAllRegister(); });
  return GdalDataset(GDALCreate(GDALGetDriverByName("MEM"), "", static_cast<int>(cols),
                                static_cast<int>(rows), bands, type, nullptr));
}

bool put_row(const GdalDataset& dataset, std::ptrdiff_t line, const void* row, std::ptrdiff_t cols,
             GDALDataType type, int band) {
  const int n = static_cast<int>(cols);
  return GDALRasterIO(GDALGetRasterBand(dataset.get(), band), GF_Write, 0, static_cast<int>(line),
                      n, 1, const_cast<void*>(row), n, 1, type, 0, 0) == CE_None;  // only reads it
}

Result<std::vector<char>> png_bytes(std::ptrdiff_t width, std::ptrdiff_t height,
                                    std::span<const std::vector<std::uint8_t>> bands) {
  static std::atomic<std::uint64_t> number{0};
  const std::string name = fmt::format("/vsimem/picture_{}.png", number++);
  const GdalMessages messages;
  const GdalDataset picture = gdal_memory(width, height, GDT_Byte, static_cast<int>(bands.size()));
  if (!picture) return messages.failure("a picture in memory");
  for (std::size_t b = 0; b < bands.size(); ++b)
    for (std::ptrdiff_t r = 0; r < height; ++r)
      if (!put_row(picture, r, bands[b].data() + r * width, width, GDT_Byte,
                   static_cast<int>(b) + 1))
        return messages.failure("a picture in memory");
  GDALDriverH driver = GDALGetDriverByName("PNG");
  if (driver == nullptr) return fail(kLibraryFailed, "GDAL has no driver PNG");
  GdalDataset copy(
      GDALCreateCopy(driver, name.c_str(), picture.get(), FALSE, nullptr, nullptr, nullptr));
  const bool made = copy != nullptr;
  copy.reset();  // the end is written now
  vsi_l_offset size = 0;
  GByte* bytes = VSIGetMemFileBuffer(name.c_str(), &size, TRUE);
  const std::unique_ptr<GByte, decltype(&VSIFree)> owner(bytes, &VSIFree);
  VSIUnlink((name + ".aux.xml").c_str());
  if (!made || messages.failed() || bytes == nullptr) return messages.failure("a PNG in memory");
  return std::vector<char>(bytes, bytes + size);
}

}  // namespace maquette::exporting::detail
