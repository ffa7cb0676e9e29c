// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file hapke.hpp
/// Hapke's reflectance of a particulate surface.
///
///   RADF = K (w/4) mu0e / (mu0e + mue)
///          [P(g)(1 + B_S(g)) + H(mu0e / K) H(mue / K) - 1] (1 + B_C(g)) S(i, e, psi)
///
///   w     single scattering albedo
///   P     phase function: two Henyey-Greenstein lobes of asymmetry b, share c backward,
///         (1 - c)(1 - b^2)/(1 + 2 b cos g + b^2)^1.5 + c (1 - b^2)/(1 - 2 b cos g + b^2)^1.5;
///         (Hapke 2012 writes (1 + c')/2 for c);
///         c = 0 and b from -1 to 1 is the single lobe, b < 0 backward
///   B_S   shadow-hiding opposition surge, B_S0 / (1 + tan(g/2) / h_S)
///   B_C   coherent backscatter, B_C0 [1 + (1 - exp(-x)) / x] / (2 (1 + x)^2), x = tan(g/2) / h_C
///   H     multiple isotropic scattering
///   S, mu0e, mue   macroscopic roughness of mean slope theta-bar with the full correction of
///         1984: what is tilted and what stands in shadow, for all azimuths
///   K     porosity, -ln(1 - 1.209 phi^(2/3)) / (1.209 phi^(2/3)), 1 for filling factor 0
///
/// Form    H                                                           K      B_C
/// y1981   (1 + 2x) / (1 + 2x gamma)                                   1      none
/// y1993   1 / (1 - (1 - gamma) x [r0 + (1 - r0/2 - r0 x) ln(1 + 1/x)])  1    none
/// y2012   1 / (1 - w x [r0 + (1 - 2 r0 x)/2 ln(1 + 1/x)])             phi    yes
///
/// with gamma = sqrt(1 - w), r0 = (1 - gamma)/(1 + gamma): equation 8.57 of the book of 1993, 13 of
/// the paper of 2002 (w up to 0.9: 0.2 % and 0.8 % from the integral equation's H).
/// The surge has the form of 1986 in all three (that of 1981 differs from it by less than 3 % of
/// B_S0), as image processing at the USGS does.
///
/// Sources Hapke 1981, doi:10.1029/JB086iB04p03039; 1984 (roughness),
///         doi:10.1016/0019-1035(84)90054-X; 1986 (opposition), doi:10.1016/0019-1035(86)90108-9;
///         Theory of Reflectance and Emittance Spectroscopy, 1993 and 2012,
///         doi:10.1017/CBO9781139025683; 2002 (coherent backscatter), doi:10.1006/icar.2002.6853;
///         2008 (porosity), doi:10.1016/j.icarus.2008.01.003

#include "camera/reflectance/angles.hpp"

namespace maquette::camera {

struct Hapke {
  enum class Form { y1981, y1993, y2012 };
  Form form = Form::y2012;
  Bands w{0.3, 0.3, 0.3};       ///< single scattering albedo, 0 to 1
  double b = 0.0;               ///< asymmetry of the lobes, -1 to 1
  double c = 0.0;               ///< share of the backward lobe; published fits go beyond 0 to 1
  double surge = 0.0;           ///< B_S0, 0 or more
  double surge_width = 0.1;     ///< h_S > 0
  double coherent = 0.0;        ///< B_C0, 0 or more
  double coherent_width = 0.1;  ///< h_C > 0
  double roughness_deg = 0.0;   ///< theta-bar, 0 to below 60
  double filling = 0.0;         ///< phi = 1 - porosity, 0 to below 0.75

  [[nodiscard]] Bands radiance_factor(const Angles& a) const;
};

}  // namespace maquette::camera
