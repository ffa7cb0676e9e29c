// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/pdf_file.hpp"

#include <memory>

#include <cairo-pdf.h>

#include "core/check.hpp"
#include "core/files.hpp"

namespace maquette::exporting {
namespace {

cairo_status_t append_bytes(void* to, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(to)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

}  // namespace

Result<void> write_pdf_file(const std::filesystem::path& out, const std::string& title,
                            double width_pt, double height_pt,
                            const std::function<void(cairo_t*)>& draw) {
  std::string bytes;
  const auto drop = [](cairo_surface_t* surface) { cairo_surface_destroy(surface); };
  const std::unique_ptr<cairo_surface_t, decltype(drop)> surface(
      cairo_pdf_surface_create_for_stream(append_bytes, &bytes, width_pt, height_pt), drop);
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_TITLE, title.c_str());
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_CREATE_DATE, "");
  cairo_t* cairo = cairo_create(surface.get());
  draw(cairo);
  cairo_destroy(cairo);
  cairo_surface_finish(surface.get());
  MAQUETTE_CHECK(cairo_surface_status(surface.get()) == CAIRO_STATUS_SUCCESS, "cairo: {}",
                 cairo_status_to_string(cairo_surface_status(surface.get())));
  return write_file(out, bytes);
}

}  // namespace maquette::exporting
