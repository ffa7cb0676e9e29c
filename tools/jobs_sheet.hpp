// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_sheet.hpp
/// What `sheet` does: many pictures small on one, with captions.

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct SheetJob {
  std::vector<std::filesystem::path> pictures;
  std::vector<std::string> captions{};  ///< as many as pictures; empty: names of the files
  int columns = 0;                      ///< 0: about as many as rows
  int width_px = 320;                   ///< of each picture on the sheet
  double exposure = 1.0;                ///< factor on the light of linear (EXR) pictures
};

/// A PNG of the pictures row by row, in the order given, each shrunk to `width_px` by the mean of
/// the light in what a pixel covers (whole-number files are taken as sRGB), with its caption
/// under it. Pictures need not be of one size: a row is as high as its highest.
/// What read_image returns; CAMERA_IMAGE_FORMAT: a sheet beyond 2^28 pixels; CORE_CANCELLED.
/// @pre at least one picture; no captions or as many; width_px > 0
[[nodiscard]] Result<JobResult> sheet_job(const SheetJob& job, const std::filesystem::path& out,
                                          const RunContext& run);

}  // namespace maquette::tools
