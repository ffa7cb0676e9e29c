// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/scene_cover.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "camera/image_io.hpp"
#include "camera/srgb.hpp"
#include "meshing/painted_mesh.hpp"

namespace maquette::tools {
namespace {
namespace fs = std::filesystem;
using meshing::Beyond;
using meshing::Paint;

/// A real index that reflects so much at normal incidence: Fresnel, F = ((n - 1) / (n + 1))^2.
double index_of(double reflectance) {
  const double root = std::sqrt(std::clamp(reflectance, 0.0, 0.96));
  return (1.0 + root) / (1.0 - root);
}

camera::Law law_of(const Paint& paint) {
  const auto& c = paint.colour;
  if (paint.metallic < 0.5) return camera::Lambert{{c[0], c[1], c[2]}};
  constexpr double kSmoothest = 1e-3;
  return camera::Ggx{{index_of(c[0]), index_of(c[1]), index_of(c[2])},
                     {0.0, 0.0, 0.0},
                     {1.0, 1.0, 1.0},
                     std::max(kSmoothest, paint.roughness * paint.roughness)};
}

camera::MeshPicture::Beyond beyond_of(Beyond b) {
  using To = camera::MeshPicture::Beyond;
  return b == Beyond::edge ? To::edge : b == Beyond::mirrored ? To::mirrored : To::repeats;
}

bool same_picture(const Paint& a, const Paint& b) {
  return a.picture_file == b.picture_file && a.beyond == b.beyond && a.picture == b.picture;
}

Result<std::shared_ptr<const camera::MeshPicture>> picture_of(const Paint& paint) {
  const std::string name = fmt::format("picture of material '{}'", paint.name);
  auto read = paint.picture_file.empty() ? camera::read_image(paint.picture, name)
                                         : camera::read_image(paint.picture_file);
  if (!read) return tl::unexpected(std::move(read).error());
  auto picture = std::make_shared<camera::MeshPicture>();
  for (std::size_t b = 0; b < 3; ++b) {
    // Grey, or grey with alpha, has its light in the first.
    picture->factor[b] = read->channels[read->channels.size() >= 3 ? b : 0];
    if (read->eight_bit)
      for (float& v : picture->factor[b].cells()) v = camera::linear_of_srgb(v);
  }
  for (std::size_t k = 0; k < 2; ++k) picture->beyond[k] = beyond_of(paint.beyond[k]);
  return picture;
}

Result<void> check_described(const std::vector<Paint>& paints,
                             const std::function<bool(const Paint&)>& in_scene,
                             const fs::path& path) {
  std::vector<std::string> unknown;
  for (const Paint& paint : paints)
    if (!paint.described && !in_scene(paint)) unknown.push_back(paint.name);
  if (unknown.empty()) return {};
  return fail(meshing::kNoPaint,
              fmt::format("{}: what its materials '{}' look like is said nowhere; put its .mtl "
                          "beside it, or describe them by [[material]] tables of these names",
                          path.string(), fmt::join(unknown, "', '")));
}

}  // namespace

Result<CoveredMesh> load_covered_mesh(const fs::path& path,
                                      const std::deque<SceneMaterial>& materials,
                                      const RunContext& run) {
  MAQUETTE_TRY(auto read, meshing::read_painted_mesh(path, run));
  auto cover = std::make_shared<camera::MeshCover>();
  const auto in_scene = [&](const Paint& paint) {
    return std::any_of(materials.begin(), materials.end(),
                       [&](const SceneMaterial& m) { return m.name == paint.name; });
  };
  MAQUETTE_TRY_VOID(check_described(read.paints, in_scene, path));
  for (const Paint& paint : read.paints) {
    camera::Material material{paint.name, law_of(paint), {}};
    if (in_scene(paint)) {
      MAQUETTE_TRY(material, find_material(materials, paint.name));
    }
    cover->materials.push_back(std::move(material));
    if (!paint.has_picture()) {
      cover->pictures.push_back(nullptr);
      continue;
    }
    // One copy of those that several have.
    const auto same =
        std::find_if(read.paints.begin(), read.paints.begin() + std::ssize(cover->pictures),
                     [&](const Paint& other) { return same_picture(paint, other); });
    if (const auto k = static_cast<std::size_t>(same - read.paints.begin());
        k < cover->pictures.size()) {
      cover->pictures.push_back(cover->pictures[k]);
      continue;
    }
    auto fresh = picture_of(paint);
    if (!fresh) return tl::unexpected(std::move(fresh).error().within(path.string()));
    cover->pictures.push_back(std::move(*fresh));
  }
  cover->material_of = std::move(read.paint_of);
  cover->at_corner = std::move(read.at_corner);
  auto fine = camera::check_cover(*cover, read.mesh);
  if (!fine) return tl::unexpected(std::move(fine).error().within(path.string()));
  return CoveredMesh{std::move(read.mesh), std::move(cover), std::move(read.files)};
}

}  // namespace maquette::tools
