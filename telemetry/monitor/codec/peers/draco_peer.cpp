#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <array>
#include <chrono>
#include <cmath>
#include <limits>

#include "telemetry/monitor/codec/peers/lattice.hpp"
#include "telemetry/tiles/draco_mesh.hpp"

namespace fathom::peers {
namespace {

constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
constexpr int kMostBits = 18;

double since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// Heights at the nodes by the nearest vertex: for a mesh that has every node as a vertex.
std::vector<float> byVertex(const Lattice& lattice, const Mesh& mesh) {
  std::vector<float> depth(lattice.depth.size(), kNothing);
  for (const Eigen::Vector3f& v : mesh.vertices) {
    const long i = std::lround(static_cast<double>(v.x()) / lattice.cell),
               j = std::lround(static_cast<double>(v.y()) / lattice.cell);
    if (i < 0 || j < 0 || i >= lattice.rows || j >= lattice.cols) continue;
    depth[lattice.at(static_cast<int>(i), static_cast<int>(j))] = v.z();
  }
  return depth;
}

// Heights at the nodes by the triangles over them.
std::vector<float> byTriangle(const Lattice& lattice, const Mesh& mesh) {
  std::vector<float> depth(lattice.depth.size(), kNothing);
  for (const auto& triangle : mesh.triangles) {
    std::array<Eigen::Vector3d, 3> p;
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = mesh.vertices[triangle[k]].cast<double>();
      p[k].head<2>() /= lattice.cell;
    }
    const auto cross = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b, double x, double y) {
      return (b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x());
    };
    const double area = cross(p[0], p[1], p[2].x(), p[2].y());
    if (!(std::abs(area) > 0)) continue;
    const auto [x0, x1] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
    const auto [y0, y1] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
    // The rim's nodes may lie just outside of a rounded rim: a hundredth of a triangle's size is let pass.
    constexpr double kRim = -0.01;
    for (int i = std::max(0, static_cast<int>(std::ceil(x0 - 0.1)));
         i <= std::min<double>(lattice.rows - 1, x1 + 0.1); ++i) {
      for (int j = std::max(0, static_cast<int>(std::ceil(y0 - 0.1)));
           j <= std::min<double>(lattice.cols - 1, y1 + 0.1); ++j) {
        const double a = cross(p[1], p[2], i, j) / area, b = cross(p[2], p[0], i, j) / area, c = 1 - a - b;
        if (std::min({a, b, c}) < kRim) continue;
        depth[lattice.at(i, j)] = static_cast<float>(a * p[0].z() + b * p[1].z() + c * p[2].z());
      }
    }
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
  for (int bits = 4; bits <= kMostBits; ++bits) {
    const auto start = std::chrono::steady_clock::now();
    const auto bytes = telemetry::encodeDracoMesh(mesh, {.position_bits = bits, .colour_bits = 0});
    const double ms = since(start);
    const auto got = bytes ? telemetry::decodeDracoMesh(*bytes) : std::nullopt;
    if (!got) continue;
    // Draco's places are relative to the least corner, as the lattice's are.
    const Errors e = errors(wanted, byVertex(lattice, *got));
    if (e.max > max_error || (best.bytes > 0 && bytes->size() >= best.bytes)) continue;
    best = {best.name, std::to_string(bits) + " bit", bytes->size(), e.max, e.rms, ms, e.nodes};
  }
  return best;
}

PeerResult dracoWholeNumbers(const Lattice& lattice, double max_error) {
  PeerResult best{"Draco grid, whole numbers", "", 0, 0, 0, 0, 0};
  const Mesh mesh = latticeMesh(lattice);
  const Lattice wanted = meshed(lattice, mesh);
  draco::Mesh out;
  const auto points = static_cast<std::uint32_t>(mesh.vertices.size());
  out.set_num_points(points);
  draco::GeometryAttribute form;
  form.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_INT32, false, 3 * sizeof(std::int32_t),
            0);
  const int position = out.AddAttribute(form, true, points);
  std::vector<float> depth(lattice.depth.size(), kNothing);
  const double step = 2 * max_error * (1 - 1e-6);  // a little less, for the float's own rounding
  for (std::uint32_t k = 0; k < points; ++k) {
    const Eigen::Vector3d v = mesh.vertices[k].cast<double>();
    const std::array<std::int32_t, 3> whole{static_cast<std::int32_t>(std::lround(v.x() / lattice.cell)),
                                            static_cast<std::int32_t>(std::lround(v.y() / lattice.cell)),
                                            static_cast<std::int32_t>(std::lround(v.z() / step))};
    out.attribute(position)->SetAttributeValue(draco::AttributeValueIndex(k), whole.data());
    depth[lattice.at(whole[0], whole[1])] = static_cast<float>(whole[2] * step);
  }
  for (const auto& triangle : mesh.triangles) {
    draco::Mesh::Face face;
    for (std::size_t c = 0; c < 3; ++c) face[c] = triangle[c];
    out.AddFace(face);
  }
  const auto start = std::chrono::steady_clock::now();
  draco::ExpertEncoder encoder(out);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(0, 0);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeToBuffer(&buffer).ok()) return best;
  const Errors e = errors(wanted, depth);
  return {best.name, "steps of twice the error", buffer.size(), e.max, e.rms, since(start), e.nodes};
}

PeerResult dracoSimplified(const Lattice& lattice, double max_error) {
  PeerResult best{"Draco simplified", "", 0, 0, 0, 0, 0};
  const Mesh full = latticeMesh(filled(lattice));
  const std::size_t mask = maskBytes(lattice);
  constexpr double kShrink = 0.9;
  std::size_t failures = 0;
  for (auto vertices = static_cast<double>(full.vertices.size()); vertices >= 4 && failures < 4;
       vertices *= kShrink) {
    const auto start = std::chrono::steady_clock::now();
    const Mesh mesh = simplify(full, static_cast<std::size_t>(vertices));
    const double simplify_ms = since(start);
    // Without quantisation: once simplification itself breaks the error, fewer vertices will not help.
    if (errors(lattice, byTriangle(lattice, mesh)).max > max_error) {
      ++failures;
      continue;
    }
    failures = 0;
    for (int bits = 5; bits <= kMostBits; ++bits) {
      const auto begin = std::chrono::steady_clock::now();
      const auto bytes = telemetry::encodeDracoMesh(mesh, {.position_bits = bits, .colour_bits = 0});
      const double ms = since(begin) + simplify_ms;
      if (!bytes || (best.bytes > 0 && bytes->size() + mask >= best.bytes)) break;  // more bits, more bytes
      const auto got = telemetry::decodeDracoMesh(*bytes);
      if (!got) continue;
      const Errors e = errors(lattice, byTriangle(lattice, *got));
      if (e.max > max_error) continue;
      best = {best.name,
              std::to_string(mesh.vertices.size()) + " vertices, " + std::to_string(bits) + " bit, mask " +
                  std::to_string(mask) + " B",
              bytes->size() + mask,
              e.max,
              e.rms,
              ms,
              e.nodes};
      break;
    }
  }
  return best;
}

}  // namespace fathom::peers
