#include "firmware_if/files/images/image_times.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {

std::vector<ImageTime> readImageTimes(const std::filesystem::path& path) {
  std::vector<ImageTime> times;
  std::ifstream stream(path);
  if (!stream) return times;
  std::string line;
  std::getline(stream, line);  // the header
  for (int number = 2; std::getline(stream, line); ++number) {
    const std::size_t comma = line.find(','),
                      second = line.find(',', comma == std::string::npos ? 0 : comma + 1);
    std::int64_t utc_ns = 0;
    const auto parsed = std::from_chars(line.data(), line.data() + std::min(comma, line.size()), utc_ns);
    if (comma == std::string::npos || second == std::string::npos || parsed.ec != std::errc() ||
        parsed.ptr != line.data() + comma) {
      throw InputError(path.string(), "line " + std::to_string(number),
                       "is not utc_ns,left_image,right_image; make the mission again");
    }
    times.push_back({utc_ns, line.substr(comma + 1, second - comma - 1), line.substr(second + 1)});
  }
  return times;
}

}  // namespace fathom::io
