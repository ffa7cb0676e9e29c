// SPDX-License-Identifier: GPL-3.0-or-later
#include "bench/scan_peer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>

#include <fmt/format.h>

#include "scan/deviate.hpp"
#include "scan/mesh_distance.hpp"
#include "scan/register.hpp"
#include "support/bench_times.hpp"
#include "support/field_mesh.hpp"
#include "support/matchers.hpp"
#include "support/peers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using testing_support::mesh_of;

namespace fs = std::filesystem;
using namespace testing_support;

/// The command that starts it, without windows.
std::optional<std::string> cloudcompare() {
  const fs::path root = peers_folder() / "cloudcompare/usr";
  const std::string offscreen = "QT_QPA_PLATFORM=offscreen ";
  if (fs::exists(root / "bin/CloudCompare")) {
    std::string libraries;
    for (const auto& e : fs::directory_iterator(root / "lib"))
      libraries += fmt::format("{0}:{0}/cloudcompare:", e.path().string());
    return fmt::format("{}LD_LIBRARY_PATH={} {}", offscreen, libraries,
                       (root / "bin/CloudCompare").string());
  }
  if (std::system("command -v CloudCompare > /dev/null") == 0) return offscreen + "CloudCompare";
  return std::nullopt;
}

/// Runs it; CPU seconds.
double run_cpu_s(const std::string& command) {
  const Outside o = run_outside(command + " > log.txt 2>&1");
  if (o.status != 0) fmt::print("it failed\n");
  return o.times.cpu;
}

/// @return false if it does not fit on the disk
bool write_mesh(const TriMesh& mesh, const fs::path& path) {
  std::ofstream out(path, std::ios::binary);
  out << "ply\nformat binary_little_endian 1.0\nelement vertex " << mesh.vertices_mm.size()
      << "\nproperty float x\nproperty float y\nproperty float z\nelement face "
      << mesh.triangles.size() << "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Vec3& v : mesh.vertices_mm) {
    const std::array p{static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
    out.write(reinterpret_cast<const char*>(&p), sizeof p);
  }
  for (const auto& t : mesh.triangles) {
    out.put(3);
    out.write(reinterpret_cast<const char*>(&t), sizeof t);
  }
  return static_cast<bool>(out.flush());
}

/// A named float or double of each vertex of a binary PLY.
std::vector<double> column(const fs::path& path, const std::string& wanted) {
  std::ifstream in(path, std::ios::binary);
  const std::map<std::string, std::size_t> sizes{{"float", 4},  {"double", 8}, {"uchar", 1},
                                                 {"ushort", 2}, {"short", 2},  {"int", 4},
                                                 {"uint", 4},   {"char", 1}};
  std::size_t count = 0, stride = 0, at = 0, width = 0;
  for (std::string line; std::getline(in, line) && line != "end_header";) {
    std::istringstream words(line);
    std::string first, second, third;
    words >> first >> second >> third;
    if (first == "element" && second == "vertex") count = std::stoul(third);
    if (first != "property" || !sizes.contains(second)) continue;
    if (third == wanted) at = stride, width = sizes.at(second);
    stride += sizes.at(second);
  }
  std::vector<double> values;
  std::string record(stride, '\0');
  if (width == 0) return values;
  while (values.size() < count && in.read(record.data(), static_cast<std::streamsize>(stride))) {
    float f = 0.0F;
    double d = 0.0;
    std::memcpy(width == 4 ? static_cast<void*>(&f) : &d, record.data() + at, width);
    values.push_back(width == 4 ? static_cast<double>(f) : d);
  }
  return values;
}

fs::path file_with(const fs::path& folder, const std::string& part) {
  for (const auto& e : fs::directory_iterator(folder))
    if (e.path().filename().string().find(part) != std::string::npos) return e.path();
  return {};
}

