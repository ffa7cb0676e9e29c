// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/range_image.hpp"

#include <algorithm>
#include <cmath>

#include "core/median.hpp"

namespace maquette::scan::detail {
namespace {

constexpr std::int64_t kFine = 512;              // cells of a face's side, to measure what is seen
constexpr std::int64_t kAlong = 4, kAcross = 3;  // points of a side
constexpr double kOffSteps = 250.0;
constexpr double kSigmas = 4.0;

struct OnFace {
  std::size_t face;
  double u, v;  // -1 to 1
};
OnFace on_face(Vec3 p) {
  const double x = std::abs(p.x), y = std::abs(p.y), z = std::abs(p.z);
  if (z >= x && z >= y) return {p.z > 0.0 ? 4U : 5U, p.x / z, p.y / z};
  if (x >= y) return {p.x > 0.0 ? 0U : 1U, p.y / x, p.z / x};
  return {p.y > 0.0 ? 2U : 3U, p.x / y, p.z / y};
}

std::int64_t cell_of(double t, double from, double size) {
  return static_cast<std::int64_t>(std::floor((t - from) / size));
}

}  // namespace

void RangeImage::Steps::add(std::uint32_t line, std::uint32_t index, Vec3 d) {
  if (line >= lines.size()) lines.resize(line + line / 2 + 64);
  Line& l = lines[line];
  const double apart = std::abs(static_cast<double>(index) - static_cast<double>(l.index));
  if (l.begun && apart > 0.0 && apart < 5.0) {
    const Vec3 before{static_cast<double>(l.direction[0]), static_cast<double>(l.direction[1]),
                      static_cast<double>(l.direction[2])};
    l.sum += static_cast<float>(norm(d - before) / apart);
    l.count += 1.0F;
  }
  l.begun = true;
  l.index = index;
  l.direction = {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)};
}

double RangeImage::Steps::mean(std::size_t line, double otherwise) const {
  if (line >= lines.size() || !(lines[line].count > 0.0F)) return otherwise;
  return static_cast<double>(lines[line].sum / lines[line].count);
}

double RangeImage::Steps::mean_of_all(double otherwise) const {
  double sum = 0.0, count = 0.0;
  for (const Line& l : lines) {
    sum += static_cast<double>(l.sum);
    count += static_cast<double>(l.count);
  }
  return count > 0.0 ? sum / count : otherwise;
}

