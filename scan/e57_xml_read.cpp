// SPDX-License-Identifier: GPL-3.0-or-later

// Reads the tree of an E57 file: data3D (stations) and images2D (listed only).

#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <pugixml.hpp>

#include "scan/detail/bit_pack.hpp"
#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/e57_xml.hpp"

namespace maquette::scan::detail {

unsigned E57Field::bits() const {
  switch (kind) {
    case Kind::real32:
      return 32;
    case Kind::real64:
      return 64;
    case Kind::text:
      return 8;
    default:
      return bits_for(minimum, maximum);
  }
}

namespace {

constexpr int kDeepest = 8;  // structures in structures of a point's record

class Parser {
 public:
  explicit Parser(const std::string& file) : file_(file) {}

  Result<E57Contents> parse(pugi::xml_node root) {
    if (std::string_view(root.name()) != "e57Root")
      return bad("e57Root", "is not the root of the XML section");
    E57Contents contents;
    std::size_t k = 0;
    for (const pugi::xml_node node : root.child("data3D").children()) {
      if (node.type() != pugi::node_element) continue;
      const std::string where = fmt::format("data3D/{}", k++);
      MAQUETTE_TRY(E57Station station, parse_station(node, where));
      contents.stations.push_back(std::move(station));
    }
    for (const pugi::xml_node node : root.child("images2D").children())
      if (node.type() == pugi::node_element) contents.images.push_back(image(node));
    return contents;
  }

 private:
  tl::unexpected<Error> bad(std::string_view where, std::string_view what) const {
    return fail(kCloudFormat, fmt::format("{}: XML element {} {}", file_, where, what));
  }

  static std::string text(pugi::xml_node parent, const char* name) {
    return parent.child(name).child_value();
  }

  /// Value of an Integer, ScaledInteger or Float element; an empty one is zero.
  Result<double> number(pugi::xml_node node, const std::string& where) const {
    std::string_view rest = node.child_value();
    const std::string_view token = next_token(rest, " \t\r\n");
    double value = 0.0;
    if (!token.empty()) {
      const auto parsed = parse_number<double>(token);
      if (!parsed || !std::isfinite(*parsed))
        return bad(where, fmt::format("is '{}'; a number was expected", shown(token)));
      value = *parsed;
    }
    if (std::string_view(node.attribute("type").value()) != "ScaledInteger") return value;
    MAQUETTE_TRY(const double scale, attribute<double>(node, "scale", 1.0, where));
    MAQUETTE_TRY(const double offset, attribute<double>(node, "offset", 0.0, where));
    return value * scale + offset;
  }

  Result<double> child_number(pugi::xml_node parent, const char* name, const std::string& where,
                              double missing) const {
    const pugi::xml_node node = parent.child(name);
    if (!node) return missing;
    return number(node, where + "/" + name);
  }

  template <class T>
  Result<T> attribute(pugi::xml_node node, const char* name, T missing,
                      const std::string& where) const {
    const pugi::xml_attribute a = node.attribute(name);
    if (!a) return missing;
    std::string_view rest = a.value();
    const auto value = parse_number<T>(next_token(rest));
    if (!value) return bad(where, fmt::format("has {} '{}'", name, shown(a.value())));
    return *value;
  }

