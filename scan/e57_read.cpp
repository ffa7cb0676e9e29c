// SPDX-License-Identifier: GPL-3.0-or-later

// Reads the points of an E57 file.
//
// A CompressedVector section: 32 bytes (section id 1, 7 zero bytes, then as uint64 the logical
// length of the section and the physical offsets of the first data and index packet), then
// packets: a byte of type (0 index, 1 data, 2 empty), a byte of flags, uint16 length - 1. A
// data packet goes on with uint16 number of bytestreams, the uint16 length of each, then their
// bytes. Bytestream k is the k-th field of the prototype; cut at any byte, it goes on in the
// next data packet. Streams need not advance together.

#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "scan/detail/bit_pack.hpp"
#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/e57_pages.hpp"
#include "scan/detail/e57_xml.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

/// Fields that are no channel of their own.
enum Special : std::size_t {
  kRange = kChannels + 1,
  kAzimuth,
  kElevation,
  kState,
  kIntensityMissing,
  kColourMissing,
  kTimeMissing,
  kColumns
};
constexpr std::size_t kSkipped = kColumns;

std::size_t column_of(std::string_view name, bool spherical) {
  constexpr std::array<std::pair<std::string_view, std::size_t>, 15> kNames{{
      {"intensity", kIntensity},
      {"colorRed", kRed},
      {"colorGreen", kGreen},
      {"colorBlue", kBlue},
      {"rowIndex", kRow},
      {"columnIndex", kColumn},
      {"returnIndex", kReturnIndex},
      {"returnCount", kReturnCount},
      {"timeStamp", kTime},
      {"nor:normalX", kNx},
      {"nor:normalY", kNy},
      {"nor:normalZ", kNz},
      {"isIntensityInvalid", kIntensityMissing},
      {"isColorInvalid", kColourMissing},
      {"isTimeStampInvalid", kTimeMissing},
  }};
  for (const auto& [known, column] : kNames)
    if (known == name) return column;
  if (spherical) {
    if (name == "sphericalRange") return kRange;
    if (name == "sphericalAzimuth") return kAzimuth;
    if (name == "sphericalElevation") return kElevation;
    if (name == "sphericalInvalidState") return kState;
  } else {
    if (name == "cartesianX") return kX;
    if (name == "cartesianY") return kY;
    if (name == "cartesianZ") return kZ;
    if (name == "cartesianInvalidState") return kState;
  }
  return kSkipped;
}

constexpr std::size_t kLongestQueue = std::size_t{64} << 20;  // streams that drift further apart

/// A bytestream that is used: bytes that came and were not yet taken.
struct Stream {
  E57Field field;
  std::size_t number = 0;  // of the bytestream
  std::size_t column = 0;
  unsigned bits = 0;
  std::string bytes;
  std::uint64_t first_bit = 0;  // of the next value, in bytes

  [[nodiscard]] std::uint64_t values() const {
    return bits == 0 ? UINT64_MAX : (8 * bytes.size() - first_bit) / bits;
  }
  /// Takes n values. @pre n <= values()
  void take(std::size_t n, std::vector<std::uint64_t>& raw, std::vector<double>& column_values) {
    raw.resize(n);
    column_values.resize(n);
    if (bits > 0) {
      const std::size_t size = bytes.size();
      bytes.resize(size + kUnpackSlack);
      unpack(bytes.data(), first_bit, bits, n, raw.data());
      bytes.resize(size);
      first_bit += std::uint64_t{bits} * n;
      const auto gone = static_cast<std::size_t>(first_bit / 8);
      bytes.erase(0, gone);
      first_bit %= 8;
    } else {
      std::fill(raw.begin(), raw.end(), 0);
    }
    switch (field.kind) {
      case E57Field::Kind::real32:
        for (std::size_t i = 0; i < n; ++i)
          column_values[i] =
              static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(raw[i])));
        break;
      case E57Field::Kind::real64:
        for (std::size_t i = 0; i < n; ++i) column_values[i] = std::bit_cast<double>(raw[i]);
        break;
      default: {
        const bool scaled = field.kind == E57Field::Kind::scaled;
        const auto low = static_cast<std::uint64_t>(field.minimum);
        for (std::size_t i = 0; i < n; ++i) {
          const auto value = static_cast<double>(static_cast<std::int64_t>(raw[i] + low));
          column_values[i] = scaled ? value * field.scale + field.offset : value;
        }
      }
    }
  }
};

