// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/path_certificate.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/path_pieces.hpp"
#include "cnc/steepness.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kBatch = std::size_t{1} << 16;
constexpr std::size_t kGrain = 256;
/// What a cutter location in double may be wrong by (cutter_location.hpp).
constexpr double kExactness_mm = 1e-9;
/// Shorter intervals are not halved.
constexpr double kShortest_mm = 1e-6;
/// Drops a motion may cost before its open intervals are given up.
constexpr double kDropsPerMotion = 256.0, kDropsPerMillimetre = 256.0;
constexpr int kLatticePerCell = 16;  // as in cutter_location.cpp: such places are cheap

/// A place of the path and the contact of the ball lowered on the surface there.
struct Place3 {
  Vec3 tip;
  CutterContact contact;
  [[nodiscard]] double gouge() const { return contact.tip_mm - tip.z; }
};

/// Largest value of a function on [0, h] that is `a` and `b` at the ends and whose second
/// derivative is at least -curvature.
double below_parabola(double a, double b, double curvature, double h) {
  const double bend = 0.5 * curvature * h * h;
  if (!(bend > std::abs(b - a))) return std::fmax(a, b);
  if (std::isinf(bend)) return INFINITY;
  return 0.5 * (a + b) + 0.25 * bend + (b - a) * (b - a) / (4.0 * bend);
}

/// Largest value on [0, h] of min(a + up x, b + down (h - x)).
double below_tent(double a, double b, double up, double down, double h) {
  if (up <= 0.0 || down <= 0.0)
    return up <= 0.0 && down <= 0.0 ? std::fmin(a, b) : up <= 0.0 ? a : b;
  if (std::isinf(up) || std::isinf(down)) return INFINITY;
  const double x = std::clamp((b - a + down * h) / (up + down), 0.0, h);
  return std::fmin(a + up * x, b + down * (h - x));
}

struct MotionFinding {
  double found = -INFINITY, proven = -INFINITY;
  PathGouge deepest;
  std::uint32_t drops = 0, undecided = 0;
};

}  // namespace

struct PathProof::State {
  State(const heightmap::ModelField& surface, BallNose tool, PathProofOptions o)
      : field(surface),
        options(o),
        R(tool.radius_mm),
        x0(surface.x0.value()),
        y0(surface.y0.value()),
        x1(surface.x_mm(surface.z_mm.cols() - 1)),
        y1(surface.y_mm(surface.z_mm.rows() - 1)),
        lattice(surface.spacing.value() / kLatticePerCell),
        highest(static_cast<double>(heightmap::height_range(surface.z_mm).max)),
        tiles(surface, tool),
        cutters(DropCutter(surface, tool)),
        square(R / std::numbers::sqrt2),
        place_cols(static_cast<std::ptrdiff_t>((x1 - x0) / square) + 1),
        place_rows(static_cast<std::ptrdiff_t>((y1 - y0) / square) + 1),
        deepest(static_cast<std::size_t>(place_cols * place_rows)) {
    batch.reserve(kBatch);
  }

  const heightmap::ModelField& field;
  PathProofOptions options;
  double R, x0, y0, x1, y1, lattice, highest;
  SteepnessTiles tiles;
  tbb::enumerable_thread_specific<DropCutter> cutters;
  double square;  // places in one are less than a radius apart
  std::ptrdiff_t place_cols, place_rows;
  std::vector<PathGouge> deepest;  // per square
  std::vector<Motion> batch;
  std::size_t program = 0;          // the batch's
  std::vector<CutterContact> ends;  // of the batch's motions
  std::vector<MotionFinding> findings;
  PathCertificate sum;

  /// Above everything: cannot gouge.
  [[nodiscard]] bool clears(const Motion& m) const {
    return m.kind != Motion::Kind::arc && std::fmin(m.from_mm.z, m.to_mm.z) >= highest;
  }
  void run_batch();
  [[nodiscard]] MotionFinding examine(const Motion& motion, const Place3& from, const Place3& to,
                                      DropCutter& cutter, double found_before) const;
  [[nodiscard]] double upper_bound(const PathPiece& piece, const Place3& a, const Place3& b) const;
  [[nodiscard]] double highest_in_reach(double left, double right, double south,
                                        double north) const;
  [[nodiscard]] double on_lattice(double mm, double origin) const {
    return origin + std::round((mm - origin) / lattice) * lattice;
  }
  /// Tip at `to` of the ball that keeps touching what it touches at `from`.
  [[nodiscard]] double rolled(const Place3& from, Vec3 to) const {
    const CutterContact& c = from.contact;
    const double w2 = R * R - c.dx_mm * c.dx_mm - c.dy_mm * c.dy_mm;
    const double dx = from.tip.x + c.dx_mm - to.x, dy = from.tip.y + c.dy_mm - to.y;
    const double q = R * R - dx * dx - dy * dy;
    return q < 0.0 ? -INFINITY : c.tip_mm - std::sqrt(std::fmax(0.0, w2)) + std::sqrt(q);
  }
  void note(const PathGouge& gouge);
  [[nodiscard]] std::vector<PathGouge> places() const;
};

