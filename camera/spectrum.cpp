// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/spectrum.hpp"

#include <charconv>
#include <numbers>
#include <string_view>

#include <fmt/format.h>

#include "core/files.hpp"

namespace maquette::camera {
namespace {

constexpr double kFirstNm = 300.0, kLastNm = 1100.0;

template <class F>
double integral(const F& f) {
  double sum = 0.5 * (f(kFirstNm) + f(kLastNm));
  for (double nm = kFirstNm + 1.0; nm < kLastNm; nm += 1.0) sum += f(nm);
  return sum;
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
  for (double nm = kFirstNm; nm <= kLastNm; nm += 5.0) {
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
  for (std::size_t b = 0; b < 3; ++b)
    light[b] = integral([&](double nm) { return spectrum.at(nm) * filters[b].at(nm); });
  return light;
}

Bands white_radiance(const SpectralCurve& spectrum, double illuminance_lux,
                     const std::array<SpectralCurve, 3>& filters) {
  const double lux =
      683.0 * integral([&](double nm) { return spectrum.at(nm) * luminous_efficiency(nm); });
  Bands light = band_light(spectrum, filters);
  for (double& b : light) b *= illuminance_lux / lux / std::numbers::pi;
  return light;
}

Result<SpectralCurve> read_spectrum(const std::filesystem::path& path) {
  MAQUETTE_TRY(const std::string file, read_file(path));
  std::string_view text = file;
  SpectralCurve curve;
  for (int number = 1; !text.empty(); ++number) {
    const auto end = text.find('\n');
    std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    const auto wrong = [&](const char* what) {
      return fail(kSpectrumFile, fmt::format("{}: line {}: {}", path.string(), number, what));
    };
    if (number == 1) {
      if (line != "wavelength_nm,value") return wrong("the head wavelength_nm,value expected");
      continue;
    }
    if (line.empty() || line.front() == '#') continue;
    double nm = 0.0, value = 0.0;
    const char* const last = line.data() + line.size();
    const auto first = std::from_chars(line.data(), last, nm);
    if (first.ec != std::errc{} || first.ptr == last || *first.ptr != ',')
      return wrong("two numbers expected");
    const auto second = std::from_chars(first.ptr + 1, last, value);
    if (second.ec != std::errc{} || second.ptr != last || !std::isfinite(nm) ||
        !std::isfinite(value) || value < 0.0)
      return wrong("two finite numbers expected, the value not negative");
    if (!curve.wavelength_nm.empty() && !(nm > curve.wavelength_nm.back()))
      return wrong("wavelengths must ascend");
    curve.wavelength_nm.push_back(nm);
    curve.value.push_back(value);
  }
  if (curve.value.size() < 2)
    return fail(kSpectrumFile, fmt::format("{}: at least two rows expected", path.string()));
  return curve;
}

}  // namespace maquette::camera
