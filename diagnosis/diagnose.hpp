// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file diagnose.hpp
/// What the simulation gets wrong, and why.
///
/// Room    diagnosis:  case -> measure -> [diagnose] -> report
/// Takes   observations of scans and probed points (case_input.hpp), the library of causes
/// Gives   named causes with parameters, what cannot be told apart, what remains unexplained
///
/// Method
/// - Every model has the six directions of each set-up's pose and the difference between cut
///   and designed surface as free nuisances.
/// - Noise is what the residuals say, scale by scale (detail/sums.hpp); at the largest scale a
///   stationary process, of the part or of each set-up, whose size and length are refitted in each
///   model (restricted likelihood, on a grid); smaller scales are blind to it (detail/points.hpp).
///   A cause must beat that process.
/// - A place is made by the pass whose ball touches it; by the one just above (MadeBy), as of a
/// much
///   finer cutter, where the case says so, or causes that hang on the program explain far more of
///   the choosing blocks so.
/// - Signatures are of one cause alone and to first order. Causes that act through the cut are cut
///   anew together, at their estimated sizes, and what that moves beyond the sum of their
///   signatures is taken off the residuals before the next round (Gauss and Newton with a fixed
///   Jacobian).
/// - Choosing: beam search over combinations on one third of the blocks, backward steps included;
///   the best is cut anew there, its moments and lengths refined, what is not missed dropped; and
///   again from nothing with the residuals that this leaves, until the causes stay.
/// - Confirming: each cause must earn its place on another third, with all others refitted, at a
///   level that shares 1 % over all tests that can be made; what was fitted on the first third
///   must predict the second; and it must be as good evidence with what all blocks share. Where
///   none does, the next best are chosen without them, twice at most, at a level that leaves 1 %.
/// - Naming: other causes that do as well in its place (likelihood ratio below 100, less than 1 %
///   of its gain, or fits that differ by less than the simulation itself may be wrong by) are its
///   equivalents.
/// - What remains is tested against a stationary Gaussian process: lonely places, edges, lines and
///   rings of the spectrum. If it fails, the rest is unexplained, and causes that explain less
///   than what is left, or that hang on the odd places, are not named.
/// Cost: two scans of 300 000 points in 15 CPU s without a cause, 20 to 50 with one (70 of lost
/// motion), 80 to 110 with two or three; 4 GB.

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "core/grid.hpp"
#include "diagnosis/case_input.hpp"
#include "diagnosis/effect.hpp"

