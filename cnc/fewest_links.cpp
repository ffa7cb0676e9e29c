// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/fewest_links.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr double kSlack = 1e-9;  // so that what touches both sides remains

/// A line, relative to where its link was sought, and the station and side that bounds the
/// polygon's edge from here on.
struct Corner {
  double a, b;
  std::uint32_t station;
  bool high;
};

struct Line {
  double t0, a, b;
  [[nodiscard]] double at(double t) const { return a * (t - t0) + b; }
};

enum class Window : std::uint8_t { upright, held_high, held_low };

class Links {
 public:
  explicit Links(std::span<const TubeStation> s) : s_(s) {
    // No link need be steeper than the tube anywhere; a box of that size keeps clipping exact.
    double lowest = s[0].low, highest = s[0].high;
    for (std::size_t k = 1; k < s.size(); ++k) {
      const double rise =
          std::max(std::abs(s[k].high - s[k - 1].low), std::abs(s[k - 1].high - s[k].low));
      steepest_ = std::max(steepest_, 2.0 * rise / (s[k].t - s[k - 1].t));
      lowest = std::min(lowest, s[k].low);
      highest = std::max(highest, s[k].high);
    }
    room_ = 1.0 + highest - lowest;
  }

  std::vector<TubePoint> run() {
    Window window = Window::upright;
    std::size_t at = 0, past = 1;               // the window's first station, the first beyond it
    double low = s_[0].low, high = s_[0].high;  // upright: its ends; else the other end, at end_t
    double end_t = s_[0].t;
    std::size_t emptied_by = 0;
    for (;;) {
      t0_ = s_[at].t;
      const double middle = 0.5 * (s_[at].low + s_[at].high);
      polygon_ = {{-steepest_, middle - room_, kBox, false},
                  {steepest_, middle - room_, kBox, false},
                  {steepest_, middle + room_, kBox, false},
                  {-steepest_, middle + room_, kBox, false}};
      if (window == Window::upright) {
        above(end_t, low - kSlack, at);
        below(end_t, high + kSlack, at);
      } else {
        const bool held_high = window == Window::held_high;
        for (std::size_t k = at; k < past; ++k)
          held_high ? below(s_[k].t, s_[k].high + kSlack, k)
                    : above(s_[k].t, s_[k].low - kSlack, k);
        held_high ? above(end_t, low - kSlack, past) : below(end_t, high + kSlack, past);
      }
      if (polygon_.empty()) return {};
      // Stations one by one.
      bool too_low = false;
      std::size_t k = past;
      for (; k < s_.size(); ++k) {
        before_ = polygon_;
        above(s_[k].t, s_[k].low, k);
        too_low = polygon_.empty();
        if (!too_low) below(s_[k].t, s_[k].high, k);
        if (polygon_.empty() || s_[k].corner) break;
      }
      if (k == s_.size() || !polygon_.empty()) {  // up to a corner or the end
        const std::size_t last = std::min(k, s_.size() - 1);
        const bool from_corner = window == Window::upright && at > 0;
        found_.push_back({t0_, s_[last].t, {}, polygon_, from_corner ? s_[at].aim : NAN});
        if (last + 1 == s_.size()) return vertices();
        low = INFINITY;
        high = -INFINITY;
        for (const Corner& c : polygon_) {
          const double z = c.a * (s_[last].t - t0_) + c.b;
          low = std::min(low, z);
          high = std::max(high, z);
        }
        window = Window::upright;
        at = last;
        past = last + 1;
        end_t = s_[last].t;
        continue;
      }
      if (k <= emptied_by) return {};  // rounding
      emptied_by = k;
      // The line that comes nearest to the station, and what holds it back.
      std::size_t best = 0;
      double nearest = -INFINITY;
      for (std::size_t i = 0; i < before_.size(); ++i) {
        const double z = before_[i].a * (s_[k].t - t0_) + before_[i].b;
        if ((too_low ? z : -z) > nearest) {
          nearest = too_low ? z : -z;
          best = i;
        }
      }
      const Corner& one = before_[best];
      const Corner& other = before_[(best + before_.size() - 1) % before_.size()];
      const Corner& holds = one.station != kBox && one.high == too_low ? one : other;
      if (holds.station == kBox || holds.high != too_low) return {};
      const Line line{t0_, one.a, one.b};
      // Where it runs through the other side, between the last two stations.
      const TubeStation &a = s_[k - 1], &b = s_[k];
      const double wall_a = too_low ? a.low : a.high, wall_b = too_low ? b.low : b.high;
      const double off_a = std::max(0.0, too_low ? line.at(a.t) - wall_a : wall_a - line.at(a.t));
      const double off_b = std::max(0.0, too_low ? wall_b - line.at(b.t) : line.at(b.t) - wall_b);
      const double share = off_a + off_b > 0.0 ? off_a / (off_a + off_b) : 0.0;
      end_t = a.t + share * (b.t - a.t);
      found_.push_back({s_[holds.station].t, end_t, line, {}, NAN});
      low = high = line.at(end_t);
      window = too_low ? Window::held_high : Window::held_low;
      at = holds.station;
      past = k;
    }
  }

