// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/many_places.hpp"

#include <algorithm>
#include <memory>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::diagnosis::detail {
namespace {

/// Programs of more states are not tabled: a dozen columns are asked for at once, and the trails of
/// such a program take gigabytes already.
constexpr std::size_t kMostStates = 6'000'000;

}  // namespace

const Pass* pass_of(const std::vector<Observation>& all) {
  const auto o = std::find_if(all.begin(), all.end(),
                              [](const Observation& each) { return each.pass != nullptr; });
  return o == all.end() ? nullptr : o->pass.get();
}

Displacements displacements(const Pass& pass, const std::function<Vec3(const CutState&)>& of) {
  Displacements off(pass.states());
  oneapi::tbb::parallel_for(std::size_t{0}, off.size(), [&](std::size_t i) {
    const Vec3 d = of(pass.state(i));
    off[i] = {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)};
  });
  return off;
}

std::function<double(const Observation&)> at_many_places(const Column& column,
                                                         const std::vector<Observation>& all) {
  const Pass* const pass = pass_of(all);
  if (!column.secant || !column.follows || !column.by_program || pass == nullptr ||
      pass->states() > kMostStates)
    return column.value;
  // By the program: the same for any observation.
  const auto table = [&](double size) {
    return size == 0.0
               ? nullptr
               : std::make_shared<const Displacements>(displacements(*pass, [&](const CutState& s) {
                   return size * column.cut(all.front(), s, {}).tip_mm;
                 }));
  };
  return [pass, secant = *column.secant, cut = column.cut, from = table(column.secant->from),
          to = table(column.secant->to)](const Observation& o) {
    const auto at = [&](double size, const Displacements& off) {
      return recut_mm(
          o, secant.ball_radius_mm, [&](const CutState& s, Vec3 n) { return size * cut(o, s, n); },
          [&](const PassBeside& p, double x, double y, double radius_mm) {
            return pass->height_mm(p.state, x, y, radius_mm, off, {});
          });
    };
    return (at(secant.to, *to) - (from ? at(secant.from, *from) : 0.0)) / (secant.to - secant.from);
  };
}

}  // namespace maquette::diagnosis::detail
