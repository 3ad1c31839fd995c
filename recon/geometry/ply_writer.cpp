#include "recon/geometry/ply_writer.hpp"

#include <bit>
#include <cstdint>
#include <cstring>
#include <ostream>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace fathom {
namespace {

static_assert(std::endian::native == std::endian::little,
              "the PLY writer writes native little-endian floats");

constexpr std::size_t kFlushBytes = 1 << 20;

PlyAttributes attributesOf(const Mesh& mesh) {
  const std::size_t n = mesh.vertices.size();
  return {mesh.normals.size() == n, mesh.colours.size() == n, mesh.texture_coordinates.size() == n,
          mesh.sigma.size() == n};
}

std::string headerOf(std::uint64_t vertices, std::uint64_t triangles, const PlyAttributes& with,
                     const std::vector<std::string>& comments) {
  std::ostringstream header;
  header << "ply\nformat binary_little_endian 1.0\n";
  for (const std::string& comment : comments) header << "comment " << comment << '\n';
  header << "element vertex " << vertices << "\nproperty float x\nproperty float y\nproperty float z\n";
  if (with.normals) header << "property float nx\nproperty float ny\nproperty float nz\n";
  if (with.colours) header << "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (with.texture) header << "property float s\nproperty float t\n";
  if (with.sigma) header << "property float sigma\n";
  header << "element face " << triangles << "\nproperty list uchar int vertex_indices\nend_header\n";
  return header.str();
}

template <typename T>
void put(std::string& out, const T& value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  out.append(raw, sizeof value);
}

void flush(std::string& buffer, std::ostream& stream, std::size_t limit = 0) {
  if (buffer.size() < limit) return;
  stream.write(buffer.data(), static_cast<std::streamsize>(buffer.size()));
  buffer.clear();
}

void writeVertices(std::ostream& stream, const Mesh& mesh, const PlyAttributes& with) {
  std::string buffer;
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    for (int k = 0; k < 3; ++k) put(buffer, mesh.vertices[i][k]);
    if (with.normals)
      for (int k = 0; k < 3; ++k) put(buffer, mesh.normals[i][k]);
    if (with.colours)
      for (const std::uint8_t channel : mesh.colours[i]) put(buffer, channel);
    if (with.texture)
      for (int k = 0; k < 2; ++k) put(buffer, mesh.texture_coordinates[i][k]);
    if (with.sigma) put(buffer, mesh.sigma[i]);
    flush(buffer, stream, kFlushBytes);
  }
  flush(buffer, stream);
}

void writeTriangles(std::ostream& stream, const Mesh& mesh) {
  std::string buffer;
  for (const auto& triangle : mesh.triangles) {
    put(buffer, std::uint8_t{3});
    for (const std::uint32_t index : triangle) put(buffer, static_cast<std::int32_t>(index));
    flush(buffer, stream, kFlushBytes);
  }
  flush(buffer, stream);
}

}  // namespace

void writePly(std::ostream& stream, const Mesh& mesh, const std::vector<std::string>& comments) {
  const PlyAttributes with = attributesOf(mesh);
  stream << headerOf(mesh.vertices.size(), mesh.triangles.size(), with, comments);
  writeVertices(stream, mesh, with);
  writeTriangles(stream, mesh);
}

void writePly(const std::filesystem::path& path, const Mesh& mesh, const std::vector<std::string>& comments) {
  AtomicFile file(path);
  writePly(file.stream(), mesh, comments);
  file.commit();
}

PlyParts::PlyParts(const std::filesystem::path& path, std::vector<std::string> comments)
    : file_(path),
      vertex_file_(path.string() + ".vertices.tmp"),
      triangle_file_(path.string() + ".faces.tmp"),
      comments_(std::move(comments)) {}

void PlyParts::add(const Mesh& part) {
  const PlyAttributes with = attributesOf(part);
  if (vertices_ == 0) with_ = with;
  if (with_.normals > with.normals || with_.colours > with.colours || with_.texture > with.texture ||
      with_.sigma > with.sigma)
    throw std::invalid_argument("a part of a PLY file without an attribute of the first");
  writeVertices(vertex_file_.stream(), part, with_);
  writeTriangles(triangle_file_.stream(), part);
  vertices_ += part.vertices.size();
  triangles_ += part.triangles.size();
  if (vertices_ > INT32_MAX) throw std::runtime_error("a PLY file of more vertices than its indices count");
}

void PlyParts::commit() {
  file_.stream() << headerOf(vertices_, triangles_, with_, comments_);
  vertex_file_.appendTo(file_.stream());
  triangle_file_.appendTo(file_.stream());
  file_.commit();
}

}  // namespace fathom
