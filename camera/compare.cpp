// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/compare.hpp"

#include <cctype>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace maquette::camera {
namespace {

struct Channel {
  std::string name;
  const Grid<float>* values = nullptr;
};

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// Light, not depth, mask or opacity; a layer's name in front does not matter.
bool shows_light(const std::string& name) {
  const std::string last = lower(name.substr(name.rfind('.') + 1));
  const std::string layer = lower(name.substr(0, name.find('.')));
  for (const char* geometry : {"normal", "position", "angle", "part"})
    if (layer == geometry) return false;
  for (const char* other : {"z", "depth", "depth_mm", "lit", "mask", "a", "alpha"})
    if (last == other) return false;
  return true;
}

std::vector<Channel> light_channels(const LoadedImage& image) {
  std::vector<Channel> channels;
  for (std::size_t k = 0; k < image.channels.size(); ++k)
    if (shows_light(image.names[k])) channels.push_back({image.names[k], &image.channels[k]});
  return channels;
}

/// The channel of `others` that belongs to channel k of `channels`: of the same
/// name, else of the same place (OpenEXR files may be in alphabetical order).
const Channel& partner(const std::vector<Channel>& channels, std::size_t k,
                       const std::vector<Channel>& others) {
  if (others.size() == 1) return others.front();
  if (channels.size() == 1) return others[k];
  for (const Channel& other : others)
    if (lower(other.name) == lower(channels[k].name)) return other;
  return others[k];
}

}  // namespace

Result<Comparison> compare_images(const LoadedImage& real, const LoadedImage& rendered) {
  const auto a = light_channels(real), b = light_channels(rendered);
  if (a.empty() || b.empty())
    return fail(kImageFormat, fmt::format("the {} image has no channel but depth and mask",
                                          a.empty() ? "real" : "rendered"));
  if (a.size() != b.size() && a.size() != 1 && b.size() != 1)
    return fail(kImagesDiffer, fmt::format("the real image has {} channels, the rendered one {}: "
                                           "the same number, or one, was expected",
                                           a.size(), b.size()));
  const std::ptrdiff_t rows = a.front().values->rows(), cols = a.front().values->cols();
  if (b.front().values->rows() != rows || b.front().values->cols() != cols)
    return fail(kImagesDiffer,
                fmt::format("the real image has {} x {} pixels, the rendered one {} x {}; render "
                            "with the photograph's resolution",
                            cols, rows, b.front().values->cols(), b.front().values->rows()));

  const bool encode_real = !real.eight_bit && rendered.eight_bit;
  const bool encode_rendered = !rendered.eight_bit && real.eight_bit;
  const auto value255 = [](float value, bool encode) {
    return encode ? static_cast<double>(srgb8(static_cast<double>(value)))
                  : 255.0 * static_cast<double>(value);
  };

  Comparison result;
  const bool real_leads = a.size() >= b.size();
  const auto& leading = real_leads ? a : b;
  const auto& other = real_leads ? b : a;
  Grid<double> mean_difference(rows, cols, 0.0);
  for (std::size_t k = 0; k < leading.size(); ++k) {
    const Channel& lead = leading[k];
    const Channel& mate = partner(leading, k, other);
    const auto real_cells = (real_leads ? lead : mate).values->cells();
    const auto rendered_cells = (real_leads ? mate : lead).values->cells();
    double absolute = 0.0, square = 0.0, sum = 0.0;
    std::size_t counted = 0;
    for (std::size_t i = 0; i < real_cells.size(); ++i) {
      const double d =
          value255(real_cells[i], encode_real) - value255(rendered_cells[i], encode_rendered);
      if (!std::isfinite(d)) continue;
      absolute += std::abs(d), square += d * d, sum += d;
      mean_difference.cells()[i] += d / static_cast<double>(leading.size());
      ++counted;
    }
    if (counted == 0)
      return fail(kImageFormat,
                  fmt::format("channel {} has no pixel that is finite in both images", lead.name));
    const auto n = static_cast<double>(counted);
    result.channels.push_back({lead.name, absolute / n, std::sqrt(square / n), sum / n});
    result.mean_abs_diff_255 += absolute / n / static_cast<double>(leading.size());
  }
  result.difference = Grid<Rgb8>(rows, cols);
  for (std::size_t i = 0; i < mean_difference.cells().size(); ++i) {
    const double shade = std::clamp(128.0 + mean_difference.cells()[i], 0.0, 255.0);
    const auto byte = static_cast<std::uint8_t>(std::lround(shade));
    result.difference.cells()[i] = {byte, byte, byte};
  }
  return result;
}

std::string to_json(const Comparison& comparison) {
  nlohmann::ordered_json json;
  json["schema"] = "maquette.compare/1";
  json["mean_abs_diff_255"] = comparison.mean_abs_diff_255;
  json["width_px"] = comparison.difference.cols();
  json["height_px"] = comparison.difference.rows();
  json["channels"] = nlohmann::ordered_json::array();
  for (const ChannelComparison& channel : comparison.channels)
    json["channels"].push_back({{"name", channel.name},
                                {"mean_abs_diff_255", channel.mean_abs_diff_255},
                                {"rmse_255", channel.rmse_255},
                                {"bias_255", channel.bias_255}});
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace maquette::camera
