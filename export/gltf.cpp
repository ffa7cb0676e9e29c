// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/gltf.hpp"

#include <atomic>
#include <cmath>
#include <limits>
#include <optional>

#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "export/detail/gltf_asset.hpp"
#include "export/draco_piece.hpp"
#include "export/glb_file.hpp"
#include "export/limits.hpp"
#include "export/text_lines.hpp"

namespace maquette::exporting {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kPieceTriangles = 1'000'000;  ///< a Draco piece: 0.3 GB while it is made
/// A position step above this share of the median edge turns slopes into stairs.
constexpr double kCoarsestStep = 0.25;
constexpr int kFloat = 5126, kUnsignedInt = 5125;  // glTF component types

/// Model frame to glTF: metres, y up, relative to `corner_mm`.
Float3 gltf_point(Vec3 v, Vec3 corner_mm) {
  const Vec3 d = gltf_axes(kMetresPerMillimetre * (v - corner_mm));
  return {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)};
}

/// Median, for a base of two long triangles must not count; of at most a million.
double median_edge_mm(const TriMesh& mesh) {
  const std::size_t stride = 1 + mesh.triangles.size() / 333'333;
  std::vector<double> edges;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += stride) {
    const auto& t = mesh.triangles[i];
    for (std::size_t k = 0; k < 3; ++k)
      edges.push_back(norm(mesh.vertices_mm[t[k]] - mesh.vertices_mm[t[(k + 1) % 3]]));
  }
  const auto middle = edges.begin() + static_cast<std::ptrdiff_t>(edges.size() / 2);
  std::nth_element(edges.begin(), middle, edges.end());
  return *middle;
}

/// Draco hands its options on as text with six decimals (draco/core/options.cc), so
/// the grid must be exact in that form or decoded positions are off by up to 1e-6 m.
float as_draco_text(double value) {
  return std::stof(std::to_string(value));
}
float text_at_most(float value) {
  double micrometres = std::floor(1e6 * static_cast<double>(value));
  while (as_draco_text(1e-6 * micrometres) > value) micrometres -= 1.0;
  return as_draco_text(1e-6 * micrometres);
}
float text_at_least(float value) {
  return -text_at_most(-value);
}

struct Geometry {
  std::vector<Float3> positions, normals;
  Vec3 corner_mm;
  PositionGrid grid;
};

Geometry make_geometry(const TriMesh& mesh, int bits) {
  Geometry g;
  const Box3 box = mesh.bounds();
  g.corner_mm = {box.min.x, box.min.y, 0.0};
  g.positions.resize(mesh.vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, g.positions.size(), [&](std::size_t i) {
    g.positions[i] = gltf_point(mesh.vertices_mm[i], g.corner_mm);
  });
  g.normals = gltf_normals(mesh);
  const Float3 a = gltf_point(box.min, g.corner_mm), b = gltf_point(box.max, g.corner_mm);
  g.grid.bits = bits;
  for (std::size_t k = 0; k < 3; ++k) {
    g.grid.origin[k] = text_at_most(std::min(a[k], b[k]));
    g.grid.range = text_at_least(std::max(g.grid.range, std::max(a[k], b[k]) - g.grid.origin[k]));
  }
  return g;
}

Result<void> check_options(const GltfOptions& options, const std::filesystem::path& path) {
  const auto bad = [&path](const std::string& what) {
    return fail(kOptionOutOfRange, fmt::format("{}: {}", path.string(), what));
  };
  if (options.position_bits < 8 || options.position_bits > 24)
    return bad(fmt::format("{} bits a coordinate: 8 to 24 expected", options.position_bits));
  if (!(options.scale_denominator > 0.0) || !std::isfinite(options.scale_denominator))
    return bad(fmt::format("scale 1:{}: more than 0 expected", options.scale_denominator));
  for (const float c : options.base_colour)
    if (!(c >= 0.0F && c <= 1.0F)) return bad(fmt::format("colour {}: 0 to 1 expected", c));
  return {};
}

/// Half a step on three axes, and the rounding of the decoded float itself.
double max_error_mm(const Geometry& g, bool draco) {
  double farthest = static_cast<double>(g.grid.range);
  for (const float x : g.grid.origin)
    farthest =
        std::max(farthest, std::abs(static_cast<double>(x)) + static_cast<double>(g.grid.range));
  const double rounding = (draco ? 2.0 : 0.5) * farthest * std::numeric_limits<float>::epsilon();
  const double half_step = draco ? 0.5 * g.grid.step() : 0.0;
  return std::sqrt(3.0) * (half_step + rounding) / kMetresPerMillimetre;
}

