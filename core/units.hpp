// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file units.hpp
/// Lengths, angles and rates whose unit is part of the type.
///
/// The same terrain lives in three worlds: the planet (metres), the physical
/// model (millimetres) and the image (pixels). At scale 1:1000 one metre of
/// planet is exactly one millimetre of model, so code that forgot to convert
/// still prints the right number. Hence: no implicit conversion, no mixed
/// arithmetic, one conversion point (ModelScale).

#include <compare>
#include <numbers>

namespace maquette {

/// A double tagged with a unit. Same size and cost as the double inside.
template <class Unit>
class Quantity {
 public:
  constexpr Quantity() = default;
  constexpr explicit Quantity(double value) : value_(value) {}

  /// The bare number, in the unit named by the type. For the edge of a numeric
  /// kernel, not between rooms.
  [[nodiscard]] constexpr double value() const { return value_; }

  constexpr Quantity& operator+=(Quantity b) {
    value_ += b.value_;
    return *this;
  }
  constexpr Quantity& operator-=(Quantity b) {
    value_ -= b.value_;
    return *this;
  }

  friend constexpr auto operator<=>(const Quantity&, const Quantity&) = default;
  friend constexpr Quantity operator-(Quantity a) { return Quantity{-a.value_}; }
  friend constexpr Quantity operator+(Quantity a, Quantity b) {
    return Quantity{a.value_ + b.value_};
  }
  friend constexpr Quantity operator-(Quantity a, Quantity b) {
    return Quantity{a.value_ - b.value_};
  }
  friend constexpr Quantity operator*(double k, Quantity a) { return Quantity{k * a.value_}; }
  friend constexpr Quantity operator*(Quantity a, double k) { return Quantity{k * a.value_}; }
  friend constexpr Quantity operator/(Quantity a, double k) { return Quantity{a.value_ / k}; }
  friend constexpr double operator/(Quantity a, Quantity b) { return a.value_ / b.value_; }

 private:
  double value_ = 0.0;
};

namespace unit {
struct Metre {};
struct Millimetre {};
struct Radian {};
struct MillimetrePerMinute {};
}  // namespace unit

using Metres = Quantity<unit::Metre>;            ///< planet surface, real spacecraft
using Millimetres = Quantity<unit::Millimetre>;  ///< model, stock, machine
using Radians = Quantity<unit::Radian>;
using FeedRate = Quantity<unit::MillimetrePerMinute>;

[[nodiscard]] constexpr Radians degrees(double deg) {
  return Radians{deg * std::numbers::pi / 180.0};
}

namespace literals {
constexpr Metres operator""_m(long double v) {
  return Metres{static_cast<double>(v)};
}
constexpr Metres operator""_m(unsigned long long v) {
  return Metres{static_cast<double>(v)};
}
constexpr Millimetres operator""_mm(long double v) {
  return Millimetres{static_cast<double>(v)};
}
constexpr Millimetres operator""_mm(unsigned long long v) {
  return Millimetres{static_cast<double>(v)};
}
}  // namespace literals

/// The one place where planet metres become model millimetres.
///
/// Heights may be exaggerated; horizontal distances never are, so the two have
/// separate functions and nobody has to remember which factor applies.
class ModelScale {
 public:
  /// @param denominator  N of "1:N"; > 0 and finite
  /// @param exaggeration vertical factor, 1 = true to scale; > 0
  constexpr explicit ModelScale(double denominator, double exaggeration = 1.0)
      : denominator_(denominator), exaggeration_(exaggeration) {}

  [[nodiscard]] constexpr Millimetres horizontal(Metres d) const {
    return Millimetres{d.value() * 1000.0 / denominator_};
  }
  [[nodiscard]] constexpr Millimetres vertical(Metres h) const {
    return Millimetres{h.value() * 1000.0 / denominator_ * exaggeration_};
  }
  [[nodiscard]] constexpr Metres unscale_horizontal(Millimetres d) const {
    return Metres{d.value() * denominator_ / 1000.0};
  }
  [[nodiscard]] constexpr Metres unscale_vertical(Millimetres h) const {
    return Metres{h.value() * denominator_ / (1000.0 * exaggeration_)};
  }
  [[nodiscard]] constexpr double denominator() const { return denominator_; }
  [[nodiscard]] constexpr double exaggeration() const { return exaggeration_; }

 private:
  double denominator_;
  double exaggeration_;
};

}  // namespace maquette
