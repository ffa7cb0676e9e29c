// SPDX-License-Identifier: GPL-3.0-or-later

// Reader of LAS 1.2 to 1.4 as far as it is uncompressed. Variable length records, waveforms,
// classes and extra bytes are stepped over.

#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/las_layout.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

class LasReader final : public BasicReader {
 public:
  LasReader(ByteSource source, const CloudReadOptions& options)
      : BasicReader(std::move(source), options, 1000.0) {}

  [[nodiscard]] std::string_view format() const override { return "LAS"; }

  Result<void> open() {
    const std::string_view head = source_.peek(las_header_bytes(4));
    if (!head.starts_with("LASF"))
      return fail(kCloudFormat, fmt::format("{}: byte 0: expected 'LASF'", file()));
    if (head.size() < las_header_bytes(2)) return source_.ended("inside the header");
    const auto u8 = [&](std::size_t at) { return static_cast<unsigned char>(head[at]); };
    const int minor = u8(25);
    if (u8(24) != 1 || minor < 2 || minor > 4)
      return fail(kCloudFormat, fmt::format("{}: byte 24: LAS {}.{}; 1.2 to 1.4 can be read",
                                            file(), u8(24), minor));
    const std::uint64_t header = load<std::uint16_t>(head.data() + 94);
    const std::uint64_t offset = load<std::uint32_t>(head.data() + 96);
    if (head.size() < las_header_bytes(minor) || header < las_header_bytes(minor) ||
        offset < header || offset > source_.size())
      return fail(kCloudFormat,
                  fmt::format("{}: byte 94: a header of {} bytes and points from byte {} on do not "
                              "fit into a file of {} bytes",
                              file(), header, offset, source_.size()));
    const std::size_t format = u8(104);
    if (format >= 64)
      return fail(kCloudFormat, fmt::format("{}: the points are compressed (LAZ); unpack the file "
                                            "with laszip or save it as LAS",
                                            file()));
    if (format >= kLasLayouts.size())
      return fail(kCloudFormat,
                  fmt::format("{}: byte 104: point format {}; 0 to 10 are known", file(), format));
    layout_ = kLasLayouts[format];
    record_ = load<std::uint16_t>(head.data() + 105);
    if (record_ < layout_.bytes)
      return fail(kCloudFormat,
                  fmt::format("{}: byte 105: records of {} bytes; point format {} has {}", file(),
                              record_, format, layout_.bytes));
    std::uint64_t points = load<std::uint32_t>(head.data() + 107);
    if (minor >= 4) points = load<std::uint64_t>(head.data() + 247);
    const std::uint64_t room = (source_.size() - offset) / record_;
    if (points > room)
      return fail(kCloudFormat,
                  fmt::format("{}: the header promises {} points, but from byte {} on the file has "
                              "room for at most {}; it is truncated or its header is wrong",
                              file(), points, offset, room));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      scale_[axis] = load<double>(head.data() + 131 + 8 * axis);
      offset_[axis] = load<double>(head.data() + 155 + 8 * axis);
      if (!std::isfinite(scale_[axis]) || scale_[axis] == 0.0 || !std::isfinite(offset_[axis]))
        return fail(kCloudFormat, fmt::format("{}: byte {}: scale {} and offset {} are no scale",
                                              file(), 131 + 8 * axis, scale_[axis], offset_[axis]));
    }
    for (const std::size_t c : {kX, kY, kZ, kIntensity, kReturnIndex, kReturnCount, kScanAngle})
      plan_.present[c] = true;
    plan_.present[kTime] = layout_.time.has_value();
    for (const std::size_t c : {kRed, kGreen, kBlue}) plan_.present[c] = layout_.colour.has_value();
    plan_.unit_mm = unit_mm_;
    plan_.colour_scale = 1.0;
    ScanStation& s = stations_.emplace_back();
    s.points = points;
    s.fields = plan_.fields();
    s.colour_bits = 16;
    s.intensity_limits = {0.0, 65535.0};
    source_.seek(offset);
    return {};
  }

  Result<bool> next(PointBatch& batch) override {
    const bool begins = !begun_;
    begun_ = true;
    start(batch, 0, begins);
    const std::uint64_t points = stations_.front().points;
    if (points_read_ == points) return begins;
    Row row{};
    while (batch.size() < batch_points_ && points_read_ < points) {
      const std::string_view bytes = source_.peek(record_);
      if (bytes.size() < record_)
        return source_.ended(fmt::format("inside point {} of {}", points_read_, points));
      decode(bytes.data(), row);
      source_.skip(record_);
      MAQUETTE_TRY_VOID(append(plan_, row, points_read_, file(), batch));
      ++points_read_;
    }
    return true;
  }

 private:
  void decode(const char* at, Row& row) const {
    constexpr double kDegree = std::numbers::pi / 180.0;
    for (const std::size_t axis : {kX, kY, kZ})
      row[axis] = load<std::int32_t>(at + 4 * axis) * scale_[axis] + offset_[axis];
    row[kIntensity] = load<std::uint16_t>(at + 12);
    const unsigned returns = load<std::uint8_t>(at + 14);
    const unsigned bits = layout_.extended ? 4 : 3, mask = (1U << bits) - 1;
    const unsigned number = returns & mask;
    row[kReturnIndex] = number > 0 ? number - 1 : 0;  // it counts from 1
    row[kReturnCount] = (returns >> bits) & mask;
    row[kScanAngle] = layout_.extended ? load<std::int16_t>(at + 18) * (kLasAngleStepDeg * kDegree)
                                       : load<std::int8_t>(at + 16) * kDegree;
    if (layout_.time) row[kTime] = load<double>(at + *layout_.time);
    if (!layout_.colour) return;
    for (std::size_t k = 0; k < 3; ++k)
      row[kRed + k] = load<std::uint16_t>(at + *layout_.colour + 2 * k);
  }

  LasLayout layout_{};
  std::size_t record_ = 0;
  std::array<double, 3> scale_{}, offset_{};
  RecordPlan plan_;
  bool begun_ = false;
};

}  // namespace

ReaderResult open_las(ByteSource source, const CloudReadOptions& options) {
  auto reader = std::make_unique<LasReader>(std::move(source), options);
  MAQUETTE_TRY_VOID(reader->open());
  return reader;
}

}  // namespace maquette::scan::detail