double rms_off(const Cloud& truth, const Cloud& seen, const RigidTransform& pose) {
  double square = 0.0, n = 0.0;
  for (std::size_t i = 0; i < truth.points_mm.size(); i += 97, n += 1.0) {
    const Vec3 e = pose.point(seen.points_mm[i]) - truth.points_mm[i];
    square += dot(e, e);
  }
  return std::sqrt(square / n);
}

/// What ours takes, and what the other's is compared with.
struct Own {
  double registration_s = 0.0, pose_error_mm = 0.0, grid_s = 0.0, mesh_s = 0.0;
  std::optional<Deviation> deviation;
};

void row(const std::string& what, double seconds, const std::string& error,
         const std::string& ratio = {}) {
  fmt::print("{:<48}{:>9.2f}{:>12}  {}\n", what, seconds, error, ratio);
}

Own measure_own(const heightmap::ModelField& part, const TriMesh& triangles, const Cloud& truth,
                const Cloud& seen) {
  Own own;
  double before = cpu_seconds();
  const auto found = register_scan(seen, part);
  own.registration_s = cpu_seconds() - before;
  if (!found) {
    fmt::print("{}\n", found.error().message);
    return own;
  }
  own.pose_error_mm = rms_off(truth, seen, found->model_from_scan);
  row("registration: maquette, any pose", own.registration_s,
      fmt::format("{:.4f}", own.pose_error_mm));
  before = cpu_seconds();
  auto deviation = deviate(truth, {}, part, Millimetres{20.0});
  own.grid_s = cpu_seconds() - before;
  if (!deviation) {
    fmt::print("{}\n", deviation.error().message);
    return own;
  }
  row("deviation: maquette, height grid, with map", own.grid_s, "");
  before = cpu_seconds();
  const MeshDistance tree(triangles);
  const auto distances = signed_distances_mm(truth.points_mm, {}, tree, 20.0);
  own.mesh_s = cpu_seconds() - before;
  double worst = 0.0;
  std::size_t compared = 0;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    const double d = std::abs(static_cast<double>(deviation->per_point_mm[i]) -
                              static_cast<double>(distances[i]));
    if (std::isnan(d)) continue;  // off the part for one of them
    worst = std::fmax(worst, d);
    ++compared;
  }
  row("deviation: maquette, any mesh, tree built", own.mesh_s, fmt::format("{:.1e}", worst),
      fmt::format("from the grid's at most, {} points", compared));
  own.deviation = std::move(*deviation);
  return own;
}

void compare_distances(const std::string& open, double files, const Own& own) {
  const double theirs_s = run_cpu_s(open + "there.ply -O mesh.ply -C2M_DIST") - files;
  const fs::path result = file_with(".", "C2M_DIST");
  const auto theirs =
      result.empty() ? std::vector<double>{} : column(result, "scalar_C2M_signed_distances");
  if (theirs.size() != own.deviation->per_point_mm.size()) {
    fmt::print("CloudCompare gave {} distances\n", theirs.size());
    return;
  }
  std::vector<double> apart;
  std::size_t flips = 0;
  for (std::size_t i = 0; i < theirs.size(); ++i) {
    const auto d = static_cast<double>(own.deviation->per_point_mm[i]);
    if (std::isnan(d)) continue;
    apart.push_back(std::abs(d - theirs[i]));
    if (std::abs(std::abs(d) - std::abs(theirs[i])) < 1e-3 && d * theirs[i] < -1e-6) ++flips;
  }
  std::sort(apart.begin(), apart.end());
  row("deviation: CloudCompare", theirs_s, fmt::format("{:.1e}", apart[apart.size() / 2]),
      fmt::format("from ours in the middle, {:.1e} for 99.9 %, {} signs; {:.1f} x the time on a "
                  "grid, {:.1f} x on a mesh",
                  apart[apart.size() * 999 / 1000], flips, theirs_s / own.grid_s,
                  theirs_s / own.mesh_s));
}

