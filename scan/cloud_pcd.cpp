// SPDX-License-Identifier: GPL-3.0-or-later

// Reader of PCD (Point Cloud Library): a header of words, then points as text, as records, or
// as fields one after the other, packed by LZF. rgb is four bytes 0xRRGGBB, often labelled
// float. HEIGHT > 1 is a grid, row by row, with NaN where nothing came back. VIEWPOINT is
// taken as the scanner's position in the frame of the points.

#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/lzf.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

struct PcdField {
  std::size_t channel = kIgnored;
  bool is_rgb = false;
  Scalar type = Scalar::float32;
  std::size_t count = 1;
  std::size_t offset = 0;  // in a record
  [[nodiscard]] std::size_t bytes() const { return count * bytes_of(type); }
};

enum class PcdData { ascii, binary, compressed };

constexpr std::uint64_t kLongestHeader = std::uint64_t{1} << 16;
constexpr std::size_t kLargestRecord = 4096;

std::optional<Scalar> scalar_of(char type, std::uint64_t size) {
  const std::string_view kinds = "IUF";
  const std::size_t kind = kinds.find(type);
  if (kind == std::string_view::npos) return std::nullopt;
  constexpr std::array<std::array<std::optional<Scalar>, 4>, 3> kTypes{{
      {Scalar::int8, Scalar::int16, Scalar::int32, Scalar::int64},
      {Scalar::uint8, Scalar::uint16, Scalar::uint32, Scalar::uint64},
      {std::nullopt, std::nullopt, Scalar::float32, Scalar::float64},
  }};
  for (std::size_t power = 0; power < 4; ++power)
    if (size == std::uint64_t{1} << power) return kTypes[kind][power];
  return std::nullopt;
}

class PcdReader final : public BasicReader {
 public:
  PcdReader(ByteSource source, const CloudReadOptions& options)
      : BasicReader(std::move(source), options, 1.0) {}

  [[nodiscard]] std::string_view format() const override { return "PCD"; }

  Result<void> open() {
    MAQUETTE_TRY_VOID(read_header());
    plan_.unit_mm = unit_mm_;
    bool colour = false;
    for (const PcdField& f : fields_) {
      if (f.is_rgb ? colour : f.channel != kIgnored && !plan_.declare(f.channel))
        return fail(kCloudFormat,
                    fmt::format("{}: a coordinate, intensity, colour or normal stands twice in "
                                "FIELDS",
                                file()));
      colour = colour || f.is_rgb;
    }
    if (colour)
      for (const std::size_t c : {kRed, kGreen, kBlue}) plan_.present[c] = true;
    if (!plan_.has_position())
      return fail(kCloudFormat, fmt::format("{}: FIELDS has no x, y and z", file()));
    ScanStation& s = stations_.front();
    gridded_ = height_ > 1;
    if (gridded_) {
      if (height_ > UINT32_MAX || width_ > UINT32_MAX)
        return fail(kCloudFormat, fmt::format("{}: a grid of {} x {}", file(), width_, height_));
      plan_.rows = s.rows = static_cast<std::uint32_t>(height_);
      plan_.columns = s.columns = static_cast<std::uint32_t>(width_);
      plan_.present[kRow] = plan_.present[kColumn] = true;
    }
    s.fields = plan_.fields();
    s.fields.flags = gridded_;
    return check_room();
  }

  Result<bool> next(PointBatch& batch) override {
    const bool begins = !begun_;
    begun_ = true;
    start(batch, 0, begins);
    if (points_read_ == points_) return begins;
    Row row{};
    while (batch.size() < batch_points_ && points_read_ < points_) {
      MAQUETTE_TRY_VOID(data_ == PcdData::ascii ? text_row(row) : binary_row(row));
      std::uint8_t flags = 0;
      if (gridded_) {
        row[kRow] = static_cast<double>(points_read_ / width_);
        row[kColumn] = static_cast<double>(points_read_ % width_);
        if (std::isnan(row[kX]) || std::isnan(row[kY]) || std::isnan(row[kZ])) {
          flags = kNoPosition;
          row[kNx] = row[kNy] = row[kNz] = 0.0;
        }
      }
      MAQUETTE_TRY_VOID(append(plan_, row, points_read_, file(), batch, flags, gridded_));
      ++points_read_;
    }
    return true;
  }

 private:
  [[nodiscard]] std::string where() const {
    return fmt::format("{}: line {}", file(), source_.line_number());
  }

  /// The tokens of a header line as numbers.
  Result<std::vector<std::uint64_t>> counts(std::string_view line, std::string_view what) const {
    std::vector<std::uint64_t> values;
    for (auto token = next_token(line); !token.empty(); token = next_token(line)) {
      const auto value = parse_number<std::uint64_t>(token);
      if (!value)
        return fail(kCloudFormat, fmt::format("{}: {} needs whole numbers, got '{}'", where(), what,
                                              shown(token)));
      values.push_back(*value);
    }
    return values;
  }

