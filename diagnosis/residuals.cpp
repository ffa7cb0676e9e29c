// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/residuals.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <ranges>

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/levelled_changes.hpp"
#include "diagnosis/detail/many_places.hpp"
#include "diagnosis/detail/squares.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// A part that is moved sideways by more has other passes there than those that are known
/// (kRivalHeight_mm): it is moved without its ridges.
constexpr double kFar_mm = 0.5;

/// Ridges between passes that a scanner or a coat has smoothed away are nowhere else when the part
/// moves: of what moving them did, the share stays that the data show of them where they would be
/// now, and of the rest what a surface without them does.
/// @param left_mm  measured less all signatures, with ridges where they were
/// @param smooth_mm  what a surface without ridges moves beyond its signatures; NaN: passes do not
///   move alike there
void take_ridges_by_their_share(const std::vector<Observation>& all,
                                const std::function<double(std::size_t)>& left_mm,
                                const std::vector<char>* wanted,
                                const std::vector<float>& smooth_mm, std::vector<double>& beyond) {
  double seen = 0.0, there = 0.0, known = 0.0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if ((wanted != nullptr && (*wanted)[i] == 0) || std::isnan(smooth_mm[i])) continue;
    const double ridge = all[i].milled_minus_design_mm, smooth = static_cast<double>(smooth_mm[i]),
                 now = ridge + beyond[i] - smooth;
    seen += now * (left_mm(i) + ridge - smooth);
    there += now * now;
    known += ridge * ridge;
  }
  if (!(there > 0.0) || !(known > 0.0)) return;
  const double share = std::clamp(seen / there, 0.0, 1.0);
  for (std::size_t i = 0; i < all.size(); ++i)
    if (!std::isnan(smooth_mm[i]))
      beyond[i] = share * beyond[i] + (1.0 - share) * static_cast<double>(smooth_mm[i]);
}

}  // namespace

