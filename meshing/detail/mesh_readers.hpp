// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_readers.hpp
/// One reader per format, each from the whole file's bytes. Messages lack the file's
/// name: read_mesh puts it in front.

#include <bit>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string_view>
#include <vector>

#include "core/random.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "meshing/painted_mesh.hpp"

namespace maquette::meshing::detail {

[[nodiscard]] Result<TriMesh> read_ply(std::string_view bytes, const RunContext& run);
[[nodiscard]] Result<TriMesh> read_ascii_stl(std::string_view bytes, const RunContext& run);
[[nodiscard]] Result<TriMesh> read_binary_stl(std::string_view bytes, const RunContext& run);
/// @param folder  where files lie that a mesh's file names
/// @param looks  materials and pictures are read, too; else only the mesh
[[nodiscard]] Result<PaintedMesh> read_obj(std::string_view bytes,
                                           const std::filesystem::path& folder, bool looks,
                                           const RunContext& run);
[[nodiscard]] Result<PaintedMesh> read_gltf(std::string_view bytes,
                                            const std::filesystem::path& folder, bool looks,
                                            const RunContext& run);
/// A binary glTF, or one that is text: the only format that begins with a brace.
[[nodiscard]] bool looks_like_gltf(std::string_view bytes);

/// Indices are 32-bit.
inline constexpr std::uint64_t kMostVertices = std::numeric_limits<std::uint32_t>::max();

/// How many items are read between two looks at the stop token.
inline constexpr std::uint64_t kItemsPerPoll = std::uint64_t{1} << 16;

// ---- corners ------------------------------------------------------------------------

/// Gives every distinct corner one number, in order of first appearance. Open addressing
/// over the vertex list itself: 4 bytes a slot, filled to at most a half.
class Welder {
 public:
  explicit Welder(std::vector<Vec3>& vertices) : vertices_(vertices), slots_(1024, kFree) {}

  std::uint32_t number_of(Vec3 corner) {
    corner = corner + Vec3{};  // -0 + 0 is +0: the two are equal and must hash alike
    std::size_t slot = find(corner);
    if (slots_[slot] == kFree) {
      if (2 * (vertices_.size() + 1) > slots_.size()) {
        grow();
        slot = find(corner);
      }
      slots_[slot] = static_cast<std::uint32_t>(vertices_.size());
      vertices_.push_back(corner);
    }
    return slots_[slot];
  }

 private:
  static constexpr std::uint32_t kFree = 0xffffffff;

  [[nodiscard]] std::size_t find(Vec3 v) const {
    const std::uint64_t hash =
        mix64(std::bit_cast<std::uint64_t>(v.x) ^
              mix64(std::bit_cast<std::uint64_t>(v.y) ^ mix64(std::bit_cast<std::uint64_t>(v.z))));
    std::size_t slot = hash & (slots_.size() - 1);
    while (slots_[slot] != kFree && vertices_[slots_[slot]] != v)
      slot = (slot + 1) & (slots_.size() - 1);
    return slot;
  }

  void grow() {
    slots_.assign(2 * slots_.size(), kFree);
    for (std::size_t i = 0; i < vertices_.size(); ++i)
      slots_[find(vertices_[i])] = static_cast<std::uint32_t>(i);
  }

  std::vector<Vec3>& vertices_;
  std::vector<std::uint32_t> slots_;
};

// ---- text ---------------------------------------------------------------------------

/// Number that fills the whole token; a leading + is fine, a value too small for double
/// is 0. Independent of the locale.
[[nodiscard]] std::optional<double> parse_double(std::string_view token);
/// Also for the scalar types of ascii PLY: an integer, written as such.
[[nodiscard]] std::optional<std::int64_t> parse_integer(std::string_view token);

/// Tokens between white space, with the line they stand in (from 1).
class Tokens {
 public:
  explicit Tokens(std::string_view text, std::uint64_t line = 1) : rest_(text), line_(line) {}
  /// Empty at the end of the text.
  [[nodiscard]] std::string_view next();
  /// The same, but empty at the end of the line, which stays in front of the next call.
  [[nodiscard]] std::string_view next_in_line();
  /// Drops what is left of the line and its end; false at the end of the text.
  bool next_line();
  [[nodiscard]] std::uint64_t line() const { return line_; }
  [[nodiscard]] std::size_t bytes_left() const { return rest_.size(); }

 private:
  std::string_view rest_;
  std::uint64_t line_;
};

/// For messages: unprintable bytes as ?, at most 40 characters.
[[nodiscard]] std::string shown(std::string_view token);

}  // namespace maquette::meshing::detail
