// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/standing.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <unordered_map>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/chi_squared.hpp"
#include "diagnosis/detail/many_places.hpp"
#include "diagnosis/detail/remainder.hpp"
#include "diagnosis/detail/wrong_signatures.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// What the simulated surface is not believed below, mm rms: the ridges that a ball of 3 mm leaves
/// between passes of 0.5 mm have that, and who touches them with a ball or resamples them loses
/// them.
constexpr double kSimulationFloor_mm = 0.0031;
/// Of what is levelled over 0.5 mm the share that a grid of half a millimetre takes.
constexpr double kRidges = 0.5;
/// Squares that a cause which is not the largest, or is smooth, must explain, over those that
/// nothing explains.
constexpr double kBesideUnknown = 3.0;
/// A cause this far above what would drop it needs no cutting anew of the others to be sure.
constexpr double kClearly = 10.0;
/// Chance that a cause which hangs on odd places would gain as much without them.
constexpr double kWithoutOddPlaces = 1e-6;

struct Drop {
  std::size_t member;
  std::string why;
  bool may_be_there = false;
};

/// What the simulation is not believed below, mm rms, where so much of it may be wrong.
double floor_mm(double wrong_share, const Left& left) {
  return std::fmax(kSimulationFloor_mm, std::sqrt(wrong_share) * left.moved_mm);
}

/// Of what is levelled over the shortest length: the ridges that this program leaves, mm rms.
double ridges_mm(const std::vector<Observation>& all) {
  double squares = 0.0;
  std::size_t count = 0;
  for (const Observation& o : all) {
    if (!o.on_surface) continue;
    squares += std::pow(o.normal.z * static_cast<double>(o.levelled[0]), 2);
    ++count;
  }
  return std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, count)));
}

/// What it is not believed below beside the others, of each member. What levels also takes the
/// ridges, which whoever touches or resamples them loses: it has to explain more than them.
std::vector<double> floors_mm(const Members& members, const std::vector<double>& explained,
                              const Left& left, const Search& search, Bank& bank,
                              Linearised& residuals) {
  std::vector<double> floors;
  const auto above = [&](std::size_t k, double floor) {
    return explained[k] > left.points * floor * floor;
  };
  for (std::size_t k = 0; k < members.size(); ++k) {
    double floor = floor_mm(wrong_share(members, explained, k), left);
    if (!above(k, floor) && above(k, kSimulationFloor_mm))
      floor =
          floor_mm(wrong_share_like(k, members, explained, search, bank, residuals, kAll), left);
    if (members[k].form.columns[0].levels)
      floor = std::fmax(floor, kRidges * ridges_mm(search.observations));
    floors.push_back(floor);
  }
  return floors;
}

/// Squares that come back without each of the members, the others cut anew where it is close.
std::vector<double> explained_by(const Members& members, Linearised& residuals, const Left& left) {
  double worst = 0.0;
  for (const Member& m : members) worst = std::fmax(worst, m.effect->signature_error);
  const double floor = std::fmax(kSimulationFloor_mm, worst * left.moved_mm);
  std::vector<double> explained;
  for (std::size_t k = 0; k < members.size(); ++k) {
    const auto fewer = without(members, k);
    residuals.about(members);
    explained.push_back(residuals.left_by(fewer) - left.squares);
    if (explained[k] > kClearly * std::fmax(left.points * floor * floor, left.structured)) continue;
    residuals.about(fewer);
    explained[k] = residuals.left_by(fewer) - left.squares;
  }
  residuals.about(members);
  return explained;
}

/// Whether a cause moves the part up and down alike within each cell, as any unknown deformation of
/// a block would.
bool is_smooth(const Member& member, const std::vector<int>& model, const Bank& bank, const Fit& f,
               const Search& search) {
  constexpr double kWithin = 0.15;  // of the variance: a bend leans, and moves slopes sideways
  constexpr double kSteepest = 0.2;
  std::vector<double> moved(search.observations.size(), 0.0);
  for (const Column& c : member.form.columns) {
    const double size = f.coefficients(place_of(bank, model, c));
    const auto value = at_many_places(c, search.observations);
    oneapi::tbb::parallel_for(std::size_t{0}, moved.size(), [&](std::size_t i) {
      moved[i] += size * value(search.observations[i]);
    });
  }
  struct Sums {
    double n = 0.0, sum = 0.0, squares = 0.0;
    void add(double v) {
      n += 1.0;
      sum += v;
      squares += v * v;
    }
    [[nodiscard]] double scatter() const { return squares - sum * sum / std::fmax(1.0, n); }
  };
  const Layout& layout = search.layout;
  std::unordered_map<std::ptrdiff_t, Sums> cells;
  Sums all;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const Observation& o = search.observations[i];
    const double up = moved[i] / std::fmax(kSteepest, o.normal.z);
    all.add(up);
    cells[layout.cell_of(o.place.x, o.place.y)].add(up);
  }
  double within = 0.0;
  for (const auto& [at, cell] : cells) within += cell.scatter();
  return within < kWithin * all.scatter();
}

