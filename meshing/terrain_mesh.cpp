// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/terrain_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

namespace maquette::meshing::detail {
namespace {

constexpr int kLanes = TerrainMesh::kLeastColumns;
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));
using Masks = std::int32_t __attribute__((vector_size(kLanes * sizeof(float))));

float sum(Lanes v) {
  using Four = float __attribute__((vector_size(16)));
  Four low, high;
  std::memcpy(&low, &v, sizeof low);
  std::memcpy(&high, reinterpret_cast<const char*>(&v) + sizeof low, sizeof high);
  low += high;
  return (low[0] + low[2]) + (low[1] + low[3]);
}

/// From the lower end of an edge, whoever asks: triangles that share it agree to the bit.
struct Crossing {
  double at = 0.0, step = 0.0;
  Crossing(const TerrainMesh::Vertex& low, const TerrainMesh::Vertex& high, std::int32_t row) {
    constexpr double kPart = 1.0 / TerrainMesh::kParts;
    // Crossings are multiples of a part's share of the rows: rounding cannot reach the next one.
    // A node on the edge belongs to the east: numbers up to here are cut to it.
    constexpr double kUp = 1.0 - 1e-7;
    if (high.row != low.row)
      step = static_cast<double>(high.col - low.col) / static_cast<double>(high.row - low.row);
    at = low.col * kPart + step * ((row * TerrainMesh::kParts - low.row) * kPart) + kUp;
  }
};

/// Where each of `count` items goes if they are sorted by their key, the order of equals kept.
template <class Key>
std::vector<std::uint32_t> places_by_key(std::uint32_t count, std::uint32_t keys, Key key) {
  std::vector<std::uint32_t> start(keys + 1, 0), place(count);
  for (std::uint32_t i = 0; i < count; ++i) ++start[key(i) + 1];
  for (std::uint32_t k = 0; k < keys; ++k) start[k + 1] += start[k];
  for (std::uint32_t i = 0; i < count; ++i) place[i] = start[key(i)]++;
  return place;
}

/// Moves each item to its place; `place` is used up.
template <class Items>
void permute(Items& items, std::vector<std::uint32_t>& place) {
  for (std::uint32_t i = 0; i < place.size(); ++i)
    while (place[i] != i) {
      const std::uint32_t to = place[i];
      std::swap(items[i], items[to]);
      std::swap(place[i], place[to]);
    }
}

}  // namespace

TerrainMesh::TerrainMesh(const heightmap::ModelField& field)
    : field_(field),
      last_row_(static_cast<std::int32_t>(field.z_mm.rows() - 1) * kParts),
      last_col_(static_cast<std::int32_t>(field.z_mm.cols() - 1) * kParts) {}

std::uint32_t TerrainMesh::add_vertex(std::int32_t row, std::int32_t col) {
  const Grid<float>& z = field_.z_mm;
  const std::int32_t r = row / kParts, c = col / kParts;
  const std::int32_t r1 = row < last_row_ ? r + 1 : r, c1 = col < last_col_ ? c + 1 : c;
  constexpr float kPart = 1.0F / kParts;
  const float y = static_cast<float>(row % kParts) * kPart;
  const float x = static_cast<float>(col % kParts) * kPart;
  const float low = z(r, c) + (z(r, c1) - z(r, c)) * x;
  const float high = z(r1, c) + (z(r1, c1) - z(r1, c)) * x;
  vertices_.push_back({row, col, low + (high - low) * y, kNone});
  return static_cast<std::uint32_t>(vertices_.size() - 1);
}

