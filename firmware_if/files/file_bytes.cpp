#include "firmware_if/files/file_bytes.hpp"

#include <fstream>
#include <string>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {

std::vector<std::uint8_t> readFileBytes(const std::filesystem::path& path, std::size_t max_bytes,
                                        const char* what) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error))
    throw InputError(path, "", std::string("is absent or no file; give ") + what);
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = in ? static_cast<std::streamoff>(in.tellg()) : -1;
  if (size < 0) throw InputError(path, "", "cannot be read; check its permissions");
  if (size == 0) throw InputError(path, "", std::string("is empty; give ") + what);
  if (static_cast<std::uint64_t>(size) > max_bytes)
    throw InputError(path, "",
                     "has " + std::to_string(size) + " bytes, more than the " + std::to_string(max_bytes) +
                         " that " + what + " may have");
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  in.seekg(0);
  if (!in.read(reinterpret_cast<char*>(bytes.data()), size))
    throw InputError(path, "", "cannot be read to its end; check the disk");
  return bytes;
}

}  // namespace fathom::io