class E57Reader final : public CloudReader {
 public:
  E57Reader(ByteSource source, const CloudReadOptions& options)
      : pages_(std::move(source)),
        batch_points_(std::max<std::size_t>(1, options.batch_points)),
        unit_mm_(options.unit_mm.value_or(1000.0)) {}

  Result<void> open() {
    MAQUETTE_TRY_VOID(pages_.open());
    MAQUETTE_TRY(const std::uint64_t at, pages_.logical(pages_.xml_physical(), "the XML section"));
    if (pages_.xml_bytes() > pages_.logical_size() - at)
      return fail(kCloudFormat, fmt::format("{}: byte 32: the header promises {} bytes of XML from "
                                            "byte {} on; the file ends before",
                                            file(), pages_.xml_bytes(), pages_.xml_physical()));
    pages_.seek(at);
    std::string xml;
    while (xml.size() < pages_.xml_bytes()) {
      const auto n = static_cast<std::size_t>(
          std::min<std::uint64_t>(pages_.xml_bytes() - xml.size(), std::size_t{1} << 15));
      MAQUETTE_TRY(const std::string_view piece, pages_.peek(n));
      xml += piece;
      pages_.skip(n);
    }
    MAQUETTE_TRY(contents_, parse_e57_xml(xml, file()));
    for (E57Station& s : contents_.stations) {
      MAQUETTE_TRY_VOID(check_station(s, stations_.size()));
      stations_.push_back(s.station);
    }
    return {};
  }

  [[nodiscard]] std::string_view format() const override { return "E57"; }
  [[nodiscard]] const std::vector<ScanStation>& stations() const override { return stations_; }
  [[nodiscard]] const std::vector<CloudImage>& images() const override { return contents_.images; }
  [[nodiscard]] double progress() const override {
    return static_cast<double>(pages_.position()) / static_cast<double>(pages_.logical_size());
  }

  Result<bool> next(PointBatch& batch) override {
    batch.clear();
    if (begun_ && done_ == stations_[current_].points) {
      ++current_;
      begun_ = false;
    }
    if (current_ == stations_.size()) return false;
    batch.station = current_;
    batch.begins_station = !begun_;
    const std::uint64_t count = stations_[current_].points;
    if (!begun_) {
      begun_ = true;
      done_ = 0;
      if (count == 0) return true;
      MAQUETTE_TRY_VOID(open_section());
    }
    while (batch.size() < batch_points_ && done_ < count) {
      std::uint64_t n = std::min<std::uint64_t>(batch_points_ - batch.size(), count - done_);
      for (const Stream& s : streams_) n = std::min(n, s.values());
      MAQUETTE_TRY_VOID(n > 0 ? take(static_cast<std::size_t>(n), batch) : next_packet());
    }
    return true;
  }

 private:
  [[nodiscard]] const std::string& file() const { return pages_.source().name(); }

  [[nodiscard]] std::string named(std::size_t k) const {
    return fmt::format("{}: data3D/{}", file(), k);
  }

