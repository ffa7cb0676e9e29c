// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "meshing/detail/mesh_readers.hpp"
#include "meshing/mesh_io.hpp"

namespace maquette::meshing::detail {
namespace {

// ---- header ----------------------------------------------------------------------------

enum class Scalar { none, i8, u8, i16, u16, i32, u32, f32, f64 };

Scalar scalar_by_name(std::string_view name) {
  constexpr std::array<std::array<std::string_view, 2>, 8> names{{{"char", "int8"},
                                                                  {"uchar", "uint8"},
                                                                  {"short", "int16"},
                                                                  {"ushort", "uint16"},
                                                                  {"int", "int32"},
                                                                  {"uint", "uint32"},
                                                                  {"float", "float32"},
                                                                  {"double", "float64"}}};
  for (std::size_t i = 0; i < names.size(); ++i)
    if (name == names[i][0] || name == names[i][1]) return static_cast<Scalar>(i + 1);
  return Scalar::none;
}

std::size_t bytes_of(Scalar s) {
  constexpr std::array<std::size_t, 9> bytes{0, 1, 1, 2, 2, 4, 4, 4, 8};
  return bytes[static_cast<std::size_t>(s)];
}

bool is_integer(Scalar s) {
  return s != Scalar::none && s < Scalar::f32;
}

/// What a property's values are for.
enum class Use { skipped, x, y, z, corners };

struct Property {
  Scalar count = Scalar::none;  ///< none: a scalar property
  Scalar type = Scalar::none;
  Use use = Use::skipped;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

enum class Encoding { none, ascii, little_endian, big_endian };

struct Header {
  Encoding encoding = Encoding::none;
  std::vector<Element> elements;
  std::size_t bytes = 0;  ///< with the end of its last line
  std::uint64_t lines = 0;
};

Use use_of(const Element& element, std::string_view name, bool is_list) {
  if (element.name == "vertex" && !is_list && name.size() == 1 && name[0] >= 'x' && name[0] <= 'z')
    return static_cast<Use>(1 + (name[0] - 'x'));
  if (element.name == "face" && is_list && (name == "vertex_indices" || name == "vertex_index"))
    return Use::corners;
  return Use::skipped;
}

Result<Header> read_header(std::string_view bytes) {
  Header header;
  Tokens in(bytes);
  const auto bad = [&](std::string_view expected, std::string_view found) {
    return fail(kMeshFormat,
                fmt::format("line {}: {} expected, found '{}'", in.line(), expected, shown(found)));
  };
  in.next_line();  // "ply"
  for (;;) {
    const std::string_view keyword = in.next_in_line();
    if (keyword == "end_header") break;
    if (keyword == "format") {
      const std::string_view name = in.next_in_line();
      header.encoding = name == "ascii"                  ? Encoding::ascii
                        : name == "binary_little_endian" ? Encoding::little_endian
                        : name == "binary_big_endian"    ? Encoding::big_endian
                                                         : Encoding::none;
      if (header.encoding == Encoding::none)
        return bad("ascii, binary_little_endian or binary_big_endian", name);
    } else if (keyword == "element") {
      Element element{.name = std::string(in.next_in_line()), .count = 0, .properties = {}};
      const std::string_view token = in.next_in_line();
      const auto count = parse_integer(token);
      if (!count || *count < 0) return bad("number of elements", token);
      for (const Element& other : header.elements)
        if (other.name == element.name) return bad("one element of each name", element.name);
      element.count = static_cast<std::uint64_t>(*count);
      header.elements.push_back(std::move(element));
    } else if (keyword == "property") {
      if (header.elements.empty()) return bad("element before its properties", keyword);
      Property property;
      std::string_view type = in.next_in_line();
      if (type == "list") {
        type = in.next_in_line();
        property.count = scalar_by_name(type);
        if (!is_integer(property.count)) return bad("integer type of the list's length", type);
        type = in.next_in_line();
      }
      property.type = scalar_by_name(type);
      if (property.type == Scalar::none) return bad("type (char .. double)", type);
      Element& element = header.elements.back();
      const std::string_view name = in.next_in_line();
      property.use = use_of(element, name, property.count != Scalar::none);
      if (property.use == Use::corners && !is_integer(property.type))
        return bad("integer type of vertex indices", type);
      for (const Property& other : element.properties)
        if (property.use != Use::skipped && other.use == property.use)
          return bad("one property of each name", name);
      element.properties.push_back(property);
    } else if (keyword != "comment" && keyword != "obj_info" && !keyword.empty()) {
      return bad("format, comment, element, property or end_header", keyword);
    }
    if (!in.next_line()) return bad("end_header", "");
  }
  if (header.encoding == Encoding::none) return bad("a format line before end_header", "");
  in.next_line();
  header.bytes = bytes.size() - in.bytes_left();
  header.lines = in.line();
  return header;
}

/// The least that an element can take: faces of three corners, other lists empty; in
/// ascii two bytes a number, but for the last in the file.
std::uint64_t least_bytes(const Element& element, bool ascii) {
  std::uint64_t sum = 0;
  for (const Property& p : element.properties) {
    sum += ascii ? 2 : bytes_of(p.count == Scalar::none ? p.type : p.count);
    if (p.use == Use::corners) sum += 3 * (ascii ? 2 : bytes_of(p.type));
  }
  return sum;
}

/// Counts are believed only as far as the file is long enough for them, so that memory
/// is bounded by the file's size.
Result<void> check_counts(const Header& header, std::size_t body_bytes) {
  const bool ascii = header.encoding == Encoding::ascii;
  for (const Element& e : header.elements) {
    const std::uint64_t least = least_bytes(e, ascii);
    if (e.count > 0 && (least == 0 || e.count > (body_bytes + 1) / least))
      return fail(kMeshFormat,
                  fmt::format("line {}: {} elements '{}' need more than the {} bytes that follow",
                              header.lines, e.count, shown(e.name), body_bytes));
    const auto has = [&](Use use) {
      return std::any_of(e.properties.begin(), e.properties.end(),
                         [&](const Property& p) { return p.use == use; });
    };
    if (e.name == "vertex" && !(has(Use::x) && has(Use::y) && has(Use::z)))
      return fail(kMeshFormat, "the vertices have no properties x, y, z");
    if (e.name == "vertex" && e.count > kMostVertices)
      return fail(kMeshFormat, fmt::format("more than {} vertices", kMostVertices));
    if (e.name == "face" && !has(Use::corners))
      return fail(kMeshFormat, "the faces have no list vertex_indices");
  }
  return {};
}

// ---- values ------------------------------------------------------------------------------

/// A number of any type: integers exactly, also as double.
struct Value {
  double real = 0.0;
  std::int64_t whole = 0;
};

class BinarySource {
 public:
  BinarySource(std::string_view bytes, std::size_t at, bool swap)
      : bytes_(bytes), at_(at), swap_(swap) {}

