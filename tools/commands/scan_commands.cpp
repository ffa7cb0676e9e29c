// SPDX-License-Identifier: GPL-3.0-or-later

// scan, clean, merge

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include "core/files.hpp"
#include "tools/commands/commands.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_clean.hpp"
#include "tools/jobs_merge.hpp"

namespace maquette::tools {
namespace {

std::optional<fs::path> given(const fs::path& path) {
  return path.empty() ? std::nullopt : std::optional(path);
}

}  // namespace

Command add_scan(CLI::App& root, const CommonOptions& common) {
  struct Options {
    fs::path surface, out = "scan.ply", stones, reflectance, scanner_file, extended;
    std::string scanner = "zf5006h";
    std::vector<double> stations_mm, target_mm;
    std::uint64_t max_points = 1'000'000;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "scan",
      "Simulated scans of a surface, one from each station.\n"
      "Example: maquette scan as_milled.tif --stones stones.json --out scan.e57 \\\n"
      "           --station-mm 100 -900 1100 --station-mm 100 1100 1100");
  app->add_option("surface", o->surface, "model field (.tif) or mesh");
  app->add_option("--out", o->out, "cloud: .e57 .ptx .pts .pcd .las .ply .xyz .csv")
      ->capture_default_str();
  app->add_option("--stones", o->stones, "stones.json of `maquette stones`");
  app->add_option("--scanner", o->scanner,
                  fmt::format("{}, or a .toml file", fmt::join(scanner_names(), ", ")))
      ->capture_default_str();
  app->add_option(
      "--write-scanner", o->scanner_file,
      "writes the scanner with all its keys as a .toml file to edit, and scans nothing");
  app->add_option("--station-mm", o->stations_mm,
                  "x y z of the scanner, once a station; default: south of the part")
      ->type_size(3)
      ->expected(-1);
  app->add_option("--target-mm", o->target_mm,
                  "x y z that structured light looks at; default: the middle")
      ->expected(3);
  app->add_option("--reflectance", o->reflectance,
                  "model field of 0 to 1: signal, noise and colour; default: grey of 0.5");
  app->add_option("--extended", o->extended,
                  "extended.toml of diagnose: its causes act on the surface (design.tif or "
                  "as_milled.tif of the case) and on the points");
  app->add_option("--max-points", o->max_points,
                  "of a station; angular steps are widened to stay below")
      ->capture_default_str();
  return {app, [o, &common](Console& console) -> Result<int> {
            ScanJob job;
            MAQUETTE_TRY(job.scanner, find_scanner(o->scanner));
            if (!o->scanner_file.empty()) {
              MAQUETTE_TRY_VOID(write_file(o->scanner_file, scanner_file_text(job.scanner)));
              console.result(fmt::format("{}: edit it, then --scanner {}", o->scanner_file.string(),
                                         o->scanner_file.string()));
              return 0;
            }
            if (o->surface.empty())
              return fail(kUsage, "scan needs a surface: a model field (.tif) or a mesh");
            job.surface = o->surface;
            job.stones = given(o->stones);
            job.reflectance = given(o->reflectance);
            job.max_points = o->max_points;
            if (!o->extended.empty()) job.extended = {o->extended, std::nullopt, {}};
            job.seed = common.seed >= 0 ? static_cast<std::uint64_t>(common.seed) : 1;
            if (!o->target_mm.empty())
              job.target_mm = Vec3{o->target_mm[0], o->target_mm[1], o->target_mm[2]};
            if (o->stations_mm.size() % 3 != 0)
              return fail(kUsage, "--station-mm takes x y z, once a station");
            for (std::size_t i = 0; i + 2 < o->stations_mm.size(); i += 3)
              job.stations_mm.push_back(
                  {o->stations_mm[i], o->stations_mm[i + 1], o->stations_mm[i + 2]});
            if (job.stations_mm.empty()) {
              // South of the part, half its depth above it: all of it is seen obliquely.
              MAQUETTE_TRY(const Box3 box, surface_bounds(o->surface));
              const double depth = box.max.y - box.min.y;
              job.stations_mm = {{0.5 * (box.min.x + box.max.x), box.min.y - 0.75 * depth - 500.0,
                                  box.max.z + depth + 500.0}};
            }
            return finish(console, "scan",
                          [&](const RunContext& run) { return scan_job(job, o->out, run); });
          }};
}

Command add_clean(CLI::App& root, const CommonOptions&) {
  struct Options {
    CleanJob job;
    std::string scanner = "zf5006h";
    fs::path out = "clean.e57", part;
    bool keep_mixed = false;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "clean",
      "Takes mixed points at edges, isolated points and what is off the part out of a scan; thins "
      "it, and turns normals to the scanner. Any size, in constant memory beside some bytes a "
      "point.\n"
      "Example: maquette clean in.e57 --part surface.tif --thin-mm 0.5 --out out.ply");
  app->add_option("cloud", o->job.cloud, ".e57 .ptx .pts .pcd .las .ply .xyz .csv")->required();
  app->add_option("--out", o->out, "cloud; PLY, XYZ and CSV hold the statistics of thinned points")
      ->capture_default_str();
  app->add_option("--scanner", o->scanner,
                  fmt::format("whose beam is as wide: {}, or a .toml file",
                              fmt::join(scanner_names(), ", ")))
      ->capture_default_str();
  app->add_option("--least-jump-mm", o->job.options.least_jump_mm,
                  "between the two surfaces of a mixed point; 0: two beam diameters")
      ->capture_default_str();
  app->add_flag("--keep-mixed", o->keep_mixed);
  app->add_option("--least-neighbours", o->job.options.least_neighbours,
                  "fewer points in the 27 voxels around a point, itself included: isolated; 0: "
                  "all stay")
      ->capture_default_str();
  app->add_option("--voxel-mm", o->job.options.voxel_mm, "of that; 0: eight points each")
      ->capture_default_str();
  app->add_option("--part", o->part,
                  "model field (.tif) or mesh in the scan's frame: what is outside its box is off "
                  "the part");
  app->add_option("--margin-mm", o->job.margin_mm, "that the box is grown by")
      ->capture_default_str();
  app->add_option("--thin-mm", o->job.options.thin_mm,
                  "one point a voxel: mean, count, spread, colour, intensity, normal; 0: every "
                  "point")
      ->capture_default_str();
  app->add_flag("--normals", o->job.options.normals, "towards the scanner, for every point");
  return {app, [o](Console& console) -> Result<int> {
            MAQUETTE_TRY(o->job.scanner, find_scanner(o->scanner));
            o->job.options.mixed = !o->keep_mixed;
            o->job.part = given(o->part);
            return finish(console, "clean",
                          [&](const RunContext& run) { return clean_job(o->job, o->out, run); });
          }};
}

Command add_merge(CLI::App& root, const CommonOptions&) {
  struct Options {
    MergeJob job;
    fs::path out = "merged.e57", mesh;
    bool poses_as_they_are = false, colours_as_they_are = false;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "merge",
      "Scans that overlap become one cloud: poses of all at once, colours balanced; and a mesh.\n"
      "Example: maquette merge a.e57 b.e57 --out merged.e57 --mesh merged.ply");
  app->add_option("clouds", o->job.clouds, "every station of every file is a scan; the first stays")
      ->required();
  app->add_option("--out", o->out, "cloud; poses, overlaps, gains and holes: <out>.merge.json")
      ->capture_default_str();
  app->add_option("--capture-mm", o->job.options.capture_mm,
                  "scans may be this far off; 0: a twentieth of their extent")
      ->capture_default_str();
  app->add_option("--voxel-mm", o->job.options.voxel_mm,
                  "finest pieces that are compared; 0: eight points each")
      ->capture_default_str();
  app->add_flag("--keep-poses", o->poses_as_they_are, "only colours, overlaps and the mesh");
  app->add_flag("--keep-colours", o->colours_as_they_are, "no balancing");
  app->add_option("--thin-mm", o->job.thin_mm,
                  "one point a voxel with means and a normal; 0: every point, stations kept")
      ->capture_default_str();
  app->add_option("--mesh", o->mesh, "PLY with a colour a vertex");
  app->add_option("--mesh-voxel-mm", o->job.mesh_voxel_mm, "0: four points a voxel")
      ->capture_default_str();
  app->add_flag("--closed", o->job.closed, "fill every border of the mesh");
  return {app, [o](Console& console) {
            o->job.options.poses = !o->poses_as_they_are;
            o->job.options.balance_colour = !o->colours_as_they_are;
            o->job.mesh = given(o->mesh);
            return finish(console, "merge",
                          [&](const RunContext& run) { return merge_job(o->job, o->out, run); });
          }};
}

}  // namespace maquette::tools
