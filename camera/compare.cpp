// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/compare.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "camera/compare_perceptual.hpp"
#include "camera/srgb.hpp"

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

/// srgb8() by its thresholds: the first guess from a table, then up to the right number.
class SrgbCodes {
 public:
  SrgbCodes() {
    for (int code = 1; code < 256; ++code) {
      double low = 0.0, high = 1.0;
      for (int i = 0; i < 60; ++i) {
        const double middle = 0.5 * (low + high);
        (srgb8(middle) >= code ? high : low) = middle;
      }
      const auto up = static_cast<float>(high);
      from_[static_cast<std::size_t>(code)] =
          srgb8(static_cast<double>(up)) >= code ? up : std::nextafter(up, 2.0F);
    }
    for (std::size_t i = 0; i < guess_.size(); ++i)
      guess_[i] = srgb8(static_cast<double>(i) / kSteps);
  }
  [[nodiscard]] float operator()(float v) const {
    if (!(v > 0.0F)) return std::isnan(v) ? v : 0.0F;
    if (v >= 1.0F) return 255.0F;
    std::size_t code = guess_[static_cast<std::size_t>(static_cast<int>(v * kSteps))];
    while (code < 255 && v >= from_[code + 1]) ++code;
    return static_cast<float>(code);
  }

 private:
  static constexpr int kSteps = 8192;
  std::array<float, 256> from_{};
  std::array<std::uint8_t, kSteps + 1> guess_{};
};

/// Pairs of channels and how their values become x/255.
struct Pairs {
  struct Pair {
    std::string name;
    const Grid<float>*real = nullptr, *rendered = nullptr;
    float gain = 1.0F;
  };
  std::vector<Pair> pairs;
  bool real_eight_bit = false, rendered_eight_bit = false;
  bool matched = false;
  SrgbCodes codes;

  [[nodiscard]] bool in_display_values() const { return real_eight_bit || rendered_eight_bit; }
  void real_row(const Pair& p, std::ptrdiff_t r, float* to) const {
    convert(p.real->row(r), real_eight_bit, 1.0F, false, to);
  }
  void rendered_row(const Pair& p, std::ptrdiff_t r, float* to) const {
    convert(p.rendered->row(r), rendered_eight_bit, p.gain, matched, to);
  }

 private:
  void convert(std::span<const float> from, bool eight_bit, float gain, bool scaled,
               float* to) const {
    const std::size_t n = from.size();
    if (in_display_values() && !eight_bit) {
      for (std::size_t i = 0; i < n; ++i) to[i] = codes(gain * from[i]);
    } else if (eight_bit && scaled) {
      for (std::size_t i = 0; i < n; ++i) to[i] = codes(gain * linear_of_srgb(from[i]));
    } else {
      for (std::size_t i = 0; i < n; ++i) to[i] = 255.0F * gain * from[i];
    }
  }
};

/// Which pixels count: 0 not, 1 yes, 2 at an edge of light and shadow.
struct Mask {
  Grid<std::uint8_t> kind;
  bool has_edges = false;
  std::size_t background = 0;
};

const Grid<float>* channel_of(const LoadedImage& image, std::string_view wanted) {
  for (std::size_t k = 0; k < image.names.size(); ++k)
    if (image.names[k] == wanted) return &image.channels[k];
  return nullptr;
}

/// Everything within `reach` of a 1 along one direction and then the other.
void widen(Grid<std::uint8_t>& g, std::ptrdiff_t reach) {
  for (const bool along : {true, false}) {
    const Grid<std::uint8_t> before = g;
    const std::ptrdiff_t lines = along ? g.rows() : g.cols(), length = along ? g.cols() : g.rows();
    for (std::ptrdiff_t line = 0; line < lines; ++line) {
      std::ptrdiff_t last = -reach - 1;
      const auto at = [&](std::ptrdiff_t i) { return along ? before(line, i) : before(i, line); };
      const auto set = [&](std::ptrdiff_t i) { (along ? g(line, i) : g(i, line)) = 1; };
      for (std::ptrdiff_t i = 0; i < length; ++i) {
        if (at(i) != 0) last = i;
        if (i - last <= reach) set(i);
      }
      last = length + reach;
      for (std::ptrdiff_t i = length; i-- > 0;) {
        if (at(i) != 0) last = i;
        if (last - i <= reach) set(i);
      }
    }
  }
}

