// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gltf_json.hpp
/// Values of a glTF's JSON with the place where they stand, poses of its nodes, bytes in its text.

#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/result.hpp"
#include "core/vec.hpp"
#include "meshing/mesh_io.hpp"

namespace maquette::meshing::detail::gltf {

using Json = nlohmann::json;

/// A value and the path to it, for messages; the value is null where there is none.
struct Node {
  const Json* value = nullptr;
  std::string path;

  [[nodiscard]] Node at(std::string_view key) const {
    const std::string name(key);
    const bool there = value != nullptr && value->is_object() && value->contains(name);
    return {there ? &(*value)[name] : nullptr, fmt::format("{}/{}", path, key)};
  }
  [[nodiscard]] Node at(std::size_t i) const {
    const bool there = value != nullptr && value->is_array() && i < value->size();
    return {there ? &(*value)[i] : nullptr, fmt::format("{}/{}", path, i)};
  }
  [[nodiscard]] bool given() const { return value != nullptr; }
  [[nodiscard]] std::size_t size() const {
    return value != nullptr && value->is_array() ? value->size() : 0;
  }
  [[nodiscard]] std::string text() const {
    return value != nullptr && value->is_string() ? value->get<std::string>() : std::string();
  }
};

inline tl::unexpected<Error> bad(const Node& node, std::string_view expected) {
  return fail(kMeshFormat, fmt::format("{}: {} expected", node.path, expected));
}

/// A count, offset or index; `absent` where the key is missing.
inline Result<std::uint64_t> whole(const Node& node, std::int64_t absent = -1) {
  if (!node.given() && absent >= 0) return static_cast<std::uint64_t>(absent);
  if (!node.given() || !node.value->is_number_unsigned())
    return bad(node, "a whole number from 0 on");
  return node.value->get<std::uint64_t>();
}

inline Result<Node> element(const Node& list, const Node& index) {
  MAQUETTE_TRY(const std::uint64_t i, whole(index));
  if (i >= list.size())
    return fail(kMeshFormat, fmt::format("{}: names {} {}, but there are {}", index.path, list.path,
                                         i, list.size()));
  return list.at(static_cast<std::size_t>(i));
}

template <std::size_t N>
Result<std::array<double, N>> numbers(const Node& node, std::array<double, N> absent) {
  if (!node.given()) return absent;
  std::array<double, N> all{};
  bool fine = node.size() == N;
  for (std::size_t i = 0; fine && i < N; ++i) {
    const Json& x = (*node.value)[i];
    fine = x.is_number() && std::isfinite(all[i] = x.get<double>());
  }
  if (!fine) return bad(node, fmt::format("{} finite numbers", N));
  return all;
}

// ---- poses -----------------------------------------------------------------------------

/// x -> a x + shift
struct Affine {
  std::array<Vec3, 3> columns{Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};
  Vec3 shift{};

  [[nodiscard]] Vec3 direction(Vec3 v) const {
    return v.x * columns[0] + v.y * columns[1] + v.z * columns[2];
  }
  [[nodiscard]] Vec3 point(Vec3 v) const { return direction(v) + shift; }
  [[nodiscard]] bool mirrors() const {
    return dot(columns[0], cross(columns[1], columns[2])) < 0.0;
  }
  friend Affine operator*(const Affine& a, const Affine& b) {
    return {{a.direction(b.columns[0]), a.direction(b.columns[1]), a.direction(b.columns[2])},
            a.point(b.shift)};
  }
};

inline Result<Affine> pose_of(const Node& node) {
  if (node.at("matrix").given()) {
    MAQUETTE_TRY(const auto m, numbers<16>(node.at("matrix"), {}));
    return Affine{{Vec3{m[0], m[1], m[2]}, Vec3{m[4], m[5], m[6]}, Vec3{m[8], m[9], m[10]}},
                  {m[12], m[13], m[14]}};
  }
  MAQUETTE_TRY(const auto t, numbers<3>(node.at("translation"), {}));
  MAQUETTE_TRY(const auto r, numbers<4>(node.at("rotation"), {0, 0, 0, 1}));
  MAQUETTE_TRY(const auto s, numbers<3>(node.at("scale"), {1, 1, 1}));
  const double length = std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]);
  if (!(std::abs(length - 1.0) < 1e-3)) return bad(node.at("rotation"), "a quaternion of length 1");
  const Quaternion q = normalized(Quaternion{r[3], r[0], r[1], r[2]});
  return Affine{
      {s[0] * rotate(q, {1, 0, 0}), s[1] * rotate(q, {0, 1, 0}), s[2] * rotate(q, {0, 0, 1})},
      {t[0], t[1], t[2]}};
}

// ---- text in base 64 ---------------------------------------------------------------------

inline std::optional<std::string> from_base64(std::string_view text) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  while (text.ends_with('=')) text.remove_suffix(1);
  std::string bytes;
  bytes.reserve(text.size() * 3 / 4);
  std::uint32_t bits = 0;
  int held = 0;
  for (const char c : text) {
    const std::size_t digit = kDigits.find(c);
    if (digit == std::string_view::npos) return std::nullopt;
    bits = (bits << 6) | static_cast<std::uint32_t>(digit);
    held += 6;
    if (held >= 8) {
      held -= 8;
      bytes.push_back(static_cast<char>((bits >> held) & 0xff));
    }
  }
  return bytes;
}

/// Of a "data:" text; none: not in base 64.
inline std::optional<std::string> from_data(std::string_view text) {
  constexpr std::string_view kBegin = ";base64,";
  const std::size_t at = text.find(kBegin);
  return at == std::string_view::npos ? std::nullopt : from_base64(text.substr(at + kBegin.size()));
}

/// %20 and its like in a file's name.
inline std::string from_percent(std::string_view text) {
  std::string name;
  for (std::size_t i = 0; i < text.size(); ++i) {
    int code = 0;
    if (text[i] == '%' && i + 2 < text.size() &&
        std::from_chars(text.data() + i + 1, text.data() + i + 3, code, 16).ptr ==
            text.data() + i + 3) {
      name.push_back(static_cast<char>(code));
      i += 2;
    } else {
      name.push_back(text[i]);
    }
  }
  return name;
}

}  // namespace maquette::meshing::detail::gltf
