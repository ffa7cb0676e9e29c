// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/fit_lines.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "cnc/fewest_links.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr double kExactness_mm = 1e-9;  // of a cutter location in double
constexpr double kUnit_mm = kTick_mm * static_cast<double>(kResolution);
constexpr double kFixed_mm = 1e-8;  // half the width of the tube where the height is given

std::int64_t units_up(double mm) {
  return static_cast<std::int64_t>(std::ceil(mm / kUnit_mm - 1e-6));
}
double mm_of_units(std::int64_t u) {
  return mm_of_ticks(u * kResolution);
}

/// All lines in one row.
class Row {
 public:
  Row(std::span<const SampledLine> lines, const FitLimits& limits)
      : lines_(lines),
        gouge_mm_(limits.gouge_mm - kExactness_mm),
        excess_mm_(limits.excess_mm - kExactness_mm) {
    double start = 0.0;
    for (std::size_t l = 0; l < lines.size(); ++l) {
      const SampledLine& line = lines[l];
      MAQUETTE_CHECK(line.samples.size() >= 2, "{} samples", line.samples.size());
      const std::int64_t first = line.samples.front().place;
      for (std::size_t k = 0; k < line.samples.size(); ++k) {
        const PathSample& s = line.samples[k];
        if (k == 0 && l > 0) {
          // Two lines may have been lifted differently where they meet; the higher one counts.
          Station& joint = stations_.back();
          const double up = s.tip_mm - joint.tip;
          stations_[stations_.size() - 2].dip += std::max(0.0, up);
          joint.tip += std::max(0.0, up);
          joint.gouge = s.gouge_mm;
          joint.dip = s.dip_mm + std::max(0.0, -up);
          joint.line = l;
          joint.place = s.place;
          joint.corner = true;
          continue;
        }
        stations_.push_back({start + line.step_mm * static_cast<double>(s.place - first), s.tip_mm,
                             s.gouge_mm, s.dip_mm, l, s.place, false});
      }
      start += line.step_mm * static_cast<double>(line.samples.back().place - first);
    }
  }

  FitBounds run(std::vector<std::vector<FittedMove>>& moves) {
    moves.assign(lines_.size(), {});
    const std::size_t last = stations_.size() - 1;
    at_ = {stations_[0].place, units_up(stations_[0].tip), stations_[0].t, 0};
    emit(0, at_, moves);
    std::vector<TubePoint> ideal = fewest_links(tube());
    if (ideal.empty())  // steeper than that can tell
      for (const Station& s : stations_) ideal.push_back({s.t, s.tip});
    for (std::size_t v = 1; v + 1 < ideal.size(); ++v) {
      const TubePoint& p = ideal[v];
      if (p.t <= at_.t) continue;
      std::size_t i = at_.interval;
      while (i + 2 < stations_.size() && stations_[i + 1].t <= p.t + 1e-9) ++i;
      // `next` is where the path goes on to; a vertex on the line there leaves it all its room.
      const TubePoint& next = ideal[v + 1];
      const double slope = (next.z - p.z) / (next.t - p.t);
      go_to(p, slope, i, moves);
    }
    end_at({stations_[last].place, units_up(stations_[last].tip), stations_[last].t, last - 1},
           moves);
    bounds_.gouge_mm += kExactness_mm;
    bounds_.excess_mm += kExactness_mm;
    return bounds_;
  }

 private:
  struct Station {
    double t, tip, gouge, dip;  // gouge and dip: from here to the next
    std::size_t line;           // on which it goes on
    std::int64_t place;         // there
    bool corner;
  };
  /// A vertex as written, and the interval it lies in, or begins.
  struct Vertex {
    std::int64_t place, z;
    double t;
    std::size_t interval;
  };

  [[nodiscard]] double below(std::size_t i) const { return gouge_mm_ - stations_[i].gouge; }
  [[nodiscard]] double above(std::size_t i) const {
    return std::max(kUnit_mm, excess_mm_ - stations_[i].dip);
  }

  [[nodiscard]] std::vector<TubeStation> tube() const {
    std::vector<TubeStation> tube(stations_.size());
    const std::size_t last = stations_.size() - 1;
    for (std::size_t k = 0; k <= last; ++k) {
      const Station& s = stations_[k];
      if (k == 0 || k == last) {
        const double z = mm_of_units(units_up(s.tip));
        tube[k] = {s.t, z - kFixed_mm, z + kFixed_mm, false, z};
        continue;
      }
      double low = s.tip - std::min(below(k - 1), below(k)) + 0.5 * kUnit_mm;
      double high = s.tip + std::min(above(k - 1), above(k)) - 0.5 * kUnit_mm;
      if (low > high) low = high = 0.5 * (low + high);
      tube[k] = {s.t, low, high, s.corner, s.tip};
    }
    return tube;
  }

  [[nodiscard]] double chord(std::size_t i, double t) const {
    const Station &a = stations_[i], &b = stations_[i + 1];
    return a.tip + (t - a.t) / (b.t - a.t) * (b.tip - a.tip);
  }

