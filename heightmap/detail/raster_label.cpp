// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/raster_label.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <fstream>
#include <system_error>

#include <cpl_minixml.h>
#include <fmt/format.h>
#include <gdal.h>

#include "heightmap/detail/gdal_support.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::heightmap::detail {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kLongestLabel = 1 << 20;

std::string upper(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return out;
}

std::string trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos) return {};
  return std::string(text.substr(first, text.find_last_not_of(" \t\r\n") - first + 1));
}

std::string without_comments(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    if (text[i] == '"') {
      const auto close = text.find('"', i + 1);
      const auto end = close == std::string_view::npos ? text.size() : close + 1;
      out.append(text.substr(i, end - i));
      i = end;
    } else if (text.substr(i, 2) == "/*") {
      const auto close = text.find("*/", i + 2);
      i = close == std::string_view::npos ? text.size() : close + 2;
    } else {
      out.push_back(text[i++]);
    }
  }
  return out;
}

/// Length of the value that starts `text`: a quoted string or a bracketed list may span lines.
std::size_t value_length(std::string_view text) {
  if (text.empty()) return 0;
  const char open = text.front();
  const char close = open == '"' ? '"' : open == '(' ? ')' : open == '{' ? '}' : '\n';
  const auto end = text.find(close, 1);
  if (end == std::string_view::npos) return text.size();
  return close == '\n' ? end : end + 1;
}

std::vector<std::pair<std::string, std::string>> statements_of(std::string_view raw) {
  const std::string text = without_comments(raw);
  std::vector<std::pair<std::string, std::string>> out;
  std::vector<std::string> inside;
  std::size_t at = 0;
  while (at < text.size()) {
    const auto line_end = std::min(text.find('\n', at), text.size());
    const auto equals = text.find('=', at);
    if (equals > line_end) {  // also npos
      const std::string word = upper(trimmed(std::string_view(text).substr(at, line_end - at)));
      if (word == "END") break;
      if ((word == "END_OBJECT" || word == "END_GROUP") && !inside.empty()) inside.pop_back();
      at = line_end + 1;
      continue;
    }
    const std::string key = upper(trimmed(std::string_view(text).substr(at, equals - at)));
    auto start = equals + 1;
    while (start < text.size() && (text[start] == ' ' || text[start] == '\t')) ++start;
    const auto length = value_length(std::string_view(text).substr(start));
    std::string value = trimmed(std::string_view(text).substr(start, length));
    if (value.size() >= 2 && value.front() == '"' && value.back() == '"')
      value = trimmed(std::string(value, 1, value.size() - 2));
    at = start + length;
    if (key == "OBJECT" || key == "GROUP") {
      inside.push_back(upper(value));
    } else if (key == "END_OBJECT" || key == "END_GROUP") {
      if (!inside.empty()) inside.pop_back();
    } else {
      std::string path;
      for (const auto& part : inside) path.append(part).push_back('/');
      path.append(key);
      out.emplace_back(std::move(path), std::move(value));
    }
  }
  return out;
}

/// The file `name` beside `label`, in whatever case the disk has it.
fs::path sibling(const fs::path& label, const std::string& name) {
  const fs::path wanted = label.parent_path() / name;
  std::error_code ignored;
  if (fs::exists(wanted, ignored)) return wanted;
  const fs::path folder = label.parent_path().empty() ? fs::path(".") : label.parent_path();
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (upper(entry.path().filename().string()) == upper(name)) return entry.path();
  return wanted;
}

Result<void> check_size(const fs::path& label, const fs::path& image, double bytes_needed) {
  std::error_code error;
  const auto size = fs::file_size(image, error);
  if (error)
    return fail(kRasterNotReadable,
                fmt::format("{}: its pixels should be in {}, which is not there ({}); copy the "
                            "image beside its label",
                            label.string(), image.string(), error.message()));
  if (static_cast<double>(size) < bytes_needed)
    return fail(kRasterNotReadable,
                fmt::format("{}: truncated: {} has {} bytes, its label demands {:.0f}; fetch the "
                            "file again",
                            label.string(), image.string(), size, bytes_needed));
  return {};
}

