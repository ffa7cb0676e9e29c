// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/stack.hpp"

#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/parallel_for.h>

namespace maquette::camera {
namespace {

template <class T>
concept WorksOnRows = requires(const T& e, const Shot& s, const Frame& f) {
  rows(e, s, f);
};

template <class T>
concept MayFail = requires(const T& e, const Shot& s, Frame& f) {
  { apply(e, s, f) } -> std::same_as<Result<void>>;
};

template <std::size_t... I>
const std::array<EffectInfo, sizeof...(I)>& infos(std::index_sequence<I...>) {
  static const std::array<EffectInfo, sizeof...(I)> all{
      std::variant_alternative_t<I, Effect>::kInfo...};
  return all;
}

const auto& all_infos() {
  return infos(std::make_index_sequence<std::variant_size_v<Effect>>());
}

Result<void> check_frame(const Frame& frame, const Shot& shot) {
  if (frame.bands.size() != 1 && frame.bands.size() != 3)
    return fail(kFrame, fmt::format("the picture has {} bands; one (grey) or three (red, green, "
                                    "blue) are possible",
                                    frame.bands.size()));
  const auto rows = shot.intrinsics.height_px, cols = shot.intrinsics.width_px;
  for (const Grid<float>& band : frame.bands)
    if (band.rows() != rows || band.cols() != cols)
      return fail(kFrame, fmt::format("the picture has {} x {} pixels, the camera {} x {}; render "
                                      "at the camera's resolution",
                                      band.cols(), band.rows(), cols, rows));
  for (const auto& [what, known] : {std::pair{"depth", &frame.depth_mm}, {"lit", &frame.lit}})
    if (!known->empty() && (known->rows() != rows || known->cols() != cols))
      return fail(kFrame, fmt::format("{} has {} x {} pixels, the picture {} x {}", what,
                                      known->cols(), known->rows(), cols, rows));
  std::vector<unsigned char> wrong(static_cast<std::size_t>(rows), 0);
  for (const Grid<float>& band : frame.bands) {
    tbb::parallel_for(0, rows, [&](int r) {
      int bad = 0;
      for (const float v : band.row(r)) bad |= static_cast<int>(!(v - v == 0.0F));
      wrong[static_cast<std::size_t>(r)] = bad != 0 ? 1 : 0;
    });
    const auto first = std::find(wrong.begin(), wrong.end(), 1);
    if (first == wrong.end()) continue;
    const auto row = first - wrong.begin();
    const auto values = band.row(row);
    const auto col =
        std::find_if(values.begin(), values.end(), [](float v) { return !std::isfinite(v); }) -
        values.begin();
    return fail(kFrame,
                fmt::format("radiance at row {}, column {} is not a finite number", row, col));
  }
  return {};
}

/// Effects that work on rows go over each row together, while it is in the cache.
void run_rows(const std::vector<RowFunction>& functions, Frame& frame) {
  tbb::parallel_for(std::ptrdiff_t{0}, frame.bands.front().rows(), [&](std::ptrdiff_t r) {
    std::vector<std::span<float>> spans;
    for (Grid<float>& band : frame.bands) spans.push_back(band.row(r));
    for (const RowFunction& f : functions) f(r, spans);
  });
}

Result<Frame> run_all(const Stack& stack, const Shot& shot, Frame frame, const RunContext& run) {
  std::vector<RowFunction> waiting;
  const auto flush = [&] {
    if (!waiting.empty()) run_rows(waiting, frame);
    waiting.clear();
  };
  for (std::size_t i = 0; i < stack.size(); ++i) {
    if (run.stopped()) return fail(kCancelled, "stopped");
    const Result<void> done = std::visit(
        [&](const auto& e) -> Result<void> {
          using T = std::decay_t<decltype(e)>;
          if constexpr (WorksOnRows<T>) {
            waiting.push_back(rows(e, shot, frame));
          } else {
            flush();
            if constexpr (MayFail<T>)
              return apply(e, shot, frame);
            else
              apply(e, shot, frame);
          }
          return {};
        },
        stack[i]);
    if (!done) return tl::unexpected(done.error());
    frame.signal = info(stack[i]).gives;
    run.progress(static_cast<double>(i + 1) / static_cast<double>(stack.size()));
  }
  flush();
  return frame;
}

/// A colour sensor sees grey light in each band; a grey one the mean of the bands.
void fit_bands(Frame& frame, std::size_t sensor_bands) {
  if (frame.bands.size() == 1 && sensor_bands == 3) {
    frame.bands.resize(3, frame.bands.front());
  } else if (frame.bands.size() == 3 && sensor_bands == 1) {
    const auto r = frame.bands[0].cells(), g = frame.bands[1].cells(), b = frame.bands[2].cells();
    for (std::size_t i = 0; i < r.size(); ++i) r[i] = (r[i] + g[i] + b[i]) / 3.0F;
    frame.bands.resize(1);
  }
}

/// Empty where two effects of the same kind of signal may change places, right or wrong.
std::string why_impossible(const EffectInfo& a, const EffectInfo& b) {
  if (a.takes == a.gives && b.takes == b.gives && a.takes == b.takes) return {};
  const auto said = [](const EffectInfo& e) {
    return e.takes == e.gives
               ? fmt::format("'{}' works on {}", e.name, name_of(e.takes))
               : fmt::format("'{}' makes {} of {}", e.name, name_of(e.gives), name_of(e.takes));
  };
  return fmt::format("{} and {}", said(a), said(b));
}

/// What counts as 255 in the picture's last signal.
double full_range(Signal signal, const Shot& shot) {
  switch (signal) {
    case Signal::dn:
      return largest_dn(shot);
    case Signal::electrons:
      return shot.full_well_e;
    case Signal::photons:
      return shot.full_well_e /
             *std::max_element(shot.quantum_efficiency.begin(), shot.quantum_efficiency.end());
    case Signal::radiance:
    case Signal::linear:
    case Signal::display:
      return 1.0;
  }
  return 1.0;
}

}  // namespace

const EffectInfo& info(const Effect& effect) {
  return all_infos()[effect.index()];
}

std::vector<std::string_view> effect_names() {
  std::vector<std::string_view> names;
  for (const EffectInfo& i : all_infos()) names.push_back(i.name);
  return names;
}

Result<void> check(const Stack& stack, const Shot& shot) {
  MAQUETTE_TRY_VOID(check(shot));
  Signal signal = Signal::radiance;
  for (std::size_t i = 0; i < stack.size(); ++i) {
    const EffectInfo& now = info(stack[i]);
    if (i > 0) {
      const EffectInfo& before = info(stack[i - 1]);
      if (stack[i].index() == stack[i - 1].index())
        return fail(kStackOrder, fmt::format("effect '{}' stands twice in the stack", now.name));
      if (stack[i].index() < stack[i - 1].index())
        return fail(kStackOrder,
                    fmt::format("effect '{}' stands after '{}', but acts before it: {}. And '{}' "
                                "stands where it does because {}. The order is: {}",
                                now.name, before.name, now.why, before.name, before.why,
                                fmt::join(effect_names(), ", ")));
    }
    if (now.takes != signal)
      return fail(kStackOrder,
                  fmt::format("effect '{}' takes {}, but {} gives {}: an effect between them that "
                              "turns one into the other is missing",
                              now.name, name_of(now.takes),
                              i == 0 ? std::string("the scene")
                                     : fmt::format("'{}'", info(stack[i - 1]).name),
                              name_of(signal)));
    signal = now.gives;
  }
  for (const Effect& effect : stack)
    MAQUETTE_TRY_VOID(std::visit([&](const auto& e) { return check(e, shot); }, effect));
  return {};
}

Result<Frame> expose(const Stack& stack, const Shot& shot, Frame frame, const RunContext& run) {
  MAQUETTE_TRY_VOID(check(stack, shot));
  MAQUETTE_TRY_VOID(check_frame(frame, shot));
  fit_bands(frame, shot.quantum_efficiency.size());
  return run_all(stack, shot, std::move(frame), run);
}

Result<std::vector<Swap>> swaps(const Stack& stack, const Shot& shot, const Frame& frame,
                                const RunContext& run) {
  MAQUETTE_TRY(const Frame right, expose(stack, shot, frame));
  const double scale = 255.0 / full_range(right.signal, shot);
  Frame light = frame;
  fit_bands(light, shot.quantum_efficiency.size());
  std::vector<Swap> result;
  for (std::size_t i = 0; i < stack.size(); ++i) {
    for (std::size_t j = i + 1; j < stack.size(); ++j) {
      const EffectInfo &a = info(stack[i]), &b = info(stack[j]);
      Swap swap{std::string(a.name), std::string(b.name)};
      swap.impossible = why_impossible(a, b);
      if (!swap.impossible.empty()) {
        swap.mean_abs_255 = swap.max_abs_255 = NAN;
        result.push_back(std::move(swap));
        continue;
      }
      Stack other = stack;
      std::swap(other[i], other[j]);
      MAQUETTE_TRY(const Frame wrong, run_all(other, shot, light, RunContext{run.stop}));
      if (wrong.bands.size() != right.bands.size()) {
        swap.impossible = "the picture would have other bands";
        swap.mean_abs_255 = swap.max_abs_255 = NAN;
        result.push_back(std::move(swap));
        continue;
      }
      std::size_t count = 0;
      for (std::size_t band = 0; band < right.bands.size(); ++band)
        for (std::size_t p = 0; p < right.bands[band].cells().size(); ++p, ++count) {
          const double d = scale * std::abs(static_cast<double>(wrong.bands[band].cells()[p]) -
                                            static_cast<double>(right.bands[band].cells()[p]));
          swap.mean_abs_255 += d;
          swap.max_abs_255 = std::max(swap.max_abs_255, d);
        }
      swap.mean_abs_255 /= static_cast<double>(count);
      result.push_back(std::move(swap));
    }
    run.progress(static_cast<double>(i + 1) / static_cast<double>(stack.size()));
  }
  return result;
}

}  // namespace maquette::camera
