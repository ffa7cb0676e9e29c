// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/compare.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "camera/compare_perceptual.hpp"
#include "camera/effects/frame.hpp"
#include "camera/render.hpp"
#include "camera/srgb.hpp"
#include "core/mask.hpp"

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

/// Files of 8 bits, and what `expose` has written behind a tone curve.
bool for_screens(const LoadedImage& image) {
  return image.eight_bit || text_in(image.metadata, "maquette:signal") == name_of(Signal::display);
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

/// srgb8() by its thresholds: the first guess from a table, then at most one up. A step of the
/// table is 1.2e-4, thresholds lie at least 3e-4 apart.
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
    from_[256] = INFINITY;
    for (std::size_t i = 0; i < guess_.size(); ++i)
      guess_[i] = srgb8(static_cast<double>(i) / kSteps);
  }
  [[nodiscard]] float operator()(float v) const {
    const float inside = std::min(v > 0.0F ? v : 0.0F, 1.0F);
    const auto guess = static_cast<std::size_t>(
        guess_[static_cast<std::size_t>(static_cast<int>(inside * kSteps))]);
    const auto code =
        static_cast<float>(static_cast<int>(guess) + static_cast<int>(inside >= from_[guess + 1]));
    return v == v ? code : v;
  }

 private:
  static constexpr int kSteps = 8192;
  std::array<float, 257> from_{};
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
  bool real_encoded = false, rendered_encoded = false;
  bool matched = false;
  SrgbCodes codes;

  [[nodiscard]] bool in_display_values() const { return real_encoded || rendered_encoded; }
  void real_row(const Pair& p, std::ptrdiff_t r, float* to) const {
    convert(p.real->row(r), real_encoded, 1.0F, false, to);
  }
  void rendered_row(const Pair& p, std::ptrdiff_t r, float* to) const {
    convert(p.rendered->row(r), rendered_encoded, p.gain, matched, to);
  }

 private:
  void convert(std::span<const float> from, bool encoded, float gain, bool scaled,
               float* to) const {
    const std::size_t n = from.size();
    if (in_display_values() && !encoded) {
      for (std::size_t i = 0; i < n; ++i) to[i] = codes(gain * from[i]);
    } else if (encoded && scaled) {
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

/// Black: left out, grey: compared, white: of an edge of light and shadow.
Grid<std::uint8_t> shown(const Mask& mask) {
  constexpr std::array<std::uint8_t, 3> kGreys{0, 128, 255};
  Grid<std::uint8_t> picture(mask.kind.rows(), mask.kind.cols());
  for (std::size_t i = 0; i < picture.cells().size(); ++i)
    picture.cells()[i] = kGreys[mask.kind.cells()[i]];
  return picture;
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
};

/// Rounded, from 0 to 255; 0 for what is no number.
std::uint8_t byte_of(float v) {
  const float up = v + 0.5F;
  return static_cast<std::uint8_t>(
      static_cast<int>(up > 0.0F ? (up < 255.0F ? up : 255.0F) : 0.0F));
}

/// Kinds of pixel that a row of the mask has.
struct RowKinds {
  bool all_ones = true, edges = false;
};
RowKinds kinds_of(std::span<const std::uint8_t> row) {
  std::uint8_t both = 1, any = 0;
  for (const std::uint8_t k : row)
    both = static_cast<std::uint8_t>(both & (k == 1 ? 1 : 0)), any |= k;
  return {both != 0, (any & 2U) != 0};
}

/// Differences of one row, eight at a time; 0 where a pixel does not count.
struct RowWork {
  static constexpr std::size_t kLanes = 8;
  std::vector<float> a, b, d;
  std::vector<std::uint8_t> bin_a, bin_b, counts;

  explicit RowWork(std::size_t cols)
      : a(padded(cols)),
        b(padded(cols)),
        d(padded(cols)),
        bin_a(padded(cols)),
        bin_b(padded(cols)),
        counts(padded(cols)) {}
  static std::size_t padded(std::size_t cols) { return (cols + kLanes - 1) / kLanes * kLanes; }

  /// d and what counts, of pixels of kind `part` + 1 (all, if the row has no other).
  void subtract(const std::uint8_t* kind, std::size_t n, std::size_t part, bool all) {
    const auto wanted = static_cast<std::uint8_t>(part + 1);
    for (std::size_t i = 0; i < n; ++i) {
      const float e = a[i] - b[i];
      const bool in = (e - e == 0.0F) && (all || kind[i] == wanted);
      d[i] = in ? e : 0.0F;
      counts[i] = in ? 1 : 0;
    }
  }
  void sum_up(std::size_t n, std::size_t part, Sums& to) const {
    std::array<double, kLanes> absolute{}, square{}, sum{};
    for (std::size_t i = 0; i < n; i += kLanes)
      for (std::size_t l = 0; l < kLanes; ++l) {
        const auto e = static_cast<double>(d[i + l]);
        absolute[l] += std::abs(e), square[l] += e * e, sum[l] += e;
      }
    std::uint32_t count = 0;
    for (std::size_t i = 0; i < n; ++i) count += counts[i];
    for (std::size_t l = 0; l < kLanes; ++l)
      to.absolute[part] += absolute[l], to.square[part] += square[l], to.sum[part] += sum[l];
    to.count[part] += count;
  }
  /// Two tables in turn, so that equal neighbours do not wait for each other.
  void count_bins(std::size_t n, bool all, std::array<std::array<std::uint32_t, 256>, 4>& bins) {
    for (std::size_t i = 0; i < n; ++i) {
      bin_a[i] = byte_of(a[i]), bin_b[i] = byte_of(b[i]);
    }
    if (all) {
      std::size_t i = 0;
      for (; i + 1 < n; i += 2) {
        ++bins[0][bin_a[i]], ++bins[1][bin_b[i]];
        ++bins[2][bin_a[i + 1]], ++bins[3][bin_b[i + 1]];
      }
      if (i < n) ++bins[0][bin_a[i]], ++bins[1][bin_b[i]];
    } else {
      for (std::size_t i = 0; i < n; ++i)
        bins[0][bin_a[i]] += counts[i], bins[1][bin_b[i]] += counts[i];
    }
  }
};

/// All channels, in strips of rows whose sums are added in their order.
std::vector<Sums> sum_up(const Pairs& pairs, const Mask& mask, Comparison& result) {
  constexpr std::ptrdiff_t kStrip = 32;
  const std::ptrdiff_t rows = mask.kind.rows(), strips = (rows + kStrip - 1) / kStrip;
  const auto cols = static_cast<std::size_t>(mask.kind.cols());
  const bool pictures = !result.difference.empty();
  std::vector<std::vector<Sums>> parts(static_cast<std::size_t>(strips));
  const float share = 1.0F / static_cast<float>(pairs.pairs.size());
  tbb::parallel_for(std::ptrdiff_t{0}, strips, [&](std::ptrdiff_t strip) {
    auto& sums = parts[static_cast<std::size_t>(strip)];
    sums.resize(pairs.pairs.size());
    RowWork work(cols);
    std::vector<float> mean(cols), absolute(cols);
    std::vector<std::array<std::array<std::uint32_t, 256>, 4>> bins(pairs.pairs.size());
    for (std::ptrdiff_t r = strip * kStrip; r < std::min((strip + 1) * kStrip, rows); ++r) {
      const std::uint8_t* kind = mask.kind.row(r).data();
      const RowKinds kinds = kinds_of(mask.kind.row(r));
      std::fill(mean.begin(), mean.end(), 0.0F);
      std::fill(absolute.begin(), absolute.end(), 0.0F);
      for (std::size_t k = 0; k < pairs.pairs.size(); ++k) {
        pairs.real_row(pairs.pairs[k], r, work.a.data());
        pairs.rendered_row(pairs.pairs[k], r, work.b.data());
        for (std::size_t part = 0; part < (kinds.edges ? 2U : 1U); ++part) {
          const std::size_t before = sums[k].count[part];
          work.subtract(kind, cols, part, kinds.all_ones);
          work.sum_up(cols, part, sums[k]);
          work.count_bins(cols, sums[k].count[part] - before == cols, bins[k]);
          if (!pictures) continue;
          for (std::size_t c = 0; c < cols; ++c) {
            mean[c] += share * work.d[c];
            absolute[c] += share * std::abs(work.d[c]);
          }
        }
      }
      if (!pictures) continue;
      std::uint8_t* difference = result.difference.row(r).data();
      std::uint8_t* distance = result.absolute.row(r).data();
      for (std::size_t c = 0; c < cols; ++c) {
        difference[c] = byte_of(128.0F + mean[c]);
        distance[c] = byte_of(absolute[c]);
      }
    }
    for (std::size_t k = 0; k < sums.size(); ++k)
      for (std::size_t i = 0; i < 256; ++i) {
        sums[k].real[i] = bins[k][0][i] + bins[k][2][i];
        sums[k].rendered[i] = bins[k][1][i] + bins[k][3][i];
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
      if (pairs.real_encoded) a = linear_of_srgb(a);
      if (pairs.rendered_encoded) b = linear_of_srgb(b);
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
                     : pairs.real_encoded && pairs.rendered_encoded
                         ? "both encoded for screens, compared as they are"
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

LoadedImage with_masks(Image image) {
  Grid<float> lit(image.lit.rows(), image.lit.cols());
  std::copy(image.lit.cells().begin(), image.lit.cells().end(), lit.cells().begin());
  LoadedImage out;
  out.names = image.bands.size() == 1 ? std::vector<std::string>{"Y"}
                                      : std::vector<std::string>{"R", "G", "B"};
  out.channels = std::move(image.bands);
  out.names.insert(out.names.end(), {"Z", "lit"});
  out.channels.push_back(std::move(image.depth_mm));
  out.channels.push_back(std::move(lit));
  return out;
}

std::vector<Grid<float>> linear_light(const LoadedImage& image) {
  auto channels = light_channels(image);
  // OpenEXR's order is the alphabet's.
  const auto place = [](const Channel& c) {
    return std::string_view("rgb").find(lower(c.name.substr(c.name.rfind('.') + 1)));
  };
  std::stable_sort(channels.begin(), channels.end(),
                   [&](const Channel& a, const Channel& b) { return place(a) < place(b); });
  std::vector<Grid<float>> light;
  for (const Channel& c : channels) {
    light.push_back(*c.values);
    if (for_screens(image))
      for (float& v : light.back().cells()) v = linear_of_srgb(v);
  }
  return light;
}

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
  pairs.real_encoded = for_screens(real), pairs.rendered_encoded = for_screens(rendered);
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
  if (options.pictures) {
    result.difference = Grid<std::uint8_t>(rows, cols);
    result.absolute = Grid<std::uint8_t>(rows, cols);
    if (mask.has_edges) result.edges = shown(mask);
  }
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