Json json_frame(const GltfOptions& options, const Geometry& g) {
  Json json;
  json["asset"] = gltf_asset({{"origin_in_model_mm", {g.corner_mm.x, g.corner_mm.y, g.corner_mm.z}},
                              {"scale_denominator", options.scale_denominator}});
  json["scene"] = 0;
  json["scenes"] = {{{"nodes", {0}}}};
  json["nodes"] = {{{"name", options.name}, {"mesh", 0}}};
  const auto& c = options.base_colour;
  json["materials"] = {{{"name", "paint"},
                        {"pbrMetallicRoughness",
                         {{"baseColorFactor", {c[0], c[1], c[2], 1.0F}},
                          {"metallicFactor", 0.0F},
                          {"roughnessFactor", 1.0F}}}}};
  json["meshes"] = {{{"name", options.name}, {"primitives", Json::array()}}};
  json["accessors"] = Json::array();
  json["bufferViews"] = Json::array();
  return json;
}

std::string text_of(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json json_accessor(int type, std::uint64_t count, const char* shape) {
  return {{"componentType", type}, {"count", count}, {"type", shape}};
}

Result<std::vector<DracoPiece>> compress(const TriMesh& mesh, const Geometry& g,
                                         const RunContext& run) {
  const std::size_t count = (mesh.triangles.size() + kPieceTriangles - 1) / kPieceTriangles;
  std::vector<std::optional<Result<DracoPiece>>> made(count);
  std::atomic<std::size_t> done{0};
  tbb::parallel_for(
      std::size_t{0}, count,
      [&](std::size_t i) {
        if (run.stopped()) return;
        const std::size_t first = i * kPieceTriangles;
        const std::size_t size = std::min(kPieceTriangles, mesh.triangles.size() - first);
        made[i] = draco_piece(g.positions, g.normals,
                              std::span(mesh.triangles).subspan(first, size), g.grid);
        run.progress(0.2 + 0.7 * static_cast<double>(++done) / static_cast<double>(count));
      },
      tbb::simple_partitioner());
  std::vector<DracoPiece> pieces;
  for (auto& piece : made) {
    if (!piece) return fail(kCancelled, "stopped while Draco compressed the mesh");
    if (!*piece) return tl::unexpected(std::move(*piece).error());
    pieces.push_back(**std::move(piece));
  }
  return pieces;
}

Result<std::uint64_t> write_draco(const TriMesh& mesh, const Geometry& g,
                                  const GltfOptions& options, AtomicFile& file,
                                  const std::filesystem::path& path, GltfReport& report,
                                  const RunContext& run) {
  MAQUETTE_TRY(const auto pieces, compress(mesh, g, run));
  for (const DracoPiece& piece : pieces) {
    report.flat_triangles += piece.flat;
    report.turned_triangles += piece.turned;
  }
  Json json = json_frame(options, g);
  json["extensionsUsed"] = {"KHR_draco_mesh_compression"};
  json["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  std::uint64_t offset = 0;
  for (const DracoPiece& piece : pieces) {
    const std::size_t view = json["bufferViews"].size(), accessor = json["accessors"].size();
    Json position = json_accessor(kFloat, piece.points, "VEC3");
    position["min"] = piece.min;
    position["max"] = piece.max;
    json["accessors"].push_back(std::move(position));
    json["accessors"].push_back(json_accessor(kFloat, piece.points, "VEC3"));
    json["accessors"].push_back(json_accessor(kUnsignedInt, 3ULL * piece.faces, "SCALAR"));
    json["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", offset}, {"byteLength", piece.bytes.size()}});
    json["meshes"][0]["primitives"].push_back(
        {{"attributes", {{"POSITION", accessor}, {"NORMAL", accessor + 1}}},
         {"indices", accessor + 2},
         {"material", 0},
         {"extensions",
          {{"KHR_draco_mesh_compression",
            {{"bufferView", view},
             {"attributes", {{"POSITION", piece.position_id}, {"NORMAL", piece.normal_id}}}}}}}});
    offset = glb_padded(offset + piece.bytes.size());
  }
  json["buffers"] = {{{"byteLength", offset}}};
  MAQUETTE_TRY(const std::uint64_t total, write_glb_head(file, text_of(json), offset, path));
  for (const DracoPiece& piece : pieces) {
    file.write(piece.bytes.data(), piece.bytes.size());
    file.write(std::string_view("\0\0\0", glb_padded(piece.bytes.size()) - piece.bytes.size()));
  }
  return total;
}

