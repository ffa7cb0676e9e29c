// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "core/files.hpp"
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

/// What is left of a line, as names with spaces need it.
/// @param first  of it, if it was read already
std::string rest_of_line(Tokens& in, std::string_view first = {}) {
  std::string all(first);
  for (std::string_view token = in.next_in_line(); !token.empty(); token = in.next_in_line()) {
    if (!all.empty()) all.push_back(' ');
    all.append(token);
  }
  return all;
}

class ObjReader {
 public:
  ObjReader(std::string_view bytes, std::filesystem::path folder, bool looks, const RunContext& run)
      : bytes_(bytes), folder_(std::move(folder)), looks_(looks), run_(run), in_(bytes) {}

  Result<PaintedMesh> read() {
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
      } else if (looks_ && keyword == "vt") {
        MAQUETTE_TRY_VOID(read_place());
      } else if (looks_ && keyword == "mtllib") {
        MAQUETTE_TRY_VOID(read_materials());
      } else if (looks_ && keyword == "usemtl") {
        use_material(rest_of_line(in_));
      } else if (!is_skipped(keyword)) {
        return fail(kMeshFormat,
                    fmt::format("line {}: '{}' is no keyword of an OBJ file (nor is the file a "
                                "PLY or STL)",
                                in_.line(), shown(keyword)));
      }
    } while (in_.next_line());
    // Faces may name vertices that follow later, so this is known only now.
    if (largest_ > static_cast<std::int64_t>(whole_.mesh.vertices_mm.size()))
      return fail(kMeshFormat,
                  fmt::format("line {}: face names vertex {}, but there are {}", line_of_largest_,
                              largest_, whole_.mesh.vertices_mm.size()));
    if (looks_) MAQUETTE_TRY_VOID(lay_pictures());
    return std::move(whole_);
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
    if (whole_.mesh.vertices_mm.size() >= kMostVertices)
      return fail(kMeshFormat,
                  fmt::format("line {}: more than {} vertices", in_.line(), kMostVertices));
    whole_.mesh.vertices_mm.push_back({xyz[0], xyz[1], xyz[2]});
    return {};
  }

  Result<void> read_face() {
    const auto known = static_cast<std::int64_t>(whole_.mesh.vertices_mm.size());
    std::array<std::uint32_t, 3> corner{};  // first, previous, current
    std::array<std::int64_t, 3> place{};    // of these in a picture, from 0; -1: not said
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
      const std::size_t here = std::min<std::size_t>(corners, 2);
      corner[here] = static_cast<std::uint32_t>(index);
      if (looks_) place[here] = place_number(token);
      if (++corners >= 3) {
        whole_.mesh.triangles.push_back(corner);
        corner[1] = corner[2];
        if (!looks_) continue;
        if (!paint_) use_material("");
        whole_.paint_of.push_back(*paint_);
        places_.push_back(place);
        place[1] = place[2];
      }
    }
    if (corners < 3)
      return fail(kMeshFormat, fmt::format("line {}: a face needs at least 3 corners, found {}",
                                           in_.line(), corners));
    return {};
  }

  // ---- looks ---------------------------------------------------------------------------

  /// The second number of v/t or v/t/n, counted from 0; -1: there is none.
  [[nodiscard]] std::int64_t place_number(std::string_view token) const {
    const std::size_t slash = token.find('/');
    if (slash == std::string_view::npos) return -1;
    const std::string_view rest = token.substr(slash + 1);
    const auto number = parse_integer(rest.substr(0, rest.find('/')));
    if (!number || *number == 0) return -1;
    return *number < 0 ? static_cast<std::int64_t>(place_.size()) + *number : *number - 1;
  }

  /// u to the right, v upward from the lower left corner.
  Result<void> read_place() {
    const std::string_view first = next(), second = next();
    const auto u = parse_double(first), v = second.empty() ? 0.0 : parse_double(second);
    if (!u || !v || !std::isfinite(*u) || !std::isfinite(*v))
      return fail(kMeshFormat, fmt::format("line {}: finite texture coordinates expected, found "
                                           "'{}'",
                                           in_.line(), shown(u ? second : first)));
    place_.push_back({static_cast<float>(*u), static_cast<float>(1.0 - *v)});
    return {};
  }

  Result<void> read_materials() {
    const std::string name = rest_of_line(in_);
    const std::filesystem::path path = folder_ / name;
    std::error_code ignored;
    if (!std::filesystem::exists(path, ignored)) return {};
    auto text = read_file(path);
    if (!text) return tl::unexpected(std::move(text).error());
    whole_.files.push_back(path);
    auto fine = read_mtl(*text, path);
    if (!fine) return tl::unexpected(std::move(fine).error().within(path.string()));
    return {};
  }

  Result<void> read_mtl(std::string_view text, const std::filesystem::path& path) {
    Tokens in(text);
    do {
      const std::string_view keyword = in.next_in_line();
      if (keyword == "newmtl") {
        Paint paint;
        paint.name = rest_of_line(in);
        whole_.paints.push_back(std::move(paint));
        continue;
      }
      if (whole_.paints.empty()) continue;
      Paint& paint = whole_.paints.back();
      const auto share = [&](double& to) -> Result<void> {
        const std::string_view token = in.next_in_line();
        const auto x = parse_double(token);
        if (!x || !(*x >= 0.0 && *x <= 1.0))
          return fail(kMeshFormat, fmt::format("line {}: {} with numbers from 0 to 1 expected, "
                                               "found '{}'",
                                               in.line(), keyword, shown(token)));
        to = *x;
        return {};
      };
      if (keyword == "Kd") {
        for (double& band : paint.colour) MAQUETTE_TRY_VOID(share(band));
      } else if (keyword == "Pm") {
        MAQUETTE_TRY_VOID(share(paint.metallic));
      } else if (keyword == "Pr") {
        MAQUETTE_TRY_VOID(share(paint.roughness));
      } else if (keyword == "map_Kd") {
        MAQUETTE_TRY_VOID(read_picture(in, path.parent_path(), paint));
      }
    } while (in.next_line());
    return {};
  }

  /// The name follows its options (-s, -o, -clamp, ...), of which that of the edge is kept.
  Result<void> read_picture(Tokens& in, const std::filesystem::path& folder, Paint& paint) {
    std::string_view token = in.next_in_line();
    while (token.starts_with('-')) {
      const std::string_view option = token;
      token = in.next_in_line();
      if (option == "-clamp") {
        if (token == "on") paint.beyond = {Beyond::edge, Beyond::edge};
        token = in.next_in_line();
      } else if (option == "-o" || option == "-s" || option == "-t") {
        return fail(kMeshFormat, fmt::format("line {}: map_Kd {}: pictures that are shifted or "
                                             "scaled are not read; put it into the coordinates",
                                             in.line(), option));
      } else {
        // One value each, -mm two.
        if (option == "-mm") token = in.next_in_line();
        token = in.next_in_line();
      }
    }
    std::string name = rest_of_line(in, token);
    if (name.empty())
      return fail(kMeshFormat, fmt::format("line {}: map_Kd without a file's name", in.line()));
    std::replace(name.begin(), name.end(), '\\', '/');
    paint.picture_file = folder / name;
    whole_.files.push_back(paint.picture_file);
    return {};
  }

  void use_material(const std::string& name) {
    auto at = std::find_if(whole_.paints.begin(), whole_.paints.end(),
                           [&](const Paint& p) { return p.name == name; });
    if (at == whole_.paints.end()) {
      Paint paint;
      paint.name = name;
      paint.described = false;
      at = whole_.paints.insert(at, std::move(paint));
    }
    paint_ = static_cast<std::uint32_t>(at - whole_.paints.begin());
  }

  /// Coordinates may follow the faces that name them.
  Result<void> lay_pictures() {
    const auto size = static_cast<std::int64_t>(place_.size());
    for (std::size_t i = 0; i < places_.size(); ++i) {
      std::array<std::array<float, 2>, 3> at{};
      const Paint& paint = whole_.paints[whole_.paint_of[i]];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::int64_t n = places_[i][k];
        const bool known = n >= 0 && n < size;
        if (!known && (paint.has_picture() || n >= size))
          return fail(kNoPaint, fmt::format("triangle {} of material '{}': each corner needs one "
                                            "of the {} texture coordinates (v/t)",
                                            i + 1, shown(paint.name), size));
        at[k] = known ? place_[static_cast<std::size_t>(n)] : std::array<float, 2>{NAN, NAN};
      }
      whole_.at_corner.push_back(at);
    }
    return {};
  }

  std::string_view bytes_;
  std::filesystem::path folder_;
  bool looks_;
  const RunContext& run_;
  Tokens in_;
  std::vector<std::array<float, 2>> place_;
  std::vector<std::array<std::int64_t, 3>> places_;  ///< by triangle
  std::optional<std::uint32_t> paint_;               ///< of the faces that follow
  PaintedMesh whole_;
  std::int64_t largest_ = 0;  ///< vertex number in a face, and where it stands
  std::uint64_t line_of_largest_ = 0;
};

}  // namespace

Result<PaintedMesh> read_obj(std::string_view bytes, const std::filesystem::path& folder,
                             bool looks, const RunContext& run) {
  return ObjReader(bytes, folder, looks, run).read();
}

}  // namespace maquette::meshing::detail