/// Of the surface under balls whose axes lie in the rectangle; INFINITY where that is more than a
/// few cells. Beside the outline they reach a narrow strip of it, in which a wall farther in, that
/// tiles have in them too, does not stand.
double PathProof::State::highest_in_reach(double left, double right, double south,
                                          double north) const {
  constexpr std::ptrdiff_t kMostNodes = 400;
  const double gap_x = std::fmax(0.0, std::fmax(x0 - right, left - x1));
  const double gap_y = std::fmax(0.0, std::fmax(y0 - north, south - y1));
  const double along_x = std::sqrt(std::fmax(0.0, R * R - gap_y * gap_y));
  const double along_y = std::sqrt(std::fmax(0.0, R * R - gap_x * gap_x));
  const double d = field.spacing.value();
  const auto node = [&](double mm, double origin, std::ptrdiff_t count, bool up) {
    const double at = (mm - origin) / d;
    return std::clamp<std::ptrdiff_t>(
        static_cast<std::ptrdiff_t>(up ? std::ceil(at + 1e-9) : std::floor(at - 1e-9)), 0,
        count - 1);
  };
  const std::ptrdiff_t c0 = node(left - along_x, x0, field.z_mm.cols(), false),
                       c1 = node(right + along_x, x0, field.z_mm.cols(), true),
                       r0 = node(south - along_y, y0, field.z_mm.rows(), false),
                       r1 = node(north + along_y, y0, field.z_mm.rows(), true);
  if ((c1 - c0 + 1) * (r1 - r0 + 1) > kMostNodes) return INFINITY;
  float found = field.z_mm(r0, c0);
  for (std::ptrdiff_t r = r0; r <= r1; ++r)
    for (std::ptrdiff_t c = c0; c <= c1; ++c) found = std::max(found, field.z_mm(r, c));
  return static_cast<double>(found);
}

double PathProof::State::upper_bound(const PathPiece& piece, const Place3& a,
                                     const Place3& b) const {
  const Vec3 p = a.tip, q = b.tip;
  const double left = std::fmin(p.x, q.x), right = std::fmax(p.x, q.x);
  const double south = std::fmin(p.y, q.y), north = std::fmax(p.y, q.y);
  const double low = std::fmin(p.z, q.z), e = piece.deviation_mm;
  const double gap_x = std::fmax(0.0, std::fmax(x0 - right, left - x1));
  const double gap_y = std::fmax(0.0, std::fmax(y0 - north, south - y1));
  const double reach = R + e;
  if (gap_x * gap_x + gap_y * gap_y > reach * reach * (1.0 + 1e-12)) return -INFINITY;

  const bool level = piece.kind == PathPiece::Kind::level_arc;
  const bool vertical = piece.kind == PathPiece::Kind::vertical_arc;
  const double chord = std::hypot(q.x - p.x, q.y - p.y);
  const double angle = level ? 2.0 * std::asin(std::fmin(1.0, 0.5 * chord / piece.radius_mm)) : 0.0;
  const double h = level ? angle * piece.radius_mm : chord;

  // The true cutter location is nowhere lower than this on the interval, or, beyond the
  // outline, what is lower does not matter: then ends without gouge count as touching.
  double fa = a.gouge(), fb = b.gouge();
  ContactBound contact;
  const bool inside = left >= x0 && right <= x1 && south >= y0 && north <= y1;
  if (inside) {
    // Places that deviate beyond the outline have no more below them than those on it.
    double lowest = std::fmax(std::fmin(a.contact.tip_mm, rolled(a, q)),
                              std::fmin(b.contact.tip_mm, rolled(b, p)));
    if (level) lowest = -INFINITY;
    contact = tiles.bound(std::fmax(x0, left - e), std::fmin(x1, right + e),
                          std::fmax(y0, south - e), std::fmin(y1, north + e), lowest);
  } else {
    // Only contacts that gouge count, and those are deeper than this.
    contact = tiles.bound(left - e, right + e, south - e, north + e, low - e);
    contact.highest_mm =
        std::fmin(contact.highest_mm,
                  std::fmax(low - e, highest_in_reach(left - e, right + e, south - e, north + e)));
    // Beside ground that rises more than a radius within reach only its facets bound the depth.
    contact.least_depth_mm =
        std::fmax(contact.least_depth_mm, R - (contact.highest_mm - (low - e)));
    fa = std::fmax(fa, 0.0);
    fb = std::fmax(fb, 0.0);
  }
  const double w = contact.least_depth_mm;
  const double slope = w > 0.0 ? std::sqrt(std::fmax(0.0, R * R / (w * w) - 1.0)) : INFINITY;
  double curvature = w > 0.0 ? R * R / (w * w * w) : INFINITY;
  double sag = 0.0;  // of the path below its chord
  if (level) curvature += slope / piece.radius_mm;
  if (vertical) {
    const double r2 = piece.radius_mm * piece.radius_mm;
    const auto bend = [&](Vec3 v) {
      const double rise = std::abs(v.z - piece.centre_mm.z);
      return rise > 0.0 ? r2 / (rise * rise * rise) : INFINITY;
    };
    curvature += piece.upper ? -std::fmin(bend(p), bend(q)) : std::fmax(bend(p), bend(q));
    if (!piece.upper) {
      const double half = 0.5 * norm(q - p);
      const double depth = piece.radius_mm - std::sqrt(std::fmax(0.0, r2 - half * half));
      sag = h > 0.0 ? depth * 2.0 * half / h : INFINITY;
    }
  }
  const double rise = h > 0.0 ? (q.z - p.z) / h : 0.0;
  const double by_height = contact.highest_mm - low;
  double bound = below_parabola(fa, fb, curvature, h);
  if (h > 0.0) bound = std::fmin(bound, below_tent(fa, fb, slope - rise, slope + rise, h) + sag);
  bound = std::fmax(std::fmin(bound, by_height), std::fmax(a.gouge(), b.gouge()));
  if (e > 0.0) bound += e * (1.0 + std::fmin(slope, 1e9));
  return std::fmin(bound, std::fmax(by_height, 0.0) + e);
}

