// SPDX-License-Identifier: GPL-3.0-or-later

// The diagnosis at full size: the default site at 2 m x 2 m, its own program (8 km, 6 million
// commands), points of the surface that the program leaves, stretched along x, with noise.
// Prints what was hidden, what was found, clock, processor time and memory of `maquette diagnose`.
//
//   diagnosis_bench MAQUETTE [FOLDER]
//
// The folder (default: one for itself, removed at the end) takes 1 GB; surface and program that are
// there already are taken. About 8 minutes on two cores.

#include <sys/resource.h>
#include <unistd.h>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/random.hpp"
#include "diagnosis/path_contact.hpp"
#include "support/folders.hpp"

namespace fs = std::filesystem;

namespace {

constexpr double kSide_mm = 2000.0, kEdge_mm = 20.0, kNoise_mm = 0.05, kStretched = 200e-6;
constexpr std::uint64_t kSeed = 20'261'128;
constexpr std::uint64_t kPoints = 400'000;  // a scan

double processor_s(const rusage& use) {
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(use.ru_utime) + seconds(use.ru_stime);
}

void run(const std::string& command) {
  fmt::print("{}\n", command);
  std::fflush(stdout);
  if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
}

/// Points anywhere on the part, whether a scanner at its station would see them or not.
void write_points(const maquette::diagnosis::CutPath& path, std::uint64_t scan,
                  const fs::path& file) {
  std::ofstream out(file);
  for (std::uint64_t i = 0; i < kPoints; ++i) {
    const std::uint64_t at = 4 * (i + scan * kPoints);
    const auto along = [&](std::uint64_t k) {
      return kEdge_mm + (kSide_mm - 2.0 * kEdge_mm) * maquette::random_uniform(kSeed, at + k);
    };
    const double x = along(0), y = along(1);
    const auto z = path.height(x, y);
    if (z)
      out << fmt::format("{:.4f} {:.4f} {:.4f}\n", x + kStretched * (x - 0.5 * kSide_mm), y,
                         *z + kNoise_mm * maquette::random_normal(kSeed, at + 2));
  }
}

int measure(const fs::path& program, const fs::path& folder) {
  const std::string maquette = fs::absolute(program).string();
  fs::create_directories(folder);
  const fs::path design = folder / "site/s1000/design.tif", gcode = folder / "part.ngc";
  if (!fs::exists(design))
    run(fmt::format(
        "{} fuse {} --set size_mm=2000 --out {} --quiet > /dev/null", maquette,
        (maquette::testing_support::source_folder() / "assets/sites/default.toml").string(),
        (folder / "site").string()));
  if (!fs::exists(gcode))
    run(fmt::format("{} mill {} --out {} --quiet > /dev/null", maquette, design.string(),
                    gcode.string()));
  {
    const fs::path programs[] = {gcode};
    const auto path = maquette::diagnosis::CutPath::read(programs, 3.0, {});
    if (!path) throw std::runtime_error(path.error().message);
    for (std::uint64_t scan = 0; scan < 2; ++scan)
      write_points(*path, scan, folder / fmt::format("scan_{}.xyz", scan));
  }
  std::ofstream(folder / "case.toml") << fmt::format(
      "schema = \"maquette.case/1\"\ndesign = \"{}\"\ngcode = \"part.ngc\"\n\n"
      "[tool]\nball_diameter_mm = 6.0\n\n"
      "[[scan]]\npoints = \"scan_0.xyz\"\nscanner_position_mm = [1000, -1500, 3000]\n"
      "range_sigma_mm = {}\n\n"
      "[[scan]]\npoints = \"scan_1.xyz\"\nscanner_position_mm = [3500, 1000, 3000]\n"
      "range_sigma_mm = {}\n",
      "site/s1000/design.tif", kNoise_mm, kNoise_mm);

  rusage before{}, after{};
  getrusage(RUSAGE_CHILDREN, &before);
  const auto start = std::chrono::steady_clock::now();
  run(fmt::format("{} diagnose {} --out {} --no-controls > /dev/null", maquette,
                  (folder / "case.toml").string(), (folder / "diagnosis").string()));
  const double clock_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  getrusage(RUSAGE_CHILDREN, &after);

  const auto found = nlohmann::json::parse(std::ifstream(folder / "diagnosis/diagnosis.json"));
  fmt::print("seed {}\nhidden: machine.scale_x {:.0f} um/m\nverdict: {}\n", kSeed, 1e6 * kStretched,
             found.at("verdict").get<std::string>());
  for (const auto& cause : found.at("causes"))
    for (const auto& [name, size] : cause.at("parameters").items())
      fmt::print("found: {} {} {:.1f} +- {:.1f}\n", cause.at("effect").get<std::string>(), name,
                 size.at("value").get<double>(), size.at("sigma").get<double>());
  fmt::print(
      "diagnose: {:.0f} s of the clock, {:.0f} s of processors, {:.1f} GiB at most (goal 24)\n",
      clock_s, processor_s(after) - processor_s(before),
      static_cast<double>(after.ru_maxrss) / 1048576.0);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "usage: diagnosis_bench MAQUETTE [FOLDER]\n");
    return 2;
  }
  const bool own = argc < 3;
  const fs::path folder =
      own ? fs::temp_directory_path() / fmt::format("diagnosis_bench.{}", getpid())
          : fs::path(argv[2]);
  try {
    const int code = measure(argv[1], folder);
    if (own) fs::remove_all(folder);
    return code;
  } catch (const std::exception& e) {
    fmt::print(stderr, "{}\n", e.what());
    return 1;
  }
}