  Result<void> read_header() {
    std::vector<std::string> names, types;
    std::vector<std::uint64_t> sizes, numbers;
    std::optional<std::uint64_t> points;
    stations_.emplace_back();
    while (true) {
      auto line = source_.line();
      if (!line || source_.position() > kLongestHeader)
        return fail(kCloudFormat, fmt::format("{}: byte {}: the header has no DATA line", file(),
                                              source_.position()));
      const std::string_view word = next_token(*line);
      if (word.empty() || word.front() == '#') continue;
      if (word == "FIELDS" || word == "TYPE") {
        auto& list = word == "TYPE" ? types : names;
        list.clear();
        for (auto token = next_token(*line); !token.empty(); token = next_token(*line))
          list.emplace_back(token);
      } else if (word == "SIZE") {
        MAQUETTE_TRY(sizes, counts(*line, "SIZE"));
      } else if (word == "COUNT") {
        MAQUETTE_TRY(numbers, counts(*line, "COUNT"));
      } else if (word == "WIDTH" || word == "HEIGHT" || word == "POINTS") {
        MAQUETTE_TRY(const auto value, counts(*line, word));
        if (value.size() != 1)
          return fail(kCloudFormat, fmt::format("{}: {} needs one number", where(), word));
        if (word == "POINTS")
          points = value[0];
        else
          (word == "WIDTH" ? width_ : height_) = value[0];
      } else if (word == "VIEWPOINT") {
        MAQUETTE_TRY_VOID(viewpoint(*line));
      } else if (word == "DATA") {
        const std::string_view kind = next_token(*line);
        if (kind == "ascii")
          data_ = PcdData::ascii;
        else if (kind == "binary")
          data_ = PcdData::binary;
        else if (kind == "binary_compressed")
          data_ = PcdData::compressed;
        else
          return fail(kCloudFormat, fmt::format("{}: DATA '{}'; expected ascii, binary or "
                                                "binary_compressed",
                                                where(), shown(kind)));
        break;
      } else if (word != "VERSION") {
        return fail(kCloudFormat,
                    fmt::format("{}: unexpected '{}' in the header", where(), shown(word)));
      }
    }
    if (numbers.empty()) numbers.assign(names.size(), 1);
    if (names.empty() || types.size() != names.size() || sizes.size() != names.size() ||
        numbers.size() != names.size())
      return fail(kCloudFormat, fmt::format("{}: FIELDS, SIZE, TYPE and COUNT must be there with "
                                            "the same number of entries",
                                            file()));
    for (std::size_t i = 0; i < names.size(); ++i)
      MAQUETTE_TRY_VOID(add_field(names[i], types[i], sizes[i], numbers[i]));
    // WIDTH and HEIGHT may be missing in old files, POINTS in others.
    if (width_ == 0 && height_ == 1 && points) width_ = *points;
    if (width_ != 0 && height_ > UINT64_MAX / width_)
      return fail(kCloudFormat, fmt::format("{}: a grid of {} x {}", file(), width_, height_));
    points_ = width_ * height_;
    if (points && *points != points_)
      return fail(kCloudFormat,
                  fmt::format("{}: POINTS is {}, WIDTH x HEIGHT is {}", file(), *points, points_));
    stations_.front().points = points_;
    return {};
  }

  Result<void> add_field(const std::string& name, const std::string& type, std::uint64_t size,
                         std::uint64_t count) {
    const auto scalar = type.size() == 1 ? scalar_of(type[0], size) : std::nullopt;
    if (!scalar || count == 0 || count > kLargestRecord)
      return fail(kCloudFormat, fmt::format("{}: field {} of TYPE {}, SIZE {}, COUNT {}", file(),
                                            shown(name), shown(type), size, count));
    PcdField f;
    f.type = *scalar;
    f.count = count;
    f.offset = record_;
    f.is_rgb = (name == "rgb" || name == "rgba") && bytes_of(f.type) == 4 && count == 1;
    if (!f.is_rgb && count == 1) f.channel = channel_by_name(name);
    record_ += f.bytes();
    if (record_ > kLargestRecord)
      return fail(kCloudFormat,
                  fmt::format("{}: records of more than {} bytes", file(), kLargestRecord));
    fields_.push_back(f);
    return {};
  }

  Result<void> viewpoint(std::string_view line) {
    std::array<double, 7> v{};
    for (double& value : v) {
      const auto number = parse_number<double>(next_token(line));
      if (!number || !std::isfinite(*number))
        return fail(kCloudFormat, fmt::format("{}: VIEWPOINT needs seven numbers", where()));
      value = *number;
    }
    const Vec3 position = unit_mm_ * Vec3{v[0], v[1], v[2]};
    if (!(norm(position) <= kLargestCoordinateMm))
      return fail(kCloudFormat, fmt::format("{}: VIEWPOINT is {} mm away; at most {} is possible",
                                            where(), norm(position), kLargestCoordinateMm));
    if (position != Vec3{}) stations_.front().position_mm = position;  // zero: what all write
    return {};
  }

