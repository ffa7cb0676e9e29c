// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/normal_equations.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "core/random.hpp"

namespace maquette::scan::detail {

using heightmap::ModelField;

namespace {

constexpr std::size_t kChunk = 8192;
// Cosine: facets that stand farther off from the smooth surface are steps, beside a stone.
constexpr double kAlike = 0.9;

/// A cell and the place in it, in spacings.
struct Place {
  std::ptrdiff_t r = 0, c = 0;
  double u = 0.0, v = 0.0;
};

/// False beside the field.
bool find_place(const ModelField& f, double per_mm, Vec3 p, Place& at) {
  const double u = (p.x - f.x0.value()) * per_mm, v = (p.y - f.y0.value()) * per_mm;
  const std::ptrdiff_t cols = f.z_mm.cols(), rows = f.z_mm.rows();
  if (!(u >= 0.0 && v >= 0.0 && u <= static_cast<double>(cols - 1) &&
        v <= static_cast<double>(rows - 1)))
    return false;
  at.c = std::min(static_cast<std::ptrdiff_t>(u), cols - 2);
  at.r = std::min(static_cast<std::ptrdiff_t>(v), rows - 2);
  at.u = u - static_cast<double>(at.c), at.v = v - static_cast<double>(at.r);
  return true;
}

Foot foot_on(const ModelField& f, double per_mm, const Place& at, Vec3 p) {
  const float* lower = &f.z_mm(at.r, at.c);
  const float* upper = &f.z_mm(at.r + 1, at.c);
  const auto z00 = static_cast<double>(lower[0]), z11 = static_cast<double>(upper[1]);
  const bool right = at.u >= at.v;
  const auto corner = static_cast<double>(right ? lower[1] : upper[0]);
  const double rise_x = right ? corner - z00 : z11 - corner;
  const double rise_y = right ? z11 - corner : corner - z00;
  const double h = z00 + at.u * rise_x + at.v * rise_y;
  const double s = f.spacing.value();
  const double n_z = s / std::sqrt(rise_x * rise_x + rise_y * rise_y + s * s);
  return {(p.z - h) * n_z,
          {-rise_x * per_mm * n_z, -rise_y * per_mm * n_z, n_z},
          std::fmin(1.0, 4.0 * n_z)};
}

/// Derivatives of e / sigma. That of the scale is taken at the surface, where the point belongs: at
/// the point itself it holds the noise once more, and the square of it pulls at the scale (a least
/// sum of e^2 is found by shrinking scan and noise together).
void columns_of(Vec3 p, const Foot& foot, const Frame& frame, double per_arm, double* j) {
  const Vec3 n = (1.0 / foot.sigma) * foot.normal;
  const Vec3 arm = per_arm * (p - frame.centre_mm), turn = cross(arm, n);
  j[0] = n.x, j[1] = n.y, j[2] = n.z;
  j[3] = turn.x, j[4] = turn.y, j[5] = turn.z;
  j[6] = dot(arm, n) - per_arm * foot.e_mm / foot.sigma;
}

void meet_chunk(std::span<const Vec3> cloud, const Pose& pose, const Surface& surface, Met& met) {
  met.points_mm.resize(cloud.size());
  met.feet.resize(cloud.size());
  // A matrix costs half of a quaternion per point.
  const Vec3 ex = pose.scale * pose.rigid.direction({1, 0, 0});
  const Vec3 ey = pose.scale * pose.rigid.direction({0, 1, 0});
  const Vec3 ez = pose.scale * pose.rigid.direction({0, 0, 1});
  for (std::size_t i = 0; i < cloud.size(); ++i)
    met.points_mm[i] =
        cloud[i].x * ex + cloud[i].y * ey + cloud[i].z * ez + pose.rigid.translation_mm;
  surface.feet(met.points_mm, met.feet);
}

}  // namespace

Influence influence(const Loss& loss, const Foot& foot) {
  const double e = foot.e_mm / foot.sigma, limit = loss.limit_mm * foot.reach, u = e / limit;
  if (loss.kind == Loss::Kind::tukey) {
    const double rest = 1.0 - u * u;
    if (!(rest > 0.0)) return {0.0, 0.0, 0.0};
    return {rest * rest, e * rest * rest, rest * (1.0 - 5.0 * u * u)};
  }
  if (std::abs(u) <= 1.0) return {1.0, e, 1.0};
  return {1.0 / std::abs(u), std::copysign(limit, e), 0.0};
}

void FieldSurface::feet(std::span<const Vec3> points, std::span<Foot> feet) const {
  const double per_mm = 1.0 / field_->spacing.value();
  for (std::size_t i = 0; i < points.size(); ++i) {
    Place at;
    feet[i] = find_place(*field_, per_mm, points[i], at) ? foot_on(*field_, per_mm, at, points[i])
                                                         : Foot{};
  }
}

namespace {

/// Difference of second order over the spacing, central where both neighbours are there.
template <class Height>
double slope_at(const Height& height, std::ptrdiff_t i, std::ptrdiff_t n) {
  if (i > 0 && i + 1 < n) return 0.5 * (height(i + 1) - height(i - 1));
  if (n < 3) return height(n - 1) - height(0);
  const std::ptrdiff_t in = i == 0 ? 1 : -1;
  return static_cast<double>(in) * 0.5 *
         (4.0 * height(i + in) - 3.0 * height(i) - height(i + 2 * in));
}

double between(double a, double b, double t) {  // std::lerp is exact at its ends, and slow
  return a + t * (b - a);
}

/// What the surface through the nodes rises over a spacing.
struct Rise {
  double x = 0.0, y = 0.0;
};

Rise rise_at_rim(const ModelField& f, const Place& at) {
  const std::ptrdiff_t rows = f.z_mm.rows(), cols = f.z_mm.cols();
  Rise rise;
  for (std::ptrdiff_t a = 0; a <= 1; ++a)
    for (std::ptrdiff_t b = 0; b <= 1; ++b) {
      const double w = (a == 0 ? 1.0 - at.v : at.v) * (b == 0 ? 1.0 - at.u : at.u);
      const std::ptrdiff_t row = at.r + a, col = at.c + b;
      rise.x += w * slope_at([&](std::ptrdiff_t k) { return double{f.z_mm(row, k)}; }, col, cols);
      rise.y += w * slope_at([&](std::ptrdiff_t k) { return double{f.z_mm(k, col)}; }, row, rows);
    }
  return rise;
}

Rise rise_within(const ModelField& f, const Place& at) {
  const auto [r, c, u, v] = at;
  const float* z0 = &f.z_mm(r - 1, c);
  const float* z1 = &f.z_mm(r, c - 1);
  const float* z2 = &f.z_mm(r + 1, c - 1);
  const float* z3 = &f.z_mm(r + 2, c);
  const auto along = [](const float* z, double t) {
    return between(double{z[2]} - double{z[0]}, double{z[3]} - double{z[1]}, t);
  };
  const auto up = [&](std::ptrdiff_t k) {
    return between(double{z2[k + 1]} - double{z0[k]}, double{z3[k]} - double{z1[k + 1]}, v);
  };
  return {0.5 * between(along(z1, u), along(z2, u), v), 0.5 * between(up(0), up(1), u)};
}

}  // namespace

void SmoothFieldSurface::feet(std::span<const Vec3> points, std::span<Foot> feet) const {
  const ModelField& f = *field_;
  const double spacing = f.spacing.value(), per_mm = 1.0 / spacing;
  const std::ptrdiff_t rows = f.z_mm.rows(), cols = f.z_mm.cols();
  for (std::size_t i = 0; i < points.size(); ++i) {
    Place at;
    feet[i] = {};
    if (!find_place(f, per_mm, points[i], at)) continue;
    feet[i] = foot_on(f, per_mm, at, points[i]);
    const bool at_rim = at.r == 0 || at.c == 0 || at.r + 2 >= rows || at.c + 2 >= cols;
    const Rise rise = at_rim ? rise_at_rim(f, at) : rise_within(f, at);
    const double per_length =
        1.0 / std::sqrt(rise.x * rise.x + rise.y * rise.y + spacing * spacing);
    const Vec3 normal{-rise.x * per_length, -rise.y * per_length, spacing * per_length};
    // Beside a void, where this is not a number, too.
    if (dot(normal, feet[i].normal) > kAlike) feet[i].normal = normal;
  }
}

Pose moved(const Pose& pose, const Frame& frame, const Vector7& step) {
  const Vec3 turn = (1.0 / frame.arm_mm) * Vec3{step(3), step(4), step(5)};
  const double angle = norm(turn), growth = 1.0 + step(6) / frame.arm_mm;
  Quaternion rotation;
  if (angle > 0.0) rotation = rotation_about((1.0 / angle) * turn, angle);
  Pose result;
  result.scale = pose.scale * growth;
  result.rigid.rotation = normalized(rotation * pose.rigid.rotation);
  const Vec3 c = frame.centre_mm;
  result.rigid.translation_mm = c + growth * rotate(rotation, pose.rigid.translation_mm - c) +
                                Vec3{step(0), step(1), step(2)};
  return result;
}

Met meet(std::span<const Vec3> cloud, const Pose& pose, const Surface& surface) {
  Met met;
  met.points_mm.resize(cloud.size());
  met.feet.resize(cloud.size());
  const std::size_t chunks = (cloud.size() + kChunk - 1) / kChunk;
  oneapi::tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t k) {
    const std::size_t first = k * kChunk, n = std::min(kChunk, cloud.size() - first);
    Met part;
    meet_chunk(cloud.subspan(first, n), pose, surface, part);
    std::copy(part.points_mm.begin(), part.points_mm.end(),
              met.points_mm.begin() + static_cast<std::ptrdiff_t>(first));
    std::copy(part.feet.begin(), part.feet.end(),
              met.feet.begin() + static_cast<std::ptrdiff_t>(first));
  });
  return met;
}

