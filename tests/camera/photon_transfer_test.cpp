// SPDX-License-Identifier: GPL-3.0-or-later

// camera/frame_series.hpp, camera/photon_transfer.hpp. Frames come from a sensor written for this
// test (std::poisson_distribution, std::normal_distribution), that shares nothing with
// camera/effects:
//   two frames ........... EMVA's formula by hand; a lamp that drifts is no noise
//   gain and noises ...... against what the frames were made with: within 4 stated uncertainties,
//                          the variance against photon transfer within 2 %
//   uncertainties ........ 200 sensors: deviations over stated uncertainties scatter by 1
//   pattern .............. DSNU, columns, PRNU under a vignette, hot pixels
//   mosaic ............... four planes of different light, one gain
//   full well ............ charge clipped; converter that ends first; none that saturates
//   the room's own stack . expose() with known parameters comes back
//   bad frames ........... codes and words

#include "camera/photon_transfer.hpp"

#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/stack.hpp"
#include "support/matchers.hpp"
#include "support/shots.hpp"

namespace maquette::camera {
namespace {

using testing_support::FailsWith;
using testing_support::Succeeds;

/// What is hidden from the calibration.
struct Sensor {
  int rows = 96, cols = 128;
  double gain = 2.5, black = 100.0, read_e = 8.0, row_e = 0.0, column_e = 0.0, dark_e_s = 0.0,
         dsnu_e = 0.0, prnu = 0.0, well_e = 20000.0, largest_dn = 16383.0, vignette = 0.0;
  unsigned seed = 1;
};

/// A sensor with its own fixed pattern and clock.
class Chip {
 public:
  explicit Chip(const Sensor& s) : s_(s), random_(s.seed) {
    std::normal_distribution<double> normal;
    offset_ = Grid<double>(s.rows, s.cols), response_ = Grid<double>(s.rows, s.cols, 1.0);
    std::vector<double> columns;
    for (int c = 0; c < s.cols; ++c) columns.push_back(s.column_e * normal(random_));
    for (int r = 0; r < s.rows; ++r)
      for (int c = 0; c < s.cols; ++c) {
        offset_(r, c) = s.dsnu_e * normal(random_) + columns[static_cast<std::size_t>(c)];
        const double x = (c + 0.5) / s.cols - 0.5, y = (r + 0.5) / s.rows - 0.5;
        response_(r, c) = (1.0 + s.prnu * normal(random_)) * (1.0 - s.vignette * (x * x + y * y));
      }
  }
  Grid<double> hot_e_s;

  Grid<float> frame(double exposure_s, const std::array<double, 4>& electrons) {
    Grid<float> out(s_.rows, s_.cols);
    std::normal_distribution<double> normal;
    for (int r = 0; r < s_.rows; ++r) {
      const double row = s_.row_e * normal(random_);
      for (int c = 0; c < s_.cols; ++c) {
        const auto plane = static_cast<std::size_t>(2 * (r & 1) + (c & 1));
        double mean = electrons[plane] * response_(r, c) + s_.dark_e_s * exposure_s;
        if (!hot_e_s.empty()) mean += exposure_s * hot_e_s(r, c);
        double e =
            mean > 0.0 ? static_cast<double>(std::poisson_distribution<long>(mean)(random_)) : 0.0;
        e = std::min(e, s_.well_e);
        e += offset_(r, c) + row + s_.read_e * normal(random_);
        out(r, c) = static_cast<float>(
            std::clamp(std::floor(s_.black + e / s_.gain + 0.5), 0.0, s_.largest_dn));
      }
    }
    return out;
  }
  FrameSeries series(double exposure_s, double electrons, int frames, int planes = 1) {
    return series(exposure_s, {electrons, electrons, electrons, electrons}, frames, planes);
  }
  FrameSeries series(double exposure_s, const std::array<double, 4>& electrons, int frames,
                     int planes) {
    FrameSeries out;
    out.exposure_s = exposure_s, out.planes = planes;
    for (int i = 0; i < frames; ++i) add_frame(out, frame(exposure_s, electrons), s_.largest_dn);
    return out;
  }