/// The weakest of those that explain too little.
/// @param is_vague  whether the k-th looks like any unknown deformation
std::optional<Drop> too_small(const std::vector<double>& explained,
                              const std::vector<double>& floors, const Left& left,
                              bool beside_unknown,
                              const std::function<bool(std::size_t)>& is_vague) {
  std::optional<Drop> drop;
  for (std::size_t k = 0; k < explained.size(); ++k) {
    if (drop && explained[k] >= explained[drop->member]) continue;
    const double floor = floors[k];
    // Beside something unknown only the largest is taken for what it looks like, and of what it may
    // look like itself none: a block of which one half had sagged was bent by a cause that
    // explained two thirds of it.
    const bool largest = explained[k] >= *std::max_element(explained.begin(), explained.end());
    if (!(explained[k] > left.points * floor * floor))
      drop = {k,
              fmt::format("smaller than what the simulation itself may be wrong by ({:.4f} mm rms)",
                          floor),
              true};
    else if (beside_unknown && explained[k] < kBesideUnknown * left.structured &&
             (!largest || explained[k] < left.structured || is_vague(k)))
      drop = {k, "explains less than what remains unexplained beside it"};
  }
  return drop;
}

/// The last that gains nothing once the odd squares are left out.
std::optional<Drop> hangs_on(const Squares& odd, const Members& members, const Search& search) {
  std::vector<Observation> kept;
  for (const Observation& o : search.observations)
    if (!odd.holds(o.place.x, o.place.y)) kept.push_back(o);
  std::vector<Column> columns;
  for (const Member& c : members)
    columns.insert(columns.end(), c.form.columns.begin(), c.form.columns.end());
  const Bank masked = sum_up(kept, search.nuisances, columns, search.layout);
  const auto at = columns_of(masked, members);
  const double full = fit(masked, at, kAll).objective;
  std::optional<Drop> drop;
  for (std::size_t k = 0; k < members.size(); ++k) {
    const auto small = columns_of(masked, without(members, k));
    const double gain = fit(masked, small, kAll).objective - full;
    if (chi_squared_tail(gain, std::max(1, static_cast<int>(at.size() - small.size()))) >
        kWithoutOddPlaces)
      drop = {k, "hangs on a few odd places"};
  }
  return drop;
}

}  // namespace

Members members_of(const std::vector<Confirmed>& confirmed) {
  Members all;
  for (const Confirmed& c : confirmed) all.push_back(c.member);
  return all;
}

Left left_of(const Linearised& residuals, const Members& members, double null_squares,
             const Remainder& remainder) {
  Left l;
  l.squares = residuals.left_by(members, &l.points);
  l.moved_mm = std::sqrt(std::fmax(0.0, null_squares - l.squares) / l.points);
  if (remainder.found)
    l.structured = l.points * remainder.structured_rms * remainder.structured_rms;
  l.excess = std::fmax(1e-300, null_squares - l.squares + l.structured);
  return l;
}

Members keep_what_stands(const Search& search, Bank& bank, Linearised& residuals,
                         double null_squares, std::vector<Confirmed>& confirmed, Diagnosis& d) {
  Squares odd;
  Members doubtful;
  while (true) {
    const Members members = members_of(confirmed);
    residuals.about(members);
    const Fit f = residuals.fit_of(members);
    const auto r = residuals_of(search.observations, members, bank, f);
    d.remainder = judge(search.observations, r, search.layout, bank, f, odd);
    Left left = left_of(residuals, members, null_squares, d.remainder);
    const auto explained = explained_by(members, residuals, left);
    if (d.remainder.structured_rms <
        floor_mm(wrong_share(members, explained, members.size()), left)) {
      d.remainder.found = false;
      left = left_of(residuals, members, null_squares, d.remainder);
    }
    d.remainder.share = left.structured / left.excess;
    const auto floors = floors_mm(members, explained, left, search, bank, residuals);
    auto drop = too_small(explained, floors, left, d.remainder.found, [&](std::size_t k) {
      return is_smooth(members[k], columns_of(bank, members), bank, f, search);
    });
    if (!drop && d.remainder.found && odd.count() > 0 && !members.empty())
      drop = hangs_on(odd, members, search);
    if (!drop) return doubtful;
    if (drop->may_be_there) doubtful.push_back(members[drop->member]);
    d.rejected.push_back({members[drop->member].effect->name, drop->why});
    confirmed.erase(confirmed.begin() + static_cast<std::ptrdiff_t>(drop->member));
  }
}

}  // namespace maquette::diagnosis::detail
