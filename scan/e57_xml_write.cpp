// SPDX-License-Identifier: GPL-3.0-or-later

// Writes the tree of an E57 file.

#include <iterator>

#include <fmt/format.h>

#include "scan/detail/e57_xml.hpp"

namespace maquette::scan::detail {
namespace {

std::string escaped(std::string_view text) {
  std::string safe;
  for (const char c : text) {
    if (c == '&')
      safe += "&amp;";
    else if (c == '<')
      safe += "&lt;";
    else if (c == '>')
      safe += "&gt;";
    else
      safe += static_cast<unsigned char>(c) < ' ' ? ' ' : c;  // XML has no control characters
  }
  return safe;
}

class Tree {
 public:
  void open(std::string_view name, std::string_view attributes) {
    line(fmt::format("<{} {}>", name, attributes));
    ++depth_;
  }
  void structure(std::string_view name) { open(name, R"(type="Structure")"); }
  void vector(std::string_view name, bool mixed) {
    open(name, fmt::format(R"(type="Vector" allowHeterogeneousChildren="{}")", mixed ? 1 : 0));
  }
  void close(std::string_view name) {
    --depth_;
    line(fmt::format("</{}>", name));
  }
  void text(std::string_view name, std::string_view value) {
    line(fmt::format(R"(<{0} type="String">{1}</{0}>)", name, escaped(value)));
  }
  void text_if_any(std::string_view name, std::string_view value) {
    if (!value.empty()) text(name, value);
  }
  void integer(std::string_view name, std::int64_t value) {
    line(fmt::format(R"(<{0} type="Integer">{1}</{0}>)", name, value));
  }
  void real(std::string_view name, double value) {
    line(fmt::format(R"(<{0} type="Float">{1}</{0}>)", name, value));
  }
  void line(std::string_view text) {
    fmt::format_to(std::back_inserter(xml_), "{:{}}{}\n", "", 2 * depth_, text);
  }
  [[nodiscard]] std::string take() { return std::move(xml_); }

 private:
  std::string xml_ = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  int depth_ = 0;
};

void write_pose(Tree& tree, const RigidTransform& pose) {
  tree.structure("pose");
  // The standard asks for a scalar part that is not negative; q and -q are one rotation.
  const double sign = pose.rotation.w < 0.0 ? -1.0 : 1.0;
  const Quaternion& q = pose.rotation;
  tree.structure("rotation");
  tree.real("w", sign * q.w);
  tree.real("x", sign * q.x);
  tree.real("y", sign * q.y);
  tree.real("z", sign * q.z);
  tree.close("rotation");
  tree.structure("translation");
  tree.real("x", pose.translation_mm.x / 1000.0);
  tree.real("y", pose.translation_mm.y / 1000.0);
  tree.real("z", pose.translation_mm.z / 1000.0);
  tree.close("translation");
  tree.close("pose");
}

void write_prototype(Tree& tree, const std::vector<E57Field>& fields) {
  tree.structure("prototype");
  for (const E57Field& f : fields) {
    if (f.kind == E57Field::Kind::integer)
      tree.line(fmt::format(R"(<{} type="Integer" minimum="{}" maximum="{}"/>)", f.name, f.minimum,
                            f.maximum));
    else if (f.kind == E57Field::Kind::scaled)
      tree.line(fmt::format(
          R"(<{} type="ScaledInteger" minimum="{}" maximum="{}" scale="{}" offset="{}"/>)", f.name,
          f.minimum, f.maximum, f.scale, f.offset));
    else
      tree.line(fmt::format(R"(<{} type="Float" precision="{}"/>)", f.name,
                            f.kind == E57Field::Kind::real32 ? "single" : "double"));
  }
  tree.close("prototype");
}

void write_station(Tree& tree, const E57Written& w) {
  const ScanStation& s = w.station;
  tree.structure("vectorChild");
  tree.text("guid", s.guid);
  tree.text_if_any("name", s.name);
  tree.text_if_any("description", s.description);
  tree.text_if_any("sensorVendor", s.sensor_vendor);
  tree.text_if_any("sensorModel", s.sensor_model);
  tree.text_if_any("sensorSerialNumber", s.sensor_serial);
  if (s.start_gps_s != 0.0) {
    tree.structure("acquisitionStart");
    tree.real("dateTimeValue", s.start_gps_s);
    tree.integer("isAtomicClockReferenced", 0);
    tree.close("acquisitionStart");
  }
  if (s.position_mm || s.model_from_station != RigidTransform{})
    write_pose(tree, s.model_from_station);
  if (s.fields.grid && s.rows > 0 && s.columns > 0) {
    tree.structure("indexBounds");
    tree.integer("rowMinimum", 0);
    tree.integer("rowMaximum", std::int64_t{s.rows} - 1);
    tree.integer("columnMinimum", 0);
    tree.integer("columnMaximum", std::int64_t{s.columns} - 1);
    tree.close("indexBounds");
  }
  if (s.fields.intensity) {
    tree.structure("intensityLimits");
    tree.real("intensityMinimum", s.intensity_limits[0]);
    tree.real("intensityMaximum", s.intensity_limits[1]);
    tree.close("intensityLimits");
  }
  if (s.fields.colour) {
    tree.structure("colorLimits");
    for (const char* name : {"Red", "Green", "Blue"}) {
      tree.integer(fmt::format("color{}Minimum", name), 0);
      tree.integer(fmt::format("color{}Maximum", name), s.colour_bits > 8 ? 65535 : 255);
    }
    tree.close("colorLimits");
  }
  if (!w.bounds_m.empty()) {
    tree.structure("cartesianBounds");
    tree.real("xMinimum", w.bounds_m.min.x);
    tree.real("xMaximum", w.bounds_m.max.x);
    tree.real("yMinimum", w.bounds_m.min.y);
    tree.real("yMaximum", w.bounds_m.max.y);
    tree.real("zMinimum", w.bounds_m.min.z);
    tree.real("zMaximum", w.bounds_m.max.z);
    tree.close("cartesianBounds");
  }
  tree.open("points", fmt::format(R"(type="CompressedVector" fileOffset="{}" recordCount="{}")",
                                  w.section_physical, s.points));
  write_prototype(tree, w.fields);
  tree.vector("codecs", true);
  tree.close("codecs");
  tree.close("points");
  tree.close("vectorChild");
}

}  // namespace

std::string format_e57_xml(const std::vector<E57Written>& stations, const std::string& guid) {
  Tree tree;
  tree.open("e57Root", R"(type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0")"
                       R"( xmlns:nor="http://www.libe57.org/E57_EXT_surface_normals.txt")");
  tree.text("formatName", "ASTM E57 3D Imaging Data File");
  tree.text("guid", guid);
  tree.integer("versionMajor", 1);
  tree.integer("versionMinor", 0);
  tree.text("e57LibraryVersion", "maquette");
  tree.text("coordinateMetadata", "");
  tree.vector("data3D", true);
  for (const E57Written& station : stations) write_station(tree, station);
  tree.close("data3D");
  tree.vector("images2D", true);
  tree.close("images2D");
  tree.close("e57Root");
  return tree.take();
}

}  // namespace maquette::scan::detail
