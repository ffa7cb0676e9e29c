// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/residuals.hpp"

#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/squares.hpp"

namespace maquette::diagnosis::detail {

namespace {
/// Beyond this, rms over a sample, rows of the cut lie elsewhere than where points look for them.
constexpr double kRowsMoved_mm = 0.03;

struct Moving {
  const Column& column;
  double coefficient;
};
/// Where the whole surface goes at an observation.
Vec3 moved(const Observation& o, const std::vector<Moving>& by) {
  Observation probe = o;
  Vec3 d;
  const auto along = [&](Vec3 axis) {
    probe.along = axis;
    double sum = 0.0;
    for (const Moving& m : by) sum += m.coefficient * m.column.value(probe);
    return sum;
  };
  d.x = along({1, 0, 0});
  d.y = along({0, 1, 0});
  d.z = along({0, 0, 1});
  return d;
}
}  // namespace

Beyond beyond_linear(const std::vector<Observation>& all, const std::vector<Member>& members,
                     const Bank& bank, const Eigen::VectorXd& coefficients, double ball_radius_mm,
                     Signatures& known, LagAndSlack& both, bool rows_may_move) {
  struct Term {
    const Column& column;
    double coefficient;
    const std::vector<float>* signature;
  };
  std::vector<Term> terms;
  std::vector<Moving> moving;
  const auto model = columns_of(bank, members);
  for (std::size_t k = 0; k < model.size(); ++k) {
    const Column& c = bank.columns[static_cast<std::size_t>(model[k])];
    const double coefficient = coefficients(static_cast<Eigen::Index>(k));
    if (rows_may_move && c.moves_whole && coefficient != 0.0) moving.push_back({c, coefficient});
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
  Beyond beyond{std::vector<double>(all.size(), 0.0), false};
  {
    double squares = 0.0, n = 0.0;
    for (std::size_t i = 0; i < all.size(); i += 1 + all.size() / 400) {
      const Vec3 d = moved(all[i], moving);
      squares += d.x * d.x + d.y * d.y;
      n += 1.0;
    }
    beyond.rows_moved = n > 0.0 && std::sqrt(squares / n) > kRowsMoved_mm;
    if (!beyond.rows_moved) moving.clear();
  }
  std::vector<FollowedTerm> followed;
  for (const Term& t : terms)
    if (t.column.follows) followed.push_back({*t.column.follows, t.coefficient});
  const auto pairs = both.changes(followed);
  if (terms.empty() && moving.empty()) return beyond;
  oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    const Observation& o = all[i];
    // A film or a spot moves no rows; marks have none.
    const Vec3 whole = moving.empty() || !o.on_surface ? Vec3{} : moved(o, moving);
    double& d = beyond.mm[i];
    d = recut_mm(o, ball_radius_mm, [&](const CutState& s, Vec3 n) {
      CutChange together{whole, 0.0, {}};
      for (const Term& t : terms) together += t.coefficient * t.column.cut(o, s, n);
      for (const auto& pair : pairs) together += pair(s);
      return together;
    });
    d -= dot(o.along, whole);
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
