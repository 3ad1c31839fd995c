#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>

#include "realtime/base/units.hpp"
#include "telemetry/monitor/codec/peers/lattice.hpp"

namespace fathom::peers {
namespace {

constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
constexpr int kMostBits = 18;

// Draco's bytes of the lattice's mesh with `positions` as its vertices, of Draco's type `type`; edgebreaker
// at its slowest and smallest setting. `bits`: of quantisation, 0 for none. Empty when Draco fails.
template <typename Value>
std::vector<char> encodeMesh(const Mesh& mesh, draco::DataType type,
                             const std::vector<std::array<Value, 3>>& positions, int bits) {
  draco::Mesh out;
  const auto points = static_cast<std::uint32_t>(positions.size());
  out.set_num_points(points);
  draco::GeometryAttribute form;
  form.Init(draco::GeometryAttribute::POSITION, nullptr, 3, type, false, 3 * sizeof(Value), 0);
  const int position = out.AddAttribute(form, true, points);
  for (std::uint32_t k = 0; k < points; ++k)
    out.attribute(position)->SetAttributeValue(draco::AttributeValueIndex(k), positions[k].data());
  for (const auto& triangle : mesh.triangles) {
    draco::Mesh::Face face;
    for (std::size_t c = 0; c < 3; ++c) face[c] = triangle[c];
    out.AddFace(face);
  }
  draco::ExpertEncoder encoder(out);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(0, 0);
  if (bits > 0) encoder.SetAttributeQuantization(position, bits);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeToBuffer(&buffer).ok()) return {};
  return {buffer.data(), buffer.data() + buffer.size()};
}

// Heights at the nodes, each by the vertex at it.
std::optional<std::vector<float>> decodedHeights(const Lattice& lattice, const std::vector<char>& bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return std::nullopt;
  const draco::Mesh& mesh = *decoded.value();
  const draco::PointAttribute& position = *mesh.GetNamedAttribute(draco::GeometryAttribute::POSITION);
  std::vector<float> depth(lattice.depth.size(), kNothing);
  for (std::uint32_t k = 0; k < mesh.num_points(); ++k) {
    Eigen::Vector3f v;
    position.GetMappedValue(draco::PointIndex(k), v.data());
    const long i = std::lround(static_cast<double>(v.x()) / lattice.cell),
               j = std::lround(static_cast<double>(v.y()) / lattice.cell);
    if (i < 0 || j < 0 || i >= lattice.rows || j >= lattice.cols) continue;
    depth[lattice.at(static_cast<int>(i), static_cast<int>(j))] = v.z();
  }
  return depth;
}

// Nodes that a mesh of the lattice has: those that a triangle touches.
Lattice meshed(const Lattice& lattice, const Mesh& mesh) {
  Lattice out = lattice;
  std::vector<bool> used(mesh.vertices.size(), false);
  for (const auto& t : mesh.triangles)
    for (const std::uint32_t v : t) used[v] = true;
  std::size_t v = 0;
  for (float& z : out.depth)
    if (!std::isnan(z) && !used[v++]) z = kNothing;
  return out;
}

}  // namespace

PeerResult dracoGrid(const Lattice& lattice, double max_error) {
  PeerResult best{"Draco grid", "", 0, 0, 0, 0, 0};
  const Mesh mesh = latticeMesh(lattice);
  const Lattice wanted = meshed(lattice, mesh);
  std::vector<std::array<float, 3>> positions;
  for (const Eigen::Vector3f& v : mesh.vertices) positions.push_back({v.x(), v.y(), v.z()});
  for (int bits = 4; bits <= kMostBits; ++bits) {
    const auto start = std::chrono::steady_clock::now();
    const auto bytes = encodeMesh(mesh, draco::DT_FLOAT32, positions, bits);
    const double ms = 1e3 * rt::secondsSince(start);
    const auto depth = bytes.empty() ? std::nullopt : decodedHeights(lattice, bytes);
    if (!depth) continue;
    const Errors e = errors(wanted, *depth);
    if (e.max > max_error || (best.bytes > 0 && bytes.size() >= best.bytes)) continue;
    best = {best.name, std::to_string(bits) + " bit", bytes.size(), e.max, e.rms, ms, e.nodes};
  }
  return best;
}

PeerResult dracoWholeNumbers(const Lattice& lattice, double max_error) {
  PeerResult best{"Draco grid, whole numbers", "", 0, 0, 0, 0, 0};
  const Mesh mesh = latticeMesh(lattice);
  std::vector<float> depth(lattice.depth.size(), kNothing);
  const double step = 2 * max_error * (1 - 1e-6);  // a little less, for the float's own rounding
  std::vector<std::array<std::int32_t, 3>> positions;
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    const Eigen::Vector3d v = vertex.cast<double>();
    const auto& whole =
        positions.emplace_back(std::array{static_cast<std::int32_t>(std::lround(v.x() / lattice.cell)),
                                          static_cast<std::int32_t>(std::lround(v.y() / lattice.cell)),
                                          static_cast<std::int32_t>(std::lround(v.z() / step))});
    depth[lattice.at(whole[0], whole[1])] = static_cast<float>(whole[2] * step);
  }
  const auto start = std::chrono::steady_clock::now();
  const auto bytes = encodeMesh(mesh, draco::DT_INT32, positions, 0);
  if (bytes.empty()) return best;
  const double ms = 1e3 * rt::secondsSince(start);
  const Errors e = errors(meshed(lattice, mesh), depth);
  return {best.name, "steps of twice the error", bytes.size(), e.max, e.rms, ms, e.nodes};
}

}  // namespace fathom::peers
