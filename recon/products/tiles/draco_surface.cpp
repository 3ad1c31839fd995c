#include "recon/products/tiles/draco_surface.hpp"

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::topside {
namespace {

constexpr int kMaxBits = 24;  // whole numbers that single precision holds exactly
// Of a texture coordinate: quarters of a texel, so that the picture moves less than is seen.
constexpr int kStepsPerTexel = 4;

struct Quantisation {
  int bits = 1;
  float least[3] = {0, 0, 0};
  float range = 0;
};

Quantisation inWholeSteps(const std::vector<Eigen::Vector3f>& positions) {
  Eigen::Vector3f least = positions.front(), greatest = positions.front();
  for (const Eigen::Vector3f& position : positions) {
    if (position.array().round().matrix() != position || !position.allFinite())
      throw std::invalid_argument("a vertex that stands on no whole step");
    least = least.cwiseMin(position);
    greatest = greatest.cwiseMax(position);
  }
  const double extent = (greatest.cast<double>() - least.cast<double>()).maxCoeff();
  Quantisation found;
  while (extent > std::ldexp(1.0, found.bits) - 1) ++found.bits;
  if (found.bits > kMaxBits) throw std::invalid_argument("a surface too wide for its steps");
  std::copy(least.begin(), least.end(), found.least);
  found.range = static_cast<float>(std::ldexp(1.0, found.bits) - 1);
  return found;
}

int bitsFor(double steps) {
  int bits = 1;
  while (bits < 30 && std::ldexp(1.0, bits) - 1 < steps) ++bits;
  return bits;
}

// Adds an attribute of `count` values of `components` numbers that are densely at `values`.
int add(draco::Mesh& mesh, draco::GeometryAttribute::Type type, int components, draco::DataType data,
        bool normalised, const void* values, std::size_t count) {
  draco::GeometryAttribute form;
  const auto stride = static_cast<std::int64_t>(components) * draco::DataTypeLength(data);
  form.Init(type, nullptr, static_cast<std::uint8_t>(components), data, normalised, stride, 0);
  const int id = mesh.AddAttribute(form, true, static_cast<std::uint32_t>(count));
  mesh.attribute(id)->buffer()->Write(0, values, static_cast<std::size_t>(stride) * count);
  return id;
}

// Edgebreaker spends about two bits on a triangle; long regular runs can take it to a fraction of one.
constexpr std::size_t kTrianglesPerByte = 64;

bool countsBounded(std::span<const std::uint8_t> bytes) {
  const std::optional<DracoCounts> counts = dracoCounts(bytes);
  const std::size_t most = kTrianglesPerByte * bytes.size();
  return counts && counts->vertices <= most && counts->faces <= most;
}

// Reads an attribute's values of all points; false where the file has another kind of attribute there.
template <typename Number, int kComponents, typename Value>
bool take(const draco::Mesh& mesh, int id, std::vector<Value>& values) {
  if (id < 0) return true;
  const draco::PointAttribute* attribute = mesh.GetAttributeByUniqueId(static_cast<std::uint32_t>(id));
  if (attribute == nullptr || attribute->num_components() != kComponents) return false;
  values.resize(mesh.num_points());
  for (std::uint32_t k = 0; k < mesh.num_points(); ++k) {
    Number numbers[kComponents];
    if (!attribute->ConvertValue<Number, kComponents>(attribute->mapped_index(draco::PointIndex(k)), numbers))
      return false;
    for (const Number number : numbers)
      if (!std::isfinite(static_cast<double>(number))) return false;
    if constexpr (kComponents == 1)
      values[k] = numbers[0];
    else
      for (int c = 0; c < kComponents; ++c) values[k][static_cast<std::size_t>(c)] = numbers[c];
  }
  return true;
}

std::optional<FileSurface> decode(std::span<const std::uint8_t> bytes, const SurfaceIds& ids) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return std::nullopt;
  const draco::Mesh& mesh = *decoded.value();
  FileSurface surface;
  if (ids.position < 0 || mesh.num_points() == 0 || mesh.num_faces() == 0 ||
      !take<float, 3>(mesh, ids.position, surface.positions) ||
      !take<float, 3>(mesh, ids.normal, surface.normals) ||
      !take<std::uint16_t, 3>(mesh, ids.colour, surface.colours) ||
      !take<float, 2>(mesh, ids.texture, surface.texture_coordinates) ||
      !take<float, 1>(mesh, ids.sigma, surface.sigma) ||
      !take<std::uint16_t, 1>(mesh, ids.views, surface.views))
    return std::nullopt;
  surface.triangles.resize(mesh.num_faces());
  for (std::uint32_t f = 0; f < mesh.num_faces(); ++f) {
    const draco::Mesh::Face& face = mesh.face(draco::FaceIndex(f));
    for (std::size_t c = 0; c < 3; ++c) {
      surface.triangles[f][c] = face[c].value();
      if (face[c].value() >= mesh.num_points()) return std::nullopt;
    }
  }
  return surface;
}

}  // namespace