Spread spread_of(const Met& met) {
  Spread s;
  Vec3 sum;
  for (std::size_t i = 0; i < met.feet.size(); ++i)
    if (!std::isnan(met.feet[i].e_mm)) {
      sum += met.points_mm[i];
      ++s.count;
    }
  if (s.count == 0) return s;
  s.frame.centre_mm = (1.0 / static_cast<double>(s.count)) * sum;
  double square = 0.0;
  for (std::size_t i = 0; i < met.feet.size(); ++i)
    if (!std::isnan(met.feet[i].e_mm)) {
      const Vec3 arm = met.points_mm[i] - s.frame.centre_mm;
      square += dot(arm, arm);
    }
  s.frame.arm_mm = std::fmax(1e-3, std::sqrt(square / static_cast<double>(s.count)));
  return s;
}

double robust_scale(const Met& met) {
  std::vector<double> e;
  e.reserve(met.feet.size());
  for (const Foot& f : met.feet)
    if (!std::isnan(f.e_mm)) e.push_back(std::abs(f.e_mm) / f.sigma);
  if (e.empty()) return NAN;
  const auto middle = e.begin() + static_cast<std::ptrdiff_t>(e.size() / 2);
  std::nth_element(e.begin(), middle, e.end());
  return 1.4826 * *middle;
}

