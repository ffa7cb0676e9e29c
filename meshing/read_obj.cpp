// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <string>

#include <fmt/format.h>

#include "meshing/detail/mesh_readers.hpp"
#include "meshing/mesh_io.hpp"

namespace maquette::meshing::detail {
namespace {

/// Keywords of the format that carry no triangles, sorted. Anything else is an error: a
/// damaged "f" would otherwise lose a face without a word.
constexpr std::array<std::string_view, 38> kSkipped{
    "bevel",     "bmat", "bsp",    "bzp",        "c_interp", "cdc",   "con",  "cstype",
    "ctech",     "curv", "curv2",  "d_interp",   "deg",      "end",   "g",    "hole",
    "l",         "lod",  "maplib", "mg",         "mtllib",   "o",     "p",    "parm",
    "res",       "s",    "scrv",   "shadow_obj", "sp",       "stech", "step", "surf",
    "trace_obj", "trim", "usemap", "usemtl",     "vn",       "vp"};
static_assert(std::is_sorted(kSkipped.begin(), kSkipped.end()));

bool is_skipped(std::string_view keyword) {
  return keyword[0] == '#' || keyword == "vt" ||
         std::binary_search(kSkipped.begin(), kSkipped.end(), keyword);
}

/// The vertex number of v, v/t, v//n or v/t/n; nothing if it is none of these.
std::optional<std::int64_t> vertex_number(std::string_view token) {
  const std::size_t slash = token.find('/');
  if (slash != std::string_view::npos) {
    const std::string_view rest = token.substr(slash);
    if (rest.find_first_not_of("/-+0123456789") != std::string_view::npos ||
        std::count(rest.begin(), rest.end(), '/') > 2)
      return std::nullopt;
  }
  return parse_integer(token.substr(0, slash));
}

class ObjReader {
 public:
  ObjReader(std::string_view bytes, const RunContext& run) : bytes_(bytes), run_(run), in_(bytes) {}

  Result<TriMesh> read() {
    std::uint64_t lines = 0;
    do {
      if (lines++ % kItemsPerPoll == 0) {
        if (run_.stopped()) return fail(kCancelled, "stopped while reading");
        run_.progress(1.0 -
                      static_cast<double>(in_.bytes_left()) / static_cast<double>(bytes_.size()));
      }
      const std::string_view keyword = next();
      if (keyword.empty()) continue;
      if (keyword == "v") {
        MAQUETTE_TRY_VOID(read_vertex());
      } else if (keyword == "f" || keyword == "fo") {
        MAQUETTE_TRY_VOID(read_face());
      } else if (!is_skipped(keyword)) {
        return fail(kMeshFormat,
                    fmt::format("line {}: '{}' is no keyword of an OBJ file (nor is the file a "
                                "PLY or STL)",
                                in_.line(), shown(keyword)));
      }
    } while (in_.next_line());
    // Faces may name vertices that follow later, so this is known only now.
    if (largest_ > static_cast<std::int64_t>(mesh_.vertices_mm.size()))
      return fail(kMeshFormat, fmt::format("line {}: face names vertex {}, but there are {}",
                                           line_of_largest_, largest_, mesh_.vertices_mm.size()));
    return std::move(mesh_);
  }

 private:
  /// A backslash at the end of a line continues it.
  std::string_view next() {
    std::string_view token = in_.next_in_line();
    while (token == "\\" && in_.next_line()) token = in_.next_in_line();
    return token;
  }

  Result<void> read_vertex() {
    std::array<double, 3> xyz{};
    for (double& x : xyz) {
      const std::string_view token = next();
      const auto value = parse_double(token);
      if (!value || !std::isfinite(*value))
        return fail(kMeshFormat, fmt::format("line {}: finite coordinate expected, found '{}'",
                                             in_.line(), shown(token)));
      x = *value;
    }
    if (mesh_.vertices_mm.size() >= kMostVertices)
      return fail(kMeshFormat,
                  fmt::format("line {}: more than {} vertices", in_.line(), kMostVertices));
    mesh_.vertices_mm.push_back({xyz[0], xyz[1], xyz[2]});
    return {};
  }

  Result<void> read_face() {
    const auto known = static_cast<std::int64_t>(mesh_.vertices_mm.size());
    std::array<std::uint32_t, 3> corner{};  // first, previous, current
    std::size_t corners = 0;
    for (std::string_view token = next(); !token.empty() && token[0] != '#'; token = next()) {
      const auto number = vertex_number(token);
      if (!number)
        return fail(kMeshFormat, fmt::format("line {}: v, v/t, v//n or v/t/n expected, found '{}'",
                                             in_.line(), shown(token)));
      const std::int64_t index = *number < 0 ? known + *number : *number - 1;
      if (*number == 0 || index < 0 || index >= static_cast<std::int64_t>(kMostVertices))
        return fail(kMeshFormat, fmt::format("line {}: face names vertex {}, but there are {}",
                                             in_.line(), *number, known));
      if (index + 1 > largest_) {
        largest_ = index + 1;
        line_of_largest_ = in_.line();
      }
      corner[std::min<std::size_t>(corners, 2)] = static_cast<std::uint32_t>(index);
      if (++corners >= 3) {
        mesh_.triangles.push_back(corner);
        corner[1] = corner[2];
      }
    }
    if (corners < 3)
      return fail(kMeshFormat, fmt::format("line {}: a face needs at least 3 corners, found {}",
                                           in_.line(), corners));
    return {};
  }

  std::string_view bytes_;
  const RunContext& run_;
  Tokens in_;
  TriMesh mesh_;
  std::int64_t largest_ = 0;  ///< vertex number in a face, and where it stands
  std::uint64_t line_of_largest_ = 0;
};

}  // namespace

Result<TriMesh> read_obj(std::string_view bytes, const RunContext& run) {
  return ObjReader(bytes, run).read();
}

}  // namespace maquette::meshing::detail