 private:
  Sensor s_;
  std::mt19937_64 random_;
  Grid<double> offset_, response_;
};

struct Levels {
  std::vector<LevelStatistics> bright, dark;
};
Levels levels_of(Chip& chip, const std::vector<double>& electrons, int frames = 2,
                 const std::vector<double>& dark_times = {0.01}) {
  Levels l;
  for (const double t : dark_times)
    l.dark.push_back(statistics_of(chip.series(t, 0.0, frames), -1));
  for (const double e : electrons)
    l.bright.push_back(statistics_of(chip.series(dark_times.front(), e, frames), 0));
  return l;
}

const std::vector<double> kLights{200, 600, 1500, 3000, 5000, 8000, 11000, 14000, 17000, 40000};

TEST(FrameSeriesOf, TwoFramesIsEmvasFormula) {
  // The second frame is 6 brighter in the mean; what is left of a - b is -+1 and +-2.
  const std::vector<float> noise{1, -1, 2, -2};
  Grid<float> a(16, 16), b(16, 16);
  double square = 0.0;
  for (std::size_t i = 0; i < a.cells().size(); ++i) {
    a.cells()[i] = 50.0F;
    b.cells()[i] = 56.0F + noise[i % 4];
    square += static_cast<double>(noise[i % 4] * noise[i % 4]);
  }
  FrameSeries s;
  add_frame(s, a, 255.0);
  add_frame(s, b, 255.0);
  const LevelStatistics level = statistics_of(s, -1);
  EXPECT_NEAR(level.variance_dn2.value, 0.5 * square / 256.0, 1e-5);
  EXPECT_NEAR(level.mean_dn.value, 53.0, 1e-5);
  EXPECT_EQ(level.pixels, 256U);
}

TEST(FrameSeriesOf, ManyFramesIsTheSampleVariance) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  std::vector<Grid<float>> frames(9, Grid<float>(24, 24));
  FrameSeries s;
  for (auto& f : frames) {
    for (float& v : f.cells()) v = static_cast<float>(1000.0 + 5.0 * normal(random));
    add_frame(s, f, 65535.0);
  }
  std::vector<double> mean;
  for (const auto& f : frames) {
    mean.push_back(0.0);
    for (const float v : f.cells()) mean.back() += static_cast<double>(v) / 576.0;
  }
  double sum = 0.0;
  for (std::size_t i = 0; i < 576; ++i) {
    double m = 0.0, q = 0.0;
    for (std::size_t k = 0; k < 9; ++k)
      m += (static_cast<double>(frames[k].cells()[i]) - mean[k]) / 9.0;
    for (std::size_t k = 0; k < 9; ++k) {
      const double d = static_cast<double>(frames[k].cells()[i]) - mean[k] - m;
      q += d * d;
    }
    sum += q / 8.0;
  }
  EXPECT_NEAR(statistics_of(s, -1).variance_dn2.value, sum / 576.0, 2e-4);  // float sums
}

TEST(PhotonTransfer, FindsWhatTheSensorIs) {
  Sensor hidden;
  hidden.rows = 200, hidden.cols = 300, hidden.row_e = 3.0, hidden.dark_e_s = 30.0;
  hidden.dsnu_e = 4.0, hidden.prnu = 0.01;
  Chip chip(hidden);
  const Levels l = levels_of(chip, kLights, 4, {0.01, 2.0, 5.0, 10.0});
  const auto c = photon_transfer(l.bright, l.dark, hidden.largest_dn);
  ASSERT_THAT(c, Succeeds());
  const auto near = [](const Measured& m, double truth, const char* what) {
    EXPECT_NEAR(m.value, truth, 4.0 * m.u) << what << " +- " << m.u;
  };
  near(c->gain_e_per_dn, hidden.gain, "gain");
  EXPECT_LT(c->gain_e_per_dn.u / hidden.gain, 0.002);
  near(c->read_noise_e, hidden.read_e, "read noise");
  near(c->row_noise_e, hidden.row_e, "row noise");
  near(c->dark_current_e_s, hidden.dark_e_s, "dark current");
  near(c->black_level_dn, hidden.black, "black level");
  near(c->temporal_dark_noise_e, std::hypot(8.0, 3.0, std::sqrt(0.3)), "temporal dark noise");
  near(c->full_well_e, hidden.well_e, "full well");
  EXPECT_GT(c->saturation_e.value, 16000.0);
  EXPECT_LE(c->saturation_e.value, hidden.well_e * 1.01);
  for (const TransferPoint& p : c->points) {
    EXPECT_EQ(p.used, p.signal_dn < 0.7 * 17000.0 / 2.5 + 1.0) << p.signal_dn;
    if (!p.saturated) {
      // The shot noise of light: the straight line itself, within 2 %.
      EXPECT_NEAR(p.variance_dn2.value / (p.signal_dn / hidden.gain), 1.0, 0.02);
    }
  }
  EXPECT_LT(c->chi2_per_dof, 3.0);
}

TEST(PhotonTransfer, StatesUncertaintiesThatHold) {
  // Root mean square of (value - truth) / u over sensors: 1, and 1 +- 0.05 for 200 of them (a
  // chi-squared variable's scatter); read and row noise at a finite number of rows: 10 % wide.
  std::array<double, 5> square{};
  constexpr int kSensors = 200;
  for (int i = 0; i < kSensors; ++i) {
    Sensor hidden;
    hidden.rows = 64, hidden.cols = 64, hidden.row_e = 4.0, hidden.dark_e_s = 20.0;
    hidden.seed = static_cast<unsigned>(1000 + i);
    Chip chip(hidden);
    const Levels l =
        levels_of(chip, {500, 1500, 4000, 8000, 14000, 19000}, 3, {0.01, 1.0, 3.0, 6.0, 10.0});
    const auto c = photon_transfer(l.bright, l.dark, hidden.largest_dn);
    ASSERT_THAT(c, Succeeds());
    const auto add = [&](std::size_t k, const Measured& m, double truth) {
      square[k] += std::pow((m.value - truth) / m.u, 2.0) / kSensors;
    };
    add(0, c->gain_e_per_dn, hidden.gain);
    add(1, c->read_noise_e, hidden.read_e);
    add(2, c->row_noise_e, hidden.row_e);
    add(3, c->dark_current_e_s, hidden.dark_e_s);
    add(4, c->black_level_dn, hidden.black);
  }
  const std::array<const char*, 5> names{"gain", "read", "row", "dark current", "black"};
  for (std::size_t k = 0; k < 5; ++k) {
    RecordProperty(names[k], fmt::format("{:.3f}", std::sqrt(square[k])));
    EXPECT_GT(std::sqrt(square[k]), 0.75) << names[k];
    EXPECT_LT(std::sqrt(square[k]), 1.2) << names[k];
  }
}

TEST(DarkPatternOf, SplitsPixelsAndColumns) {
  Sensor hidden;
  hidden.rows = 300, hidden.cols = 400, hidden.dsnu_e = 6.0, hidden.column_e = 3.0;
  hidden.row_e = 5.0, hidden.black = 400.0;
  Chip chip(hidden);
  const DarkPattern p = dark_pattern(chip.series(0.01, 0.0, 16));
  EXPECT_NEAR(p.pixel_dn.value, 6.0 / 2.5, 4.0 * p.pixel_dn.u);
  EXPECT_LT(p.pixel_dn.u, 0.03);
  EXPECT_NEAR(p.column_dn.value, 3.0 / 2.5, 4.0 * p.column_dn.u);  // of 400 columns: 3.5 %
  EXPECT_NEAR(p.row_dn.value, 0.0, 3.0 * p.row_dn.u);
  EXPECT_NEAR(p.dsnu_dn.value, std::hypot(6.0, 3.0) / 2.5, 4.0 * p.dsnu_dn.u);
  EXPECT_EQ(p.hot_found, 0U);
}

TEST(DarkPatternOf, CountsHotPixelsApart) {
  Sensor hidden;
  hidden.rows = 300, hidden.cols = 400, hidden.dsnu_e = 6.0;
  Chip chip(hidden);
  chip.hot_e_s = Grid<double>(300, 400);
  std::mt19937_64 random(3);
  std::exponential_distribution<double> rate(1.0 / 300.0);
  std::uniform_real_distribution<double> u;
  for (double& v : chip.hot_e_s.cells()) v = u(random) < 0.002 ? rate(random) : 0.0;
  const DarkPattern p = dark_pattern(chip.series(2.0, 0.0, 16));
  // 240 of them, their rates' mean is known to 1 / sqrt(200) = 7 %, their number as well.
  EXPECT_NEAR(p.hot_share, 0.002, 0.2 * 0.002);
  EXPECT_NEAR(p.hot_mean_dn * 2.5 / 2.0, 300.0, 0.25 * 300.0);
  // Those that hide below six standard deviations: 0.01 % of pixels with up to 15 DN.
  EXPECT_NEAR(p.pixel_dn.value, 6.0 / 2.5, 0.08);
}

TEST(ResponsePatternOf, IsNotTheLens) {
  for (const int planes : {1, 4}) {
    Sensor hidden;
    hidden.rows = 200, hidden.cols = 300, hidden.prnu = 0.01, hidden.dsnu_e = 10.0;
    hidden.vignette = 0.8;
    Chip chip(hidden);
    const Measured p = response_pattern(
        chip.series(0.01, {9000.0, 6000.0, 6000.0, 4000.0}, 8, planes), chip.series(0.01, 0.0, 8));
    if (planes == 4) {
      EXPECT_NEAR(p.value, 0.01, 4.0 * p.u);
      EXPECT_LT(p.u, 2e-4);
    } else {
      EXPECT_GT(p.value, 0.1);  // four colours taken for one
    }
  }
}

TEST(PhotonTransfer, OfAMosaicHasOneGain) {
  Sensor hidden;
  hidden.rows = 200, hidden.cols = 200;
  Chip chip(hidden);
  std::vector<LevelStatistics> bright, dark{statistics_of(chip.series(0.01, 0.0, 4), -1)};
  for (const double light : {0.05, 0.2, 0.4, 0.7}) {
    const FrameSeries s =
        chip.series(0.01, {8000.0 * light, 16000.0 * light, 16000.0 * light, 5000.0 * light}, 4, 4);
    for (int p = 0; p < 4; ++p) bright.push_back(statistics_of(s, p));
  }
  const auto c = photon_transfer(bright, dark, hidden.largest_dn);
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->gain_e_per_dn.value, hidden.gain, 4.0 * c->gain_e_per_dn.u);
  EXPECT_FALSE(c->full_well_e.known());
  EXPECT_THAT(c->notes, testing::Contains(testing::HasSubstr("no level saturates")));
}

