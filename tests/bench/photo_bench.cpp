// SPDX-License-Identifier: GPL-3.0-or-later

// A picture of 4256 x 2832 pixels through a camera, and compared with another: CPU seconds and
// seconds by the clock of the effect stack (all that nikon_d700_55deg lists; the lens apart from
// the sensor), of the figures of a comparison in memory, and of the programs that read two PNG
// files: `maquette compare --fast`, `maquette compare` and OpenImageIO's idiff.
//
//   photo_bench [program]     maquette beside which idiff runs; without it only what is in memory

#include <cmath>
#include <filesystem>
#include <string>

#include <fmt/format.h>

#include "camera/compare.hpp"
#include "camera/stack.hpp"
#include "support/bench_times.hpp"
#include "support/d700_stack.hpp"

namespace maquette {
namespace {

using namespace testing_support;
using namespace camera;
namespace fs = std::filesystem;

constexpr int kWidth = D700::width_px, kHeight = D700::height_px;
constexpr double kMpixel = 1e-6 * kWidth * kHeight;

template <class F>
Times cost(const F& f) {
  const Times a = now();
  f();
  const Times b = now();
  return {b.wall - a.wall, b.cpu - a.cpu};
}

void report(const std::string& what, const Times& t) {
  fmt::print("{:<44}{:>8.2f} CPU s{:>8.2f} s{:>10.1f} Mpixel/CPU s\n", what, t.cpu, t.wall,
             kMpixel / t.cpu);
}

/// A program that runs to its end; idiff says in its status that pictures differ.
void report_outside(const std::string& what, const std::string& command) {
  constexpr int kNotThere = 127;  // of the shell
  const Outside o = run_outside(command + " >/dev/null 2>&1");
  if (!WIFEXITED(o.status) || WEXITSTATUS(o.status) == kNotThere)
    fmt::print("{:<44} is not there, or broke off\n", what);
  else
    report(what, o.times);
}

/// Waves and noise, in three bands.
Frame light() {
  Frame f;
  for (std::size_t b = 0; b < 3; ++b) {
    Grid<float>& g = f.bands.emplace_back(kHeight, kWidth);
    for (std::ptrdiff_t r = 0; r < kHeight; ++r)
      for (std::ptrdiff_t c = 0; c < kWidth; ++c)
        g(r, c) = static_cast<float>(
            0.3 + 0.25 * std::sin(0.011 * static_cast<double>(c) + static_cast<double>(b)) *
                      std::cos(0.007 * static_cast<double>(r)));
  }
  f.depth_mm = Grid<float>(kHeight, kWidth);
  for (std::ptrdiff_t r = 0; r < kHeight; ++r)
    for (float& v : f.depth_mm.row(r)) v = 4200.0F - 0.2F * static_cast<float>(r);
  return f;
}

int run(const std::string& program) {
  const D700 d700;
  Shot shot = d700.shot;
  const Stack &lens = d700.lens, &sensor = d700.sensor, whole = d700.whole();
  const Frame scene = light();
  fmt::print("{} x {} pixels, {:.1f} Mpixel\n", kWidth, kHeight, kMpixel);
  Frame picture;
  for (const auto& [name, stack] :
       {std::pair{"lens", lens}, {"sensor", sensor}, {"whole stack", whole}}) {
    (void)expose(stack, shot, scene);  // tables and plans are made once
    Frame copy = scene;
    report(name, cost([&] {
             auto done = expose(stack, shot, std::move(copy));
             if (done) picture = std::move(*done);
           }));
  }

  // What has been exposed against the same at another time: noise of a photograph.
  LoadedImage a, b;
  shot.time_s = 1.0;
  const auto other = expose(whole, shot, scene);
  for (auto* image : {&a, &b}) {
    image->names = {"R", "G", "B"};
    image->eight_bit = true;
    image->channels = image == &a ? picture.bands : other->bands;
    for (auto& g : image->channels)
      for (float& v : g.cells()) v = std::round(255.0F * v) / 255.0F;
  }
  LoadedImage linear = b;
  linear.eight_bit = false;
  CompareOptions figures;
  figures.pictures = false;
  report("compare, figures, 8 bit and 8 bit", cost([&] { (void)compare_images(a, b, figures); }));
  report("compare, figures, 8 bit and linear",
         cost([&] { (void)compare_images(a, linear, figures); }));
  if (program.empty()) return 0;
  const fs::path folder = fs::temp_directory_path() / fmt::format("photo_bench_{}", ::getpid());
  fs::create_directories(folder);
  const auto write = [&](const LoadedImage& image, const char* name) {
    std::vector<std::pair<std::string, const Grid<float>*>> bands;
    for (std::size_t k = 0; k < 3; ++k) bands.emplace_back(image.names[k], &image.channels[k]);
    (void)write_whole_numbers(bands, 1.0, 8, folder / name);
    return (folder / name).string();
  };
  for (const char* ending : {"png", "tif"}) {
    const std::string one = write(a, fmt::format("a.{}", ending).c_str());
    const std::string two = write(b, fmt::format("b.{}", ending).c_str());
    report_outside(fmt::format("idiff, two .{}", ending), fmt::format("idiff {} {}", one, two));
    const std::string compare =
        fmt::format("{} compare {} {} --quiet --out {}", program, one, two, folder.string());
    report_outside("maquette compare --fast", compare + " --fast");
    report_outside("maquette compare", compare);
  }
  fs::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace maquette

int main(int count, char** words) {
  return maquette::run(count > 1 ? words[1] : "");
}
