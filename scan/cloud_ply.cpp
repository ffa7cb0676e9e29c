// SPDX-License-Identifier: GPL-3.0-or-later

// Reader of PLY clouds. The file is hostile until shown otherwise: every count is
// compared with the bytes that are there before anything is allocated.

#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"

namespace maquette::scan::detail {
namespace {

enum class Scalar { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

struct ScalarName {
  std::string_view name;
  Scalar type;
};
constexpr std::array kScalarNames{
    ScalarName{"char", Scalar::int8},      ScalarName{"int8", Scalar::int8},
    ScalarName{"uchar", Scalar::uint8},    ScalarName{"uint8", Scalar::uint8},
    ScalarName{"short", Scalar::int16},    ScalarName{"int16", Scalar::int16},
    ScalarName{"ushort", Scalar::uint16},  ScalarName{"uint16", Scalar::uint16},
    ScalarName{"int", Scalar::int32},      ScalarName{"int32", Scalar::int32},
    ScalarName{"uint", Scalar::uint32},    ScalarName{"uint32", Scalar::uint32},
    ScalarName{"float", Scalar::float32},  ScalarName{"float32", Scalar::float32},
    ScalarName{"double", Scalar::float64}, ScalarName{"float64", Scalar::float64},
};

std::optional<Scalar> scalar_by_name(std::string_view name) {
  for (const auto& known : kScalarNames)
    if (known.name == name) return known.type;
  return std::nullopt;
}

std::size_t bytes_of(Scalar type) {
  switch (type) {
    case Scalar::int8:
    case Scalar::uint8:
      return 1;
    case Scalar::int16:
    case Scalar::uint16:
      return 2;
    case Scalar::float64:
      return 8;
    default:
      return 4;
  }
}

struct Property {
  Scalar type = Scalar::float32;
  bool is_list = false;
  Scalar count_type = Scalar::uint8;  // of a list
  std::size_t channel = kIgnored;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
  /// The least that one row takes: a list may be empty.
  [[nodiscard]] std::size_t least_bytes() const {
    std::size_t bytes = 0;
    for (const Property& p : properties) bytes += bytes_of(p.is_list ? p.count_type : p.type);
    return bytes;
  }
};

enum class Encoding { ascii, little, big };

struct Header {
  Encoding encoding = Encoding::ascii;
  std::vector<Element> elements;
  std::optional<Vec3> station;
  std::size_t end = 0;         // byte behind end_header
  std::uint64_t end_line = 0;  // lines up to and with end_header
};

constexpr std::size_t kLongestHeader = std::size_t{1} << 20;

Result<Property> parse_property(std::string_view line, bool in_vertex, const std::string& where) {
  Property p;
  std::string_view type = next_token(line);
  if (type == "list") {
    p.is_list = true;
    const std::string_view count = next_token(line);
    const auto count_type = scalar_by_name(count);
    if (!count_type || *count_type == Scalar::float32 || *count_type == Scalar::float64)
      return fail(kCloudFormat, fmt::format("{}: '{}' is no integer type for a list's length",
                                            where, shown(count)));
    p.count_type = *count_type;
    type = next_token(line);
  }
  const auto known = scalar_by_name(type);
  if (!known)
    return fail(kCloudFormat,
                fmt::format("{}: unknown property type '{}'; expected char, uchar, short, ushort, "
                            "int, uint, float or double",
                            where, shown(type)));
  p.type = *known;
  const std::string_view name = next_token(line);
  if (name.empty()) return fail(kCloudFormat, fmt::format("{}: property without a name", where));
  if (in_vertex && !p.is_list) p.channel = channel_by_name(name);
  return p;
}

Result<Header> parse_header(std::string_view data, const std::string& file) {
  Header h;
  std::size_t at = 0;
  std::uint64_t line_number = 1;
  if (next_line(data, at) != "ply")
    return fail(kCloudFormat, fmt::format("{}: line 1: expected 'ply'", file));
  bool has_format = false;
  while (true) {
    if (at >= data.size() || at > kLongestHeader)
      return fail(kCloudFormat, fmt::format("{}: byte {}: the header has no end_header", file, at));
    std::string_view line = next_line(data, at);
    const std::string where = fmt::format("{}: line {}", file, ++line_number);
    const std::string_view word = next_token(line);
    if (word == "end_header") break;
    if (word == "comment") {
      MAQUETTE_TRY(const auto station, station_comment(line, where));
      if (station) h.station = station;
    } else if (word == "format") {
      const std::string_view kind = next_token(line);
      if (kind == "ascii")
        h.encoding = Encoding::ascii;
      else if (kind == "binary_little_endian")
        h.encoding = Encoding::little;
      else if (kind == "binary_big_endian")
        h.encoding = Encoding::big;
      else
        return fail(kCloudFormat,
                    fmt::format("{}: unknown format '{}'; expected ascii, binary_little_endian or "
                                "binary_big_endian",
                                where, shown(kind)));
      has_format = true;
    } else if (word == "element") {
      Element e;
      e.name = next_token(line);
      const std::string_view count = next_token(line);
      const auto number = parse_number<std::uint64_t>(count);
      if (e.name.empty() || !number)
        return fail(kCloudFormat, fmt::format("{}: expected 'element NAME COUNT', got count '{}'",
                                              where, shown(count)));
      e.count = *number;
      for (const Element& other : h.elements)
        if (other.name == e.name)
          return fail(kCloudFormat,
                      fmt::format("{}: element '{}' is declared twice", where, shown(e.name)));
      h.elements.push_back(std::move(e));
    } else if (word == "property") {
      if (h.elements.empty())
        return fail(kCloudFormat, fmt::format("{}: property before any element", where));
      Element& e = h.elements.back();
      MAQUETTE_TRY(const Property p, parse_property(line, e.name == "vertex", where));
      e.properties.push_back(p);
    } else if (!word.empty() && word != "obj_info") {
      return fail(kCloudFormat,
                  fmt::format("{}: unexpected '{}' in the header", where, shown(word)));
    }
  }
  if (!has_format)
    return fail(kCloudFormat, fmt::format("{}: the header has no format line", file));
  h.end = at;
  h.end_line = line_number;
  return h;
}

template <class T>
double load(const char* bytes, bool swap) {
  std::array<char, sizeof(T)> raw;
  for (std::size_t i = 0; i < sizeof(T); ++i) raw[i] = bytes[swap ? sizeof(T) - 1 - i : i];
  T value;
  std::memcpy(&value, raw.data(), sizeof value);
  return static_cast<double>(value);
}

double load_scalar(Scalar type, const char* bytes, bool swap) {
  switch (type) {
    case Scalar::int8:
      return load<std::int8_t>(bytes, swap);
    case Scalar::uint8:
      return load<std::uint8_t>(bytes, swap);
    case Scalar::int16:
      return load<std::int16_t>(bytes, swap);
    case Scalar::uint16:
      return load<std::uint16_t>(bytes, swap);
    case Scalar::int32:
      return load<std::int32_t>(bytes, swap);
    case Scalar::uint32:
      return load<std::uint32_t>(bytes, swap);
    case Scalar::float32:
      return load<float>(bytes, swap);
    default:
      return load<double>(bytes, swap);
  }
}

using Row = std::array<double, kChannels + 1>;  // the last one takes what is ignored

/// Where reading stands; rows of either encoding move it forward.
struct Body {
  std::string_view data;
  std::size_t at;
  std::uint64_t line;
  bool swap;
  const std::string& file;

