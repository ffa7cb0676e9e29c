// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/rendered_light.hpp"

#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "core/units.hpp"

namespace maquette::tools {
namespace {

/// Numbers of one of the rendering's metadata; empty: it is not there.
Result<std::vector<double>> numbers_in(const RenderedLight& light, std::string_view key,
                                       std::size_t count) {
  const std::string_view text = camera::text_in(light.metadata, key);
  std::vector<double> numbers;
  if (text.empty()) return numbers;
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (json.is_number()) numbers.push_back(json.get<double>());
  if (json.is_array())
    for (const auto& entry : json)
      if (entry.is_number()) numbers.push_back(entry.get<double>());
  for (const double v : numbers)
    if (!std::isfinite(v)) numbers.clear();
  if (numbers.size() != count)
    return fail(camera::kFrame, fmt::format("the picture's metadata say {} = \"{}\"; {} finite "
                                            "number{} expected",
                                            key, text, count, count == 1 ? "" : "s"));
  return numbers;
}

}  // namespace

Result<RenderedLight> read_rendered_light(const std::filesystem::path& path) {
  MAQUETTE_TRY(camera::LoadedImage image, camera::read_image(path));
  const auto find = [&](std::string_view name) { return camera::channel_of(image, name); };
  RenderedLight light;
  camera::Frame& frame = light.frame;
  if (Grid<float>* r = find("R"), *g = find("G"), *b = find("B"); r && g && b) {
    for (Grid<float>* band : {r, g, b}) frame.bands.push_back(std::move(*band));
  } else if (Grid<float>* y = find("Y")) {
    frame.bands.push_back(std::move(*y));
  } else {
    return fail(camera::kFrame,
                fmt::format("{}: channels R, G, B or Y of linear light are expected; "
                            "it has {}",
                            path.string(), fmt::join(image.names, ", ")));
  }
  if (image.eight_bit)
    return fail(camera::kFrame, fmt::format("{}: an 8-bit picture is no linear radiance; render to "
                                            ".exr",
                                            path.string()));
  if (!camera::text_in(image.metadata, kExposedKey).empty())
    return fail(camera::kFrame,
                fmt::format("{}: a picture that a camera has exposed ({}) is no linear radiance",
                            path.string(), camera::text_in(image.metadata, kExposedKey)));
  if (Grid<float>* z = find("Z")) frame.depth_mm = std::move(*z);
  if (Grid<float>* lit = find("lit")) frame.lit = std::move(*lit);
  light.metadata = std::move(image.metadata);
  return light;
}

Result<void> take_radiance(RenderedLight& light, CameraFile& file) {
  camera::Exposure* exposure = nullptr;
  for (camera::Effect& e : file.stack)
    if (auto* found = std::get_if<camera::Exposure>(&e)) exposure = found;
  if (exposure == nullptr || exposure->electrons_at_one > 0.0) return {};
  for (const double v : exposure->radiance_of_one)
    if (v > 0.0) return {};
  MAQUETTE_TRY(const auto one, numbers_in(light, "maquette:white_radiance_w_m2_sr", 3));
  if (one.empty()) return {};
  for (const double v : one)
    if (!(v > 0.0))
      return fail(camera::kFrame,
                  fmt::format("the picture's metadata say that value 1 is {} W m^-2 "
                              "sr^-1; more than 0 expected",
                              v));
  exposure->radiance_of_one = one;
  if (file.shot.quantum_efficiency.size() != 1) return {};
  // A grey sensor counts what arrives in all bands.
  const double all = one[0] + one[1] + one[2];
  exposure->radiance_of_one = {all};
  auto& bands = light.frame.bands;
  if (bands.size() != 3) return {};
  for (std::size_t i = 0; i < bands[0].cells().size(); ++i) {
    double sum = 0.0;
    for (std::size_t b = 0; b < 3; ++b) sum += one[b] * static_cast<double>(bands[b].cells()[i]);
    bands[0].cells()[i] = static_cast<float>(sum / all);
  }
  bands.resize(1);
  return {};
}

bool has_depth_of_field(const RenderedLight& light) {
  return !camera::text_in(light.metadata, kLensKey).empty();
}

Result<void> take_motion(const RenderedLight& light, camera::Shot& shot) {
  if (norm(shot.velocity_mm_s) > 0.0 || norm(shot.angular_rate_rad_s) > 0.0) return {};
  MAQUETTE_TRY(const auto v, numbers_in(light, "maquette:velocity_mm_s", 3));
  MAQUETTE_TRY(const auto w, numbers_in(light, "maquette:angular_rate_deg_s", 3));
  if (!v.empty()) shot.velocity_mm_s = {v[0], v[1], v[2]};
  if (!w.empty()) shot.angular_rate_rad_s = degrees(1.0).value() * Vec3{w[0], w[1], w[2]};
  return {};
}

Result<std::optional<double>> time_of(const RenderedLight& light) {
  MAQUETTE_TRY(const auto time, numbers_in(light, "maquette:time_s", 1));
  return time.empty() ? std::nullopt : std::optional(time[0]);
}

}  // namespace maquette::tools
