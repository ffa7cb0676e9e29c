// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file effect.hpp
/// The library of causes. One file per family in diagnosis/effects, one entry here.
///
/// A cause has one or more forms: laws that its physics may follow (a thermal time constant, a
/// moment at which a step was lost, a spray direction). A form is linear in its parameters: its
/// columns say how far an observation moves for one unit of each. What is not linear is a grid of
/// forms, refined around the best.

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/observation.hpp"

namespace maquette::diagnosis {

struct PhotoForm;  // photo_chain.hpp
struct PhotoScene;

struct Parameter {
  std::string name;         ///< with its unit: "width_mm"
  double per_column = 1.0;  ///< value of the parameter for a coefficient of 1
  double plausible = 1.0;   ///< largest absolute value a workshop would believe
  double least = -1e300;    ///< smallest value that there can be
};

/// Causes that answer to the whole motion do not add up: a drive that lags rounds off where lost
/// motion turns over.
struct Follows {
  bool lag = false;      ///< else lost motion
  int axis = 0;          ///< of lost motion
  double size_mm = 0.0;  ///< lag or width
};

/// Causes that take a mean over a width (a film that levels, a spot): what other causes move is
/// levelled with the surface.
struct Levels {
  double sigma_mm = 0.0;     ///< standard deviation of the Gaussian that is the mean's weight
  bool by_the_spot = false;  ///< the scanner's, of ranges and after the film; else of heights
};

/// Two coefficients between which passes are cut anew with a ball of that radius.
struct Secant {
  double from = 0.0, to = 1.0, ball_radius_mm = 3.0;
};

/// mm of residual for one unit of a coefficient.
struct Column {
  std::string key;  ///< columns of one key are the same column
  Parameter parameter;
  std::function<double(const Observation&)> value;
  /// Of causes that act through the cut: what one unit of the coefficient does to a pass, so that
  /// several together can be cut anew (recut_mm) where `value` is to first order. Empty: others.
  std::function<CutChange(const Observation&, const CutState&, Vec3 normal)> cut{};
  /// `cut` goes by the state alone, and may change along a pass. Others are the same within
  /// kBendReach_mm.
  bool by_program = false;
  /// `value` is the slope of that secant of `cut`.
  std::optional<Secant> secant{};
  /// Of poses and scanners, which move all passes alike: where to, for one unit of the coefficient.
  /// Beside causes that are cut anew the ridges between passes go along.
  std::function<Vec3(const Observation&)> moves{};
  std::optional<Follows> follows{};
  std::optional<Levels> levels{};
};

struct Form {
  std::string law;  ///< "time constant 3.2 min"
  std::vector<Column> columns;
  /// Values that the law fixes, reported beside the parameters.
  std::vector<std::pair<std::string, double>> fixed{};
  /// 1 or -1: only coefficients of that sign are physical (of the first columns); 0: any.
  int sign = 0;
  std::size_t signed_columns = 1;
  /// Neighbours of this form, closer than the grid's; empty: nothing to refine.
  std::function<std::vector<Form>()> finer{};
  /// Of a step at one moment: the form at another share of the program's time; empty: others.
  std::function<Form(double share)> at_moment{};
  /// Of steps, a column each: the form with one of the moments later by a share of the program;
  /// nullopt: that is too close to another, or beyond the program. Empty: others.
  std::function<std::optional<Form>(std::size_t which, double later)> move_moment{};
  /// Of waves: the form that lasts from one share of the program's time to another; empty: others.
  std::function<Form(double from, double to)> during{};
  /// Where a size hangs on what the law fixes (a growth on its time constant): the form with other
  /// values of that, even in its logarithm; the spread of sizes over them is part of the error.
  std::function<std::vector<Form>()> alternatives{};
  /// The size that the signature was made of, where it hangs on that; 0: it does not, or `follows`
  /// has it.
  double made_of_mm = 0.0;
  /// Of a lag that was made of another size before: which, and its coefficient then.
  struct Before {
    double size_mm, coefficient;
  };
  std::optional<Before> before{};
  /// The form made of another size.
  std::function<Form(double size_mm)> of_size{};
  /// The same with the tangent at that size for a signature; empty: none.
  std::function<Form(double size_mm)> at_size{};
};

enum class Needs { nothing, path, station, photograph, stones };

struct Effect {
  std::string name;     ///< as users write it: "machine.backlash_x"
  std::string says;     ///< what happened, one sentence
  std::string source;   ///< of physics and size
  std::string acts_on;  ///< link of the chain: commanded, machine, cutter, stock, coat, scanner
  std::string depends_on;
  std::vector<std::string> looks_like;
  std::string separate_by;  ///< the measurement that tells it from those
  std::string correction;   ///< what to change at the machine; empty: nothing
  /// Axes along which the cause shifts the whole part by an amount that depends on a zero nobody
  /// knows (that of a scale, of a warm-up): "z"; "r": each scan along its beam. Beside it, such a
  /// shift is no finding.
  std::string unknown_shift{};
  /// A cause that this one says with more or fewer terms: beside each other they would only patch
  /// up what a signature to first order is wrong by.
  std::string never_beside{};
  /// What its signature may be wrong by, as a share of what it moves, rms: another drive lags by
  /// another law, another film pools otherwise. What of that could be taken for a second cause gets
  /// no name. Least where the law leaves nothing open (a scale, a length).
  double signature_error = 0.09;
  Needs needs = Needs::nothing;
  std::function<std::vector<Form>(const Scene&)> forms;  ///< as scans and probes see it
  /// As photographs see it: numbers of the chain (photo_chain.hpp).
  std::function<std::vector<PhotoForm>(const PhotoScene&)> photo_forms;
};

/// All effects, in fixed order.
[[nodiscard]] const std::vector<Effect>& library();
/// nullptr if there is none.
[[nodiscard]] const Effect* find_effect(const std::string& name);

}  // namespace maquette::diagnosis