 private:
  static constexpr std::uint32_t kBox = std::numeric_limits<std::uint32_t>::max();
  struct Found {
    double window_from, window_to;  // what may cross it may do so here
    Line line;                      // the only one, unless there are
    std::vector<Corner> choice;     // several, and the window is upright
    double aim;                     // for the choice: height at window_from, NAN: any
  };

  /// Keeps lines that are at z or above at t.
  void above(double t, double z, std::size_t station) { clip(t - t0_, 1.0, z, station, false); }
  void below(double t, double z, std::size_t station) { clip(t0_ - t, -1.0, -z, station, true); }
  void clip(double na, double nb, double c, std::size_t station, bool high) {
    if (polygon_.empty()) return;
    scratch_.clear();
    const Corner* p = &polygon_.back();
    double d_p = na * p->a + nb * p->b - c;
    for (const Corner& q : polygon_) {
      const double d_q = na * q.a + nb * q.b - c;
      if ((d_p >= 0.0) != (d_q >= 0.0)) {
        const double u = d_p / (d_p - d_q);
        Corner cut{p->a + u * (q.a - p->a), p->b + u * (q.b - p->b), p->station, p->high};
        if (d_p >= 0.0) {
          cut.station = static_cast<std::uint32_t>(station);
          cut.high = high;
        }
        scratch_.push_back(cut);
      }
      if (d_q >= 0.0) scratch_.push_back(q);
      p = &q;
      d_p = d_q;
    }
    std::swap(polygon_, scratch_);
  }

  /// Of the lines of a polygon one at height z at t, or as near to it as they come: that nearest to
  /// the aim, or the middle one.
  [[nodiscard]] static Line chosen(const Found& f, double t, double z) {
    const double t0 = f.window_from;
    double lowest = INFINITY, highest = -INFINITY;
    for (const Corner& c : f.choice) {
      lowest = std::min(lowest, c.a * (t - t0) + c.b);
      highest = std::max(highest, c.a * (t - t0) + c.b);
    }
    z = std::clamp(z, lowest, highest);
    double least = INFINITY, most = -INFINITY, nearest = INFINITY, a_near = 0.0;
    const Corner* p = &f.choice.back();
    double d_p = p->a * (t - t0) + p->b - z;
    for (const Corner& q : f.choice) {
      const double d_q = q.a * (t - t0) + q.b - z;
      if (std::abs(d_q) < nearest) {
        nearest = std::abs(d_q);
        a_near = q.a;
      }
      if ((d_p >= 0.0) != (d_q >= 0.0)) {
        const double a = p->a + d_p / (d_p - d_q) * (q.a - p->a);
        least = std::min(least, a);
        most = std::max(most, a);
      }
      p = &q;
      d_p = d_q;
    }
    if (least > most) least = most = a_near;
    const double a =
        std::isnan(f.aim) ? 0.5 * (least + most) : std::clamp((z - f.aim) / (t - t0), least, most);
    return {t0, a, z - a * (t - t0)};
  }

  /// From the last link to the first.
  [[nodiscard]] std::vector<TubePoint> vertices() const {
    std::vector<TubePoint> points(found_.size() + 1);
    Line next{};
    for (std::size_t k = found_.size(); k-- > 0;) {
      const Found& f = found_[k];
      Line own = f.line;
      if (!f.choice.empty()) {
        const double t = f.window_to;
        const bool last = k + 1 == found_.size();
        own = chosen(f, t, last ? 0.5 * (s_.back().low + s_.back().high) : next.at(t));
        points[k + 1] = {t, own.at(t)};
      } else {
        const double bend = next.a - own.a;
        const double from = f.window_from, gap = own.at(from) - next.at(from);
        double t = bend != 0.0 ? from + gap / bend : f.window_to;
        t = std::clamp(t, from, f.window_to);
        points[k + 1] = {t, own.at(t)};
      }
      next = own;
    }
    points[0] = {s_[0].t, next.at(s_[0].t)};
    return points;
  }

  std::span<const TubeStation> s_;
  double steepest_ = 1.0, room_ = 1.0, t0_ = 0.0;
  std::vector<Corner> polygon_, before_, scratch_;
  std::vector<Found> found_;
};

}  // namespace

std::vector<TubePoint> fewest_links(std::span<const TubeStation> stations) {
  MAQUETTE_CHECK(stations.size() >= 2, "{} stations", stations.size());
  return Links(stations).run();
}

}  // namespace maquette::cnc
