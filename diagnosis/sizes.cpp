// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/sizes.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Of a size's own standard errors: a doubtful cause that would move it further is told of.
constexpr double kWorthANote = 2.0;

/// Variance of the first size of the k-th about `fitted`, over what its law might have fixed:
/// averaged by likelihood (a profile would end where the law's own range does).
double variance_over_laws(const Search& search, const Bank& bank, const Members& members,
                          std::size_t k, double fitted) {
  const auto forms = members[k].form.alternatives();
  std::vector<Column> columns;
  for (const Member& m : members)
    columns.insert(columns.end(), m.form.columns.begin(), m.form.columns.end());
  for (const Form& f : forms) columns.insert(columns.end(), f.columns.begin(), f.columns.end());
  Bank wide = sum_up(search.observations, search.nuisances, columns, search.layout, &bank.theta);
  wide.weight = bank.weight;
  struct Law {
    double objective, square;
  };
  std::vector<Law> laws(forms.size());
  oneapi::tbb::parallel_for(std::size_t{0}, forms.size(), [&](std::size_t i) {
    Members with = members;
    with[k].form = forms[i];
    const auto at = columns_of(wide, with);
    const Fit f = fit(wide, at, kAll);
    const auto c = place_of(wide, at, forms[i].columns[0]);
    const double off = f.coefficients(c) - fitted;
    laws[i] = {f.objective, f.covariance(c, c) + off * off};
  });
  double least = INFINITY, sum = 0.0, weight = 0.0;
  for (const Law& l : laws) least = std::fmin(least, l.objective);
  for (const Law& l : laws) {
    const double w = std::exp(-0.5 * (l.objective - least));
    sum += w * l.square;
    weight += w;
  }
  return weight > 0.0 ? sum / weight : 0.0;
}

/// By how much more a size changes than what it moves: half the square of a lag is reported, and
/// what a lag moves grows with its power 1.4 or so, for bends are shorter than the way it needs.
/// From the coefficients that the form had before it was made of its size and has now.
double change_of_size(const Form& form, double coefficient) {
  constexpr double kReported = 2.0, kUsual = 1.4;
  const auto& what = form.columns[0].follows;
  if (!what || !what->lag) return 1.0;
  double power = kUsual;
  if (form.before)
    power = std::log(form.before->coefficient / coefficient) /
            std::log(what->size_mm / form.before->size_mm);
  return kReported / (power >= 0.5 * kReported && power <= kReported ? power : kUsual);
}

/// A size as it is reported.
double value_of(const Form& form, const Column& column, double coefficient) {
  if (coefficient > 0.0) coefficient = std::pow(coefficient, change_of_size(form, coefficient));
  return coefficient * column.parameter.per_column;
}

}  // namespace

std::vector<Estimate> sizes_of(const Search& search, const Bank& bank, const Members& members,
                               const Fit& fit, std::size_t k) {
  const auto model = columns_of(bank, members);
  const Form& form = members[k].form;
  const double wider =
      std::sqrt(overstated(bank, model, columns_of(bank, without(members, k)), fit));
  const Eigen::MatrixXd covariance = covariance_over_laws(bank, model, fit, kAll);
  std::vector<Estimate> sizes;
  for (const Column& column : form.columns) {
    const auto at = place_of(bank, model, column);
    const double coefficient = fit.coefficients(at);
    double variance = std::fmax(0.0, covariance(at, at));
    if (sizes.empty() && form.alternatives)
      variance = std::fmax(variance, variance_over_laws(search, bank, members, k, coefficient));
    sizes.push_back({column.parameter.name, value_of(form, column, coefficient),
                     wider * change_of_size(form, coefficient) * std::sqrt(variance) *
                         std::abs(column.parameter.per_column)});
  }
  return sizes;
}

double sureness(const Bank& bank, const Members& members, const Fit& fit, std::size_t k) {
  const auto model = columns_of(bank, members);
  const double wider = overstated(bank, model, columns_of(bank, without(members, k)), fit);
  const auto at = place_of(bank, model, members[k].form.columns[0]);
  const double variance = wider * covariance_over_laws(bank, model, fit, kAll)(at, at);
  return variance > 0.0 ? std::abs(fit.coefficients(at)) / std::sqrt(variance) : INFINITY;
}

void settle_sizes(const Bank& bank, Linearised& residuals, const Members& members,
                  const Members& doubtful, Diagnosis& d) {
  for (std::size_t k = 0; k < members.size(); ++k) {
    Cause& c = d.causes[k];
    // With the form of the size that is reported the extended model needs no share of it.
    if (const auto& what = members[k].form.columns[0].follows; what && what->lag)
      for (auto& [name, value] : c.fixed)
        if (name == kFollowedLag && c.parameters[0].value > 0.0)
          value = std::sqrt(2.0 * c.parameters[0].value);
  }
  widen_by_doubtful(bank, residuals, members, doubtful, d);
  std::ranges::sort(d.causes, [](const Cause& a, const Cause& b) { return a.share > b.share; });
}

void widen_by_doubtful(const Bank& bank, Linearised& residuals, const Members& members,
                       const Members& doubtful, Diagnosis& d) {
  std::vector<std::vector<double>> most(members.size());
  for (std::size_t k = 0; k < members.size(); ++k)
    most[k].assign(members[k].form.columns.size(), 0.0);
  for (const Member& m : doubtful) {
    if (!may_join(members, m.effect)) continue;
    Members with = members;
    with.push_back(m);
    residuals.about(with);
    const Fit f = residuals.fit_of(with);
    const auto model = columns_of(bank, with);
    for (std::size_t k = 0; k < members.size(); ++k)
      for (std::size_t c = 0; c < most[k].size(); ++c) {
        const Column& column = members[k].form.columns[c];
        const Estimate& now = d.causes[k].parameters[c];
        const double beside =
            value_of(members[k].form, column, f.coefficients(place_of(bank, model, column)));
        const double off = std::abs(beside - now.value);
        if (off > kWorthANote * now.sigma)
          d.notes.push_back(fmt::format(
              "{}, too small beside the others to be named, would make {} of {} {:.4g}, not {:.4g}",
              m.effect->name, now.name, d.causes[k].effect, beside, now.value));
        most[k][c] = std::fmax(most[k][c], off);
      }
  }
  residuals.about(members);
  for (std::size_t k = 0; k < members.size(); ++k)
    for (std::size_t c = 0; c < most[k].size(); ++c) {
      double& sigma = d.causes[k].parameters[c].sigma;
      sigma = std::hypot(sigma, most[k][c]);
    }
}

}  // namespace maquette::diagnosis::detail
