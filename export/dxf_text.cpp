// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/dxf_text.hpp"

#include "export/text_lines.hpp"

namespace maquette::exporting {
namespace {

void append_coordinate(fmt::memory_buffer& out, std::string_view group, double value) {
  append_text(out, group);
  append_micro(out, value);
  out.push_back('\n');
}

void append_start(fmt::memory_buffer& out, std::string_view entity, std::string_view layer) {
  append_text(out, "0\n");
  append_text(out, entity);
  append_text(out, "\n8\n");
  append_text(out, layer);
  out.push_back('\n');
}

}  // namespace

std::string dxf_header(std::string_view comment, const Box3& extent,
                       std::span<const DxfLayer> layers) {
  std::string text = fmt::format(
      "999\nmaquette: {}, model frame x east y north z up, millimetres\n"
      "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n"
      "9\n$EXTMIN\n10\n{:.6f}\n20\n{:.6f}\n30\n{:.6f}\n"
      "9\n$EXTMAX\n10\n{:.6f}\n20\n{:.6f}\n30\n{:.6f}\n0\nENDSEC\n"
      "0\nSECTION\n2\nTABLES\n"
      "0\nTABLE\n2\nLTYPE\n70\n1\n0\nLTYPE\n2\nCONTINUOUS\n70\n0\n3\nSolid line\n72\n65\n73\n0\n"
      "40\n0.0\n0\nENDTAB\n0\nTABLE\n2\nLAYER\n70\n{}\n",
      comment, extent.min.x, extent.min.y, extent.min.z, extent.max.x, extent.max.y, extent.max.z,
      layers.size());
  for (const DxfLayer& layer : layers)
    text +=
        fmt::format("0\nLAYER\n2\n{}\n70\n0\n62\n{}\n6\nCONTINUOUS\n", layer.name, layer.colour);
  return text + "0\nENDTAB\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n";
}

void append_dxf_polyline(fmt::memory_buffer& out, std::string_view layer,
                         std::span<const std::array<double, 2>> points_mm, bool closed, double z) {
  append_start(out, "POLYLINE", layer);
  append_text(out, "66\n1\n10\n0.0\n20\n0.0\n");
  append_coordinate(out, "30\n", z);
  append_text(out, closed ? "70\n1\n" : "70\n0\n");
  for (const auto& p : points_mm) {
    append_start(out, "VERTEX", layer);
    append_coordinate(out, "10\n", p[0]);
    append_coordinate(out, "20\n", p[1]);
    append_coordinate(out, "30\n", z);
  }
  append_start(out, "SEQEND", layer);
}

void append_dxf_line(fmt::memory_buffer& out, std::string_view layer, std::array<double, 2> from,
                     std::array<double, 2> to) {
  append_start(out, "LINE", layer);
  append_coordinate(out, "10\n", from[0]);
  append_coordinate(out, "20\n", from[1]);
  append_text(out, "30\n0.0\n");
  append_coordinate(out, "11\n", to[0]);
  append_coordinate(out, "21\n", to[1]);
  append_text(out, "31\n0.0\n");
}

void append_dxf_point(fmt::memory_buffer& out, std::string_view layer, std::array<double, 2> at) {
  append_start(out, "POINT", layer);
  append_coordinate(out, "10\n", at[0]);
  append_coordinate(out, "20\n", at[1]);
  append_text(out, "30\n0.0\n");
}

void append_dxf_text(fmt::memory_buffer& out, std::string_view layer, std::array<double, 2> at,
                     double height_mm, std::string_view text) {
  append_start(out, "TEXT", layer);
  append_coordinate(out, "10\n", at[0]);
  append_coordinate(out, "20\n", at[1]);
  append_text(out, "30\n0.0\n");
  append_coordinate(out, "40\n", height_mm);
  append_text(out, "1\n");
  append_text(out, text);
  out.push_back('\n');
}

}  // namespace maquette::exporting