PackedSurface packSurface(const FileSurface& surface, const DracoConfig& config) {
  if (surface.triangles.empty() || surface.positions.empty())
    throw std::invalid_argument("a surface without triangles");
  const Quantisation positions = inWholeSteps(surface.positions);
  const std::size_t count = surface.positions.size();
  draco::Mesh mesh;
  mesh.set_num_points(static_cast<std::uint32_t>(count));
  PackedSurface packed;
  using Attribute = draco::GeometryAttribute;
  packed.position =
      add(mesh, Attribute::POSITION, 3, draco::DT_FLOAT32, false, surface.positions.data(), count);
  if (surface.normals.size() == count)
    packed.normal = add(mesh, Attribute::NORMAL, 3, draco::DT_FLOAT32, false, surface.normals.data(), count);
  if (surface.colours.size() == count)
    packed.colour = add(mesh, Attribute::COLOR, 3, draco::DT_UINT16, true, surface.colours.data(), count);
  if (config.texture_edge > 0 && surface.texture_coordinates.size() == count)
    packed.texture = add(mesh, Attribute::TEX_COORD, 2, draco::DT_FLOAT32, false,
                         surface.texture_coordinates.data(), count);
  if (surface.sigma.size() == count)
    packed.sigma = add(mesh, Attribute::GENERIC, 1, draco::DT_FLOAT32, false, surface.sigma.data(), count);
  if (surface.views.size() == count)
    packed.views = add(mesh, Attribute::GENERIC, 1, draco::DT_UINT16, false, surface.views.data(), count);
  for (const auto& triangle : surface.triangles) {
    draco::Mesh::Face face;
    for (std::size_t c = 0; c < 3; ++c) {
      if (triangle[c] >= count) throw std::invalid_argument("a triangle of a vertex that is not there");
      face[c] = triangle[c];
    }
    mesh.AddFace(face);
  }
  // Charts' seams double vertices: their positions become one again, so that connectivity is coded once.
  if (!mesh.DeduplicateAttributeValues()) throw std::runtime_error("Draco cannot join equal values");
  mesh.DeduplicatePointIds();

  draco::ExpertEncoder encoder(mesh);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(config.speed, config.speed);
  encoder.SetTrackEncodedProperties(true);
  encoder.SetAttributeExplicitQuantization(packed.position, positions.bits, 3, positions.least,
                                           positions.range);
  if (packed.normal >= 0) encoder.SetAttributeQuantization(packed.normal, config.normal_bits);
  if (packed.texture >= 0) {
    const float zero[2] = {0, 0};
    encoder.SetAttributeExplicitQuantization(
        packed.texture, bitsFor(static_cast<double>(config.texture_edge) * kStepsPerTexel), 2, zero, 1.0F);
  }
  if (packed.sigma >= 0) {
    const float zero = 0;
    const float most = *std::max_element(surface.sigma.begin(), surface.sigma.end());
    const int bits = std::min(bitsFor(static_cast<double>(most) / config.sigma_step), 16);
    encoder.SetAttributeExplicitQuantization(
        packed.sigma, bits, 1, &zero,
        std::max(most, static_cast<float>((std::ldexp(1.0, bits) - 1) * config.sigma_step)));
  }
  draco::EncoderBuffer buffer;
  const draco::Status status = encoder.EncodeToBuffer(&buffer);
  if (!status.ok()) throw std::runtime_error("Draco: " + status.error_msg_string());
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(buffer.data());
  packed.bytes.assign(bytes, bytes + buffer.size());
  packed.vertices = encoder.num_encoded_points();
  packed.triangles = encoder.num_encoded_faces();
  return packed;
}

FileSurface unpackSurface(std::span<const std::uint8_t> bytes, const SurfaceIds& ids,
                          const std::string& name) {
  if (!countsBounded(bytes)) throw InputError(name, "Draco data", "is damaged, or not a mesh by edgebreaker");
  std::optional<FileSurface> surface;
  try {
    surface = decode(bytes, ids);
  } catch (const std::exception&) {  // out of memory, or a length that Draco did not check
    surface.reset();
  }
  if (!surface) throw InputError(name, "Draco data", "is damaged, or lacks an attribute that is named");
  return std::move(*surface);
}

}  // namespace fathom::topside
