// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/pack_builds.hpp"

#include <algorithm>
#include <numeric>

#include <fmt/format.h>

#include "core/check.hpp"

namespace maquette::exporting {
namespace {

/// A hair of slack, so that ten boxes of 0.1 fit in 1.
constexpr double kSlack_mm = 1e-9;

struct Row {
  double y_mm, depth_mm, filled_mm;
};
struct Layer {
  double z_mm, filled_mm;
  std::vector<Row> rows;
};
struct Volume {
  double filled_mm = 0.0;
  std::vector<Layer> layers;
};

class Shelves {
 public:
  explicit Shelves(const BuildVolume& volume) : room_(volume.size_mm), gap_(volume.spacing_mm) {}

  /// @pre the box fits in an empty volume and is no higher than those before it
  PackedBox place(Vec3 size) {
    for (std::size_t v = 0; v < volumes_.size(); ++v) {
      for (Layer& layer : volumes_[v].layers) {
        for (Row& row : layer.rows)
          if (size.y <= row.depth_mm + kSlack_mm && row.filled_mm + size.x <= room_.x + kSlack_mm)
            return in_row(v, layer, row, size);
        if (layer.filled_mm + size.y <= room_.y + kSlack_mm)
          return in_row(v, layer, new_row(layer, size), size);
      }
      if (volumes_[v].filled_mm + size.z <= room_.z + kSlack_mm) return on_top(v, size);
    }
    volumes_.emplace_back();
    return on_top(volumes_.size() - 1, size);
  }

 private:
  Row& new_row(Layer& layer, Vec3 size) const {
    layer.rows.push_back({layer.filled_mm, size.y, 0.0});
    layer.filled_mm += size.y + gap_;
    return layer.rows.back();
  }
  PackedBox in_row(std::size_t volume, const Layer& layer, Row& row, Vec3 size) const {
    const PackedBox placed{volume, {row.filled_mm, row.y_mm, layer.z_mm}};
    row.filled_mm += size.x + gap_;
    return placed;
  }
  PackedBox on_top(std::size_t v, Vec3 size) {
    Volume& volume = volumes_[v];
    volume.layers.push_back({volume.filled_mm, 0.0, {}});
    volume.filled_mm += size.z + gap_;
    Layer& layer = volume.layers.back();
    return in_row(v, layer, new_row(layer, size), size);
  }

  Vec3 room_;
  double gap_;
  std::vector<Volume> volumes_;
};

}  // namespace

Result<std::vector<PackedBox>> pack_builds(std::span<const Vec3> sizes_mm,
                                           const BuildVolume& volume) {
  const Vec3 room = volume.size_mm;
  MAQUETTE_CHECK(room.x > 0.0 && room.y > 0.0 && room.z > 0.0 && volume.spacing_mm >= 0.0,
                 "{} x {} x {} mm, spacing {} mm", room.x, room.y, room.z, volume.spacing_mm);
  for (std::size_t i = 0; i < sizes_mm.size(); ++i) {
    const Vec3 s = sizes_mm[i];
    MAQUETTE_CHECK(s.x > 0.0 && s.y > 0.0 && s.z > 0.0, "box {}", i);
    if (s.x > room.x || s.y > room.y || s.z > room.z)
      return fail(
          kPartTooLarge,
          fmt::format("part {} of the list is {:.1f} x {:.1f} x {:.1f} mm; the build volume "
                      "has {:g} x {:g} x {:g} mm; name a larger machine",
                      i + 1, s.x, s.y, s.z, room.x, room.y, room.z));
  }
  std::vector<std::size_t> order(sizes_mm.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const Vec3 p = sizes_mm[a], q = sizes_mm[b];
    return p.z != q.z ? p.z > q.z : p.y > q.y;
  });
  Shelves shelves(volume);
  std::vector<PackedBox> placed(sizes_mm.size());
  for (const std::size_t i : order) placed[i] = shelves.place(sizes_mm[i]);
  return placed;
}

}  // namespace maquette::exporting
