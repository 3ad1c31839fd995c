#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

// One plausible rig, and how others write it: each function gives the text of a file, or writes files, from
// the rig and by that program's conventions, none of which the reader's code is used for.
[[nodiscard]] StereoRig divingRig();

// cv::FileStorage itself writes these: by extension YAML, XML or JSON. `unit` is that of T [m].
void writeOpenCv(const std::filesystem::path& path, const StereoRig& rig, double unit = 1);
void writeOpenCvPair(const std::filesystem::path& intrinsics, const std::filesystem::path& extrinsics,
                     const StereoRig& rig);

[[nodiscard]] std::string kalibrText(const StereoRig& rig);

[[nodiscard]] std::string colmapCameras(const StereoRig& rig);  // numbers 7 (left) and 3
[[nodiscard]] std::string colmapRigs(const StereoRig& rig);
[[nodiscard]] nlohmann::ordered_json colmapRigConfig(const StereoRig& rig);

// toStruct() before R2022b, in millimetres; and the object from then on, in metres.
[[nodiscard]] nlohmann::ordered_json matlabStruct(const StereoRig& rig);
[[nodiscard]] nlohmann::ordered_json matlabObject(const StereoRig& rig);

}  // namespace fathom::test