MotionFinding PathProof::State::examine(const Motion& motion, const Place3& from, const Place3& to,
                                        DropCutter& cutter, double found_before) const {
  MotionFinding finding;
  const auto look = [&](const Place3& at) {
    if (!(at.gouge() > finding.found)) return;
    finding.found = at.gouge();
    finding.deepest = {at.tip.x + at.contact.dx_mm, at.tip.y + at.contact.dy_mm, at.gouge(),
                       program, motion.line};
  };
  const auto drop = [&](Vec3 tip) {
    ++finding.drops;
    const Place3 at{tip, cutter.drop(tip.x, tip.y)};
    look(at);
    return at;
  };
  look(from);
  look(to);
  const double allowed = kDropsPerMotion + kDropsPerMillimetre * std::fmin(1e6, length_mm(motion));

  const auto prove = [&](const auto& self, PathPiece& piece, const Place3& a,
                         const Place3& b) -> void {
    const double bound = upper_bound(piece, a, b);
    const double here = std::fmax(a.gouge(), b.gouge());
    const double matters = finding.found > options.limit_mm
                               ? std::fmax(found_before, finding.found) + options.resolution_mm
                               // What had to be left open before: less does not count any more.
                               : std::fmax(options.limit_mm - kExactness_mm, finding.proven);
    const bool pinned = here > options.limit_mm && bound <= here + 0.25 * options.resolution_mm;
    const bool done = bound <= matters || pinned;
    const bool hopeless =
        norm(b.tip - a.tip) <= kShortest_mm || static_cast<double>(finding.drops) >= allowed;
    if (done || hopeless) {
      finding.undecided += !done;
      finding.proven = std::fmax(finding.proven, bound);
      return;
    }
    piece.from_mm = a.tip;
    piece.to_mm = b.tip;
    Vec3 tip = middle_of(piece);
    if (piece.kind == PathPiece::Kind::line) {
      // Along an axis, a place of the lattice near the middle; its height from the line.
      const Vec3 d = b.tip - a.tip;
      double share = 0.5;
      if (d.y == 0.0 && std::abs(d.x) > 4.0 * lattice)
        share = (on_lattice(tip.x, x0) - a.tip.x) / d.x;
      else if (d.x == 0.0 && std::abs(d.y) > 4.0 * lattice)
        share = (on_lattice(tip.y, y0) - a.tip.y) / d.y;
      tip = a.tip + share * d;
    }
    const Place3 middle = drop(tip);
    self(self, piece, a, middle);
    self(self, piece, middle, b);
  };

  if (motion.kind != Motion::Kind::arc) {
    PathPiece piece;
    prove(prove, piece, from, to);
    return finding;
  }
  Place3 a = from;
  for_each_piece(motion, [&](const PathPiece& part) {
    PathPiece piece = part;
    const Place3 b = part.to_mm == to.tip ? to : drop(part.to_mm);
    prove(prove, piece, a, b);
    a = b;
  });
  return finding;
}

