// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file spectrum.hpp
/// From a lamp's spectrum and the curves of filters to light in bands.
///
/// A spectrum is that of a black body (Planck 1901; constants of the SI of 2019) or a table. Bands
/// without curves of their own are boxes: R 580 to 680 nm, G 490 to 580 nm, B 400 to 490 nm.

#include <array>
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
/// The same at 300 to 1100 nm in steps of 2.
[[nodiscard]] SpectralCurve black_body(double temperature_k);

/// R, G, B as said above.
[[nodiscard]] std::array<SpectralCurve, 3> box_bands();

/// CIE 1931 luminous efficiency by the fit of Wyman, Sloan and Shirley 2013, JCGT 2(2): 1 %.
[[nodiscard]] double luminous_efficiency(double wavelength_nm);

/// Integral of spectrum times filter over wavelength, in the spectrum's unit times nm; trapezia of
/// at most 1 nm from 300 to 1100 nm, where both are known: of a black body through a box within
/// 1e-4 of Planck's integral.
[[nodiscard]] Bands band_light(const SpectralCurve& spectrum,
                               const std::array<SpectralCurve, 3>& filters);

/// What a white surface under this lamp has in the bands, 1 in G, when equal energy in every
/// nanometre is white: a band counts by its mean, not by its width. Nothing: no light in G.
/// @pre each filter lets something pass
[[nodiscard]] std::optional<Bands> colour_of(const SpectralCurve& spectrum,
                                             const std::array<SpectralCurve, 3>& filters);

/// What 1.0 in a picture is, W m^-2 sr^-1 in each band, when a lamp of this spectrum gives
/// `illuminance_lux` on a white Lambert surface: E / pi, E from 683 lm/W and V(lambda).
[[nodiscard]] Bands white_radiance(const SpectralCurve& spectrum, double illuminance_lux,
                                   const std::array<SpectralCurve, 3>& filters);

/// CSV with the head `wavelength_nm,value`. CORE_FILE_*; CAMERA_SPECTRUM_FILE with the line.
[[nodiscard]] Result<SpectralCurve> read_spectrum(const std::filesystem::path& path);
/// Filters of a camera, each in its own unit: CSV with the head `wavelength_nm,r,g,b`. Also
/// refused: a filter that lets nothing pass from 300 to 1100 nm.
[[nodiscard]] Result<std::array<SpectralCurve, 3>> read_filters(const std::filesystem::path& path);

}  // namespace maquette::camera
