// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file placed_stones.hpp
/// Stones of a plan, made by hand.

#include <cstdint>
#include <memory>

#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/stone_body.hpp"
#include "meshing/stones.hpp"
#include "support/shapes.hpp"

namespace maquette::testing_support {

/// A rock with its middle over a place, sunk by a share of its size; its number is its seed.
inline meshing::PlacedStone placed_rock(int number, const heightmap::ModelField& field, double x,
                                        double y, double size_mm, double sunk = 0.0) {
  meshing::PlacedStone stone;
  stone.number = number;
  stone.shape.seed = static_cast<std::uint64_t>(number);
  stone.shape.subdivisions = 3;
  stone.scale_mm = size_mm;
  stone.model_from_stone.translation_mm = {x, y,
                                           heightmap::height_at(field, x, y) - sunk * size_mm};
  return stone;
}

/// A body of diameter 1, scaled, with its middle there.
inline meshing::PlacedStone placed_body(int number, TriMesh mesh, double size_mm, Vec3 at) {
  auto body = std::make_shared<meshing::StoneBody>();
  body->name = body->source = "made";
  body->mesh = std::move(mesh);
  meshing::PlacedStone stone;
  stone.number = number;
  stone.body = body;
  stone.scale_mm = size_mm;
  stone.model_from_stone.translation_mm = at;
  return stone;
}

/// It cuts itself, so that only a level set with a fillet unites it with terrain.
inline meshing::PlacedStone two_balls_in_one(Vec3 at) {
  TriMesh balls = unit_sphere(3), second = balls;
  for (Vec3& v : balls.vertices_mm) v = 0.5 * v;
  for (Vec3& v : second.vertices_mm) v = 0.2 * v + Vec3{0.4, 0.05, 0.1};
  append(balls, second);
  return placed_body(1, std::move(balls), 12.0, at);
}

}  // namespace maquette::testing_support