  Result<E57Station> parse_station(pugi::xml_node node, const std::string& where) const {
    E57Station s;
    ScanStation& station = s.station;
    station.name = text(node, "name");
    station.guid = text(node, "guid");
    station.description = text(node, "description");
    station.sensor_vendor = text(node, "sensorVendor");
    station.sensor_model = text(node, "sensorModel");
    station.sensor_serial = text(node, "sensorSerialNumber");
    MAQUETTE_TRY(station.start_gps_s, child_number(node.child("acquisitionStart"), "dateTimeValue",
                                                   where + "/acquisitionStart", 0.0));
    if (const pugi::xml_node pose = node.child("pose"))
      MAQUETTE_TRY_VOID(parse_pose(pose, where + "/pose", station));

    const pugi::xml_node points = node.child("points");
    const std::string at = where + "/points";
    if (std::string_view(points.attribute("type").value()) != "CompressedVector")
      return bad(at, "is missing or is no CompressedVector");
    MAQUETTE_TRY(s.section_physical, attribute<std::uint64_t>(points, "fileOffset", 0, at));
    MAQUETTE_TRY(station.points, attribute<std::uint64_t>(points, "recordCount", 0, at));
    MAQUETTE_TRY_VOID(
        parse_prototype(points.child("prototype"), at + "/prototype", "", 0, s.fields));
    for (const pugi::xml_node codec : points.child("codecs").children())
      if (codec.type() == pugi::node_element && !codec.child("bitPackCodec"))
        return bad(at + "/codecs", "asks for a codec other than bitPackCodec, which is not known");

    const pugi::xml_node index = node.child("indexBounds");
    MAQUETTE_TRY_VOID(grid_bounds(index, "row", where, station.rows, s.row_minimum));
    MAQUETTE_TRY_VOID(grid_bounds(index, "column", where, station.columns, s.column_minimum));
    if (station.rows == 0 || station.columns == 0) {
      station.rows = station.columns = 0;
      s.row_minimum = s.column_minimum = 0;
    }
    if (const pugi::xml_node limits = node.child("intensityLimits")) {
      s.states_intensity_limits = true;
      MAQUETTE_TRY(station.intensity_limits[0],
                   child_number(limits, "intensityMinimum", where + "/intensityLimits", 0.0));
      MAQUETTE_TRY(station.intensity_limits[1],
                   child_number(limits, "intensityMaximum", where + "/intensityLimits", 1.0));
    }
    if (const pugi::xml_node limits = node.child("colorLimits")) {
      s.colour.emplace();
      MAQUETTE_TRY(s.colour->minimum,
                   child_number(limits, "colorRedMinimum", where + "/colorLimits", 0.0));
      MAQUETTE_TRY(s.colour->maximum,
                   child_number(limits, "colorRedMaximum", where + "/colorLimits", 255.0));
    }
    return s;
  }

  Result<void> parse_pose(pugi::xml_node pose, const std::string& where,
                          ScanStation& station) const {
    const auto vector = [&](const char* part, std::array<const char*, 4> names,
                            std::array<double, 4>& v) -> Result<void> {
      const pugi::xml_node node = pose.child(part);
      for (std::size_t i = 0; i < 4 && node; ++i) {
        if (names[i] == nullptr) continue;
        MAQUETTE_TRY(v[i], child_number(node, names[i], where + "/" + part, v[i]));
      }
      return {};
    };
    std::array<double, 4> q{1.0, 0.0, 0.0, 0.0}, t{};
    MAQUETTE_TRY_VOID(vector("rotation", {"w", "x", "y", "z"}, q));
    MAQUETTE_TRY_VOID(vector("translation", {"x", "y", "z", nullptr}, t));
    const double length = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
    if (!(std::abs(length - 1.0) < 1e-3))
      return bad(where + "/rotation",
                 fmt::format("has length {}; a unit quaternion was expected", length));
    // Already unit quaternions stay what they are to the bit.
    const Quaternion raw{q[0], q[1], q[2], q[3]};
    station.model_from_station.rotation = std::abs(length - 1.0) < 1e-15 ? raw : normalized(raw);
    const Vec3 position_mm = 1000.0 * Vec3{t[0], t[1], t[2]};
    if (!(norm(position_mm) <= kLargestCoordinateMm))
      return bad(where + "/translation", fmt::format("is {} mm away; at most {} is possible",
                                                     norm(position_mm), kLargestCoordinateMm));
    station.model_from_station.translation_mm = position_mm;
    station.position_mm = position_mm;
    return {};
  }

