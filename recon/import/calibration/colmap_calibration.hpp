#pragma once

#include "recon/import/calibration/camera_pair.hpp"

namespace fathom::topside {

// COLMAP's text files: the lenses in cameras.txt, a line each
//
//   CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]
//
// with SIMPLE_PINHOLE f cx cy, PINHOLE fx fy cx cy, SIMPLE_RADIAL f cx cy k1, RADIAL f cx cy k1 k2, OPENCV fx
// fy cx cy k1 k2 p1 p2, FULL_OPENCV ... k3 k4 k5 k6, the last three zero; and beside it the rig, whose
// reference camera is taken for the left one: rigs.txt (COLMAP 3.12)
//
//   RIG_ID NUM_SENSORS REF_TYPE REF_ID (SENSOR_TYPE SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ])[]
//
// or rig_config.json, x_camera = R x_rig + t as there:
//
//   [{"ref_camera_id": 1, "cameras": [{"camera_id": 1, "cam_from_rig_rotation": [w, x, y, z],
//                                      "cam_from_rig_translation": [x, y, z]}, ...]}]
//
// or with "ref_sensor": true and, without cameras.txt, "camera_model_name" and "camera_params". Lengths are
// taken for metres, which COLMAP does not promise. Pixel (0.5, 0.5) is the centre of the top left pixel in
// COLMAP: principal points are shifted by half. Source: colmap.github.io/format.html, cameras.html,
// rigs.html.

// "cameras.txt" or "rigs.txt" by its first line of data; "" for other text.
[[nodiscard]] std::string colmapFileOf(const std::string& text);
[[nodiscard]] bool isColmapRig(const CalibrationTree& tree);

// From any of these files, with the others beside it.
[[nodiscard]] CameraPair readColmapText(const std::filesystem::path& file);
[[nodiscard]] CameraPair readColmapRig(const std::filesystem::path& file, const CalibrationTree& tree);

}  // namespace fathom::topside