  /// Whether the move to v stays inside, and by how much it gouges and exceeds.
  [[nodiscard]] bool inside(const Vertex& v, FitBounds& bounds) const {
    const double z0 = mm_of_units(at_.z), z1 = mm_of_units(v.z);
    const double slope = (z1 - z0) / (v.t - at_.t);
    double before = z0 - chord(at_.interval, at_.t);
    for (std::size_t i = at_.interval;; ++i) {
      const bool ends = i == v.interval || stations_[i + 1].t >= v.t - 1e-9;
      const double here = ends ? z1 - chord(i, v.t)
                               : z0 + slope * (stations_[i + 1].t - at_.t) - stations_[i + 1].tip;
      const double low = std::max(-before, -here), high = std::max(before, here);
      if (low > below(i) || high > above(i)) return false;
      bounds.gouge_mm = std::max(bounds.gouge_mm, std::max(0.0, low) + stations_[i].gouge);
      bounds.excess_mm = std::max(bounds.excess_mm, std::max(0.0, high) + stations_[i].dip);
      if (ends && i != v.interval)  // it must leave the next move the room beside it
        return -here <= below(v.interval) && here <= above(v.interval);
      if (ends) return true;
      before = here;
    }
  }

  /// If the move to v stays inside, makes it.
  bool take(const Vertex& v, std::vector<std::vector<FittedMove>>& moves) {
    FitBounds bounds = bounds_;
    if (!inside(v, bounds)) return false;
    bounds_ = bounds;
    // The move may end where a line ends: it is on the line before.
    const Station& s = stations_[v.interval];
    if (v.interval > 0 && s.corner && v.place == s.place && v.t == s.t) {
      const std::size_t line = stations_[v.interval - 1].line;
      emit(line, {lines_[line].samples.back().place, v.z, v.t, 0}, moves);
    }
    emit(s.line, v, moves);
    at_ = v;
    return true;
  }
  static void emit(std::size_t line, const Vertex& v, std::vector<std::vector<FittedMove>>& moves) {
    moves[line].push_back({v.place, v.z * kResolution, FittedMove::Shape::line, 0});
  }

  /// To near p in interval i, from where the path goes on with `slope`.
  void go_to(const TubePoint& p, double slope, std::size_t i,
             std::vector<std::vector<FittedMove>>& moves) {
    const bool at_station = stations_[i].t >= p.t - 1e-9;
    while (!vertex_near(p, slope, i, moves)) {
      if (at_station && stations_[i].corner && vertex_at(i, moves)) return;
      if (!sample_before(at_station ? i : i + 1, moves)) return;  // none between: left out
    }
  }

  /// To the farthest sample before `end` that can be reached; the next one always can.
  bool sample_before(std::size_t end, std::vector<std::vector<FittedMove>>& moves) {
    for (std::size_t k = end; --k > at_.interval;)
      if (vertex_at(k, moves)) return true;
    return false;
  }

  bool vertex_near(const TubePoint& p, double slope, std::size_t i,
                   std::vector<std::vector<FittedMove>>& moves) {
    const Station& s = stations_[i];
    const double step = lines_[s.line].step_mm;
    const std::int64_t first = s.place, last = place_of_end(i);
    const double exact = static_cast<double>(first) + (p.t - s.t) / step;
    const std::int64_t nearest_place = std::llround(exact);
    const std::int64_t beyond = exact > static_cast<double>(nearest_place) ? 1 : -1;
    const bool fixed = s.corner && std::abs(p.t - s.t) < 1e-9;  // where the plan turns
    for (const std::int64_t off : {0, 1, -1, 2, -2})
      for (const std::int64_t away : {0, 1, -1, 2, -2, 3, -3}) {
        const std::int64_t place = nearest_place + away * beyond;
        if (place < first || place > last || (fixed && place != first)) continue;
        if (place == last && i + 2 == stations_.size()) continue;  // the end has its height
        const double t = place == first ? s.t : s.t + step * static_cast<double>(place - first);
        if (t <= at_.t) continue;
        const double z = p.z + slope * (t - p.t);
        const std::int64_t nearest = std::llround(z / kUnit_mm);
        Vertex v{place, nearest + (z > mm_of_units(nearest) ? off : -off), t, i};
        if (place == last) v = begins(v, i + 1);
        if (take(v, moves)) return true;
      }
    return false;
  }

  /// At sample k, as near to it as fits.
  bool vertex_at(std::size_t k, std::vector<std::vector<FittedMove>>& moves) {
    const Station& s = stations_[k];
    const std::int64_t exact = units_up(s.tip);
    for (std::int64_t off = 0; off <= 8; ++off)
      for (const std::int64_t z : {exact + off, exact - off})
        if (take({s.place, z, s.t, k}, moves)) return true;
    return false;
  }

  /// The same vertex as the beginning of interval k.
  [[nodiscard]] Vertex begins(const Vertex& v, std::size_t k) const {
    return {stations_[k].place, v.z, stations_[k].t, k};
  }
  /// Where interval i ends, as a place of its line.
  [[nodiscard]] std::int64_t place_of_end(std::size_t i) const {
    const Station& next = stations_[i + 1];
    const std::size_t line = stations_[i].line;
    return next.line == line ? next.place : lines_[line].samples.back().place;
  }

  void end_at(const Vertex& end, std::vector<std::vector<FittedMove>>& moves) {
    while (!take(end, moves))
      MAQUETTE_CHECK(sample_before(end.interval + 1, moves), "no height fits at t = {} mm", at_.t);
  }

  std::span<const SampledLine> lines_;
  double gouge_mm_, excess_mm_;
  std::vector<Station> stations_;
  Vertex at_{};
  FitBounds bounds_;
};

}  // namespace

FitBounds fit_lines(std::span<const SampledLine> lines, const FitLimits& limits,
                    std::vector<std::vector<FittedMove>>& moves) {
  MAQUETTE_CHECK(!lines.empty(), "no lines");
  return Row(lines, limits).run(moves);
}

}  // namespace maquette::cnc
