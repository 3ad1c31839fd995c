#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// "PR_YYYYMMDD_HHMMSS_mmm_LC16.tif" (left) or "..._RM16.tif" (right); UTC, truncated to the millisecond.
[[nodiscard]] FileName imageFileName(std::int64_t utc_ns, CameraSide side);
// Time [ns] and side of such a name; std::nullopt for any other name or an impossible date.
struct ImageName {
  std::int64_t utc_ns = 0;
  CameraSide side = CameraSide::kLeft;
};
[[nodiscard]] std::optional<ImageName> parseImageFileName(const std::string& name);

// Whether `name`, from a log or pose file, can only be a file inside its folder: not empty, no slash, not
// "..".
[[nodiscard]] bool plainFileName(const std::string& name);
// The same for a file in a folder below it: "left/0001.png".
[[nodiscard]] bool nameInside(const std::string& name);

// An image read from a file, owning its pixels.
struct ImageFile {
  std::vector<std::uint8_t> bytes;
  ImageView view;                              // into `bytes`
  std::shared_ptr<const ImageMask> mask = {};  // that of the view, if it has one
};

// Reads a single-channel 8 or 16 bit TIFF (or PNG); `format` and `bits` as mission.toml says. Throws
// InputError on an absent, truncated or foreign file, or a size other than width x height (0: any).
[[nodiscard]] ImageFile readImage(const std::filesystem::path& path, PixelFormat format, int bits,
                                  int width = 0, int height = 0);
// Reads a grey or RGB TIFF, PNG or JPEG of 8 or 16 bit as it is, for tools that are given single images:
// format kMono or kRgb (a Bayer mosaic is stored as grey), and bits 8, or the fewest of 10, 12 and 16 that
// hold its brightest sample. Throws InputError on an absent, truncated or foreign file.
[[nodiscard]] ImageFile readAnyImage(const std::filesystem::path& path);
// Writes TIFF (lossless, deflate) under a temporary name, then renames.
void writeImage(const std::filesystem::path& path, const ImageView& image);

// One line of truth/images.csv of a simulated mission, utc_ns,left_image,right_image: true time of a pair's
// exposure.
struct ImageTime {
  std::int64_t utc_ns = 0;
  std::string left, right;
};

// Empty when there is no such file. Throws InputError for one that is damaged.
[[nodiscard]] std::vector<ImageTime> readImageTimes(const std::filesystem::path& path);

// The images of a mission, of the formats, bits and sizes that its mission.toml and calibration say.
// Thread-safe.
class MissionImages {
 public:
  MissionImages(const MissionPaths& paths, const MissionConfig& mission, const StereoRig& rig)
      : folder_(paths.images()), cameras_(mission.cameras), left_(rig.left), right_(rig.right) {}

  // Throws InputError, which names the file, for one that is absent, damaged or other than that.
  [[nodiscard]] ImageFile read(const std::string& name, CameraSide side) const {
    const bool is_left = side == CameraSide::kLeft;
    const Camera& camera = is_left ? left_ : right_;
    return readImage(folder_ / name, is_left ? cameras_.left_format : cameras_.right_format, cameras_.bits,
                     camera.width, camera.height);
  }

 private:
  std::filesystem::path folder_;
  MissionConfig::Cameras cameras_;
  Camera left_, right_;
};

}  // namespace fathom::io