Mask mask_of(const LoadedImage& rendered, std::ptrdiff_t rows, std::ptrdiff_t cols,
             const CompareOptions& options) {
  Mask mask{Grid<std::uint8_t>(rows, cols, 1)};
  const Grid<float>* depth = channel_of(rendered, "Z");
  const auto seen = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return depth == nullptr || std::isfinite((*depth)(r, c));
  };
  if (const Grid<float>* lit = channel_of(rendered, "lit")) {
    Grid<std::uint8_t> edge(rows, cols);
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c)
        for (const auto& [dr, dc] : {std::pair{0, 1}, {1, 0}})
          if (r + dr < rows && c + dc < cols && (*lit)(r, c) != (*lit)(r + dr, c + dc) &&
              seen(r, c) && seen(r + dr, c + dc))
            edge(r, c) = edge(r + dr, c + dc) = 1;
    widen(edge, options.edge_px);
    for (std::size_t i = 0; i < edge.cells().size(); ++i)
      if (edge.cells()[i] != 0) mask.kind.cells()[i] = 2;
    mask.has_edges = true;
  }
  if (depth != nullptr && !options.background)
    for (std::size_t i = 0; i < mask.kind.cells().size(); ++i)
      if (!std::isfinite(depth->cells()[i])) mask.kind.cells()[i] = 0, ++mask.background;
  return mask;
}

/// Sums of one channel over some rows.
struct Sums {
  std::array<double, 2> absolute{}, square{}, sum{};  ///< of the rest, of edges
  std::array<std::size_t, 2> count{};
  std::array<std::uint32_t, 256> real{}, rendered{};
  void add(const Sums& o) {
    for (std::size_t k = 0; k < 2; ++k)
      absolute[k] += o.absolute[k], square[k] += o.square[k], sum[k] += o.sum[k],
          count[k] += o.count[k];
    for (std::size_t i = 0; i < 256; ++i) real[i] += o.real[i], rendered[i] += o.rendered[i];
  }
  void add_row(const float* a, const float* b, const std::uint8_t* kind, std::size_t n, float share,
               float* mean, float* mean_absolute) {
    for (std::size_t i = 0; i < n; ++i) {
      const float d = a[i] - b[i];
      if (kind[i] == 0 || !std::isfinite(d)) continue;
      const std::size_t part = kind[i] - 1U;
      const auto e = static_cast<double>(d);
      absolute[part] += std::abs(e), square[part] += e * e, sum[part] += e;
      ++count[part];
      mean[i] += share * d;
      mean_absolute[i] += share * std::abs(d);
      ++real[static_cast<std::size_t>(static_cast<int>(std::clamp(a[i] + 0.5F, 0.0F, 255.0F)))];
      ++rendered[static_cast<std::size_t>(static_cast<int>(std::clamp(b[i] + 0.5F, 0.0F, 255.0F)))];
    }
  }
};

std::uint8_t byte_of(float v) {
  return static_cast<std::uint8_t>(std::clamp(std::lround(v), 0L, 255L));
}

