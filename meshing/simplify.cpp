// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/simplify.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModNormalFlippingT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>

#include "core/check.hpp"
#include "meshing/stone_parts.hpp"

namespace maquette::meshing {
namespace {

using Mesh = OpenMesh::TriMesh_ArrayKernelT<OpenMesh::DefaultTraitsDouble>;

constexpr std::uint64_t kFewest = 4;  // a tetrahedron
constexpr double kTurns_deg[] = {60.0, 30.0, 15.0};

Result<MeshCertificate> certificate_of(const TriMesh& mesh, const RunContext& run) {
  return check_mesh(mesh, nullptr, {}, RunContext{.stop = run.stop});
}

/// What OpenMesh keeps: neighbours of every edge.
Result<MeshCertificate> check_input(const TriMesh& mesh, const RunContext& run) {
  MAQUETTE_TRY(MeshCertificate was, certificate_of(mesh, run));
  if (!was.manifold || was.degenerate_triangles > 0)
    return fail(kNotSimplified,
                fmt::format("{}; a 2-manifold mesh without degenerate triangles expected",
                            shortcomings(was)));
  if (!was.sound()) run.warn(fmt::format("{}: so is what comes of it", shortcomings(was)));
  return was;
}

/// Nothing is worse than it was.
bool as_good(const MeshCertificate& now, const MeshCertificate& was) {
  return now.manifold && now.degenerate_triangles == 0 && now.closed == was.closed &&
         (now.sound() || !was.sound());
}

/// nullopt: OpenMesh does not take it.
std::optional<TriMesh> collapsed(const TriMesh& mesh, std::uint64_t triangles, double turn_deg) {
  Mesh body;
  body.request_vertex_status();
  body.request_edge_status();
  body.request_halfedge_status();
  body.request_face_status();
  body.request_face_normals();
  for (const Vec3& v : mesh.vertices_mm) body.add_vertex({v.x, v.y, v.z});
  for (const auto& [a, b, c] : mesh.triangles)
    if (!body.add_face(Mesh::VertexHandle(static_cast<int>(a)),
                       Mesh::VertexHandle(static_cast<int>(b)),
                       Mesh::VertexHandle(static_cast<int>(c)))
             .is_valid())
      return std::nullopt;
  for (const auto v : body.vertices()) body.status(v).set_locked(body.is_boundary(v));
  body.update_face_normals();
  OpenMesh::Decimater::DecimaterT<Mesh> decimater(body);
  OpenMesh::Decimater::ModQuadricT<Mesh>::Handle quadric;
  OpenMesh::Decimater::ModNormalFlippingT<Mesh>::Handle normals;
  decimater.add(quadric);
  decimater.module(quadric).unset_max_err();
  decimater.add(normals);
  decimater.module(normals).set_max_normal_deviation(turn_deg);
  if (!decimater.initialize()) return std::nullopt;
  decimater.decimate_to_faces(0, triangles);
  body.garbage_collection();
  TriMesh result;
  for (const auto v : body.vertices()) {
    const auto& p = body.point(v);
    result.vertices_mm.push_back({p[0], p[1], p[2]});
  }
  for (const auto f : body.faces()) {
    auto& corners = result.triangles.emplace_back();
    std::size_t k = 0;
    for (const auto v : body.fv_range(f)) corners[k++] = static_cast<std::uint32_t>(v.idx());
  }
  return result;
}

/// @param was  check_input()
Result<SimplifiedMesh> to_count(const TriMesh& mesh, const MeshCertificate& was,
                                std::uint64_t triangles, const RunContext& run) {
  std::string why = "OpenMesh does not take it";
  for (const double turn_deg : kTurns_deg) {
    if (run.stopped()) return fail(kCancelled, "simplifying was stopped");
    auto fewer = collapsed(mesh, triangles, turn_deg);
    if (!fewer) continue;
    SimplifiedMesh result;
    MAQUETTE_TRY(result.certificate, certificate_of(*fewer, run));
    if (!as_good(result.certificate, was)) {
      why = shortcomings(result.certificate);
      continue;
    }
    result.deviation_mm =
        std::fmax(clearance_of(*fewer, mesh).most_mm, clearance_of(mesh, *fewer).most_mm);
    result.mesh = *std::move(fewer);
    return result;
  }
  return fail(kNotSimplified, fmt::format("with {} triangles: {}; ask for more", triangles, why));
}

}  // namespace

Result<SimplifiedMesh> simplify(const TriMesh& mesh, std::uint64_t triangles,
                                const RunContext& run) {
  MAQUETTE_CHECK(triangles >= kFewest, "{} triangles", triangles);
  MAQUETTE_TRY(const MeshCertificate was, check_input(mesh, run));
  return to_count(mesh, was, triangles, run);
}

Result<SimplifiedMesh> simplify_within(const TriMesh& mesh, Millimetres most,
                                       const RunContext& run) {
  MAQUETTE_CHECK(most.value() > 0.0, "{} mm", most.value());
  MAQUETTE_TRY(const MeshCertificate was, check_input(mesh, run));
  constexpr double kNear = 1.0 / 16.0;
  std::uint64_t enough = mesh.triangles.size(), few = kFewest;
  std::optional<SimplifiedMesh> best;
  while (static_cast<double>(enough) > (1.0 + kNear) * static_cast<double>(few)) {
    // Counts that are tried are even in their logarithm.
    const auto middle = std::clamp(static_cast<std::uint64_t>(std::sqrt(
                                       static_cast<double>(enough) * static_cast<double>(few))),
                                   few, enough - 1);
    auto tried = to_count(mesh, was, middle, run);
    if (!tried && tried.error().code == kCancelled) return tried;
    if (tried && tried->deviation_mm <= most.value()) {
      enough = middle;
      best = *std::move(tried);
    } else {
      few = middle + 1;
    }
    run.progress(1.0 - std::log(static_cast<double>(enough) / static_cast<double>(few)) /
                           std::log(static_cast<double>(mesh.triangles.size()) / kFewest));
  }
  if (!best) {
    MAQUETTE_TRY(best.emplace(), to_count(mesh, was, mesh.triangles.size(), run));
  }
  return *std::move(best);
}

}  // namespace maquette::meshing