std::vector<double> beyond_linear(const std::vector<Observation>& all,
                                  std::span<const double> measured_mm,
                                  const std::vector<Member>& members, const Bank& bank,
                                  const Eigen::VectorXd& coefficients, double ball_radius_mm,
                                  bool has_ridges, Signatures& known, LagAndSlack& both,
                                  const std::vector<char>* wanted) {
  struct Term {
    const Column& column;
    double coefficient;
    const std::vector<float>* signature;
    [[nodiscard]] double at(std::size_t i) const {
      return coefficient * static_cast<double>((*signature)[i]);
    }
  };
  const auto model = columns_of(bank, members);
  const auto column = [&](std::size_t k) -> const Column& {
    return bank.columns[static_cast<std::size_t>(model[k])];
  };
  bool levels = false;
  for (std::size_t k = 0; k < model.size(); ++k) levels |= column(k).levels.has_value();
  // What is levelled is the mean of places around.
  const auto is_wanted = [&](std::size_t i) {
    return wanted == nullptr || levels || (*wanted)[i] != 0;
  };
  const bool anew = std::any_of(members.begin(), members.end(), [&](const Member& m) {
    return std::any_of(m.form.columns.begin(), m.form.columns.end(),
                       [&](const Column& c) { return c.cut || (has_ridges && c.moves); });
  });
  // A film takes ridges off by itself.
  const bool by_their_share = anew && !levels && has_ridges && !measured_mm.empty();
  // Of causes that act through the cut, of what moves the part with its ridges, of those that
  // level, and of all others.
  std::vector<Term> cut, moving, levelling, others;
  for (std::size_t k = 0; k < model.size(); ++k) {
    const Column& c = column(k);
    const bool nuisance = static_cast<int>(k) < bank.nuisances, moves = anew && c.moves;
    if (c.key == kMilledMinusDesign) continue;
    if (!moves && !by_their_share && (nuisance || !(c.cut || levels))) continue;
    std::vector<float>& signature = known[c.key];
    signature.resize(all.size(), NAN);
    const auto is_asked_for = [&](std::size_t i) {
      return is_wanted(i) && std::isnan(signature[i]);
    };
    if (const auto numbers = std::views::iota(std::size_t{0}, all.size());
        std::ranges::any_of(numbers, is_asked_for)) {
      const auto value = at_many_places(c, all);
      oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
        if (is_asked_for(i)) signature[i] = static_cast<float>(value(all[i]));
      });
    }
    const Term term{c, coefficients(static_cast<Eigen::Index>(k)), &signature};
    if (moves) moving.push_back(term);
    if (c.cut)
      cut.push_back(term);
    else if (c.levels)
      levelling.push_back(term);
    else if (levels ? !nuisance : !moves)
      others.push_back(term);
  }
  std::vector<double> beyond(all.size(), 0.0), change(levels ? all.size() : 0, 0.0);
  std::vector<float> without_ridges(by_their_share ? all.size() : 0, NAN);  // mm
  std::vector<FollowedTerm> followed;
  for (const Term& t : cut)
    if (t.column.follows) followed.push_back({*t.column.follows, t.coefficient});
  const auto pairs = both.changes(followed);
  const auto sum_of = [&](bool by_program, const Observation& o, const CutState& s, Vec3 n) {
    CutChange sum;
    for (const Term& t : cut)
      if (t.column.by_program == by_program) sum += t.coefficient * t.column.cut(o, s, n);
    if (by_program)
      for (const auto& pair : pairs) sum += pair(s);
    return sum;
  };
  // All passes alike.
  const auto moved_of = [&](const Observation& o) {
    CutChange moved;
    for (const Term& t : moving) moved.tip_mm += t.coefficient * t.column.moves(o);
    return moved;
  };
  // What follows the program bends passes, and so do waves; what is far from its place is swept as
  // it is. The same states are met from many places then.
  constexpr std::size_t kEvery = 61;  // a look at so few shows whether any do for a while
  bool bends = !followed.empty();
  for (std::size_t i = 0; i < all.size() && !bends && !cut.empty(); i += kEvery) {
    CutChange c = sum_of(true, all[i], all[i], {});
    bends = c.curves(ball_radius_mm);
    c += sum_of(false, all[i], all[i], all[i].normal);
    c += moved_of(all[i]);
    bends |= is_far(c);
  }
  const Pass* const pass = bends ? pass_of(all) : nullptr;
  Displacements off;
  if (pass != nullptr)
    off = displacements(*pass,
                        [&](const CutState& s) { return sum_of(true, all.front(), s, {}).tip_mm; });
  if (anew)
    oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
      if (!is_wanted(i)) return;
      const Observation& o = all[i];
      double& d = beyond[i];
      CutChange moved = moved_of(o);
      const bool far = std::hypot(moved.tip_mm.x, moved.tip_mm.y) > kFar_mm;
      if (far) moved = {};
      const auto all_of_it = [&](const CutState& s, Vec3 n) {
        CutChange together = moved;
        together += sum_of(false, o, s, n);
        together += sum_of(true, o, s, n);
        return together;
      };
      const auto bent = [&](const PassBeside& p, double x, double y, double radius_mm) {
        const CutChange more = sum_of(false, o, p.state, p.normal);
        return pass->height_mm(
            p.state, x, y, radius_mm, off,
            moved.tip_mm + more.tip_mm + towards_place(p.normal, ball_radius_mm, more.runout_mm));
      };
      std::optional<Vec3> shift;
      d = pass != nullptr ? recut_mm(o, ball_radius_mm, all_of_it, bent, &shift)
                          : recut_mm(o, ball_radius_mm, all_of_it, &shift);
      for (const Term& t : moving)
        if (!far) d -= t.at(i);
      double of_cut = 0.0;
      for (const Term& t : cut) of_cut += t.at(i);
      d -= of_cut;
      if (levels) change[i] = d + of_cut;
      if (shift && !without_ridges.empty())
        without_ridges[i] = static_cast<float>(o.normal.z * second_order_rise_mm(o, *shift));
    });
  if (by_their_share) {
    const auto left = [&](std::size_t i) {
      double sum = measured_mm[i];
      for (const auto* terms : {&cut, &moving, &others})
        for (const Term& t : *terms) sum -= t.at(i);
      return sum;
    };
    take_ridges_by_their_share(all, left, wanted, without_ridges, beyond);
  }
  if (!levels) return beyond;
  oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    for (const Term& t : others) change[i] += t.at(i);
  });
  std::vector<LevellingTerm> means;
  for (const Term& t : levelling)
    means.push_back({*t.column.levels, t.coefficient, [&t](std::size_t i) { return t.at(i); }});
  add_levelled(all, std::move(change), means, beyond);
  return beyond;
}

std::vector<double> residuals_of(const std::vector<Observation>& all,
                                 const std::vector<Member>& members, const Bank& bank,
                                 const Fit& f) {
  const auto model = columns_of(bank, members);
  const Eigen::VectorXd b = levelled(bank, model, f.coefficients, kAll);
  std::vector<double> r(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) r[i] = all[i].residual_mm;
  for (std::size_t k = 0; k < model.size(); ++k) {
    const auto value = at_many_places(bank.columns[static_cast<std::size_t>(model[k])], all);
    oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
      r[i] -= b(static_cast<Eigen::Index>(k)) * value(all[i]);
    });
  }
  return r;
}

}  // namespace maquette::diagnosis::detail