/// All channels, in strips of rows whose sums are added in their order.
std::vector<Sums> sum_up(const Pairs& pairs, const Mask& mask, Comparison& result) {
  constexpr std::ptrdiff_t kStrip = 32;
  const std::ptrdiff_t rows = mask.kind.rows(), strips = (rows + kStrip - 1) / kStrip;
  const auto cols = static_cast<std::size_t>(mask.kind.cols());
  std::vector<std::vector<Sums>> parts(static_cast<std::size_t>(strips));
  const float share = 1.0F / static_cast<float>(pairs.pairs.size());
  tbb::parallel_for(std::ptrdiff_t{0}, strips, [&](std::ptrdiff_t strip) {
    auto& sums = parts[static_cast<std::size_t>(strip)];
    sums.resize(pairs.pairs.size());
    std::vector<float> a(cols), b(cols), mean(cols), absolute(cols);
    for (std::ptrdiff_t r = strip * kStrip; r < std::min((strip + 1) * kStrip, rows); ++r) {
      std::fill(mean.begin(), mean.end(), 0.0F);
      std::fill(absolute.begin(), absolute.end(), 0.0F);
      for (std::size_t k = 0; k < pairs.pairs.size(); ++k) {
        pairs.real_row(pairs.pairs[k], r, a.data());
        pairs.rendered_row(pairs.pairs[k], r, b.data());
        sums[k].add_row(a.data(), b.data(), mask.kind.row(r).data(), cols, share, mean.data(),
                        absolute.data());
      }
      for (std::size_t c = 0; c < cols; ++c) {
        const std::uint8_t shade = byte_of(128.0F + mean[c]);
        result.difference.row(r)[c] = {shade, shade, shade};
        result.absolute.row(r)[c] = byte_of(absolute[c]);
      }
    }
  });
  std::vector<Sums> all(pairs.pairs.size());
  for (const auto& part : parts)
    for (std::size_t k = 0; k < all.size(); ++k) all[k].add(part[k]);
  return all;
}

double histogram_distance(const Sums& s) {
  double area = 0.0, a = 0.0, b = 0.0, n = 0.0;
  for (const std::uint32_t v : s.real) n += v;
  for (std::size_t i = 0; i + 1 < 256; ++i) {
    a += s.real[i], b += s.rendered[i];
    area += std::abs(a - b) / n;
  }
  return area;
}

/// The factor between linear lights of some pairs, robust.
std::optional<float> fitted_gain(const Pairs& pairs, std::span<const Pairs::Pair> of,
                                 const Mask& mask) {
  constexpr float kDark = 0.02F, kBright = 0.98F;
  constexpr std::size_t kWanted = 400'000;
  std::vector<std::array<float, 2>> samples;
  const std::size_t cells = mask.kind.cells().size();
  const std::size_t step = std::max<std::size_t>(1, cells * of.size() / kWanted) | 1U;
  for (const Pairs::Pair& p : of)
    for (std::size_t i = 0; i < cells; i += step) {
      float a = p.real->cells()[i], b = p.rendered->cells()[i];
      if (mask.kind.cells()[i] == 0 || !(a < kBright) || !(b < kBright)) continue;
      if (pairs.real_eight_bit) a = linear_of_srgb(a);
      if (pairs.rendered_eight_bit) b = linear_of_srgb(b);
      if (a > kDark && b > kDark) samples.push_back({a, b});
    }
  if (samples.size() < 10) return std::nullopt;
  std::vector<float> ratios;
  for (const auto& [a, b] : samples) ratios.push_back(a / b);
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  auto gain = static_cast<double>(*middle);
  for (int i = 0; i < 20; ++i) {
    std::vector<float> off;
    for (const auto& [a, b] : samples)
      off.push_back(
          static_cast<float>(std::abs(static_cast<double>(a) - gain * static_cast<double>(b))));
    const auto half = off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2);
    std::nth_element(off.begin(), half, off.end());
    const double limit = 1.345 * 1.4826 * static_cast<double>(*half) + 1e-12;  // Huber, 95 %
    double ab = 0.0, bb = 0.0;
    for (const auto& [a, b] : samples) {
      const double x = static_cast<double>(a), y = static_cast<double>(b);
      const double e = std::abs(x - gain * y), w = e <= limit ? 1.0 : limit / e;
      ab += w * x * y, bb += w * y * y;
    }
    const double next = ab / bb;
    if (std::abs(next - gain) < 1e-9 * gain) break;
    gain = next;
  }
  return static_cast<float>(gain);
}

