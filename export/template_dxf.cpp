// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/files.hpp"
#include "export/dxf_text.hpp"
#include "export/placing_template.hpp"

namespace maquette::exporting {

Result<void> write_template_dxf(const PlacingTemplate& plan, const std::filesystem::path& path) {
  constexpr std::array<DxfLayer, 6> kLayers{
      {{"PART", 7}, {"JOINT", 8}, {"STONE", 1}, {"NUMBER", 5}, {"HEADING", 3}, {"CENTRE", 2}}};
  const auto labels = label_places(plan);
  const auto lo = plan.min_mm, hi = plan.max_mm;
  const std::array<std::array<double, 2>, 4> part{
      {{lo[0], lo[1]}, {hi[0], lo[1]}, {hi[0], hi[1]}, {lo[0], hi[1]}}};
  fmt::memory_buffer text;
  append_dxf_polyline(text, "PART", part, true, 0.0);
  for (const auto& j : plan.joints) append_dxf_line(text, "JOINT", {j[0], j[1]}, {j[2], j[3]});
  for (std::size_t i = 0; i < plan.stones.size(); ++i) {
    const TemplateStone& s = plan.stones[i];
    if (!s.outline_mm.empty()) append_dxf_polyline(text, "STONE", s.outline_mm, true, 0.0);
    append_dxf_line(text, "HEADING", s.centre_mm, heading_end(s));
    append_dxf_point(text, "CENTRE", s.centre_mm);
    append_dxf_text(text, "NUMBER", labels[i], kLabelLetters_mm, label_of(s));
  }
  return write_file(path,
                    dxf_header("where stones go", {{lo[0], lo[1], 0}, {hi[0], hi[1], 0}}, kLayers) +
                        std::string(text.data(), text.size()) + std::string(kDxfEnd));
}

}  // namespace maquette::exporting
