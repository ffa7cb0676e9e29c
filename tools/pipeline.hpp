// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pipeline.hpp
/// Work that is done once. A unit is the smallest piece that can be run alone: one
/// band, one station, one file. Its key is a hash of its name, its parameters and
/// its input files' content; a record beside the results says which key they
/// belong to. So a second run does nothing, a changed parameter redoes what depends
/// on it, and a killed run goes on where it was.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/console.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kDirectoryBusy{"TOOLS_DIRECTORY_BUSY", ErrorKind::environment};
inline constexpr ErrorCode kShardRange{"TOOLS_SHARD_RANGE"};
inline constexpr ErrorCode kInputMissing{"TOOLS_INPUT_MISSING"};

/// What a piece of work leaves behind.
struct JobResult {
  std::vector<std::filesystem::path> outputs;
  std::string figures_json = "{}";  ///< for the manifest
  std::string note;                 ///< for people, one short line
  std::string unmet;                ///< a bound that the user asked for and that does not hold
  /// Those of `outputs` that are programs as they were meant, where others are called for the
  /// machine (MillJob::adjust).
  std::vector<std::filesystem::path> meant{};
};

struct Unit {
  std::string name;  ///< unique, a file name: "s1000.mill.band_01"
  std::vector<std::filesystem::path> inputs;
  std::string parameters_json;
  std::function<Result<JobResult>(const RunContext&)> work;
};

/// Units that may be run in any order and on different machines.
struct Stage {
  std::string name;  ///< "s1000.mill"
  std::vector<Unit> units;
};

struct OutputRecord {
  std::string path;  ///< relative to the run's folder
  std::string sha256;
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;
};

struct UnitRecord {
  std::string name, key, figures_json, note, unmet, parameters_json;
  std::vector<OutputRecord> inputs, outputs;
  double wall_s = 0.0, cpu_s = 0.0, peak_mib = 0.0;
  bool reused = false;  ///< found up to date in this run
};

/// Which part of each stage to do: unit i of a stage is done if i % count == index.
struct Shard {
  std::uint64_t index = 0, count = 1;
};
/// "2/4" -> index 1 of 4. TOOLS_SHARD_RANGE.
[[nodiscard]] Result<Shard> parse_shard(const std::string& text);

class Pipeline {
 public:
  /// Takes the folder's lock: exclusive, or shared for shards. TOOLS_DIRECTORY_BUSY
  /// names who holds it; CORE_FILE_NOT_WRITABLE.
  [[nodiscard]] static Result<Pipeline> open(const std::filesystem::path& folder, bool shared,
                                             Console& console);
  Pipeline(Pipeline&&) noexcept;
  ~Pipeline();

  /// Runs the units of the stage that belong to the shard and are not up to date.
  /// TOOLS_INPUT_MISSING if an input is not there (an earlier stage has not been run).
  [[nodiscard]] Result<void> run(const Stage& stage, Shard shard = {});

  /// Records of all units that were run or found up to date, in order.
  [[nodiscard]] const std::vector<UnitRecord>& records() const { return records_; }

 private:
  Pipeline(std::filesystem::path folder, int lock, Console& console);
  [[nodiscard]] Result<OutputRecord> fingerprint(const std::filesystem::path& path);
  [[nodiscard]] bool up_to_date(const UnitRecord& record) const;

  std::filesystem::path folder_;
  int lock_ = -1;
  Console* console_;
  std::vector<UnitRecord> records_;
  std::map<std::string, OutputRecord> known_;  ///< by path; valid while size and time agree
};

}  // namespace maquette::tools