namespace {

/// Upper triangles, row by row.
struct RawSums {
  std::array<double, 28> weighted{}, bread{}, meat{};
  std::array<double, 7> gradient{};
  double weight = 0.0, square = 0.0;
  std::size_t count = 0;
};

Matrix7 whole(const std::array<double, 28>& upper) {
  Matrix7 m;
  std::size_t k = 0;
  for (Eigen::Index a = 0; a < 7; ++a)
    for (Eigen::Index b = a; b < 7; ++b) m(a, b) = m(b, a) = upper[k++];
  return m;
}

void add_point(RawSums& s, const Foot& foot, Vec3 p, const Frame& frame, double per_arm,
               const Loss& loss) {
  s.square += foot.e_mm * foot.e_mm;
  ++s.count;
  const auto [w, psi, slope] = influence(loss, foot);
  if (w == 0.0) return;
  double j[7];
  columns_of(p, foot, frame, per_arm, j);
  const double psi2 = psi * psi;
  std::size_t k = 0;
  for (int a = 0; a < 7; ++a)
    for (int b = a; b < 7; ++b, ++k) {
      const double jj = j[a] * j[b];
      s.weighted[k] += w * jj;
      s.bread[k] += slope * jj;
      s.meat[k] += psi2 * jj;
    }
  for (std::size_t a = 0; a < 7; ++a) s.gradient[a] += psi * j[a];
  s.weight += w;
}

void join(Sums& all, const RawSums& s) {
  all.weighted += whole(s.weighted);
  all.bread += whole(s.bread);
  all.meat += whole(s.meat);
  for (Eigen::Index a = 0; a < 7; ++a) all.gradient(a) += s.gradient[static_cast<std::size_t>(a)];
  all.weight += s.weight;
  all.square += s.square;
  all.count += s.count;
}

}  // namespace