  [[nodiscard]] std::optional<Value> read(Scalar type) {
    switch (type) {
      case Scalar::i8:
        return whole<std::int8_t>();
      case Scalar::u8:
        return whole<std::uint8_t>();
      case Scalar::i16:
        return whole<std::int16_t>();
      case Scalar::u16:
        return whole<std::uint16_t>();
      case Scalar::i32:
        return whole<std::int32_t>();
      case Scalar::u32:
        return whole<std::uint32_t>();
      case Scalar::f32:
        return real<float>();
      case Scalar::f64:
        return real<double>();
      case Scalar::none:
        break;
    }
    return std::nullopt;
  }
  [[nodiscard]] bool skip(std::uint64_t count, Scalar type) {
    if (count > left() / bytes_of(type)) return false;
    at_ += count * bytes_of(type);
    return true;
  }
  static constexpr std::string_view kPlaceUnit = "byte";
  [[nodiscard]] std::uint64_t place() const { return at_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }

 private:
  template <class T>
  std::optional<T> take() {
    if (left() < sizeof(T)) return std::nullopt;
    std::array<char, sizeof(T)> raw{};
    std::memcpy(raw.data(), bytes_.data() + at_, sizeof(T));
    if (swap_) std::reverse(raw.begin(), raw.end());
    at_ += sizeof(T);
    return std::bit_cast<T>(raw);
  }
  template <class T>
  std::optional<Value> whole() {
    const auto x = take<T>();
    if (!x) return std::nullopt;
    return Value{static_cast<double>(*x), static_cast<std::int64_t>(*x)};
  }
  template <class T>
  std::optional<Value> real() {
    const auto x = take<T>();
    if (!x) return std::nullopt;
    return Value{static_cast<double>(*x), 0};
  }

  std::string_view bytes_;
  std::size_t at_;
  bool swap_;
};

class AsciiSource {
 public:
  AsciiSource(std::string_view body, std::uint64_t line) : in_(body, line) {}

  [[nodiscard]] std::optional<Value> read(Scalar type) {
    const std::string_view token = in_.next();
    if (is_integer(type)) {
      const auto x = parse_integer(token);
      if (!x) return std::nullopt;
      return Value{static_cast<double>(*x), *x};
    }
    const auto x = parse_double(token);
    if (!x) return std::nullopt;
    return Value{*x, 0};
  }
  [[nodiscard]] bool skip(std::uint64_t count, Scalar) {
    for (std::uint64_t i = 0; i < count; ++i)
      if (in_.next().empty()) return false;
    return true;
  }
  static constexpr std::string_view kPlaceUnit = "line";
  [[nodiscard]] std::uint64_t place() const { return in_.line(); }
  [[nodiscard]] std::size_t left() const { return in_.bytes_left(); }

