// SPDX-License-Identifier: GPL-3.0-or-later

// Writes E57 files: one section per station, then the XML. Every data packet holds a whole
// number of records, a multiple of eight, so that each bytestream starts on a byte in each
// packet.

#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "core/check.hpp"
#include "core/random.hpp"
#include "scan/detail/bit_pack.hpp"
#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/e57_pages.hpp"
#include "scan/detail/e57_xml.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

constexpr std::size_t kLargestPacket = 65'536;
constexpr std::int64_t kLargestIndex = 2147483647;  // of rows and columns, by the standard

/// A guid of our own making: from the content, so that the same job gives the same bytes.
std::string guid_from(std::uint64_t fingerprint) {
  const std::uint64_t a = mix64(fingerprint), b = mix64(a);
  return fmt::format("{{{:08X}-{:04X}-{:04X}-{:04X}-{:012X}}}", a >> 32, (a >> 16) & 0xFFFFU,
                     a & 0xFFFFU, b >> 48, b & 0xFFFFFFFFFFFFU);
}

class E57Writer final : public CloudWriter {
 public:
  E57Writer(AtomicFile file, std::string name, double step_mm)
      : pages_(std::move(file)), name_(std::move(name)), step_m_(step_mm / 1000.0) {}

  [[nodiscard]] bool keeps_poses() const override { return true; }

  Result<void> begin_station(const ScanStation& station) override {
    end_station();
    E57Written& w = written_.emplace_back();
    w.station = station;
    w.station.points = 0;
    // The pose's origin is the scanner; where a station says otherwise its points move.
    new_from_old_.reset();
    if (station.position_mm && *station.position_mm != station.model_from_station.translation_mm) {
      w.station.model_from_station.translation_mm = *station.position_mm;
      new_from_old_ = w.station.model_from_station.inverse() * station.model_from_station;
    }
    choose_fields(w);
    pages_.end_page();
    w.section_physical = pages_.physical();
    section_start_ = pages_.logical();
    pages_.keep_page();
    pages_.write(std::string(32, '\0'));
    data_physical_ = pages_.physical();
    return {};
  }

  Result<void> write(const PointBatch& batch) override {
    MAQUETTE_CHECK(!written_.empty(), "write before begin_station");
    check_batch(written_.back().station.fields, batch);
    for (std::size_t from = 0; from < batch.size();) {
      const std::size_t n = std::min(batch.size() - from, per_packet_ - in_packet_);
      MAQUETTE_TRY_VOID(pack(batch, from, n));
      from += n;
      in_packet_ += n;
      if (in_packet_ == per_packet_) end_packet();
    }
    return {};
  }

  Result<void> finish() override {
    end_station();
    for (E57Written& w : written_)
      if (w.station.guid.empty())
        w.station.guid = guid_from(pages_.fingerprint() + w.section_physical);
    const std::string xml = format_e57_xml(written_, guid_from(pages_.fingerprint()));
    const std::uint64_t at = pages_.physical();
    pages_.write(xml);
    return pages_.finish(at, xml.size());
  }

