// SPDX-License-Identifier: GPL-3.0-or-later

// Writer of PLY clouds: binary little-endian, everything a point has but flags.

#include <utility>

#include <fmt/format.h>

#include "core/check.hpp"
#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

class PlyWriter final : public FlatWriter {
 public:
  PlyWriter(AtomicFile file, std::string name, double unit_mm, const ExtraScalar* extra)
      : FlatWriter(std::move(file), std::move(name), unit_mm) {
    if (extra != nullptr) extra_ = *extra;
  }

 private:
  Result<std::string> header(bool complete) override {
    const CloudFields& f = first_.fields;
    std::string text = "ply\nformat binary_little_endian 1.0\ncomment maquette cloud, unit ";
    text += unit_mm_ == 1.0 ? "mm\n" : fmt::format("{} mm\n", unit_mm_);
    if (first_.position_mm) {
      const std::string position = scanner_position_text(*first_.position_mm);
      text += fmt::format("comment {:<{}}\n", stations_ > 1 ? "" : position, position.size());
    }
    // Some readers take the count with its blanks for a name: they go into a comment.
    const std::string count = fmt::format("{}", complete ? count_ : 0);
    text += fmt::format("comment {:<{}}\nelement vertex {}\n", "", 20 - count.size(), count);
    text += "property double x\nproperty double y\nproperty double z\n";
    if (f.intensity) text += "property float intensity\n";
    if (f.normals) text += "property double nx\nproperty double ny\nproperty double nz\n";
    if (f.colour)
      for (const char* name : {"red", "green", "blue"})
        text += fmt::format("property {} {}\n", first_.colour_bits > 8 ? "ushort" : "uchar", name);
    if (f.grid) text += "property uint row\nproperty uint column\n";
    if (f.time) text += "property double time_s\n";
    if (f.returns) text += "property uchar return_index\nproperty uchar return_count\n";
    if (f.scan_angle) text += "property float scan_angle_rad\n";
    if (f.statistics) text += "property uint point_count\nproperty float spread\n";
    if (extra_) text += fmt::format("property float {}\n", extra_->name);
    return text + "end_header\n";
  }

  Result<void> point(const PointBatch& b, std::size_t i, Vec3 p, Vec3 n) override {
    const CloudFields& f = first_.fields;
    store(rows_, p.x / unit_mm_);
    store(rows_, p.y / unit_mm_);
    store(rows_, p.z / unit_mm_);
    if (f.intensity) store(rows_, b.intensity[i]);
    if (f.normals) store(rows_, n);
    if (f.colour) {
      const Colour& c = b.colours[i];
      for (const std::uint16_t v : {c.red, c.green, c.blue})
        if (first_.colour_bits > 8)
          store(rows_, v);
        else
          rows_ += static_cast<char>(eight_bits(v));
    }
    if (f.grid) store(rows_, b.grid[i]);
    if (f.time) store(rows_, b.time_s[i]);
    if (f.returns) {
      rows_ += static_cast<char>(b.return_index[i]);
      rows_ += static_cast<char>(b.return_count[i]);
    }
    if (f.scan_angle) store(rows_, b.scan_angle_rad[i]);
    if (f.statistics) {
      store(rows_, b.counts[i]);
      store(rows_, static_cast<float>(static_cast<double>(b.spread_mm[i]) / unit_mm_));
    }
    if (extra_) {
      MAQUETTE_CHECK(count_ < extra_->values->size(), "{} scalars for more points",
                     extra_->values->size());
      store(rows_, (*extra_->values)[count_]);
    }
    return {};
  }

  std::optional<ExtraScalar> extra_;
};

}  // namespace

WriterResult create_ply(const std::filesystem::path& path, const CloudWriteOptions& options,
                        const ExtraScalar* extra) {
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  return std::make_unique<PlyWriter>(std::move(file), path.string(), options.unit_mm.value_or(1.0),
                                     extra);
}

}  // namespace maquette::scan::detail