namespace maquette::diagnosis {

/// Level of all claims of a case together.
inline constexpr double kFamilyLevel = 0.01;
/// Of one claim: as many tests can be made as there are causes in the largest model, in each of its
/// rounds.
inline constexpr double kClaimLevel = kFamilyLevel / 20.0;

struct Estimate {
  std::string name;
  double value = 0.0, sigma = 0.0;
};

struct Cause {
  std::string effect, law;
  std::vector<Estimate> parameters;
  std::vector<std::pair<std::string, double>> fixed;
  double share = 0.0;    ///< of the excess variance
  double p_value = 1.0;  ///< on the confirming blocks
  std::vector<std::string> equivalent;
  std::string separate_by;
  /// As extended.toml has them, where parameters are not what the law takes; empty: they are.
  std::vector<std::pair<std::string, double>> raw{};
};

/// The cause as a model has it that knows it.
[[nodiscard]] KnownCause as_known(const Cause& cause);

struct Rejected {
  std::string effect, why;
};

struct Ranked {
  std::string effect, law;
  double gain = 0.0;  ///< in -2 log likelihood, alone, on the choosing blocks
};

struct PoseEstimate {
  std::string set_up;
  Vec3 shift_mm, turn_urad;  ///< of its file, to fit the model; about the points' centre
  Vec3 shift_sigma_mm, turn_sigma_urad;
};

struct Map {
  double x0_mm = 0.0, y0_mm = 0.0, cell_mm = 1.0;
  Grid<float> before, after;
};

struct Dependence {  ///< mean residual by classes of a covariate
  std::string covariate;
  std::vector<double> at, before, after, sigma;
};

struct Remainder {
  bool found = false;
  /// "lonely places", "edges", "a wave", "rings"; or "what several causes look like"
  std::vector<std::string> kinds;
  double share = 0.0;  ///< of the excess variance
  double structured_rms = 0.0;
  double morans_i = 0.0, p_white = 1.0;
  double smooth_mm = 0.0, smooth_length_mm = 0.0;  ///< of the generic process
};

/// What the fit says of the noise: variances as of one point, mm^2.
struct FittedNoise {
  double cell_mm = 1.0;                        ///< largest squares
  double point_mm2 = 0.0;                      ///< within the smallest squares
  std::array<double, 3> common_mm2{};          ///< details shared by all set-ups, coarse to fine
  std::array<double, 3> own_mm2{};             ///< of differences between set-ups
  struct Top {                                 ///< means of cells
    double white_mm2 = 0.0;                    ///< as of one point
    double smooth_mm2 = 0.0, length_mm = 1.0;  ///< of a stationary process
    bool gauss = true;                         ///< its correlation; else exponential
  };
  Top common, own;
};

/// controls.hpp
struct Controls {
  std::size_t points = 0;
  std::string null_verdict;
  std::vector<std::string> null_claims;  ///< must be empty
  struct Recovery {
    std::string effect;    ///< as injected
    std::string named_as;  ///< itself, an equivalent that was named in its place; empty: missed
    struct Size {
      std::string parameter;
      double injected = 0.0, found = 0.0, sigma = 0.0;
    };
    std::vector<Size> sizes;  ///< where it came back by its own name and law
  };
  std::vector<Recovery> recoveries;
  std::vector<std::string> false_claims;  ///< beside them
  /// The null is consistent, all causes are back and no other.
  [[nodiscard]] bool passed() const;
};

/// What was seen of the stones, where the case has a plan of them.
struct StoneReport {
  std::vector<std::pair<int, std::string>> states;  ///< number; as of scan::name_of
  std::vector<std::string> unexplained;
  /// Of ranges about the stones, mm; where a cause of theirs was named: fitted to every second
  /// patch of the points, measured on the others.
  double rms_before = 0.0, rms_after = 0.0, rms_noise = 0.0;
  std::size_t points = 0;
};

struct Diagnosis {
  std::string unit = "mm";  ///< of rms, map, dependences and what remains; photographs: "/ 255"
  std::string verdict = "consistent";
  /// Scans were read anew for it (Measurements::settled_anew): what goes on with it reads them so.
  bool beside_long_beams = false;
  MadeBy contact = MadeBy::ball;  ///< as the case says, or as the data say: of what is found
  std::vector<Cause> causes;
  std::vector<Rejected> rejected;
  std::vector<Ranked> ranking;
  std::vector<std::string> untestable;
  std::vector<PoseEstimate> poses;
  Remainder remainder;
  double rms_before = 0.0, rms_after = 0.0, rms_noise = 0.0;
  std::size_t n_report = 0;
  /// Photographs that had no part in the choice: mean absolute difference of the part's pixels from
  /// what the simulation expected, /255 of the numbers in the file.
  struct HeldOut {
    std::string image;
    double before = 0.0, after = 0.0;
    double noise = 0.0;  ///< what noise alone would give
  };
  std::vector<HeldOut> held_out;
  Map map;
  std::vector<Dependence> dependences;
  std::vector<std::string> notes;
  FittedNoise noise;
  std::optional<Controls> controls;
  std::optional<StoneReport> stones;
};

[[nodiscard]] Result<Diagnosis> diagnose(Measurements measurements, std::uint64_t seed,
                                         const RunContext& run = {});

/// Law of causes that residuals do not show.
inline constexpr const char* kPoseLaw = "seen in the poses of the measurements only";

/// diagnosis.json, schema maquette.diagnosis/1.
[[nodiscard]] std::string to_json(const Diagnosis& diagnosis);
/// Tables [[cause]] to be added to a case file: what the simulation is extended by.
[[nodiscard]] std::string extension_toml(const Diagnosis& diagnosis);
/// The page: one file, nothing from outside.
[[nodiscard]] std::string to_html(const Diagnosis& diagnosis);

}  // namespace maquette::diagnosis
