// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/residuals.hpp"

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/squares.hpp"

namespace maquette::diagnosis::detail {

std::vector<double> beyond_linear(const std::vector<Observation>& all,
                                  const std::vector<Member>& members, const Bank& bank,
                                  const Eigen::VectorXd& coefficients, double ball_radius_mm,
                                  Signatures& known, LagAndSlack& both) {
  struct Term {
    const Column& column;
    double coefficient;
    const std::vector<float>* signature;
  };
  std::vector<Term> terms;
  const auto model = columns_of(bank, members);
  for (std::size_t k = 0; k < model.size(); ++k) {
    const Column& c = bank.columns[static_cast<std::size_t>(model[k])];
    const double coefficient = coefficients(static_cast<Eigen::Index>(k));
    if (!c.cut) continue;
    std::vector<float>& signature = known[c.key];
    if (signature.empty()) {
      signature.resize(all.size());
      oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
        signature[i] = static_cast<float>(c.value(all[i]));
      });
    }
    terms.push_back({c, coefficient, &signature});
  }
  std::vector<double> beyond(all.size(), 0.0);
  std::vector<FollowedTerm> followed;
  for (const Term& t : terms)
    if (t.column.follows) followed.push_back({*t.column.follows, t.coefficient});
  const auto pairs = both.changes(followed);
  if (terms.empty()) return beyond;
  oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    const Observation& o = all[i];
    double& d = beyond[i];
    d = recut_mm(o, ball_radius_mm, [&](const CutState& s, Vec3 n) {
      CutChange together;
      for (const Term& t : terms) together += t.coefficient * t.column.cut(o, s, n);
      for (const auto& pair : pairs) together += pair(s);
      return together;
    });
    for (const Term& t : terms) d -= t.coefficient * static_cast<double>((*t.signature)[i]);
  });
  return beyond;
}

std::vector<double> residuals_of(const std::vector<Observation>& all,
                                 const std::vector<Member>& members, const Bank& bank,
                                 const Fit& f) {
  const auto model = columns_of(bank, members);
  const Eigen::VectorXd b = levelled(bank, model, f.coefficients, kAll);
  std::vector<double> r(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    double v = all[i].residual_mm;
    for (std::size_t k = 0; k < model.size(); ++k)
      v -= b(static_cast<Eigen::Index>(k)) *
           bank.columns[static_cast<std::size_t>(model[k])].value(all[i]);
    r[i] = v;
  }
  return r;
}

}  // namespace maquette::diagnosis::detail