Sums accumulate(const Met& met, const Frame& frame, const Loss& loss) {
  RawSums raw;
  const double per_arm = 1.0 / frame.arm_mm;
  for (std::size_t i = 0; i < met.feet.size(); ++i)
    if (!std::isnan(met.feet[i].e_mm))
      add_point(raw, met.feet[i], met.points_mm[i], frame, per_arm, loss);
  Sums all;
  join(all, raw);
  return all;
}

Sums accumulate(std::span<const Vec3> cloud, const Pose& pose, const Surface& surface,
                const Frame& frame, const Loss& loss) {
  const std::size_t chunks = (cloud.size() + kChunk - 1) / kChunk;
  std::vector<RawSums> parts(chunks);
  const double per_arm = 1.0 / frame.arm_mm;
  oneapi::tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t k) {
    Met met;
    meet_chunk(cloud.subspan(k * kChunk, std::min(kChunk, cloud.size() - k * kChunk)), pose,
               surface, met);
    RawSums raw;
    for (std::size_t i = 0; i < met.feet.size(); ++i)
      if (!std::isnan(met.feet[i].e_mm))
        add_point(raw, met.feet[i], met.points_mm[i], frame, per_arm, loss);
    parts[k] = raw;
  });
  Sums all;
  for (const RawSums& raw : parts) join(all, raw);
  return all;
}

