// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_readers.hpp
/// One reader per format, each from the whole file's bytes. Messages lack the file's
/// name: read_mesh puts it in front.

#include <cstdint>
#include <limits>
#include <optional>
#include <string_view>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::meshing::detail {

[[nodiscard]] Result<TriMesh> read_ply(std::string_view bytes, const RunContext& run);
[[nodiscard]] Result<TriMesh> read_ascii_stl(std::string_view bytes, const RunContext& run);
[[nodiscard]] Result<TriMesh> read_binary_stl(std::string_view bytes, const RunContext& run);
[[nodiscard]] Result<TriMesh> read_obj(std::string_view bytes, const RunContext& run);

/// Indices are 32-bit.
inline constexpr std::uint64_t kMostVertices = std::numeric_limits<std::uint32_t>::max();

/// How many items are read between two looks at the stop token.
inline constexpr std::uint64_t kItemsPerPoll = std::uint64_t{1} << 16;

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
