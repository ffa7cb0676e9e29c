// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file spectrum.hpp
/// From a lamp's spectrum and the curves of filters to light in bands.
///
/// A spectrum is that of a black body (Planck 1901; constants of the SI of 2019) or a table. Bands
/// without curves of their own are boxes: R 580 to 680 nm, G 490 to 580 nm, B 400 to 490 nm.

#include <filesystem>
#include <optional>
#include <vector>

#include "camera/reflectance/angles.hpp"
#include "core/result.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kSpectrumFile{"CAMERA_SPECTRUM_FILE"};

/// Linear between wavelengths, 0 outside.
struct SpectralCurve {
  std::vector<double> wavelength_nm, value;  ///< ascending; at least two

  [[nodiscard]] double at(double wavelength_nm) const;
};

/// Spectral radiance of a black body, W m^-2 sr^-1 nm^-1.
[[nodiscard]] double planck(double wavelength_nm, double temperature_k);
/// The same at 300 to 1100 nm in steps of 5.
[[nodiscard]] SpectralCurve black_body(double temperature_k);

/// R, G, B as said above.
[[nodiscard]] std::array<SpectralCurve, 3> box_bands();

/// CIE 1931 luminous efficiency by the fit of Wyman, Sloan and Shirley 2013, JCGT 2(2): 1 %.
[[nodiscard]] double luminous_efficiency(double wavelength_nm);

/// Integral of spectrum times filter over wavelength, in the spectrum's unit times nm; trapezia of
/// 1 nm from 300 to 1100 nm.
[[nodiscard]] Bands band_light(const SpectralCurve& spectrum,
                               const std::array<SpectralCurve, 3>& filters);

/// What 1.0 in a picture is, W m^-2 sr^-1 in each band, when a lamp of this spectrum gives
/// `illuminance_lux` on a white Lambert surface: E / pi, E from 683 lm/W and V(lambda).
[[nodiscard]] Bands white_radiance(const SpectralCurve& spectrum, double illuminance_lux,
                                   const std::array<SpectralCurve, 3>& filters);

/// CSV with the head `wavelength_nm,value`. CORE_FILE_*; CAMERA_SPECTRUM_FILE with the line.
[[nodiscard]] Result<SpectralCurve> read_spectrum(const std::filesystem::path& path);

}  // namespace maquette::camera