  /// Which fields there are, and what follows from them for the station.
  Result<void> check_station(E57Station& s, std::size_t k) const {
    ScanStation& station = s.station;
    const auto field = [&](std::string_view name) -> const E57Field* {
      for (const E57Field& f : s.fields)
        if (f.name == name) return &f;
      return nullptr;
    };
    for (std::size_t i = 0; i < s.fields.size(); ++i)
      for (std::size_t j = 0; j < i; ++j)
        if (s.fields[i].name == s.fields[j].name)
          return fail(kCloudFormat, fmt::format("{}: the record has two fields {}", named(k),
                                                shown(s.fields[i].name)));
    const bool cartesian = field("cartesianX") && field("cartesianY") && field("cartesianZ");
    const bool spherical =
        field("sphericalRange") && field("sphericalAzimuth") && field("sphericalElevation");
    if (!cartesian && !spherical)
      return fail(kCloudFormat,
                  fmt::format("{}: the points have neither cartesianX, Y, Z nor sphericalRange, "
                              "Azimuth, Elevation",
                              named(k)));
    std::uint64_t bits = 0;
    for (const E57Field& f : s.fields) {
      if (f.kind == E57Field::Kind::text && column_of(f.name, !cartesian) != kSkipped)
        return fail(kCloudFormat, fmt::format("{}: field {} is a string; a number was expected",
                                              named(k), shown(f.name)));
      bits += f.bits();
    }
    // Without this, a few bytes of header could promise any number of points.
    if (station.points > 1 && (bits == 0 || station.points > 8 * pages_.logical_size() / bits))
      return fail(kCloudFormat,
                  fmt::format("{}: {} points of {} bits are promised, but the file has only {} "
                              "bytes; it is truncated or its header is wrong",
                              named(k), station.points, bits, pages_.source().size()));
    RecordPlan plan;
    for (const E57Field& f : s.fields)
      if (const std::size_t c = column_of(f.name, !cartesian); c < kChannels) (void)plan.declare(c);
    station.fields = plan.fields();
    station.fields.flags = false;
    for (const E57Field& f : s.fields)
      if (const std::size_t c = column_of(f.name, !cartesian); c >= kState && c < kColumns)
        station.fields.flags = true;
    if (const E57Field* f = field("intensity");
        f != nullptr && !s.states_intensity_limits && f->kind == E57Field::Kind::integer)
      station.intensity_limits = {static_cast<double>(f->minimum), static_cast<double>(f->maximum)};
    if (const E57Field* red = field("colorRed")) {
      const bool whole = red->kind == E57Field::Kind::integer;
      if (!s.colour && whole)
        s.colour = E57Limits{static_cast<double>(red->minimum), static_cast<double>(red->maximum)};
      if (!s.colour || !(s.colour->maximum > s.colour->minimum)) s.colour = E57Limits{0.0, 255.0};
      station.colour_bits = whole && s.colour->maximum - s.colour->minimum <= 255.0 ? 8 : 16;
    }
    return {};
  }

  [[nodiscard]] RecordPlan plan_of(const E57Station& s, bool spherical) const {
    RecordPlan plan;
    for (const E57Field& f : s.fields)
      if (const std::size_t c = column_of(f.name, spherical); c < kChannels) (void)plan.declare(c);
    for (const std::size_t c : {kX, kY, kZ}) plan.present[c] = true;  // also from spherical
    plan.unit_mm = unit_mm_;
    plan.rows = s.station.rows;
    plan.columns = s.station.columns;
    if (s.colour) {
      plan.colour_offset = s.colour->minimum;
      plan.colour_scale = 65535.0 / (s.colour->maximum - s.colour->minimum);
    }
    return plan;
  }

  Result<void> open_section() {
    const E57Station& s = contents_.stations[current_];
    MAQUETTE_TRY(const std::uint64_t at, pages_.logical(s.section_physical, "a section of points"));
    pages_.seek(at);
    MAQUETTE_TRY(const std::string_view head, pages_.peek(32));
    if (head[0] != 1)
      return fail(kCloudFormat,
                  fmt::format("{}: byte {}: section of kind {}; points (1) were "
                              "expected",
                              file(), s.section_physical, static_cast<unsigned char>(head[0])));
    const std::uint64_t length = load<std::uint64_t>(head.data() + 8);
    const std::uint64_t data = load<std::uint64_t>(head.data() + 16);
    section_end_ = at + std::min(length, pages_.logical_size() - at);
    MAQUETTE_TRY(const std::uint64_t first, pages_.logical(data, "the first data packet"));
    pages_.seek(first);

    std::size_t cartesian = 0;
    for (const E57Field& f : s.fields)
      cartesian += f.name == "cartesianX" || f.name == "cartesianY" || f.name == "cartesianZ";
    spherical_ = cartesian < 3;
    plan_ = plan_of(s, spherical_);
    streams_.clear();
    for (std::size_t k = 0; k < s.fields.size(); ++k) {
      const std::size_t column = column_of(s.fields[k].name, spherical_);
      if (column == kSkipped) continue;
      Stream& stream = streams_.emplace_back();
      stream.field = s.fields[k];
      stream.number = k;
      stream.column = column;
      stream.bits = stream.field.bits();
    }
    columns_.assign(kColumns, {});
    return {};
  }

