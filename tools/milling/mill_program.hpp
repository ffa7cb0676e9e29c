// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mill_program.hpp
/// What all strategies share: from pieces of path to a program in its place, read back, timed,
/// and proven where it has a proof. Used by the strategies in this folder only.

#include <nlohmann/json_fwd.hpp>

#include "cnc/engrave.hpp"
#include "cnc/path_certificate.hpp"
#include "cnc/path_figures.hpp"
#include "cnc/program.hpp"
#include "cnc/stock_depth.hpp"
#include "heightmap/height_field.hpp"
#include "tools/milling.hpp"
#include "tools/sphere_file.hpp"

namespace maquette::tools {

/// What a ball's path is measured against: `lowered_mm` below the program, it cuts no deeper than
/// `limit_mm` below the surface (path_certificate.hpp).
struct Proof {
  const heightmap::ModelField& surface;
  double ball_radius_mm = 3.0;
  double limit_mm = 0.005;
  double lowered_mm = 0.0;
};

/// Where a program waits until it may have its name. What is left in it when it goes is nobody's.
class Waiting {
 public:
  static Result<Waiting> beside(const std::filesystem::path& out);
  Waiting(Waiting&& other) noexcept : folder_(std::exchange(other.folder_, {})) {}
  Waiting& operator=(Waiting&&) = delete;
  ~Waiting();
  [[nodiscard]] std::filesystem::path file(const std::filesystem::path& out) const {
    return folder_ / out.filename();
  }

 private:
  Waiting() = default;
  std::filesystem::path folder_;
};

/// What a strategy mills: a surface, of a band with what the cutter feels beside it.
struct Piece {
  heightmap::ModelField design;
  std::optional<heightmap::ModelField> stock;
  double first_y_mm = NAN, last_y_mm = NAN;  ///< of a band's passes; NaN: the whole surface
  double top_mm = 0.0;                       ///< of design and stock
  double table_mm = 0.0;                     ///< that the block lies on
  /// How deep the cutter stands in the stock: at most `deepest_mm`, and along a move as `depth`
  /// says.
  double deepest_mm = 0.0;
  std::optional<cnc::StockDepth> depth;
};
/// @param margin_mm  beside the band
[[nodiscard]] Result<Piece> piece_of(const MillJob& job, double margin_mm);

/// Moves the parts beside `out`, as they are called or with `ending` behind it.
[[nodiscard]] Result<std::vector<std::filesystem::path>> put_in_place(
    const std::vector<std::filesystem::path>& parts, const std::filesystem::path& out,
    const std::string& ending);

/// At most ten.
[[nodiscard]] nlohmann::json places_of(const cnc::PathCertificate& proof);

/// What a program of that blending tells the control.
[[nodiscard]] cnc::PathControl control_of(const std::string& post, Millimetres blending);

/// Why a program is rejected: it meets stones that stand, with the first place and line. Empty
/// where it does not, or none stand. @param parts  of the program, in the folder it waits in
[[nodiscard]] Result<std::string> meets_stones(const MillJob& job,
                                               std::span<const std::filesystem::path> parts,
                                               std::span<const cnc::Tool> tools,
                                               const RunContext& run);

void warn_of_blocks(double highest_blocks_per_s, double waiting_s, const cnc::Machine& machine,
                    const std::filesystem::path& program, const RunContext& run);

/// Feeds and spindle as asked for, or as they are where nothing is asked for; they are within what
/// the machine can do. Feeds of moves are set when the program is written.
[[nodiscard]] Result<MillJob> with_feeds(const MillJob& job);

class MillProgram {
 public:
  /// @param top_mm    of all that stands; rapids between operations clear it
  /// @param blending  that the control may add to the path's deviation
  /// @return CNC_TOOL_TOO_LONG if the tool does not clear the work; the errors of program.hpp
  static Result<MillProgram> begin(const MillJob& job, const Piece& piece,
                                   const std::filesystem::path& out, double top_mm,
                                   Millimetres blending, std::vector<std::string> comments);

  /// The next piece of the path.
  Result<void> add(const cnc::Toolpath& piece);
  [[nodiscard]] cnc::ProgramWriter& writer() { return writer_; }
  [[nodiscard]] const cnc::PathFigures& figures() const { return figures_; }

  /// @param figures  of the strategy; those of the program are added
  Result<JobResult> finish(const std::optional<Proof>& proof, nlohmann::json figures,
                           const RunContext& run);
  /// Of a program whose way depends on what only the machine knows: a probe's.
  Result<JobResult> finish_unread(nlohmann::json figures);

 private:
  MillProgram(const MillJob& job, const Piece& piece, std::filesystem::path out, Waiting waiting,
              cnc::ProgramWriter writer, double blending_mm, cnc::SpindleSpeed spindle)
      : job_(job),
        piece_(piece),
        spindle_(spindle),
        out_(std::move(out)),
        waiting_(std::move(waiting)),
        writer_(std::move(writer)),
        blending_mm_(blending_mm) {}

  Result<void> set_feeds(cnc::Toolpath& path);

  const MillJob& job_;
  const Piece& piece_;
  cnc::SpindleSpeed spindle_;
  cnc::FeedReport feeds_;
  std::filesystem::path out_;
  Waiting waiting_;
  cnc::ProgramWriter writer_;
  double blending_mm_;
  cnc::PathFigures figures_;
};

/// What seats and outlines are made for. @return CNC_ENGRAVE_OPTION_OUT_OF_RANGE, errors of the
/// stones' file
[[nodiscard]] Result<std::vector<cnc::Seat>> seats_of(const MillJob& job,
                                                      const heightmap::ModelField& design);

/// Those of a job's file. @return TOOLS_CONFIG_INVALID without one, errors of sphere_file.hpp
[[nodiscard]] Result<std::vector<ReferenceSphere>> spheres_of(const MillJob& job);

/// <program>.<what>.tif
[[nodiscard]] std::filesystem::path beside(const std::filesystem::path& program,
                                           const std::string& what);

// The strategies, mill_finish.cpp, mill_rough.cpp, mill_rest.cpp, mill_probe.cpp, mill_spheres.cpp.
Result<JobResult> raster_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> semi_finish_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> waterline_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> geodesic_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> rough_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> rest_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> seats_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> outlines_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> probe_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> sphere_seats_job(const MillJob&, const std::filesystem::path&, const RunContext&);
Result<JobResult> probe_spheres_job(const MillJob&, const std::filesystem::path&,
                                    const RunContext&);

}  // namespace maquette::tools
