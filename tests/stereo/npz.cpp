#include "tests/stereo/npz.hpp"

#include <zlib.h>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

namespace fathom::test {
namespace {

std::uint32_t number(const std::string& bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8 | static_cast<std::uint8_t>(bytes.at(at + i));
  return value;
}

// Content of the archive's first file. Sizes come from the central directory: the local header may leave them
// out.
std::string firstFile(const std::string& zip) {
  constexpr std::uint32_t kDirectoryEnd = 0x06054b50;
  std::size_t end = zip.size() >= 22 ? zip.size() - 22 : 0;
  while (end > 0 && number(zip, end, 4) != kDirectoryEnd) --end;
  if (end == 0) throw std::runtime_error("not a zip archive");
  const std::size_t directory = number(zip, end + 16, 4);
  const std::uint32_t method = number(zip, directory + 10, 2);
  const std::uint32_t packed = number(zip, directory + 20, 4), size = number(zip, directory + 24, 4);
  const std::size_t local = number(zip, directory + 42, 4);
  const std::size_t data = local + 30 + number(zip, local + 26, 2) + number(zip, local + 28, 2);
  if (method == 0) return zip.substr(data, size);
  std::string content(size, '\0');
  z_stream stream{};
  if (method != 8 || inflateInit2(&stream, -MAX_WBITS) != Z_OK)
    throw std::runtime_error("unknown compression");
  std::string input = zip.substr(data, packed);
  stream.next_in = reinterpret_cast<Bytef*>(input.data());
  stream.avail_in = packed;
  stream.next_out = reinterpret_cast<Bytef*>(content.data());
  stream.avail_out = size;
  const int status = inflate(&stream, Z_FINISH);
  inflateEnd(&stream);
  if (status != Z_STREAM_END) throw std::runtime_error("damaged zip archive");
  return content;
}

}  // namespace

FloatArray readNpz(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string npy = firstFile({std::istreambuf_iterator<char>(in), {}});
  const std::size_t header = number(npy, 8, 2);
  const std::string text = npy.substr(10, header);
  const std::size_t shape = text.find("'shape': (");
  FloatArray array;
  if (text.find("'<f4'") == std::string::npos || text.find("'fortran_order': False") == std::string::npos ||
      shape == std::string::npos ||
      std::sscanf(text.c_str() + shape, "'shape': (%d, %d)", &array.rows, &array.columns) != 2)
    throw std::runtime_error("not a two-dimensional float32 array");
  array.values.resize(static_cast<std::size_t>(array.rows) * static_cast<std::size_t>(array.columns));
  if (npy.size() != 10 + header + array.values.size() * sizeof(float))
    throw std::runtime_error("array is cut");
  std::memcpy(array.values.data(), npy.data() + 10 + header, array.values.size() * sizeof(float));
  return array;
}

}  // namespace fathom::test
