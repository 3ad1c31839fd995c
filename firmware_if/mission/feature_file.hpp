#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "firmware_if/mission/mission.hpp"
#include "recon/geometry/stereo_feature_frame.hpp"

namespace fathom::io {

// The feature file of a pair, by its left image's name: "PR_..._LC16.tif" gives "PR_..._LC16.feat". Any other
// extension is replaced likewise.
[[nodiscard]] std::string featureFileName(const std::string& left_image_name);

// Whether the mission has features/ and no img/.
[[nodiscard]] bool isFeatureMission(const MissionPaths& paths);

// Reads features/NAME.feat; firmware_if/README.md describes the bytes. Throws InputError naming file, place
// and fix: an absent, empty, truncated or foreign file, one of another version, a wrong CRC, or numbers that
// cannot be (a pixel outside the image, a size or a standard deviation of zero).
[[nodiscard]] StereoFeatureFrame readFeatureFile(const std::filesystem::path& path);
// The same into a frame, which reuses its memory; after a throw it is empty.
void readFeatureFile(const std::filesystem::path& path, StereoFeatureFrame& frame);
// The same from bytes; `name` is what errors call them.
void parseFeatureFile(std::span<const std::uint8_t> bytes, const std::string& name,
                      StereoFeatureFrame& frame);

// Writes under a temporary name, then renames. Pixels are rounded to 1/512 px, the other numbers as the
// README says. Throws std::invalid_argument for a frame that could not be read back.
void writeFeatureFile(const std::filesystem::path& path, const StereoFeatureFrame& frame);
[[nodiscard]] std::vector<std::uint8_t> encodeFeatureFile(const StereoFeatureFrame& frame);

}  // namespace fathom::io