void TerrainMesh::sort_by_place(std::int32_t nodes) {
  const std::int32_t side = nodes * kParts;
  const std::int32_t across = last_col_ / side + 1, up = last_row_ / side + 1;
  const auto key = [&](std::uint32_t v) {
    const std::int32_t r = vertices_[v].row / side, c = vertices_[v].col / side;
    return static_cast<std::uint32_t>(r * across + (r % 2 == 0 ? c : across - 1 - c));
  };
  const auto keys = static_cast<std::uint32_t>(across * up);
  const std::uint32_t count = triangles_.size();
  std::vector<std::uint32_t> place =
      places_by_key(count, keys, [&](std::uint32_t t) { return key(triangles_[t].v[0]); });
  for (std::uint32_t t = 0; t < count; ++t)
    for (std::uint32_t& n : triangles_[t].n)
      if (n != kNone) n = place[n];
  permute(triangles_, place);
  place = places_by_key(static_cast<std::uint32_t>(vertices_.size()), keys, key);
  for (std::uint32_t t = 0; t < count; ++t)
    for (std::uint32_t& v : triangles_[t].v) v = place[v];
  permute(vertices_, place);
}

/// Eight nodes of a row at once; half open, as for_rows().
TerrainMesh::Sums TerrainMesh::sums(const Vertex& a, const Vertex& b, const Vertex& c) const {
  constexpr float kPart = 1.0F / kParts;
  const auto from_a = [](std::int32_t x, std::int32_t y) {
    return static_cast<float>(x - y) * kPart;
  };
  const float r1 = from_a(b.row, a.row), r2 = from_a(c.row, a.row);
  const float c1 = from_a(b.col, a.col), c2 = from_a(c.col, a.col);
  const float z1 = b.z_mm - a.z_mm, z2 = c.z_mm - a.z_mm;
  const float per_area = 1.0F / (c1 * r2 - r1 * c2);
  const float per_col = (z1 * r2 - z2 * r1) * per_area, per_row = (z2 * c1 - z1 * c2) * per_area;
  const Vertex *low = &a, *middle = &b, *high = &c;
  if (middle->row < low->row) std::swap(low, middle);
  if (high->row < middle->row) std::swap(middle, high);
  if (middle->row < low->row) std::swap(low, middle);
  const bool middle_is_east = detail::doubled_area(*low, *middle, *high) > 0;
  const auto up = [](std::int32_t row) { return (row + kParts - 1) / kParts; };
  const std::int32_t first = up(low->row), bend = up(middle->row), end = up(high->row);

  const Masks lane{0, 1, 2, 3, 4, 5, 6, 7};
  Lanes off{}, off_x{}, off_y{}, squares{};
  const auto last_start = static_cast<std::int32_t>(field_.z_mm.cols()) - kLanes;
  const float col0 = static_cast<float>(a.col) * kPart;
  Crossing along(*low, *high, first);
  float y = static_cast<float>(first) - static_cast<float>(a.row) * kPart;
  const auto rows = [&](std::int32_t from_row, std::int32_t to_row, const Vertex& p,
                        const Vertex& q) {
    if (from_row >= to_row) return;
    const Crossing other(p, q, from_row);
    double west = middle_is_east ? along.at : other.at, east = middle_is_east ? other.at : along.at;
    const double west_step = middle_is_east ? along.step : other.step;
    const double east_step = middle_is_east ? other.step : along.step;
    const float* height = &field_.z_mm(from_row, 0);
    for (std::int32_t r = from_row; r < to_row; ++r, height += field_.z_mm.cols()) {
      auto k = static_cast<std::int32_t>(west);
      const auto to = static_cast<std::int32_t>(east);
      const float here = per_row * y;
      for (; k < to; k += kLanes) {
        const std::int32_t start = std::min(k, last_start);
        const Masks column = lane + start;
        const Masks inside = (column >= k) & (column < to);
        Lanes z;
        std::memcpy(&z, height + start, sizeof z);
        const Lanes x = __builtin_convertvector(column, Lanes) - col0;
        Lanes d = (z - a.z_mm) - (per_col * x + here);
        d = reinterpret_cast<Lanes>(reinterpret_cast<Masks>(d) & inside);
        off += d;
        off_x += d * x;
        off_y += d * y;
        squares += d * d;
      }
      west += west_step;
      east += east_step;
      y += 1.0F;
    }
    along.at = middle_is_east ? west : east;
  };
  rows(first, bend, *low, *middle);
  rows(bend, end, *middle, *high);
  Sums s{sum(off), sum(off_x), sum(off_y), sum(squares)};
  // A float's last place, for every node.
  const float step = 3e-7F * (std::abs(a.z_mm) + std::abs(z1) + std::abs(z2));
  if (s.squares <= step * step * (1.0F + 0.5F / per_area)) s = {};
  return s;
}