  /// Does the file have room for what the header promises?
  Result<void> check_room() {
    if (data_ == PcdData::compressed) return unpack_all();
    std::size_t values = 0;
    for (const PcdField& f : fields_) values += f.count;
    const std::size_t least = data_ == PcdData::ascii ? 2 * values : record_;
    const std::uint64_t room = (source_.remaining() + (data_ == PcdData::ascii ? 1 : 0)) / least;
    if (points_ > room)
      return fail(kCloudFormat,
                  fmt::format("{}: the header promises {} points, but from byte {} on the file has "
                              "room for at most {}; it is truncated or its header is wrong",
                              file(), points_, source_.position(), room));
    return {};
  }

  Result<void> unpack_all() {
    const std::string_view head = source_.peek(8);
    if (head.size() < 8) return source_.ended("before the sizes of its packed points");
    const std::uint64_t packed = load<std::uint32_t>(head.data());
    const std::uint64_t size = load<std::uint32_t>(head.data() + 4);
    source_.skip(8);
    if (packed > source_.remaining())
      return source_.ended(fmt::format("inside {} bytes of packed points", packed));
    if (points_ > size / record_ || points_ * record_ != size)
      return fail(kCloudFormat, fmt::format("{}: {} points of {} bytes are promised, the packed "
                                            "points become {} bytes",
                                            file(), points_, record_, size));
    const std::string_view bytes = source_.peek(static_cast<std::size_t>(packed));
    if (bytes.size() < packed) return source_.ended("inside its packed points");
    auto all = lzf_decompress(bytes, static_cast<std::size_t>(size));
    if (!all)
      return fail(kCloudFormat,
                  fmt::format("{}: the packed points are damaged: they do not become {} bytes",
                              file(), size));
    unpacked_ = std::move(*all);
    source_.skip(bytes.size());
    return {};
  }

  static void set_rgb(Row& row, std::uint32_t rgb) {
    row[kRed] = (rgb >> 16) & 0xFFU;
    row[kGreen] = (rgb >> 8) & 0xFFU;
    row[kBlue] = rgb & 0xFFU;
  }

  Result<void> binary_row(Row& row) {
    const bool columns = data_ == PcdData::compressed;
    std::string_view record;
    if (!columns) {
      record = source_.peek(record_);
      if (record.size() < record_)
        return source_.ended(fmt::format("inside point {} of {}", points_read_, points_));
    }
    for (const PcdField& f : fields_) {
      if (!f.is_rgb && f.channel == kIgnored) continue;
      const char* at = columns ? unpacked_.data() + f.offset * points_ + f.bytes() * points_read_
                               : record.data() + f.offset;
      if (f.is_rgb)
        set_rgb(row, load<std::uint32_t>(at));
      else
        row[f.channel] = load_scalar(f.type, at);
    }
    if (!columns) source_.skip(record_);
    return {};
  }

  Result<void> text_row(Row& row) {
    auto line = source_.line();
    if (!line) return source_.ended(fmt::format("before point {} of {}", points_read_, points_));
    for (const PcdField& f : fields_)
      for (std::size_t k = 0; k < f.count; ++k) {
        const std::string_view token = next_token(*line);
        if (f.is_rgb && f.type != Scalar::float32) {
          const auto bits = parse_number<std::uint32_t>(token);
          if (!bits) return no_number(token);
          set_rgb(row, *bits);
          continue;
        }
        const auto value = parse_number<double>(token);
        if (!value) return no_number(token);
        if (f.is_rgb)  // the float whose bytes are the colour
          set_rgb(row, std::bit_cast<std::uint32_t>(
                           std::abs(*value) < 3e38 ? static_cast<float>(*value) : 0.0F));
        else
          row[f.channel] = *value;
      }
    if (const std::string_view more = next_token(*line); !more.empty())
      return fail(kCloudFormat, fmt::format("{}: '{}' after the last field", where(), shown(more)));
    return {};
  }

  tl::unexpected<Error> no_number(std::string_view token) const {
    return fail(kCloudFormat, fmt::format("{}: expected a number for each of {} fields, got '{}'",
                                          where(), fields_.size(), shown(token)));
  }

  std::vector<PcdField> fields_;
  std::size_t record_ = 0;
  std::uint64_t width_ = 0, height_ = 1, points_ = 0;
  PcdData data_ = PcdData::ascii;
  bool gridded_ = false, begun_ = false;
  RecordPlan plan_;
  std::string unpacked_;
};

}  // namespace

ReaderResult open_pcd(ByteSource source, const CloudReadOptions& options) {
  auto reader = std::make_unique<PcdReader>(std::move(source), options);
  MAQUETTE_TRY_VOID(reader->open());
  return reader;
}

}  // namespace maquette::scan::detail
