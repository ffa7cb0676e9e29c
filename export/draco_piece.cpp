// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/draco_piece.hpp"

#include <exception>
#include <limits>

#include <draco/compression/encode.h>
#include <draco/core/quantization_utils.h>
#include <draco/mesh/mesh.h>
#include <fmt/format.h>

#include "export/cad.hpp"

namespace maquette::exporting {
namespace {

/// The vertices that a piece uses, in their own order, and the way there.
struct Selection {
  std::uint32_t first = 0;
  std::vector<std::uint32_t> local;   ///< by vertex number - first
  std::vector<std::uint32_t> global;  ///< by local number
};

Selection select(std::span<const std::array<std::uint32_t, 3>> piece) {
  std::uint32_t lowest = std::numeric_limits<std::uint32_t>::max(), highest = 0;
  for (const auto& t : piece)
    for (const std::uint32_t v : t) lowest = std::min(lowest, v), highest = std::max(highest, v);
  Selection s;
  s.first = lowest;
  constexpr std::uint32_t kUnused = ~std::uint32_t{0};
  s.local.assign(std::size_t{highest - lowest} + 1, kUnused);
  for (const auto& t : piece)
    for (const std::uint32_t v : t) s.local[v - lowest] = 0;
  for (std::size_t i = 0; i < s.local.size(); ++i) {
    if (s.local[i] == kUnused) continue;
    s.local[i] = static_cast<std::uint32_t>(s.global.size());
    s.global.push_back(lowest + static_cast<std::uint32_t>(i));
  }
  return s;
}

template <std::size_t Size>
int add_attribute(draco::Mesh& mesh, draco::GeometryAttribute::Type type,
                  std::span<const std::array<float, Size>> values,
                  const std::vector<std::uint32_t>& which) {
  draco::GeometryAttribute attribute;
  attribute.Init(type, nullptr, Size, draco::DT_FLOAT32, false, sizeof(values[0]), 0);
  const int id = mesh.AddAttribute(attribute, true, static_cast<std::uint32_t>(which.size()));
  for (std::uint32_t i = 0; i < which.size(); ++i)
    mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), values[which[i]].data());
  return id;
}

/// What the decoder's arithmetic makes of a coordinate, with Draco's own classes.
class Rounding {
 public:
  explicit Rounding(const PositionGrid& grid) : origin_(grid.origin) {
    const auto steps = static_cast<std::int32_t>((std::uint32_t{1} << grid.bits) - 1);
    forth_.Init(grid.range, steps);
    back_.Init(grid.range, steps);
  }
  [[nodiscard]] float operator()(float value, std::size_t axis) const {
    return back_.DequantizeFloat(forth_.QuantizeFloat(value - origin_[axis])) + origin_[axis];
  }

 private:
  Float3 origin_;
  draco::Quantizer forth_;
  draco::Dequantizer back_;
};

using Double3 = std::array<double, 3>;

Double3 area_vector(const std::array<Float3, 3>& t) {
  Double3 a{}, b{};
  for (std::size_t k = 0; k < 3; ++k) {
    a[k] = static_cast<double>(t[1][k]) - static_cast<double>(t[0][k]);
    b[k] = static_cast<double>(t[2][k]) - static_cast<double>(t[0][k]);
  }
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

void count_spoilt(std::span<const Float3> positions,
                  std::span<const std::array<std::uint32_t, 3>> piece, const Rounding& rounding,
                  DracoPiece& result) {
  for (const auto& corners : piece) {
    std::array<Float3, 3> before{}, after{};
    for (std::size_t i = 0; i < 3; ++i) {
      before[i] = positions[corners[i]];
      for (std::size_t axis = 0; axis < 3; ++axis) after[i][axis] = rounding(before[i][axis], axis);
    }
    const Double3 a = area_vector(before), b = area_vector(after);
    if (b == Double3{}) ++result.flat;
    if (a[0] * b[0] + a[1] * b[1] + a[2] * b[2] < 0.0) ++result.turned;
  }
}

}  // namespace

