// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file merge_files.hpp
/// Scans in files, of any size, become one cloud that is read in batches and never held as a whole.
///
/// Poses    by merge.hpp, from an even random share of the points where there are more than
///          `most_points` together: the scans with most points are halved until they fit, so that
///          small scans keep all of theirs.
/// Memory   30 bytes a point of the share, twice that while it is read; a batch afterwards. Four
///          files of 50 M points: 2.3 GiB at most, with the merged file written.
/// Cost     The files are read once for the poses and once more by each reader.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "scan/cloud_stream.hpp"
#include "scan/merge.hpp"

namespace maquette::scan {

/// One station with points.
struct FileScan {
  std::string name;          ///< the file's, and the station's where there are several
  std::size_t file = 0;      ///< of those that were given
  std::size_t station = 0;   ///< of the file
  std::uint64_t points = 0;  ///< with position
  std::uint64_t used = 0;    ///< of them, for the poses
};

struct MergedFiles {
  std::vector<std::filesystem::path> files;
  std::vector<FileScan> scans;  ///< in the order of files and stations
  CloudFields fields;           ///< those that every scan has
  Merge merge;                  ///< a pose for each scan
};

/// Reads the files once and merges their scans.
/// @return errors of reading; SCAN_CLOUD_EMPTY: a file has no points; those of merge_scans
[[nodiscard]] Result<MergedFiles> merge_files(std::span<const std::filesystem::path> files,
                                              const MergeOptions& options = {},
                                              const RunContext& run = {},
                                              std::uint64_t most_points = 24'000'000);

/// All scans one after the other, each a station with its corrected pose and position, colours
/// balanced (65535 at most), points without position and fields that only some have left out.
/// @pre `merged` outlives the reader
[[nodiscard]] Result<std::unique_ptr<CloudReader>> open_merged(const MergedFiles& merged);

/// Every point of a reader into a file, stations kept.
[[nodiscard]] Result<void> copy_cloud(const OpenCloud& from, const std::filesystem::path& to,
                                      const RunContext& run = {});

}  // namespace maquette::scan
