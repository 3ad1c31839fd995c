#include "recon/geometry/ply.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <ostream>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "realtime/base/input_error.hpp"

namespace fathom {
namespace {

enum class Encoding { kAscii, kLittleEndian, kBigEndian };

// A type of a property: how long it is, and its value from bytes in this machine's order.
struct Scalar {
  std::size_t size = 0;
  double (*read)(const unsigned char* raw) = nullptr;
};

template <typename T>
constexpr Scalar scalar() {
  return {sizeof(T), [](const unsigned char* raw) {
            T value;
            std::memcpy(&value, raw, sizeof value);
            return static_cast<double>(value);
          }};
}

bool parseScalar(const std::string& name, Scalar& out) {
  struct Type {
    const char *name, *sized_name;
    Scalar scalar;
  };
  static constexpr Type kTypes[] = {
      {"char", "int8", scalar<std::int8_t>()},    {"uchar", "uint8", scalar<std::uint8_t>()},
      {"short", "int16", scalar<std::int16_t>()}, {"ushort", "uint16", scalar<std::uint16_t>()},
      {"int", "int32", scalar<std::int32_t>()},   {"uint", "uint32", scalar<std::uint32_t>()},
      {"float", "float32", scalar<float>()},      {"double", "float64", scalar<double>()}};
  for (const Type& type : kTypes) {
    if (name != type.name && name != type.sized_name) continue;
    out = type.scalar;
    return true;
  }
  return false;
}

struct Property {
  std::string name;
  Scalar type;
  bool is_list = false;
  Scalar count_type;
};

struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
};

// One file's bytes with a reading position; every failure names file and place.
class Source {
 public:
  Source(const std::filesystem::path& path, std::string bytes) : path_(path), bytes_(std::move(bytes)) {}

  [[noreturn]] void fail(const std::string& fix) const {
    throw InputError(path_, place_.empty() ? "byte " + std::to_string(position_) : place_, fix);
  }
  void setPlace(std::string place) { place_ = std::move(place); }
  [[nodiscard]] std::size_t remaining() const { return bytes_.size() - position_; }

  std::string line() {
    const std::size_t end = bytes_.find('\n', position_);
    if (end == std::string::npos) fail("is cut short in the header; export the mesh again");
    std::string text = bytes_.substr(position_, end - position_);
    if (!text.empty() && text.back() == '\r') text.pop_back();
    position_ = end + 1;
    return text;
  }

  double scalar(const Scalar& type, Encoding encoding) {
    return encoding == Encoding::kAscii ? asciiScalar() : binaryScalar(type, encoding);
  }

 private:
  double asciiScalar() {
    constexpr const char* kSpace = " \t\r\n";
    const std::size_t begin = bytes_.find_first_not_of(kSpace, position_);
    if (begin == std::string::npos) fail("is cut short; export the mesh again");
    std::size_t end = bytes_.find_first_of(kSpace, begin);
    if (end == std::string::npos) end = bytes_.size();
    const std::string token = bytes_.substr(begin, end - begin);
    char* stop = nullptr;
    const double value = std::strtod(token.c_str(), &stop);
    if (stop != token.c_str() + token.size()) fail("'" + token.substr(0, 40) + "' is not a number");
    position_ = end;
    return value;
  }

  double binaryScalar(const Scalar& type, Encoding encoding) {
    if (remaining() < type.size) fail("is cut short; export the mesh again");
    unsigned char raw[8];
    for (std::size_t i = 0; i < type.size; ++i)
      raw[encoding == Encoding::kLittleEndian ? i : type.size - 1 - i] =
          static_cast<unsigned char>(bytes_[position_ + i]);
    position_ += type.size;
    return type.read(raw);
  }

  std::filesystem::path path_;
  std::string bytes_;
  std::size_t position_ = 0;
  std::string place_;
};

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
};

Property readProperty(Source& in, std::istringstream& words) {
  Property property;
  std::string type;
  words >> type;
  if (type == "list") {
    property.is_list = true;
    std::string count_type;
    words >> count_type >> type;
    if (!parseScalar(count_type, property.count_type))
      in.fail("unknown list count type '" + count_type + "'");
  }
  if (!parseScalar(type, property.type)) in.fail("unknown property type '" + type + "'");
  if (!(words >> property.name)) in.fail("property without a name");
  return property;
}

Header readHeader(Source& in) {
  if (in.remaining() < 4 || in.line() != "ply") in.fail("is not a PLY file (no 'ply' in the first line)");
  Header header;
  bool have_format = false;
  for (int number = 2;; ++number) {
    in.setPlace("line " + std::to_string(number));
    std::istringstream words(in.line());
    std::string key;
    words >> key;
    if (key == "end_header") break;
    if (key == "format") {
      std::string format;
      words >> format;
      have_format = true;
      if (format == "ascii")
        header.encoding = Encoding::kAscii;
      else if (format == "binary_little_endian")
        header.encoding = Encoding::kLittleEndian;
      else if (format == "binary_big_endian")
        header.encoding = Encoding::kBigEndian;
      else
        in.fail("unknown format '" + format + "'");
    } else if (key == "element") {
      Element element;
      if (!(words >> element.name >> element.count)) in.fail("element without name and count");
      header.elements.push_back(std::move(element));
    } else if (key == "property") {
      if (header.elements.empty()) in.fail("property before any element");
      header.elements.back().properties.push_back(readProperty(in, words));
    }
  }
  if (!have_format) in.fail("the header names no format");
  return header;
}