 private:
  Tokens in_;
};

// ---- body ----------------------------------------------------------------------------------

template <class Source>
class BodyReader {
 public:
  BodyReader(Source source, const RunContext& run) : in_(source), run_(run), all_(in_.left()) {}

  Result<TriMesh> read(const Header& header) {
    for (const Element& e : header.elements) {
      if (e.name == "vertex") mesh_.vertices_mm.reserve(e.count);
      if (e.name == "face") mesh_.triangles.reserve(e.count);
      for (std::uint64_t i = 0; i < e.count; ++i) {
        if (i % kItemsPerPoll == 0) {
          if (run_.stopped()) return fail(kCancelled, "stopped while reading");
          run_.progress(1.0 - static_cast<double>(in_.left()) / static_cast<double>(all_));
        }
        MAQUETTE_TRY_VOID(read_element(e, i));
      }
    }
    // Faces may stand before the vertices, so this is known only now.
    if (largest_ >= 0 && static_cast<std::uint64_t>(largest_) >= mesh_.vertices_mm.size())
      return fail(
          kMeshFormat,
          fmt::format("{} {}: face names vertex {}, but there are only {} (counted from 0)",
                      Source::kPlaceUnit, place_of_largest_, largest_, mesh_.vertices_mm.size()));
    if (in_.left() > 0 && !std::is_same_v<Source, AsciiSource>)
      run_.warn(fmt::format("PLY: {} bytes after the end of the data are ignored", in_.left()));
    return std::move(mesh_);
  }

 private:
  tl::unexpected<Error> bad(const Element& e, std::uint64_t i, std::string_view what) const {
    return fail(kMeshFormat, fmt::format("{} {}: {} {} of {}: {}", Source::kPlaceUnit, in_.place(),
                                         shown(e.name), i, e.count, what));
  }

  Result<void> read_element(const Element& e, std::uint64_t i) {
    Vec3 vertex;
    for (const Property& p : e.properties) {
      if (p.count != Scalar::none) {
        MAQUETTE_TRY_VOID(read_list(e, i, p));
        continue;
      }
      const auto value = in_.read(p.type);
      if (!value) return bad(e, i, "number expected; the file is cut off or damaged");
      if (p.use == Use::skipped) continue;
      if (!std::isfinite(value->real)) return bad(e, i, "coordinate is not finite");
      (p.use == Use::x ? vertex.x : p.use == Use::y ? vertex.y : vertex.z) = value->real;
    }
    if (e.name == "vertex") mesh_.vertices_mm.push_back(vertex);
    return {};
  }

  Result<void> read_list(const Element& e, std::uint64_t i, const Property& p) {
    const auto length = in_.read(p.count);
    if (!length || length->whole < 0)
      return bad(e, i, "length of a list expected; the file is cut off or damaged");
    const auto count = static_cast<std::uint64_t>(length->whole);
    if (p.use != Use::corners) {
      if (!in_.skip(count, p.type)) return bad(e, i, "list is longer than the file");
      return {};
    }
    if (count < 3) return bad(e, i, "a face needs at least 3 corners");
    std::array<std::uint32_t, 3> corner{};  // first, previous, current
    for (std::uint64_t k = 0; k < count; ++k) {
      const auto value = in_.read(p.type);
      if (!value) return bad(e, i, "vertex index expected; the file is cut off or damaged");
      if (value->whole < 0 || value->whole >= static_cast<std::int64_t>(kMostVertices))
        return bad(e, i, fmt::format("vertex index {} is out of range", value->whole));
      if (value->whole > largest_) {
        largest_ = value->whole;
        place_of_largest_ = in_.place();
      }
      corner[std::min<std::size_t>(k, 2)] = static_cast<std::uint32_t>(value->whole);
      if (k >= 2) {
        mesh_.triangles.push_back(corner);
        corner[1] = corner[2];
      }
    }
    return {};
  }

  Source in_;
  const RunContext& run_;
  std::size_t all_;
  TriMesh mesh_;
  std::int64_t largest_ = -1;  ///< vertex index in a face, and where it stands
  std::uint64_t place_of_largest_ = 0;
};

}  // namespace

Result<TriMesh> read_ply(std::string_view bytes, const RunContext& run) {
  MAQUETTE_TRY(const Header header, read_header(bytes));
  MAQUETTE_TRY_VOID(check_counts(header, bytes.size() - header.bytes));
  if (header.encoding == Encoding::ascii)
    return BodyReader(AsciiSource(bytes.substr(header.bytes), header.lines), run).read(header);
  const bool swap =
      (header.encoding == Encoding::little_endian) != (std::endian::native == std::endian::little);
  return BodyReader(BinarySource(bytes, header.bytes, swap), run).read(header);
}

}  // namespace maquette::meshing::detail