Result<void> match_light(Pairs& pairs, const Mask& mask, Match match) {
  if (match == Match::none) return {};
  const auto too_few = [] {
    return fail(kImageFormat,
                "fewer than ten pixels are neither black nor saturated in both "
                "pictures: exposure cannot be matched");
  };
  pairs.matched = true;
  if (match == Match::exposure) {
    const auto gain = fitted_gain(pairs, pairs.pairs, mask);
    if (!gain) return too_few();
    for (auto& p : pairs.pairs) p.gain = *gain;
    return {};
  }
  for (auto& p : pairs.pairs) {
    const auto gain = fitted_gain(pairs, std::span(&p, 1), mask);
    if (!gain) return too_few();
    p.gain = *gain;
  }
  return {};
}

/// What was done to the values, in words.
std::string state_of(const Pairs& pairs, Match match) {
  std::string text = !pairs.in_display_values() ? "both linear, compared as they are"
                     : pairs.real_eight_bit && pairs.rendered_eight_bit
                         ? "both of 8 bits, compared as they are"
                         : "the linear one encoded to sRGB";
  switch (match) {
    case Match::none:
      return text + "; exposure and white balance as given";
    case Match::exposure:
      return text +
             fmt::format("; exposure of the rendering matched: x {:.4f}", pairs.pairs[0].gain);
    case Match::white_balance:
      text += "; exposure and white balance of the rendering matched:";
      for (const auto& p : pairs.pairs) text += fmt::format(" {} x {:.4f}", p.name, p.gain);
      return text;
  }
  return text;
}

void look_at_both(const Pairs& pairs, const Mask& mask, Comparison& result) {
  const std::ptrdiff_t rows = mask.kind.rows(), cols = mask.kind.cols();
  std::vector<Grid<float>> a, b;
  for (const auto& p : pairs.pairs) {
    a.emplace_back(rows, cols), b.emplace_back(rows, cols);
    for (std::ptrdiff_t r = 0; r < rows; ++r) {
      pairs.real_row(p, r, a.back().row(r).data());
      pairs.rendered_row(p, r, b.back().row(r).data());
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        // Linear pictures are looked at as sRGB; what does not count is black in both.
        for (Grid<float>* g : {&a.back(), &b.back()}) {
          float& v = (*g)(r, c);
          v = pairs.in_display_values() ? v / 255.0F : pairs.codes(v / 255.0F) / 255.0F;
          if (mask.kind(r, c) == 0 || !std::isfinite(v)) v = 0.0F;
        }
      }
    }
  }
  const auto mean = [&](const std::vector<Grid<float>>& bands) {
    Grid<float> m(rows, cols);
    for (const auto& band : bands)
      for (std::size_t i = 0; i < m.cells().size(); ++i)
        m.cells()[i] += band.cells()[i] / static_cast<float>(bands.size());
    return m;
  };
  result.ssim = structural_similarity(mean(a), mean(b));
  if (a.size() != 1 && a.size() != 3) return;
  const Grid<float> seen = flip(a, b);
  double sum = 0.0;
  for (std::size_t i = 0; i < seen.cells().size(); ++i)
    if (mask.kind.cells()[i] != 0) sum += static_cast<double>(seen.cells()[i]);
  result.flip = result.pixels > 0 ? sum / static_cast<double>(result.pixels) : NAN;
}

PartComparison part_of(const std::vector<Sums>& all, std::size_t part) {
  PartComparison p;
  double n = 0.0;
  for (const Sums& s : all) {
    p.mean_abs_diff_255 += s.absolute[part], p.rmse_255 += s.square[part];
    p.bias_255 += s.sum[part], n += static_cast<double>(s.count[part]);
    p.pixels = std::max(p.pixels, s.count[part]);
  }
  if (n == 0.0) return p;
  p.mean_abs_diff_255 /= n, p.rmse_255 = std::sqrt(p.rmse_255 / n), p.bias_255 /= n;
  return p;
}

}  // namespace

