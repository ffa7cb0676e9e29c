// SPDX-License-Identifier: GPL-3.0-or-later

// Reader of PLY clouds. The file is hostile until shown otherwise: every count is
// compared with the bytes that are there before anything is believed.

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

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
};

constexpr std::uint64_t kLongestHeader = std::uint64_t{1} << 20;

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

Result<Header> parse_header(ByteSource& source) {
  const std::string& file = source.name();
  Header h;
  if (source.line() != "ply")
    return fail(kCloudFormat, fmt::format("{}: line 1: expected 'ply'", file));
  bool has_format = false;
  while (true) {
    auto next = source.line();
    if (!next || source.position() > kLongestHeader)
      return fail(kCloudFormat, fmt::format("{}: byte {}: the header has no end_header", file,
                                            source.position()));
    std::string_view line = *next;
    const std::string where = fmt::format("{}: line {}", file, source.line_number());
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
  return h;
}

class PlyReader final : public BasicReader {
 public:
  using BasicReader::BasicReader;

  Result<void> open() {
    MAQUETTE_TRY(header_, parse_header(source_));
    ScanStation& station = stations_.emplace_back();
    station.position_mm = header_.station;
    plan_.unit_mm = unit_mm_;
    for (; element_ < header_.elements.size(); ++element_) {
      const Element& e = header_.elements[element_];
      if (e.name == "vertex") {
        MAQUETTE_TRY_VOID(take_layout(e, station));
        return check_count(e);
      }
      if (e.properties.empty()) {
        if (is_ascii() && e.count > 0)
          return fail(kCloudFormat,
                      fmt::format("{}: element '{}' has no properties", file(), shown(e.name)));
        continue;  // its rows take no bytes
      }
      MAQUETTE_TRY_VOID(check_count(e));
      Row ignored;
      for (std::uint64_t i = 0; i < e.count; ++i) MAQUETTE_TRY_VOID(row(e, i, ignored));
    }
    return fail(kCloudFormat, fmt::format("{}: the file has no element vertex", file()));
  }

  [[nodiscard]] std::string_view format() const override { return "PLY"; }

  Result<bool> next(PointBatch& batch) override {
    const Element& vertex = header_.elements[element_];
    const bool begins = !begun_;
    begun_ = true;
    start(batch, 0, begins);
    if (points_read_ == vertex.count) return begins;  // what follows is not ours
    Row values{};
    while (batch.size() < batch_points_ && points_read_ < vertex.count) {
      MAQUETTE_TRY_VOID(row(vertex, points_read_, values));
      MAQUETTE_TRY_VOID(append(plan_, values, points_read_, file(), batch));
      ++points_read_;
    }
    return true;
  }

 private:
  [[nodiscard]] bool is_ascii() const { return header_.encoding == Encoding::ascii; }

  Result<void> take_layout(const Element& vertex, ScanStation& station) {
    for (const Property& p : vertex.properties) {
      if (p.channel != kIgnored && !plan_.declare(p.channel))
        return fail(kCloudFormat, fmt::format("{}: a coordinate, intensity, colour or normal is "
                                              "declared twice",
                                              file()));
      if (p.channel == kRed) {
        const bool real = p.type == Scalar::float32 || p.type == Scalar::float64;
        station.colour_bits = bytes_of(p.type) == 1 ? 8 : 16;
        plan_.colour_scale = real ? 65535.0 : bytes_of(p.type) == 1 ? 257.0 : 1.0;
      }
    }
    if (!plan_.has_position())
      return fail(kCloudFormat,
                  fmt::format("{}: element vertex needs the properties x, y and z", file()));
    station.fields = plan_.fields();
    station.points = vertex.count;
    return {};
  }

  /// Does the file have room for what the header promises?
  Result<void> check_count(const Element& e) const {
    // In ascii a value takes a digit and a separator, the last one perhaps only the digit.
    const std::size_t least = is_ascii() ? 2 * e.properties.size() : e.least_bytes();
    const std::uint64_t room = (source_.remaining() + (is_ascii() ? 1 : 0)) / least;
    if (e.count > room)
      return fail(kCloudFormat,
                  fmt::format("{}: the header promises {} x {}, but from byte {} on the file has "
                              "room for at most {}; it is truncated or its header is wrong",
                              file(), e.count, shown(e.name), source_.position(), room));
    return {};
  }

  Result<void> row(const Element& e, std::uint64_t index, Row& values) {
    return is_ascii() ? ascii_row(e, index, values) : binary_row(e, index, values);
  }

  Result<void> binary_row(const Element& e, std::uint64_t index, Row& values) {
    const bool swap = header_.encoding == Encoding::big;
    const auto truncated = [&] {
      return source_.ended(fmt::format("inside {} {} of {}", shown(e.name), index, e.count));
    };
    for (const Property& p : e.properties) {
      const std::size_t width = bytes_of(p.is_list ? p.count_type : p.type);
      const std::string_view bytes = source_.peek(width);
      if (bytes.size() < width) return truncated();
      const double value = load_scalar(p.is_list ? p.count_type : p.type, bytes.data(), swap);
      source_.skip(width);
      if (!p.is_list) {
        values[p.channel] = value;
        continue;
      }
      if (value < 0.0)
        return fail(kCloudFormat, fmt::format("{}: byte {}: list of length {}", file(),
                                              source_.position() - width, value));
      const std::uint64_t items = static_cast<std::uint64_t>(value) * bytes_of(p.type);
      if (items > source_.remaining()) return truncated();
      source_.seek(source_.position() + items);
    }
    return {};
  }

  Result<void> ascii_row(const Element& e, std::uint64_t index, Row& values) {
    auto next = source_.line();
    const std::uint64_t line = source_.line_number();
    if (!next)
      return fail(kCloudFormat, fmt::format("{}: line {}: the file ends before {} {} of {}", file(),
                                            line + 1, shown(e.name), index, e.count));
    std::string_view text = *next;
    for (const Property& p : e.properties) {
      std::uint64_t items = 1;
      if (p.is_list) {
        const std::string_view token = next_token(text);
        const auto length = parse_number<std::uint32_t>(token);
        if (!length)
          return fail(kCloudFormat, fmt::format("{}: line {}: '{}' is no list length", file(), line,
                                                shown(token)));
        items = *length;
      }
      for (std::uint64_t i = 0; i < items; ++i) {
        const std::string_view token = next_token(text);
        const auto value = parse_number<double>(token);
        if (!value)
          return fail(kCloudFormat,
                      fmt::format("{}: line {}: expected {} values of a {}, got '{}'", file(), line,
                                  e.properties.size(), shown(e.name), shown(token)));
        values[p.channel] = *value;
      }
    }
    if (const std::string_view more = next_token(text); !more.empty())
      return fail(kCloudFormat, fmt::format("{}: line {}: '{}' after the last property of {} {}",
                                            file(), line, shown(more), shown(e.name), index));
    return {};
  }

  Header header_;
  std::size_t element_ = 0;  // vertex, once open
  RecordPlan plan_;
  bool begun_ = false;
};

}  // namespace

ReaderResult open_ply(ByteSource source, const CloudReadOptions& options) {
  auto reader = std::make_unique<PlyReader>(std::move(source), options, 1.0);
  MAQUETTE_TRY_VOID(reader->open());
  return reader;
}

}  // namespace maquette::scan::detail