Result<void> check_pds3(const fs::path& path, const RasterLabel& label) {
  for (const auto& [key, value] : label.statements)
    if (key.rfind("COMPRESSED_FILE/", 0) == 0) return {};  // JPEG 2000: GDAL notices itself
  const auto pointer = label.find("^IMAGE");
  if (!pointer) return {};
  const double record_bytes = label.number("RECORD_BYTES").value_or(0.0);
  // n, n <BYTES>, "file", ("file", n), ("file", n <BYTES>)
  std::string rest = *pointer;
  fs::path image = path;
  rest.erase(std::remove_if(rest.begin(), rest.end(), [](char c) { return c == '(' || c == ')'; }),
             rest.end());
  const auto comma = rest.find(',');
  std::string place = trimmed(rest.substr(comma == std::string::npos ? 0 : comma + 1));
  const bool names_file =
      comma != std::string::npos ||
      (!place.empty() && std::isdigit(static_cast<unsigned char>(place.front())) == 0) ||
      place.find('.') != std::string::npos;
  if (names_file) {
    std::string name = trimmed(rest.substr(0, comma));
    name.erase(std::remove(name.begin(), name.end(), '"'), name.end());
    image = sibling(path, name);
    if (comma == std::string::npos) place.clear();
  }
  double first = 1.0;
  std::from_chars(place.data(), place.data() + place.size(), first);
  const double unit = place.find("BYTES") != std::string::npos ? 1.0 : record_bytes;
  const auto lines = label.number("IMAGE/LINES");
  const auto samples = label.number("IMAGE/LINE_SAMPLES");
  const auto bits = label.number("IMAGE/SAMPLE_BITS");
  if (!lines || !samples || !bits) return check_size(path, image, 0.0);
  const double line_bytes = *samples * *bits / 8.0 * label.number("IMAGE/BANDS").value_or(1.0) +
                            label.number("IMAGE/LINE_PREFIX_BYTES").value_or(0.0) +
                            label.number("IMAGE/LINE_SUFFIX_BYTES").value_or(0.0);
  return check_size(path, image, (first - 1.0) * unit + *lines * line_bytes);
}

Result<void> check_isis3(const fs::path& path, const RasterLabel& label) {
  const auto format = upper(label.find("CORE/FORMAT").value_or(""));
  if (format != "TILE" && format != "BANDSEQUENTIAL") return {};
  fs::path image = path;
  if (const auto core = label.find("CORE/^CORE")) image = sibling(path, *core);
  const auto type = upper(label.find("PIXELS/TYPE").value_or("REAL"));
  const double bytes = type == "UNSIGNEDBYTE"                                        ? 1.0
                       : type == "REAL" || type.find("INTEGER") != std::string::npos ? 4.0
                       : type == "DOUBLE"                                            ? 8.0
                                                                                     : 2.0;
  double samples = label.number("DIMENSIONS/SAMPLES").value_or(0.0);
  double lines = label.number("DIMENSIONS/LINES").value_or(0.0);
  if (format == "TILE") {
    const double tile_samples = label.number("CORE/TILESAMPLES").value_or(1.0);
    const double tile_lines = label.number("CORE/TILELINES").value_or(1.0);
    samples = std::ceil(samples / tile_samples) * tile_samples;
    lines = std::ceil(lines / tile_lines) * tile_lines;
  }
  return check_size(path, image,
                    label.number("CORE/STARTBYTE").value_or(1.0) - 1.0 +
                        samples * lines * bytes * label.number("DIMENSIONS/BANDS").value_or(1.0));
}

/// Largest file offset that a raw VRT band reads, plus one.
double raw_band_bytes(const CPLXMLNode* band, double cols, double rows) {
  const auto type = GDALGetDataTypeByName(CPLGetXMLValue(band, "dataType", "Byte"));
  const double bytes = GDALGetDataTypeSizeBytes(type);
  const double pixel = CPLAtof(CPLGetXMLValue(band, "PixelOffset", "0"));
  const double pixel_step = pixel != 0.0 ? pixel : bytes;
  const double line = CPLAtof(CPLGetXMLValue(band, "LineOffset", "0"));
  const double line_step = line != 0.0 ? line : pixel_step * cols;
  return CPLAtof(CPLGetXMLValue(band, "ImageOffset", "0")) +
         std::max(0.0, pixel_step * (cols - 1.0)) + std::max(0.0, line_step * (rows - 1.0)) + bytes;
}

Result<void> check_vrt(const fs::path& path, int depth);

Result<void> check_any(const fs::path& path, int depth) {
  if (const auto label = read_raster_label(path)) {
    if (label->kind == RasterLabel::Kind::pds3) return check_pds3(path, *label);
    if (label->kind == RasterLabel::Kind::isis3) return check_isis3(path, *label);
    const Pds4Image image = pds4_image(*label);
    return check_size(path, sibling(path, image.file), image.bytes);
  }
  if (upper(path.extension().string()) == ".VRT" && depth < 8) return check_vrt(path, depth);
  return {};
}