BlockMeat block_meat(std::span<const Vec3> cloud, const Pose& pose, const Surface& surface,
                     const Frame& frame, const Loss& loss, const Box3& box, std::ptrdiff_t finest,
                     int levels) {
  // Whole multiples of 2^-32 mm: integer addition does not depend on the order of threads.
  constexpr double kUnitsPerMm = 0x1.0p32;
  const auto side = static_cast<std::size_t>(finest);
  std::vector<std::int64_t> score(side * side * 7, 0);
  const double per_arm = 1.0 / frame.arm_mm;
  const double n = static_cast<double>(finest);
  const double per_x = n / std::fmax(1e-9, box.max.x - box.min.x);
  const double per_y = n / std::fmax(1e-9, box.max.y - box.min.y);
  const std::size_t chunks = (cloud.size() + kChunk - 1) / kChunk;
  oneapi::tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t k) {
    Met met;
    meet_chunk(cloud.subspan(k * kChunk, std::min(kChunk, cloud.size() - k * kChunk)), pose,
               surface, met);
    for (std::size_t i = 0; i < met.feet.size(); ++i) {
      const Foot& foot = met.feet[i];
      if (std::isnan(foot.e_mm)) continue;
      const double psi = influence(loss, foot).psi;
      if (psi == 0.0) continue;
      double j[7];
      const Vec3 p = met.points_mm[i];
      columns_of(p, foot, frame, per_arm, j);
      const auto c = static_cast<std::size_t>(std::clamp((p.x - box.min.x) * per_x, 0.0, n - 1.0));
      const auto r = static_cast<std::size_t>(std::clamp((p.y - box.min.y) * per_y, 0.0, n - 1.0));
      std::int64_t* at = &score[(r * side + c) * 7];
      for (int a = 0; a < 7; ++a)
        std::atomic_ref(at[a]).fetch_add(std::llround(psi * j[a] * kUnitsPerMm),
                                         std::memory_order_relaxed);
    }
  });
  BlockMeat result;
  std::size_t now = side;
  for (int level = 0; level < levels; ++level) {
    Matrix7 meat = Matrix7::Zero();
    std::size_t occupied = 0;
    for (std::size_t b = 0; b < now * now; ++b) {
      Vector7 g;
      for (Eigen::Index a = 0; a < 7; ++a)
        g(a) = static_cast<double>(score[b * 7 + static_cast<std::size_t>(a)]) / kUnitsPerMm;
      if (g.isZero()) continue;
      meat += g * g.transpose();
      ++occupied;
    }
    result.levels.push_back(meat);
    result.occupied.push_back(occupied);
    const std::size_t next = now / 2;
    if (next == 0) break;
    std::vector<std::int64_t> joined(next * next * 7, 0);
    for (std::size_t r = 0; r < 2 * next; ++r)
      for (std::size_t c = 0; c < 2 * next; ++c)
        for (std::size_t a = 0; a < 7; ++a)
          joined[((r / 2) * next + c / 2) * 7 + a] += score[(r * now + c) * 7 + a];
    score = std::move(joined);
    now = next;
  }
  return result;
}

std::vector<std::size_t> sample_indices(std::size_t n, std::size_t m) {
  std::vector<std::size_t> some(std::min(n, m));
  for (std::size_t k = 0; k < some.size(); ++k) {
    const std::size_t first = k * n / some.size(), end = (k + 1) * n / some.size();
    some[k] = first + random_bits(0x5ca1ab1e, k) % (end - first);
  }
  return some;
}

std::vector<Vec3> sample(std::span<const Vec3> points, std::size_t m) {
  std::vector<Vec3> some;
  some.reserve(std::min(m, points.size()));
  for (const std::size_t i : sample_indices(points.size(), m)) some.push_back(points[i]);
  return some;
}

ModelField coarser(const ModelField& f) {
  const std::ptrdiff_t rows = (f.z_mm.rows() - 1) / 2 + 1, cols = (f.z_mm.cols() - 1) / 2 + 1;
  ModelField out{Grid<float>(rows, cols), 2.0 * f.spacing, f.x0, f.y0};
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double sum = 0.0, weight = 0.0;
      // At the border the mirror image is taken, so that a slope keeps its height there.
      for (std::ptrdiff_t i = -1; i <= 1; ++i)
        for (std::ptrdiff_t j = -1; j <= 1; ++j) {
          if (!f.z_mm.contains(2 * r + i, 2 * c + j) || !f.z_mm.contains(2 * r - i, 2 * c - j))
            continue;
          const auto h = static_cast<double>(f.z_mm(2 * r + i, 2 * c + j));
          if (std::isnan(h)) continue;
          const double w = (i == 0 ? 2.0 : 1.0) * (j == 0 ? 2.0 : 1.0);
          sum += w * h;
          weight += w;
        }
      out.z_mm(r, c) = weight > 0.0 ? static_cast<float>(sum / weight) : NAN;
    }
  });
  return out;
}

}  // namespace maquette::scan::detail
