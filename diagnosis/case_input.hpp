// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file case_input.hpp
/// What was designed, run and measured -> observations.
///
/// Registration. Each set-up's pose is first settled on the simulated surface (robust
/// point-to-plane), only so that the linear model holds; the six directions stay free in every
/// model that is fitted later.

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "diagnosis/observation.hpp"
#include "diagnosis/stones_seen.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis {

inline constexpr ErrorCode kOtherPart{"DIAGNOSIS_OTHER_PART"};
inline constexpr ErrorCode kOtherProgram{"DIAGNOSIS_OTHER_PROGRAM"};
inline constexpr ErrorCode kTooFewMeasurements{"DIAGNOSIS_TOO_FEW_MEASUREMENTS"};
inline constexpr ErrorCode kProbeTable{"DIAGNOSIS_PROBE_TABLE"};
inline constexpr ErrorCode kUnknownCause{"DIAGNOSIS_UNKNOWN_CAUSE"};

/// Least number of measurements on the part, and of blocks (of 36) that hold some.
inline constexpr std::size_t kLeastMeasurements = 60;
inline constexpr std::size_t kLeastBlocks = 9;

struct ScanInput {
  std::filesystem::path points;
  std::optional<Vec3> station_mm;
  double range_sigma_mm = 0.05;
  double beam_mm = 0.0;  ///< width at the part; 0: a ray
};

/// A cause that the model has already (extended.toml): taken off the residuals.
struct KnownCause {
  std::string effect, law;
  std::vector<std::pair<std::string, double>> parameters, fixed;
};

/// A mesh that stands on the part or beside it while photographs are taken, such as a spacecraft.
struct Body {
  std::filesystem::path mesh;
  RigidTransform model_from_mesh;
  double scale = 1.0;  ///< of the mesh, before it is moved
};

/// Which pass made a place: that whose ball touches it, or the one just above, as of a cutter that
/// is much finer than the ball that was declared. Causes that hang on direction, order or time of
/// the cut are another pattern then.
enum class MadeBy { unknown, ball, tip };

struct CaseInput {
  std::filesystem::path design;
  /// The design without the stones that are glued on after milling; empty: there are none. What is
  /// measured on and beside stones, or photographed in their shadows, says nothing of the ground.
  std::filesystem::path ground;
  std::filesystem::path stones;  ///< their plan: they are judged, too
  /// What photographs show of them and of their shadows says nothing of the part. Scans are without
  /// them.
  std::vector<Body> bodies;
  std::vector<std::filesystem::path> programs;
  double ball_diameter_mm = 6.0;
  MadeBy contact = MadeBy::unknown;
  double coat_mm = 0.0, coat_sigma_mm = 0.04, coat_correlation_mm = 0.25;
  double reach_mm = 2.0;
  std::vector<ScanInput> scans;
  std::vector<std::filesystem::path> probes;
  std::vector<KnownCause> known;
  std::uint64_t seed = 1;
  std::size_t most_points = 400'000;  ///< of all set-ups together, drawn at random
  /// Scans are settled on the design beside range errors that grow with obliqueness, where points
  /// lie much closer to it then.
  bool beside_long_beams = false;
};

struct SetUp {
  std::string name;
  bool scan = true;
  RigidTransform model_from_file;  ///< where the linear model starts
  Vec3 centre_mm;                  ///< of its points: poses turn about it
  std::size_t points = 0, used = 0, far = 0;
};

struct Measurements {
  Scene scene;
  MadeBy contact = MadeBy::unknown;  ///< of the observations: unknown as ball
  std::vector<SetUp> set_ups;
  std::vector<Observation> observations;
  std::vector<std::string> notes;  ///< what could not be used and why
  bool strays_gather = false;  ///< of a scan many points of one place are far from the rest there
  std::shared_ptr<const StonesSeen> stones;  ///< null: the case has none, or no plan of them
  bool beside_long_beams = false;            ///< a scan was settled so
  /// The same with CaseInput::beside_long_beams; null: no scan has a station. Beams that read a
  /// millimetre long push a scan that far aside: read there, slopes are those of other places.
  std::function<Result<Measurements>(const RunContext&)> settled_anew;
};

/// The design without its stones; none where the case names none.
/// @return DIAGNOSIS_OTHER_PART: another number of nodes; errors of the reader
[[nodiscard]] Result<std::optional<heightmap::ModelField>> read_ground(
    const CaseInput& input, const heightmap::ModelField& design);
/// What stands higher than that over it is a stone.
inline constexpr double kStone_mm = 1e-3;

/// About which the poses of the set-ups turn.
[[nodiscard]] std::vector<Vec3> centres_of(const Measurements& measurements);

/// From here on each place is what the pass above it made (MadeBy::tip).
void cut_by_tips(Measurements& measurements);
/// The same of one observation. @return whether a pass is near enough
bool cut_by_tip(Observation& observation, const Scene& scene);

/// Takes what known causes move off the residuals. @return DIAGNOSIS_UNKNOWN_CAUSE
[[nodiscard]] Result<void> take_off(const std::vector<KnownCause>& known,
                                    Measurements& measurements);

/// @return the observations, or
///   DIAGNOSIS_OTHER_PROGRAM          the program does not cut the design
///   DIAGNOSIS_OTHER_PART             the points do not follow the design
///   DIAGNOSIS_TOO_FEW_MEASUREMENTS   with the number needed; also: all in a few blocks
///   DIAGNOSIS_UNKNOWN_CAUSE          a [[cause]] that the library has not
///   DIAGNOSIS_PROBE_TABLE            file, line and what was expected
///   errors of the readers; SCAN_UNIT_SLIP
[[nodiscard]] Result<Measurements> measure(const CaseInput& input, const RunContext& run = {});

}  // namespace maquette::diagnosis
