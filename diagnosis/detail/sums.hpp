// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Normal equations of all candidate columns at once, split by scale and by set of blocks, so that
// any model (any choice of columns) costs a small solve.
//
// Scales. Squares of four sizes halve into each other (cell, cell / 2, / 4, / 8). What is summed at
// one scale is the scatter of the means of a square's quarters about the square's mean (Haar
// details), of points within the smallest squares at the finest. Details of different scales of
// correlated noise are nearly uncorrelated, and each scale has a variance of its own, which the
// residuals give: rough coats make the coarser ones larger.
//
// Set-ups. A rough coat is the same in all scans, so their details are not independent. Those of
// one square are turned (Helmert) into the mean over the set-ups, which has the part's roughness,
// and differences between set-ups, which have not; each kind has its own variance at each scale.
//
// The means of the cells have a dense covariance: white + a stationary process of heights (theta)
// less its best plane, one for means over the set-ups and one for differences between them. It may
// be rough within a cell and smooth over several (a coat on an uneven block); what is fitted by one
// length of the two lies between them, and the smooth part is a warp to what believes it. A
// process longer than a block is the same in neighbouring sets: where all sets are used at once,
// means over the set-ups have one covariance, not one for each set.
//
// Sets. Blocks of cells in plan are drawn by the seed for choosing, confirming, reporting;
// points within `buffer` of a border between blocks count for none.

#include <array>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include <Eigen/Dense>

#include "diagnosis/effect.hpp"
#include "diagnosis/observation.hpp"