void PathProof::State::run_batch() {
  const std::size_t n = batch.size();
  ends.resize(n);
  findings.assign(n, {});
  const auto parallel = [&](auto&& body) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, n, kGrain),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        DropCutter& cutter = cutters.local();
                        for (std::size_t i = range.begin(); i < range.end(); ++i) body(i, cutter);
                      });
  };
  parallel([&](std::size_t i, DropCutter& cutter) {
    if (!clears(batch[i])) ends[i] = cutter.drop(batch[i].to_mm.x, batch[i].to_mm.y);
  });
  for (std::size_t i = 0; i < n; ++i)
    if (!clears(batch[i])) {
      ++sum.drops;
      sum.max_gouge_mm = std::fmax(sum.max_gouge_mm, ends[i].tip_mm - batch[i].to_mm.z);
    }
  parallel([&](std::size_t i, DropCutter& cutter) {
    const Motion& m = batch[i];
    if (clears(m)) return;
    const bool known = i > 0 && !clears(batch[i - 1]) && batch[i - 1].to_mm == m.from_mm;
    const Place3 from{m.from_mm, known ? ends[i - 1] : cutter.drop(m.from_mm.x, m.from_mm.y)};
    findings[i] = examine(m, from, {m.to_mm, ends[i]}, cutter, sum.max_gouge_mm);
    findings[i].drops += !known;
  });
  for (const MotionFinding& f : findings) {
    sum.max_gouge_mm = std::fmax(sum.max_gouge_mm, f.found);
    sum.proven_mm = std::fmax(sum.proven_mm, f.proven);
    sum.drops += f.drops;
    sum.undecided += f.undecided;
    if (f.found > options.limit_mm) {
      ++sum.gouging_motions;
      note(f.deepest);
    }
  }
  sum.motions += n;
  batch.clear();
}

void PathProof::State::note(const PathGouge& gouge) {
  const auto index = [&](double mm, std::ptrdiff_t count) {
    return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::floor(mm / square)), 0,
                                      count - 1);
  };
  PathGouge& known = deepest[static_cast<std::size_t>(
      index(gouge.y_mm - y0, place_rows) * place_cols + index(gouge.x_mm - x0, place_cols))];
  if (gouge.depth_mm > known.depth_mm) known = gouge;
}

std::vector<PathGouge> PathProof::State::places() const {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < deepest.size(); ++i)
    if (deepest[i].depth_mm > 0.0) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return deepest[a].depth_mm > deepest[b].depth_mm;
  });
  std::vector<PathGouge> chosen;
  std::vector<std::uint8_t> taken(deepest.size(), 0);
  for (const std::size_t i : order) {
    if (chosen.size() == options.most_places) break;
    const auto row = static_cast<std::ptrdiff_t>(i) / place_cols;
    const auto col = static_cast<std::ptrdiff_t>(i) % place_cols;
    bool close = false;
    for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, row - 2);
         r <= std::min(place_rows - 1, row + 2); ++r)
      for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, col - 2);
           c <= std::min(place_cols - 1, col + 2); ++c) {
        const auto k = static_cast<std::size_t>(r * place_cols + c);
        close = close || (taken[k] != 0 && std::hypot(deepest[k].x_mm - deepest[i].x_mm,
                                                      deepest[k].y_mm - deepest[i].y_mm) < R);
      }
    if (close) continue;
    taken[i] = 1;
    chosen.push_back(deepest[i]);
  }
  return chosen;
}

PathProof::PathProof(const heightmap::ModelField& surface, BallNose tool, PathProofOptions options)
    : state_(std::make_unique<State>(surface, tool, options)) {}
PathProof::~PathProof() = default;

void PathProof::add(std::span<const Motion> motions, std::size_t program) {
  State& s = *state_;
  if (program != s.program) s.run_batch();
  s.program = program;
  while (!motions.empty()) {
    const std::size_t n = std::min(motions.size(), kBatch - s.batch.size());
    s.batch.insert(s.batch.end(), motions.begin(),
                   motions.begin() + static_cast<std::ptrdiff_t>(n));
    motions = motions.subspan(n);
    if (s.batch.size() == kBatch) s.run_batch();
  }
}

PathCertificate PathProof::finish() {
  State& s = *state_;
  s.run_batch();
  s.sum.proven_mm = std::fmax(s.sum.proven_mm, s.sum.max_gouge_mm) + kExactness_mm;
  s.sum.places = s.places();
  return s.sum;
}

}  // namespace maquette::cnc