  Result<void> next_packet() {
    const E57Station& s = contents_.stations[current_];
    const std::uint64_t at = pages_.position();
    if (at + 4 > section_end_)
      return fail(kCloudFormat, fmt::format("{}: the section of points ends after {} of {} points",
                                            named(current_), done_, stations_[current_].points));
    MAQUETTE_TRY(const std::string_view head, pages_.peek(4));
    const auto type = static_cast<unsigned char>(head[0]);
    const std::size_t length = std::size_t{load<std::uint16_t>(head.data() + 2)} + 1;
    const auto bad = [&](std::string_view what) {
      return fail(kCloudFormat, fmt::format("{}: packet at byte {}: {}", file(),
                                            at / kE57Content * kE57Page + at % kE57Content, what));
    };
    if (type > 2) return bad(fmt::format("kind {} is not known", type));
    if (length < 4 || at + length > section_end_)
      return bad(fmt::format("{} bytes do not fit into its section", length));
    if (type == 1) {
      MAQUETTE_TRY(const std::string_view packet, pages_.peek(length));
      const std::size_t count = s.fields.size();
      std::size_t from = 6 + 2 * count;
      if (length < from || load<std::uint16_t>(packet.data() + 4) != count)
        return bad(fmt::format("expected {} bytestreams", count));
      auto stream = streams_.begin();
      for (std::size_t k = 0; k < count; ++k) {
        const std::size_t bytes = load<std::uint16_t>(packet.data() + 6 + 2 * k);
        if (bytes > length - from) return bad("its bytestreams are longer than itself");
        if (stream != streams_.end() && stream->number == k) {
          stream->bytes += packet.substr(from, bytes);
          if (stream->bytes.size() > kLongestQueue)
            return bad(fmt::format("bytestream {} is more than {} bytes ahead of another", k,
                                   kLongestQueue));
          ++stream;
        }
        from += bytes;
      }
    }
    pages_.seek(at + length);
    return {};
  }

  /// n more points from the streams.
  Result<void> take(std::size_t n, PointBatch& batch) {
    for (Stream& s : streams_) s.take(n, raw_, columns_[s.column]);
    const bool with_flags = stations_[current_].fields.flags;
    const E57Station& station = contents_.stations[current_];
    const auto value = [&](std::size_t column, std::size_t i) {
      return columns_[column].empty() ? 0.0 : columns_[column][i];
    };
    Row row{};
    for (std::size_t i = 0; i < n; ++i) {
      for (const Stream& s : streams_)
        if (s.column < kChannels) row[s.column] = columns_[s.column][i];
      std::uint8_t flags = 0;
      if (with_flags) {
        const double state = value(kState, i);
        flags = state == 0.0 ? 0 : state == 1.0 ? kDirectionOnly : kNoPosition;
        if (value(kIntensityMissing, i) != 0.0) flags |= kNoIntensity;
        if (value(kColourMissing, i) != 0.0) flags |= kNoColour;
        if (value(kTimeMissing, i) != 0.0) flags |= kNoTime;
      }
      if (spherical_) {
        const double r = (flags & kDirectionOnly) != 0 ? 1.0 : columns_[kRange][i];
        const double azimuth = columns_[kAzimuth][i], elevation = columns_[kElevation][i];
        const double level = r * std::cos(elevation);
        row[kX] = level * std::cos(azimuth);
        row[kY] = level * std::sin(azimuth);
        row[kZ] = r * std::sin(elevation);
      }
      if (plan_.has_grid()) {
        row[kRow] -= static_cast<double>(station.row_minimum);
        row[kColumn] -= static_cast<double>(station.column_minimum);
      }
      MAQUETTE_TRY_VOID(append(plan_, row, points_read_, file(), batch, flags, with_flags));
      ++points_read_;
    }
    done_ += n;
    return {};
  }

  E57PageReader pages_;
  std::size_t batch_points_;
  double unit_mm_;
  E57Contents contents_;
  std::vector<ScanStation> stations_;
  std::uint64_t points_read_ = 0;  // of the file, for messages
  // The station being read.
  std::size_t current_ = 0;
  bool begun_ = false, spherical_ = false;
  std::uint64_t done_ = 0, section_end_ = 0;
  RecordPlan plan_;
  std::vector<Stream> streams_;
  std::vector<std::vector<double>> columns_;
  std::vector<std::uint64_t> raw_;
};

}  // namespace

ReaderResult open_e57(ByteSource source, const CloudReadOptions& options) {
  auto reader = std::make_unique<E57Reader>(std::move(source), options);
  MAQUETTE_TRY_VOID(reader->open());
  return reader;
}

}  // namespace maquette::scan::detail