namespace maquette::diagnosis::detail {

inline constexpr int kScales = 3;  // of details of squares
/// Details with a variance of their own: means over the set-ups by scale, differences between them
/// by scale, points within the smallest squares.
inline constexpr int kGroups = 2 * kScales + 1;
inline constexpr std::size_t kPointGroup = 2 * kScales;
/// Means of cells: over the set-ups, and differences between them.
inline constexpr std::size_t kTops = 2;
enum Set : int { kChoose = 0, kConfirm = 1, kReport = 2, kSets = 3 };
inline const std::vector<int> kAll{kChoose, kConfirm, kReport};
/// Which sets something holds for.
using OfSets = std::array<bool, kSets>;
[[nodiscard]] OfSets which_of(const std::vector<int>& sets);

/// Smooth noise of the cell means, relative to the white part.
struct Theta {
  bool gauss = false;  ///< else exponential correlation
  double length_mm = 0.0;
  double ratio = 0.0;  ///< variance over that of the white part of a mean cell; 0: white
  /// Share of the variance that a coat has: exponential correlation, shorter than a cell.
  double rough = 0.0;
  [[nodiscard]] double smooth_ratio() const { return (1.0 - rough) * ratio; }
};
/// Of one length each.
[[nodiscard]] std::vector<Theta> plain_thetas(double cell_mm);
/// These, and those that are rough and smooth at once.
[[nodiscard]] std::vector<Theta> thetas(double cell_mm);

/// What neighbouring cells tell of each other (points.hpp).
struct SmoothLaw {
  double length_mm = 0.0;  ///< of the Gaussian correlation; 0: nothing
  double nugget = 1.0;     ///< variance of a cell's mean that is its own, over that of the process
};

struct Bank;

struct Layout {
  SmoothLaw smooth;
  double x0 = 0.0, y0 = 0.0, cell_mm = 8.0;
  std::ptrdiff_t rows = 0, cols = 0, block = 4;  ///< cells; cells of a block's side
  double buffer_mm = 1.0;
  std::vector<int> set_of_block;
  std::ptrdiff_t block_cols = 0;
  /// -1: in a buffer.
  [[nodiscard]] int set_of(double x, double y) const;
  [[nodiscard]] int block_of(double x, double y) const;
  /// One number for each cell. @pre (x, y) on the part
  [[nodiscard]] std::ptrdiff_t cell_of(double x, double y) const;
};
/// @param in_bands  the program is in sections, which may meet in steps
[[nodiscard]] Layout lay_out(const Box3& box, std::uint64_t seed, bool in_bands = false);
/// The law of what is smooth over a cell and more in what the nuisances leave of the cells' means.
[[nodiscard]] SmoothLaw smooth_law(const Bank& bank, const Layout& layout);

struct TopSums {
  std::vector<double> weight;        ///< points that a mean (or difference) is worth
  std::vector<Vec3> centre;          ///< of the cell
  std::vector<double> rise;          ///< what a point higher by 1 adds: mean z of `along`
  std::vector<std::uint32_t> which;  ///< difference: between the first `which` set-ups and the next
  std::vector<Eigen::MatrixXd> gram;  ///< over the covariance, by theta; with room, as below
  std::vector<double> log_det;
  [[nodiscard]] double points() const;  ///< sum of the weights
};

struct SetSums {
  /// Products of the columns, the residual behind them: the upper left y() + 1; the rest is room.
  std::array<Eigen::MatrixXd, kGroups> gram;
  std::array<double, kGroups> count{};  ///< degrees of freedom
  std::array<TopSums, kTops> top;
};

/// The observations sorted into cells, and every column's details: what the sums are made of, kept
/// so that columns can be added and residuals exchanged.
struct Points;

/// Weight of each group of details, at most 1: details of roughness that is longer than a square
/// are not independent, so that a group of n is worth n weight.
using Weights = std::array<double, kGroups>;

struct Bank {
  Weights weight = [] {
    Weights w;
    w.fill(1.0);
    return w;
  }();
  std::vector<Column> columns;  ///< nuisances first
  std::unordered_map<std::string, int> index;
  int nuisances = 0;
  std::array<SetSums, kSets> sets;
  TopSums joint;  ///< means over the set-ups, of all sets; empty in a bank of one set
  std::vector<Theta> theta;
  /// Fits try the first so many. Plain ones come first: beside noise that may be rough and smooth
  /// at once two causes are seldom found one after the other.
  std::size_t tried = 0;
  std::shared_ptr<Points> points;
  [[nodiscard]] int y() const { return static_cast<int>(columns.size()); }
};

/// @param theta  nullptr: all; @param only  one set, or -1 for all
[[nodiscard]] Bank sum_up(const std::vector<Observation>& observations,
                          const std::vector<Column>& nuisances, const std::vector<Column>& columns,
                          const Layout& layout, const std::vector<Theta>* theta = nullptr,
                          int only = -1);

/// Those of `columns` that the bank has not yet. `observations` are those it was made of.
void add_columns(Bank& bank, const std::vector<Observation>& observations,
                 const std::vector<Column>& columns);
/// Other residuals in the same places, one for each observation.
/// @param columns  indices of those that are to be fitted to them (nullptr: all): to multiply all
///   with the residual costs as much as to cut anew. The others' sums are NaN until `answer`.
/// @param sets  whose residuals are exchanged; all sums of others with the residual are NaN then
void exchange_residuals(Bank& bank, const std::vector<double>& residual_mm,
                        const std::vector<int>* columns = nullptr,
                        const std::vector<int>& sets = kAll);
/// Which of the observations that a bank was made of are in one of its sets.
/// @param count  of all observations
[[nodiscard]] std::vector<char> those_in(const Bank& bank, Set set, std::size_t count);
/// Of columns that have none.
void answer(Bank& bank, const std::vector<int>& columns);
/// @return whether any had none
bool answer_all(Bank& bank);

/// What of a bank hangs on its residuals, to come back to them. Columns added since have no answer.
struct Answers {
  OfSets told{};
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> residual;
  std::vector<char> answered;
  std::vector<Eigen::VectorXd> products, white;
};
[[nodiscard]] Answers answers_of(Bank& bank);
void restore_answers(Bank& bank, const Answers& answers);

/// The sums of means that the likelihood of some of the sets has.
[[nodiscard]] std::vector<const TopSums*> tops_of(const Bank& bank, const std::vector<int>& sets,
                                                  std::size_t top);

/// A model fitted to some of the sets.
struct Fit {
  double objective = INFINITY;  ///< -2 log likelihood, up to a constant
  std::array<int, kTops> theta{};
  Eigen::VectorXd coefficients;  ///< in the order of the model's columns
  Eigen::MatrixXd covariance;
  std::array<double, kGroups> variance{};  ///< of one point, by group
  std::array<double, kTops> top_variance{};
};
/// Covariance of a fit's coefficients about those of the best one, over what law the unevenness
/// might have: averaged over the laws by restricted likelihood. Of a process as long as a third of
/// the part there are a dozen independent places, which leave its variance and length open by
/// half; the best law's covariance alone is too small by as much.
/// @param best  of the same sets
[[nodiscard]] Eigen::MatrixXd covariance_over_laws(const Bank& bank, const std::vector<int>& model,
                                                   const Fit& best, const std::vector<int>& sets);

/// What details are worth: the variance that scores (column times residual) would have were the
/// residuals of a fit independent, over the variance that they have, sums over cells and their
/// neighbours taken together (Conley, J. Econometrics 92 (1999),
/// doi:10.1016/S0304-4076(98)00084-0). Median over all columns that are no nuisances, so that a
/// cause not yet in the model counts little.
[[nodiscard]] Weights effective_weights(const Bank& bank, const std::vector<int>& model,
                                        const Fit& fit);

/// By how much a fit overstates what is known of one cause, as it was fitted: the variance that the
/// score of its signature (less what the others take of it) has in the details, sums over cells and
/// their neighbours taken together, over that which it would have were they independent; as a
/// factor of its whole variance, at least 1. Weights are of the median column: a curve over the
/// whole part that shows through the relief, by where the tip was, is worth less where unevenness
/// is as long as the relief.
/// @param without  the model's columns that are not the cause's; @param fit  of all sets
[[nodiscard]] double overstated(const Bank& bank, const std::vector<int>& model,
                                const std::vector<int>& without, const Fit& fit);

/// @param model  indices of columns
[[nodiscard]] Fit fit(const Bank& bank, const std::vector<int>& model,
                      const std::vector<int>& sets);
/// Of the plane that the fitted process of all means adds to where the part lies (covariances of
/// the means leave it to the poses): height, mm, and slopes along x and y.
[[nodiscard]] Eigen::Matrix3d plane_covariance(const Bank& bank, const Fit& fit, double cell_mm);
/// A column beside a fitted model, at the fit's noise.
struct Beside {
  Eigen::VectorXd absorbed;  ///< what of one unit the model's columns take
  double information = 0.0;  ///< on its coefficient, 1 / variance
  double estimate = 0.0;
};
[[nodiscard]] Beside beside(const Bank& bank, const std::vector<int>& model, const Fit& fit,
                            int column, const std::vector<int>& sets = kAll);

/// -2 log likelihood of sets with coefficients held except the nuisances (the first ones), noise
/// profiled.
[[nodiscard]] double objective_held(const Bank& bank, const std::vector<int>& model,
                                    const Eigen::VectorXd& coefficients, int free_columns,
                                    const std::vector<int>& sets);

}  // namespace maquette::diagnosis::detail
