#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/import/images/stereo_files.hpp"

namespace fathom::topside {

// When a camera says that it took an image: DateTimeOriginal and SubSecTimeOriginal of a JPEG's EXIF, as if
// UTC [ns].
[[nodiscard]] std::optional<std::int64_t> exifTime(const std::filesystem::path& image);

// "3 images are" to "3 images are left out: a.png, b.png, c.png", of many the first few.
[[nodiscard]] std::string leftOut(const std::string& which, const std::vector<std::string>& names);

// Gives all pairs their times, if most have one and these differ: by `pattern` (NameTime), else those that
// they have, else by the usual forms of the left images' names, else as the left images' EXIF says, else
// none. Adds to `assumed` what was taken; pairs that have none where most do are left out. Throws InputError
// for a pattern that does not fit.
void takeTimes(const std::string& pattern, StereoFiles& files);

}  // namespace fathom::topside