  Result<void> grid_bounds(pugi::xml_node index, const std::string& what, const std::string& where,
                           std::uint32_t& count, std::int64_t& minimum) const {
    if (!index.child((what + "Maximum").c_str())) return {};
    const std::string at = where + "/indexBounds";
    MAQUETTE_TRY(const double low, child_number(index, (what + "Minimum").c_str(), at, 0.0));
    MAQUETTE_TRY(const double high, child_number(index, (what + "Maximum").c_str(), at, 0.0));
    if (!(low >= 0.0 && low <= high && high < 2147483648.0))
      return bad(at, fmt::format("has {}s from {} to {}", what, low, high));
    minimum = static_cast<std::int64_t>(low);
    count = static_cast<std::uint32_t>(high - low) + 1;
    return {};
  }

  Result<void> parse_prototype(pugi::xml_node node, const std::string& where,
                               const std::string& prefix, int depth,
                               std::vector<E57Field>& fields) const {
    if (depth > kDeepest) return bad(where, "is nested too deeply");
    for (const pugi::xml_node child : node.children()) {
      if (child.type() != pugi::node_element) continue;
      E57Field f;
      f.name = prefix + child.name();
      const std::string at = where + "/" + child.name();
      const std::string_view type = child.attribute("type").value();
      if (type == "Structure" || type == "Vector") {
        MAQUETTE_TRY_VOID(parse_prototype(child, at, f.name + "/", depth + 1, fields));
        continue;
      }
      if (type == "Integer" || type == "ScaledInteger") {
        f.kind = type == "Integer" ? E57Field::Kind::integer : E57Field::Kind::scaled;
        MAQUETTE_TRY(f.minimum, attribute<std::int64_t>(child, "minimum", INT64_MIN, at));
        MAQUETTE_TRY(f.maximum, attribute<std::int64_t>(child, "maximum", INT64_MAX, at));
        if (f.minimum > f.maximum)
          return bad(at, fmt::format("has minimum {} above maximum {}", f.minimum, f.maximum));
      }
      if (type == "ScaledInteger") {
        MAQUETTE_TRY(f.scale, attribute<double>(child, "scale", 1.0, at));
        MAQUETTE_TRY(f.offset, attribute<double>(child, "offset", 0.0, at));
        if (!std::isfinite(f.scale) || !std::isfinite(f.offset))
          return bad(at, "has a scale or offset that is not finite");
      } else if (type == "Float") {
        const std::string_view precision = child.attribute("precision").value();
        f.kind = precision == "single" ? E57Field::Kind::real32 : E57Field::Kind::real64;
      } else if (type == "String") {
        f.kind = E57Field::Kind::text;
      } else if (type != "Integer") {
        return bad(at, fmt::format("has type '{}', which points cannot have", shown(type)));
      }
      fields.push_back(std::move(f));
    }
    return {};
  }

  static CloudImage image(pugi::xml_node node) {
    CloudImage image;
    image.name = text(node, "name");
    image.station_guid = text(node, "associatedData3DGuid");
    for (const char* kind : {"pinhole", "spherical", "cylindrical", "visualReference"}) {
      const pugi::xml_node view = node.child((std::string(kind) + "Representation").c_str());
      if (!view) continue;
      image.kind = kind;
      for (const char* blob : {"jpegImage", "pngImage"})
        image.bytes += view.child(blob).attribute("length").as_ullong();
    }
    return image;
  }

  const std::string& file_;
};

}  // namespace

Result<E57Contents> parse_e57_xml(std::string_view xml, const std::string& file) {
  pugi::xml_document document;
  const pugi::xml_parse_result parsed =
      document.load_buffer(xml.data(), xml.size(), pugi::parse_default, pugi::encoding_utf8);
  if (!parsed)
    return fail(kCloudFormat, fmt::format("{}: byte {} of the XML section: {}", file, parsed.offset,
                                          parsed.description()));
  return Parser(file).parse(document.document_element());
}

}  // namespace maquette::scan::detail
