#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fathom::io {

// One line of truth/images.csv of a simulated mission, utc_ns,left_image,right_image: when a pair was truly
// exposed.
struct ImageTime {
  std::int64_t utc_ns = 0;
  std::string left, right;
};

// Empty when there is no such file. Throws InputError for one that is damaged.
[[nodiscard]] std::vector<ImageTime> readImageTimes(const std::filesystem::path& path);

}  // namespace fathom::io
