#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "recon/import/images/image_samples.hpp"

namespace fathom::topside {

// What a camera's images are, by some of them: the format and the bits that hold all, and the size of the
// first.
struct Probed {
  PixelFormat format = PixelFormat::kMono;
  int bits = 8;
  std::array<int, 2> size{0, 0};  // width, height [px]
};

// `names`: of files in `folder`; `option`: that says what samples are. Files that cannot be read are passed
// over. Throws InputError where nobody says that grey images are a mosaic, as they seem to be.
[[nodiscard]] Probed probe(const std::filesystem::path& folder, const std::vector<std::string>& names,
                           Samples samples, const char* option);

}  // namespace fathom::topside