void TerrainMesh::measure(Triangle& t) const {
  const Vertex &a = vertices_[t.v[0]], &b = vertices_[t.v[1]], &c = vertices_[t.v[2]];
  const Sums s = sums(a, b, c);
  const float r1 = static_cast<float>(b.row - a.row), r2 = static_cast<float>(c.row - a.row);
  const float c1 = static_cast<float>(b.col - a.col), c2 = static_cast<float>(c.col - a.col);
  const float scale = kParts / (c1 * r2 - r1 * c2);
  t.pull[1] = (s.off_x * r2 - s.off_y * c2) * scale;
  t.pull[2] = (s.off_y * c1 - s.off_x * r1) * scale;
  t.pull[0] = s.off - t.pull[1] - t.pull[2];
  t.squares = s.squares;
}

float TerrainMesh::squares(const Vertex& a, const Vertex& b, const Vertex& c) const {
  return sums(a, b, c).squares;
}

float TerrainMesh::fitted_squares(const Triangle& t) const {
  const auto area = static_cast<float>(doubled_area(t)) * (0.5F / (kParts * kParts));
  const auto& p = t.pull;
  const float sum = p[0] + p[1] + p[2];
  const float gain = 12.0F / area * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2] - 0.25F * sum * sum);
  // Of few nodes the estimate can be more than there is.
  constexpr float kLeast = 0.1F;
  return std::max(t.squares - gain, kLeast * t.squares);
}

TerrainMesh::Worst TerrainMesh::worst(const Triangle& t) const {
  Worst worst;
  for_rows(t, false,
           [&](std::int32_t r, std::int32_t from, std::int32_t to, double z, double per_col) {
             const float* height = field_.z_mm.row(r).data();
             for (std::int32_t k = from; k <= to; ++k) {
               const auto off =
                   static_cast<float>(std::abs(z + per_col * k - static_cast<double>(height[k])));
               if (off > worst.off_mm) worst = {off, r, k};
             }
           });
  return worst;
}

void TerrainMesh::relink(std::uint32_t of, std::uint32_t from, std::uint32_t to) {
  if (of == kNone) return;
  for (std::uint32_t& n : triangles_[of].n)
    if (n == from) {
      n = to;
      return;
    }
}

std::uint32_t TerrainMesh::turn(std::uint32_t t, std::size_t i) {
  const std::uint32_t u = triangles_[t].n[i];
  if (u == kNone) return kNone;
  Triangle &near = triangles_[t], &far = triangles_[u];
  std::size_t j = 0;
  while (far.n[j] != t) ++j;
  const std::uint32_t p = near.v[i], b = near.v[(i + 1) % 3], c = near.v[(i + 2) % 3], q = far.v[j];
  const Vertex &at_p = vertices_[p], &at_b = vertices_[b], &at_c = vertices_[c],
               &at_q = vertices_[q];
  if (detail::doubled_area(at_p, at_b, at_q) < kLeastArea ||
      detail::doubled_area(at_p, at_q, at_c) < kLeastArea)
    return kNone;
  constexpr float kGain = 0.99F;
  const float before = kGain * (near.squares + far.squares);
  const float first = squares(at_p, at_b, at_q);
  if (first >= before || first + squares(at_p, at_q, at_c) >= before) return kNone;
  const std::uint32_t past_b = far.n[(j + 1) % 3], past_c = far.n[(j + 2) % 3];
  const std::uint32_t before_c = near.n[(i + 1) % 3], before_b = near.n[(i + 2) % 3];
  near.v = {p, b, q};
  near.n = {past_b, u, before_b};
  far.v = {p, q, c};
  far.n = {past_c, before_c, t};
  measure(near);
  measure(far);
  relink(past_b, u, t);
  relink(before_c, t, u);
  vertices_[p].triangle = vertices_[b].triangle = vertices_[q].triangle = t;
  vertices_[c].triangle = u;
  return u;
}

}  // namespace maquette::meshing::detail