Result<DracoPiece> draco_piece(std::span<const Float3> positions, std::span<const Float3> normals,
                               std::span<const std::array<std::uint32_t, 3>> piece,
                               const PositionGrid& grid, const DracoSettings& settings,
                               const DracoTexture& texture) try {
  const Selection selection = select(piece);
  draco::Mesh mesh;
  mesh.set_num_points(static_cast<std::uint32_t>(selection.global.size()));
  mesh.SetNumFaces(piece.size());
  for (std::uint32_t i = 0; i < piece.size(); ++i) {
    draco::Mesh::Face face;
    for (std::size_t k = 0; k < 3; ++k)
      face[k] = draco::PointIndex(selection.local[piece[i][k] - selection.first]);
    mesh.SetFace(draco::FaceIndex(i), face);
  }
  const int position =
      add_attribute(mesh, draco::GeometryAttribute::POSITION, positions, selection.global);
  const int normal = normals.empty() ? -1
                                     : add_attribute(mesh, draco::GeometryAttribute::NORMAL,
                                                     normals, selection.global);
  const int picture = texture.values.empty()
                          ? -1
                          : add_attribute(mesh, draco::GeometryAttribute::TEX_COORD, texture.values,
                                          selection.global);

  int tangent = -1;
  if (texture.tangent) {
    draco::GeometryAttribute attribute;
    attribute.Init(draco::GeometryAttribute::GENERIC, nullptr, 4, draco::DT_FLOAT32, false,
                   sizeof *texture.tangent, 0);
    tangent =
        mesh.AddAttribute(attribute, true, static_cast<std::uint32_t>(selection.global.size()));
    for (std::uint32_t i = 0; i < selection.global.size(); ++i)
      mesh.attribute(tangent)->SetAttributeValue(draco::AttributeValueIndex(i),
                                                 texture.tangent->data());
  }

  DracoPiece result;
  result.position_id = mesh.attribute(position)->unique_id();
  if (normal >= 0) result.normal_id = mesh.attribute(normal)->unique_id();
  if (picture >= 0) result.texture_id = mesh.attribute(picture)->unique_id();
  if (tangent >= 0) result.tangent_id = mesh.attribute(tangent)->unique_id();
  result.min.fill(std::numeric_limits<float>::infinity());
  result.max.fill(-std::numeric_limits<float>::infinity());
  for (const std::uint32_t v : selection.global)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      result.min[axis] = std::min(result.min[axis], positions[v][axis]);
      result.max[axis] = std::max(result.max[axis], positions[v][axis]);
    }
  const Rounding rounding(grid);  // monotone: the extremes stay extremes
  for (std::size_t axis = 0; axis < 3; ++axis) {
    result.min[axis] = rounding(result.min[axis], axis);
    result.max[axis] = rounding(result.max[axis], axis);
  }
  count_spoilt(positions, piece, rounding, result);

  draco::Encoder encoder;
  encoder.SetSpeedOptions(settings.speed, settings.speed);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetAttributeExplicitQuantization(draco::GeometryAttribute::POSITION, grid.bits, 3,
                                           grid.origin.data(), grid.range);
  encoder.SetAttributeQuantization(draco::GeometryAttribute::NORMAL, settings.normal_bits);
  // What is flat over the mesh is predicted by parallelograms, not from the relief.
  if (settings.normals_alike)
    encoder.SetAttributePredictionScheme(draco::GeometryAttribute::NORMAL,
                                         draco::PREDICTION_DIFFERENCE);
  if (picture >= 0) {
    constexpr Float2 kOrigin{};
    encoder.SetAttributeExplicitQuantization(draco::GeometryAttribute::TEX_COORD, texture.bits, 2,
                                             kOrigin.data(), texture.range);
    encoder.SetAttributePredictionScheme(draco::GeometryAttribute::TEX_COORD,
                                         draco::MESH_PREDICTION_PARALLELOGRAM);
  }
  if (tangent >= 0) {
    encoder.SetAttributeQuantization(draco::GeometryAttribute::GENERIC, 8);  // one value: exact
    encoder.SetAttributePredictionScheme(draco::GeometryAttribute::GENERIC,
                                         draco::PREDICTION_DIFFERENCE);
  }
  encoder.SetTrackEncodedProperties(true);
  draco::EncoderBuffer buffer;
  const draco::Status status = encoder.EncodeMeshToBuffer(mesh, &buffer);
  if (!status.ok())
    return fail(kLibraryFailed, fmt::format("Draco: {}", status.error_msg_string()));
  result.points = static_cast<std::uint32_t>(encoder.num_encoded_points());
  result.faces = static_cast<std::uint32_t>(encoder.num_encoded_faces());
  result.bytes.assign(buffer.data(), buffer.data() + buffer.size());
  return result;
} catch (const std::bad_alloc&) {
  throw;
} catch (const std::exception& error) {
  return fail(kLibraryFailed, fmt::format("Draco: {}", error.what()));
}

}  // namespace maquette::exporting