 private:
  void choose_fields(E57Written& w) {
    const ScanStation& s = w.station;
    const CloudFields& f = s.fields;
    using Kind = E57Field::Kind;
    const auto real = [&](const char* name, Kind kind) {
      E57Field field;
      field.name = name;
      field.kind = kind;
      w.fields.push_back(field);
    };
    const auto whole = [&](const char* name, std::int64_t maximum) {
      E57Field field;
      field.name = name;
      field.kind = Kind::integer;
      field.minimum = 0;
      field.maximum = maximum;
      w.fields.push_back(field);
    };
    for (const char* name : {"cartesianX", "cartesianY", "cartesianZ"}) {
      real(name, Kind::real64);
      if (step_m_ == 0.0) continue;
      E57Field& field = w.fields.back();
      field.kind = Kind::scaled;
      field.minimum = INT32_MIN;
      field.maximum = INT32_MAX;
      field.scale = step_m_;
    }
    if (f.flags) whole("cartesianInvalidState", 2);
    if (f.intensity) real("intensity", Kind::real32);
    if (f.intensity && f.flags) whole("isIntensityInvalid", 1);
    if (f.colour)
      for (const char* name : {"colorRed", "colorGreen", "colorBlue"})
        whole(name, s.colour_bits > 8 ? 65535 : 255);
    if (f.colour && f.flags) whole("isColorInvalid", 1);
    if (f.normals)
      for (const char* name : {"nor:normalX", "nor:normalY", "nor:normalZ"})
        real(name, Kind::real32);
    if (f.grid) {
      whole("rowIndex", s.rows > 0 ? std::int64_t{s.rows} - 1 : kLargestIndex);
      whole("columnIndex", s.columns > 0 ? std::int64_t{s.columns} - 1 : kLargestIndex);
    }
    if (f.time) real("timeStamp", Kind::real64);
    if (f.time && f.flags) whole("isTimeStampInvalid", 1);
    if (f.returns) {
      whole("returnIndex", 255);
      whole("returnCount", 255);
    }
    streams_.assign(w.fields.size(), {});
    std::size_t bits = 0;
    widths_.clear();
    for (const E57Field& field : w.fields) bits += widths_.emplace_back(field.bits());
    const std::size_t room = kLargestPacket - 6 - 2 * w.fields.size() - 4;  // 4: padding
    per_packet_ = 8 * room / bits / 8 * 8;
    in_packet_ = 0;
  }

