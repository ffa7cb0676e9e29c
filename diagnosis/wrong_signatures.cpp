// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/wrong_signatures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/chi_squared.hpp"
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/squares.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Of a signature's error the part that follows neither place nor slope, as a share of its square.
constexpr double kElsewhere = 0.1;
/// What signatures are wrong by at most where the law leaves nothing open.
constexpr double kExact = 0.03;
/// By what a signature may be off: over the part from -1 to 1, slopes of 0.3 as 1.
constexpr int kWays = 9, kWaysAndHeights = 11;
std::array<double, kWaysAndHeights> ways(const Observation& o, const Box3& box) {
  constexpr double kSlope = 0.3;
  const auto within = [](double at, double from, double to) {
    return 2.0 * (at - from) / std::fmax(1e-9, to - from) - 1.0;
  };
  const double x = within(o.place.x, box.min.x, box.max.x),
               y = within(o.place.y, box.min.y, box.max.y),
               z = within(o.place.z, box.min.z, box.max.z), u = o.slope_normal.x / kSlope,
               v = o.slope_normal.y / kSlope;
  return {x, y, x * x, x * y, y * y, u, v, u * u, v * v, z, z * z};
}

Box3 box_of(const std::vector<Observation>& all) {
  Box3 box;
  for (const Observation& o : all) box.add(o.place);
  return box;
}

/// What a member moves, let grow in the first so many ways.
std::vector<Column> off_in_ways(int count, const Member& member, const Bank& bank,
                                const std::vector<int>& model, const Fit& f,
                                const std::vector<Observation>& all, const Box3& box) {
  const auto signature = std::make_shared<std::vector<float>>(all.size(), 0.0F);
  std::string key = "off";
  for (const Column& c : member.form.columns) {
    const double coefficient = f.coefficients(place_of(bank, model, c));
    key += fmt::format(" {} {}", c.key, coefficient);
    oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
      (*signature)[i] += static_cast<float>(coefficient * c.value(all[i]));
    });
  }
  std::vector<Column> columns;
  for (int way = 0; way < count; ++way)
    columns.push_back(column(fmt::format("{} way {}", key, way), {"", 1.0, INFINITY},
                             [signature, box, way, first = all.data()](const Observation& o) {
                               return static_cast<double>(
                                          (*signature)[static_cast<std::size_t>(&o - first)]) *
                                      ways(o, box)[static_cast<std::size_t>(way)];
                             }));
  return columns;
}

/// Columns by which the signatures of all but the k-th may be off, those that may be wrong by more
/// than `error`. They are answered.
std::vector<int> others_off(std::size_t k, double error, const Members& members,
                            const Search& search, Bank& bank, const Fit& f) {
  const auto model = columns_of(bank, members);
  const Box3 box = box_of(search.observations);
  std::vector<int> off;
  for (std::size_t j = 0; j < members.size(); ++j) {
    if (j == k || !(members[j].effect->signature_error > error)) continue;
    const auto columns = off_in_ways(kWays, members[j], bank, model, f, search.observations, box);
    add_columns(bank, search.observations, columns);
    for (const Column& c : columns) off.push_back(bank.index.at(c.key));
  }
  answer(bank, off);
  return off;
}

}  // namespace

double wrong_share(const Members& members, const std::vector<double>& explained, std::size_t but) {
  double all = 0.0, wrong = 0.0;
  for (std::size_t k = 0; k < members.size(); ++k) {
    const double part = std::fmax(0.0, explained[k]), error = members[k].effect->signature_error;
    all += part;
    if (k != but) wrong += error * error * part;
  }
  return all > 0.0 ? wrong / all : 0.0;
}

double wrong_share_like(std::size_t k, const Members& members, const std::vector<double>& explained,
                        const Search& search, Bank& bank, Linearised& residuals,
                        const std::vector<int>& sets) {
  residuals.about(members);
  const auto model = columns_of(bank, members);
  const auto off = others_off(k, 0.0, members, search, bank, residuals.fit_of(members));
  const auto gain = [&](const std::vector<int>& beside) {
    auto with = model, less = columns_of(bank, without(members, k));
    with.insert(with.end(), beside.begin(), beside.end());
    less.insert(less.end(), beside.begin(), beside.end());
    return fit(bank, less, sets).objective - fit(bank, with, sets).objective;
  };
  const double plain = gain({}), beside = gain(off);
  const double like = plain > 0.0 ? std::clamp(1.0 - beside / plain, kElsewhere, 1.0) : 1.0;
  return like * wrong_share(members, explained, k);
}

bool has_exact_law(const Effect& effect) {
  return effect.signature_error <= kExact;
}

bool breaks_its_law(std::size_t k, const Members& members, double explained, const Search& search,
                    Bank& bank, Linearised& residuals) {
  constexpr double kShare = 0.1, kChance = 1e-4;
  if (!has_exact_law(*members[k].effect)) return false;
  residuals.about(members);
  const auto model = columns_of(bank, members);
  const Fit f = residuals.fit_of(members);
  const auto off = off_in_ways(kWaysAndHeights, members[k], bank, model, f, search.observations,
                               box_of(search.observations));
  add_columns(bank, search.observations, off);
  // Beside what the others' signatures may be wrong by, which is no fault of this one.
  auto beside = model;
  const auto others = others_off(k, kExact, members, search, bank, f);
  beside.insert(beside.end(), others.begin(), others.end());
  auto with = beside;
  for (const Column& c : off) with.push_back(bank.index.at(c.key));
  answer(bank, with);
  const Fit held = others.empty() ? f : fit(bank, beside, kAll), free = fit(bank, with, kAll);
  const double gain = (held.objective - free.objective) / overstated(bank, with, beside, free);
  return chi_squared_tail(std::fmax(0.0, gain), kWaysAndHeights) < kChance &&
         squares(bank, beside, held.coefficients, kAll, nullptr) -
                 squares(bank, with, free.coefficients, kAll, nullptr) >
             kShare * explained;
}

}  // namespace maquette::diagnosis::detail
