// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_stream.hpp
/// A triangle mesh that is asked for in pieces, so that what is written need not be in memory.

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "core/tri_mesh.hpp"

namespace maquette {

/// Vertices and triangles by number, any piece at any time, from several threads at once.
/// Model frame, millimetres, triangles counter-clockwise seen from outside.
class MeshStream {
 public:
  using Corners = std::array<Vec3, 3>;
  using Triangle = std::array<std::uint32_t, 3>;
  virtual ~MeshStream() = default;
  [[nodiscard]] virtual std::uint64_t vertex_count() const = 0;
  [[nodiscard]] virtual std::uint64_t triangle_count() const = 0;
  /// Fill `out` from number `first` on. @pre first + out.size() <= count
  virtual void vertices(std::uint64_t first, std::span<Vec3> out) const = 0;
  virtual void triangles(std::uint64_t first, std::span<Triangle> out) const = 0;
  virtual void corners(std::uint64_t first, std::span<Corners> out) const = 0;
};

/// A mesh in memory; it must outlive the stream.
class TriMeshStream final : public MeshStream {
 public:
  explicit TriMeshStream(const TriMesh& mesh) : mesh_(mesh) {}
  [[nodiscard]] std::uint64_t vertex_count() const override { return mesh_.vertices_mm.size(); }
  [[nodiscard]] std::uint64_t triangle_count() const override { return mesh_.triangles.size(); }
  void vertices(std::uint64_t first, std::span<Vec3> out) const override {
    std::copy_n(mesh_.vertices_mm.data() + first, out.size(), out.data());
  }
  void triangles(std::uint64_t first, std::span<Triangle> out) const override {
    std::copy_n(mesh_.triangles.data() + first, out.size(), out.data());
  }
  void corners(std::uint64_t first, std::span<Corners> out) const override {
    for (std::size_t i = 0; i < out.size(); ++i) {
      const Triangle& t = mesh_.triangles[first + i];
      out[i] = {mesh_.vertices_mm[t[0]], mesh_.vertices_mm[t[1]], mesh_.vertices_mm[t[2]]};
    }
  }

 private:
  const TriMesh& mesh_;
};

}  // namespace maquette