TEST(PhotonTransfer, SaysWhenTheConverterEndsFirst) {
  Sensor hidden;
  hidden.largest_dn = 4095.0;  // 9988 e
  Chip chip(hidden);
  const Levels l = levels_of(chip, {500, 2000, 4000, 6000, 8000, 15000});
  const auto c = photon_transfer(l.bright, l.dark, hidden.largest_dn);
  ASSERT_THAT(c, Succeeds());
  EXPECT_FALSE(c->full_well_e.known());
  EXPECT_THAT(c->notes, testing::Contains(testing::HasSubstr("converter ends before the well")));
  EXPECT_TRUE(c->points.back().saturated);
}

TEST(PhotonTransfer, GivesTheStacksParametersBack) {
  // The room's own effects, whose generator is tested for itself.
  Shot shot = testing_support::shot_of(256, 192);
  shot.quantum_efficiency = {0.5};
  shot.gain_e_per_dn = 3.0, shot.black_level_dn = 200.0, shot.full_well_e = 30000.0;
  const Stack stack{Exposure{}, QuantumEfficiency{}, Prnu{0.008},     ShotNoise{},
                    FullWell{}, Dsnu{5.0},           ReadNoise{12.0}, RowColumnNoise{4.0, 0.0},
                    Adc{}};
  int clock = 0;
  const auto series = [&](double light, int frames) {
    FrameSeries s;
    s.exposure_s = shot.exposure_s;
    for (int i = 0; i < frames; ++i) {
      shot.time_s = ++clock;
      const auto f = expose(stack, shot, testing_support::flat(256, 192, light));
      EXPECT_THAT(f, Succeeds());
      add_frame(s, f->bands[0], largest_dn(shot));
    }
    return s;
  };
  const FrameSeries dark = series(0.0, 8), half = series(0.5, 8);
  std::vector<LevelStatistics> bright{statistics_of(half, 0)};
  for (const double light : {0.02, 0.1, 0.3, 0.65, 0.9, 2.0})
    bright.push_back(statistics_of(series(light, 2), 0));
  const auto c = photon_transfer(bright, {statistics_of(dark, -1)}, largest_dn(shot));
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->gain_e_per_dn.value, 3.0, 4.0 * c->gain_e_per_dn.u);
  EXPECT_NEAR(c->gain_e_per_dn.value, 3.0, 0.06);  // 2 %
  EXPECT_NEAR(c->read_noise_e.value, 12.0, 4.0 * c->read_noise_e.u);
  EXPECT_NEAR(c->row_noise_e.value, 4.0, 4.0 * c->row_noise_e.u);
  EXPECT_NEAR(c->full_well_e.value, 30000.0, 4.0 * c->full_well_e.u);
  EXPECT_NEAR(dark_pattern(dark).pixel_dn.value * 3.0, 5.0, 0.15);
  EXPECT_NEAR(response_pattern(half, dark).value, 0.008, 2e-4);
}

