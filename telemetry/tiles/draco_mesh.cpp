#include "telemetry/tiles/draco_mesh.hpp"

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <optional>

#include "recon/geometry/draco_counts.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kFacesPerVertex = 4;  // allowed; a surface has two

bool countsBounded(std::span<const std::uint8_t> bytes, std::size_t max_vertices) {
  const std::optional<DracoCounts> counts = dracoCounts(bytes);
  return counts && counts->vertices <= max_vertices && counts->faces <= max_vertices * kFacesPerVertex;
}

// Bits that quantise `extent` in steps of 2 * max_error or less; 0 if more than 30 are needed.
int bitsFor(double extent, double max_error) {
  int bits = 1;
  while (bits <= 30 && extent / (std::ldexp(1.0, bits) - 1) > 2 * max_error) ++bits;
  return bits <= 30 ? bits : 0;
}

std::optional<std::vector<std::uint8_t>> encodeUnchecked(const Mesh& mesh, const DracoMeshConfig& config,
                                                         int bits) {
  draco::Mesh out;
  const auto points = static_cast<std::uint32_t>(mesh.vertices.size());
  out.set_num_points(points);
  draco::GeometryAttribute form;
  form.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_FLOAT32, false, 3 * sizeof(float), 0);
  const int position = out.AddAttribute(form, true, points);
  int colour = -1;
  if (config.colour_bits > 0 && !mesh.colours.empty()) {
    form.Init(draco::GeometryAttribute::COLOR, nullptr, 3, draco::DT_UINT8, true, 3, 0);
    colour = out.AddAttribute(form, true, points);
  }
  for (std::uint32_t k = 0; k < points; ++k) {
    const draco::AttributeValueIndex index(k);
    out.attribute(position)->SetAttributeValue(index, mesh.vertices[k].data());
    if (colour < 0) continue;
    Rgb rgb = mesh.colours[k];
    for (std::uint8_t& channel : rgb) {  // the top bits, repeated below so that white stays white
      const int shift = 8 - config.colour_bits;
      const int top = channel >> shift << shift;
      channel = static_cast<std::uint8_t>(top | top >> config.colour_bits);
    }
    out.attribute(colour)->SetAttributeValue(index, rgb.data());
  }
  for (const auto& triangle : mesh.triangles) {
    draco::Mesh::Face face;
    for (std::size_t c = 0; c < 3; ++c) face[c] = triangle[c];
    out.AddFace(face);
  }
  draco::ExpertEncoder encoder(out);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(0, 0);
  encoder.SetAttributeQuantization(position, bits);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeToBuffer(&buffer).ok()) return std::nullopt;
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(buffer.data());
  return std::vector<std::uint8_t>(bytes, bytes + buffer.size());
}

std::optional<Mesh> decodeUnchecked(std::span<const std::uint8_t> bytes, std::size_t max_vertices) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return std::nullopt;
  const draco::Mesh& in = *decoded.value();
  const draco::PointAttribute* position = in.GetNamedAttribute(draco::GeometryAttribute::POSITION);
  if (position == nullptr || position->num_components() != 3 || in.num_points() == 0 ||
      in.num_points() > max_vertices * kFacesPerVertex)
    return std::nullopt;
  const draco::PointAttribute* colour = in.GetNamedAttribute(draco::GeometryAttribute::COLOR);
  if (colour != nullptr && (colour->num_components() != 3 || colour->data_type() != draco::DT_UINT8))
    return std::nullopt;
  Mesh mesh;
  mesh.vertices.resize(in.num_points());
  if (colour != nullptr) mesh.colours.resize(in.num_points());
  for (std::uint32_t k = 0; k < in.num_points(); ++k) {
    const draco::PointIndex point(k);
    if (!position->ConvertValue<float, 3>(position->mapped_index(point), mesh.vertices[k].data()) ||
        !mesh.vertices[k].allFinite())
      return std::nullopt;
    if (colour != nullptr) colour->GetMappedValue(point, mesh.colours[k].data());
  }
  for (std::uint32_t f = 0; f < in.num_faces(); ++f) {
    const draco::Mesh::Face& face = in.face(draco::FaceIndex(f));
    std::array<std::uint32_t, 3> triangle{};
    for (std::size_t c = 0; c < 3; ++c) {
      triangle[c] = face[c].value();
      if (triangle[c] >= in.num_points()) return std::nullopt;
    }
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

}  // namespace

std::optional<std::vector<std::uint8_t>> encodeDracoMesh(const Mesh& mesh, const DracoMeshConfig& config) {
  if (mesh.triangles.empty() || mesh.vertices.empty() || mesh.vertices.size() > config.max_vertices ||
      config.colour_bits < 0 || config.colour_bits > 8 || config.position_bits < 0 ||
      config.position_bits > 30)
    return std::nullopt;
  Eigen::Vector3f least = mesh.vertices[0], greatest = mesh.vertices[0];
  for (const Eigen::Vector3f& v : mesh.vertices) {
    if (!v.allFinite()) return std::nullopt;
    least = least.cwiseMin(v);
    greatest = greatest.cwiseMax(v);
  }
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t k : triangle)
      if (k >= mesh.vertices.size()) return std::nullopt;
  const int bits = config.position_bits > 0
                       ? config.position_bits
                       : bitsFor(static_cast<double>((greatest - least).maxCoeff()), config.max_error);
  if (bits == 0 || (config.position_bits == 0 && !(config.max_error > 0))) return std::nullopt;
  try {
    return encodeUnchecked(mesh, config, bits);
  } catch (const std::exception&) {  // out of memory
    return std::nullopt;
  }
}

std::optional<Mesh> decodeDracoMesh(std::span<const std::uint8_t> bytes, std::size_t max_vertices) {
  if (!countsBounded(bytes, max_vertices)) return std::nullopt;
  try {
    return decodeUnchecked(bytes, max_vertices);
  } catch (const std::exception&) {  // out of memory, or a length that Draco did not check
    return std::nullopt;
  }
}

}  // namespace fathom::telemetry