void compare_pose(const std::string& command, const std::string& stop, double files, const Own& own,
                  const Cloud& truth, const Cloud& seen) {
  for (fs::path old = file_with(".", "REGISTRATION_MATRIX"); !old.empty();
       old = file_with(".", "REGISTRATION_MATRIX"))
    fs::remove(old);
  const double theirs_s = run_cpu_s(command) - files;
  const fs::path file = file_with(".", "REGISTRATION_MATRIX");
  std::array<double, 16> m{};
  std::ifstream in(file);
  for (double& v : m) in >> v;
  if (file.empty() || !in) {
    fmt::print("CloudCompare, {}: no registration\n", stop);
    return;
  }
  double square = 0.0, n = 0.0;
  for (std::size_t i = 0; i < truth.points_mm.size(); i += 97, n += 1.0) {
    const Vec3 p = seen.points_mm[i];
    const Vec3 q{m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3],
                 m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7],
                 m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11]};
    square += dot(q - truth.points_mm[i], q - truth.points_mm[i]);
  }
  const double error = std::sqrt(square / n);
  row("registration: CloudCompare, " + stop, theirs_s, fmt::format("{:.4f}", error),
      fmt::format("{:.1f} x the time, {:.1f} x the error", theirs_s / own.registration_s,
                  error / own.pose_error_mm));
}

}  // namespace

void beside_cloudcompare(std::ptrdiff_t nodes, std::size_t points, std::size_t sampled) {
  const double spacing = 2000.0 / static_cast<double>(nodes - 1);
  const heightmap::ModelField part = rough_part(1, nodes, nodes, spacing);
  const TriMesh triangles = mesh_of(part);
  const Cloud truth = points_on(part, points, 2, 0.3);
  // Near, for the other's ICP has no coarse step.
  const Cloud seen = seen_from(truth, random_pose(3, {1000.0, 1000.0, 10.0}, 0.001, 2.0));
  fmt::print(
      "{:.2f} M triangles over 2 m x 2 m, {:.2f} M points of 0.3 mm, begun 2 mm and 1 mrad off\n"
      "{:<48}{:>9}{:>12}\n",
      1e-6 * static_cast<double>(triangles.triangles.size()), 1e-6 * static_cast<double>(points),
      "", "CPU s", "error, mm");
  const Own own = measure_own(part, triangles, truth, seen);
  if (!own.deviation) return;
  const auto start = cloudcompare();
  if (!start) {
    fmt::print("CloudCompare is not installed (tools/setup --peers): no comparison\n");
    return;
  }
  const ScratchFolder folder;
  fs::current_path(folder.path());
  if (!write_mesh(triangles, "mesh.ply") || !write_cloud(truth, "there.ply") ||
      !write_cloud(seen, "off.ply")) {
    fmt::print("no room for the files in {}: no comparison\n", folder.path().string());
    return;
  }
  const std::string open = *start +
                           " -SILENT -NO_TIMESTAMP -C_EXPORT_FMT PLY -PLY_EXPORT_FMT "
                           "BINARY_LE -O ";
  // What it takes to read both files and write one.
  const double files = run_cpu_s(open + "there.ply -O mesh.ply -SAVE_CLOUDS");
  fmt::print("CloudCompare reads both files and writes one in {:.2f} s, taken off below\n", files);
  if (sampled > 0) {
    compare_pose(open + fmt::format("off.ply -O mesh.ply -ICP -MIN_ERROR_DIFF 1e-10 "
                                    "-RANDOM_SAMPLING_LIMIT {}",
                                    sampled),
                 fmt::format("stop at 1e-10, {} points", sampled), files, own, truth, seen);
    return;
  }
  compare_distances(open, files, own);
  for (const auto& [option, name] :
       {std::pair{"", "stop as it is"}, std::pair{" -MIN_ERROR_DIFF 1e-10", "stop at 1e-10"}})
    compare_pose(open + "off.ply -O mesh.ply -ICP" + option, name, files, own, truth, seen);
}

}  // namespace maquette::scan