Result<void> check_source(const fs::path& vrt, const CPLXMLNode* source, const CPLXMLNode* band,
                          double cols, double rows, int depth) {
  const char* name = CPLGetXMLValue(source, "SourceFilename", nullptr);
  if (name == nullptr || *name == '\0') return {};
  const CPLXMLNode* node = CPLGetXMLNode(const_cast<CPLXMLNode*>(source), "SourceFilename");
  const bool relative =
      std::string_view(CPLGetXMLValue(node, "relativeToVRT", "0")) == std::string_view("1");
  const fs::path file = relative ? vrt.parent_path() / name : fs::path(name);
  if (file.string().rfind("/vsi", 0) == 0) return {};
  const bool raw = source == band;
  MAQUETTE_TRY_VOID(check_size(vrt, file, raw ? raw_band_bytes(band, cols, rows) : 0.0));
  return raw ? Result<void>{} : check_any(file, depth + 1);
}

Result<void> check_vrt(const fs::path& path, int depth) {
  const ErrorCapture capture;
  CPLXMLNode* const root = CPLParseXMLFile(path.string().c_str());
  if (root == nullptr) return {};  // GDAL says why when it opens the file
  struct Guard {
    CPLXMLNode* node;
    ~Guard() { CPLDestroyXMLNode(node); }
  } const guard{root};
  const CPLXMLNode* vrt = CPLGetXMLNode(root, "=VRTDataset");
  if (vrt == nullptr) return {};
  const double cols = CPLAtof(CPLGetXMLValue(vrt, "rasterXSize", "0"));
  const double rows = CPLAtof(CPLGetXMLValue(vrt, "rasterYSize", "0"));
  for (const CPLXMLNode* band = vrt->psChild; band != nullptr; band = band->psNext) {
    if (band->eType != CXT_Element || std::string_view(band->pszValue) != "VRTRasterBand") continue;
    MAQUETTE_TRY_VOID(check_source(path, band, band, cols, rows, depth));
    for (const CPLXMLNode* s = band->psChild; s != nullptr; s = s->psNext)
      if (s->eType == CXT_Element && std::string_view(s->pszValue) != "SourceFilename")
        MAQUETTE_TRY_VOID(check_source(path, s, band, cols, rows, depth));
  }
  return {};
}

}  // namespace

std::optional<std::string> RasterLabel::find(std::string_view tail) const {
  for (const auto& [key, value] : statements) {
    if (key.size() < tail.size() || key.compare(key.size() - tail.size(), tail.size(), tail) != 0)
      continue;
    if (key.size() == tail.size() || key[key.size() - tail.size() - 1] == '/') return value;
  }
  return std::nullopt;
}

std::optional<double> RasterLabel::number(std::string_view tail) const {
  const auto value = find(tail);
  if (!value) return std::nullopt;
  double number = 0.0;
  const auto [end, error] = std::from_chars(value->data(), value->data() + value->size(), number);
  if (error != std::errc{}) return std::nullopt;
  return number;
}

std::optional<RasterLabel> read_raster_label(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text(kLongestLabel, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  const std::string_view head = std::string_view(text).substr(0, 4096);
  if (head.rfind("<?xml", 0) == 0 || head.find("<Product_Observational") != std::string_view::npos)
    return parse_pds4_label(text);
  RasterLabel label;
  if (head.find("PDS_VERSION_ID") != std::string_view::npos &&
      head.find("PDS3") != std::string_view::npos)
    label.kind = RasterLabel::Kind::pds3;
  else if (head.find("IsisCube") != std::string_view::npos)
    label.kind = RasterLabel::Kind::isis3;
  else
    return std::nullopt;
  label.statements = statements_of(text);
  return label;
}

fs::path openable_path(const fs::path& path) {
  if (upper(path.extension().string()) != ".IMG" || read_raster_label(path)) return path;
  for (const char* extension : {".LBL", ".lbl", ".xml", ".XML", ".lblx"}) {
    const fs::path label = fs::path(path).replace_extension(extension);
    std::error_code ignored;
    if (fs::exists(label, ignored) && read_raster_label(label)) return label;
  }
  return path;
}

Result<void> check_pixels_complete(const fs::path& path) {
  return check_any(path, 0);
}

}  // namespace maquette::heightmap::detail
