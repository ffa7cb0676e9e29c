// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gltf_text.hpp
/// Plain glTF files made by hand, for readers.

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include "core/tri_mesh.hpp"

namespace maquette::testing_support {

/// Vertices as float and indices as 32 bits, one after the other.
inline std::string gltf_buffer(const TriMesh& mesh) {
  std::string bytes;
  const auto put = [&](auto value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (const Vec3& v : mesh.vertices_mm)
    for (const double x : {v.x, v.y, v.z}) put(static_cast<float>(x));
  for (const auto& t : mesh.triangles)
    for (const std::uint32_t i : t) put(i);
  return bytes;
}

/// One node with the mesh; coordinates are written as they are: metres, y up.
/// @param node    further keys of the node: `,"translation":[1,2,3]`
/// @param buffer  further keys of the buffer: `,"uri":"a.bin"`
inline std::string gltf_json(const TriMesh& mesh, std::string_view node = "",
                             std::string_view buffer = "") {
  const std::size_t points = mesh.vertices_mm.size(), corners = 3 * mesh.triangles.size();
  return fmt::format(
      R"({{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],)"
      R"("nodes":[{{"mesh":0{}}}],)"
      R"("meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],)"
      R"("accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3"}},)"
      R"({{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}],)"
      R"("bufferViews":[{{"buffer":0,"byteLength":{}}},)"
      R"({{"buffer":0,"byteOffset":{},"byteLength":{}}}],"buffers":[{{"byteLength":{}{}}}]}})",
      node, points, corners, 12 * points, 12 * points, 4 * corners, 12 * points + 4 * corners,
      buffer);
}

inline std::string glb_file(std::string json, std::string_view binary) {
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const auto word = [](std::size_t n) {
    const auto value = static_cast<std::uint32_t>(n);
    return std::string(reinterpret_cast<const char*>(&value), sizeof value);
  };
  std::string file = "glTF" + word(2) + word(28 + json.size() + binary.size()) + word(json.size()) +
                     "JSON" + json + word(binary.size());
  file.append("BIN\0", 4);
  return file.append(binary);
}

inline std::string base64_text(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k)
      bits = bits << 8 | (i + k < bytes.size() ? static_cast<std::uint8_t>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k > bytes.size() ? '=' : kDigits[bits >> (18 - 6 * k) & 63];
  }
  return text;
}

}  // namespace maquette::testing_support
