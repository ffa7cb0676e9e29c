// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/profile_walk.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::scan::detail {
namespace {

/// Distances along a line at which it is between 0 and `cells` of one coordinate.
void clip(double at, double step, double cells, double& in, double& out) {
  if (step == 0.0) {
    if (at < 0.0 || at > cells) out = -INFINITY;
    return;
  }
  const double a = -at / step, b = (cells - at) / step;
  in = std::fmax(in, std::fmin(a, b));
  out = std::fmin(out, std::fmax(a, b));
}

std::ptrdiff_t cell_at(double place, double step, std::ptrdiff_t cells) {
  // On a line of the grid the cell that is entered next.
  const double whole = step < 0.0 ? std::ceil(place) - 1.0 : std::floor(place);
  return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(whole), 0, cells - 1);
}

}  // namespace

ProfileWalk::ProfileWalk(const heightmap::ModelField& field, Vec3 origin, Vec3 horizontal)
    : field_(field), origin_(origin), horizontal_(horizontal) {
  const double spacing = field.spacing.value();
  const std::ptrdiff_t cols = field.z_mm.cols() - 1, rows = field.z_mm.rows() - 1;
  u_ = (origin.x - field.x0.value()) / spacing;
  v_ = (origin.y - field.y0.value()) / spacing;
  du_ = horizontal.x / spacing;
  dv_ = horizontal.y / spacing;
  to_u_ = 1.0 / du_;  // not used where du_ is zero
  to_v_ = 1.0 / dv_;
  double in = 0.0;
  leave_ = INFINITY;
  clip(u_, du_, static_cast<double>(cols), in, leave_);
  clip(v_, dv_, static_cast<double>(rows), in, leave_);
  if (!(in < leave_)) return;
  over_ = false;
  col_ = cell_at(u_ + in * du_, du_, cols);
  row_ = cell_at(v_ + in * dv_, dv_, rows);
  const double a = std::clamp(u_ + in * du_ - static_cast<double>(col_), 0.0, 1.0),
               b = std::clamp(v_ + in * dv_ - static_cast<double>(row_), 0.0, 1.0);
  const auto z = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
    return static_cast<double>(field.z_mm(row_ + i, col_ + j));
  };
  piece_.to = in;
  piece_.to_z = a >= b ? z(0, 0) + a * (z(0, 1) - z(0, 0)) + b * (z(1, 1) - z(0, 1))
                       : z(0, 0) + b * (z(1, 0) - z(0, 0)) + a * (z(1, 1) - z(1, 0));
  enter_cell();
}

/// The one or two pieces of the present cell, from where the last piece ends.
void ProfileWalk::enter_cell() {
  const auto col = static_cast<double>(col_), row = static_cast<double>(row_);
  const double from = piece_.to, from_z = piece_.to_z;
  const double by_col = du_ > 0.0   ? (col + 1.0 - u_) * to_u_
                        : du_ < 0.0 ? (col - u_) * to_u_
                                    : INFINITY;
  const double by_row = dv_ > 0.0   ? (row + 1.0 - v_) * to_v_
                        : dv_ < 0.0 ? (row - v_) * to_v_
                                    : INFINITY;
  leave_by_column_ = by_col <= by_row;
  const double to = std::max(from, std::min(by_col, by_row));
  // Places in the cell, 0 to 1.
  const double a0 = std::clamp(u_ + from * du_ - col, 0.0, 1.0),
               b0 = std::clamp(v_ + from * dv_ - row, 0.0, 1.0);
  double a1 = std::clamp(u_ + to * du_ - col, 0.0, 1.0),
         b1 = std::clamp(v_ + to * dv_ - row, 0.0, 1.0);
  const float* lower = &field_.z_mm(row_, col_);
  const float* upper = &field_.z_mm(row_ + 1, col_);
  const double z00 = static_cast<double>(lower[0]), z01 = static_cast<double>(lower[1]),
               z10 = static_cast<double>(upper[0]), z11 = static_cast<double>(upper[1]);
  double to_z = 0.0;
  if (leave_by_column_) {
    a1 = du_ > 0.0 ? 1.0 : 0.0;
    to_z = du_ > 0.0 ? z01 + b1 * (z11 - z01) : z00 + b1 * (z10 - z00);
  } else {
    b1 = dv_ > 0.0 ? 1.0 : 0.0;
    to_z = dv_ > 0.0 ? z10 + a1 * (z11 - z10) : z00 + a1 * (z01 - z00);
  }
  // The diagonal goes from the lower left to the upper right corner.
  const double aside0 = a0 - b0, aside1 = a1 - b1;
  has_second_ = (aside0 > 0.0 && aside1 < 0.0) || (aside0 < 0.0 && aside1 > 0.0);
  if (!has_second_) {
    piece_ = {from, from_z, to, to_z, aside0 + aside1 > 0.0};
    return;
  }
  const double share = aside0 / (aside0 - aside1);
  const double middle = from + share * (to - from);
  const double middle_z = z00 + (a0 + share * (a1 - a0)) * (z11 - z00);
  piece_ = {from, from_z, middle, middle_z, aside0 > 0.0};
  second_ = {middle, middle_z, to, to_z, aside1 > 0.0};
}

/// To the next piece. @return false beyond the terrain
bool ProfileWalk::advance() {
  first_ = false;
  if (has_second_) {
    piece_ = second_;
    has_second_ = false;
    return true;
  }
  if (leave_by_column_)
    col_ += du_ > 0.0 ? 1 : -1;
  else
    row_ += dv_ > 0.0 ? 1 : -1;
  over_ = col_ < 0 || row_ < 0 || col_ >= field_.z_mm.cols() - 1 || row_ >= field_.z_mm.rows() - 1;
  if (!over_) enter_cell();
  return !over_;
}

std::optional<heightmap::FieldHit> ProfileWalk::hit(double across, double up) {
  if (over_) return std::nullopt;
  const double rise = up / across;
  if (first_ && origin_.z + rise * piece_.from < piece_.from_z) return std::nullopt;  // the wall
  while (origin_.z + rise * piece_.to > piece_.to_z)
    if (!advance()) return std::nullopt;
  const double above = std::fmax(0.0, origin_.z + rise * piece_.from - piece_.from_z);
  const double below = std::fmax(0.0, piece_.to_z - origin_.z - rise * piece_.to);
  const double share = above > 0.0 ? above / (above + below) : 0.0;
  const double distance = (piece_.from + share * (piece_.to - piece_.from)) / across;
  const auto z = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
    return static_cast<double>(field_.z_mm(row_ + i, col_ + j));
  };
  const bool right = piece_.lower_right;
  const double rise_x = right ? z(0, 1) - z(0, 0) : z(1, 1) - z(1, 0);
  const double rise_y = right ? z(1, 1) - z(0, 1) : z(1, 0) - z(0, 0);
  return heightmap::FieldHit{distance,
                             origin_ + distance * (across * horizontal_ + Vec3{0.0, 0.0, up}),
                             normalized(Vec3{-rise_x, -rise_y, field_.spacing.value()})};
}

}  // namespace maquette::scan::detail