  Result<void> binary_row(const Element& e, std::uint64_t index, Row& row) {
    const auto truncated = [&] {
      return fail(kCloudFormat, fmt::format("{}: byte {}: the file ends inside {} {} of {}", file,
                                            data.size(), shown(e.name), index, e.count));
    };
    for (const Property& p : e.properties) {
      const std::size_t width = bytes_of(p.type);
      if (!p.is_list) {
        if (data.size() - at < width) return truncated();
        row[p.channel] = load_scalar(p.type, data.data() + at, swap);
        at += width;
        continue;
      }
      const std::size_t count_width = bytes_of(p.count_type);
      if (data.size() - at < count_width) return truncated();
      const double length = load_scalar(p.count_type, data.data() + at, swap);
      if (length < 0.0)
        return fail(kCloudFormat, fmt::format("{}: byte {}: list of length {}", file, at, length));
      at += count_width;
      const auto items = static_cast<std::size_t>(length);  // at most 2^32 - 1
      if ((data.size() - at) / width < items) return truncated();
      at += items * width;
    }
    return {};
  }

  Result<void> ascii_row(const Element& e, std::uint64_t index, Row& row) {
    if (at >= data.size())
      return fail(kCloudFormat, fmt::format("{}: line {}: the file ends before {} {} of {}", file,
                                            line + 1, shown(e.name), index, e.count));
    std::string_view text = next_line(data, at);
    ++line;
    for (const Property& p : e.properties) {
      std::uint64_t items = 1;
      if (p.is_list) {
        const std::string_view token = next_token(text);
        const auto length = parse_number<std::uint32_t>(token);
        if (!length)
          return fail(kCloudFormat,
                      fmt::format("{}: line {}: '{}' is no list length", file, line, shown(token)));
        items = *length;
      }
      for (std::uint64_t i = 0; i < items; ++i) {
        const std::string_view token = next_token(text);
        const auto value = parse_number<double>(token);
        if (!value)
          return fail(kCloudFormat,
                      fmt::format("{}: line {}: expected {} values of a {}, got '{}'", file, line,
                                  e.properties.size(), shown(e.name), shown(token)));
        row[p.channel] = *value;
      }
    }
    if (const std::string_view more = next_token(text); !more.empty())
      return fail(kCloudFormat, fmt::format("{}: line {}: '{}' after the last property of {} {}",
                                            file, line, shown(more), shown(e.name), index));
    return {};
  }
};

}  // namespace

Result<Cloud> read_ply_cloud(std::string_view data, const std::string& file,
                             const RunContext& run) {
  MAQUETTE_TRY(const Header h, parse_header(data, file));
  CloudBuilder builder(file);
  if (h.station) builder.set_station(*h.station);
  Body body{data, h.end, h.end_line, h.encoding == Encoding::big, file};
  const bool ascii = h.encoding == Encoding::ascii;
  for (const Element& e : h.elements) {
    const bool is_vertex = e.name == "vertex";
    if (is_vertex) {
      for (const Property& p : e.properties)
        if (p.channel != kIgnored && !builder.declare(p.channel))
          return fail(kCloudFormat,
                      fmt::format("{}: a coordinate, intensity or normal is declared twice", file));
      if (!builder.has_position())
        return fail(kCloudFormat,
                    fmt::format("{}: element vertex needs the properties x, y and z", file));
    } else if (e.properties.empty()) {
      if (ascii && e.count > 0)
        return fail(kCloudFormat,
                    fmt::format("{}: element '{}' has no properties", file, shown(e.name)));
      continue;  // its rows take no bytes
    }
    // In ascii a value takes a digit and a separator.
    const std::size_t least = ascii ? 2 * e.properties.size() : e.least_bytes();
    if (e.count > (data.size() - body.at + (ascii ? 1 : 0)) / least)
      return fail(kCloudFormat,
                  fmt::format("{}: the header promises {} x {}, but from byte {} on the file has "
                              "room for at most {}; it is truncated or its header is wrong",
                              file, e.count, shown(e.name), body.at,
                              (data.size() - body.at + (ascii ? 1 : 0)) / least));
    if (is_vertex) builder.reserve(static_cast<std::size_t>(e.count));
    Row row{};
    for (std::uint64_t i = 0; i < e.count; ++i) {
      if (i % 500'000 == 0) {
        if (run.stopped()) return fail(kCancelled, fmt::format("{}: reading was cancelled", file));
        run.progress(static_cast<double>(i) / static_cast<double>(e.count));
      }
      MAQUETTE_TRY_VOID(ascii ? body.ascii_row(e, i, row) : body.binary_row(e, i, row));
      if (!is_vertex) continue;
      MAQUETTE_TRY_VOID(builder.add(row));
    }
    if (is_vertex) return std::move(builder).finish();  // what follows is not ours
  }
  return fail(kCloudFormat, fmt::format("{}: the file has no element vertex", file));
}

}  // namespace maquette::scan::detail