Result<Comparison> compare_images(const LoadedImage& real, const LoadedImage& rendered,
                                  const CompareOptions& options) {
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

  Pairs pairs;
  pairs.real_eight_bit = real.eight_bit, pairs.rendered_eight_bit = rendered.eight_bit;
  const bool real_leads = a.size() >= b.size();
  const auto &leading = real_leads ? a : b, &other = real_leads ? b : a;
  for (std::size_t k = 0; k < leading.size(); ++k) {
    const Channel& mate = partner(leading, k, other);
    pairs.pairs.push_back({leading[k].name, (real_leads ? leading[k] : mate).values,
                           (real_leads ? mate : leading[k]).values});
  }
  const Mask mask = mask_of(rendered, rows, cols, options);
  MAQUETTE_TRY_VOID(match_light(pairs, mask, options.match));

  Comparison result;
  result.state = state_of(pairs, options.match);
  result.background_pixels = mask.background;
  result.difference = Grid<Rgb8>(rows, cols);
  result.absolute = Grid<std::uint8_t>(rows, cols);
  const std::vector<Sums> all = sum_up(pairs, mask, result);
  double square = 0.0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Sums& s = all[k];
    const std::size_t counted = s.count[0] + s.count[1];
    if (counted == 0)
      return fail(kImageFormat, fmt::format("channel {} has no pixel that is finite in both images "
                                            "and not background",
                                            pairs.pairs[k].name));
    const auto n = static_cast<double>(counted);
    result.channels.push_back({pairs.pairs[k].name, (s.absolute[0] + s.absolute[1]) / n,
                               std::sqrt((s.square[0] + s.square[1]) / n),
                               (s.sum[0] + s.sum[1]) / n, histogram_distance(s),
                               static_cast<double>(pairs.pairs[k].gain)});
    const double share = 1.0 / static_cast<double>(all.size());
    result.mean_abs_diff_255 += share * result.channels.back().mean_abs_diff_255;
    result.bias_255 += share * result.channels.back().bias_255;
    square += share * (s.square[0] + s.square[1]) / n;
    result.pixels = std::max(result.pixels, counted);
  }
  result.rmse_255 = std::sqrt(square);
  if (mask.has_edges) {
    result.rest = part_of(all, 0);
    result.shadow_edges = part_of(all, 1);
  }
  if (options.perceptual) look_at_both(pairs, mask, result);
  return result;
}

std::string to_json(const Comparison& comparison) {
  nlohmann::ordered_json json;
  json["schema"] = "maquette.compare/1";
  json["mean_abs_diff_255"] = comparison.mean_abs_diff_255;
  json["rmse_255"] = comparison.rmse_255;
  json["bias_255"] = comparison.bias_255;
  json["state"] = comparison.state;
  if (!std::isnan(comparison.ssim)) json["ssim"] = comparison.ssim;
  if (!std::isnan(comparison.flip)) json["flip"] = comparison.flip;
  json["pixels"] = comparison.pixels;
  json["background_pixels"] = comparison.background_pixels;
  const auto part = [&](const char* name, const std::optional<PartComparison>& p) {
    if (!p) return;
    json[name] = {{"pixels", p->pixels},
                  {"mean_abs_diff_255", p->mean_abs_diff_255},
                  {"rmse_255", p->rmse_255},
                  {"bias_255", p->bias_255}};
  };
  part("shadow_edges", comparison.shadow_edges);
  part("outside_shadow_edges", comparison.rest);
  json["width_px"] = comparison.difference.cols();
  json["height_px"] = comparison.difference.rows();
  json["channels"] = nlohmann::ordered_json::array();
  for (const ChannelComparison& channel : comparison.channels)
    json["channels"].push_back({{"name", channel.name},
                                {"mean_abs_diff_255", channel.mean_abs_diff_255},
                                {"rmse_255", channel.rmse_255},
                                {"bias_255", channel.bias_255},
                                {"histogram_distance_255", channel.histogram_distance_255},
                                {"gain", channel.gain}});
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace maquette::camera
