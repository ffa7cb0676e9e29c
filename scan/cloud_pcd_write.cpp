// SPDX-License-Identifier: GPL-3.0-or-later

// Writer of PCD. Coordinates are doubles (F 8): floats would cost tenths of a micrometre.

#include <iterator>
#include <utility>

#include <fmt/format.h>

#include "scan/detail/cloud_parts.hpp"
#include "scan/detail/lzf.hpp"
#include "scan/detail/scalars.hpp"

namespace maquette::scan::detail {
namespace {

using Encoding = CloudWriteOptions::Pcd;

class PcdWriter final : public FlatWriter {
 public:
  PcdWriter(AtomicFile file, std::string name, double unit_mm, Encoding encoding)
      : FlatWriter(std::move(file), std::move(name), unit_mm), encoding_(encoding) {}

 private:
  struct Field {
    const char* name;
    char type;
    std::size_t size;
  };

  [[nodiscard]] std::vector<Field> fields() const {
    const CloudFields& f = first_.fields;
    std::vector<Field> list{{"x", 'F', 8}, {"y", 'F', 8}, {"z", 'F', 8}};
    if (f.intensity) list.push_back({"intensity", 'F', 4});
    if (f.normals)
      for (const char* name : {"normal_x", "normal_y", "normal_z"}) list.push_back({name, 'F', 4});
    if (f.colour) list.push_back({"rgb", 'U', 4});
    if (f.grid)
      for (const char* name : {"row", "column"}) list.push_back({name, 'U', 4});
    if (f.time) list.push_back({"time_s", 'F', 8});
    if (f.returns)
      for (const char* name : {"return_index", "return_count"}) list.push_back({name, 'U', 1});
    return list;
  }

  Result<std::string> header(bool complete) override {
    std::string names = "FIELDS", sizes = "SIZE", types = "TYPE", counts = "COUNT";
    for (const Field& f : fields()) {
      names += std::string(" ") + f.name;
      sizes += fmt::format(" {}", f.size);
      types += std::string(" ") + f.type;
      counts += " 1";
    }
    columns_.resize(fields().size());
    std::string text = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n";
    for (const auto& line : {names, sizes, types, counts}) text += line + "\n";
    const std::string count = padded_count(complete ? count_ : 0);
    text += "WIDTH " + count + "\nHEIGHT 1\n";
    if (first_.position_mm) {
      const Vec3 p = *first_.position_mm;
      const std::string known =
          fmt::format("VIEWPOINT {} {} {} 1 0 0 0", p.x / unit_mm_, p.y / unit_mm_, p.z / unit_mm_);
      const std::string unknown = "VIEWPOINT 0 0 0 1 0 0 0";
      text += fmt::format("{:<{}}\n", stations_ > 1 ? unknown : known,
                          std::max(known.size(), unknown.size()));
    } else {
      text += "VIEWPOINT 0 0 0 1 0 0 0\n";
    }
    constexpr std::array kNames{"binary", "ascii", "binary_compressed"};
    return text + "POINTS " + count + "\nDATA " + kNames[static_cast<std::size_t>(encoding_)] +
           "\n";
  }

  /// The next value of the point, in the encoding.
  template <class T>
  void value(const T& v) {
    if (encoding_ == Encoding::ascii)
      fmt::format_to(std::back_inserter(rows_), "{}{}", column_ == 0 ? "" : " ", v);
    else
      store(encoding_ == Encoding::binary ? rows_ : columns_[column_], v);
    ++column_;
  }

  Result<void> point(const PointBatch& b, std::size_t i, Vec3 p, Vec3 n) override {
    const CloudFields& f = first_.fields;
    column_ = 0;
    for (const double v : {p.x, p.y, p.z}) value(v / unit_mm_);
    if (f.intensity) value(b.intensity[i]);
    if (f.normals)
      for (const double v : {n.x, n.y, n.z}) value(static_cast<float>(v));
    if (f.colour) {
      const Colour& c = b.colours[i];
      value(std::uint32_t{eight_bits(c.red)} << 16 | std::uint32_t{eight_bits(c.green)} << 8 |
            std::uint32_t{eight_bits(c.blue)});
    }
    if (f.grid) {
      value(b.grid[i].row);
      value(b.grid[i].column);
    }
    if (f.time) value(b.time_s[i]);
    if (f.returns) {
      value(b.return_index[i]);
      value(b.return_count[i]);
    }
    if (encoding_ == Encoding::ascii) rows_ += '\n';
    return {};
  }

  Result<void> end() override {
    if (encoding_ != Encoding::binary_compressed) return {};
    // Each field by itself: copies then never reach into another, which costs nothing.
    std::string packed;
    std::uint64_t size = 0;
    for (std::string& column : columns_) {
      size += column.size();
      packed += lzf_compress(column);
      column = {};
    }
    if (size > UINT32_MAX || packed.size() > UINT32_MAX)
      return fail(kCloudCannotHold, fmt::format("{}: {} bytes of points; binary_compressed PCD "
                                                "holds 4 GiB, write it as binary",
                                                name_, size));
    store(rows_, static_cast<std::uint32_t>(packed.size()));
    store(rows_, static_cast<std::uint32_t>(size));
    flush_rows();
    file_.write(packed);
    return {};
  }

  Encoding encoding_;
  std::size_t column_ = 0;
  std::vector<std::string> columns_;  // binary_compressed: field by field
};

}  // namespace

WriterResult create_pcd(const std::filesystem::path& path, const CloudWriteOptions& options) {
  MAQUETTE_TRY(AtomicFile file, AtomicFile::create(path));
  return std::make_unique<PcdWriter>(std::move(file), path.string(), options.unit_mm.value_or(1.0),
                                     options.pcd);
}

}  // namespace maquette::scan::detail
