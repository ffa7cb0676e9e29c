// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/mesh_borders.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <unordered_map>

#include <oneapi/tbb/parallel_sort.h>

#include "core/check.hpp"

namespace maquette::scan::detail {
namespace {

struct Half {
  std::uint64_t edge;
  std::uint32_t from, to;
  bool operator<(const Half& b) const { return edge != b.edge ? edge < b.edge : from < b.from; }
};

/// Border edges as the triangles have them.
std::vector<Half> border_of(const TriMesh& mesh) {
  std::vector<Half> halves;
  halves.reserve(3 * mesh.triangles.size());
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      halves.push_back({std::uint64_t{std::min(a, b)} << 32U | std::max(a, b), a, b});
    }
  oneapi::tbb::parallel_sort(halves.begin(), halves.end());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < halves.size();) {
    std::size_t j = i;
    while (j < halves.size() && halves[j].edge == halves[i].edge) ++j;
    MAQUETTE_CHECK(j - i <= 2, "an edge of {} triangles", j - i);
    if (j - i == 1) halves[kept++] = halves[i];
    i = j;
  }
  halves.resize(kept);
  return halves;
}

}  // namespace

std::size_t part_fans(TriMesh& mesh, std::vector<Colour>& colours) {
  std::vector<std::uint8_t> borders(mesh.vertices_mm.size(), 0);
  for (const Half& h : border_of(mesh))
    borders[h.from] = static_cast<std::uint8_t>(std::min(2, borders[h.from] + 1));
  struct Corner {
    std::uint32_t vertex;
    std::size_t triangle;
  };
  std::vector<Corner> corners;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const std::uint32_t v : mesh.triangles[t])
      if (borders[v] > 1) corners.push_back({v, t});
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.vertex < b.vertex; });
  const std::size_t before = mesh.vertices_mm.size();
  for (std::size_t i = 0; i < corners.size();) {
    std::size_t j = i;
    while (j < corners.size() && corners[j].vertex == corners[i].vertex) ++j;
    const std::uint32_t v = corners[i].vertex;
    // Triangles that share an edge at the vertex belong to one fan.
    std::vector<std::size_t> fan(j - i);
    std::iota(fan.begin(), fan.end(), std::size_t{0});
    std::unordered_map<std::uint32_t, std::size_t> by_other;
    for (std::size_t k = 0; k < fan.size(); ++k)
      for (const std::uint32_t other : mesh.triangles[corners[i + k].triangle]) {
        if (other == v) continue;
        const auto [found, fresh] = by_other.try_emplace(other, k);
        if (fresh) continue;
        const std::size_t from = fan[k], to = fan[found->second];
        std::replace(fan.begin(), fan.end(), from, to);
      }
    std::unordered_map<std::size_t, std::uint32_t> copy{{fan[0], v}};
    for (std::size_t k = 0; k < fan.size(); ++k) {
      const auto [found, fresh] =
          copy.try_emplace(fan[k], static_cast<std::uint32_t>(mesh.vertices_mm.size()));
      if (fresh) {
        const Vec3 place = mesh.vertices_mm[v];
        mesh.vertices_mm.push_back(place);
        if (!colours.empty()) colours.push_back(Colour{colours[v]});
      }
      for (std::uint32_t& c : mesh.triangles[corners[i + k].triangle])
        if (c == v) c = found->second;
    }
    i = j;
  }
  return mesh.vertices_mm.size() - before;
}

std::vector<std::vector<std::uint32_t>> border_loops(const TriMesh& mesh) {
  const std::vector<Half> border = border_of(mesh);
  std::unordered_map<std::uint32_t, std::uint32_t> next;
  // The border runs against the triangle's edge, so that a fan fits.
  for (const Half& h : border) {
    const bool only = next.emplace(h.to, h.from).second;
    MAQUETTE_CHECK(only, "vertex {} has two borders", h.to);
  }
  std::vector<std::vector<std::uint32_t>> loops;
  for (const Half& h : border) {
    std::vector<std::uint32_t> loop;
    for (auto step = next.find(h.to); step != next.end(); step = next.find(loop.back())) {
      const std::uint32_t to = step->second;
      if (loop.empty()) loop.push_back(step->first);
      next.erase(step);
      if (to == loop.front()) break;
      loop.push_back(to);
    }
    if (!loop.empty()) loops.push_back(std::move(loop));
  }
  return loops;
}

}  // namespace maquette::scan::detail