  Result<void> pack(const PointBatch& b, std::size_t from, std::size_t n) {
    E57Written& w = written_.back();
    const CloudFields& f = w.station.fields;
    const auto at = [&](std::size_t axis, const Vec3& v) {
      return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
    };
    const bool eight = w.station.colour_bits <= 8;
    for (std::size_t i = from; i < from + n; ++i) {
      std::size_t k = 0;  // in the order of choose_fields
      const std::uint8_t flags = b.flags.empty() ? std::uint8_t{0} : b.flags[i];
      const auto integer = [&](std::uint64_t value) {
        streams_[k].put(value, widths_[k]);
        ++k;
      };
      const auto real32 = [&](float value) {
        streams_[k++].put(std::bit_cast<std::uint32_t>(value), 32);
      };
      const auto real64 = [&](double value) {
        streams_[k++].put(std::bit_cast<std::uint64_t>(value), 64);
      };
      const bool positioned = b.has_position(i);
      Vec3 p = b.points_mm[i];
      if ((flags & kNoPosition) != 0)
        p = {};
      else if (new_from_old_)
        p = positioned ? new_from_old_->point(p) : new_from_old_->direction(p);
      if (positioned) {
        p = {p.x / 1000.0, p.y / 1000.0, p.z / 1000.0};
        w.bounds_m.add(p);
      }
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (step_m_ == 0.0) {
          real64(at(axis, p));
          continue;
        }
        const double steps = std::round(at(axis, p) / step_m_);
        if (!(steps >= INT32_MIN && steps <= INT32_MAX))
          return fail(kCloudCannotHold,
                      fmt::format("{}: point {} is {} mm from its station, more than 2^31 steps of "
                                  "{} mm; take a larger step",
                                  name_, w.station.points + i - from, 1000.0 * at(axis, p),
                                  1000.0 * step_m_));
        integer(static_cast<std::uint64_t>(static_cast<std::int64_t>(steps) - INT32_MIN));
      }
      if (f.flags)
        integer((flags & kNoPosition) != 0 ? 2U : (flags & kDirectionOnly) != 0 ? 1U : 0U);
      if (f.intensity) real32(b.intensity[i]);
      if (f.intensity && f.flags) integer((flags & kNoIntensity) != 0 ? 1 : 0);
      if (f.colour)
        for (const std::uint16_t v : {b.colours[i].red, b.colours[i].green, b.colours[i].blue})
          integer(eight ? eight_bits(v) : v);
      if (f.colour && f.flags) integer((flags & kNoColour) != 0 ? 1 : 0);
      if (f.normals) {
        const Vec3 v = new_from_old_ ? new_from_old_->direction(b.normals[i]) : b.normals[i];
        for (std::size_t axis = 0; axis < 3; ++axis) real32(static_cast<float>(at(axis, v)));
      }
      if (f.grid) {
        for (const std::uint32_t v : {b.grid[i].row, b.grid[i].column}) {
          if (v > w.fields[k].maximum)
            return fail(kCloudCannotHold,
                        fmt::format("{}: point {} lies in row {}, column {}, outside its grid of "
                                    "{} x {}",
                                    name_, w.station.points + i - from, b.grid[i].row,
                                    b.grid[i].column, w.station.rows, w.station.columns));
          integer(v);
        }
      }
      if (f.time) real64(b.time_s[i]);
      if (f.time && f.flags) integer((flags & kNoTime) != 0 ? 1 : 0);
      if (f.returns) {
        integer(b.return_index[i]);
        integer(b.return_count[i]);
      }
    }
    w.station.points += n;
    return {};
  }

  void end_packet() {
    if (in_packet_ == 0) return;
    std::string packet(6, '\0'), content;
    for (BitPacker& stream : streams_) {
      const std::string bytes = stream.take();
      store(packet, static_cast<std::uint16_t>(bytes.size()));
      content += bytes;
    }
    packet += content;
    packet.resize((packet.size() + 3) / 4 * 4);
    packet[0] = 1;
    const auto length = static_cast<std::uint16_t>(packet.size() - 1);
    const auto count = static_cast<std::uint16_t>(streams_.size());
    std::memcpy(packet.data() + 2, &length, 2);
    std::memcpy(packet.data() + 4, &count, 2);
    pages_.write(packet);
    in_packet_ = 0;
  }

  void end_station() {
    if (written_.empty() || section_start_ == 0) return;
    end_packet();
    const std::uint64_t index_physical = pages_.physical();
    // The index that the standard asks for: one entry, the first record at the first packet.
    std::string index(16, '\0');
    index[2] = 31;  // length - 1
    index[4] = 1;   // entries
    store(index, std::uint64_t{0});
    store(index, data_physical_);
    pages_.write(index);
    std::string head(8, '\0');
    head[0] = 1;
    store(head, pages_.logical() - section_start_);
    store(head, data_physical_);
    store(head, index_physical);
    pages_.end_page();
    pages_.patch_page(head);
    section_start_ = 0;
  }

  E57PageWriter pages_;
  std::string name_;
  double step_m_;
  std::vector<E57Written> written_;
  // The station being written.
  std::optional<RigidTransform> new_from_old_;
  std::vector<BitPacker> streams_;
  std::vector<unsigned> widths_;  // of a value, in bits
  std::size_t per_packet_ = 0, in_packet_ = 0;
  std::uint64_t section_start_ = 0, data_physical_ = 0;
};

}  // namespace

WriterResult create_e57(const std::filesystem::path& path, const CloudWriteOptions& options) {
  if (!(options.e57_step_mm >= 0.0 && std::isfinite(options.e57_step_mm)))
    return fail(kCloudFormat, fmt::format("{}: a step of {} mm; zero or more was expected",
                                          path.string(), options.e57_step_mm));
  if (options.unit_mm && *options.unit_mm != 1000.0)
    return fail(kCloudCannotHold, fmt::format("{}: E57 is in metres, not in units of {} mm",
                                              path.string(), *options.unit_mm));
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  return std::make_unique<E57Writer>(std::move(file), path.string(), options.e57_step_mm);
}

}  // namespace maquette::scan::detail
