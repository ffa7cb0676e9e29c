// SPDX-License-Identifier: GPL-3.0-or-later

// glTF 2.0 (ISO/IEC 12113:2022), binary or text: the triangles of a scene and, where
// asked for, the colours and pictures of its materials.
// By JSON and Draco, which are here anyway. Assimp, which reads glTF too, was weighed: of 1500
// files with a few bytes changed it did not come back from one within ten seconds, and what is
// wrong with a file it says without the place.
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <new>
#include <string>
#include <utility>

#include <draco/compression/decode.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "meshing/detail/gltf_json.hpp"
#include "meshing/detail/mesh_readers.hpp"
#include "meshing/mesh_io.hpp"

namespace maquette::meshing::detail {
namespace {

using namespace gltf;

constexpr std::string_view kDraco = "KHR_draco_mesh_compression";
constexpr double kMillimetresPerMetre = 1000.0;

std::uint32_t u32_at(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

class GltfReader {
 public:
  GltfReader(std::filesystem::path folder, bool looks, const RunContext& run)
      : folder_(std::move(folder)), looks_(looks), run_(run), weld_(whole_.mesh.vertices_mm) {}

  Result<PaintedMesh> read(std::string_view bytes) {
    MAQUETTE_TRY_VOID(open(bytes));
    MAQUETTE_TRY_VOID(check_header());
    MAQUETTE_TRY_VOID(load_buffers());
    if (looks_) MAQUETTE_TRY_VOID(read_materials());
    MAQUETTE_TRY_VOID(walk_nodes());
    return std::move(whole_);
  }

 private:
  Result<void> open(std::string_view bytes) {
    std::string_view text = bytes;
    if (bytes.starts_with("glTF")) {
      if (bytes.size() < 20)
        return fail(kMeshFormat, fmt::format("byte {}: header of a binary glTF expected, the file "
                                             "ends here",
                                             bytes.size()));
      if (u32_at(bytes, 4) != 2)
        return fail(kMeshFormat,
                    fmt::format("byte 4: glTF of version 2 expected, found {}", u32_at(bytes, 4)));
      const std::size_t size = u32_at(bytes, 12);
      if (bytes.substr(16, 4) != "JSON" || size > bytes.size() - 20)
        return fail(kMeshFormat, "byte 12: a JSON chunk that ends within the file expected");
      text = bytes.substr(20, size);
      const std::size_t next = 20 + size;
      if (bytes.size() - next >= 8) {
        const std::size_t length = u32_at(bytes, next);
        if (bytes.substr(next + 4, 4) != std::string_view("BIN\0", 4) ||
            length > bytes.size() - next - 8)
          return fail(kMeshFormat,
                      fmt::format("byte {}: a BIN chunk that ends within the file expected", next));
        chunk_ = bytes.substr(next + 8, length);
      }
    }
    try {
      json_ = Json::parse(text);
    } catch (const Json::exception& e) {
      return fail(kMeshFormat, fmt::format("no JSON of a glTF: {}", e.what()));
    }
    root_ = {&json_, ""};
    return {};
  }

  Result<void> check_header() {
    if (!root_.at("asset").at("version").text().starts_with("2"))
      return bad(root_.at("asset").at("version"), "\"2.0\"");
    const Node required = root_.at("extensionsRequired");
    for (std::size_t i = 0; i < required.size(); ++i) {
      const std::string name = required.at(i).text();
      const bool looks = name.starts_with("KHR_materials") || name.starts_with("KHR_texture") ||
                         name.starts_with("EXT_texture");
      if (!looks && name != kDraco && name != "KHR_mesh_quantization")
        return fail(kMeshFormat,
                    fmt::format("{}: this file cannot be read without the extension '{}', which is "
                                "not known here; write it plain or with Draco",
                                required.at(i).path, shown(name)));
    }
    return {};
  }

  Result<void> load_buffers() {
    const Node list = root_.at("buffers");
    for (std::size_t i = 0; i < list.size(); ++i) {
      const Node uri = list.at(i).at("uri");
      if (!uri.given()) {
        buffers_.emplace_back(i == 0 ? chunk_ : std::string_view());
        continue;
      }
      const std::string text = uri.text();
      if (text.starts_with("data:")) {
        auto bytes = from_data(text);
        if (!bytes) return bad(uri, "data in base 64");
        buffers_.emplace_back(std::move(*bytes));
      } else {
        MAQUETTE_TRY(auto bytes, read_file(folder_ / from_percent(text)));
        buffers_.emplace_back(std::move(bytes));
      }
    }
    return {};
  }

  /// The bytes of a buffer view. @pre its place is an object of the file
  Result<std::string_view> view(const Node& place) {
    MAQUETTE_TRY(const Node v, element(root_.at("bufferViews"), place));
    MAQUETTE_TRY(const std::uint64_t buffer, whole(v.at("buffer")));
    MAQUETTE_TRY(const std::uint64_t offset, whole(v.at("byteOffset"), 0));
    MAQUETTE_TRY(const std::uint64_t length, whole(v.at("byteLength")));
    const std::uint64_t there = buffer < buffers_.size() ? buffers_[buffer].bytes().size() : 0;
    if (offset > there || length > there - offset)
      return fail(kMeshFormat, fmt::format("{}: bytes {} to {} of buffer {} expected, which has {}",
                                           v.path, offset, offset + length, buffer, there));
    return buffers_[buffer].bytes().substr(offset, length);
  }

  // ---- looks ---------------------------------------------------------------------------

  /// Where a material's picture lies: which coordinates, and how they are bent.
  struct PictureUse {
    bool has = false;
    std::uint64_t set = 0;
    std::array<double, 2> shift{0.0, 0.0}, scale{1.0, 1.0};
    double rotation_rad = 0.0;
  };

  Result<void> read_materials() {
    const Node list = root_.at("materials");
    for (std::size_t i = 0; i < list.size(); ++i) {
      const Node material = list.at(i), pbr = material.at("pbrMetallicRoughness");
      Paint paint;
      paint.name = material.at("name").text();
      MAQUETTE_TRY(const auto colour, numbers<4>(pbr.at("baseColorFactor"), {1, 1, 1, 1}));
      MAQUETTE_TRY(paint.metallic, share(pbr.at("metallicFactor"), 1.0));
      MAQUETTE_TRY(paint.roughness, share(pbr.at("roughnessFactor"), 1.0));
      for (std::size_t b = 0; b < 3; ++b) {
        if (colour[b] < 0.0 || colour[b] > 1.0)
          return bad(pbr.at("baseColorFactor"), "numbers from 0 to 1");
        paint.colour[b] = colour[b];
      }
      PictureUse use;
      const Node texture = pbr.at("baseColorTexture");
      if (texture.given()) {
        MAQUETTE_TRY_VOID(read_picture(texture, paint));
        MAQUETTE_TRY(use, use_of(texture));
      }
      whole_.paints.push_back(std::move(paint));
      uses_.push_back(use);
    }
    return {};
  }

  static Result<double> share(const Node& node, double absent) {
    if (!node.given()) return absent;
    const double x = node.value->is_number() ? node.value->get<double>() : -1.0;
    if (!(x >= 0.0 && x <= 1.0)) return bad(node, "a number from 0 to 1");
    return x;
  }

  Result<PictureUse> use_of(const Node& texture) {
    PictureUse use;
    use.has = true;
    MAQUETTE_TRY(use.set, whole(texture.at("texCoord"), 0));
    const Node bent = texture.at("extensions").at("KHR_texture_transform");
    if (!bent.given()) return use;
    MAQUETTE_TRY(use.shift, numbers<2>(bent.at("offset"), {0, 0}));
    MAQUETTE_TRY(use.scale, numbers<2>(bent.at("scale"), {1, 1}));
    MAQUETTE_TRY(use.rotation_rad, real(bent.at("rotation")));
    MAQUETTE_TRY(use.set, whole(bent.at("texCoord"), static_cast<std::int64_t>(use.set)));
    return use;
  }

  static Result<double> real(const Node& node) {
    if (!node.given()) return 0.0;
    if (!node.value->is_number() || !std::isfinite(node.value->get<double>()))
      return bad(node, "a finite number");
    return node.value->get<double>();
  }

  Result<void> read_picture(const Node& use, Paint& paint) {
    MAQUETTE_TRY(const Node texture, element(root_.at("textures"), use.at("index")));
    if (texture.at("sampler").given()) {
      MAQUETTE_TRY(const Node sampler, element(root_.at("samplers"), texture.at("sampler")));
      MAQUETTE_TRY(paint.beyond[0], beyond(sampler.at("wrapS")));
      MAQUETTE_TRY(paint.beyond[1], beyond(sampler.at("wrapT")));
    }
    if (!texture.at("source").given())
      return fail(kMeshFormat,
                  fmt::format("{}/source: a PNG or JPEG expected; pictures that only an extension "
                              "knows are not read, write it with plain ones",
                              texture.path));
    MAQUETTE_TRY(const Node image, element(root_.at("images"), texture.at("source")));
    const Node uri = image.at("uri");
    if (!uri.given()) {
      MAQUETTE_TRY(const std::string_view bytes, view(image.at("bufferView")));
      paint.picture = bytes;
    } else if (uri.text().starts_with("data:")) {
      auto bytes = from_data(uri.text());
      if (!bytes) return bad(uri, "data in base 64");
      paint.picture = std::move(*bytes);
    } else {
      paint.picture_file = folder_ / from_percent(uri.text());
      whole_.files.push_back(paint.picture_file);
    }
    if (!paint.has_picture()) return bad(image, "a picture that is not empty");
    return {};
  }

  static Result<Beyond> beyond(const Node& node) {
    MAQUETTE_TRY(const std::uint64_t how, whole(node, 10497));
    if (how == 10497) return Beyond::repeats;
    if (how == 33071) return Beyond::edge;
    if (how == 33648) return Beyond::mirrored;
    return bad(node, "10497, 33071 or 33648");
  }

  /// The paint of a primitive; one that has none gets the format's own.
  Result<std::size_t> paint_of(const Node& primitive) {
    if (primitive.at("material").given()) {
      MAQUETTE_TRY(const std::uint64_t i, whole(primitive.at("material")));
      if (i >= whole_.paints.size() || (plain_paint_ && i >= *plain_paint_))
        return bad(primitive.at("material"), "a material that is there");
      return static_cast<std::size_t>(i);
    }
    if (!plain_paint_) {
      plain_paint_ = whole_.paints.size();
      Paint paint;
      paint.metallic = 1.0;
      whole_.paints.push_back(std::move(paint));
      uses_.emplace_back();
    }
    return *plain_paint_;
  }

  /// Where coordinates are in a picture: scaled, turned (from its right side to its upper one),
  /// shifted, as KHR_texture_transform has it.
  static std::array<float, 2> bent(const PictureUse& use, double u, double v) {
    const double x = use.scale[0] * u, y = use.scale[1] * v;
    const double c = std::cos(use.rotation_rad), s = std::sin(use.rotation_rad);
    return {static_cast<float>(c * x + s * y + use.shift[0]),
            static_cast<float>(-s * x + c * y + use.shift[1])};
  }

  // ---- triangles -----------------------------------------------------------------------

  /// Numbers of an accessor, `width` each, to double; integers as they are, or as shares of their
  /// range where they are normalised.
  Result<std::vector<double>> accessor(const Node& place, std::size_t width) {
    MAQUETTE_TRY(const Node a, element(root_.at("accessors"), place));
    if (a.at("sparse").given())
      return fail(kMeshFormat, a.path + "/sparse: sparse accessors are not read; write it plain");
    const std::string_view type_name = width == 3 ? "VEC3" : width == 2 ? "VEC2" : "SCALAR";
    if (a.at("type").text() != type_name)
      return bad(a.at("type"), fmt::format("\"{}\"", type_name));
    MAQUETTE_TRY(const std::uint64_t count, whole(a.at("count")));
    MAQUETTE_TRY(const std::uint64_t type, whole(a.at("componentType")));
    MAQUETTE_TRY(const std::uint64_t offset, whole(a.at("byteOffset"), 0));
    const std::size_t size = type == 5120 || type == 5121   ? 1
                             : type == 5122 || type == 5123 ? 2
                             : type == 5125 || type == 5126 ? 4
                                                            : 0;
    if (size == 0) return bad(a.at("componentType"), "5120 to 5123, 5125 or 5126");
    MAQUETTE_TRY(const std::string_view bytes, view(a.at("bufferView")));
    const Node stated = root_.at("bufferViews")
                            .at(static_cast<std::size_t>(whole(a.at("bufferView")).value()))
                            .at("byteStride");
    MAQUETTE_TRY(const std::uint64_t stride,
                 whole(stated, static_cast<std::int64_t>(size * width)));
    if (stride < size * width || stride > 252)
      return bad(stated, fmt::format("{} to 252 bytes", size * width));
    if (count > 0 && (count > bytes.size() || offset > bytes.size() ||
                      (count - 1) * stride + size * width > bytes.size() - offset))
      return fail(kMeshFormat, fmt::format("{}: {} elements of {} bytes expected from byte {} on, "
                                           "but its view has {}",
                                           a.path, count, stride, offset, bytes.size()));
    const bool shares = a.at("normalized").given() && *a.at("normalized").value == true;
    std::vector<double> all;
    all.reserve(count * width);
    for (std::uint64_t i = 0; i < count; ++i)
      for (std::size_t k = 0; k < width; ++k)
        all.push_back(component(bytes.data() + offset + i * stride + k * size, type, shares));
    return all;
  }

  static double component(const char* from, std::uint64_t type, bool shares) {
    const auto get = [&](auto value) {
      std::memcpy(&value, from, sizeof value);
      if constexpr (std::is_integral_v<decltype(value)>) {
        const double most = std::numeric_limits<decltype(value)>::max();
        return shares ? std::fmax(-1.0, static_cast<double>(value) / most)
                      : static_cast<double>(value);
      } else {
        return static_cast<double>(value);
      }
    };
    switch (type) {
      case 5120:
        return get(std::int8_t{});
      case 5121:
        return get(std::uint8_t{});
      case 5122:
        return get(std::int16_t{});
      case 5123:
        return get(std::uint16_t{});
      case 5125:
        return get(std::uint32_t{});
      default:
        return get(float{});
    }
  }

  struct Part {
    std::vector<Vec3> points;
    std::vector<std::uint64_t> corners;
    std::vector<std::array<double, 2>> at;  ///< by point, in a picture; empty: not known
  };

  /// N numbers of each point, to `take`.
  template <std::size_t N, class Take>
  static Result<void> attribute(const draco::Mesh& mesh, const Node& place, const Take& take) {
    MAQUETTE_TRY(const std::uint64_t id, whole(place));
    const draco::PointAttribute* at = mesh.GetAttributeByUniqueId(static_cast<std::uint32_t>(id));
    if (at == nullptr || at->num_components() != N)
      return bad(place, fmt::format("an attribute of {} numbers", N == 3 ? "three" : "two"));
    for (std::uint32_t i = 0; i < mesh.num_points(); ++i) {
      std::array<float, N> p{};
      if (!at->ConvertValue<float, N>(at->mapped_index(draco::PointIndex(i)), p.data()))
        return bad(place, fmt::format("{} numbers a point", N == 3 ? "three" : "two"));
      take(p);
    }
    return {};
  }

  /// @param coordinates  key of the attribute that says where points lie in a picture; empty: none
  Result<Part> packed(const Node& draco, const std::string& coordinates) {
    MAQUETTE_TRY(const std::string_view bytes, view(draco.at("bufferView")));
    draco::DecoderBuffer buffer;
    buffer.Init(bytes.data(), bytes.size());
    draco::Decoder decoder;
    auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
    if (!decoded.ok())
      return fail(kMeshFormat, fmt::format("{}: Draco cannot decode it: {}", draco.path,
                                           decoded.status().error_msg_string()));
    const draco::Mesh& mesh = *decoded.value();
    const Node attributes = draco.at("attributes");
    Part part;
    MAQUETTE_TRY_VOID(attribute<3>(mesh, attributes.at("POSITION"), [&](const auto& p) {
      part.points.push_back({p[0], p[1], p[2]});
    }));
    if (!coordinates.empty() && attributes.at(coordinates).given())
      MAQUETTE_TRY_VOID(attribute<2>(mesh, attributes.at(coordinates), [&](const auto& p) {
        part.at.push_back({p[0], p[1]});
      }));
    for (std::uint32_t f = 0; f < mesh.num_faces(); ++f)
      for (const draco::PointIndex& corner : mesh.face(draco::FaceIndex(f)))
        part.corners.push_back(corner.value());
    return part;
  }

  Result<Part> plain(const Node& primitive, const std::string& coordinates) {
    MAQUETTE_TRY(const auto xyz, accessor(primitive.at("attributes").at("POSITION"), 3));
    Part part;
    for (std::size_t i = 0; i + 2 < xyz.size(); i += 3)
      part.points.push_back({xyz[i], xyz[i + 1], xyz[i + 2]});
    if (primitive.at("indices").given()) {
      MAQUETTE_TRY(const auto corners, accessor(primitive.at("indices"), 1));
      for (const double c : corners) part.corners.push_back(static_cast<std::uint64_t>(c));
    } else {
      for (std::size_t i = 0; i < part.points.size(); ++i) part.corners.push_back(i);
    }
    if (!coordinates.empty() && primitive.at("attributes").at(coordinates).given()) {
      const Node place = primitive.at("attributes").at(coordinates);
      MAQUETTE_TRY(const auto uv, accessor(place, 2));
      if (uv.size() != 2 * part.points.size()) return bad(place, "as many as there are points");
      for (std::size_t i = 0; i + 1 < uv.size(); i += 2) part.at.push_back({uv[i], uv[i + 1]});
    }
    return part;
  }

  Result<void> add_primitive(const Node& primitive, const Affine& pose) {
    if (run_.stopped()) return fail(kCancelled, "stopped while reading");
    MAQUETTE_TRY(const std::uint64_t mode, whole(primitive.at("mode"), 4));
    if (mode > 6) return bad(primitive.at("mode"), "0 to 6");
    if (mode < 4) return {};  // points and lines have no surface
    const Node draco = primitive.at("extensions").at(kDraco);
    std::size_t paint = 0;
    std::string coordinates;
    if (looks_) {
      MAQUETTE_TRY(paint, paint_of(primitive));
      if (uses_[paint].has) coordinates = fmt::format("TEXCOORD_{}", uses_[paint].set);
    }
    MAQUETTE_TRY(const Part part,
                 draco.given() ? packed(draco, coordinates) : plain(primitive, coordinates));
    if (!coordinates.empty() && part.at.empty())
      return fail(kNoPaint,
                  fmt::format("{}: material '{}' has a picture, but the triangles do not "
                              "say where they lie in it ({})",
                              primitive.path, shown(whole_.paints[paint].name), coordinates));
    for (const std::uint64_t c : part.corners)
      if (c >= part.points.size())
        return fail(kMeshFormat, fmt::format("{}: a triangle names vertex {}, but there are {}",
                                             primitive.path, c, part.points.size()));
    if (mode == 4 && part.corners.size() % 3 != 0)
      return fail(kMeshFormat, fmt::format("{}: {} corners are no whole triangles", primitive.path,
                                           part.corners.size()));
    std::vector<std::uint32_t> number;
    number.reserve(part.points.size());
    for (const Vec3& p : part.points) {
      // y is up in a glTF, z in the model frame.
      const Vec3 q = kMillimetresPerMetre * pose.point(p);
      if (!std::isfinite(q.x) || !std::isfinite(q.y) || !std::isfinite(q.z))
        return fail(kMeshFormat,
                    fmt::format("{}: vertex {} is not finite", primitive.path, number.size()));
      if (whole_.mesh.vertices_mm.size() >= kMostVertices)
        return fail(kMeshFormat,
                    fmt::format("{}: more than {} vertices", primitive.path, kMostVertices));
      number.push_back(weld_.number_of({q.x, -q.z, q.y}));
    }
    const std::size_t step = mode == 4 ? 3 : 1;
    for (std::size_t i = 0; i + 2 < part.corners.size(); i += step) {
      const std::size_t first = mode == 6 ? 0 : i;
      std::array<std::uint32_t, 3> t{number[part.corners[first]], number[part.corners[i + 1]],
                                     number[part.corners[i + 2]]};
      const bool turned = pose.mirrors() != (mode == 5 && i % 2 == 1);
      if (turned) std::swap(t[1], t[2]);
      whole_.mesh.triangles.push_back(t);
      if (!looks_) continue;
      whole_.paint_of.push_back(static_cast<std::uint32_t>(paint));
      std::array<std::array<float, 2>, 3> at{kNowhere, kNowhere, kNowhere};
      if (!part.at.empty()) {
        const std::array<std::uint64_t, 3> corner{part.corners[first], part.corners[i + 1],
                                                  part.corners[i + 2]};
        for (std::size_t k = 0; k < 3; ++k)
          at[k] = bent(uses_[paint], part.at[corner[k]][0], part.at[corner[k]][1]);
      }
      if (turned) std::swap(at[1], at[2]);
      whole_.at_corner.push_back(at);
    }
    return {};
  }

  Result<void> walk_nodes() {
    const Node nodes = root_.at("nodes");
    struct Visit {
      std::size_t node;
      Affine parent;
    };
    std::vector<Visit> todo;
    std::vector<bool> seen(nodes.size(), false);
    const auto add = [&](const Node& list, const Affine& parent) -> Result<void> {
      for (std::size_t i = list.size(); i-- > 0;) {  // the first comes out of the stack first
        MAQUETTE_TRY(const std::uint64_t n, whole(list.at(i)));
        if (n >= nodes.size() || seen[n])
          return bad(list.at(i), "a node that is there and has no other parent");
        seen[n] = true;
        todo.push_back({static_cast<std::size_t>(n), parent});
      }
      return {};
    };
    MAQUETTE_TRY(const std::uint64_t scene, whole(root_.at("scene"), 0));
    MAQUETTE_TRY_VOID(
        add(root_.at("scenes").at(static_cast<std::size_t>(scene)).at("nodes"), Affine{}));
    while (!todo.empty()) {
      const Visit here = todo.back();
      todo.pop_back();
      const Node node = nodes.at(here.node);
      MAQUETTE_TRY(const Affine own, pose_of(node));
      const Affine pose = here.parent * own;
      if (node.at("mesh").given()) {
        MAQUETTE_TRY(const Node mesh, element(root_.at("meshes"), node.at("mesh")));
        const Node primitives = mesh.at("primitives");
        for (std::size_t i = 0; i < primitives.size(); ++i)
          MAQUETTE_TRY_VOID(add_primitive(primitives.at(i), pose));
      }
      MAQUETTE_TRY_VOID(add(node.at("children"), pose));
    }
    return {};
  }

  /// Either bytes of the file itself or bytes that had to be made.
  class Buffer {
   public:
    explicit Buffer(std::string_view of_file) : of_file_(of_file) {}
    explicit Buffer(std::string own) : own_(std::move(own)), is_own_(true) {}
    [[nodiscard]] std::string_view bytes() const { return is_own_ ? own_ : of_file_; }

   private:
    std::string own_;
    std::string_view of_file_;
    bool is_own_ = false;
  };

  static constexpr std::array<float, 2> kNowhere{NAN, NAN};

  std::filesystem::path folder_;
  bool looks_;
  const RunContext& run_;
  Json json_;
  Node root_;
  std::string_view chunk_;
  std::vector<Buffer> buffers_;
  PaintedMesh whole_;
  std::vector<PictureUse> uses_;  ///< by paint
  std::optional<std::size_t> plain_paint_;
  Welder weld_;
};

}  // namespace

bool looks_like_gltf(std::string_view bytes) {
  const std::size_t first = bytes.find_first_not_of(" \t\r\n");
  return bytes.starts_with("glTF") || (first != std::string_view::npos && bytes[first] == '{');
}

Result<PaintedMesh> read_gltf(std::string_view bytes, const std::filesystem::path& folder,
                              bool looks, const RunContext& run) {
  try {
    return GltfReader(folder, looks, run).read(bytes);
  } catch (const std::bad_alloc&) {  // Draco believes the counts of a damaged file
    return fail(kMeshFormat, "its packed triangles do not fit into memory; the file is damaged");
  }
}

}  // namespace maquette::meshing::detail