TEST(PhotonTransfer, RefusesFramesThatDoNotSayIt) {
  Sensor hidden;
  Chip chip(hidden);
  const Levels good = levels_of(chip, {500, 2000, 4000, 8000});
  const auto fails = [&](const std::vector<LevelStatistics>& bright,
                         const std::vector<LevelStatistics>& dark, const char* says) {
    const auto c = photon_transfer(bright, dark, hidden.largest_dn);
    EXPECT_THAT(c, FailsWith(kCalibrationFrames)) << says;
    if (!c) {
      EXPECT_THAT(c.error().message, testing::HasSubstr(says));
    }
  };
  fails(good.bright, {}, "no dark frames");
  fails({}, good.dark, "no bright frames");
  fails({good.bright[0], good.bright[1]}, good.dark, "at least 3");
  auto other = good.dark;
  other[0].exposure_s = 0.02;
  fails(good.bright, other, "no dark frames of that exposure time");
  Sensor cut = hidden;
  cut.black = 0.0;
  Chip black_chip(cut);
  const Levels black = levels_of(black_chip, {500, 2000, 4000, 8000});
  fails(black.bright, black.dark, "cut at black");
  // Eight-bit pictures with a tone curve, or one frame copied: no noise that rises with light.
  Levels still = good;
  for (auto& b : still.bright) b.variance_dn2 = good.dark[0].variance_dn2;
  fails(still.bright, still.dark, "does not rise with light");
  const Levels burnt = levels_of(chip, {30000, 40000, 60000, 80000});
  fails(burnt.bright, burnt.dark, "");
}

}  // namespace
}  // namespace maquette::camera
