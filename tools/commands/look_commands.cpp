// SPDX-License-Identifier: GPL-3.0-or-later

// info, doctor

#include <fstream>
#include <thread>

#include <fmt/format.h>
#include <unistd.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "scan/cloud_stream.hpp"
#include "tools/commands/commands.hpp"
#include "tools/jobs.hpp"
#include "tools/version.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

bool is_cloud(const std::string& extension) {
  for (const char* known : {".e57", ".ptx", ".pts", ".pcd", ".las", ".xyz", ".txt", ".asc", ".csv"})
    if (extension == known) return true;
  return false;
}

Result<void> describe_cloud(const fs::path& path, json& j) {
  MAQUETTE_TRY(const auto info, scan::inspect_cloud(path));
  j["kind"] = "point cloud (" + info.format + "), mm";
  j["points"] = info.points;
  j["without_position"] = info.without_position;
  if (!info.bounds_mm.empty()) {
    const Box3& box = info.bounds_mm;
    j["min_mm"] = {box.min.x, box.min.y, box.min.z};
    j["max_mm"] = {box.max.x, box.max.y, box.max.z};
  }
  j["stations"] = json::array();
  for (const scan::ScanStation& s : info.stations) {
    json station{{"points", s.points}};
    if (!s.name.empty()) station["name"] = s.name;
    if (!s.sensor_model.empty()) station["sensor"] = s.sensor_model;
    if (s.rows > 0) station["rows_columns"] = {s.rows, s.columns};
    if (s.position_mm)
      station["position_mm"] = {s.position_mm->x, s.position_mm->y, s.position_mm->z};
    station["intensity"] = s.fields.intensity;
    station["colour"] = s.fields.colour;
    j["stations"].push_back(std::move(station));
  }
  if (!info.images.empty()) j["images"] = info.images.size();
  return {};
}

Result<json> describe(const fs::path& path) {
  MAQUETTE_TRY(const std::string digest, sha256_file(path));
  std::error_code ec;
  json j{{"file", path.string()}, {"bytes", fs::file_size(path, ec)}, {"sha256", digest}};
  const std::string ext = path.extension().string();
  if (is_field(path)) {
    MAQUETTE_TRY(const auto field, heightmap::read_model_field(path));
    const auto range = heightmap::height_range(field.z_mm);
    j["kind"] = "model field, mm";
    j["nodes"] = {field.z_mm.cols(), field.z_mm.rows()};
    j["spacing_mm"] = field.spacing.value();
    j["origin_mm"] = {field.x0.value(), field.y0.value()};
    j["lowest_mm"] = range.min;
    j["highest_mm"] = range.max;
    j["voids"] = range.voids;
  } else if (ext == ".ply" || ext == ".stl" || ext == ".obj") {
    const auto mesh = meshing::read_mesh(path);
    if (!mesh) {  // a PLY without faces is a scan
      if (ext == ".ply" && describe_cloud(path, j)) return j;
      return tl::unexpected(mesh.error());
    }
    const Box3 box = mesh->bounds();
    j["kind"] = "mesh, mm";
    j["vertices"] = mesh->vertices_mm.size();
    j["triangles"] = mesh->triangles.size();
    j["min_mm"] = {box.min.x, box.min.y, box.min.z};
    j["max_mm"] = {box.max.x, box.max.y, box.max.z};
  } else if (is_cloud(ext)) {
    MAQUETTE_TRY_VOID(describe_cloud(path, j));
  } else if (ext == ".toml") {
    MAQUETTE_TRY(const auto site, read_site(path));
    j["kind"] = "site file";
    j["parameters"] = json::parse(site.schema.values_json());
  } else {
    j["kind"] =
        "unknown to maquette info; known: .tif, .ply, .stl, .obj, .e57 and other clouds, site "
        ".toml";
  }
  return j;
}

}  // namespace

Command add_info(CLI::App& root, const CommonOptions&) {
  auto path = std::make_shared<fs::path>();
  auto* app = root.add_subcommand("info",
                                  "What a file holds: size, unit, extent, hash.\n"
                                  "Example: maquette info out/s1000/design.tif");
  app->add_option("file", *path, "")->required();
  return {app, [path](Console& console) -> Result<int> {
            MAQUETTE_TRY(const json j, describe(*path));
            for (const auto& [key, value] : j.items())
              console.result(fmt::format(
                  "{:<12} {}", key, value.is_string() ? value.get<std::string>() : value.dump()));
            console.json_result(j.dump(1));
            return 0;
          }};
}

Command add_doctor(CLI::App& root, const CommonOptions&) {
  auto folder = std::make_shared<fs::path>(".");
  auto* app = root.add_subcommand(
      "doctor",
      "Is this machine fit for the work: cores, memory, disk, write permission.\n"
      "Example: maquette doctor --out out");
  app->add_option("--out", *folder, "where results would go")->capture_default_str();
  return {
      app, [folder](Console& console) -> Result<int> {
        const double memory = static_cast<double>(::sysconf(_SC_PHYS_PAGES)) *
                              static_cast<double>(::sysconf(_SC_PAGE_SIZE));
        std::error_code ec;
        fs::path existing = fs::absolute(*folder);
        while (!fs::exists(existing, ec) && existing.has_relative_path())
          existing = existing.parent_path();
        const double space = static_cast<double>(fs::space(existing, ec).available);
        const bool writable = ::access(existing.c_str(), W_OK) == 0;
        // Full size (16 M quads): measured peak and the files of one scale.
        constexpr double kFullMemory = 20e9, kFullDisk = 12e9;
        const json j{{"maquette", kVersion},
                     {"cores", std::thread::hardware_concurrency()},
                     {"memory_bytes", memory},
                     {"disk_free_bytes", space},
                     {"writable", writable},
                     {"full_size_memory", memory >= kFullMemory},
                     {"full_size_disk", space >= kFullDisk}};
        console.result(fmt::format("maquette {}", kVersion));
        console.result(fmt::format("cores      {}", j["cores"].get<unsigned>()));
        console.result(fmt::format("memory     {}{}", human_bytes(memory),
                                   memory >= kFullMemory ? ""
                                                         : "  (below 20 GB: use bands "
                                                           "or a smaller size_mm)"));
        console.result(fmt::format("disk free  {}{}", human_bytes(space),
                                   space >= kFullDisk ? "" : "  (a full-size scale needs 12 GB)"));
        console.json_result(j.dump(1));
        if (!writable)
          return fail(kFileNotWritable, fmt::format("{}: cannot write there; choose another --out",
                                                    existing.string()));
        console.result(fmt::format("writable   {}", existing.string()));
        return 0;
      }};
}

}  // namespace maquette::tools
