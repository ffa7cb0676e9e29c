// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/view_files.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

namespace maquette::tools {
namespace fs = std::filesystem;

std::optional<fs::path> file_below(const fs::path& root, std::string_view path) {
  if (path.empty() || path.find('\0') != std::string_view::npos) return std::nullopt;
  const fs::path asked(path);
  if (asked.is_absolute()) return std::nullopt;
  for (const fs::path& part : asked)
    if (part.empty() || part.native().front() == '.') return std::nullopt;
  std::error_code ec;
  fs::path file = fs::canonical(root / asked, ec);
  if (ec || !fs::is_regular_file(file, ec)) return std::nullopt;
  const auto [end, at] = std::mismatch(root.begin(), root.end(), file.begin(), file.end());
  if (end != root.end()) return std::nullopt;
  return file;
}

const char* mime_type(const fs::path& file) {
  using Row = std::pair<std::string_view, const char*>;
  static constexpr std::array<Row, 24> kTypes{{
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".mjs", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".json", "application/json"},
      {".wasm", "application/wasm"},
      {".glb", "model/gltf-binary"},
      {".gltf", "model/gltf+json"},
      {".png", "image/png"},
      {".svg", "image/svg+xml"},
      {".pdf", "application/pdf"},
      {".tif", "image/tiff"},
      {".exr", "image/x-exr"},
      {".stl", "model/stl"},
      {".obj", "model/obj"},
      {".3mf", "model/3mf"},
      {".step", "model/step"},
      {".ply", "application/octet-stream"},
      {".toml", "text/plain; charset=utf-8"},
      {".txt", "text/plain; charset=utf-8"},
      {".csv", "text/csv; charset=utf-8"},
      {".ngc", "text/plain; charset=utf-8"},
      {".nc", "text/plain; charset=utf-8"},
      {".subtree", "application/octet-stream"},
  }};
  const std::string extension = file.extension().string();
  const auto* row = std::find_if(kTypes.begin(), kTypes.end(),
                                 [&](const Row& r) { return r.first == extension; });
  return row == kTypes.end() ? "application/octet-stream" : row->second;
}

}  // namespace maquette::tools
