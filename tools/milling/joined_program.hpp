// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file joined_program.hpp
/// One program of several operations, with tool changes between them. What the machine will read is
/// read back as a whole: each operation is timed and proven by its own lines of it.

#include <memory>

#include <nlohmann/json_fwd.hpp>

#include "cnc/machine_run.hpp"
#include "cnc/motion_time.hpp"
#include "cnc/path_certificate.hpp"
#include "tools/milling/mill_program.hpp"

namespace maquette::tools {

/// Where an operation begins in the files of a program, and what it is measured by.
struct Section {
  std::string name;
  int tool = 1;
  cnc::PathControl control{};  ///< where the program does not say
  double blending_mm = 0.0;
  cnc::ProgramPlace begin{};
  std::optional<Proof> proof;
};

struct SectionFigures {
  cnc::MotionTime time;
  std::optional<cnc::PathCertificate> proof;
  [[nodiscard]] double proven_mm() const { return proof ? proof->proven_mm : 0.0; }
};

/// Reads files of one program back; motions belong to the last section that began before them.
/// @param machine_run  of a program written for a machine with errors: the path that the machine
///                     makes of it is proven; or nullptr
/// @return one a section; the errors of read_gcode(), CNC_BEYOND_TRAVEL
[[nodiscard]] Result<std::vector<SectionFigures>> read_back(
    std::span<const std::filesystem::path> parts, std::span<const Section> sections,
    const cnc::Machine& machine, const RunContext& run, cnc::MachineRun* machine_run = nullptr);

/// The program as the machine of job.adjust must be called, from the one that is meant.
struct Adjusted {
  std::vector<std::filesystem::path> files;  ///< under the names that they will have
  std::vector<Section> sections;             ///< the same, where they begin now
  std::vector<SectionFigures> back;          ///< of the path that the machine makes
  double largest_mm = 0.0;                   ///< change of a coordinate
  std::string figures_json, unmet;
};
/// @param folder  that the files wait in
/// @return errors of read_back() and cnc::compensate()
[[nodiscard]] Result<Adjusted> adjusted(const MillJob& job,
                                        std::span<const std::filesystem::path> meant,
                                        std::span<const Section> sections,
                                        std::span<const cnc::Tool> tools,
                                        const std::filesystem::path& folder, const RunContext& run);

/// Rows of the table of times: one a section.
[[nodiscard]] nlohmann::json time_row(const std::string& program, const Section& section,
                                      const std::string& band, const cnc::MotionTime& time);

class JoinedProgram {
 public:
  /// @param first  post, name, work offset and splitting are its
  static Result<JoinedProgram> create(const MillJob& first, const std::filesystem::path& out);

  /// The next operation, from MillProgram: its tool, then its path, then what it is measured by.
  void begin(const MillJob& job, const cnc::Tool& tool, double spindle_rpm,
             const cnc::ProgramOptions& options);
  Result<void> add(const cnc::Toolpath& path) { return writer_.add(path); }
  void end(const std::optional<Proof>& proof);

  /// Puts the program in its place, or under .rejected. @param figures  of the operations, in order
  Result<JobResult> finish(const MillJob& first, nlohmann::json figures, const RunContext& run);

 private:
  JoinedProgram(std::filesystem::path out, Waiting waiting, cnc::ProgramWriter writer)
      : out_(std::move(out)), waiting_(std::move(waiting)), writer_(std::move(writer)) {}

  std::filesystem::path out_;
  Waiting waiting_;
  cnc::ProgramWriter writer_;
  std::vector<cnc::Tool> tools_;
  std::vector<Section> sections_;
  std::vector<std::unique_ptr<heightmap::ModelField>> surfaces_;  // of the proofs
};

}  // namespace maquette::tools
