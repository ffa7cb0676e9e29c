// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/spectrum.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>

#include <fmt/format.h>

#include "core/files.hpp"

namespace maquette::camera {
namespace {

constexpr double kFirstNm = 300.0, kLastNm = 1100.0;

/// By trapezia of at most 1 nm that end where f does.
template <class F>
double integral(double from_nm, double to_nm, const F& f) {
  from_nm = std::max(from_nm, kFirstNm), to_nm = std::min(to_nm, kLastNm);
  if (!(to_nm > from_nm)) return 0.0;
  const double steps = std::ceil(to_nm - from_nm), step = (to_nm - from_nm) / steps;
  double sum = 0.5 * (f(from_nm) + f(to_nm));
  for (double i = 1.0; i < steps; i += 1.0) sum += f(from_nm + i * step);
  return step * sum;
}

/// Rows of a wavelength and `Columns` values under `head`.
template <std::size_t Columns>
Result<std::array<SpectralCurve, Columns>> read_curves(const std::filesystem::path& path,
                                                       std::string_view head) {
  MAQUETTE_TRY(const std::string file, read_file(path));
  std::string_view text = file;
  std::array<SpectralCurve, Columns> curves;
  for (int number = 1; !text.empty(); ++number) {
    const auto end = text.find('\n');
    std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    const auto wrong = [&](const std::string& what) {
      return fail(kSpectrumFile, fmt::format("{}: line {}: {}", path.string(), number, what));
    };
    if (number == 1) {
      if (line != head) return wrong(fmt::format("the head {} expected", head));
      continue;
    }
    if (line.empty() || line.front() == '#') continue;
    std::array<double, Columns + 1> row{};
    const char *at = line.data(), *const last = line.data() + line.size();
    for (std::size_t i = 0; i <= Columns; ++i) {
      const auto read = std::from_chars(at, last, row[i]);
      const bool ended = i == Columns ? read.ptr == last : read.ptr != last && *read.ptr == ',';
      if (read.ec != std::errc{} || !ended || !std::isfinite(row[i]))
        return wrong(fmt::format("{} finite numbers expected", Columns + 1));
      if (i > 0 && row[i] < 0.0) return wrong("a value is negative");
      at = read.ptr == last ? last : read.ptr + 1;
    }
    if (!curves[0].wavelength_nm.empty() && !(row[0] > curves[0].wavelength_nm.back()))
      return wrong("wavelengths must ascend");
    for (std::size_t i = 0; i < Columns; ++i) {
      curves[i].wavelength_nm.push_back(row[0]);
      curves[i].value.push_back(row[i + 1]);
    }
  }
  if (curves[0].value.size() < 2)
    return fail(kSpectrumFile, fmt::format("{}: at least two rows expected", path.string()));
  return curves;
}

}  // namespace

double SpectralCurve::at(double nm) const {
  if (wavelength_nm.empty() || nm < wavelength_nm.front() || nm > wavelength_nm.back()) return 0.0;
  const auto above = std::upper_bound(wavelength_nm.begin(), wavelength_nm.end(), nm);
  if (above == wavelength_nm.end()) return value.back();
  const auto i = static_cast<std::size_t>(above - wavelength_nm.begin());
  const double share = (nm - wavelength_nm[i - 1]) / (wavelength_nm[i] - wavelength_nm[i - 1]);
  return (1.0 - share) * value[i - 1] + share * value[i];
}

double planck(double nm, double temperature_k) {
  constexpr double h = 6.62607015e-34, c = 299792458.0, k = 1.380649e-23;
  const double metres = 1e-9 * nm;
  return 1e-9 * 2.0 * h * c * c / std::pow(metres, 5) /
         std::expm1(h * c / (metres * k * temperature_k));
}

SpectralCurve black_body(double temperature_k) {
  SpectralCurve curve;
  for (double nm = kFirstNm; nm <= kLastNm; nm += 2.0) {
    curve.wavelength_nm.push_back(nm);
    curve.value.push_back(planck(nm, temperature_k));
  }
  return curve;
}

std::array<SpectralCurve, 3> box_bands() {
  return {SpectralCurve{{580, 680}, {1, 1}}, SpectralCurve{{490, 580}, {1, 1}},
          SpectralCurve{{400, 490}, {1, 1}}};
}

double luminous_efficiency(double nm) {
  const auto lobe = [nm](double peak, double middle, double left, double right) {
    const double t = (nm - middle) * (nm < middle ? left : right);
    return peak * std::exp(-0.5 * t * t);
  };
  return lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322);
}

Bands band_light(const SpectralCurve& spectrum, const std::array<SpectralCurve, 3>& filters) {
  Bands light{};
  for (std::size_t b = 0; b < 3; ++b) {
    const auto &s = spectrum.wavelength_nm, &f = filters[b].wavelength_nm;
    if (s.empty() || f.empty()) continue;
    light[b] = integral(std::max(s.front(), f.front()), std::min(s.back(), f.back()),
                        [&](double nm) { return spectrum.at(nm) * filters[b].at(nm); });
  }
  return light;
}

Bands white_radiance(const SpectralCurve& spectrum, double illuminance_lux,
                     const std::array<SpectralCurve, 3>& filters) {
  const double lux = 683.0 * integral(kFirstNm, kLastNm, [&](double nm) {
                       return spectrum.at(nm) * luminous_efficiency(nm);
                     });
  Bands light = band_light(spectrum, filters);
  for (double& b : light) b *= illuminance_lux / lux / std::numbers::pi;
  return light;
}

Result<SpectralCurve> read_spectrum(const std::filesystem::path& path) {
  MAQUETTE_TRY(auto curves, read_curves<1>(path, "wavelength_nm,value"));
  return std::move(curves[0]);
}

Result<std::array<SpectralCurve, 3>> read_filters(const std::filesystem::path& path) {
  MAQUETTE_TRY(auto filters, read_curves<3>(path, "wavelength_nm,r,g,b"));
  const SpectralCurve flat{{kFirstNm, kLastNm}, {1.0, 1.0}};
  const Bands width = band_light(flat, filters);
  for (std::size_t b = 0; b < 3; ++b)
    if (!(width[b] > 0.0))
      return fail(kSpectrumFile, fmt::format("{}: filter {} lets nothing pass from {} to {} nm",
                                             path.string(), "rgb"[b], kFirstNm, kLastNm));
  return filters;
}

std::optional<Bands> colour_of(const SpectralCurve& spectrum,
                               const std::array<SpectralCurve, 3>& filters) {
  const Bands light = band_light(spectrum, filters);
  const Bands flat = band_light({{kFirstNm, kLastNm}, {1.0, 1.0}}, filters);
  if (!(light[1] > 0.0)) return std::nullopt;
  Bands colour;
  for (std::size_t b = 0; b < 3; ++b) colour[b] = light[b] / flat[b] / (light[1] / flat[1]);
  return colour;
}

}  // namespace maquette::camera
