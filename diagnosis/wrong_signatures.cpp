// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/wrong_signatures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Of a signature's error the part that follows neither place nor slope, as a share of its square.
constexpr double kElsewhere = 0.1;
/// By what a signature may be off: over the part from -1 to 1, slopes of 0.3 as 1.
constexpr int kWays = 9;
std::array<double, kWays> ways(const Observation& o, const Box3& box) {
  constexpr double kSlope = 0.3;
  const double x = 2.0 * (o.place.x - box.min.x) / (box.max.x - box.min.x) - 1.0,
               y = 2.0 * (o.place.y - box.min.y) / (box.max.y - box.min.y) - 1.0,
               u = o.slope_normal.x / kSlope, v = o.slope_normal.y / kSlope;
  return {x, y, x * x, x * y, y * y, u, v, u * u, v * v};
}

/// What a member moves, let grow in all ways.
std::vector<Column> off_in_all_ways(const Member& member, const Bank& bank,
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
  for (int way = 0; way < kWays; ++way)
    columns.push_back(column(fmt::format("{} way {}", key, way), {"", 1.0, INFINITY},
                             [signature, box, way, first = all.data()](const Observation& o) {
                               return static_cast<double>(
                                          (*signature)[static_cast<std::size_t>(&o - first)]) *
                                      ways(o, box)[static_cast<std::size_t>(way)];
                             }));
  return columns;
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
  const Fit f = residuals.fit_of(members);
  Box3 box;
  for (const Observation& o : search.observations) box.add(o.place);
  std::vector<int> off;
  for (std::size_t j = 0; j < members.size(); ++j) {
    if (j == k) continue;
    const auto columns = off_in_all_ways(members[j], bank, model, f, search.observations, box);
    add_columns(bank, search.observations, columns);
    for (const Column& c : columns) off.push_back(bank.index.at(c.key));
  }
  answer(bank, off);
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

}  // namespace maquette::diagnosis::detail
