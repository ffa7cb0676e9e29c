// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cctype>
#include <memory>

#include <cpl_minixml.h>

#include "heightmap/detail/gdal_support.hpp"
#include "heightmap/detail/raster_label.hpp"

namespace maquette::heightmap::detail {
namespace {

std::string key_of(std::string_view element) {
  std::string key(element.substr(element.find(':') + 1));  // npos + 1 is 0
  std::transform(key.begin(), key.end(), key.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return key;
}

void collect(const CPLXMLNode* node, const std::string& inside, RasterLabel& label) {
  for (; node != nullptr; node = node->psNext) {
    if (node->eType != CXT_Element) continue;
    const std::string key = inside + key_of(node->pszValue);
    for (const CPLXMLNode* child = node->psChild; child != nullptr; child = child->psNext)
      if (child->eType == CXT_Text) label.statements.emplace_back(key, child->pszValue);
    collect(node->psChild, key + "/", label);
  }
}

/// Of the PDS4 data types: "SignedMSB2", "IEEE754LSBDouble", "UnsignedByte".
double bytes_of(std::string_view type) {
  if (type.find("Double") != std::string_view::npos) return 8.0;
  if (type.find("Single") != std::string_view::npos) return 4.0;
  const char last = type.empty() ? '1' : type.back();
  return std::isdigit(static_cast<unsigned char>(last)) != 0 ? last - '0' : 1.0;
}

}  // namespace

std::optional<RasterLabel> parse_pds4_label(const std::string& text) {
  const ErrorCapture capture;
  const std::unique_ptr<CPLXMLNode, void (*)(CPLXMLNode*)> root(
      CPLParseXMLString(text.c_str()), [](CPLXMLNode* n) { CPLDestroyXMLNode(n); });
  if (!root) return std::nullopt;
  RasterLabel label;
  label.kind = RasterLabel::Kind::pds4;
  collect(root.get(), "", label);
  if (label.statements.empty() || !label.find("FILE/FILE_NAME")) return std::nullopt;
  return label;
}

Pds4Image pds4_image(const RasterLabel& label) {
  Pds4Image image{label.find("FILE/FILE_NAME").value_or(""), 0.0};
  for (const char* array : {"ARRAY_3D_IMAGE", "ARRAY_2D_IMAGE", "ARRAY_2D_MAP", "ARRAY_2D"}) {
    const std::string inside = std::string(array) + "/";
    const auto offset = label.number(inside + "OFFSET");
    if (!offset) continue;
    double pixels = 1.0;
    for (const auto& [key, value] : label.statements)
      if (key.ends_with("/" + inside + "AXIS_ARRAY/ELEMENTS")) pixels *= std::stod(value);
    image.bytes =
        *offset + pixels * bytes_of(label.find(inside + "ELEMENT_ARRAY/DATA_TYPE").value_or(""));
    break;
  }
  return image;
}

}  // namespace maquette::heightmap::detail
