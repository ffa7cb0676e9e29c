// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/source_files.hpp"

#include <algorithm>

#include "heightmap/detail/gdal_support.hpp"

namespace maquette::heightmap {

Result<std::vector<std::filesystem::path>> source_files(const std::filesystem::path& path) {
  MAQUETTE_TRY(const auto dataset, detail::open_raster(path));
  std::vector<std::filesystem::path> files{path};
  const detail::ErrorCapture capture;
  char** list = dataset->GetFileList();
  for (char** f = list; f != nullptr && *f != nullptr; ++f)
    // GDAL's own statistics are no part of the product, and may appear at any time.
    if (const std::filesystem::path file = *f;
        !file.string().ends_with(".aux.xml") && std::filesystem::is_regular_file(file))
      files.push_back(file);
  CSLDestroy(list);
  std::sort(files.begin(), files.end());
  files.erase(std::unique(files.begin(), files.end()), files.end());
  return files;
}

}  // namespace maquette::heightmap
