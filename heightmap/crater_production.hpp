// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file crater_production.hpp
/// How many craters a surface has, by diameter and age.
///
/// Production: Neukum's polynomial in log D with the coefficients of Neukum, Ivanov and Hartmann
/// 2001, doi:10.1023/A:1011989004263 (Moon) and Ivanov 2001, doi:10.1023/A:1011941121102 (Mars),
/// which holds from 10 m on; below, the power law that it has there goes on, which is an
/// extrapolation. Chronology: N(1 km) = a (exp(6.93 t) - 1) + b t of the same papers and of
/// Hartmann and Neukum 2001, doi:10.1023/A:1011945222010. Equilibrium: no more than 10^-1.33
/// D^-1.83 per square kilometre are ever there, old ones go as new ones come (Hartmann 1984,
/// doi:10.1016/0019-1035(84)90166-6, from 60 m on; extrapolated too).
///
/// Not in it: secondaries of a near crater, targets of unusual strength, and what Mars's atmosphere
/// keeps from making craters of metres.

#include "heightmap/body.hpp"

namespace maquette::heightmap {

/// Of at least this diameter per square metre, after so long. @pre diameter > 0, 0 <= age
[[nodiscard]] double craters_produced(const Body& body, double age_gyr, double diameter_m);
[[nodiscard]] double craters_in_equilibrium(double diameter_m);
/// The lesser of the two.
[[nodiscard]] double craters_present(const Body& body, double age_gyr, double diameter_m);

}  // namespace maquette::heightmap