Result<std::uint64_t> write_plain(const TriMesh& mesh, const Geometry& g,
                                  const GltfOptions& options, AtomicFile& file,
                                  const std::filesystem::path& path) {
  const std::uint64_t vectors = g.positions.size() * sizeof(Float3);
  const std::uint64_t indices = mesh.triangles.size() * sizeof(mesh.triangles[0]);
  Json json = json_frame(options, g);
  Float3 lo = g.positions.front(), hi = lo;
  for (const Float3& p : g.positions)
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], p[k]);
      hi[k] = std::max(hi[k], p[k]);
    }
  constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;
  json["bufferViews"] = {
      {{"buffer", 0}, {"byteOffset", 0}, {"byteLength", vectors}, {"target", kArrayBuffer}},
      {{"buffer", 0}, {"byteOffset", vectors}, {"byteLength", vectors}, {"target", kArrayBuffer}},
      {{"buffer", 0},
       {"byteOffset", 2 * vectors},
       {"byteLength", indices},
       {"target", kElementArrayBuffer}}};
  json["accessors"] = {json_accessor(kFloat, g.positions.size(), "VEC3"),
                       json_accessor(kFloat, g.normals.size(), "VEC3"),
                       json_accessor(kUnsignedInt, 3 * mesh.triangles.size(), "SCALAR")};
  for (std::size_t k = 0; k < 3; ++k) json["accessors"][k]["bufferView"] = k;
  json["accessors"][0]["min"] = lo;
  json["accessors"][0]["max"] = hi;
  json["meshes"][0]["primitives"] = {
      {{"attributes", {{"POSITION", 0}, {"NORMAL", 1}}}, {"indices", 2}, {"material", 0}}};
  json["buffers"] = {{{"byteLength", 2 * vectors + indices}}};
  MAQUETTE_TRY(const std::uint64_t total,
               write_glb_head(file, text_of(json), 2 * vectors + indices, path));
  file.write(g.positions.data(), vectors);
  file.write(g.normals.data(), vectors);
  file.write(mesh.triangles.data(), indices);
  return total;
}

}  // namespace

Result<GltfReport> write_glb(const TriMesh& mesh, const GltfOptions& options,
                             const std::filesystem::path& path, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_options(options, path));
  MAQUETTE_TRY_VOID(check_mesh_for_export(mesh, path));
  if (!options.draco)
    MAQUETTE_TRY_VOID(within_limit(2 * mesh.vertices_mm.size() * sizeof(Float3) +
                                       mesh.triangles.size() * sizeof(mesh.triangles[0]),
                                   kGlbByteLimit, "bytes", "glb", path));
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  const Geometry geometry = make_geometry(mesh, options.position_bits);
  const double step_mm = geometry.grid.step() / kMetresPerMillimetre,
               edge_mm = median_edge_mm(mesh);
  if (options.draco && step_mm > kCoarsestStep * edge_mm)
    return fail(kQuantisationTooCoarse,
                fmt::format("{}: {} bits make position steps of {:.4g} mm, triangles have a median "
                            "edge of {:.4g} mm; {} bits would do",
                            path.string(), options.position_bits, step_mm, edge_mm,
                            options.position_bits +
                                std::ceil(std::log2(step_mm / (kCoarsestStep * edge_mm)))));
  const auto cancelled = [&path] {
    return fail(kCancelled, fmt::format("{}: stopped while it was written", path.string()));
  };
  if (run.stopped()) return cancelled();
  run.progress(0.2);
  GltfReport report;
  report.max_quantisation_error_mm = max_error_mm(geometry, options.draco);
  if (options.draco) {
    MAQUETTE_TRY(report.bytes, write_draco(mesh, geometry, options, file, path, report, run));
  } else {
    MAQUETTE_TRY(report.bytes, write_plain(mesh, geometry, options, file, path));
  }
  if (run.stopped()) return cancelled();
  MAQUETTE_TRY_VOID(file.commit());
  run.progress(1.0);
  return report;
}

}  // namespace maquette::exporting
