// SPDX-License-Identifier: GPL-3.0-or-later

// Writer of LAS: 1.2 and 1.3 with point formats 0 to 3, 1.4 with 6 and 7.

#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/las_layout.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

class LasWriter final : public FlatWriter {
 public:
  LasWriter(AtomicFile file, std::string name, double unit_mm, double step_mm, int minor)
      : FlatWriter(std::move(file), std::move(name), unit_mm),
        scale_(step_mm / unit_mm),
        minor_(minor) {}

 private:
  Result<std::string> header(bool /*complete*/) override {
    const CloudFields& f = first_.fields;
    format_ = minor_ >= 4 ? (f.colour ? 7U : 6U) : (f.time ? 1U : 0U) + (f.colour ? 2U : 0U);
    layout_ = kLasLayouts[format_];
    std::string head(las_header_bytes(minor_), '\0');
    const auto set = [&](std::size_t at, const auto& value) {
      std::memcpy(head.data() + at, &value, sizeof value);
    };
    head.replace(0, 4, "LASF");
    head[24] = 1;
    head[25] = static_cast<char>(minor_);
    if (minor_ >= 4) head[6] = 16;  // "coordinates by WKT", which these formats must say
    head.replace(26, 8, "maquette");
    head.replace(58, 8, "maquette");
    set(94, static_cast<std::uint16_t>(head.size()));
    set(96, static_cast<std::uint32_t>(head.size()));
    head[104] = static_cast<char>(format_);
    set(105, static_cast<std::uint16_t>(layout_.bytes));
    if (minor_ < 4) {
      set(107, static_cast<std::uint32_t>(count_));
      for (std::size_t k = 0; k < 5; ++k)
        set(111 + 4 * k, static_cast<std::uint32_t>(by_return_[k]));
    } else {  // the old counts are zero for formats from 6 on
      set(247, count_);
      for (std::size_t k = 0; k < 15; ++k) set(255 + 8 * k, by_return_[k]);
    }
    const Vec3 high = bounds_.empty() ? Vec3{} : bounds_.max,
               low = bounds_.empty() ? Vec3{} : bounds_.min;
    const std::array<double, 6> extremes{high.x, low.x, high.y, low.y, high.z, low.z};
    for (std::size_t axis = 0; axis < 3; ++axis) set(131 + 8 * axis, scale_);
    for (std::size_t k = 0; k < 6; ++k) set(179 + 8 * k, extremes[k]);
    return head;
  }

  Result<void> point(const PointBatch& b, std::size_t i, Vec3 p, Vec3 /*n*/) override {
    const CloudFields& f = first_.fields;
    if (minor_ < 4 && count_ == UINT32_MAX)
      return fail(kCloudCannotHold, fmt::format("{}: LAS 1.{} holds {} points; write LAS 1.4",
                                                name_, minor_, count_));
    std::array<std::int32_t, 3> raw{};
    const std::array<double, 3> mm{p.x, p.y, p.z};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double steps = std::round(mm[axis] / unit_mm_ / scale_);
      if (!(steps >= INT32_MIN && steps <= INT32_MAX))
        return fail(
            kCloudCannotHold,
            fmt::format("{}: point {} is at {} mm, more than 2^31 steps of {} mm from zero; "
                        "take a larger step",
                        name_, count_, mm[axis], scale_ * unit_mm_));
      raw[axis] = static_cast<std::int32_t>(steps);
      store(rows_, raw[axis]);
    }
    bounds_.add({raw[0] * scale_, raw[1] * scale_, raw[2] * scale_});
    store(rows_,
          f.intensity ? sixteen_bits(static_cast<double>(b.intensity[i])) : std::uint16_t{0});
    const unsigned bits = layout_.extended ? 4 : 3, most = (1U << bits) - 1;
    const unsigned number = f.returns ? b.return_index[i] + 1U : 1U;
    const unsigned returns = f.returns ? b.return_count[i] : 1U;
    if (number > most || returns > most)
      return fail(kCloudCannotHold, fmt::format("{}: point {} is return {} of {}; LAS 1.{} holds "
                                                "{}{}",
                                                name_, count_, number, returns, minor_, most,
                                                minor_ < 4 ? ", write LAS 1.4" : ""));
    ++by_return_[std::min<std::size_t>(number - 1, by_return_.size() - 1)];
    store(rows_, static_cast<std::uint8_t>(number | returns << bits));
    const double degrees =
        f.scan_angle ? static_cast<double>(b.scan_angle_rad[i]) * 180.0 / std::numbers::pi : 0.0;
    const auto whole = [&](double step, double limit) {
      const double v = std::round(degrees / step);
      return std::isnan(v) ? 0.0 : std::clamp(v, -limit, limit);
    };
    if (layout_.extended) {
      rows_.append(3, '\0');  // flags, class, user data
      store(rows_, static_cast<std::int16_t>(whole(kLasAngleStepDeg, 30'000.0)));
    } else {
      rows_ += '\0';  // class
      store(rows_, static_cast<std::int8_t>(whole(1.0, 90.0)));
      rows_ += '\0';  // user data
    }
    store(rows_, std::uint16_t{0});  // source
    if (layout_.time) store(rows_, f.time ? b.time_s[i] : 0.0);
    if (layout_.colour) store(rows_, b.colours[i]);
    return {};
  }

  /// The station's limits are mapped to the whole range.
  [[nodiscard]] std::uint16_t sixteen_bits(double v) const {
    const double low = first_.intensity_limits[0], high = first_.intensity_limits[1];
    if (high > low) v = 65535.0 * ((v - low) / (high - low));
    return std::isnan(v) ? std::uint16_t{0}
                         : static_cast<std::uint16_t>(std::round(std::clamp(v, 0.0, 65535.0)));
  }

  double scale_;  // in the file's unit
  int minor_;
  std::size_t format_ = 0;
  LasLayout layout_{};
  std::array<std::uint64_t, 15> by_return_{};
  Box3 bounds_;  // in the file's unit
};

}  // namespace

WriterResult create_las(const std::filesystem::path& path, const CloudWriteOptions& options) {
  if (!(options.las_step_mm > 0.0 && std::isfinite(options.las_step_mm)))
    return fail(kCloudFormat, fmt::format("{}: a step of {} mm; a positive length was expected",
                                          path.string(), options.las_step_mm));
  if (options.las_minor < 2 || options.las_minor > 4)
    return fail(kCloudFormat, fmt::format("{}: LAS 1.{}; 1.2 to 1.4 can be written", path.string(),
                                          options.las_minor));
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  return std::make_unique<LasWriter>(std::move(file), path.string(),
                                     options.unit_mm.value_or(1000.0), options.las_step_mm,
                                     options.las_minor);
}

}  // namespace maquette::scan::detail