// Where a vertex property goes; -1 in a slot means that the file lacks it.
enum Slot { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kS, kT, kSigma, kSlots };

int slotOf(const std::string& name) {
  static const std::pair<const char*, Slot> kNames[] = {
      {"x", kX},     {"y", kY},         {"z", kZ},         {"nx", kNx},      {"ny", kNy}, {"nz", kNz},
      {"red", kRed}, {"green", kGreen}, {"blue", kBlue},   {"s", kS},        {"t", kT},   {"u", kS},
      {"v", kT},     {"texture_u", kS}, {"texture_v", kT}, {"sigma", kSigma}};
  for (const auto& [text, slot] : kNames)
    if (name == text) return slot;
  return -1;
}

// Values of a property of one element; a list's count that is no whole number is rounded down.
std::uint64_t valuesOf(const Property& property, Source& in, Encoding encoding) {
  constexpr double kMost = 4294967295.0;  // of any list: its count has 32 bits
  if (!property.is_list) return 1;
  const double count = in.scalar(property.count_type, encoding);
  return count >= 1 ? static_cast<std::uint64_t>(std::min(count, kMost)) : 0;
}

void skipElementEntry(Source& in, const Element& element, Encoding encoding) {
  for (const Property& property : element.properties) {
    for (std::uint64_t count = valuesOf(property, in, encoding); count > 0; --count)
      in.scalar(property.type, encoding);
  }
}

void readVertices(Source& in, const Element& element, Encoding encoding, Mesh& mesh) {
  bool has[kSlots] = {};
  std::vector<int> slots;
  for (const Property& property : element.properties) {
    const int slot = property.is_list ? -1 : slotOf(property.name);
    slots.push_back(slot);
    if (slot >= 0) has[slot] = true;
  }
  if (!has[kX] || !has[kY] || !has[kZ]) in.fail("vertices lack x, y or z");
  for (std::size_t i = 0; i < element.count; ++i) {
    in.setPlace("vertex " + std::to_string(i));
    double value[kSlots] = {};
    for (std::size_t p = 0; p < slots.size(); ++p) {
      const Property& property = element.properties[p];
      for (std::uint64_t count = valuesOf(property, in, encoding); count > 0; --count) {
        const double v = in.scalar(property.type, encoding);
        if (slots[p] < 0) continue;
        if (!std::isfinite(v)) in.fail("'" + property.name + "' is not finite");
        value[slots[p]] = v;
      }
    }
    const auto f = [&](Slot s) { return static_cast<float>(value[s]); };
    const auto byte = [&](Slot s) { return static_cast<std::uint8_t>(std::clamp(value[s], 0.0, 255.0)); };
    mesh.vertices.emplace_back(f(kX), f(kY), f(kZ));
    if (has[kNx] && has[kNy] && has[kNz]) mesh.normals.emplace_back(f(kNx), f(kNy), f(kNz));
    if (has[kRed] && has[kGreen] && has[kBlue])
      mesh.colours.push_back({byte(kRed), byte(kGreen), byte(kBlue)});
    if (has[kS] && has[kT]) mesh.texture_coordinates.emplace_back(f(kS), f(kT));
    if (has[kSigma]) mesh.sigma.push_back(f(kSigma));
  }
}

void readFaces(Source& in, const Element& element, Encoding encoding, Mesh& mesh) {
  constexpr double kMaxCorners = 1000;  // of one polygon; more is taken as damage
  for (std::size_t i = 0; i < element.count; ++i) {
    in.setPlace("face " + std::to_string(i));
    for (const Property& property : element.properties) {
      if (!property.is_list) {
        in.scalar(property.type, encoding);
        continue;
      }
      const bool indices = property.name == "vertex_indices" || property.name == "vertex_index";
      const double count = in.scalar(property.count_type, encoding);
      if (!(count >= 0 && count <= kMaxCorners))
        in.fail("a polygon of " + std::to_string(count) + " corners");
      std::uint32_t first = 0, last = 0;
      for (int corner = 0; corner < static_cast<int>(count); ++corner) {
        const double value = in.scalar(property.type, encoding);
        if (!indices) continue;
        if (!(value >= 0 && value < static_cast<double>(mesh.vertices.size())))
          in.fail("vertex index " + std::to_string(value) + " of " + std::to_string(mesh.vertices.size()) +
                  " vertices");
        const auto index = static_cast<std::uint32_t>(value);
        if (corner == 0) first = index;
        if (corner >= 2) mesh.triangles.push_back({first, last, index});
        last = index;
      }
    }
  }
}

std::string readAll(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path))
    throw InputError(path, "", "cannot be read; give a PLY mesh");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

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

void put(std::string& out, const auto& value) {
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

Mesh readPly(const std::filesystem::path& path) {
  Source in(path, readAll(path));
  const Header header = readHeader(in);
  Mesh mesh;
  for (const Element& element : header.elements) {
    // Every entry takes at least a byte (two in ascii): a larger count is damage, not a reason to allocate.
    if (!element.properties.empty() && element.count > in.remaining())
      in.fail("announces " + std::to_string(element.count) + " of '" + element.name +
              "' but holds fewer bytes");
    if (element.name == "vertex")
      readVertices(in, element, header.encoding, mesh);
    else if (element.name == "face")
      readFaces(in, element, header.encoding, mesh);
    else if (!element.properties.empty())
      for (std::size_t i = 0; i < element.count; ++i) skipElementEntry(in, element, header.encoding);
  }
  if (mesh.vertices.empty()) in.fail("holds no vertices");
  return mesh;
}

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