void RangeImage::survey(Vec3 p, const GridIndex* grid) {
  ++points_;
  // A grid that is mostly empty, by whatever the file says, is taken for none.
  if (grid == nullptr || std::max(grid->row, grid->column) > 65'536 + 4 * points_) gridded_ = false;
  if (gridded_) {
    last_row_ = std::max(last_row_, grid->row);
    last_column_ = std::max(last_column_, grid->column);
    const Vec3 d = normalized(p);
    along_rows_.add(grid->row, grid->column, d);
    along_columns_.add(grid->column, grid->row, d);
  }
  const OnFace f = on_face(p);
  Sheet& s = sheets_[f.face];
  s.min_u = std::min(s.min_u, f.u);
  s.max_u = std::max(s.max_u, f.u);
  s.min_v = std::min(s.min_v, f.v);
  s.max_v = std::max(s.max_v, f.v);
  const auto at = [](double t) {
    return std::clamp<std::int64_t>(cell_of(t, -1.0, 2.0 / kFine), 0, kFine - 1);
  };
  const auto cell = static_cast<std::uint32_t>(
      (static_cast<std::int64_t>(f.face) * kFine + at(f.v)) * kFine + at(f.u));
  if (!seen_.empty() && seen_.back() == cell) return;
  seen_.push_back(cell);
  if (seen_.size() < seen_limit_) return;
  std::sort(seen_.begin(), seen_.end());
  seen_.erase(std::unique(seen_.begin(), seen_.end()), seen_.end());
  seen_limit_ = std::max<std::size_t>(4096, 2 * seen_.size());
}

void RangeImage::build() {
  // The solid angle that is seen, in cells that hold six points and more on average.
  std::int64_t side = kFine;
  std::vector<std::uint8_t> seen(6 * kFine * kFine);
  for (const std::uint32_t cell : seen_) seen[cell] = 1;
  seen_ = {};
  double angle = 0.0;
  while (true) {
    std::uint64_t occupied = 0;
    angle = 0.0;
    const double size = 2.0 / static_cast<double>(side);
    for (std::size_t i = 0; i < seen.size(); ++i) {
      if (seen[i] == 0) continue;
      ++occupied;
      const double u = size * (static_cast<double>(i % static_cast<std::size_t>(side)) + 0.5) - 1.0;
      const double v = size * (static_cast<double>(i / static_cast<std::size_t>(side) %
                                                   static_cast<std::size_t>(side)) +
                               0.5) -
                       1.0;
      angle += size * size * std::pow(1.0 + u * u + v * v, -1.5);
    }
    if (points_ >= 6 * occupied || side <= 4) break;
    std::vector<std::uint8_t> wider(6 * static_cast<std::size_t>(side / 2 * (side / 2)));
    for (std::size_t i = 0; i < seen.size(); ++i) {
      if (seen[i] == 0) continue;
      const auto c = static_cast<std::int64_t>(i) % side, r = static_cast<std::int64_t>(i) / side;
      wider[static_cast<std::size_t>((r / 2) * (side / 2) + c / 2)] = 1;
    }
    seen = std::move(wider);
    side /= 2;
  }
  spacing_rad_ = std::sqrt(angle / static_cast<double>(std::max<std::uint64_t>(1, points_)));

  const double most = 4.0 * static_cast<double>(points_) + 65'536.0;
  gridded_ = gridded_ && (last_row_ + 1.0) * (last_column_ + 1.0) <= most;
  std::size_t cells = 0;
  if (gridded_) {
    sheets_[0].rows = last_row_ + std::int64_t{1};
    sheets_[0].columns = last_column_ + std::int64_t{1};
    cells = static_cast<std::size_t>(sheets_[0].rows * sheets_[0].columns);
    row_step_rad_ = along_columns_.mean_of_all(spacing_rad_);
    along_columns_ = {};
  } else {
    along_rows_ = along_columns_ = {};
    cell_ = std::fmax(1.2 * spacing_rad_, 1e-9);
    const auto lay_out = [&] {
      double sum = 0.0;
      for (Sheet& s : sheets_) {
        if (!(s.min_u <= s.max_u)) continue;
        s.u0 = s.min_u;
        s.v0 = s.min_v;
        s.first = static_cast<std::size_t>(std::fmin(sum, 1e15));
        const double columns = std::floor((s.max_u - s.min_u) / cell_) + 1.0,
                     rows = std::floor((s.max_v - s.min_v) / cell_) + 1.0;
        sum += columns * rows;
        s.columns = static_cast<std::int64_t>(columns);
        s.rows = static_cast<std::int64_t>(rows);
      }
      return sum;
    };
    double sum = lay_out();
    while (sum > most) {
      cell_ *= std::fmax(1.01, std::sqrt(sum / most));
      sum = lay_out();
    }
    cells = static_cast<std::size_t>(sum);
  }
  inverse_.assign(cells, 0.0F);
  if (!gridded_) off_.resize(cells);
}

RangeImage::Place RangeImage::place_of(Vec3 p, const GridIndex* grid) const {
  if (gridded_)
    return {&sheets_[0], grid->row, grid->column, row_step_rad_,
            along_rows_.mean(grid->row, spacing_rad_)};
  const OnFace f = on_face(p);
  const Sheet& s = sheets_[f.face];
  const double square = 1.0 + f.u * f.u + f.v * f.v;
  Place at{&s, std::clamp<std::int64_t>(cell_of(f.v, s.v0, cell_), 0, s.rows - 1),
           std::clamp<std::int64_t>(cell_of(f.u, s.u0, cell_), 0, s.columns - 1),
           cell_ * std::sqrt(1.0 + f.u * f.u) / square,
           cell_ * std::sqrt(1.0 + f.v * f.v) / square};
  at.row_off = (f.v - s.v0) / cell_ - static_cast<double>(at.row) - 0.5;
  at.column_off = (f.u - s.u0) / cell_ - static_cast<double>(at.column) - 0.5;
  return at;
}

void RangeImage::put(Vec3 p, const GridIndex* grid) {
  const Place at = place_of(p, grid);
  const std::size_t cell =
      at.sheet->first + static_cast<std::size_t>(at.row * at.sheet->columns + at.column);
  inverse_[cell] = static_cast<float>(1.0 / norm(p));
  if (off_.empty()) return;
  const auto step = [](double off) {
    return static_cast<std::int8_t>(std::lround(std::clamp(off, -0.5, 0.5) * kOffSteps));
  };
  off_[cell] = std::array<std::int8_t, 2>{step(at.row_off), step(at.column_off)};
}

void RangeImage::finish() {
  // Second differences of three ranges in a row: a plane has none.
  std::vector<double> second;
  const std::size_t stride = std::max<std::size_t>(1, inverse_.size() / 400'000);
  for (const Sheet& s : sheets_)
    for (std::size_t i = 0; i < static_cast<std::size_t>(s.rows * s.columns); i += stride) {
      const std::size_t column = i % static_cast<std::size_t>(s.columns);
      if (column == 0 || column + 1 == static_cast<std::size_t>(s.columns)) continue;
      const float* q = &inverse_[s.first + i];
      if (q[-1] == 0.0F || q[0] == 0.0F || q[1] == 0.0F) continue;
      const double range = 1.0 / static_cast<double>(q[0]);
      second.push_back(std::abs(static_cast<double>(q[-1]) - 2.0 * static_cast<double>(q[0]) +
                                static_cast<double>(q[1])) *
                       range * range);
    }
  if (second.empty()) return;
  noise_mm_ = kMadToSigma * median(std::move(second)) / std::sqrt(6.0);
}

float RangeImage::look(const Place& at, std::int64_t down, std::int64_t right) const {
  const std::int64_t row = at.row + down, column = at.column + right;
  if (row < 0 || row >= at.sheet->rows || column < 0 || column >= at.sheet->columns) return 0.0F;
  return inverse_[at.sheet->first + static_cast<std::size_t>(row * at.sheet->columns + column)];
}

RangeImage::Side RangeImage::side(const Place& at, std::int64_t dr, std::int64_t dc,
                                  std::int64_t from, std::int64_t stride) const {
  // q = a + b t + c s: along the direction and across, in steps of it, from the point.
  std::array<std::array<double, 3>, kAlong * kAcross> sample;
  std::size_t count = 0;
  const double length2 = static_cast<double>(dr * dr + dc * dc);
  for (std::int64_t k = 0; k < kAlong; ++k)
    for (std::int64_t across = -kAcross / 2; across <= kAcross / 2; ++across) {
      const std::int64_t t = from + k * stride;
      const std::int64_t right = dr * t + dc * across, up = dc * t - dr * across;
      const std::int64_t row = at.row + right, column = at.column + up;
      if (row < 0 || row >= at.sheet->rows || column < 0 || column >= at.sheet->columns) continue;
      const std::size_t cell =
          at.sheet->first + static_cast<std::size_t>(row * at.sheet->columns + column);
      if (inverse_[cell] == 0.0F) continue;
      double y = static_cast<double>(right), x = static_cast<double>(up);
      if (!off_.empty()) {
        y += off_[cell][0] / kOffSteps - at.row_off;
        x += off_[cell][1] / kOffSteps - at.column_off;
      }
      sample[count++] = {(static_cast<double>(dr) * y + static_cast<double>(dc) * x) / length2,
                         (static_cast<double>(dc) * y - static_cast<double>(dr) * x) / length2,
                         static_cast<double>(inverse_[cell])};
    }
  if (count < 6) return {};
  double mt = 0.0, ms = 0.0, mq = 0.0;
  const double n = static_cast<double>(count);
  for (std::size_t i = 0; i < count; ++i) {
    mt += sample[i][0] / n;
    ms += sample[i][1] / n;
    mq += sample[i][2] / n;
  }
  double tt = 0.0, ts = 0.0, ss = 0.0, tq = 0.0, sq = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = sample[i][0] - mt, s = sample[i][1] - ms, q = sample[i][2] - mq;
    tt += t * t;
    ts += t * s;
    ss += s * s;
    tq += t * q;
    sq += s * q;
  }
  const double det = tt * ss - ts * ts;
  if (!(det > 1e-6 * tt * ss)) return {};
  const double b = (tq * ss - sq * ts) / det, c = (sq * tt - tq * ts) / det;
  const double here = mq - b * mt - c * ms;
  if (!(here > 0.0)) return {};
  double square = 0.0;
  for (std::size_t i = 0; i < count; ++i)
    square += std::pow(sample[i][2] - here - b * sample[i][0] - c * sample[i][1], 2);
  const double range = 1.0 / here;
  const double rough = std::fmax(noise_mm_, range * range * std::sqrt(square / (n - 3.0)));
  const double predicted =
      rough * std::sqrt(1.0 / n + (mt * mt * ss - 2.0 * mt * ms * ts + ms * ms * tt) / det);
  return {true, range, kSigmas * std::hypot(noise_mm_, predicted)};
}

bool RangeImage::mixed(Vec3 p, const GridIndex* grid, const BeamWidth& beam,
                       double least_jump_mm) const {
  const double range = norm(p);
  const double radius = std::hypot(beam.waist_radius_mm, 0.5 * beam.divergence_rad * range) / range;
  const Place at = place_of(p, grid);
  constexpr std::array<std::array<std::int64_t, 2>, 4> kDirections{
      {{0, 1}, {1, 0}, {1, 1}, {1, -1}}};
  for (const auto& [dr, dc] : kDirections) {
    const double step = std::hypot(static_cast<double>(dr) * at.row_step_rad,
                                   static_cast<double>(dc) * at.column_step_rad);
    // An edge within the point's beam is within that of points nearer than its diameter.
    const double clear = std::ceil(2.0 * radius / step);
    if (!(clear < 1e6)) continue;
    const auto from = std::max<std::int64_t>(1, static_cast<std::int64_t>(clear));
    const std::int64_t stride = std::max<std::int64_t>(1, (from + 1) / 3);
    // The nearest on either side must differ themselves: rough ground's lines diverge, too.
    const float qa = look(at, dr * from, dc * from), qb = look(at, -dr * from, -dc * from);
    if (qa > 0.0F && qb > 0.0F &&
        std::abs(1.0 / static_cast<double>(qa) - 1.0 / static_cast<double>(qb)) <
            0.5 * least_jump_mm)
      continue;
    const Side a = side(at, dr, dc, from, stride);
    if (!a.known) continue;
    const Side b = side(at, -dr, -dc, from, stride);
    if (!b.known) continue;
    const Side& near = a.range_mm < b.range_mm ? a : b;
    const Side& far = a.range_mm < b.range_mm ? b : a;
    if (far.range_mm - near.range_mm < least_jump_mm) continue;
    if (range > near.range_mm + near.margin_mm && range < far.range_mm - far.margin_mm) return true;
  }
  return false;
}

}  // namespace maquette::scan::detail
